"""The interacting multiple model filter against one filter, filterpy's, and the exact sum over all sequences of modes."""

import dataclasses
import itertools

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from estimators.imm import InteractingExtended, InteractingUnscented
from estimators.kalman import Kalman
from estimators.ukf import Unscented
from suite import modes
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.problems import CURVED
from tests.jump_oracles import PARTS, THREE, TWO, JumpLinear, enumeration, near
from tests.oracles import range_bearing

BOTH = pytest.mark.parametrize("imm", [InteractingExtended(), InteractingUnscented()], ids=lambda f: f.name)
TPMS = (np.eye(3), THREE.P, np.full((3, 3), 1 / 3), np.roll(np.eye(3), 1, axis=1))
LAWS = (np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.0, 0.8]))


def common_prior(p):
    """The model with the prior of its first mode for all modes."""
    first = p.modes[0]
    return dataclasses.replace(p, modes=tuple(dataclasses.replace(mode, m0=first.m0, P0=first.P0) for mode in p.modes))


def with_outages(y):
    """The first step without one component in one run and without both in another; later ones missing here and there."""
    y = y.copy()
    y[0, 0, 0] = y[0, :, 1] = y[2, 1, 2] = y[3, :, 1:3] = np.nan
    return y


@pytest.mark.parametrize("p0", LAWS)
@pytest.mark.parametrize("P", TPMS)
@BOTH
def test_identical_modes_are_one_filter(imm, P, p0):
    problem = JumpLinear((THREE.modes[1],) * 3, P, p0)
    y = with_outages(THREE.simulate(steps=8, runs=4, seed=1)[1])
    found = imm.run(problem.model, y)
    near(found, Kalman().run(THREE.modes[1].model, y), PARTS[:3])
    chain = np.stack([p0 @ np.linalg.matrix_power(P, k) for k in range(1, 9)])
    np.testing.assert_allclose(found.mode, np.repeat(chain[..., None], 4, axis=2), rtol=1e-10, atol=1e-12)


def test_identical_curved_modes_are_one_unscented_filter():
    model = range_bearing()
    jumping = JumpModel((model, model), TWO.P, TWO.p0)
    y = np.array([[1000.0, np.pi], [990.0, -3.13], [np.nan, -3.1]])[..., None]
    near(InteractingUnscented().run(jumping, y), Unscented().run(model, y), PARTS[:3])


@pytest.mark.parametrize("mode", [0, 1, 2])
@BOTH
def test_where_nothing_leads_away_from_the_first_mode_it_is_that_mode_s_filter(imm, mode):
    P = np.full((3, 3), 1 / 3)
    P[mode] = np.eye(3)[mode]
    problem = dataclasses.replace(THREE, P=P, p0=np.eye(3)[mode])
    y = with_outages(THREE.simulate(steps=8, runs=4, seed=2)[1])
    found = imm.run(problem.model, y)
    near(found, Kalman().run(THREE.modes[mode].model, y), PARTS[:3])
    np.testing.assert_array_equal(found.mode, np.broadcast_to(np.eye(3)[mode][:, None], found.mode.shape))
    assert (found.statistic == (1e300 if mode else -1e300)).all()


class Shifted(KalmanFilter):
    """filterpy's Kalman filter for measurements with an offset."""

    offset = 0.0

    def update(self, z):
        super().update(z - self.offset)


def filterpy_imm(p):
    filters = []
    for mode in p.modes:
        kf = Shifted(dim_x=2, dim_z=2, dim_u=1)
        kf.x, kf.P = mode.m0[:, None].copy(), mode.P0.copy()
        kf.F, kf.B, kf.Q = mode.A, (mode.a + mode.G @ mode.w)[:, None], mode.G @ mode.Q @ mode.G.T
        kf.H, kf.R, kf.offset = mode.H, mode.R, (mode.h + mode.v)[:, None]
        filters.append(kf)
    return IMMEstimator(filters, p.p0.copy(), p.P)


