"""A figure as a page shows it: drawing, caption, legend, and all its data, also as files to take along."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from reports.text import number, tick
from suite.linalg import Array

TABLE_ROWS = 30
"""Rows of a figure's table on the page at most; its file has all."""
MARKERS_ON_A_LINE = 7
"""Of a figure for LaTeX."""


@dataclass(frozen=True)
class Column:
    """Values of a figure's data under their head; series: label of the estimator they are of, role: value, low or high.

    over: head of the column that is their abscissa, where that is not the first one.
    """

    head: str
    values: Sequence[object] | Array
    series: str = ""
    role: str = "value"
    over: str = ""


@dataclass(frozen=True)
class Plot:
    """A figure with its title, caption, drawing (None where there is nothing to draw), estimators in its legend, and data.

    The first column is the abscissa, or names points. x, y: titles of the axes with their units; log: which of them are
    logarithmic ("", "x", "y", "xy"). whole: the rows in which nothing is left out, where that is not all of them. first: those
    of many estimators that are shown at first; all where it is empty. nothing: why there is nothing to draw. metrics: names of
    those whose formulas stand below it.
    """

    id: str
    title: str
    caption: str
    drawing: Markup | None
    labels: Sequence[str]
    columns: Sequence[Column]
    x: str = "time (s)"
    y: str = ""
    log: str = ""
    whole: Sequence[int] = ()
    first: Sequence[str] = ()
    nothing: str = ""
    metrics: Sequence[str] = ()

    @property
    def header(self) -> list[str]:
        """Heads of the table under the figure."""
        return [column.head for column in self.columns]

    @property
    def steps(self) -> int:
        """Rows of the data."""
        return len(self.columns[0].values) if self.columns else 0

    @property
    def shown(self) -> list[int]:
        """Rows that the table on the page has: all, or `TABLE_ROWS` of the whole ones, the first and the last included."""
        if self.steps <= TABLE_ROWS:
            return list(range(self.steps))
        rows = self.whole or range(self.steps)
        return sorted({int(rows[int(i)]) for i in np.linspace(0, len(rows) - 1, TABLE_ROWS).round()})

    @property
    def rows(self) -> list[list[str]]:
        """Rows of the table under the figure, in words."""
        shown = self.shown
        words = [[_word(column.values[i], not place) for i in shown] for place, column in enumerate(self.columns)]
        return [list(row) for row in zip(*words, strict=True)]

    @property
    def note(self) -> str:
        """Says which rows of the data the table leaves out."""
        left = len(self.shown) < self.steps
        return f"{len(self.shown)} of {self.steps} rows, spread evenly; the CSV file has all." if left else ""


def _word(value: object, first: bool) -> str:
    if isinstance(value, str):
        return value
    return tick(float(value)) if first else number(float(value))  # type: ignore[arg-type]


def data_files(stem: str, plots: Sequence[Plot]) -> Iterator[tuple[str, str]]:
    """The data of figures as CSV files, and each figure for LaTeX, drawn by pgfplots."""
    for plot in plots:
        if plot.drawing:
            yield f"data/{stem}-{plot.id}.csv", to_csv(plot)
            yield f"data/{stem}-{plot.id}.tex", to_latex(plot, f"{stem}-{plot.id}.csv")


def to_csv(plot: Plot) -> str:
    """The data of a figure."""
    return table_csv(plot.columns)


def table_csv(columns: Sequence[Column]) -> str:
    """Columns, comma-separated, numbers to seven digits; what does not exist is empty."""
    lines = [",".join(_quoted(column.head) for column in columns)]
    lines += [",".join(_cell(value) for value in row) for row in zip(*(column.values for column in columns), strict=True)]
    return "\n".join(lines) + "\n"


def to_latex(plot: Plot, table: str) -> str:
    """A figure for LaTeX with the package pgfplots.

    It reads its numbers from the CSV file `table` beside it, in which pgfplots must find no words; where rows have names the
    numbers stand in the figure itself.
    """
    kind = {"": "axis", "x": "semilogxaxis", "y": "semilogyaxis", "xy": "loglogaxis"}[plot.log]
    names = next((column.values for column in plot.columns if _words(column)), None)
    drawn = _lines(plot, table) if names is None else _points(plot, [str(name) for name in names])
    ticks = ""
    if names is not None and not any(column.over for column in plot.columns):
        words = ", ".join(f"{{{tex(str(name))}}}" for name in names)
        ticks = rf"  xtick={{1,...,{len(names)}}}, xticklabels={{{words}}}, x tick label style={{rotate=60, anchor=east}},"
    return "\n".join([
        r"% Needs \usepackage{pgfplots} and \pgfplotsset{compat=1.18}.",
        r"\begin{figure}",
        r"\centering",
        r"\begin{tikzpicture}",
        rf"\begin{{{kind}}}[width=\linewidth, height=0.55\linewidth, xlabel={{{tex(plot.x)}}}, ylabel={{{tex(plot.y)}}},",
        *([ticks] if ticks else []),
        r"  cycle multiindex* list={exotic\nextlist linestyles\nextlist}, legend cell align=left, legend columns=2,",
        r"  legend style={at={(0.5,-0.3)}, anchor=north, font=\footnotesize}, unbounded coords=jump]",
        *drawn,
        rf"\end{{{kind}}}",
        r"\end{tikzpicture}",
        rf"\caption{{{tex(plot.caption)}}}",
        r"\end{figure}",
        "",
    ])  # fmt: skip


