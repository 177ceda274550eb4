"""What the command line prints: tables of registry entries and of scores."""

import itertools
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from suite import parameters, score
from suite.case import Case
from suite.metrics import METRICS, SURVIVING
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
