"""filterpy's interacting multiple model filter against the algorithm written out, and what filterpy gets wrong.

A test of a defect fails when filterpy mends it; then the words in estimators/peers are to be changed.
"""

import dataclasses

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter, UnscentedKalmanFilter
from scipy import stats
from scipy.special import logsumexp

from estimators.peers.filterpy_imm import FilterpyImm
from suite import gaussian, moment_rules
from suite.estimator import LOST, OK
from suite.gaussian import GaussianBelief
from suite.jump import JumpModel, simulated
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from tests.estimators.test_filterpy import near, with_outages
from tests.oracles import generators, random_linear

CHAIN = np.array([[0.7, 0.2, 0.1], [0.3, 0.6, 0.1], [0.0, 0.5, 0.5]])
START = np.array([0.6, 0.1, 0.3])


def imm(model, step, y):
    """Means, covariances, log-likelihoods and mode probabilities of one run's y[T, m] (Blom and Bar-Shalom, 1988).

    step(j, x, P, z, k) gives mean, covariance and log-likelihood by mode j from those of the step before. Probabilities are
    in the log domain.
    """
    count, found = len(model.modes), []
    x, P = [mode.prior.mean for mode in model.modes], [mode.prior.cov for mode in model.modes]
    with np.errstate(divide="ignore"):
        chain, now = np.log(model.transition), np.log(model.initial)
    for k, z in enumerate(y, start=1):
        joint = chain + now[:, None]
        ahead = logsumexp(joint, axis=0)
        weights = np.exp(joint - ahead)
        mixed = [mixture(weights[:, j], x, P) for j in range(count)]
        x, P, loglik = zip(*[step(j, *mixed[j], z, k) for j in range(count)], strict=True)
        evidence = logsumexp(ahead + np.array(loglik))
        now = ahead + np.array(loglik) - evidence
        found.append((*mixture(np.exp(now), x, P), evidence, np.exp(now)))
    return tuple(np.stack(part) for part in zip(*found, strict=True))


def mixture(weights, x, P):
    """Mean and covariance of a mixture of Gaussians."""
    mean = sum(w * a for w, a in zip(weights, x, strict=True))
    return mean, sum(w * (b + np.outer(a - mean, a - mean)) for w, a, b in zip(weights, x, P, strict=True))


def kalman(problems):
    """A step of the Kalman filter by one of the linear problems, in matrices."""

    def step(j, x, P, z, k):
        p = problems[j]
        x, P = p.A @ x + p.a + p.G @ p.w, p.A @ P @ p.A.T + p.G @ p.Q @ p.G.T
        rows = np.flatnonzero(~np.isnan(z))
        if not len(rows):
            return x, P, 0.0
        H, error = p.H[rows], (z - p.H @ x - p.h - p.v)[rows]
        S = H @ P @ H.T + p.R[np.ix_(rows, rows)]
        gain = P @ H.T @ np.linalg.inv(S)
        return x + gain @ error, P - gain @ S @ gain.T, stats.multivariate_normal(np.zeros(len(rows)), S).logpdf(error)

    return step


def unscented(model, rule):
    """A step of the unscented filter by one of the modes."""

    def step(j, x, P, z, k):
        belief = GaussianBelief(x[None], np.linalg.cholesky(P)[None])
        ahead = gaussian.predict(rule, belief, model.modes[j].dynamics, k)
        after = gaussian.update(rule, ahead, model.modes[j].sensor, z[:, None], k)
        return after.mean[0], after.cov[0], after.loglik[0]

    return step


def equal(model, y, step, tolerance=1e-10, estimator=FilterpyImm()):  # noqa: B008 - it is frozen
    estimate = estimator.run(model, y)
    assert estimate.ok.all()
    for r in range(y.shape[2]):
        mean, cov, loglik, mode = imm(model, step, y[:, :, r])
        near(estimate.mean[..., r], mean, tolerance)
        near(estimate.cov[..., r], cov, tolerance)
        near(estimate.loglik[:, r], loglik, tolerance)
        near(estimate.mode[..., r], mode, tolerance)
        odds = np.log(np.delete(mode, model.nominal, axis=1).sum(1) / mode[:, model.nominal])
        near(estimate.statistic[:, r], odds, 1e-6)


