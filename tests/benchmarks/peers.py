"""The bootstrap filter of other libraries on the ballistic model: what ours is timed against, each optional.

All do the same: N draws of x_0, then for every measurement systematic resampling, the transition, the likelihood, and the
weighted mean and covariance. `particles` and `stonesoup` are handed filterbench's own array code for what the library
leaves to its user, so that a difference in time is the library's; `cuthbert` gets it written once more in JAX.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from cases.ballistic import DELTA, G, fall
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.random import Streams

LIBRARIES = ("particles", "cuthbert", "stonesoup")


@dataclass(frozen=True)
class Result:
    """Means [T, n], covariances [T, n, n] and, where the library tells it, log p(y_1, ..., y_T)."""

    mean: Array
    cov: Array
    loglik: float | None = None


Run = Callable[[int], Result]
"""A filter made ready: from a seed to its result."""


def prepare(library: str, model: StateSpaceModel, y: Array, count: int) -> Run:
    """The bootstrap filter of a library, for measurements y[T, m] of the ballistic model and `count` particles."""
    return {"particles": _particles, "cuthbert": _cuthbert, "stonesoup": _stonesoup}[library](model, y, count)


def _particles(model: StateSpaceModel, y: Array, count: int) -> Run:
    """N. Chopin's `particles`: arrays [N, n], NumPy, and Numba for resampling."""
    from particles import SMC, FeynmanKac
    from particles.collectors import Moments
    from particles.resampling import wmean_and_cov

    class Ballistic(FeynmanKac):
        """The prior as step 0, which has no measurement."""

        def __init__(self, seed: int):
            super().__init__(T=len(y) + 1)
            self.rng = Streams(("peer", seed)).batch(0, 1)

        def M0(self, N):  # noqa: N802 - the library's name
            return model.prior.sample(self.rng, (1, N))[:, 0].T

        def M(self, t, xp):  # noqa: N802
            return model.dynamics.sample(self.rng, xp.T[:, None], t)[:, 0].T

        def logG(self, t, xp, x):  # noqa: N802
            return model.sensor.logpdf(y[t - 1][:, None], x.T[:, None], t)[0] if t else np.zeros(len(x))

        def default_moments(self, W, X):
            return wmean_and_cov(W, X)

    def run(seed: int) -> Result:
        np.random.seed(seed)  # noqa: NPY002 - its resampling draws from NumPy's global generator
        smc = SMC(Ballistic(seed), N=count, resampling="systematic", ESSrmin=1.0, collect=[Moments()])
        smc.run()
        mean, cov = zip(*smc.summaries.moments[1:], strict=True)
        return Result(np.stack(mean), np.stack(cov), float(smc.logLt))

    return run


def _cuthbert(model: StateSpaceModel, y: Array, count: int) -> Run:
    """`cuthbert`: JAX in double precision on one thread, compiled here, before any timing."""
    import cuthbert
    import jax
    from cuthbert.smc import particle_filter
    from cuthbertlib.resampling import systematic
    from jax import numpy as jnp

    jax.config.update("jax_enable_x64", True)
    n, m = model.n, model.m
    prior_mean, prior_root, root = model.prior.mean, model.prior.lower, model.dynamics.noise_at(1).lower
    deviation = np.sqrt(np.diag(model.sensor.noise.cov))
    constant = -0.5 * m * np.log(2 * np.pi) - np.log(deviation).sum()

    def start(key):
        return prior_mean + prior_root @ jax.random.normal(key, (n,))

    def propagate(key, state, z):
        px, vx, py, vy, beta = state
        low = py < 9144.0
        density = jnp.where(low, 1.227, 1.754) * jnp.exp(jnp.where(low, -1.093e-4, -1.49e-4) * py)
        drag = (-0.5 * G) / beta * density * jnp.sqrt(vx * vx + vy * vy)
        ax, ay, half = drag * vx, drag * vy - G, DELTA**2 / 2
        moved = [px + DELTA * vx + half * ax, vx + DELTA * ax, py + DELTA * vy + half * ay, vy + DELTA * ay, beta]
        return jnp.stack(moved) + root @ jax.random.normal(key, (n,))

    def fit(before, state, z):
        turn = z[1] - jnp.arctan2(state[2], state[0])
        turn = turn - 2 * jnp.pi * jnp.ceil(turn / (2 * jnp.pi) - 0.5)
        error = jnp.stack([z[0] - jnp.sqrt(state[0] ** 2 + state[2] ** 2), turn]) / deviation
        return constant - 0.5 * error @ error

    filter_ = particle_filter.build_filter(start, propagate, fit, count, systematic.resampling)

    @jax.jit
    def compiled(key, z):
        begin, rest = jax.random.split(key)
        states = cuthbert.filter(filter_, z, filter_.init_prepare(key=begin), key=rest)
        x, weights = states.particles[1:], jax.nn.softmax(states.log_weights[1:])
        mean = jnp.einsum("tn,tni->ti", weights, x)
        spread = (x - mean[:, None]) * jnp.sqrt(weights)[..., None]
        return mean, jnp.einsum("tni,tnj->tij", spread, spread), states.log_normalizing_constant[-1]

    def run(seed: int) -> Result:
        mean, cov, loglik = compiled(jax.random.key(seed), y)
        assert mean.dtype == jnp.float64
        return Result(np.asarray(mean), np.asarray(cov), float(loglik))

    run(0)
    return run


def _stonesoup(model: StateSpaceModel, y: Array, count: int) -> Run:
    """`stonesoup`: its own noise, radar, predictor, updater and resampler; state vectors [n, N], NumPy and SciPy."""
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    from stonesoup.models.transition.nonlinear import GaussianTransitionModel
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    class Fall(GaussianTransitionModel):
        @property
        def ndim_state(self):
            return model.n

        def covar(self, **kwargs):
            return model.dynamics.noise_cov(1)

        def function(self, state, noise=False, **kwargs):
            x = state.state_vector
            return fall(np.asarray(x), 1).view(StateVectors) + self.rvs(num_samples=x.shape[1], **kwargs)

    begin = datetime(2000, 1, 1)
    noise = model.sensor.noise.cov[::-1, ::-1]  # bearing before range
    radar = CartesianToBearingRange(ndim_state=model.n, mapping=(0, 2), noise_covar=noise)
    plots = [
        Detection(np.array([[z[1]], [z[0]]]), timestamp=begin + k * timedelta(seconds=DELTA), measurement_model=radar)
        for k, z in enumerate(y, start=1)
    ]

    def run(seed: int) -> Result:
        np.random.seed(seed)  # noqa: NPY002 - it draws from NumPy's global generator
        predictor, updater, resampler = ParticlePredictor(Fall()), ParticleUpdater(radar), SystematicResampler()
        draws = model.prior.sample(Streams(("peer", seed)).batch(0, 1), (1, count))[:, 0]
        state = ParticleState(draws.view(StateVectors), timestamp=begin, log_weight=np.full(count, -np.log(count)))
        means, covs = [], []
        for plot in plots:
            state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=plot.timestamp), plot))
            means.append(np.asarray(state.mean, float)[:, 0])
            covs.append(np.asarray(state.covar, float))
            state = resampler.resample(state)
        return Result(np.stack(means), np.stack(covs))

    return run
