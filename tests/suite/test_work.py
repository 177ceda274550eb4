"""What an estimator may not return, and what becomes of it when it does."""

import numpy as np
import pytest

from cases import CASES
from suite.estimator import Estimate
from suite.work import compute, examined

CASE = CASES["linear-gaussian"]
RUNS = 3


def parts():
    shape = (CASE.steps, CASE.model.n, RUNS)
    cov = np.tile(np.eye(CASE.model.n)[None, :, :, None], (CASE.steps, 1, 1, RUNS))
    return np.zeros(shape), cov


class Saboteur:
    name = "saboteur"
    reference = "none"

    def __init__(self, error):
        self.error = error

    def accepts(self, model):
        return None

    def run(self, model, y, seed=0):
        raise self.error


def test_a_run_with_a_bad_step_is_charged_alone():
    mean, cov = parts()
    mean[16, 2, 1] = np.nan
    cov[4, 0, 1, 2] = 0.5
    done = examined(Estimate(mean, cov), CASE, RUNS, 1.0)
    assert done.status == ["ok", "failed", "failed"]
    assert done.reason == ["", "step 17: mean is not finite", "step 5: cov is not symmetric"]


def test_a_negative_variance_is_a_fault_of_its_run():
    mean, cov = parts()
    cov[2, 3, 3, 1] = -1e-6
    cov[8, 0, 0, 2] = -1.0
    done = examined(Estimate(mean, cov), CASE, RUNS, 1.0)
    assert done.status == ["ok", "failed", "failed"]
    assert done.reason[1:] == ["step 3: cov has a negative variance", "step 9: cov has a negative variance"]


def test_a_variance_is_negative_beyond_rounding_only():
    """Rounding of a matrix is that of its largest number; where all variances are negative, none is rounding."""
    mean, cov = parts()
    cov[:, 0, 0, :], cov[:, 1, 1, :] = 1e12, -1e-5
    assert examined(Estimate(mean, cov), CASE, RUNS, 1.0).ok.all()
    cov[:, 1, 1, :] = -1e-2
    assert not examined(Estimate(mean, cov), CASE, RUNS, 1.0).ok.any()
    assert not examined(
        Estimate(mean, np.tile(-1e-30 * np.eye(4)[None, :, :, None], (100, 1, 1, RUNS))), CASE, RUNS, 1.0
    ).ok.any()
    assert examined(Estimate(mean, np.zeros_like(cov)), CASE, RUNS, 1.0).ok.all()


@pytest.mark.parametrize("value", [-1e-12, np.nan, np.inf])
def test_seconds_are_times(value):
    mean, cov = parts()
    seconds = np.zeros((CASE.steps, RUNS))
    seconds[5, 1] = value
    with pytest.raises(ValueError, match=r"^seconds are negative or not finite$"):
        examined(Estimate(mean, cov, seconds=seconds), CASE, RUNS, 1.0)
    status = ["ok", "lost", "ok"]
    assert examined(Estimate(mean, cov, seconds=seconds, status=status), CASE, RUNS, 1.0).status == status


def test_rounding_does_not_make_a_covariance_asymmetric():
    mean, cov = parts()
    cov[:, 0, 1], cov[:, 1, 0] = 0.5, 0.5 + 1e-12
    assert examined(Estimate(mean, cov), CASE, RUNS, 1.0).ok.all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mean": lambda x: x + 1j}, "mean is complex"),
        ({"cov": lambda x: x[:-1]}, r"cov has shape \(99, 4, 4, 3\), expected \(100, 4, 4, 3\)"),
        ({"status": lambda _: ["fine"] * RUNS}, "status must be one of ok, lost, failed, got .'fine'."),
    ],
)
def test_a_wrong_part_is_named(change, message):
    mean, cov = parts()
    estimate = Estimate(mean, cov)
    for name, spoil in change.items():
        setattr(estimate, name, spoil(getattr(estimate, name)))
    with pytest.raises((TypeError, ValueError), match=message):
        examined(estimate, CASE, RUNS, 1.0)


@pytest.mark.parametrize("error", [ValueError("no"), SystemExit(5), GeneratorExit("no")])
def test_whatever_it_raises_is_its_own_failure(error):
    done = compute(CASE, Saboteur(error), 1, 0, 2)
    assert done.estimate.status == ["failed"] * 2
    assert done.estimate.reason[0].startswith(type(error).__name__)


def test_an_interrupt_is_not():
    with pytest.raises(KeyboardInterrupt):
        compute(CASE, Saboteur(KeyboardInterrupt()), 1, 0, 2)
