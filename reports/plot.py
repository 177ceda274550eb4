"""A figure as a page shows it: drawing, caption, legend, and all its data, also as files to take along."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from reports.text import number, tick
from suite.linalg import Array

TABLE_ROWS = 60
"""Rows of a figure's table on the page at most; its file has all."""


@dataclass(frozen=True)
class Column:
    """Values of a figure's data under their head; series: label of the estimator they are of, role: value, low or high."""

    head: str
    values: Sequence[object] | Array
    series: str = ""
    role: str = "value"


@dataclass(frozen=True)
class Plot:
    """A figure with its title, caption, drawing (None where there is nothing to draw), estimators in its legend, and data.

    The first column is the abscissa. x, y: titles of the axes with their units; log: which of them are logarithmic ("", "x",
    "y", "xy"). whole: the rows in which nothing is left out, where that is not all of them.
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
        words = [[_word(column.values[i], not place) for i in self.shown] for place, column in enumerate(self.columns)]
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
    """The data of figures as CSV files, and each figure for LaTeX, drawn by pgfplots from its CSV file."""
    for plot in plots:
        if plot.drawing:
            yield f"data/{stem}-{plot.id}.csv", to_csv(plot)
            yield f"data/{stem}-{plot.id}.tex", to_latex(plot, f"{stem}-{plot.id}.csv")


def to_csv(plot: Plot) -> str:
    """The data of a figure, comma-separated, numbers to seven digits; what does not exist is empty."""
    lines = [",".join(_quoted(head) for head in plot.header)]
    lines += [",".join(_cell(column.values[i]) for column in plot.columns) for i in range(plot.steps)]
    return "\n".join(lines) + "\n"


def to_latex(plot: Plot, table: str) -> str:
    """A figure for LaTeX with the package pgfplots, which reads its numbers from the CSV file `table` beside it."""
    kind = {"": "axis", "x": "semilogxaxis", "y": "semilogyaxis", "xy": "loglogaxis"}[plot.log]
    lines = [r"% Needs \usepackage{pgfplots}, \pgfplotsset{compat=1.18}.", r"\begin{figure}", r"\centering",
             r"\begin{tikzpicture}",
             rf"\begin{{{kind}}}[width=\linewidth, height=0.55\linewidth, xlabel={{{tex(plot.x)}}}, ylabel={{{tex(plot.y)}}},",
             r"  legend pos=outer north east, legend cell align=left, unbounded coords=jump]"]  # fmt: skip
    for place, column in enumerate(plot.columns):
        if place and column.role == "value" and not _words(column):
            lines.append(rf"\addplot table[col sep=comma, x index=0, y index={place}]{{{table}}};")
            lines.append(rf"\addlegendentry{{{tex(column.series or column.head)}}}")
    lines += [rf"\end{{{kind}}}", r"\end{tikzpicture}", rf"\caption{{{tex(plot.caption)}}}", r"\end{figure}"]
    return "\n".join(lines) + "\n"


def _words(column: Column) -> bool:
    return any(isinstance(value, str) for value in column.values)


def _cell(value: object) -> str:
    if isinstance(value, str):
        return _quoted(value)
    x = float(value)  # type: ignore[arg-type]
    return "" if np.isnan(x) else f"{x:.7g}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if re.search(r'[",\r\n]', text) else text


_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\u202f": r"\,"}
_SPECIAL |= {sign: f"\\{sign}" for sign in "&%$#_{}"}


def tex(text: str) -> str:
    """Words for LaTeX, signs that it would take for commands escaped."""
    return "".join(_SPECIAL.get(sign, sign) for sign in " ".join(text.split()))
