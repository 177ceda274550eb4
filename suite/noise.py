"""Noises: laws of a random vector e[d, ...] with sampling, log-density and moments."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from itertools import groupby
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.linalg import block_diag
from scipy.special import gammaln

from suite.checks import finite, positive, several
from suite.linalg import Array, apply, factor
from suite.random import Generators


@runtime_checkable
class Law(Protocol):
    """Law of a random vector with d components, by its moments and draws."""

    @property
    def mean(self) -> Array:
        """Mean [d]."""

    @property
    def cov(self) -> Array:
        """Covariance [d, d]."""

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]; shape[0] is the number of runs."""


class Noise(Law, Protocol):
    """Law that has a density and marginals too."""

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]: [...]."""

    def marginal(self, rows: tuple[int, ...]) -> "Noise":
        """Law of the components `rows` alone."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Normal law; the covariance may be singular, then it can be sampled but has no density."""

    mean: Array
    cov: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", finite("Gaussian.mean", self.mean, 1))
        object.__setattr__(self, "cov", finite("Gaussian.cov", self.cov, 2))
        d = len(self.mean)
        if self.cov.shape != (d, d):
            raise ValueError(f"Gaussian.cov has shape {self.cov.shape}, a mean of {d} components needs {(d, d)}")
        _ = self.lower  # a bad covariance is named here, not at its first use

    @classmethod
    def noise(cls, cov: Array | Sequence[Sequence[float]]) -> "Gaussian":
        """Zero-mean Gaussian with covariance [d, d]."""
        matrix = finite("Gaussian.cov", cov, 2)
        return cls(np.zeros(len(matrix)), matrix)

    @classmethod
    def diagonal(cls, variances: Array | Sequence[float]) -> "Gaussian":
        """Zero-mean Gaussian of independent components with the given variances [d]."""
        return cls.noise(np.diag(finite("Gaussian.variances", variances, 1)))

    @cached_property
    def lower(self) -> Array:
        """Lower-triangular L with L Lᵀ = cov."""
        return factor(self.cov, "Gaussian.cov")

    @cached_property
    def _whiten(self) -> tuple[Array, float]:
        scale = np.diag(self.lower)
        if (scale == 0).any():
            raise ValueError("a Gaussian with a singular covariance has no density")
        return np.asarray(np.linalg.inv(self.lower), float), float(-0.5 * len(scale) * np.log(2 * np.pi) - np.log(scale).sum())

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]."""
        draws = apply(self.lower, rng.standard_normal((len(self.mean), *shape)))
        return draws + _column(self.mean, draws) if self.mean.any() else draws

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]; raises ValueError when the covariance is singular."""
        whiten, constant = self._whiten
        centred = e - _column(self.mean, e) if self.mean.any() else e
        return constant - 0.5 * _sum_of_squares(apply(whiten, centred))

    @lru_cache(maxsize=256)  # noqa: B019 - a noise lives as long as its case, and outage patterns are few
    def marginal(self, rows: tuple[int, ...]) -> "Gaussian":
        """Law of the components `rows` alone."""
        keep = list(rows)
        return Gaussian(self.mean[keep], self.cov[np.ix_(keep, keep)])