def _curves(plot: Plot) -> Iterator[tuple[int, int]]:
    """Places of the columns that are drawn, each with that of its abscissa."""
    abscissae = {column.over for column in plot.columns}
    for place, column in enumerate(plot.columns):
        if place and column.role == "value" and column.head not in abscissae and not _words(column):
            yield place, plot.header.index(column.over) if column.over else 0


def _ends(plot: Plot, place: int) -> list[int]:
    """Places of the columns with the lower and the upper end of the intervals of the one at a place, which follow it."""
    following = [column.role for column in plot.columns[place + 1 : place + 3]]
    return [place + 1, place + 2] if following == ["low", "high"] else []


def _lines(plot: Plot, table: str) -> Iterator[str]:
    """Lines through the rows of the CSV file; thin ones of the same colour at the ends of the intervals."""
    markers = f"mark repeat={max(1, plot.steps // MARKERS_ON_A_LINE)}"
    for y, x in _curves(plot):
        read = f"table[col sep=comma, header=false, skip first n=1, x index={x}, y index="
        for end in _ends(plot, y):
            yield rf"\addplot+[no marks, solid, thin, opacity=0.4, forget plot] {read}{end}]{{{table}}};"
        yield rf"\addplot+[{markers}] {read}{y}]{{{table}}};"
        yield rf"\addlegendentry{{{tex(plot.columns[y].series or plot.columns[y].head)}}}"


def _points(plot: Plot, names: Sequence[str]) -> Iterator[str]:
    """Marks with their intervals: rows of the same name as one series, or, over the rows themselves, columns."""
    for y, x in _curves(plot):
        groups = {plot.columns[y].series or plot.columns[y].head: list(range(plot.steps))}
        if plot.columns[y].over:
            groups = {name: [i for i, other in enumerate(names) if other == name] for name in names}
        for name, rows in groups.items():
            yield r"\addplot+[only marks, error bars/.cd, x dir=both, x explicit, y dir=both, y explicit]"
            yield r"  table[x=x, y=y, x error minus=xl, x error plus=xh, y error minus=yl, y error plus=yh]{"
            yield "x xl xh y yl yh"
            for i in rows:
                across = _bars(plot, x, i) if plot.columns[y].over else [str(i + 1), "0", "0"]
                yield " ".join([*across, *_bars(plot, y, i)])
            yield "};"
            yield rf"\addlegendentry{{{tex(name)}}}"


def _bars(plot: Plot, place: int, row: int) -> list[str]:
    """The value of a column in a row, and how far its interval reaches below and above it."""
    value, *ends = (float(plot.columns[at].values[row]) for at in (place, *_ends(plot, place)))  # type: ignore[arg-type]
    reach = [abs(end - value) if np.isfinite(end) else 0.0 for end in ends] or [0.0, 0.0]
    return [f"{x:.7g}" for x in (value, *reach)]


def _words(column: Column) -> bool:
    return any(isinstance(value, str) for value in column.values)


def _cell(value: object) -> str:
    if isinstance(value, str):
        return _quoted(value)
    x = float(value)  # type: ignore[arg-type]
    return "" if np.isnan(x) else f"{x:.7g}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if re.search(r'[",\r\n]', text) else text


_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\u00a0": "~", "\u202f": r"\,",
    "\N{MINUS SIGN}": "$-$", "\N{MULTIPLICATION SIGN}": r"$\times$", "·": r"$\cdot$", "±": r"$\pm$", "√": r"$\surd$",
    "∞": r"$\infty$", "≤": r"$\leq$", "≥": r"$\geq$", "≈": r"$\approx$", "≠": r"$\neq$", "→": r"$\to$", "↦": r"$\mapsto$",
    "µ": r"$\mu$", "°": r"$^\circ$", "✕": r"$\times$", "⁻": "$^-$", "…": r"\dots{}", "\N{EN DASH}": "--", "—": "---",
    "\N{LEFT SINGLE QUOTATION MARK}": "`", "\N{RIGHT SINGLE QUOTATION MARK}": "'", "“": "``", "”": "''", "[": "{[}", "]": "{]}",
}  # fmt: skip
_SPECIAL |= {sign: f"\\{sign}" for sign in "&%$#_{}"}
_SPECIAL |= {sign: f"$^{i}$" for i, sign in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")} | {sign: f"$_{i}$" for i, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")}
_GREEK = (
    "αalpha βbeta γgamma δdelta εvarepsilon ζzeta ηeta θtheta κkappa λlambda μmu νnu πpi ρrho σsigma τtau φvarphi χchi ψpsi "
    "ωomega ΔDelta ΣSigma ΩOmega"
)
_SPECIAL |= {name[0]: f"$\\{name[1:]}$" for name in _GREEK.split()}


def tex(text: str) -> str:
    """Words for LaTeX, signs that it would take for commands escaped."""
    return "".join(_SPECIAL.get(sign, sign) for sign in re.sub(r"[ \t\r\n]+", " ", text).strip(" "))
