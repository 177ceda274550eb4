"""The Gaussian flow of Bunch and Godsill (2016): particles drawn from the transition move to where the measurement is likely.

In standard form a particle's state is x = Psi + B z with z ~ N(0, I), Psi its predicted state and B B' the process
covariance, which may be singular; its residual is e(z) = R^(-1/2) (y - h(x)). Pseudo-time l goes from 0, where only the
prior counts, to 1: the law at l is proportional to N(z; 0, I) exp(-l |e(z)|² / 2). In each step of pseudo-time a particle
takes the sensor for the linear one that touches it, and moves as that one's Gaussian laws do. Arrays are z[q, R, N] for R
runs of N particles; l[R, 1] is shared by a run's particles.

The weights are exact: the volume of a step includes the dependence of the tangent on the particle, and the diffusion is a
Metropolis-Hastings step. Both updates of the paper hold the tangent fixed, so its weights are exact for linear sensors only.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from suite import pointwise
from suite.linalg import Array, apply
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel, outage_patterns
from suite.proposal import Proposed, centred_noise
from suite.random import Generators
from suite.resampling import Indices

DISTANCE = 1e-4
"""Step of the central differences of the sensor's slope, in standard deviations of the process noise."""

BLOCK = 1024
"""Particles of all runs carried together: each brings hundreds of numbers along, so these are fewer than elsewhere."""

SHORTEST, LONGEST = 1e-8, 0.5  # lengths between which a pseudo-time step is sought


@dataclass(frozen=True)
class Standard:
    """One step of the runs of predicted[n, R, N] and y[m, R] in standard form, with the measurement components `rows`.

    spread[n, q] is the matrix B, whiten[len(rows), len(rows)] the inverse of a factor of the measurement noise's covariance.
    """

    sensor: AdditiveSensor
    k: int
    rows: tuple[int, ...]
    spread: Array
    whiten: Array
    predicted: Array
    y: Array

    def of(self, runs: Indices) -> "Standard":
        """The same for some of the runs."""
        return replace(self, predicted=self.predicted[:, runs], y=self.y[:, runs])

    def state(self, z: Array) -> Array:
        """The state x[n, R, N] at z[q, R, N]."""
        return self.predicted + apply(self.spread, z)

    def error(self, z: Array) -> Array:
        """The residual e[m, R, N] at z[q, R, N]."""
        error = self.sensor.residual(self.y[:, :, None], self.sensor.mean(self.state(z), self.k))
        return apply(self.whiten, error[list(self.rows)])

    def slope(self, x: Array) -> Array:
        """G = -de/dz [m, q, ...] at the states x[n, ...]."""
        slope = np.asarray(self.sensor.jacobian(x, self.k))[list(self.rows)]
        along = apply(self.spread.T, np.swapaxes(slope, 0, 1))
        return apply(self.whiten, np.swapaxes(along, 0, 1))

    def tangent(self, z: Array) -> "Tangent":
        """The linear sensor that touches the sensor at z[q, R, N]; NaN where that is not finite."""
        error, slope = self.error(z), self.slope(self.state(z))
        information = np.moveaxis(pointwise.dot(slope[:, :, None], slope[:, None]), (0, 1), (-2, -1)).copy()
        lost = ~np.isfinite(information).all((-1, -2))
        information[lost] = 0.0
        values, vectors = np.linalg.eigh(information)
        values[lost] = np.nan
        axes = np.ascontiguousarray(np.moveaxis(vectors, (-2, -1), (0, 1)))
        there = pointwise.transposed_times(axes, z)
        sharpness = np.maximum(np.ascontiguousarray(np.moveaxis(values, -1, 0)), 0.0)
        tilted = np.stack([pointwise.transposed_times(axes, row) for row in slope])
        pull = pointwise.transposed_times(tilted, error) + sharpness * there
        return Tangent(axes, there, sharpness, pull, error, tilted)

    def log_law(self, z: Array, at: "Tangent", time: Array) -> Array:
        """Log-density [R, N] at z of the law at pseudo-time `time`, but for a constant."""
        return np.asarray(-0.5 * (pointwise.dot(z, z) + time * pointwise.dot(at.error, at.error)))

    def log_volume(self, z: Array, at: "Tangent", start: Array, end: Array) -> Array:
        """log det dz1/dz [R, N] of `Tangent.flow` from z, the dependence of the tangent on z included.

        NaN where the determinant is negative: there the step folds space. The curvature of the sensor is from central
        differences of its slope; their relative error is about 1e-8 and none for a linear sensor.
        """
        q = len(z)
        shifts = DISTANCE * np.concat([np.eye(q), -np.eye(q)], axis=1)[:, :, None, None]
        ahead, behind = np.split(self.slope(self.state(z)[:, None] + apply(self.spread, shifts)), 2, axis=2)
        bend = (ahead - behind) / (2 * DISTANCE)  # [i, j, l]: derivative of G[i, j] with respect to z[l]
        own, cross = at.gains(start, end)
        jacobian = own[:, None] * at.turned(pointwise.dot(at.error[:, None, None], bend))
        jacobian[range(q), range(q)] += at.shrinkage(start, end)
        for b in range(q):
            inner = at.turned(pointwise.dot(at.slope[:, b, None, None], bend))
            jacobian[b] += pointwise.dot(cross[b][:, None], inner)
            jacobian += cross[:, b, None] * inner
        return np.asarray(np.log(pointwise.determinant(jacobian)))


