"""Cramér-Rao bounds on the covariance of any estimate of the state, by Monte Carlo over simulated trajectories.

The posterior bound is Tichavský's recursion (Tichavský, Muravchik and Nehorai, 1998), written for a factor of the bound
itself instead of its inverse. With F the slope of the transition, Fm = E[F], Q the inverse of the process noise's Fisher
information and A = E[(F - Fm)ᵀ Q⁻¹ (F - Fm)], the bound P goes on as
    P⁻ = Q + Fm (P⁻¹ + A)⁻¹ Fmᵀ,   P = ((P⁻)⁻¹ + E[Hᵀ I H])⁻¹,
where (P⁻¹ + A)⁻¹ = L (1 + Lᵀ A L)⁻¹ Lᵀ for P = L Lᵀ. Neither P nor Q is inverted: a prior that is a point, or a process
noise of lower rank than the state, is no special case as long as slopes differ only along directions that the noise reaches.

Of a measurement, I is the Fisher information of the noise of those components that were observed in a run: information is
averaged over runs with their outages. A bound holds for truths drawn from the model; where they are not, filters may fall
below it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from suite import fisher
from suite.fisher import by_mode, dynamics, measured, process_factor, whitening
from suite.jump import JumpModel, Model, Modes, chosen, evolved, started
from suite.linalg import Array, cholesky, lower_triangular, solve_lower, square_root
from suite.model import StateSpaceModel
from suite.random import Generators

POSTERIOR = "posterior"
CONDITIONAL = "conditional on the trajectory"
KNOWN_MODES = "known modes"
BEST_FIT = "best-fitting Gaussian"
NONE = "none"
GROUPS = 32
"""Groups of the jackknife."""
OUTSIDE = "slopes of the transition differ where its noise does not reach: conditional on each trajectory, no strict bound"
ALONE = "a sequence of modes has a single trajectory: conditional on it, no strict bound"


@dataclass(frozen=True)
class Trajectories:
    """States x[T + 1, n, R] from x_0 on, and the modes [T + 1, R] in force from r_0 on, zeros where there is but one.

    copies: so many runs on end share one draw of modes. The kinds `POSTERIOR` and `BEST_FIT` take expectations at single
    times only: for them x_0 may be of other runs.
    """

    x: Array
    mode: Modes
    copies: int = 1


@dataclass(frozen=True)
class Bound:
    """A bound cov[T, n, n] on the error covariance at steps 1..T, its kind, and in `reason` what there is to say of it.

    left_out[G, T, n]: its diagonal without each of G groups of trajectories, from which follows the Monte Carlo error of
    whatever is computed from it. Without a bound, kind `NONE`, all numbers are NaN and the reason says why.
    """

    cov: Array
    left_out: Array
    kind: str
    reason: str = ""

    @property
    def error(self) -> Array:
        """Standard error [T, n] of the diagonal of the bound; NaN when there are no two groups."""
        return _jackknife(self.left_out)

    def rmse(self, components: Iterable[int]) -> tuple[Array, Array]:
        """Bound on the root mean square error of a block of the state [T], in its unit, and its standard error [T]."""
        at = list(components)
        variance = np.diagonal(self.cov, axis1=1, axis2=2)[:, at].sum(1)
        return np.sqrt(variance), _jackknife(np.sqrt(self.left_out[:, :, at].sum(2)))


def trajectories(model: Model, steps: int, rng: Generators, copies: int = 1) -> Trajectories:
    """Trajectories drawn from the model, `copies` for each run of the generators; copies share the run's modes."""
    modes, shape = _modes(model), (rng.runs, copies)
    mode = started(model, rng, (rng.runs,)) if isinstance(model, JumpModel) else np.zeros(rng.runs, np.intp)
    x = chosen(mode[:, None], [each.prior.sample(rng, shape) for each in modes])
    states, found = [x], [mode]
    for k in range(1, steps + 1):
        mode = evolved(model, mode, rng) if isinstance(model, JumpModel) else mode
        x = chosen(mode[:, None], [each.dynamics.sample(rng, x, k) for each in modes])
        states.append(x)
        found.append(mode)
    flat = np.stack(states).reshape(steps + 1, model.n, -1)
    return Trajectories(flat, np.repeat(np.stack(found), copies, axis=1), copies)