@pytest.mark.parametrize("problem", [TWO, THREE], ids=["two", "three"])
@BOTH
def test_equals_filterpy(imm, problem):
    _, y, _ = problem.simulate(steps=10, runs=4, seed=3)
    found = imm.run(problem.model, y)
    for r in range(4):
        theirs = filterpy_imm(problem)
        for k, z in enumerate(y[:, :, r]):
            theirs.predict(u=np.ones((1, 1)))
            ahead = theirs.cbar.copy()
            theirs.update(z[:, None])
            np.testing.assert_allclose(found.mean[k, :, r], theirs.x[:, 0], rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(found.cov[k, :, :, r], theirs.P, rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(found.mode[k, :, r], theirs.mu, rtol=1e-10, atol=1e-12)
            likelihood = ahead @ [f.likelihood for f in theirs.filters]
            np.testing.assert_allclose(found.loglik[k, r], np.log(likelihood), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("problem", [TWO, common_prior(THREE)], ids=["two", "three"])
@BOTH
def test_the_first_step_is_exact_where_modes_share_a_prior(imm, problem):
    y = with_outages(problem.simulate(steps=4, runs=6, seed=4)[1])[:1]
    exact = enumeration(problem, y)
    found = imm.run(problem.model, y)
    near(found, exact)
    np.testing.assert_allclose(found.statistic, np.log(exact.mode[:, 1:].sum(1) / exact.mode[:, 0]), rtol=1e-9, atol=1e-9)


@BOTH
def test_an_outlier_still_tells_modes_apart(imm):
    """A measurement some 1e4 deviations off: all likelihoods underflow, and what says most for it is the widest mode."""
    _, y, _ = TWO.simulate(steps=6, runs=2, seed=5)
    y[0, :, 0] = [2e4, -1e4]
    exact, found = enumeration(TWO, y[:1]), imm.run(TWO.model, y)
    assert exact.loglik[0, 0] < -1e6
    np.testing.assert_allclose(found.loglik[0, 0], exact.loglik[0, 0], rtol=1e-12)
    odds = exact.logp[0, 1, 0] - exact.logp[0, 0, 0]
    assert odds > 1e6
    np.testing.assert_allclose(found.statistic[0, 0], odds, rtol=1e-12)
    np.testing.assert_array_equal(found.mode[0, :, 0], [0.0, 1.0])
    assert found.ok.all()
    np.testing.assert_allclose(found.mode.sum(1), 1.0, rtol=1e-12)
    theirs = filterpy_imm(TWO)
    theirs.predict(u=np.ones((1, 1)))
    theirs.update(y[0, :, :1])
    np.testing.assert_allclose(theirs.mu, TWO.p0 @ TWO.P)  # in the linear domain it learns nothing


# How far merging leaves it from exact, rms over 40 runs of 5 steps, and what is left when all modes start from the one
# Gaussian that the step before amounts to (the generalised pseudo-Bayes method of first order, GPB1). Measured:
#                 mean, in posterior deviations   mode probabilities   log-likelihood
#   two modes               0.030 and 0.086         0.008 and 0.041    0.023 and 0.089
#   three modes             0.106 and 0.194         0.015 and 0.042    0.094 and 0.234
CLOSE = [(TWO, (0.04, 0.011, 0.03)), (common_prior(THREE), (0.14, 0.02, 0.13))]


@pytest.mark.parametrize(("problem", "bounds"), CLOSE, ids=["two", "three"])
def test_later_steps_are_close_to_exact_and_closer_than_with_one_gaussian(problem, bounds, monkeypatch):
    y = problem.simulate(steps=5, runs=40, seed=6)[1]
    exact = enumeration(problem, y)
    deviation = np.sqrt(np.moveaxis(np.diagonal(exact.cov, axis1=1, axis2=2), -1, 1))

    def distance():
        found = InteractingExtended().run(problem.model, y)
        scaled = (found.mean - exact.mean) / deviation
        return np.array([np.sqrt((e * e).mean()) for e in (scaled, found.mode - exact.mode, found.loglik - exact.loglik)])

    found, predicted = distance(), modes.predicted
    monkeypatch.setattr(modes, "predicted", lambda model, logp: (predicted(model, logp)[0], all_alike(logp)))
    assert (found < bounds).all()
    assert (found < 0.6 * distance()).all()


def all_alike(logp):
    """Mixing weights [M, M, R] that are the modes' probabilities, whatever mode follows."""
    return np.repeat(np.exp(logp)[:, None], len(logp), axis=1)


@BOTH
def test_without_measurements_it_is_exact(imm):
    """Merging keeps mean and covariance, and these are all that linear predictions need."""
    y = np.full((4, 2, 1), np.nan)
    for problem in (TWO, THREE):
        found, exact = imm.run(problem.model, y), enumeration(problem, y)
        near(found, exact, ("mean", "cov", "mode"))
        np.testing.assert_allclose(found.loglik, 0.0, atol=1e-14)
        assert found.innovation is None


@BOTH
def test_the_order_of_modes_does_not_matter(imm):
    model = THREE.model
    y = with_outages(THREE.simulate(steps=8, runs=4, seed=7)[1])
    found = imm.run(dataclasses.replace(model, nominal=1), y)
    for order in itertools.permutations(range(3)):
        turned = JumpModel(
            tuple(model.modes[i] for i in order),
            model.transition[np.ix_(order, order)],
            model.initial[list(order)],
            order.index(1),
        )
        other = imm.run(turned, y)
        near(other, found, ("mean", "cov", "loglik", "statistic"))
        np.testing.assert_allclose(other.mode, found.mode[:, order], rtol=1e-10, atol=1e-13)


@BOTH
def test_runs_with_other_gaps_keep_their_bits(imm):
    y = with_outages(THREE.simulate(steps=6, runs=4, seed=8)[1])
    found = imm.run(THREE.model, y)
    for r in range(4):
        alone = imm.run(THREE.model, y[:, :, r : r + 1])
        for part in (*PARTS, "statistic"):
            np.testing.assert_array_equal(getattr(alone, part)[..., 0], getattr(found, part)[..., r])


WALK = StateSpaceModel(
    Gaussian([5.0], [[0.01]]),
    AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[0.01]])),
    AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[0.01]])),
)
POSITIVE = dataclasses.replace(WALK, sensor=AdditiveSensor(lambda x, k: np.sqrt(x) ** 2, WALK.sensor.noise))
"""A scalar walk, and the same with a sensor that sees no state below zero."""
BELOW = np.array([[-5.0, 5.0], [-5.0, 5.1], [-5.0, 5.0], [-5.0, 5.1]])[:, None]
"""Measurements that draw one of two runs below zero in their first step."""


