"""Timing of every estimator on every case that it accepts: one run (latency) and many runs together (throughput).

Run with `nox -s bench`; the plain test run leaves these out.
"""

import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite.case import Truth

STEPS = 20
PAIRS = [(e, c) for c in CASES for e in ESTIMATORS if ESTIMATORS[e].accepts(CASES[c].model) is None]


@pytest.fixture(scope="module")
def truths() -> dict[str, Truth]:
    return {name: case.simulate(runs=100, seed=1) for name, case in CASES.items()}


@pytest.mark.parametrize("runs", [1, 100])
@pytest.mark.parametrize(("estimator", "case"), PAIRS)
def test_filter(benchmark, truths, estimator: str, case: str, runs: int) -> None:
    if runs > 1 and estimator.startswith("filterpy:"):
        runs = 10  # one filter object a run: the time of a run-step does not depend on how many there are
    model, y = CASES[case].model, truths[case].y[:STEPS, :, :runs]
    benchmark.group = f"{case}, {'one run' if runs == 1 else 'many runs'}"
    benchmark.extra_info |= {"estimator": estimator, "case": case, "runs": runs, "steps": STEPS}
    estimate = benchmark.pedantic(ESTIMATORS[estimator].run, (model, y), {"seed": 1}, rounds=5, warmup_rounds=1)
    benchmark.extra_info["us_per_run_step"] = 1e6 * benchmark.stats.stats.median / (runs * STEPS)
    assert estimate.ok.all()