def linear(kept=(), n=3, m=2):
    """Three random linear problems, and the jump model whose modes they are; of the sensors' offsets and means those kept."""
    none = {name: np.zeros(m) for name in ("h", "v") if name not in kept}
    problems = [dataclasses.replace(random_linear(10 + j, n, m, 2), **none) for j in range(3)]
    return problems, JumpModel(tuple(p.model for p in problems), CHAIN, START, nominal=1)


def kinds(model):
    """The classes of the filters that the modes run."""
    return {type(one) for one in FilterpyImm().init(model, generators(1)).objects.filters[0].filters}


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("kept", ["", "h", "v"], ids=["matrices", "offsets", "means"])
def test_equals_the_algorithm_on_linear_modes(kept, missing):
    """With offsets or means of their sensors the modes run unscented filters, on linear functions the same."""
    problems, model = linear(kept)
    y = simulated(model, 15, generators(3, "linear"))[1]
    y = with_outages(y) if missing else y
    assert kinds(model) == {UnscentedKalmanFilter if kept else KalmanFilter}
    equal(model, y, kalman(problems))


def test_an_angle_that_is_a_component_of_the_state_wraps():
    # Measured pi - 0.05 + 0.1, which is -pi + 0.05; the gain is 1/2 by P = Q = 1/2 and R = 1.
    half = Gaussian.diagonal([0.5])
    sensor = AdditiveSensor(Affine([[1.0]]), Gaussian.diagonal([1.0]), angles=(0,))
    mode = StateSpaceModel(Gaussian([np.pi - 0.05], half.cov), AdditiveTransition(Affine([[1.0]]), half), sensor)
    model = JumpModel((mode, mode), np.full((2, 2), 0.5), np.array([0.5, 0.5]))
    near(FilterpyImm().run(model, np.array([[[-np.pi + 0.05]]])).mean[0, 0, 0], np.pi, 1e-12)


def bend(x, k):
    return np.stack([x[0] + 0.1 * np.sin(x[1]) - 0.2, 0.9 * x[1] + 0.2 * np.cos(x[0] + 0.1 * k)])


def look(x, k):
    return np.stack([x[0] + 0.2 * np.sin(x[1]), np.atan2(x[1], x[0])])


SEEN = AdditiveSensor(look, Gaussian([0.1, 0.0], [[0.3, 0.1], [0.1, 0.4]]), angles=(1,))
PLAIN = AdditiveSensor(Affine([[1.0, 0.0], [0.0, 2.0]]), Gaussian.diagonal([0.5, 4.0]))
PRIOR, PUSH = Gaussian([-1.0, 0.0], [[0.5, 0.1], [0.1, 0.3]]), Gaussian([0.3], [[0.2]])
CURVED = JumpModel(
    tuple(
        StateSpaceModel(PRIOR, AdditiveTransition(motion, PUSH, gain=np.array([[1.0], [0.5]])), sensor)
        for motion, sensor in ((bend, SEEN), (Affine([[0.9, 0.2], [-0.2, 0.9]]), SEEN), (Affine(0.8 * np.eye(2)), PLAIN))
    ),
    CHAIN,
    START,
)
"""Two modes with a bearing that wraps beside one in matrices; their measurements are near enough to be taken for each other."""


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("spread", [(1.0, 2.0, 0.0), (0.5, 1.0, 2.0)], ids=str)
def test_equals_the_algorithm_on_curved_modes_beside_a_linear_one(spread, missing):
    y = simulated(CURVED, 15, generators(3, "curved"))[1]
    y = with_outages(y) if missing else y
    equal(CURVED, y, unscented(CURVED, moment_rules.unscented(*spread)), 1e-9, FilterpyImm(*spread))


