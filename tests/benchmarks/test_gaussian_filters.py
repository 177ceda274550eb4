"""The Gaussian filters against filterpy's on the same work: first the same answers, then the time of a run-step.

filterpy's are written as its users would: one run after the other, with no more hooks than the models need, and mean,
covariance and log-likelihood stored. Both get the same functions and derivatives, but filterpy matrices where it is linear.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import (
    CubatureKalmanFilter,
    ExtendedKalmanFilter,
    IMMEstimator,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from cases import CASES
from cases.ballistic import DELTA, G, air_density
from estimators import ESTIMATORS
from suite.jump import JumpModel, simulated
from suite.linalg import Array
from suite.model import Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Streams
from tests.benchmarks.timing import TIMER, in_turns, rounds_within

pytestmark = pytest.mark.benchmark(timer=TIMER)

RUNS = 100
KNOWN_DEFECT = ("ckf",)
"""Where filterpy's estimates are not those of the method, see estimators/peers/filterpy.py: the loop is held against that."""


def fall_slope(s: Array, k: int) -> Array:
    """Derivative of the ballistic case's motion."""
    _, vx, y, vy, beta = s
    speed = np.sqrt(vx * vx + vy * vy)
    c = (-0.5 * G) / beta * air_density(y)
    thinning = np.where(y < 9144.0, -1.093e-4, -1.49e-4)
    slope = np.zeros((5, *s.shape))
    for row, v in ((0, vx), (2, vy)):
        of_acceleration = np.stack(
            [0 * c, c * v * vx / speed, c * v * speed * thinning, c * v * vy / speed, -c * v * speed / beta]
        )
        of_acceleration[row + 1] += c * speed
        slope[row], slope[row + 1] = DELTA**2 / 2 * of_acceleration, DELTA * of_acceleration
        slope[row, row + 1] += DELTA
    for i in range(5):
        slope[i, i] += 1.0
    return slope


def radar_slope(s: Array, k: int) -> Array:
    """Derivative of the ballistic case's range and elevation."""
    x, _, y, _, _ = s
    square, none = x * x + y * y, np.zeros_like(x)
    far = np.sqrt(square)
    return np.stack([np.stack([x / far, none, y / far, none, none]), np.stack([-y / square, none, x / square, none, none])])


LINEAR = CASES["linear-gaussian"].model
BALLISTIC = replace(
    CASES["ballistic/1"].model,
    dynamics=replace(CASES["ballistic/1"].model.dynamics, jacobian_of_mean=fall_slope),
    sensor=replace(CASES["ballistic/1"].model.sensor, jacobian_of_mean=radar_slope),
)
TURNING = replace(LINEAR, dynamics=replace(LINEAR.dynamics, noise=Gaussian.noise(25 * LINEAR.dynamics.noise_cov(1))))
SWITCHING = JumpModel((LINEAR, TURNING), np.array([[0.95, 0.05], [0.1, 0.9]]), np.array([0.9, 0.1]))


@dataclass(frozen=True)
class Track:
    """What is kept of a run: means [T, n], covariances [T, n, n], log-likelihoods [T]."""

    mean: Array
    cov: Array
    loglik: Array


def recorded(one: Any, y: Array, advance: Callable[[Array, int], float]) -> Track:
    """A filterpy object's track over measurements y[T, m], each of which `advance` gives it."""
    n, steps = one.P.shape[0], len(y)
    track = Track(np.empty((steps, n)), np.empty((steps, n, n)), np.empty(steps))
    for k, z in enumerate(y, start=1):
        track.loglik[k - 1] = advance(z, k)
        track.mean[k - 1], track.cov[k - 1] = one.x.ravel(), one.P
    return track


def set_up(one: Any, model: StateSpaceModel) -> Any:
    """A filterpy object at the prior, with noises, and the matrices that Kalman filters take."""
    one.x, one.P = model.prior.mean.copy(), model.prior.cov.copy()
    one.Q, one.R = model.dynamics.noise_cov(1), model.sensor.noise.cov
    if isinstance(one, KalmanFilter):
        one.F, one.H = model.dynamics.mean.matrix(1), model.sensor.mean.matrix(1)
    return one


def plain(function: Callable[[Array, int], Array]) -> Callable[..., Array]:
    """A model's function of one state x[n]; whatever filterpy gives beside it does not matter to these models."""
    if isinstance(function, Affine):
        matrix = function.matrix(1)
        return lambda x, dt=None: matrix @ x
    return lambda x, dt=None: function(x, 1)


def slope(law: Any) -> Callable[[Array], Array]:
    """The derivative of a law's function in one state x[n]."""
    if isinstance(law.mean, Affine):
        matrix = law.mean.matrix(1)
        return lambda x: matrix
    return lambda x: law.jacobian_of_mean(x, 1)


def kalman(model: StateSpaceModel, y: Array) -> Track:
    kf = set_up(KalmanFilter(model.n, model.m), model)

    def advance(z: Array, k: int) -> float:
        kf.predict()
        kf.update(z)
        return kf.log_likelihood

    return recorded(kf, y, advance)


