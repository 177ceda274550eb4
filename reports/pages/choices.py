"""What can be chosen to be shown of all cases and estimators at once: metrics and blocks, and how to read them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reports.text import slugs
from reports.views import CaseView, Key
from suite.case_bounds import BlockBound
from suite.metrics import FAMILIES, METRICS, SURVIVING, Metric

FIRST = "first block of each case"
STEPS = (1.1, 1.5, 3.0, 10.0)
"""Upper ends of the classes of shading, as ratios to the best of the row or to the bound; above is the last class."""
RATES = (0.02, 0.1, 0.25, 0.5)
"""The same for rates, as they stand: a ratio to a rate of zero says nothing."""
OVER_BOUND = [f"up to {step:g} times the bound" for step in STEPS]
BEHIND = f", {SURVIVING}"


@dataclass(frozen=True)
class Choice:
    """A metric and block that a reader can choose; block None stands for the first block of each case.

    of_state: whether blocks are those of the state. behind: what follows the name of the block. legend: words of the classes
    of shading by the best of the row, bound: by the bound; empty where there is no such shading. factor: how to read a ratio.
    """

    id: str
    metric: Metric
    of_state: bool
    block: str | None
    behind: str
    title: str
    better: str
    legend: tuple[str, ...]
    bound: tuple[str, ...]
    factor: str

    def key(self, case: CaseView) -> Key:
        """The metric and block to show of a case."""
        first = case.card.blocks[0].name if case.card.blocks else ""
        return self.metric.name, (first if self.block is None else self.block) + self.behind

    @property
    def named(self) -> str:
        """The block in words."""
        return (self.block or FIRST) + self.behind


def choices(cases: Sequence[CaseView]) -> list[Choice]:
    """What can be shown of all cases at once, family by family; the default is the first.

    Of a metric of state blocks that of each case's first block comes first, since their names differ from case to case. The
    RMSE leads unless the truth of no case is known.
    """
    ordered = [name for family in FAMILIES for name, metric in METRICS.items() if metric.family == family]
    found = dict.fromkeys(key for name in ordered for case in cases for key in case.keys if key[0] == name)
    of_blocks = {name for name in METRICS if all(_of_block(case, key) for case in cases for key in case.keys if key[0] == name)}
    offered: dict[tuple[str, str | None, str], None] = {}
    if not found or any(case.known for case in cases):
        offered["rmse", None, ""] = None
    for name, keys in itertools.groupby(found, lambda key: key[0]):
        blocks = [_parted(block) for _, block in keys]
        if name in of_blocks:
            offered |= {(name, None, behind): None for _, behind in blocks}
        if name not in of_blocks or len({block for block, _ in blocks}) > 1:
            offered |= {(name, *block): None for block in blocks}
    ids = slugs([_id(*each) for each in offered])
    bounded = any(strict(case) for case in cases)
    return [_choice(ids[_id(*each)], each[0] in of_blocks, *each, bounded) for each in offered]


def _parted(block: str) -> tuple[str, str]:
    """The name of a block, and what follows it where not all runs count."""
    return (block.removesuffix(BEHIND), BEHIND) if block.endswith(BEHIND) else (block, "")


def _id(name: str, block: str | None, behind: str) -> str:
    return f"{name} {block or 'first'}{behind}"


def _of_block(case: CaseView, key: Key) -> bool:
    return key[1].partition(", ")[0] in [block.name for block in case.card.blocks]


def _choice(id_: str, of_state: bool, name: str, block: str | None, behind: str, bounded: bool) -> Choice:
    metric = METRICS[name]
    title = "RMSE" if name == "rmse" else metric.title
    bound = (*OVER_BOUND, "more") if bounded and name in ("rmse", "crlb-ratio") and not behind else ()
    return Choice(id_, metric, of_state, block, behind, title, *_reading(metric), bound, _factor(metric))


def _reading(metric: Metric) -> tuple[str, tuple[str, ...]]:
    """How to read a metric, and the words of the classes of shading: none where a ratio to the best says nothing."""
    if not metric.ranked:
        return "by which nobody is ranked", ()
    if metric.binomial:
        ends = [f"{100 * r:g} %" for r in RATES]
        return "lower is better", (f"up to {ends[0]}", *(f"up to {e}" for e in ends[1:]), "more")
    better = f"{metric.better} is better" if isinstance(metric.better, str) else f"{metric.better:g} is best"
    if metric.signed:
        return better, ()
    if not isinstance(metric.better, str):
        return better, (*(f"within a factor {s:g} of {metric.better:g}" for s in STEPS), "further off")
    low = metric.better == "lower"
    thing = "smallest" if low else "largest"
    steps = [f"up to {s:g} times" if low else f"down to 1/{s:g} of" for s in STEPS[1:]]
    return better, (f"within {100 * (STEPS[0] - 1):.0f} % of the row's {thing}", *steps, "further off")


def _factor(metric: Metric) -> str:
    if not isinstance(metric.better, str):
        return f"times off {metric.better:g}"
    return "times the row's smallest" if metric.better == "lower" else "times below the row's largest"


def strict(case: CaseView) -> bool:
    """Whether no estimator can beat the first bound of a case, from what is stored beside it."""
    if case.results.bound is None:
        return False
    said, none = case.results.bound.meta["bounds"][0], np.empty(0)
    return BlockBound(said["kind"], said["reason"], none, none, none).strict
