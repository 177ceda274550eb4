"""The IMM's CUSUM, by hand."""

import numpy as np

from cases import CASES
from estimators.imm import InteractingExtended
from estimators.imm_cusum import InteractingCusum
from suite.random import Streams

CASE = CASES["jump-linear"]


def test_the_statistic_is_the_scalar_recursion_on_densities_of_the_innovations():
    y = CASE.simulate(3, seed=5).y.copy()
    y[6, :, 1] = np.nan
    model, rng = CASE.model, Streams((1,)).batch(0, 3)
    belief, sums, highest = InteractingCusum().init(model, rng), [0.0, 0.0, 0.0], 0.0
    for k, z in enumerate(y, start=1):
        before, belief = belief, InteractingCusum().step(model, belief, z, k, rng)
        for r in range(3):
            p = np.exp(before.filtered.logp[:, r])
            density = np.empty(2)
            for j, mode in enumerate(model.modes):
                mixing = model.transition[:, j] * p / (model.transition[:, j] @ p)
                mean = mixing @ before.filtered.mean[:, r]
                cov = sum(
                    w * (root @ root.T + np.outer(m - mean, m - mean))
                    for w, m, root in zip(mixing, before.filtered.mean[:, r], before.filtered.root[:, r], strict=True)
                )
                F, Q = mode.dynamics.mean.matrix(k), mode.dynamics.noise_cov(k)
                expected, variance = (F @ mean)[0], (F @ cov @ F.T + Q)[0, 0] + mode.sensor.noise.cov[0, 0]
                density[j] = np.exp(-0.5 * (z[0, r] - expected) ** 2 / variance) / np.sqrt(2 * np.pi * variance)
            if np.isfinite(z[0, r]):
                sums[r] = max(0.0, sums[r] + np.log(density[1] / density[0]))
        np.testing.assert_allclose(belief.total, sums, rtol=1e-8, atol=1e-8)
        highest = max(highest, *sums)
    assert highest > 1
    assert min(sums) < highest


def test_all_else_is_the_filters():
    y = CASE.simulate(4, seed=6).y
    with_sum, plain = InteractingCusum().run(CASE.model, y), InteractingExtended().run(CASE.model, y)
    for name in ("mean", "cov", "mode", "loglik"):
        np.testing.assert_array_equal(getattr(with_sum, name), getattr(plain, name))
    assert (with_sum.statistic >= 0).all()
    assert (with_sum.statistic != plain.statistic).any()