@dataclass(frozen=True, eq=False)
class StudentT:
    """Zero-mean multivariate Student t with scale matrix [d, d] and `dof` > 2 degrees of freedom (heavy tails)."""

    scale: Array
    dof: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", finite("StudentT.scale", self.scale, 2))
        factor(self.scale, "StudentT.scale")
        if not finite("StudentT.dof", self.dof, 0) > 2:
            raise ValueError(f"StudentT.dof is {self.dof}, a finite covariance needs more than 2")

    @cached_property
    def _core(self) -> Gaussian:
        return Gaussian.noise(self.scale)

    @property
    def mean(self) -> Array:
        """Mean [d]: zero."""
        return self._core.mean

    @property
    def cov(self) -> Array:
        """Covariance [d, d]: scale · dof / (dof − 2)."""
        return self.scale * (self.dof / (self.dof - 2))

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]."""
        normal = self._core.sample(rng, shape)
        chi2 = 2.0 * rng.standard_gamma(self.dof / 2, (1, *shape))
        return normal * np.sqrt(self.dof / chi2)

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]; raises ValueError when the scale matrix is singular."""
        d, dof = len(self.scale), self.dof
        whiten, _ = self._core._whiten
        constant = gammaln((dof + d) / 2) - gammaln(dof / 2) - 0.5 * d * np.log(dof * np.pi)
        constant += np.log(np.diag(whiten)).sum()
        return np.asarray(constant - 0.5 * (dof + d) * np.log1p(_sum_of_squares(apply(whiten, e)) / dof))

    def marginal(self, rows: tuple[int, ...]) -> "StudentT":
        """Law of the components `rows` alone."""
        return StudentT(self.scale[np.ix_(list(rows), list(rows))], self.dof)


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Mixture of Gaussians with positive weights that sum to one."""

    weights: tuple[float, ...]
    components: tuple[Gaussian, ...]

    def __post_init__(self) -> None:
        weights = positive("GaussianMixture.weights", self.weights)
        object.__setattr__(self, "weights", tuple(weights.tolist()))
        object.__setattr__(self, "components", several("GaussianMixture.components", self.components, Gaussian))
        if len(self.weights) != len(self.components):
            raise ValueError(f"GaussianMixture.weights has {len(weights)} entries for {len(self.components)} components")
        if abs(weights.sum() - 1) > 1e-9:
            raise ValueError(f"GaussianMixture.weights sums to {weights.sum():.9g}, not to 1")
        dims = [len(component.mean) for component in self.components]
        for i, d in enumerate(dims):
            if d != dims[0]:
                raise ValueError(f"GaussianMixture.components[{i}] is of dimension {d}, components[0] of {dims[0]}")

    @property
    def mean(self) -> Array:
        """Mean [d]."""
        return np.asarray(sum(w * c.mean for w, c in self._pairs))

    @property
    def cov(self) -> Array:
        """Covariance [d, d]."""
        mean = self.mean
        return np.asarray(sum(w * (c.cov + np.outer(c.mean - mean, c.mean - mean)) for w, c in self._pairs))

    @property
    def _pairs(self) -> list[tuple[float, Gaussian]]:
        return list(zip(self.weights, self.components, strict=True))

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]."""
        uniform = rng.random((1, *shape))
        edges = np.cumsum(self.weights)[:-1]
        chosen = self.components[0].sample(rng, shape)
        for edge, component in zip(edges, self.components[1:], strict=True):
            chosen = np.where(uniform >= edge, component.sample(rng, shape), chosen)
        return chosen

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]."""
        terms = [np.log(w) + c.logpdf(e) for w, c in self._pairs]
        return np.asarray(reduce(np.logaddexp, terms))

    def marginal(self, rows: tuple[int, ...]) -> "GaussianMixture":
        """Law of the components `rows` alone."""
        return GaussianMixture(self.weights, tuple(c.marginal(rows) for c in self.components))


@dataclass(frozen=True, eq=False)
class Gamma:
    """Independent Gamma components with shape parameters [d] and scales [d]; zero or above, mean shape · scale."""

    shape: Array
    scale: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", positive("Gamma.shape", self.shape))
        object.__setattr__(self, "scale", positive("Gamma.scale", self.scale))
        if len(self.shape) != len(self.scale):
            raise ValueError(f"Gamma.scale has {len(self.scale)} entries, Gamma.shape has {len(self.shape)}")

    @property
    def mean(self) -> Array:
        """Mean [d]."""
        return self.shape * self.scale

    @property
    def cov(self) -> Array:
        """Covariance [d, d], diagonal."""
        return np.diag(self.shape * self.scale**2)

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]."""
        draws = [s * rng.standard_gamma(a, (1, *shape))[0] for a, s in zip(self.shape, self.scale, strict=True)]
        return np.stack(draws)

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]; minus infinity where a component is not positive."""
        a, s = _column(self.shape, e), _column(self.scale, e)
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = (a - 1) * np.log(e / s) - e / s - gammaln(a) - np.log(s)
        terms = np.where(e <= 0, -np.inf, terms)
        total = terms[0]
        for term in terms[1:]:
            total = total + term
        return np.asarray(total)

    def marginal(self, rows: tuple[int, ...]) -> "Gamma":
        """Law of the components `rows` alone."""
        return Gamma(self.shape[list(rows)], self.scale[list(rows)])


@dataclass(frozen=True, eq=False)
class Independent:
    """Vector made of independent ones, one below the other, each with a law of its own."""

    parts: tuple[Noise, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", several("Independent.parts", self.parts, Law))

    @cached_property
    def mean(self) -> Array:
        """Mean [d]."""
        return np.concat([part.mean for part in self.parts])

    @cached_property
    def cov(self) -> Array:
        """Covariance [d, d], block-diagonal."""
        return np.asarray(block_diag(*(part.cov for part in self.parts)))

    @cached_property
    def _places(self) -> list[tuple[int, int]]:
        """For each component, its part and its place within that part."""
        return [(p, i) for p, part in enumerate(self.parts) for i in range(len(part.mean))]

    def sample(self, rng: Generators, shape: tuple[int, ...]) -> Array:
        """Independent draws [d, *shape]."""
        return np.concat([part.sample(rng, shape) for part in self.parts])

    def logpdf(self, e: Array) -> Array:
        """Log-density at e[d, ...]."""
        ends = np.cumsum([len(part.mean) for part in self.parts])[:-1]
        terms = [part.logpdf(piece) for part, piece in zip(self.parts, np.split(e, ends), strict=True)]
        return np.asarray(reduce(np.add, terms))

    def marginal(self, rows: tuple[int, ...]) -> Noise:
        """Law of the components `rows` alone. Raises ValueError when those of one part do not stand together."""
        groups = [(p, tuple(i for _, i in group)) for p, group in groupby((self._places[r] for r in rows), lambda at: at[0])]
        if len({p for p, _ in groups}) < len(groups):
            raise ValueError(f"components of one part must stand together, got {rows}")
        laws = tuple(self.parts[p].marginal(inside) for p, inside in groups)
        return laws[0] if len(laws) == 1 else Independent(laws)


def _column(vector: Array, like: Array) -> Array:
    """A vector [d] shaped to broadcast over the trailing axes of `like`[d, ...]."""
    return vector.reshape(-1, *(1,) * (like.ndim - 1))


def _sum_of_squares(x: Array) -> Array:
    """Sum of squares over the leading axis, in a fixed order whatever the trailing shape."""
    total = x[0] * x[0]
    for row in x[1:]:
        total = total + row * row
    return np.asarray(total)
