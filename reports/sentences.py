"""What a result set shows, in a few sentences that are never stronger than the intervals."""

import itertools
import math
import statistics
from collections import Counter
from collections.abc import Sequence

import numpy as np

from reports.text import count, grouped, listed, quantity
from reports.views import CaseView, CellView, Key
from suite.bounds import BEST_FIT, CONDITIONAL, KNOWN_MODES, NONE, POSTERIOR
from suite.case import RECORDED
from suite.case_bounds import BlockBound
from suite.linalg import Array
from suite.metrics import METRICS
from suite.score import BEST

FEW_CASES = 3
"""Up to so many cases are told one by one, more are counted."""
NAMES_IN_A_LIST = 5
MOST_NAMED = 3
"""Estimators that are named of those that lead most often."""
BOUND_NAMES = {
    POSTERIOR: "posterior Cramér-Rao bound",
    CONDITIONAL: "covariance linearised along each truth (no bound)",
    KNOWN_MODES: "Cramér-Rao bound of filters that are told the modes",
    BEST_FIT: "error predicted by the Gaussian motion that fits the modes best (no bound)",
}


def headline(cases: Sequence[CaseView]) -> list[str]:
    """What is to be said of accuracy, of runs and estimators that went wrong, and of cost. Less when nothing is stored."""
    if not any(cell.scores or cell.total for case in cases for cell in case.cells.values()):
        return ["No run is stored in this results folder, so there is nothing to compare yet."]
    return [_accuracy(cases), _robustness(cases), _cost(cases)]


def first_block(case: CaseView) -> Key:
    """The key of the RMSE of the case's first block."""
    return "rmse", case.card.blocks[0].name if case.card.blocks else ""


def _accuracy(cases: Sequence[CaseView]) -> str:
    keyed = [(case, first_block(case)) for case in cases]
    if len(cases) > FEW_CASES:
        return _counted(keyed, "the RMSE of each case's first block")
    return _joined([_clause(case, key, "the smallest", f"RMSE of {key[1]}") for case, key in keyed])


def _cost(cases: Sequence[CaseView]) -> str:
    keyed: list[tuple[CaseView, Key]] = [(case, ("latency", "step")) for case in cases]
    if not any(case.with_score(key) for case, key in keyed):
        return "No running times are stored."
    if len(cases) > FEW_CASES:
        return _counted(keyed, "the time of a step")
    return _joined([_clause(case, key, "the shortest", "step") for case, key in keyed])


def _joined(clauses: Sequence[str]) -> str:
    """Clauses of the cases as one sentence."""
    text = "; ".join(clauses)
    return f"{text[:1].upper()}{text[1:]}."


def _clause(case: CaseView, key: Key, superlative: str, thing: str) -> str:
    """Who is best on a case, or why nobody can be said to be."""
    scored, leaders = case.with_score(key), case.leaders(key)
    where = f"on {case.card.name},"
    if not scored and not (case.known or METRICS[key[0]].timed):
        return f"{where} nobody can be ranked by {thing}, since the truth is not known"
    if not scored:
        return f"{where} no estimator has {_an(thing)}"
    if not leaders and len(scored) == 1:
        return (
            f"{where} only {scored[0].label} has {_an(thing)} ({_value(scored, key)}), so there is nothing to compare it with"
        )
    if not leaders:
        alone = all(c.scores[key].runs == 1 for c in scored)
        why = "there is one run each" if alone else "no estimator completed all runs without a fault"
        why = "all runs are of the same recording" if case.card.origin == RECORDED else why
        return f"{where} nobody can be ranked by {thing}, since {why}"
    names = listed([c.label for c in leaders], NAMES_IN_A_LIST)
    verb = "has" if len(leaders) == 1 else "tie for"
    return f"{where} {names} {verb} {superlative} {thing} ({_value(leaders, key)}){_left_out(case.ahead(key))}"


def _left_out(cells: Sequence[CellView]) -> str:
    """Names the estimators with better values that compete for no place, and why."""
    named = [f"{cell.label} ({listed([r.kind for r in cell.remarks if r.bars])})" for cell in cells]
    return f", leaving out {listed(named, NAMES_IN_A_LIST)}" if named else ""


