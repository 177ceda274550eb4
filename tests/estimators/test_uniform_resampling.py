"""The filter with uniform resampling: what it keeps, its box, and its estimates against a grid filter that does the same."""

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.bootstrap import Bootstrap
from estimators.sir import SequentialImportanceResampling
from estimators.uniform_resampling import UniformResampling
from suite import particles
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from tests.estimators.references import on_a_grid, repeated, scores
from tests.oracles import generators

BOXES = pytest.mark.parametrize("box", ["kept", "survivors", "deviations"])


@BOXES
@pytest.mark.parametrize("case", list(CASES))
def test_with_nothing_drawn_anew_it_is_the_filter_it_starts_from(case, box):
    model, y = CASES[case].model, CASES[case].simulate(6).y[:15]
    for threshold, other in ((1.0, Bootstrap(80)), (0.5, SequentialImportanceResampling(80, threshold=0.5))):
        mine = UniformResampling(80, fraction=1.0, box=box, threshold=threshold, resampling="systematic").run(model, y, 1)
        theirs = other.run(model, y, 1)
        for part in ("mean", "cov", "loglik", "ess", "ancestors"):
            a, b = getattr(mine, part), getattr(theirs, part)
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


@BOXES
def test_the_rest_is_drawn_evenly_over_the_box(box):
    # 2 runs x 2 components x 2000 even draws; Kolmogorov and Smirnov's test with a false alarm of 1e-6 each.
    rng, count = generators(2, "box"), 8000
    x = rng.standard_normal((2, 2, count)) * np.array([1.0, 30.0])[:, None, None] + 7
    belief = particles.weighted(x, -np.abs(x[0] - 8), particles.all_of(2, count))
    estimator = UniformResampling(count, fraction=0.75, box=box)
    assert estimator.keep == 6000
    start = particles.resample(belief, estimator.survivors, 1.0, rng)
    filled = estimator.filled(belief, start, rng)
    for r in range(2):
        kept = np.argsort(-belief.weights[r])[:6000]
        survivors = start.parents[r, :6000]
        assert set(survivors) <= set(kept)
        np.testing.assert_array_equal(filled[:, r, :6000], x[:, r, survivors])
        share = belief.weights[r, kept] / belief.weights[r, kept].sum()
        for i in range(2):
            inside = x[i, r, survivors if box == "survivors" else kept]
            low, high = inside.min(), inside.max()
            if box == "deviations":
                mean = inside @ share
                half = np.sqrt(3 * share @ (inside - mean) ** 2)
                low, high = mean - half, mean + half
            fresh = filled[i, r, 6000:]
            assert low <= fresh.min() < fresh.max() <= high
            assert stats.kstest(fresh, stats.uniform(low, high - low).cdf).pvalue > 1e-6


WALK = StateSpaceModel(
    Gaussian([1.0], [[2.0]]),
    AdditiveTransition(Affine([[0.9]]), Gaussian.noise([[1.0]])),
    AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[2.0]])),
)
FRACTION = 0.7


def mixed(grid, box):
    """What many particles become: the likeliest share of the predicted law, weighted, and an even law over its box."""
    step = grid[1] - grid[0]

    def between(predicted, likelihood, posterior):
        order = np.argsort(-likelihood[:, 0])
        kept = np.zeros(len(grid))
        kept[order] = np.clip(FRACTION / step - np.cumsum(predicted[order, 0]) + predicted[order, 0], 0, predicted[order, 0])
        inside = np.flatnonzero(kept)
        density = kept * likelihood[:, 0]
        density /= density.sum() * step
        low, high = grid[inside[0]] - step / 2, grid[inside[-1]] + step / 2
        if box == "deviations":
            mean = grid @ density * step
            half = np.sqrt(3 * ((grid - mean) ** 2 @ density) * step)
            low, high = mean - half, mean + half
        even = np.clip((grid + step / 2 - low) / step, 0, 1) - np.clip((grid - step / 2 - high) / step + 1, 0, 1)
        return (FRACTION * density + (1 - FRACTION) * np.maximum(even, 0) / (high - low))[:, None]

    return between


@BOXES
def test_estimates_are_those_of_a_grid_filter_that_does_the_same(box):
    # Means over 60 runs of 2000 particles, whose bias of order 1/N, and the grid's edges known to half a cell of 0.01, are
    # below the standard error. 4 steps x 3 figures in three tests: 7 standard errors of Student's t with 59 degrees of
    # freedom are passed with probability below 1e-6.
    y = np.array([1.2, 0.6, 1.0, 0.4])[:, None, None]  # as predicted: both ends of the box lie among many particles
    grid = np.linspace(-11, 13, 2401)
    exact = on_a_grid(grid, WALK, y, mixed(grid, box))
    estimate = UniformResampling(2000, fraction=FRACTION, box=box).run(WALK, repeated(y, 60), 3)
    for found, expected in zip((estimate.mean[:, 0], estimate.cov[:, 0, 0], estimate.loglik), exact, strict=True):
        worst = np.abs(scores(found, expected[:, 0])).max()
        assert worst < 7
    # It is another law than the posterior, by far.
    right = on_a_grid(grid, WALK, y)
    worst = np.abs(scores(estimate.cov[:, 0, 0], right[1][:, 0])).max()
    assert worst > 20


@pytest.mark.parametrize("box", ["kept", "survivors", "deviations"])
@pytest.mark.parametrize("dead", [1e6, np.nan])
def test_particles_of_weight_zero_are_not_in_the_box(box, dead):
    """Where fewer have any weight than are to be kept, the others do not count."""
    x = np.full((1, 1, 100), dead)
    x[0, 0, :30] = np.linspace(-1, 1, 30)
    logw = np.full((1, 100), -np.inf)
    logw[0, :30] = 0.0
    filled = UniformResampling(particles=100, box=box)
    belief = particles.weighted(x, logw, particles.all_of(1, 100))
    drawn = filled.filled(
        belief, particles.resample(belief, filled.survivors, 1.0, generators(1, "box")), generators(1, "even")
    )
    assert (np.abs(drawn) <= 1.2).all()
