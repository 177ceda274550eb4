"""What every estimator owes on every case: a run's numbers depend on that run alone, and inputs stay as they were."""

import numpy as np
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite.random import Streams

STEPS, RUNS = 40, 7
PARTS = ("mean", "cov", "loglik", "ess", "innovation")
PAIRS = [(e, c) for e in ESTIMATORS for c in CASES if ESTIMATORS[e].accepts(CASES[c].model) is None]
STREAMS = Streams(("blocks",))
EVERYWHERE = pytest.mark.parametrize(("name", "case"), PAIRS, ids=["-".join(p) for p in PAIRS])


@pytest.fixture(scope="module")
def measured():
    """Measurements of every case, with outages that differ from run to run."""
    found = {}
    for name, case in CASES.items():
        y = case.simulate(RUNS, seed=4).y[:STEPS].copy()
        y[10:13] = np.nan
        y[20:24, 0, 2] = np.nan
        y[22:30, :, 5] = np.nan
        y[30, 1, :4] = np.nan
        found[name] = y
    return found


@pytest.fixture(scope="module")
def together(measured):
    """All runs of each pair in one call."""
    return {(e, c): ESTIMATORS[e].run(CASES[c].model, measured[c], STREAMS) for e, c in PAIRS}


def test_no_estimator_refuses_all_cases():
    assert {e for e, _ in PAIRS} == set(ESTIMATORS)


@EVERYWHERE
@pytest.mark.parametrize("size", [1, 2, 3])
def test_blocks_of_runs_do_not_show(name, case, size, measured, together):
    whole, y = together[name, case], measured[case]
    for first in range(0, RUNS, size):
        block = slice(first, min(first + size, RUNS))
        part = ESTIMATORS[name].run(CASES[case].model, y[:, :, block], Streams(STREAMS.key, first))
        assert list(part.status) == list(whole.status[block])
        for name_of_part in PARTS:
            a, b = getattr(part, name_of_part), getattr(whole, name_of_part)
            assert (a is None) == (b is None)
            if a is not None:
                np.testing.assert_array_equal(a, b[..., block], err_msg=f"{name_of_part}, runs from {first}")


@EVERYWHERE
def test_inputs_are_not_touched_and_a_seed_repeats_itself(name, case, measured, together):
    estimator, model, y = ESTIMATORS[name], CASES[case].model, measured[case].copy()
    before = y.copy(), model.prior.mean.copy(), model.prior.cov.copy(), model.sensor.noise.cov.copy()
    y.flags.writeable = False
    again = estimator.run(model, y, STREAMS)
    other = estimator.run(model, y, Streams(("another seed",)))
    for kept, now in zip(before, (y, model.prior.mean, model.prior.cov, model.sensor.noise.cov), strict=True):
        np.testing.assert_array_equal(kept, now)
    np.testing.assert_array_equal(again.mean, together[name, case].mean)
    np.testing.assert_array_equal(again.cov, together[name, case].cov)
    random = again.ess is not None  # those that count particles draw them
    assert random != np.array_equal(again.mean, other.mean)


@EVERYWHERE
def test_shapes_and_statuses(name, case, measured, together):
    estimate, model = together[name, case], CASES[case].model
    assert estimate.mean.shape == (STEPS, model.n, RUNS)
    assert estimate.cov.shape == (STEPS, model.n, model.n, RUNS)
    assert estimate.loglik.shape == estimate.seconds.shape == (STEPS, RUNS)
    assert estimate.ok.all()
    assert (estimate.seconds > 0).all()
    assert list(estimate.batch) == [RUNS] * RUNS
    np.testing.assert_array_equal(estimate.cov, np.swapaxes(estimate.cov, 1, 2)) if name != "filterpy:ukf" else None
    assert (estimate.loglik[10:13] == 0).all() if estimate.ess is None else (np.abs(estimate.loglik[10:13]) < 1e-12).all()


@EVERYWHERE
def test_a_missing_value_is_not_the_same_as_any_value(name, case, measured, together):
    y = measured[case].copy()
    y[20, 0, 2] = y[19, 0, 2]
    other = ESTIMATORS[name].run(CASES[case].model, y, STREAMS)
    same = [np.array_equal(other.mean[..., r], together[name, case].mean[..., r]) for r in range(RUNS)]
    assert same == [r != 2 for r in range(RUNS)]
