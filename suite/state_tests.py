"""Whether two sets of states differ, component by component: the tests of the multistatic paper, and the same over runs.

M. Benko, P. Kulmon, Aplikácia časticových filtrov na merania multistatického radaru (in Slovak), section 2.4.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suite.case import RECORDED, Card
from suite.estimator import OK
from suite.linalg import Array
from suite.results import CaseResults, Cell
from suite.statistics import mean_over_time

TRUTH = "truth"
"""The reference that is no estimator: in the paper, the GPS receiver."""
EVERYWHERE = "all"
ASSUMED = 0.05
"""Level at which an assumption of a test is given up."""
MOST = 5000
"""Most differences for which Shapiro and Wilk's p-value is accurate."""
VARIANCE = np.pi / 2 - 1
"""Variance of (mean - median) √n / standard deviation for normal numbers."""


@dataclass(frozen=True)
class Tested:
    """A test of whether differences are zero: which one, of how many differences it is of, and its two-sided p-value."""

    test: str = "none"
    count: int = 0
    p: float = np.nan


@dataclass(frozen=True)
class StateTest:
    """Tests of one component of the state in one region: of an estimator minus a reference.

    mean: of the differences over the steps of the run, in the unit. over_steps: the paper's test, of one run. Its p-values are
    too small, for it takes the differences as independent and those of a filter are correlated in time: at 5 % the errors of
    the exact filter on `linear-gaussian` are rejected in 39 of 100 runs (3000 tried). over_runs: the same of the means over
    time of each run, which are independent (5 of 100 groups of 30 runs); none on a recording, whose runs are of the same data.
    """

    case: str
    seed: int
    estimator: str
    reference: str
    component: str
    region: str
    unit: str
    run: int
    mean: float
    over_steps: Tested
    over_runs: Tested


def of_differences(differences: Array) -> Tested:
    """The strongest test whose assumptions the differences [N] do not contradict, of those that the paper names.

    Student's t where normality is not rejected (Shapiro and Wilk, 1965; of more than 5000, D'Agostino and Pearson, 1973), else
    Wilcoxon's signed ranks where symmetry is not, else the sign test, which leaves out zeros. What is NaN is left out.
    """
    from scipy import stats  # takes a second; no other command needs it

    d = differences[~np.isnan(differences)]
    if len(d) < 3:
        return Tested(count=len(d))
    if np.ptp(d) > 0:
        normality = stats.shapiro if len(d) <= MOST else stats.normaltest
        if normality(d).pvalue >= ASSUMED:
            return Tested("t", len(d), float(stats.ttest_1samp(d, 0.0).pvalue))
        if symmetry(d) >= ASSUMED:
            return Tested("Wilcoxon", len(d), float(stats.wilcoxon(d).pvalue))
    apart = int((d != 0).sum())
    p = stats.binomtest(int((d > 0).sum()), apart).pvalue if apart else 1.0
    return Tested("sign", len(d), float(p))


def symmetry(differences: Array) -> float:
    """Two-sided p-value of symmetry about an unknown median, from the distance of mean and median.

    P. Cabilio, J. Masaro, A simple test of symmetry about an unknown median, Canadian Journal of Statistics 24(3), 1996.
    """
    from scipy.special import ndtr

    distance = (differences.mean() - np.median(differences)) / differences.std(ddof=1)
    return float(2 * ndtr(-np.abs(distance) * np.sqrt(len(differences) / VARIANCE)))


def state_tests(case: CaseResults, estimator: str, reference: str, run: int | None = None) -> list[StateTest]:
    """Each component of the state, in all regions and inside and outside each; `reference` is a label or `truth`.

    run: the one that is tested over its steps; the first that came through on both sides where it is None. A step is in a
    region where the estimator says that the target is, as in the paper. Nothing where the two have no such run in common.
    """
    if estimator == reference or estimator not in case.cells or reference not in (*case.cells, TRUTH):
        return []
    mine = case.cells[estimator]
    through = set(_through(mine)) & set(mine.runs if reference == TRUTH else _through(case.cells[reference]))
    common = sorted(through)
    chosen = common[0] if run is None and common else run
    if chosen is None or chosen not in through:
        return []
    states = _states(mine, common)
    others = _states(mine, common, of_truth=True) if reference == TRUTH else _states(case.cells[reference], common)
    units = {i: block.unit for block in case.card.blocks for i in block.components}
    found = []
    for region, inside in _regions(case.card, states):
        apart = np.where(inside[:, None], states - others, np.nan)
        for i, component in enumerate(case.card.state):
            steps = apart[:, i, common.index(chosen)]
            one_sample = case.card.origin == RECORDED
            over_runs = Tested() if one_sample else of_differences(mean_over_time(apart[:, i])[0])
            found.append(
                StateTest(
                    case.card.name, case.seed, estimator, reference, component, region, units.get(i, ""), chosen,
                    float(mean_over_time(steps[:, None])[0, 0]), of_differences(steps), over_runs,
                )
            )  # fmt: skip
    return found


def _through(cell: Cell) -> list[int]:
    """Numbers of the runs that came through."""
    return [run for run, status in zip(cell.runs, cell.estimate.status, strict=True) if status == OK] if cell.runs else []


def _states(cell: Cell, runs: list[int], of_truth: bool = False) -> Array:
    """Estimates, or the truth, x[T, n, R] of some runs."""
    values = cell.truth.x if of_truth else cell.estimate.mean
    return values[..., [cell.runs.index(run) for run in runs]]


def _regions(card: Card, states: Array) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names of regions, and which steps and runs [T, R] of states x[T, n, R] lie in them."""
    yield EVERYWHERE, np.ones((len(states), states.shape[2]), bool)
    for region in card.regions:
        assert card.plane is not None
        inside = region.holds(*(states[:, axis] for axis in card.plane))
        yield f"inside {region.name}", inside
        yield f"outside {region.name}", ~inside