@BOTH
def test_a_mode_without_numbers_has_probability_zero_and_spoils_nothing(imm):
    """It starts anew from the other mode in each step, and is lost again."""
    found, alone = imm.run(JumpModel((WALK, POSITIVE), TWO.P, TWO.p0), BELOW), Kalman().run(WALK, BELOW)
    assert found.ok.all()
    near(found, alone, ("mean", "cov"))
    chain = np.stack([TWO.p0 @ np.linalg.matrix_power(TWO.P, k) for k in range(1, 5)])
    np.testing.assert_allclose(found.mode[..., 1], chain, rtol=1e-9)
    np.testing.assert_allclose(found.mode[..., 0], [chain[0], [1, 0], [1, 0], [1, 0]], rtol=1e-9)
    np.testing.assert_allclose(found.loglik[:, 1], alone.loglik[:, 1], rtol=1e-9)
    of_the_first = np.log([1.0, chain[1, 0], TWO.P[0, 0], TWO.P[0, 0]])
    np.testing.assert_allclose(found.loglik[:, 0], alone.loglik[:, 0] + of_the_first, rtol=1e-9)


@BOTH
def test_a_run_is_lost_only_when_all_its_modes_are(imm):
    model = JumpModel((POSITIVE, POSITIVE), TWO.P, TWO.p0)
    found = imm.run(model, BELOW)
    np.testing.assert_array_equal(found.ok, [False, True])
    assert found.reason[0].startswith("step 2:")
    np.testing.assert_array_equal(found.mean[..., 1:], imm.run(model, BELOW[..., 1:]).mean)


def test_one_mode_is_a_single_filter():
    model = TWO.model.modes[1]
    y = with_outages(TWO.simulate(steps=4, runs=4, seed=9)[1])
    found = InteractingExtended().run(JumpModel((model,), [[1.0]], [1.0]), y)
    near(found, Kalman().run(model, y), PARTS[:3])
    assert (found.mode == 1).all()
    assert (found.statistic == -1e300).all()


class Sampled:
    """A sensor that is no function of a state and a noise."""

    dim = 2


def test_what_it_accepts():
    plain = TWO.model
    opaque = AdditiveSensor(lambda x, k: np.frompyfunc(float, 1, 1)(x), plain.modes[1].sensor.noise)
    foreign = dataclasses.replace(plain.modes[1], sensor=Sampled())
    for imm in (InteractingExtended(), InteractingUnscented()):
        assert imm.accepts(plain) is None
        assert imm.accepts(dataclasses.replace(JumpModel((CURVED, CURVED), TWO.P, TWO.p0))) is None
        assert imm.accepts(CURVED) == "the model has a single mode"
        refusal = imm.accepts(dataclasses.replace(plain, modes=(plain.modes[0], foreign)))
        assert refusal == "mode 2: its measurement is not a function of the state and a noise"
    replaced = dataclasses.replace(plain.modes[1], sensor=opaque)
    curved = dataclasses.replace(plain, modes=(plain.modes[0], replaced), names=("straight", "turning"))
    assert InteractingUnscented().accepts(curved) is None
    assert InteractingExtended().accepts(curved).startswith("turning: its sensor cannot be differentiated")