def test_matrices_and_noise_may_change_with_time():
    problems, model = linear()
    modes = tuple(
        dataclasses.replace(
            mode,
            dynamics=AdditiveTransition(
                Affine(lambda k, p=p: p.A * np.cos(k), p.a), lambda k, p=p: Gaussian(k * p.w, k * p.Q), p.G
            ),
            sensor=AdditiveSensor(Affine(lambda k, p=p: p.H * np.sin(k)), mode.sensor.noise),
        )
        for p, mode in zip(problems, model.modes, strict=True)
    )
    timed = dataclasses.replace(model, modes=modes)

    def step(j, x, P, z, k):
        p = problems[j]
        return kalman([dataclasses.replace(p, A=p.A * np.cos(k), w=k * p.w, Q=k * p.Q, H=p.H * np.sin(k))])(0, x, P, z, k)

    equal(timed, simulated(timed, 8, generators(2, "timed"))[1], step)


def scalar(noise=1.0, push=0.0, size=1.0):
    """A mode of one component that stays where it is but for a push and noise; measured with variance size."""
    return StateSpaceModel(
        Gaussian([0.0], [[0.0]]),
        AdditiveTransition(Affine([[1.0]], np.array([push])), Gaussian.diagonal([noise])),
        AdditiveSensor(Affine([[1.0]]), Gaussian.diagonal([size])),
    )


def probabilities(modes, z):
    """Mode probabilities after one scalar measurement: filterpy's, and by Bayes' rule in the log domain."""
    model = JumpModel(tuple(modes), np.array([[0.9, 0.1], [0.2, 0.8]]), np.array([0.5, 0.5]))
    S = np.array([mode.dynamics.noise_cov(1)[0, 0] + mode.sensor.noise.cov[0, 0] for mode in modes])
    pushes = np.array([mode.dynamics.mean.offset[0] for mode in modes])
    logp = np.log([0.55, 0.45]) + stats.norm.logpdf(z, pushes, np.sqrt(S))
    return FilterpyImm().run(model, np.array([[[z]]])).mode[0, :, 0], np.exp(logp - logsumexp(logp))


def test_an_ordinary_measurement_weighs_the_modes_by_bayes_rule():
    found, exact = probabilities([scalar(), scalar(noise=50.0)], 5.0)
    near(found, exact)


def test_after_a_measurement_far_from_all_modes_their_probabilities_stay_as_predicted():
    found, exact = probabilities([scalar(), scalar(noise=50.0)], 1000.0)
    near(found, [0.55, 0.45])
    near(exact, [0.0, 1.0])


def test_a_likelihood_just_above_zero_loses_to_one_that_underflows():
    # 38.45 standard deviations are exp(-740), which is 4e-322; further off it is 0, which filterpy makes 2e-308.
    found, exact = probabilities([scalar(noise=0.0), scalar(noise=0.0, push=-10.0)], 38.45)
    near(found, [0.0, 1.0])
    near(exact, [1.0, 0.0])


def test_the_log_likelihood_ends_where_likelihoods_underflow():
    model = JumpModel((scalar(), scalar(push=1.0)), np.full((2, 2), 0.5), np.array([0.5, 0.5]))
    estimate = FilterpyImm().run(model, np.array([[[1e5]]]))
    near(estimate.loglik, np.log(np.finfo(float).tiny))


def test_a_likelihood_that_overflows_loses_its_own_run():
    # Without noise to speak of, four components measured as predicted have a density of 1e400.
    tiny = Gaussian.noise(1e-200 * np.eye(4))
    still = StateSpaceModel(tiny, AdditiveTransition(Affine(np.eye(4)), tiny), AdditiveSensor(Affine(np.eye(4)), tiny))
    model = JumpModel((still, still), np.full((2, 2), 0.5), np.array([0.5, 0.5]))
    assert list(FilterpyImm().run(model, np.array([[[0.0, 3e-99]] * 4])).status) == [LOST, OK]


