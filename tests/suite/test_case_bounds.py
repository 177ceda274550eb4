"""Bounds of whole cases: which are computed, about which trajectories, and that they are stored and read as they are."""

import dataclasses

import numpy as np
import pytest

from cases import CASES
from suite import bounds
from suite.bounds import trajectories
from suite.case import FROM_ANOTHER, FROM_MODEL, GIVEN_TRACK, RECORDED, StateBlock, Truth, draw
from suite.case_bounds import UNKNOWN, bounds_of
from suite.effort import BRIEF
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Streams
from suite.results import load
from tests.bound_oracles import near, riccati

LINEAR = CASES["linear-gaussian"]


def kalman(models, y=None):
    """Covariances of the Kalman filter [T, n, n] of the linear models in force, one a step; y[T, m] says what is missing."""
    P, found = models[0].prior.cov, []
    for k, model in enumerate(models):
        motion, sensor = model.dynamics, model.sensor
        Q, seen = motion.noise_cov(k + 1), np.zeros(model.m) if y is None else y[k]
        P = riccati(P, motion.mean.matrix(k), Q, sensor.mean.matrix(k), sensor.noise.cov, seen)
        found.append(P)
    return np.stack(found)


@pytest.mark.parametrize("origin", [LINEAR.origin, GIVEN_TRACK, RECORDED, FROM_ANOTHER])
def test_a_linear_case_has_the_kalman_covariance_whatever_its_truth(origin):
    """Even a truth that nobody knows: slopes do not depend on it."""

    def generate(rng):
        truth = LINEAR.generate(rng)
        return dataclasses.replace(truth, x=np.full_like(truth.x, np.nan) if origin == RECORDED else truth.x)

    (found,) = bounds_of(dataclasses.replace(LINEAR, origin=origin, generate=generate), 1)
    near(found.cov, kalman([LINEAR.model] * LINEAR.steps))
    variance = np.diagonal(found.cov, axis1=1, axis2=2)
    for j, block in enumerate(LINEAR.blocks):
        np.testing.assert_allclose(found.value[:, j], np.sqrt(variance[:, list(block.components)].sum(1)), rtol=1e-12)
    assert found.kind == bounds.POSTERIOR
    assert ("filters may fall below it" in found.reason) == (origin != LINEAR.origin)


def test_gaps_of_the_measurements_enter():
    def generate(rng):
        truth = LINEAR.generate(rng)
        truth.y[3:6] = np.nan
        return truth

    (found,) = bounds_of(dataclasses.replace(LINEAR, generate=generate), 1)
    missing = np.zeros((LINEAR.steps, 2))
    missing[3:6] = np.nan
    near(found.cov, kalman([LINEAR.model] * LINEAR.steps, missing))


def test_a_given_track_is_where_the_sensor_is_linearised():
    """A target that stays at (3, 4): information is that of the slope of its bearing there, not at states of the model."""
    case = CASES["bearings-only"]
    place = np.array([3.0, 0.0, 4.0, 0.0])

    def generate(rng):
        x = np.tile(place[:, None], (2, 1, rng.runs))
        return Truth(x, np.zeros((2, 1, rng.runs)))

    fixed = dataclasses.replace(case, steps=2, origin=GIVEN_TRACK, generate=generate)
    (found,) = bounds_of(fixed, 1)
    # The bearing's slope at (x, y) = (3, 4) is (-y, x) / r² = (-4, 3) / 25.
    slope = Affine(np.array([[-4.0, 0.0, 3.0, 0.0]]) / 25)
    near(found.cov, kalman([dataclasses.replace(case.model, sensor=AdditiveSensor(slope, case.model.sensor.noise))] * 2))


def test_a_truth_drawn_from_the_model_takes_many_trajectories_of_it():
    case = CASES["ballistic/1"]
    (found,) = bounds_of(case, 1)
    drawn = trajectories(case.model, case.steps, Streams((1, case.name, "bound")).batch(0, 2000))
    expected = bounds.bound(case.model, drawn)
    np.testing.assert_array_equal(found.cov, expected.cov)
    assert (found.error / found.value).max() < 0.01
    (again,) = bounds_of(case, 2)
    assert not np.array_equal(again.cov, found.cov)