def _an(thing: str) -> str:
    return "a time for a step" if thing == "step" else f"an {thing}"


def _value(cells: Sequence[CellView], key: Key) -> str:
    """The value of some cells, or its range."""
    metric = METRICS[key[0]]
    ordered = sorted((c.scores[key] for c in cells), key=lambda s: s.value)
    low, high = quantity(ordered[0], metric), quantity(ordered[-1], metric)
    if (low.value, low.unit) == (high.value, high.unit):
        return f"{low.value} {low.unit}".strip()
    return f"{low.value}{' ' + low.unit if low.unit != high.unit else ''} to {high.value} {high.unit}".strip()


def _counted(keyed: Sequence[tuple[CaseView, Key]], thing: str) -> str:
    """In how many cases each estimator leads; leaders in the most cases first."""
    ranked = [(case, key) for case, key in keyed if case.leaders(key)]
    if not ranked:
        return f"By {thing}, no estimator can be said to lead in any of {count(len(keyed), 'case')}."
    leads = Counter(c.label for case, key in ranked for c in case.leaders(key)).most_common()
    alone = Counter(c.label for case, key in ranked for c in case.leaders(key) if c.standing[key] == BEST)
    every = len(ranked) == len(keyed)
    of = count(len(ranked), "case") if every else f"the {len(ranked)} of {len(keyed)} cases where anybody can be ranked"
    told = [f"{label} in {n}{f' (alone in {alone[label]})' if alone[label] else ''}" for label, n in leads[:MOST_NAMED]]
    others = sum(n == leads[MOST_NAMED - 1][1] for _, n in leads[MOST_NAMED:])
    also = f", and {count(others, 'other')} in as many" if others else ""
    usual = statistics.median_high(len(case.leaders(key)) for case, key in ranked)
    tied = f"in half of these cases {usual} or more estimators may be the best" if usual > 1 else ""
    ahead = sum(bool(case.ahead(key)) for case, key in keyed)
    left = f"in {count(ahead, 'case')} one that is not ranked, for its failures or faults, has a smaller value" if ahead else ""
    return f"By {thing}, in {of}, most often among the best: {'; '.join(filter(None, [listed(told) + also, tied, left]))}."


def behind(cases: Sequence[CaseView]) -> str:
    """How much lies behind the scores: runs a cell, and particles where there are any; nothing where nothing ran."""
    ran = [cell for case in cases for cell in case.cells.values() if cell.total]
    if not ran:
        return ""
    carried = [n for cell in ran if isinstance(n := cell.meta.get("parameters", {}).get("particles"), int)]
    particles = f"; particle filters carry {_range(carried, 'particle')}" if carried else ""
    return f"{_range([cell.total for cell in ran], 'run')} a cell{particles}"


def _range(numbers: Sequence[int], one: str) -> str:
    low, high = min(numbers), max(numbers)
    return count(high, one) if low == high else f"{grouped(low)} to {count(high, one)}"


def _robustness(cases: Sequence[CaseView]) -> str:
    cells = [(case, cell) for case in cases for cell in case.cells.values()]
    total = sum(cell.total for _, cell in cells)
    wrong = [(case, cell, cell.lost + cell.failed) for case, cell in cells if cell.lost + cell.failed]
    away = [(case, cell, n) for case, cell in cells if (n := diverged(cell))]
    untold = sum(cell.total for case, cell in cells if not case.known)
    refused, idle = (sum(cell.status == status for _, cell in cells) for status in ("refused", "not run"))
    failed = f"{_share(sum(n for *_, n in wrong), 'failed or was lost', 'failed or were lost')}{_who(wrong)}"
    if untold == total:
        strayed = "; whether any diverged cannot be told, since the truth is not known"
    else:
        strayed = f" and {_share(sum(n for *_, n in away), 'diverged', 'diverged')}{_who(away)}"
        strayed += f"; whether {count(untold, 'run')} without a known truth diverged cannot be told" if untold else ""
    absent = [f"{n} {words}" for n, words in ((refused, f"{_were(refused)} refused"), (idle, f"{_were(idle)} not run")) if n]
    tail = f"; of {count(len(cells), 'combination')} of estimator and case, {listed(absent)}" if absent else ""
    said = f"Of {count(total, 'run')}, {failed}{strayed}{tail}." if total else f"No run could be counted{tail}."
    return said + _faults([cell for _, cell in cells])


