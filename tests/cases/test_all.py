"""What holds for every case: measurements and motion scatter about their models as these say."""

import numpy as np
import pytest

from cases import CASES
from suite.case import FROM_MODEL, RECORDED
from suite.model import AdditiveSensor, AdditiveTransition

DRAWS = 2000
"""Steps of all runs together, at least."""
NAMES = [name for name, case in CASES.items() if case.origin != RECORDED]


def truth_of(name):
    case = CASES[name]
    truth = case.simulate(max(2, -(-DRAWS // case.steps)), seed=5)
    modes = getattr(case.model, "modes", (case.model,))
    mode = np.zeros(truth.x[:, 0].shape, int) if truth.mode is None else truth.mode
    return case, truth, modes, mode


def standard(deviations):
    """Whether deviations [d, count] over their standard deviations have mean 0 and mean square 1, each within six sigma.

    The chance of a false alarm is 2e-9 for each of some 600 such tests.
    """
    for z in deviations:
        z = z[np.isfinite(z)]
        for sample, expected in ((z, 0.0), (z**2, 1.0)):
            assert abs(sample.mean() - expected) < 6 * sample.std() / np.sqrt(len(sample)) + 1e-12


@pytest.mark.parametrize("name", NAMES)
def test_measurements_scatter_about_the_sensor_as_its_noise_says(name):
    case, truth, modes, mode = truth_of(name)
    if not all(isinstance(each.sensor, AdditiveSensor) for each in modes):
        pytest.skip("its noise is inside the sensor")
    found = []
    for k in range(case.steps):
        for j, model in enumerate(modes):
            at, noise = mode[k] == j, model.sensor.noise_at(k + 1)
            x, y = truth.x[k][:, at], truth.y[k][:, at]
            off = model.sensor.residual(y, model.sensor.mean(x, k + 1)) - noise.mean[:, None]
            found.append(off / np.sqrt(np.diag(noise.cov))[:, None])
    standard(np.concatenate(found, axis=1))


@pytest.mark.parametrize("name", [name for name in NAMES if CASES[name].origin == FROM_MODEL])
def test_states_scatter_about_the_motion_as_its_noise_says(name):
    """Components without noise follow the motion to rounding."""
    case, truth, modes, mode = truth_of(name)
    if not all(isinstance(each.dynamics, AdditiveTransition) for each in modes):
        pytest.skip("its noise is inside the motion")
    found = []
    for k in range(1, case.steps):
        for j, model in enumerate(modes):
            at, motion = mode[k] == j, model.dynamics
            off = truth.x[k][:, at] - motion.mean(truth.x[k - 1][:, at], k + 1) - motion.noise_mean(k + 1)[:, None]
            sd = np.sqrt(np.diag(motion.noise_cov(k + 1)))
            still = sd == 0
            np.testing.assert_allclose(off[still], 0.0, atol=1e-9 * np.abs(truth.x[k]).max(initial=1.0))
            found.append(np.where(still[:, None], np.nan, off / np.where(still, 1.0, sd)[:, None]))
    together = np.concatenate(found, axis=1)
    standard([row for row in together if np.isfinite(row).any()])


@pytest.mark.parametrize("name", [name for name in CASES if name not in NAMES])
def test_recordings_are_the_same_in_every_run(name):
    case = CASES[name]
    first, other = case.simulate(1, seed=1), case.simulate(2, seed=9, first=4)
    for part in ("x", "y"):
        np.testing.assert_array_equal(getattr(other, part)[..., 1], getattr(first, part)[..., 0])