def test_several_modes_have_two_bounds():
    case = CASES["jump-linear"]
    assert isinstance(case.model, JumpModel)
    known, fitted = bounds_of(case, 1)
    assert (known.kind, fitted.kind) == (bounds.KNOWN_MODES, bounds.BEST_FIT)
    assert (fitted.value[1:] > known.value[1:]).all()


def test_known_modes_are_those_of_the_track():
    """Linear modes that differ in their noise, and a track that changes once: the Kalman covariance along that sequence."""
    case = CASES["jump-linear"]
    modes = np.repeat([0, 1], [3, case.steps - 3])

    def generate(rng):
        truth = case.generate(rng)
        return dataclasses.replace(truth, mode=np.tile(modes[:, None], rng.runs))

    known, _ = bounds_of(dataclasses.replace(case, origin=GIVEN_TRACK, generate=generate), 1)
    near(known.cov, kalman([case.model.modes[mode] for mode in modes]))


def test_a_truth_nobody_knows_has_no_bound_where_slopes_depend_on_it():
    case = CASES["bearings-only"]

    def blank(rng):
        truth = case.generate(rng)
        return dataclasses.replace(truth, x=np.full_like(truth.x, np.nan))

    (found,) = bounds_of(dataclasses.replace(case, origin=RECORDED, generate=blank), 1)
    assert (found.kind, np.isnan(found.value).all()) == (bounds.NONE, True)
    assert found.reason == UNKNOWN


def test_bounds_are_read_as_they_were_stored(cli, inline, tmp_path):
    results = tmp_path / "results"
    assert cli("run", "-c", "jump-linear", "-e", "imm-ekf", "--runs", 2, "--results", results).code == 0
    read, computed = load(results).cases["jump-linear"].bounds, bounds_of(CASES["jump-linear"], 1, BRIEF)
    assert len(read) == len(computed) == 2
    for a, b in zip(read, computed, strict=True):
        assert (a.kind, a.reason) == (b.kind, b.reason)
        for name in ("value", "error", "cov"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_a_block_is_bounded_in_all_of_its_components():
    whole = dataclasses.replace(LINEAR, blocks=(*LINEAR.blocks, StateBlock("all", (0, 1, 2, 3), "mixed")))
    (found,) = bounds_of(whole, 1)
    np.testing.assert_allclose(found.value[:, -1], np.sqrt(np.trace(found.cov, axis1=1, axis2=2)), rtol=1e-12)


def test_gaps_that_depend_on_the_state_are_those_of_the_trajectories():
    """x_k = 0.9 x_{k-1} + w, seen as x² / 2 where |x| is 1 or more: information is that of the states that were seen."""

    def generate(rng):
        truth = draw(model, 6, rng)
        return dataclasses.replace(truth, y=np.where(np.abs(truth.x) < 1, np.nan, truth.y))

    motion = AdditiveTransition(Affine([[0.9]]), Gaussian.diagonal([1.0]))
    sensor = AdditiveSensor(lambda x, k: 0.5 * x * x, Gaussian.diagonal([0.5]))
    model = StateSpaceModel(Gaussian([0.0], [[2.0]]), motion, sensor)
    case = dataclasses.replace(
        LINEAR, name="blind", steps=6, state=("x",), blocks=(StateBlock("position", (0,), "m"),), plane=None, model=model,
        generate=generate, published=(), landmarks=(),
    )  # fmt: skip
    (found,) = bounds_of(case, 1)
    x, P, expected = case.simulate(2000, 1).x[:, 0], 2.0, []
    for states in x:
        P = 1 / (1 / (0.81 * P + 1.0) + np.mean(np.where(np.abs(states) < 1, 0.0, states**2)) / 0.5)
        expected.append(P)
    np.testing.assert_allclose(found.cov[:, 0, 0], expected, rtol=1e-9)
    assert (found.kind, found.reason) == (bounds.POSTERIOR, "")


def test_curved_modes_with_gaps_have_bounds():
    """What each trajectory alone allows for, which is no bound, and named so."""
    case = CASES["manoeuvre-detection/naval"]

    def generate(rng):
        truth = draw(case.model, case.steps, rng)
        truth.y[::3] = np.nan
        return truth

    known, fitted = bounds_of(dataclasses.replace(case, origin=FROM_MODEL, generate=generate), 1)
    assert np.isfinite(known.value).all()
    assert np.isfinite(fitted.value).all()
    assert "no strict bound" in known.reason