def test_an_impossible_measurement_loses_its_own_run():
    _, model = linear("hv")
    y = simulated(model, 6, generators(3, "alone"))[1]
    spoilt = y.copy()
    spoilt[2, 0, 1] = np.inf
    plain, found = FilterpyImm().run(model, y), FilterpyImm().run(model, spoilt)
    assert list(found.status) == [OK, LOST, OK]
    for name in ("mean", "mode", "statistic"):
        np.testing.assert_array_equal(getattr(found, name)[:, ..., [0, 2]], getattr(plain, name)[:, ..., [0, 2]])


def test_filterpy_moves_the_modes_by_a_measurement_that_is_none():
    """Its filters answer `update(None)` with the density of zero under an old innovation's covariance."""
    filters = [KalmanFilter(1, 1), KalmanFilter(1, 1)]
    for kf, noise in zip(filters, (1.0, 100.0), strict=True):
        kf.H, kf.Q = np.eye(1), noise * np.eye(1)
    imm = IMMEstimator(filters, [0.5, 0.5], np.full((2, 2), 0.5))
    imm.predict()
    imm.update(np.zeros(1))
    imm.predict()
    imm.update(None)
    assert abs(imm.mu[0] - 0.5) > 0.3


def test_filterpy_does_not_take_its_extended_filter():
    imm = IMMEstimator([ExtendedKalmanFilter(1, 1), ExtendedKalmanFilter(1, 1)], [0.5, 0.5], np.full((2, 2), 0.5))
    with pytest.raises(TypeError, match="HJacobian"):
        imm.update(np.zeros(1))


def test_filterpy_divides_by_the_probability_of_a_mode():
    one = scalar()
    filters = [KalmanFilter(1, 1), KalmanFilter(1, 1)]
    with np.errstate(invalid="ignore"):
        imm = IMMEstimator(filters, [1.0, 0.0], np.eye(2))
        imm.predict()
    assert np.isnan(imm.x).all()
    assert "probability zero" in FilterpyImm().accepts(JumpModel((one, one), np.eye(2), np.array([1.0, 0.0])))
    assert FilterpyImm().accepts(JumpModel((one, one), np.eye(2), np.array([0.9, 0.1]))) is None


def test_a_mode_whose_probability_underflows_loses_its_run():
    """Where the chain has zeros, nothing else is left of the probability that filterpy divides by."""
    far = JumpModel((scalar(), scalar(push=50.0)), np.array([[1.0, 0.0], [0.5, 0.5]]), np.array([0.5, 0.5]))
    near_by = dataclasses.replace(far, modes=(scalar(), scalar(push=0.5)))
    y = np.zeros((4, 1, 1))
    assert FilterpyImm().accepts(far) is None
    assert list(FilterpyImm().run(near_by, y).status) == [OK]
    assert list(FilterpyImm().run(far, y).status) == [LOST]


def test_refuses_what_filterpy_cannot_express():
    _, model = linear("hv")

    class Law:
        dim = 2

    def accepts(*modes):
        count = len(modes)
        return FilterpyImm().accepts(JumpModel(modes, np.full((count, count), 1 / count), np.full(count, 1 / count)))

    first, second, _ = model.modes
    assert FilterpyImm().accepts(model) is None
    assert "single mode" in FilterpyImm().accepts(first)
    assert "two modes" in accepts(first)
    assert accepts(first, dataclasses.replace(second, dynamics=Law())) == "mode 2: its process noise is not additive"
    assert accepts(first, dataclasses.replace(second, sensor=Law())) == "mode 2: its measurement noise is not additive"
    known = dataclasses.replace(second, prior=Gaussian(second.prior.mean, np.zeros((3, 3))))
    assert accepts(first, known).startswith("mode 2: its prior has a singular covariance")
