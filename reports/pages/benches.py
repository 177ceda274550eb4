"""Benchmarks of pytest-benchmark files on the page of running times: each machine apart, against rivals, and over files."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from reports.frame import Frame
from reports.marks import Mark, marks
from reports.pages.bench_figures import against, commit, history, moment, spaced, values
from reports.plot import Plot
from reports.text import Quantity, number, quantity, slugs, within
from suite.benchmarks import Row
from suite.metrics import METRICS, Score


@dataclass(frozen=True)
class Source:
    """A file: its name, date, machine, node, Python, commit, and how many benchmarks it holds."""

    name: str
    date: str
    machine: str
    node: str
    python: str
    commit: str
    benchmarks: int


@dataclass(frozen=True)
class Line:
    """A benchmark in the table of its group: value in words, rounds, ratios in words, and what else it says."""

    label: str
    value: Quantity
    rounds: int
    ratios: Sequence[str]
    told: str


@dataclass(frozen=True)
class Group:
    """Benchmarks of one group in the newest file that has it, with their figure, and their history where there is one.

    about: what they say of themselves together. ratios: names of the columns of ratios.
    """

    title: str
    when: str
    about: Sequence[str]
    ratios: Sequence[str]
    lines: Sequence[Line]
    plot: Plot | None
    history: Plot | None


@dataclass(frozen=True)
class Machine:
    """A machine with its groups, and how many files are of it."""

    name: str
    files: int
    groups: Sequence[Group]

    @property
    def plots(self) -> Iterator[Plot]:
        """The figures of all groups."""
        for group in self.groups:
            yield from filter(None, (group.plot, group.history))


def sources(rows: Sequence[Row]) -> list[Source]:
    """The files, the oldest first."""
    about = ("source", "date", "machine", "node", "python")
    found: dict[Source, int] = {}
    for row in rows:
        source = Source(*(row[name] for name in about), commit(row), 0)
        found[source] = found.get(source, 0) + 1
    counted = [Source(**(vars(source) | {"benchmarks": n, "date": moment(source.date)})) for source, n in found.items()]
    return sorted(counted, key=lambda source: source.date)


def machines(frame: Frame, rows: Sequence[Row]) -> list[Machine]:
    """The machines, each with the groups of benchmarks that were timed on it."""
    apart: dict[str, dict[tuple[str, ...], Row]] = {}
    for row in sorted(rows, key=lambda row: row["date"]):  # the same file may be named twice
        apart.setdefault(_machine(row), {})[row["date"], row["group"] or "", row["metric"], row["name"]] = row
    looks = all_marks(frame, rows)
    return [
        Machine(name, len({row["date"] for row in held.values()}), list(_groups(list(held.values()), looks, place)))
        for place, (name, held) in enumerate(apart.items())
    ]


def all_marks(frame: Frame, rows: Sequence[Row]) -> dict[str, Mark]:
    """The marks of estimators, and after them those of what else is timed or held against."""
    return frame.marks | marks([*frame.labels, *_others(frame, rows)])


def all_anchors(frame: Frame, rows: Sequence[Row]) -> dict[str, str]:
    """Names of all of these that a script can tell apart."""
    return {name: f"other-{anchor}" for name, anchor in slugs(_others(frame, rows)).items()} | frame.anchors


def _others(frame: Frame, rows: Sequence[Row]) -> list[str]:
    named = [name for row in rows for name in (subject(row), row["name"], *map(spaced, row["against"]))]
    return [name for name in dict.fromkeys(named) if name not in frame.marks]


def _machine(row: Row) -> str:
    return f"{row['machine']}, node {row['node']}"


def subject(row: Row) -> str:
    """What a benchmark times: the estimator that it names, else its parameter, else its own name."""
    parameter = re.fullmatch(r".*?\[(.+)\]", row["name"])
    return str(row.get("estimator") or (parameter[1] if parameter else row["name"]))


def _labels(rows: Sequence[Row]) -> list[str]:
    """The subjects of the rows; their whole names where subjects are not told apart."""
    short = [subject(row) for row in rows]
    return short if len(set(short)) == len(short) else [row["name"] for row in rows]


def _groups(rows: Sequence[Row], looks: dict[str, Mark], place: int) -> Iterator[Group]:
    """The groups of a machine, by the newest file that has each."""
    apart: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        apart.setdefault((row["group"] or "", row["metric"]), []).append(row)
    for i, ((title, _), held) in enumerate(apart.items()):
        newest = [row for row in held if row["date"] == held[-1]["date"]]
        ratios = list(dict.fromkeys(ratio for row in newest for ratio in row["against"]))
        labels, name = _labels(newest), f"bench-{place}-{i}"
        yield Group(
            title or "Benchmarks without a group",
            f"{moment(held[-1]['date'])}, commit {commit(held[-1])}, Python {held[-1]['python']}",
            list(dict.fromkeys(str(row["told"]["table"]) for row in newest if "table" in row["told"])),
            list(map(spaced, ratios)),
            [_line(row, label, ratios) for row, label in zip(newest, labels, strict=True)],
            _of(title, against(newest, labels, ratios, looks, name) if ratios else values(newest, labels, looks, name)),
            _of(title, history(held, newest, labels, looks, f"{name}-history")),
        )


def _of(group: str, plot: Plot | None) -> Plot | None:
    """A figure that names its group: saved by itself it has no heading above it."""
    return replace(plot, title=f"{plot.title}, {group}") if plot and group else plot


def _line(row: Row, label: str, ratios: Sequence[str]) -> Line:
    scale, unit = (1e6, "µs") if row["unit"] == "s" else (1.0, row["unit"])
    ends = (scale * row[end] for end in ("value", "low", "high"))
    score = Score(*ends, unit, 2, 2)  # a single round has no interval either
    value = quantity(score, METRICS["latency" if unit == "µs" else row["metric"]])
    elsewhere = {"table", *(("estimator", "case", "runs", "steps", "us_per_run_step") if "estimator" in row else ())}
    told = [f"{spaced(name)} {each if isinstance(each, str | int) else number(each)}" for name, each in row["told"].items()
            if name not in elsewhere]  # fmt: skip
    return Line(label, value, row["rounds"], [_ratio(row["against"].get(ratio)) for ratio in ratios], "; ".join(told))


def _ratio(ratio: tuple[float, float, float] | None) -> str:
    if ratio is None:
        return ""
    return f"{number(ratio[0])} (no interval)" if math.isnan(ratio[1]) else within(*ratio, "")
