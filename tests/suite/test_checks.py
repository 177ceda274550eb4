"""Bad input to models: each gives one line that names the field; what is merely written otherwise is taken."""

import numpy as np
import pytest

from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition

H = np.array([[1.0, 0.0], [0.5, -1.0], [0.0, 2.0]])
ONE, TWO, THREE = (Gaussian.noise(np.eye(d)) for d in (1, 2, 3))
PRIOR, STILL = TWO, Affine(np.eye(2))
MOTION, SENSOR = AdditiveTransition(STILL, TWO), AdditiveSensor(Affine(H), THREE)


def bend(x, noise, k):
    return x * np.exp(noise[0]) if k else x


@pytest.mark.parametrize(
    ("dynamics", "sensor", "words"),
    [
        (AdditiveTransition(Affine(H), TWO), SENSOR, r"AdditiveTransition\.mean maps a state of shape \(2, 1\) to \(3, 1\)"),
        (
            AdditiveTransition(STILL, THREE),
            SENSOR,
            r"AdditiveTransition\.noise has 3 components without a gain, the state has 2",
        ),
        (AdditiveTransition(STILL, ONE), SENSOR, r"AdditiveTransition\.noise has 1 components without a gain, the state has 2"),
        (
            AdditiveTransition(lambda x, k: x[0], TWO),
            SENSOR,
            r"AdditiveTransition\.mean maps a state of shape \(2, 1\) to \(1,\)",
        ),
        (
            AdditiveTransition(STILL, TWO, H),
            SENSOR,
            r"AdditiveTransition\.gain has shape \(3, 2\), 2 state and 2 noise .* \(2, 2\)",
        ),
        (AdditiveTransition(STILL, ONE, np.eye(2)), SENSOR, r"AdditiveTransition\.gain has shape \(2, 2\), .* need \(2, 1\)"),
        (
            AdditiveTransition(STILL, lambda k: ONE, H[:2]),
            SENSOR,
            r"AdditiveTransition\.gain has shape \(2, 2\), .* need \(2, 1\)",
        ),
        (AdditiveTransition(STILL, lambda k: np.eye(2)), SENSOR, r"AdditiveTransition\.noise is of type ndarray, not a Law"),
        (AdditiveTransition(lambda x: x, TWO), SENSOR, r"AdditiveTransition\.mean fails at the prior mean: TypeError: "),
        (
            MOTION,
            AdditiveSensor(Affine(H), TWO),
            r"AdditiveSensor\.mean maps a state of shape \(2, 1\) to \(3, 1\), not \(2, 1\)",
        ),
        (
            MOTION,
            AdditiveSensor(lambda x, k: x[0] + x[1], ONE),
            r"AdditiveSensor\.mean maps a state of shape \(2, 1\) to \(1,\)",
        ),
        (
            MOTION,
            AdditiveSensor(Affine(np.eye(3)), THREE),
            r"AdditiveSensor\.mean fails at the prior mean: .*\(3, 3\) does not fit",
        ),
        (MOTION, AdditiveSensor(lambda x, k: x[2:], ONE), r"AdditiveSensor\.mean maps a state of shape \(2, 1\) to \(0, 1\)"),
        (
            NonadditiveTransition(lambda x, w, k: x[:1] * w, ONE),
            SENSOR,
            r"NonadditiveTransition\.function maps .* not \(2, 1\)",
        ),
        (
            NonadditiveTransition(lambda x, w, k: x + w, THREE),
            SENSOR,
            r"NonadditiveTransition\.function fails at the prior mean: ",
        ),
        (NonadditiveTransition(lambda x, w, k: x, lambda k: 1.0), SENSOR, r"NonadditiveTransition\.noise is of type float"),
        (
            MOTION,
            NonadditiveSensor(lambda x, v, k: x * v, ONE, dim=1),
            r"NonadditiveSensor\.function maps a state of shape \(2, 1\) and a noise of shape \(1, 1\) to \(2, 1\), not",
        ),
        (
            MOTION,
            NonadditiveSensor(lambda x, v, k: x + v, THREE, dim=2),
            r"NonadditiveSensor\.function fails at the prior mean: ",
        ),
    ],
)
def test_parts_that_do_not_fit_are_named(dynamics, sensor, words):
    with pytest.raises(ValueError, match="^" + words) as caught:
        StateSpaceModel(PRIOR, dynamics, sensor)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: StateSpaceModel(np.zeros(2), MOTION, SENSOR), r"StateSpaceModel\.prior is of type ndarray, not a Gaussian"),
        (lambda: AdditiveTransition(STILL, np.eye(2)), r"AdditiveTransition\.noise is of type ndarray, not a Law"),
        (lambda: AdditiveTransition(STILL, ONE, [1.0, 2.0]), r"AdditiveTransition\.gain has shape \(2,\), it must be a matrix"),
        (lambda: AdditiveTransition(STILL, ONE, [[1], [np.nan]]), r"AdditiveTransition\.gain\[1, 0\] is nan, not a finite"),
        (lambda: AdditiveTransition(STILL, ONE, "G"), r"AdditiveTransition\.gain is not an array of numbers"),
        (lambda: AdditiveSensor(STILL, np.eye(2)), r"AdditiveSensor\.noise is of type ndarray, not a Law"),
        (
            lambda: AdditiveSensor(STILL, TWO, (3,)),
            r"AdditiveSensor\.angles must be distinct indices of 2 components, .*\(3,\)",
        ),
        (lambda: AdditiveSensor(STILL, TWO, (2,)), r"AdditiveSensor\.angles must be"),
        (lambda: AdditiveSensor(STILL, TWO, (-1,)), r"AdditiveSensor\.angles must be"),
        (lambda: AdditiveSensor(STILL, TWO, (1, 1)), r"AdditiveSensor\.angles must be"),
        (lambda: AdditiveSensor(STILL, TWO, (0.0,)), r"AdditiveSensor\.angles must be .*, from 0 to 1, got \(0.0,\)"),
        (lambda: AdditiveSensor(STILL, TWO, (True,)), r"AdditiveSensor\.angles must be"),
        (lambda: AdditiveSensor(STILL, TWO, ("0",)), r"AdditiveSensor\.angles must be"),
        (lambda: AdditiveSensor(STILL, TWO, 1), r"AdditiveSensor\.angles must be .*, got 1$"),
        (lambda: AdditiveSensor(STILL, TWO, np.array([0.5])), r"AdditiveSensor\.angles must be"),
        (lambda: NonadditiveTransition(bend, np.eye(2)), r"NonadditiveTransition\.noise is of type ndarray, not a Law"),
        (lambda: NonadditiveSensor(bend, 1.0, 2), r"NonadditiveSensor\.noise is of type float, not a Law"),
        (lambda: NonadditiveSensor(bend, ONE, 2, (2,)), r"NonadditiveSensor\.angles must be distinct indices of 2 components"),
        (lambda: NonadditiveSensor(bend, ONE, 0), r"NonadditiveSensor\.dim is 0, not a number of components: 1 or more"),
        (lambda: NonadditiveSensor(bend, ONE, 2.0), r"NonadditiveSensor\.dim is 2.0, not a number"),
        (lambda: NonadditiveSensor(bend, ONE, True), r"NonadditiveSensor\.dim is True, not a number"),
        (lambda: Affine([1.0, 2.0]), r"Affine\.matrix has shape \(2,\), it must be a matrix"),
        (lambda: Affine([["a"]]), r"Affine\.matrix is not an array of numbers"),
        (lambda: Affine(H, [1.0]), r"Affine\.offset has 1 entries, Affine\.matrix has 3 rows"),
        (lambda: Affine(H, 1.0), r"Affine\.offset has shape \(\), it must be a vector"),
    ],
)
def test_bad_fields_are_named_where_they_are_given(make, words):
    with pytest.raises(ValueError, match="^" + words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_fields_may_come_as_lists_and_arrays():
    sensor = AdditiveSensor(Affine([[1, 0], [0, 1]], [1, 2]), TWO, angles=np.array([1]))
    assert sensor.angles == (1,)
    motion = AdditiveTransition(STILL, ONE, [[1], [2]])
    np.testing.assert_array_equal(motion.noise_cov(1), [[1, 2], [2, 4]])
    model = StateSpaceModel(PRIOR, motion, sensor, linear=[0, 1])
    assert model.linear == (0, 1)
    inside = StateSpaceModel(PRIOR, NonadditiveTransition(bend, lambda k: THREE), NonadditiveSensor(bend, ONE, 2, [0]))
    assert (inside.n, inside.m, inside.sensor.angles) == (2, 2, (0,))


def test_a_function_that_is_not_defined_at_the_prior_mean_has_a_size_all_the_same():
    sensor = AdditiveSensor(lambda x, k: np.log(x[:1]) / x[1:], ONE)
    assert StateSpaceModel(PRIOR, MOTION, sensor).m == 1