def extended(model: StateSpaceModel, y: Array) -> Track:
    move, look, into, onto = plain(model.dynamics.mean), plain(model.sensor.mean), slope(model.dynamics), slope(model.sensor)

    class Moved(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = move(self.x)

    ekf = set_up(Moved(model.n, model.m), model)

    def advance(z: Array, k: int) -> float:
        ekf.F = into(ekf.x)
        ekf.predict()
        ekf.update(z, onto, look)
        return ekf.log_likelihood

    return recorded(ekf, y, advance)


def sigma(model: StateSpaceModel) -> UnscentedKalmanFilter:
    points = MerweScaledSigmaPoints(model.n, 1.0, 2.0, 0.0)
    return set_up(
        UnscentedKalmanFilter(model.n, model.m, 1.0, plain(model.sensor.mean), plain(model.dynamics.mean), points), model
    )


def unscented(model: StateSpaceModel, y: Array) -> Track:
    ukf = sigma(model)

    def advance(z: Array, k: int) -> float:
        ukf.predict()
        ukf.update(z)
        return ukf.log_likelihood

    return recorded(ukf, y, advance)


def cubature(model: StateSpaceModel, y: Array) -> Track:
    ckf = set_up(CubatureKalmanFilter(model.n, model.m, 1.0, plain(model.sensor.mean), plain(model.dynamics.mean)), model)

    def advance(z: Array, k: int) -> float:
        ckf.predict()
        ckf.update(z[:, None])
        return ckf.log_likelihood

    return recorded(ckf, y, advance)


def multiple(make: Callable[[StateSpaceModel], Any], model: JumpModel, y: Array) -> Track:
    imm = IMMEstimator([make(mode) for mode in model.modes], model.initial, model.transition)

    def advance(z: Array, k: int) -> float:
        predicted = imm.cbar
        imm.predict()
        imm.update(z)
        return float(np.log(predicted @ imm.likelihood))

    return recorded(imm, y, advance)


Loop = Callable[[Any, Array], Track]
matrices: Loop = partial(multiple, lambda mode: set_up(KalmanFilter(mode.n, mode.m), mode))
WORK: tuple[tuple[str, Any, str, Loop], ...] = (
    ("linear-gaussian", LINEAR, "kalman", kalman),
    ("linear-gaussian", LINEAR, "ekf", extended),
    ("linear-gaussian", LINEAR, "ukf", unscented),
    ("linear-gaussian", LINEAR, "ckf", cubature),
    ("ballistic/1", BALLISTIC, "ekf", extended),
    ("ballistic/1", BALLISTIC, "ukf", unscented),
    ("ballistic/1", BALLISTIC, "ckf", cubature),
    ("two linear modes", SWITCHING, "imm-ekf", matrices),
    ("two linear modes", SWITCHING, "imm-ukf", partial(multiple, sigma)),
)


def measured(case: str) -> Array:
    """Measurements y[T, m, R] of a case."""
    if case in CASES:
        return CASES[case].simulate(RUNS, seed=1).y
    return simulated(SWITCHING, 100, Streams(("bench",)).batch(0, RUNS))[1]


def check_agreement(ours: Any, loop: Loop, model: Any, y: Array) -> None:
    """Both give the same means, covariances and log-likelihoods, to rounding."""
    estimate = ours.run(model, y)
    for r in range(y.shape[2]):
        track = loop(model, y[:, :, r])
        for name in ("mean", "cov", "loglik"):
            a, b = getattr(estimate, name)[..., r], getattr(track, name)
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(b).max())


def check_derivatives() -> None:
    """Both filters would agree on derivatives that are wrong."""
    original, s = CASES["ballistic/1"].model, CASES["ballistic/1"].simulate(3, seed=1).x[10]
    np.testing.assert_allclose(fall_slope(s, 1), original.dynamics.jacobian(s, 1), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(radar_slope(s, 1), original.sensor.jacobian(s, 1), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("case", "model", "name", "loop"), WORK, ids=[f"{case}-{name}" for case, _, name, _ in WORK])
def test_gaussian_filter_against_filterpy(benchmark, case: str, model: Any, name: str, loop: Loop) -> None:
    if name not in ESTIMATORS:
        pytest.skip(f"no estimator is named {name}")
    ours, y = ESTIMATORS[name], measured(case)
    check_derivatives()
    check_agreement(ESTIMATORS[f"filterpy:{name}"] if name in KNOWN_DEFECT else ours, loop, model, y[:, :, :3])
    one = np.ascontiguousarray(y[:, :, :1])

    def peer() -> Track:  # its second run costs what its first does
        return loop(model, y[:, :, 0])

    rivals = {"one": lambda: ours.run(model, one), "100": lambda: ours.run(model, y)}
    turns = in_turns(benchmark, peer, rivals, rounds_within(4, peer, low=5, high=30))
    us = 1e6 / len(y)
    benchmark.group = f"{case}, Gaussian filters and filterpy's"
    benchmark.extra_info |= {
        "table": "Gaussian filters and filterpy's on the same work, microseconds a run-step, one thread; "
        "aims: 100 runs together 20 times as fast as filterpy, one run no slower",
        "case": case,
        "filter": name,
        "filterpy": us * float(np.median(turns.subject)),
        "one run": us * turns.medians()["one"],
        "100 runs": us / RUNS * turns.medians()["100"],
        "filterpy to one": turns.ratio("one"),
        "filterpy to 100": RUNS * turns.ratio("100"),
    }