def bound(model: Model, drawn: Trajectories, y: Array | None = None) -> Bound:
    """The Cramér-Rao bound of a model, given trajectories drawn from it; of y[T, m, R] only counts what is missing (NaN).

    One mode: the posterior bound. Where its expectation A is infinite, the covariance of the Kalman filter linearised at each
    true trajectory is averaged instead (`CONDITIONAL`): that is larger, and no strict bound.

    Several modes: the posterior bound given the sequence of modes, averaged over sequences (`KNOWN_MODES`). It is a bound, but
    optimistic: no estimator is told the modes. Expectations are over the trajectories of one sequence; from few of them the
    result is too high, unless slopes are constant, and from one each it is conditional on the trajectory too.
    """
    modes = _modes(model)
    drawn, y, said = _sound(modes, drawn, y)
    if not drawn.x.size:
        return _none(drawn, *said)
    several = isinstance(model, JumpModel)
    try:
        if not several:
            return _pooled(_Slopes(modes, drawn, _all(drawn)), y, POSTERIOR, *said)
        sequences = _apart(np.unique(drawn.mode, axis=1, return_inverse=True)[1])
        alone = np.diff(sequences.weights.indptr).min() == 1 and not all(fisher.constant(mode) for mode in modes)
        return _averaged(_Slopes(modes, drawn, sequences), y, KNOWN_MODES, *([ALONE] if alone else []), *said)
    except _Outside:
        each = _apart(np.arange(drawn.x.shape[2]))
        return _averaged(_Slopes(modes, drawn, each), y, KNOWN_MODES if several else CONDITIONAL, OUTSIDE, *said)


def best_fitting_gaussian(model: JumpModel, drawn: Trajectories, y: Array | None = None) -> Bound:
    """The posterior bound of the linear Gaussian motion that fits a jump-Markov model best: a prediction, no bound.

    At each step the motion has the mean slope Φ of the modes, and a noise that gives the state the covariance that the modes
    give it together, as if r_k did not depend on x_{k-1} (Hernandez, Ristic, Farina, Sathyan and Kirubarajan, 2005): with
    e = f_j(x) + mean of the noise - Φ x, that noise has the covariance Σ p_j Q_j + Cov(e), over modes and trajectories.
    """
    drawn, y, said = _sound(model.modes, drawn, y)
    if not drawn.x.size:
        return _none(drawn, *said)
    chance = np.stack([model.initial @ np.linalg.matrix_power(model.transition, k) for k in range(len(drawn.x))])
    return _pooled(_Fitted(model.modes, chance, drawn, _all(drawn)), y, BEST_FIT, *said)


class _Outside(Exception):
    """Slopes differ along directions that the process noise does not reach."""


@dataclass(frozen=True)
class _Average:
    """Means over runs: each row of weights[B, R] sums to one; centre[R]: the row whose mean a run's deviations are from."""

    weights: sparse.csr_array
    centre: NDArray[np.intp]

    def __call__(self, values: Array) -> Array:
        """The means [B, ...] of values[..., R]."""
        return np.asarray(self.weights @ values.reshape(-1, values.shape[-1]).T).reshape(-1, *values.shape[:-1])

    def deviations(self, values: Array) -> Array:
        """Values [..., R] less the means that they are held against."""
        return values - np.moveaxis(self(values)[self.centre], 0, -1)


def _all(drawn: Trajectories) -> _Average:
    """All runs together, with and without each group."""
    return _Average(sparse.csr_array(_weightings(drawn)), np.zeros(drawn.x.shape[2], np.intp))


