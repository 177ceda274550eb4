"""Jump-Markov models: what they refuse, and that simulations follow the chain of modes and the law of the mode in force."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from suite.jump import JumpModel, chosen, drawn, evolved, simulated, started
from suite.jump_filter import JumpFilter
from suite.random import Streams
from tests.jump_oracles import THREE, TWO, JumpLinear, enumeration
from tests.oracles import Given, generators, joint_loglik, random_linear

STAYS = np.array([[0.7, 0.2, 0.1], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]])
OTHER = random_linear(1, 2, 1, 2).model
TALL = random_linear(1, 3, 2, 3).model


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("modes", (), "JumpModel.modes is empty"),
        ("modes", None, "JumpModel.modes is of type NoneType, not a tuple of StateSpaceModel"),
        ("modes", TALL, "JumpModel.modes is of type StateSpaceModel, not a tuple of StateSpaceModel"),
        ("modes", (None,), r"JumpModel.modes\[0\] is of type NoneType, not a StateSpaceModel"),
        (
            "modes",
            (TWO.model.modes[0], TALL),
            r"JumpModel.modes\[1\] has 3 state and 2 measurement components, modes\[0\] has 2",
        ),
        ("modes", (TWO.model.modes[0], OTHER), r"JumpModel.modes\[1\] has 2 state and 1 measurement components"),
        ("modes", (TWO.model.modes[0], TWO.model), r"JumpModel.modes\[1\] is of type JumpModel, not a StateSpaceModel"),
        ("modes", TWO.model.modes[:1], r"JumpModel.transition has shape \(2, 2\), 1 modes need \(1, 1\)"),
        ("transition", [[0.9, 0.1], [0.3, 0.6]], "JumpModel.transition row 1 sums to 0.9, not to 1"),
        ("transition", [[0.9, 0.3], [0.1, 0.7]], "JumpModel.transition row 0 sums to 1.2, not to 1"),
        ("transition", [[0.9, 0.1], [-0.1, 1.1]], r"JumpModel.transition row 1 is \[-0.1, 1.1\]"),
        ("transition", [[np.nan, 0.1], [0.3, 0.7]], r"JumpModel.transition row 0 is \[nan, 0.1\]"),
        ("transition", [[0.9, 0.1], [0.3, np.inf]], r"JumpModel.transition row 1 is \[0.3, inf\]"),
        ("transition", [0.5, 0.5], r"JumpModel.transition has shape \(2,\), 2 modes need \(2, 2\)"),
        ("transition", np.eye(3), r"JumpModel.transition has shape \(3, 3\), 2 modes need \(2, 2\)"),
        ("transition", [[0.5, 0.5], [1.0]], "JumpModel.transition is not an array of numbers"),
        ("transition", "eye", "JumpModel.transition is not an array of numbers"),
        ("initial", [0.5, 0.4], "JumpModel.initial sums to 0.9, not to 1"),
        ("initial", [1.5, -0.5], r"JumpModel.initial is \[1.5, -0.5\]"),
        ("initial", [np.nan, 1.0], r"JumpModel.initial is \[nan, 1.0\]"),
        ("initial", [1.0], r"JumpModel.initial has shape \(1,\), 2 modes need \(2,\)"),
        ("initial", [[0.5, 0.5]], r"JumpModel.initial has shape \(1, 2\)"),
        ("nominal", 2, "JumpModel.nominal is 2, not the index of one of 2 modes: 0 to 1"),
        ("nominal", -1, "JumpModel.nominal is -1, not the index"),
        ("nominal", 1.0, "JumpModel.nominal is 1.0, not the index"),
        ("nominal", True, "JumpModel.nominal is True, not the index"),
        ("nominal", np.eye(3), r"JumpModel.nominal is array\(\[\[1., 0., 0.\], \[0., 1., 0.\]"),
        ("nominal", "straight", "JumpModel.nominal is 'straight', not the index"),
        ("names", ("a", "a"), r"JumpModel.names must be 2 different names, one a mode, got \('a', 'a'\)"),
        ("names", ("a", "b", "a"), "JumpModel.names must be 2 different names"),
        ("names", ("a",), "JumpModel.names must be 2 different names"),
        ("names", "ab", "JumpModel.names must be 2 different names, one a mode, got 'ab'"),
        ("names", (1, 2), "JumpModel.names must be 2 different names"),
        ("names", None, "JumpModel.names must be 2 different names, one a mode, got None"),
        ("names", "", "JumpModel.names must be 2 different names, one a mode, got ''"),
        ("names", np.array(["a", "a"]), "JumpModel.names must be 2 different names"),
        ("names", np.array([1, 2]), "JumpModel.names must be 2 different names"),
        ("names", np.array("a"), "JumpModel.names must be 2 different names"),
        ("transition", [["0.5", "0.5"], ["0.5", "0.5"]], "JumpModel.transition is not an array of numbers"),
    ],
)
def test_bad_input_is_named_in_one_line(field, value, words):
    with pytest.raises(ValueError, match="^" + words) as caught:
        dataclasses.replace(TWO.model, **{field: value})
    assert "\n" not in str(caught.value)


def test_probabilities_may_come_as_lists_and_sum_to_one_but_for_rounding():
    third = 1 / 3 + 1e-11
    modes = THREE.model.modes
    model = JumpModel(list(modes), [[third] * 3, [1, 0, 0], [0, 1, 0]], [third] * 3)
    assert model.modes == modes
    np.testing.assert_allclose(model.transition.sum(1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(model.initial.sum(), 1.0, rtol=1e-15)
    assert model.names == ("mode 1", "mode 2", "mode 3")
    assert (model.n, model.m) == (2, 2)
    assert model.nominal_mode is modes[0]


@pytest.mark.parametrize("make", [tuple, list, np.array])
def test_names_may_come_in_any_order_that_is_one(make):
    assert dataclasses.replace(TWO.model, names=make(["straight", "turn"])).names == ("straight", "turn")
    assert dataclasses.replace(TWO.model, names=make([])).names == ("mode 1", "mode 2")


# Chi-square tests of independent draws. A fit is refused at a p-value below 1e-8, in fewer than 20 tests: a false alarm has
# probability below 2e-7, as far as counts of hundreds follow the chi-square law.
LEAST = 1e-8


def fits(counts, probabilities):
    """Whether counts [M] may be draws with these probabilities; impossible ones never are."""
    possible = probabilities > 0
    assert (counts[~possible] == 0).all()
    expected = counts.sum() * probabilities[possible]
    return possible.sum() == 1 or stats.chisquare(counts[possible], expected).pvalue > LEAST


def test_simulated_modes_follow_the_chain():
    """Steps from a mode are independent draws from its row, whatever led there."""
    _, _, modes = simulated(THREE.model, 40, generators(200, "chain"))
    counts = np.zeros((3, 3))
    np.add.at(counts, (modes[:-1].ravel(), modes[1:].ravel()), 1)
    assert counts.sum(1).min() > 500
    assert all(fits(row, p) for row, p in zip(counts, THREE.P, strict=True))
    two_apart = np.zeros((3, 3))
    np.add.at(two_apart, (modes[:-2:3].ravel(), modes[2::3].ravel()), 1)
    assert all(fits(row, p) for row, p in zip(two_apart, THREE.P @ THREE.P, strict=True))


def test_the_first_mode_is_one_step_from_the_initial_law():
    _, _, modes = simulated(THREE.model, 1, generators(4000, "first"))
    assert fits(np.bincount(modes[0], minlength=3), THREE.p0 @ THREE.P)
    assert fits(np.bincount(started(THREE.model, generators(4000, "r0"), (4000,)), minlength=3), THREE.p0)


def test_modes_evolve_over_any_shape():
    begin = np.tile(np.arange(3), (5, 1000))
    after = evolved(dataclasses.replace(THREE.model, transition=STAYS), begin, generators(5, "shape"))
    assert after.shape == begin.shape
    assert all(fits(np.bincount(after[begin == i], minlength=3), STAYS[i]) for i in range(3))


def test_a_mode_of_probability_zero_is_never_drawn():
    """Not at the ends of the range of uniform numbers either, and not where rounding leaves a sum below one."""
    ends = [0.0, 0.1 - 2**-53, 0.1, 0.5, 1 - 2**-53]
    found = drawn(np.array([0.0, 0.1, 0.0, 0.9 - 1e-12, 0.0]) * np.ones((5, 1, 1)), Given(np.array(ends)[:, None]))
    np.testing.assert_array_equal(found[:, 0], [1, 1, 3, 3, 3])


def without_noise(problem):
    zero = np.zeros((2, 2))
    modes = [dataclasses.replace(p, G=np.eye(2), w=np.zeros(2), v=np.zeros(2), Q=zero, R=zero, P0=zero) for p in problem.modes]
    return dataclasses.replace(problem, modes=tuple(modes))


def test_states_and_measurements_follow_the_mode_in_force():
    """Without noises they are functions of the modes."""
    problem = without_noise(THREE)
    x, y, modes = simulated(problem.model, 12, generators(50, "force"))
    assert len(np.unique(modes)) == 3
    for k, r in np.ndindex(modes.shape):
        p = problem.modes[modes[k, r]]
        if k:
            np.testing.assert_allclose(x[k, :, r], p.A @ x[k - 1, :, r] + p.a, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(y[k, :, r], p.H @ x[k, :, r] + p.h, rtol=1e-12, atol=1e-12)


def test_the_first_state_follows_the_prior_of_the_mode_before():
    problem = dataclasses.replace(without_noise(THREE), P=np.eye(3), p0=np.array([0.3, 0.3, 0.4]))
    x, _, modes = simulated(problem.model, 1, generators(30, "prior"))
    for r, mode in enumerate(modes[0]):
        p = problem.modes[mode]
        np.testing.assert_allclose(x[0, :, r], p.A @ p.m0 + p.a, rtol=1e-12)


def test_a_run_is_the_same_whatever_runs_beside_it():
    streams = Streams(("test", "neighbours"))
    together = simulated(THREE.model, 6, streams.batch(0, 5))
    alone = simulated(THREE.model, 6, streams.batch(3, 1))
    for some, one in zip(together, alone, strict=True):
        np.testing.assert_array_equal(some[..., 3:4], one)


def test_options_are_chosen_by_mode():
    options = [np.full((2, 3), 10.0 * j) for j in range(3)]
    np.testing.assert_array_equal(chosen(np.array([2, 0, 1]), options), [[20, 0, 10], [20, 0, 10]])


class Picky(JumpFilter):
    name, reference = "picky", "none"

    def accepts_mode(self, model):
        return None if model.prior.mean[0] == 0 else "its prior is not about zero"

    init = step = read = None


def test_a_filter_of_modes_names_the_mode_that_it_refuses():
    assert Picky().accepts(TWO.model) is None
    assert Picky().accepts(THREE.model) == "mode 3: its prior is not about zero"
    assert Picky().accepts(TWO.model.modes[0]) == "the model has a single mode"


def test_the_enumeration_of_one_mode_is_the_joint_gaussian():
    """An oracle for the oracle, with other arithmetic: with one mode, or modes all alike, nothing is left to enumerate."""
    problem = random_linear(5, 2, 2, 2)
    _, y = problem.simulate(steps=4, runs=2, seed=1)
    y[1, 0, 0], y[2, :, 1] = np.nan, np.nan
    found = enumeration(JumpLinear((problem, problem), TWO.P, TWO.p0), y)
    expected = [joint_loglik(problem, y[:, :, r]) for r in range(2)]
    np.testing.assert_allclose(found.loglik.sum(0), expected, rtol=1e-10)
    chain = np.stack([TWO.p0 @ np.linalg.matrix_power(TWO.P, k) for k in range(1, 5)])
    np.testing.assert_allclose(found.mode, np.repeat(chain[..., None], 2, axis=2), rtol=1e-10)


def test_the_enumeration_is_the_expectation_over_simulated_sequences():
    """E[p(y | r_0..r_k)] over drawn sequences, each weighed by the joint Gaussian of its own states, built by hand."""
    _, y, _ = THREE.simulate(steps=2, runs=1, seed=2)
    total = 0.0
    for r0, r1, r2 in np.ndindex(3, 3, 3):
        p, q, start = THREE.modes[r1], THREE.modes[r2], THREE.modes[r0]
        noise = [mode.G @ mode.Q @ mode.G.T for mode in (p, q)]
        m1 = p.A @ start.m0 + p.a + p.G @ p.w
        P1 = p.A @ start.P0 @ p.A.T + noise[0]
        m2, P2 = q.A @ m1 + q.a + q.G @ q.w, q.A @ P1 @ q.A.T + noise[1]
        cross = p.H @ P1 @ q.A.T @ q.H.T
        cov = np.block([[p.H @ P1 @ p.H.T + p.R, cross], [cross.T, q.H @ P2 @ q.H.T + q.R]])
        mean = np.concatenate([p.H @ m1 + p.h + p.v, q.H @ m2 + q.h + q.v])
        total += THREE.p0[r0] * THREE.P[r0, r1] * THREE.P[r1, r2] * stats.multivariate_normal(mean, cov).pdf(y.ravel())
    assert enumeration(THREE, y).loglik.sum() == pytest.approx(np.log(total), rel=1e-10)
