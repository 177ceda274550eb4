"""Fisher information: of a noise about what it is added to, of a measurement about the state, of a step about the last one."""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from suite import gaussian
from suite.jump import Modes
from suite.linalg import Array, factor, lower_triangular
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel, outage_patterns
from suite.noise import Gamma, Gaussian, GaussianMixture, Independent, Noise, StudentT
from suite.random import Streams

DRAWS = 200_000
NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


def information(noise: Noise) -> Array:
    """Fisher information matrix E[s sᵀ] [d, d] of a noise, with s the gradient of its log-density.

    In closed form for Gaussian, Student t (Lange, Little and Taylor, 1989) and Gamma laws, by quadrature to 1e-9 for scalar
    mixtures; for any other law over 200 000 draws of its own, with a relative standard error of about 0.5 %. Raises ValueError
    when there is none: no density, or one that jumps or has an edge too steep.
    """
    match noise:
        case Gaussian():
            if not np.diag(noise.lower).all():
                raise ValueError("a singular covariance")
            return np.asarray(np.linalg.inv(noise.cov))
        case StudentT():
            d = len(noise.scale)
            return (noise.dof + d) / (noise.dof + d + 2) * information(Gaussian.noise(noise.scale))
        case Gamma():
            if (noise.shape <= 2).any():
                raise ValueError("a Gamma law with a shape of 2 or less")
            return np.diag(1 / ((noise.shape - 2) * noise.scale**2))
        case Independent():
            return np.asarray(block_diag(*(information(part) for part in noise.parts)), float)
        case GaussianMixture() if len(noise.mean) == 1:
            return _by_quadrature(noise)
    return _by_simulation(noise)


@lru_cache(maxsize=256)
def of_components(noise: Noise, rows: tuple[int, ...]) -> Array:
    """Fisher information of the components `rows` of a noise alone."""
    return information(noise.marginal(rows))


@lru_cache(maxsize=256)
def noise_factor(noise: Noise) -> Array:
    """A factor [d, d] of the inverse of a noise's Fisher information; of its covariance for a Gaussian, singular or not."""
    return noise.lower if isinstance(noise, Gaussian) else factor(np.asarray(np.linalg.inv(information(noise))))


def refusal(model: StateSpaceModel, steps: int) -> str | None:
    """None when both laws of the model have slopes, and noises with a finite Fisher information; otherwise why not."""
    if reason := gaussian.additive(model) or gaussian.differentiable(model):
        return reason
    part, rows = "measurement", tuple(range(model.m))
    try:
        for k in range(1, steps + 1):
            of_components(sensor(model).noise_at(k), rows)  # type: ignore[arg-type]
        part = "process"
        for k in range(1, steps + 1):
            process_factor(model, k)
    except ValueError as error:
        return f"its {part} noise has no finite Fisher information: {error}"
    return None


def dynamics(model: StateSpaceModel) -> AdditiveTransition:
    """The transition of a model that was not refused."""
    assert isinstance(model.dynamics, AdditiveTransition)
    return model.dynamics


def sensor(model: StateSpaceModel) -> AdditiveSensor:
    """The sensor of a model that was not refused."""
    assert isinstance(model.sensor, AdditiveSensor)
    return model.sensor


def constant(model: StateSpaceModel) -> bool:
    """Whether the slopes of both laws do not depend on the state."""
    return isinstance(dynamics(model).mean, Affine) and isinstance(sensor(model).mean, Affine)


def by_mode(mode: Modes) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """The modes that are in force in some of the runs [R], with those runs."""
    for j in np.flatnonzero(np.bincount(mode)).tolist():
        yield j, np.flatnonzero(mode == j)


