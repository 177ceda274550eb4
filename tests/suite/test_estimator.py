"""The loop over time: shapes, order of steps, lost runs, errors that name their step."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from suite.errors import BadInput
from suite.estimator import LOST, OK, Estimate, Filter, Readout, StepError, join, measurements, unavailable
from suite.random import Streams
from tests.oracles import random_linear

MODEL = random_linear(0, 2, 3, 2).model


@dataclass(frozen=True)
class Echo(Filter):
    """Says back what it was given: mean (y[0], k), covariance k; loses run `lost` at step 3, raises at step `raises`."""

    name: ClassVar[str] = "echo"
    reference: ClassVar[str] = "none"
    lost: int = -1
    raises: int = -1
    size: int = 0

    def runs_at_once(self, model):
        return self.size or None

    def init(self, model, rng):
        return np.full(rng.runs, 0.0), np.zeros(rng.runs)

    def step(self, model, belief, y, k, rng):
        if k == self.raises:
            raise ZeroDivisionError("no good")
        first = np.where((np.arange(rng.runs) == self.lost) & (k == 3), np.inf, y[0])
        return first, np.full(rng.runs, float(k))

    def read(self, belief):
        first, k = belief
        return Readout(np.stack([first, k]), np.broadcast_to(k, (2, 2, len(k))), loglik=first + k)


def data(steps=5, runs=4):
    return np.random.default_rng(0).standard_normal((steps, 3, runs))


def test_steps_come_in_order_with_their_measurements():
    y = data()
    estimate = Echo().run(MODEL, y)
    np.testing.assert_array_equal(estimate.mean[:, 0], y[:, 0])
    np.testing.assert_array_equal(estimate.mean[:, 1], np.arange(1.0, 6)[:, None] * np.ones(4))
    np.testing.assert_array_equal(estimate.loglik, y[:, 0] + np.arange(1, 6)[:, None])
    assert estimate.status == [OK] * 4
    assert estimate.reason == [""] * 4
    assert estimate.ess is None
    assert estimate.innovation is None
    assert estimate.seconds.shape == (5, 4)


def test_a_lost_run_stays_lost_and_is_said_once():
    y = data()
    estimate = Echo(lost=2).run(MODEL, y)
    assert estimate.status == [OK, OK, LOST, OK]
    assert estimate.reason[2] == "step 3: the state estimate is not finite"
    assert list(estimate.ok) == [True, True, False, True]
    np.testing.assert_array_equal(np.isnan(estimate.mean[:, 0, 2]), [False, False, True, True, True])
    np.testing.assert_array_equal(np.isnan(estimate.loglik[:, 2]), [False, False, True, True, True])
    np.testing.assert_array_equal(np.isnan(estimate.cov[:, 0, 0, 2]), [False, False, True, True, True])
    assert np.isfinite(estimate.mean[..., [0, 1, 3]]).all()


@pytest.mark.parametrize("size", [1, 2, 3, 4, 9])
def test_groups_of_runs_join_to_the_same(size):
    y = data()
    whole, parts = Echo().run(MODEL, y), Echo(size=size).run(MODEL, y)
    np.testing.assert_array_equal(whole.mean, parts.mean)
    np.testing.assert_array_equal(whole.cov, parts.cov)
    assert parts.batch == [4] * 4
    assert parts.seconds.shape == (5, 4)


def test_an_error_names_its_step():
    with pytest.raises(StepError, match="step 4: ZeroDivisionError: no good"):
        Echo(raises=4).run(MODEL, data())


def test_warnings_of_lost_runs_are_quiet_inside_only():
    Echo(lost=1).run(MODEL, data())
    with pytest.warns(RuntimeWarning):
        np.log(np.zeros(1))


@pytest.mark.parametrize("shape", [(5, 3), (5, 2, 4), (0, 3, 4), (5, 3, 0), (5, 3, 4, 1)], ids=str)
def test_shapes_that_do_not_fit_are_refused(shape):
    with pytest.raises(BadInput, match=r"\(steps, 3, runs\)"):
        Echo().run(MODEL, np.zeros(shape))


def test_measurements_become_floats():
    assert measurements(MODEL, np.zeros((2, 3, 1), int)).dtype == float


def test_seeds_and_streams_are_the_same_thing():
    @dataclass(frozen=True)
    class Noisy(Echo):
        def step(self, model, belief, y, k, rng):
            return rng.standard_normal((1, rng.runs))[0], np.full(rng.runs, float(k))

    a, b = Noisy().run(MODEL, data(), 3), Noisy().run(MODEL, data(), Streams((3,)))
    np.testing.assert_array_equal(a.mean, b.mean)
    shifted = Noisy(size=1).run(MODEL, data()[:, :, 2:], Streams((3,), 2))
    np.testing.assert_array_equal(shifted.mean, a.mean[:, :, 2:])


def test_join_keeps_order_and_drops_what_a_part_lacks():
    a, b = Echo().run(MODEL, data()), unavailable(5, 2, 2, "failed", "because")
    both = join([a, b])
    assert both.status == [OK] * 4 + ["failed"] * 2
    assert both.reason == [""] * 4 + ["because"] * 2
    np.testing.assert_array_equal(both.mean[..., :4], a.mean)
    assert np.isnan(both.mean[..., 4:]).all()
    assert both.loglik is None
    assert join([a]) is a


def test_an_estimate_fills_in_its_statuses():
    estimate = Estimate(np.zeros((2, 1, 3)), np.zeros((2, 1, 1, 3)))
    assert (estimate.status, estimate.reason, estimate.batch) == ([OK] * 3, [""] * 3, [3] * 3)