def _were(n: int) -> str:
    return "was" if n == 1 else "were"


def _faults(cells: Sequence[CellView]) -> str:
    """How many estimators are kept from being called best by what their numbers say of them; failures are told elsewhere."""
    found = [{r.kind for r in cell.remarks if r.bars} - {"failed", "lost", "diverges"} for cell in cells]
    faulty, ran = sum(map(bool, found)), sum(cell.ran for cell in cells)
    if not faulty:
        return ""
    kinds = listed([f"{kind} in {n}" for kind, n in Counter(itertools.chain(*map(sorted, found))).most_common()])
    return f" In {faulty} of {count(ran, 'combination')} that ran, scores show a fault of the estimator ({kinds})."


def diverged(cell: CellView) -> int:
    """How many of the counted runs diverged by the case's definition."""
    score = cell.scores.get(("divergence", "runs"))
    return round(score.value * score.runs) if score and math.isfinite(score.value) else 0


def bound_name(bound: BlockBound) -> str:
    """What a bound is called; one that comes with a reason holds for other truths, or for a part of them."""
    loose = bound.reason and bound.kind in (POSTERIOR, KNOWN_MODES)
    return BOUND_NAMES[bound.kind] + (" (no strict bound here)" if loose else "")


def against_bound(bounds: Sequence[BlockBound]) -> str:
    """How to read errors over the first bound of a case."""
    if not bounds:
        return "No bound is stored for this case."
    if bounds[0].kind == NONE:
        return f"There is no bound: {bounds[0].reason}."
    name = f"Errors are held against the {bound_name(bounds[0])}."
    if bounds[0].strict:
        return f"{name} In the long run none are smaller; a ratio whose interval lies below 1 is flagged."
    return f"{name} Ratios below 1 mean nothing here{': ' if bounds[0].reason else ''}{bounds[0].reason}."


def bounded(bounds: Sequence[tuple[BlockBound, Array, Array]]) -> str:
    """What the dashed and the dotted line of a figure are, from each bound with its value[T] and error[T] there."""
    found = []
    for line, (bound, value, error) in zip(("dashed", "dotted"), bounds, strict=False):
        if bound.kind == NONE:
            found.append(f" There is no bound: {bound.reason}.")
            continue
        name = bound_name(bound)
        if not (value > 0).any():
            found.append(f" The {name} is zero.")
            continue
        share = float(np.nanmax(error[value > 0] / value[value > 0], initial=0.0))
        percent = f"{100 * share:.1g}" if share < 0.095 else f"{100 * share:.0f}"
        wide = f", its standard error by Monte Carlo up to {percent} %" if share > 0.0005 else ""
        found.append(f" The {line} line without marks is the {name}{wide}.")
    reasons = [bound.reason for bound, *_ in bounds if bound.reason and bound.kind != NONE]
    told = "; ".join(dict.fromkeys(clause for reason in reasons for clause in reason.split("; ")))
    return "".join(found) + (f" {told[:1].upper()}{told[1:]}." if told else "")


def _share(n: int, one: str, many: str) -> str:
    return f"none {one}" if n == 0 else f"{grouped(n)} {one if n == 1 else many}"


def _who(found: Sequence[tuple[CaseView, CellView, int]]) -> str:
    """Where it went wrong: the cells, or one of the worst where they are more than two."""
    worst = sorted(found, key=lambda f: -f[2])
    named = [f"{cell.label} on {case.card.name}, {n} of {cell.total}" for case, cell, n in worst]
    if len(named) > 2:
        return f" (in {len(named)} cells, among them {named[0]})"
    return f" ({'; '.join(named)})" if named else ""