def measured(modes: Sequence[StateSpaceModel], mode: Modes, x: Array, y: Array | None, k: int) -> Array:
    """Information Hᵀ I H [n, n, R] of those components of y_k = y[m, R] that are not missing about each run's x_k = x[n, R]."""
    found = np.zeros((len(x), *x.shape))
    seen = np.zeros((modes[0].m, x.shape[1])) if y is None else y
    for j, at in by_mode(mode):
        law = sensor(modes[j])
        slope = law.jacobian(x[:, at], k)
        for rows, runs in outage_patterns(seen[:, at]):
            if rows:
                H = slope[np.array(rows)[:, None, None], np.arange(len(x))[:, None], runs]
                weighed = np.tensordot(of_components(law.noise_at(k), rows), H, 1)  # type: ignore[arg-type]
                found[:, :, at[runs]] = np.einsum("pir,pjr->ijr", H, weighed)
    return found


def process_factor(model: StateSpaceModel, k: int) -> Array:
    """A factor Q = root rootᵀ [n, n] of the inverse of the Fisher information that x_k has about the mean of its transition.

    Behind a gain G it is that of G I⁻¹ Gᵀ, which is exact for Gaussian noise and wherever G has full column rank, and
    otherwise too small, hence still part of a bound (Zamir, 1998).
    """
    root, gain = noise_factor(dynamics(model).noise_at(k)), dynamics(model).gain  # type: ignore[arg-type]
    return np.asarray(lower_triangular((root if gain is None else gain @ root)[None])[0])


def whitening(root: Array) -> tuple[Array, Array]:
    """For a factor [n, n] of Q: W with W Q Wᵀ = 1 on the range of Q, and N whose rows stand across it, N Q = 0; [n, n] each."""
    scale = np.linalg.norm(root, axis=1)
    scale[scale == 0] = 1.0
    directions, sizes, _ = np.linalg.svd(root / scale[:, None])
    inside = (sizes > 1e-9 * sizes[0])[:, None]
    rows = directions.T / scale
    return np.where(inside, rows / np.where(inside, sizes[:, None], 1.0), 0.0), np.where(inside, 0.0, rows)


def _by_quadrature(noise: GaussianMixture) -> Array:
    """Of a scalar mixture, by Gauss-Legendre rules on pieces that are short for every component within its reach."""
    mean = np.asarray([part.mean[0] for part in noise.components])
    std = np.sqrt([part.cov[0, 0] for part in noise.components])
    if not std.all():
        raise ValueError("a mixture with a component without spread")
    edges = np.unique(mean[:, None] + std[:, None] * np.linspace(-10, 10, 81))
    half = np.diff(edges)[:, None] / 2
    e = (edges[:-1, None] + half * (1 + NODES)).ravel()
    logp = np.stack([np.log(w) + part.logpdf(e[None]) for w, part in zip(noise.weights, noise.components, strict=True)])
    total = noise.logpdf(e[None])
    score = (np.exp(logp - total) * (mean[:, None] - e) / std[:, None] ** 2).sum(0)
    return np.array([[(half * WEIGHTS).ravel() @ (np.exp(total) * score**2)]])


def _by_simulation(noise: Noise) -> Array:
    """By the score, from central differences, at fixed draws; E[s (e - mean)ᵀ] = -1 tells whether the density is smooth."""
    d, std = len(noise.mean), np.sqrt(np.diag(noise.cov))
    e = noise.sample(Streams(("Fisher information",)).batch(0, 1), (1, DRAWS))[:, 0]
    step = 1e-5 * std[:, None, None] * np.eye(d)[:, :, None]
    with np.errstate(invalid="ignore"):  # where the density is zero on one side or both
        score = np.stack([(noise.logpdf(e + h) - noise.logpdf(e - h)) / (2e-5 * s) for h, s in zip(step, std, strict=True)])
        products = score[:, None] * (e - noise.mean[:, None]) * (std[:, None] / std)[..., None]
        reach = 6 * products.std(-1) / np.sqrt(DRAWS) + 1e-3
    if not (np.abs(products.mean(-1) + np.eye(d)) <= reach).all():
        raise ValueError("a density that is not smooth, or not over all numbers")
    return np.asarray(score @ score.T / DRAWS, float)
