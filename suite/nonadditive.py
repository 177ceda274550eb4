"""Laws whose noise enters their function: x_k = f(x_{k-1}, w_k, k), y_k = h(x_k, v_k, k)."""

from collections.abc import Callable
from dataclasses import dataclass

from suite.angles import difference, wrap
from suite.checks import instance, is_integer, places, shown
from suite.jacobian import value_and_derivative
from suite.linalg import Array
from suite.noise import Law, Noise
from suite.random import Generators

NoisyFunction = Callable[[Array, Array, int], Array]
"""function(x[n, ...], noise[q, ...], k) -> [p, ...]."""
Density = Callable[[Array, Array, int], Array]


@dataclass(frozen=True, eq=False)
class NonadditiveTransition:
    """x_k = function(x_{k-1}, w_k, k) with w_k from `noise`, constant or a function of k.

    density: log p(z | x) as a function of z[n, ...], x[n, ...] and k, for filters that weigh by it; none when left out.
    """

    function: NoisyFunction
    noise: Noise | Callable[[int], Noise]
    density: Density | None = None

    def __post_init__(self) -> None:
        if not callable(self.noise):
            instance("NonadditiveTransition.noise", self.noise, Law)

    def noise_at(self, k: int) -> Noise:
        """Law of w_k."""
        return self.noise(k) if callable(self.noise) else self.noise

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of x_k [n, R, ...] given x_{k-1} = x[n, R, ...]."""
        return self.function(x, self.noise_at(k).sample(rng, x.shape[1:]), k)

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of x_k = z[n, ...] given x_{k-1} = x[n, ...]; raises ValueError when none was given."""
        return _density(self.density)(z, x, k)

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference of two states [n, ...]."""
        return z - expected


@dataclass(frozen=True, eq=False)
class NonadditiveSensor:
    """y_k = function(x_k, v_k, k) with v_k from `noise`; `dim` components, those in `angles` in radians that wrap.

    density: log p(z | x) as a function of z[m, R], x[n, R, ...] and k, where NaN components of z drop out, for filters that
    weigh by the likelihood; none when left out.
    """

    function: NoisyFunction
    noise: Noise
    dim: int
    angles: tuple[int, ...] = ()
    density: Density | None = None

    def __post_init__(self) -> None:
        instance("NonadditiveSensor.noise", self.noise, Law)
        if not is_integer(self.dim) or self.dim < 1:
            raise ValueError(f"NonadditiveSensor.dim is {shown(self.dim)}, not a number of components: 1 or more")
        object.__setattr__(self, "angles", places("NonadditiveSensor.angles", self.angles, self.dim))

    def noise_at(self, k: int) -> Noise:
        """Law of v_k."""
        return self.noise

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of y_k [m, R, ...] given x_k = x[n, R, ...]."""
        y = self.function(x, self.noise.sample(rng, x.shape[1:]), k)
        for i in self.angles:
            y[i] = wrap(y[i])
        return y

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of y_k = z[m, R] given x_k = x[n, R, ...]: [R, ...]; raises ValueError when none was given."""
        return _density(self.density)(z, x, k)

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference z - expected [m, ...], its angular components wrapped to (-pi, pi]."""
        return difference(z, expected, self.angles)


@dataclass(frozen=True, eq=False)
class Augmented:
    """A law's function of state and noise, stacked s[n + q, ...]: what a Gaussian filter needs to know of it.

    The derivative is by dual numbers; n, the number of components of the state.
    """

    law: NonadditiveTransition | NonadditiveSensor
    n: int

    def mean(self, s: Array, k: int) -> Array:
        """The function's value at s."""
        return self.law.function(s[: self.n], s[self.n :], k)

    def linearised(self, s: Array, k: int) -> tuple[Array, Array]:
        """The function's value at s and its derivative [p, n + q, ...]."""
        return value_and_derivative(lambda stacked: self.mean(stacked, k), s)

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference of two values, angles wrapped."""
        return self.law.residual(z, expected)


def _density(given: Density | None) -> Density:
    if given is None:
        raise ValueError("a law whose noise is not additive has no density unless one is given")
    return given
