"""Timing of every estimator on a case of every family that it accepts: one run (latency) and many together (throughput).

Run with `nox -s bench`; the plain test run leaves these out.
"""

import pytest

from cases import CASES, MODULES
from estimators import ESTIMATORS
from suite.case import Truth
from suite.estimator import told
from tests.benchmarks.timing import clock, rounds_within

STEPS = 20
FAMILIES = [module.CASES[0].name for module in MODULES]
PAIRS = [(e, c) for c in FAMILIES for e in ESTIMATORS if ESTIMATORS[e].accepts(told(ESTIMATORS[e], CASES[c].model)) is None]


@pytest.fixture(scope="module")
def truths() -> dict[str, Truth]:
    return {name: CASES[name].simulate(runs=100, seed=1) for name in FAMILIES}


@pytest.mark.parametrize("many", [False, True], ids=["one", "many"])
@pytest.mark.parametrize(("estimator", "case"), PAIRS)
def test_filter(benchmark, truths, estimator: str, case: str, many: bool) -> None:
    model, y = CASES[case].model, truths[case].y[:STEPS]
    seconds = clock(lambda: ESTIMATORS[estimator].run(model, y[:, :, :1], seed=1))
    runs = min(100, max(2, int(1 / seconds))) if many else 1  # the slow ones get fewer

    def job():
        return ESTIMATORS[estimator].run(model, y[:, :, :runs], seed=1)

    benchmark.group = f"{case}, {'many runs' if many else 'one run'}"
    benchmark.extra_info |= {"estimator": estimator, "case": case, "runs": runs, "steps": STEPS}
    estimate = benchmark.pedantic(job, rounds=rounds_within(1, job, high=5), warmup_rounds=1)
    benchmark.extra_info["us_per_run_step"] = 1e6 * benchmark.stats.stats.median / (runs * STEPS)
    assert estimate.ok.all()