@dataclass(frozen=True)
class Tangent:
    """The linear sensor e(z) ~ error - slope (z - there) in the principal axes of G'G.

    axes[q, q, R, N], columns are the axes; there[q, R, N], the point of contact; sharpness[q, R, N], the eigenvalues of
    G'G; pull[q, R, N] = G'(e + G z); error[m, R, N]; slope[m, q, R, N]. All but axes and error are in these axes.
    """

    axes: Array
    there: Array
    sharpness: Array
    pull: Array
    error: Array
    slope: Array

    def of(self, runs: Indices) -> "Tangent":
        """The same for some of the runs."""
        return Tangent(*(getattr(self, field.name)[..., runs, :] for field in fields(self)))

    def put(self, runs: Indices, other: "Tangent") -> None:
        """Set these runs to those of another, in place."""
        for field in fields(self):
            getattr(self, field.name)[..., runs, :] = getattr(other, field.name)

    def where(self, chosen: Array, other: "Tangent") -> "Tangent":
        """This tangent for the particles chosen [R, N], another's for the rest."""
        return Tangent(*(np.where(chosen, getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))

    def turned(self, matrix: Array) -> Array:
        """A matrix [q, q, R, N] seen from these axes, V' S V."""
        half = pointwise.dot(np.swapaxes(matrix, 0, 1)[:, :, None], self.axes[:, None])
        return pointwise.dot(self.axes[:, :, None], half[:, None])

    def mean(self, time: Array) -> Array:
        """Mean of the law at pseudo-time `time` under the linear sensor, l (I + l G'G)^-1 G'(e + G z)."""
        return time * self.pull / (1 + time * self.sharpness)

    def precision(self, time: Array) -> Array:
        """Inverse of the law's variance along each axis, 1 + l G'G."""
        return 1 + time * self.sharpness

    def shrinkage(self, start: Array, end: Array) -> Array:
        """Ratio of standard deviations at the pseudo-times `end` and `start` along each axis."""
        return np.asarray(np.sqrt(self.precision(start) / self.precision(end)))

    def flow(self, start: Array, end: Array) -> Array:
        """Where the flow without diffusion carries the point of contact (eq 12 with gamma = 0), in these axes.

        The root of the covariance is P^(1/2) = B (I + l G'G)^(-1/2): with it eq 12 is the integral of the drift in eq 11.
        """
        return self.mean(end) + self.shrinkage(start, end) * (self.there - self.mean(start))

    def drift(self, there: Array, time: Array) -> Array:
        """Velocity dz/dl of the flow without diffusion at the point `there`, in these axes (eq 11)."""
        precision = self.precision(time)
        return (self.pull / precision - 0.5 * self.sharpness * (there - self.mean(time))) / precision

    def mismatch(self, new: "Tangent", there: Array, time: Array) -> Array:
        """Half the difference of this drift and a new tangent's at the latter's point [R, N], in standard deviations.

        there[q, R, N]: the point in this tangent's axes. Times the length of the step it is the error of the step.
        """
        old = pointwise.transposed_times(new.axes, pointwise.times(self.axes, self.drift(there, time)))
        off = old - new.drift(new.there, time)
        return np.asarray(0.5 * np.sqrt(pointwise.dot(off * off, new.precision(time))))

    def gains(self, start: Array, end: Array) -> tuple[Array, Array]:
        """Derivatives of `flow`: [q, R, N] with respect to the pull, and [q, q, R, N] with respect to G'G and pull together.

        Divided differences of the functions of G'G (Daleckii and Krein, 1965), written without cancellation.
        """
        before, after, root = self.precision(start), self.precision(end), self.shrinkage(start, end)
        own = end / after - root * start / before
        off = self.there - self.mean(start)
        cross = np.empty((len(off), *off.shape))
        for a, row in enumerate(cross):
            row[:] = -(end - start) * off / (after[a] * after * (root[a] + root))
            row += own[a] * self.there - end / after[a] * self.mean(end) + root[a] * start / before[a] * self.mean(start)
        return own, cross

    def diffuse(self, noise: Array, end: Array, share: Array) -> Array:
        """A draw [q, R, N] that keeps the linear sensor's law at `end` and renews a share [R, 1] of its variance.

        noise[q, R, N]: standard normal numbers. The result is in the state's axes.
        """
        mean = self.mean(end)
        moved = mean + np.sqrt(1 - share) * (self.there - mean) + np.sqrt(share / self.precision(end)) * noise
        return pointwise.times(self.axes, moved)

    def log_diffused(self, z: Array, end: Array, share: Array) -> Array:
        """Log-density [R, N] of `diffuse` at z[q, R, N], but for a constant."""
        mean, precision = self.mean(end), self.precision(end)
        off = pointwise.transposed_times(self.axes, z) - mean - np.sqrt(1 - share) * (self.there - mean)
        return np.asarray(0.5 * sum(np.log(precision) - off * off * precision / share))


@dataclass(frozen=True)
class Control:
    """How the flow is cut into pseudo-time steps, and its diffusion `gamma`.

    A run's step is taken when its error is at most `tolerance` for every particle, in standard deviations of the law there,
    or when it is so short that with shorter ones the end would not be reached in `steps` tries. One that folds space at some
    particle is never taken: several points would land on one, which the weights do not know. After a fold the flow may stop
    short of the end when the tries run out; the weights hold wherever it stops.
    `first`: length of the first try.
    """

    gamma: float
    tolerance: float
    first: float
    steps: int

    def next(self, length: Array, error: Array) -> Array:
        """Length of the next try [R] after a step of some length and error, by the rule of the authors' program."""
        return np.asarray(np.fmin(LONGEST, length * np.fmin(10.0, 0.8 * (self.tolerance / error) ** 0.7)))


def propose(model: StateSpaceModel, x: Array, y: Array, k: int, rng: Generators, control: Control) -> Proposed:
    """Draws [n, R, N] from the transition of x[n, R, N], carried by the flow; their fit [R, N] is the log of the weight.

    The weight is p(y | x1) N(z1; 0, I) / N(z0; 0, I) times the volume of each step, over the change of the law there by
    its diffusion. A particle whose path leaves the numbers has weight zero.
    """
    dynamics, sensor = model.dynamics, model.sensor
    assert isinstance(dynamics, AdditiveTransition)
    assert isinstance(sensor, AdditiveSensor)
    noise, measured = centred_noise(dynamics, k), centred_noise(sensor, k)
    spread = noise.lower if dynamics.gain is None else dynamics.gain @ noise.lower
    predicted = dynamics.mean(x, k)
    z = rng.standard_normal((spread.shape[1], *x.shape[1:]))
    fit = 0.5 * pointwise.dot(z, z)
    for rows, runs in outage_patterns(y):
        if rows:
            whiten = np.asarray(np.linalg.inv(measured.marginal(rows).lower), float)
            step = Standard(sensor, k, rows, spread, whiten, predicted[:, runs], y[:, runs])
            z[:, runs], gained = _carried(step, z[:, runs], rng.of(runs), control)
            fit[runs] += gained
    drawn = predicted + apply(spread, z)
    fit += sensor.logpdf(y, drawn, k) - 0.5 * pointwise.dot(z, z)
    sound = np.isfinite(fit) & np.isfinite(drawn).all(0)
    return np.where(sound, drawn, predicted), np.where(sound, fit, -np.inf), np.zeros(fit.shape)


def _carried(step: Standard, z: Array, rng: Generators, control: Control) -> tuple[Array, Array]:
    """Where the flow carries z[q, R, N] from pseudo-time 0 to 1, and what the log-weights gain on the way [R, N]."""
    z, gained, at = z.copy(), np.zeros(z.shape[1:]), step.tangent(z)
    time, length = np.zeros(len(gained)), np.full(len(gained), control.first)
    hurried = np.ones(len(gained), bool)  # until a step folds, the end is to be reached
    for left in range(control.steps, 0, -1):
        live = np.flatnonzero(time < 1)
        if not len(live):
            break
        start, old, here = time[live, None], at.of(live), step.of(live)
        shortest = np.where(hurried[live, None], np.maximum(start ** (1 - 1 / left), SHORTEST), start + SHORTEST)
        end = np.clip(start + length[live, None], shortest, 1.0)
        there = old.flow(start, end)
        moved = pointwise.times(old.axes, there)
        new = here.tangent(moved)
        tried = (end - start)[:, 0]
        error = tried * np.fmax.reduce(old.mismatch(new, there, end), axis=1)
        length[live] = control.next(tried, error)
        forced = (end <= shortest)[:, 0]
        taken = np.flatnonzero(~(error > control.tolerance) | forced)
        if not len(taken):
            continue
        volume = here.of(taken).log_volume(z[:, live[taken]], old.of(taken), start[taken], end[taken])
        folded = (~np.isfinite(volume) & np.isfinite(moved[0, taken])).any(1)
        length[live[taken[folded]]], hurried[live[taken[folded]]] = 0.5 * tried[taken[folded]], False
        taken, volume = taken[~folded], volume[~folded]
        runs, new, moved = live[taken], new.of(taken), moved[:, taken]
        gained[runs] += volume
        if control.gamma and len(runs):
            share = -np.expm1(control.gamma * (start - end)[taken])
            moved, new, change = _diffused(here.of(taken), new, moved, end[taken], share, rng.of(runs))
            gained[runs] += change
        z[:, runs], time[runs] = moved, end[taken, 0]
        at.put(runs, new)
    return z, gained


def _diffused(
    step: Standard, at: Tangent, z: Array, time: Array, share: Array, rng: Generators
) -> tuple[Array, Tangent, Array]:
    """A Metropolis-Hastings step with the diffusion as its proposal: points, their tangents, what the weights gain.

    It leaves the law at `time` as it is, so it changes no weight of that law; the weights here leave the law out.
    """
    candidate = at.diffuse(rng.standard_normal(z.shape), time, share)
    there = step.tangent(candidate)
    change = step.log_law(candidate, there, time) - step.log_law(z, at, time)
    ratio = change + there.log_diffused(z, time, share) - at.log_diffused(candidate, time, share)
    accepted = np.log(rng.random((1, *ratio.shape))[0]) < ratio
    return np.where(accepted, candidate, z), there.where(accepted, at), np.where(accepted, -change, 0.0)
