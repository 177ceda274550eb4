"""What the command line prints: tables of registry entries and of scores."""

import itertools
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import Any

import pandas
from rich.console import Console
from rich.table import Table
from rich.text import Text

from suite import parameters, score
from suite.case import Case
from suite.compare import Comparison
from suite.differences import Interval
from suite.metrics import METRICS, SURVIVING
from suite.state_tests import StateTest, Tested
from suite.verdicts import Verdict


def describe(entry: Any) -> str:
    """What a case, a metric or an estimator is, with the parameters it takes."""
    if isinstance(entry, Case):
        blocks = ", ".join(b.title for b in entry.blocks)
        modes = f"; modes: {', '.join(entry.modes)}" if entry.modes else ""
        return f"{entry.title}; {entry.steps} steps; {blocks}{modes}"
    if entry.name in METRICS and entry is METRICS[entry.name]:
        better = entry.better if isinstance(entry.better, str) else f"target {entry.better:g}"
        return f"{entry.title} ({better}); {entry.words}"
    lines = [(type(entry).__doc__ or "").strip().partition("\n")[0]]
    for name, value in parameters.values(entry).items():
        lines.append(f"  {name}={value}  {parameters.fields(entry)[name].metadata.get('doc', '')}")
    return "\n".join(lines)


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; where the output is no terminal, plainly and 160 characters wide."""
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    for name in header:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def print_verdicts(found: Iterable[Verdict]) -> None:
    """Print published figures beside what the results measure of them."""
    for case, group in itertools.groupby(found, key=lambda v: v.case):
        rows = []
        for v in group:
            p, s = v.published, v.score
            theirs = "claim" if p.value is None else f"{p.value:g} {p.unit}".strip()
            ours = f"{s.value:.4g} [{s.low:.4g}, {s.high:.4g}], {s.runs} runs" if s else "not here"
            now = {None: "", True: "agrees", False: "differs"}[v.agrees]
            rows.append((p.estimator, p.quantity, p.where, theirs, ours, now, v.recorded))
        header = ("estimator", "quantity", "where", "published", "here, 95 % interval", "now", "recorded verdict")
        print_table(case, header, rows)


def print_frame(frame: Any, form: str, show: Callable[[Any], None]) -> None:
    """Print a data frame as a table, by what shows it so, or as csv or json."""
    if form == "table":
        show(frame)
    else:
        print((score.to_json(frame) if form == "json" else frame.to_csv(index=False)).rstrip())


def print_operating_points(frame: Any) -> None:
    """Print a table of operating points for each case, and what they were set on."""
    for (case, twin, seed), group in frame.groupby(["case", "twin", "seed"], sort=False):
        rows = []
        for p in group.itertuples():
            numbers = [_value(p, name) for name in ("false_alarm", "run_length", "detection", "delay")]
            set_on = f"{p.calm_runs} of the twin" if p.calm_runs else "before manoeuvres"
            rows.append((p.estimator, f"{p.level:g}", f"{p.threshold:.4g}", *numbers, str(p.runs), set_on))
        names = ("P(false alarm)", "run length (s)", "detected", "delay (s)", "runs", "set on")
        print_table(f"{case}, seed {seed}", ("estimator", "level", "threshold", *names), rows)
        alone = group[group.calm_runs == 0].estimator.unique()
        if twin and len(alone):
            print(f"Nothing is stored of {', '.join(alone)} on {twin}: run that too, for delays and for alarms of whole runs.")


def _value(row: Any, name: str) -> str:
    """A number of a row with its interval; nothing where it is not known."""
    value, low, high = (getattr(row, name + end) for end in ("", "_low", "_high"))
    return f"{value:.3g} [{low:.3g}, {high:.3g}]" if value == value else ""


def print_scores(frame: Any) -> None:
    """Print a table of scores for each case, without the metrics of which no estimator has a value where others have any."""
    for case, group in frame.groupby("case", sort=False):
        rows = []
        valued = {(r.metric, r.block) for r in group.itertuples() if r.value == r.value}
        scored = {(r.estimator, r.metric, r.block): r.runs for r in group.itertuples() if isinstance(r.block, str)}
        survived = score.all_survived(scored)
        for r in group.itertuples():
            if r.status in ("refused", "not run") or not isinstance(r.metric, str):
                rows.append((r.estimator, r.status, r.reason, "", "", ""))
                continue
            if (valued and (r.metric, r.block) not in valued) or (survived and r.block.endswith(SURVIVING)):
                continue
            mark = {score.BEST: "best", score.TIED: "tied for best"}.get(r.standing, "")
            value = f"{r.value:.4g} {r.unit}" if r.value == r.value else "none"
            interval = f"[{r.low:.4g}, {r.high:.4g}]" if r.low == r.low else "one run" if r.runs == 1 else ""
            name = f"{r.estimator} (told the mode {r.told} alone)" if r.told else r.estimator
            rows.append((name, f"{r.metric}:{r.block}", value, interval, f"{r.runs}/{r.total}", mark))
        print_table(
            f"{case}, seed {group.seed.iloc[0]}", ("estimator", "metric", "value", "95 % interval", "runs", "standing"), rows
        )
        for label, said, why in group[["estimator", "remarks", "reason"]].drop_duplicates().itertuples(index=False):
            if said:
                print(f"{label}: {said}" + (f"; {why}" if why else ""))


def frame_of(records: Sequence[Any]) -> pandas.DataFrame:
    """Dataclasses as rows; a field that is a dataclass as several columns, the one of its `value` without a suffix."""
    rows = []
    for record in records:
        parts = {name: held if isinstance(held, dict) else {"value": held} for name, held in asdict(record).items()}
        columns = {(name, part): value for name, held in parts.items() for part, value in held.items()}
        rows.append({name if part == "value" else f"{name}_{part}": value for (name, part), value in columns.items()})
    return pandas.DataFrame(rows)


def print_comparisons(found: Sequence[Comparison]) -> None:
    """Print a table for each case, and over what the p-values are adjusted."""
    header = ("estimator", "metric", "value", "reference", "ratio or difference", "wins", "effect", "p (Holm)", "runs")
    for case in dict.fromkeys(c.case for c in found):
        rows = []
        for c in (one for one in found if one.case == case):
            values = [f"{value:.4g} {c.unit}".strip() if value == value else "none" for value in (c.value, c.reference_value)]
            apart = _interval(c.ratio) or _interval(c.difference, "+")
            effect, p = (f"{number:.2g}" if number == number else "" for number in (c.effect.value, c.holm))
            runs = (
                f"{c.runs}, left out {c.left_out} and {c.reference_left_out}" if c.left_out + c.reference_left_out else c.runs
            )
            rest = (_interval(c.wins), effect, p, str(runs), c.verdict, c.remarks)
            rows.append((c.estimator, f"{c.metric}:{c.block}", *values, apart, *rest))
        print_table(f"{case}, seed {c.seed}: against {c.reference}", (*header, "verdict", "remarks"), rows)
    families = Counter(c.metric for c in found if c.p == c.p)
    told = "; ".join(f"{count} by {name}" for name, count in families.items())
    print("p is adjusted over all comparisons by a metric:", told or "none is tested")


def print_state_tests(found: Sequence[StateTest]) -> None:
    """Print a table for each case, and what is wrong with tests over steps."""
    header = ("estimator", "component", "region", "run", "mean", "over its steps, as the paper", "over means of runs")
    for case, group in itertools.groupby(found, key=lambda t: t.case):
        rows = []
        for t in group:
            mean = f"{t.mean:.4g} {t.unit}".strip() if t.mean == t.mean else ""
            rows.append((t.estimator, t.component, t.region, str(t.run), mean, _tested(t.over_steps), _tested(t.over_runs)))
        print_table(f"{case}, seed {t.seed}: minus {t.reference}", header, rows)
    print("Errors are correlated in time, so p over steps is too small: at 5 % the exact filter of linear-gaussian is rejected")
    print("in 39 of 100 runs. The means of runs are independent.")


def _interval(number: Interval, sign: str = "") -> str:
    """A number with its interval, as far as there is one."""
    if number.value != number.value:
        return ""
    return f"{number.value:{sign}.3g}" + (f" [{number.low:.3g}, {number.high:.3g}]" if number.low == number.low else "")


def _tested(test: Tested) -> str:
    return f"{test.test} of {test.count}: p = {test.p:.2g}" if test.p == test.p else ""