def _apart(group: NDArray[np.intp]) -> _Average:
    """The runs of each group [R], numbered from 0."""
    counts = np.bincount(group)
    return _Average(sparse.csr_array((1 / counts[group], (group, np.arange(len(group))))), group)


def _weightings(drawn: Trajectories) -> Array:
    """Weights [1 + G, R] of all runs, then of all without one of G groups; no group where there is a single draw."""
    draws = drawn.x.shape[2] // drawn.copies
    groups = min(GROUPS, draws) if draws > 1 else 0
    group = np.repeat(np.arange(draws) * groups // draws, drawn.copies)
    rows = np.where(group == np.arange(-1, groups)[:, None], 0.0, 1.0)
    return np.asarray(rows / rows.sum(1, keepdims=True))


@dataclass(frozen=True)
class _Slopes:
    """The recursion's terms from the slopes of the mode in force; the runs of a row of the average share their modes."""

    modes: tuple[StateSpaceModel, ...]
    drawn: Trajectories
    average: _Average

    def _of_rows(self, stack: list[Array], k: int) -> Array:
        """Of matrices, one a mode, those of the rows' modes at step k [B, ...]."""
        weights = self.average.weights
        return np.asarray(np.stack(stack)[self.drawn.mode[k, weights.indices[weights.indptr[:-1]]]])

    def prior(self) -> Array:
        """Factors [B, n, n] of the covariance of x_0."""
        return self._of_rows([mode.prior.lower for mode in self.modes], 0)

    def motion(self, k: int) -> tuple[Array, Array, Array]:
        """Mean slopes Fm, their spread A, and factors of Q, [B, n, n] each. Raises `_Outside` where A would be infinite."""
        x, average = self.drawn.x[k - 1], self.average
        slope = np.empty((len(x), *x.shape))
        for j, at in by_mode(self.drawn.mode[k]):
            slope[:, :, at] = dynamics(self.modes[j]).jacobian(x[:, at], k)
        roots = [process_factor(mode, k) for mode in self.modes]
        white, deviations = np.empty_like(slope), average.deviations(slope)
        for j, at in by_mode(self.drawn.mode[k]):
            inside, across = whitening(roots[j])
            rounding = 1e-9 * np.abs(across) @ np.abs(slope[:, :, at]).max(-1)
            if (np.abs(np.tensordot(across, deviations[:, :, at], 1)).max(-1) > rounding).any():
                raise _Outside
            white[:, :, at] = np.tensordot(inside, deviations[:, :, at], 1)
        mean = average(white)
        spread = average(np.einsum("pir,pjr->ijr", white, white)) - np.swapaxes(mean, 1, 2) @ mean
        return average(slope), spread, self._of_rows(roots, k)


@dataclass(frozen=True)
class _Fitted:
    """The recursion's terms from the Gaussian that fits all modes together; chance[T + 1, M] is the law of r_k."""

    modes: tuple[StateSpaceModel, ...]
    chance: Array
    drawn: Trajectories
    average: _Average

    def prior(self) -> Array:
        """Factor [1, n, n] of the covariance of x_0."""
        mean = np.stack([mode.prior.mean for mode in self.modes])
        off = mean - self.chance[0] @ mean
        covs = np.stack([mode.prior.cov for mode in self.modes]) + off[:, :, None] * off[:, None]
        return square_root(np.tensordot(self.chance[0], covs, 1)[None])

    def motion(self, k: int) -> tuple[Array, Array, Array]:
        """Mean slopes Φ, no spread, and factors of the fitted noise's covariance, [B, n, n] each."""
        x, chance, laws = self.drawn.x[k - 1], self.chance[k], [dynamics(mode) for mode in self.modes]
        values, slopes = (np.stack(part) for part in zip(*(law.linearised(x, k) for law in laws), strict=True))
        slope = self.average(np.tensordot(chance, slopes, 1))
        e = values + np.stack([law.noise_mean(k) for law in laws])[..., None] - slope[0] @ x
        e -= np.tensordot(chance, e.mean(-1), 1)[:, None]
        second = self.average(np.einsum("j,jar,jbr->abr", chance, e, e))
        noise = np.tensordot(chance, np.stack([law.noise_cov(k) for law in laws]), 1)
        return slope, np.zeros_like(slope), square_root(noise + second)


def _recursion(terms: _Slopes | _Fitted, y: Array | None) -> Array:
    """The bounds [T, B, n, n] of the rows of the average."""
    found, drawn = [], terms.drawn
    with np.errstate(all="ignore"):  # what goes wrong is seen by its numbers
        root = terms.prior()
        for k in range(1, len(drawn.x)):
            slope, spread, noise = terms.motion(k)
            root = lower_triangular(np.concat([slope @ _informed(root, spread), noise], axis=2))
            seen = measured(terms.modes, drawn.mode[k], drawn.x[k], None if y is None else y[k - 1], k)
            root = _informed(root, terms.average(seen))
            found.append(root @ np.swapaxes(root, 1, 2))
    return np.stack(found)


def _informed(root: Array, more: Array) -> Array:
    """Factors [B, n, n] of (P⁻¹ + A)⁻¹ = L (1 + Lᵀ A L)⁻¹ Lᵀ from those of P = L Lᵀ, singular or not."""
    across = np.swapaxes(root, 1, 2)
    inner = cholesky(np.eye(root.shape[1]) + across @ more @ root)
    return np.swapaxes(solve_lower(inner, np.broadcast_to(across, inner.shape)), 1, 2)


def _pooled(terms: _Slopes | _Fitted, y: Array | None, kind: str, *said: str) -> Bound:
    """The bound of all runs."""
    found = _recursion(terms, y)
    return Bound(found[:, 0], np.diagonal(found[:, 1:], axis1=2, axis2=3).swapaxes(0, 1), kind, "; ".join(said))


def _averaged(terms: _Slopes, y: Array | None, kind: str, *said: str) -> Bound:
    """The mean over runs of the bounds of their rows."""
    found = _recursion(terms, y)
    share = np.stack([np.bincount(terms.average.centre, weights) for weights in _weightings(terms.drawn)]).astype(float)
    left_out = np.tensordot(share[1:], np.diagonal(found, axis1=2, axis2=3), (1, 1))
    return Bound(np.tensordot(share[0], found, (0, 1)), left_out, kind, "; ".join(said))


def _none(drawn: Trajectories, *said: str) -> Bound:
    steps, n = len(drawn.x) - 1, drawn.x.shape[1]
    return Bound(np.full((steps, n, n), np.nan), np.full((0, steps, n), np.nan), NONE, "; ".join(said))


def _sound(
    modes: Sequence[StateSpaceModel], drawn: Trajectories, y: Array | None
) -> tuple[Trajectories, Array | None, list[str]]:
    """The finite trajectories, none where the model has no bound, and why the others are left out."""
    said = [reason for mode in modes if (reason := fisher.refusal(mode, len(drawn.x) - 1))][:1]
    finite = np.isfinite(drawn.x).all((0, 1)).reshape(-1, drawn.copies).all(1)
    sound = np.repeat(finite & (not said), drawn.copies)
    if not (said or sound.all()):
        said = [f"{np.sum(~sound)} of {sound.size} trajectories are not finite and left out"]
    kept = Trajectories(drawn.x[:, :, sound], drawn.mode[:, sound], drawn.copies)
    return kept, None if y is None else y[:, :, sound], said


def _modes(model: Model) -> tuple[StateSpaceModel, ...]:
    return model.modes if isinstance(model, JumpModel) else (model,)


def _jackknife(left_out: Array) -> Array:
    """Standard error [...] of a figure, from its values [G, ...] without each of the groups."""
    groups = len(left_out)
    if groups < 2:
        return np.full(left_out.shape[1:], np.nan)
    return np.asarray(np.sqrt((groups - 1) / groups * ((left_out - left_out.mean(0)) ** 2).sum(0)))
