"""What metrics are given: what is certain, how far errors are by their covariance, and that units do not matter."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import mahalanobis as of_scipy

from cases import CASES
from estimators import ESTIMATORS
from suite.case import Card, Divergence, StateBlock, Truth
from suite.case_bounds import BlockBound
from suite.estimator import Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.evidence import mahalanobis

CARD = Card(
    name="toy", title="", summary="", steps=6, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 1e9, 2), reference="",
)  # fmt: skip
STEPS, RUNS = 6, 4


def drawn(seed=0, n=3):
    """A truth and an estimate with correlated covariances of their own at every step and run."""
    rng = np.random.default_rng(seed)
    x = rng.normal(0, 5, (STEPS, n, RUNS))
    root = rng.standard_normal((STEPS, RUNS, n, n)) + 2 * np.eye(n)
    cov = np.moveaxis(root @ np.swapaxes(root, 2, 3), 1, -1)
    return Truth(x, np.zeros((STEPS, 1, RUNS))), Estimate(x + rng.standard_normal(x.shape), cov)


def known(truth, estimate, *rows):
    """The same, with components of the state known exactly."""
    mean, cov = estimate.mean.copy(), estimate.cov.copy()
    for i in rows:
        mean[:, i], cov[:, i], cov[:, :, i] = truth.x[:, i], 0.0, 0.0
    return Estimate(mean, cov)


def by_scipy(truth, estimate, keep):
    """Squared distances [T, R] of some components, one after the other."""
    out = np.empty((len(truth.x), truth.x.shape[2]))
    for k, r in np.ndindex(out.shape):
        inverse = np.linalg.inv(estimate.cov[k][np.ix_(keep, keep)][..., r])
        out[k, r] = of_scipy(estimate.mean[k, keep, r], truth.x[k, keep, r], inverse) ** 2
    return out


def test_distance_is_that_of_scipy():
    truth, estimate = drawn()
    found = Evidence(CARD, truth, estimate)
    assert not found.certain.any()
    np.testing.assert_allclose(found.distance, by_scipy(truth, estimate, [0, 1, 2]), rtol=1e-9)
    np.testing.assert_array_equal(found.dimension, 3)


@pytest.mark.parametrize("rows", [(0,), (1,), (2,), (0, 2)])
def test_what_is_known_exactly_does_not_count(rows):
    truth, estimate = drawn()
    rest = [i for i in range(3) if i not in rows]
    found = Evidence(CARD, truth, known(truth, estimate, *rows))
    np.testing.assert_array_equal(np.flatnonzero(found.certain.all((0, 2))), rows)
    np.testing.assert_allclose(found.distance, by_scipy(truth, estimate, rest), rtol=1e-9)
    np.testing.assert_array_equal(found.dimension, len(rest))


def test_where_all_is_known_exactly_there_is_no_distance_to_speak_of():
    truth, estimate = drawn()
    found = Evidence(CARD, truth, known(truth, estimate, 0, 1, 2))
    np.testing.assert_array_equal(found.distance, 0)
    assert np.isnan(found.dimension).all()
    assert np.isnan(METRICS["nees"](CARD, truth, found.estimate)["state"].value)


def test_each_step_and_run_has_its_own_certainty():
    truth, estimate = drawn()
    mixed = known(truth, estimate, 1)
    mixed.mean[3:, 1, 2:], mixed.cov[3:, :, :, 2:] = estimate.mean[3:, 1, 2:], estimate.cov[3:, :, :, 2:]
    found = Evidence(CARD, truth, mixed)
    some, all_three = by_scipy(truth, mixed, [0, 2]), by_scipy(truth, estimate, [0, 1, 2])
    some[3:, 2:] = all_three[3:, 2:]
    np.testing.assert_allclose(found.distance, some, rtol=1e-9)
    np.testing.assert_array_equal(found.dimension, np.where(found.certain.any(1), 2, 3))


def test_doubt_without_error_and_error_without_doubt_are_not_certain():
    truth, estimate = drawn()
    right, sure = known(truth, estimate), known(truth, estimate, 1)
    right.mean[:, 1] = truth.x[:, 1]
    assert not Evidence(CARD, truth, right).certain.any()
    np.testing.assert_allclose(Evidence(CARD, truth, right).distance, by_scipy(truth, right, [0, 1, 2]), rtol=1e-9)
    sure.mean[:, 1] += 0.1
    found = Evidence(CARD, truth, sure)
    assert not found.certain.any()
    assert np.isinf(found.distance).all()
    assert METRICS["nees"](CARD, truth, sure)["state"].value == np.inf


@pytest.mark.parametrize("rest", [1e-3, 1e-7, 1e-9, 1e-12])
def test_nearly_singular_covariances_keep_their_distance(rest):
    """Of two components with correlation rho, by the closed form of the inverse."""
    rho, error, scale = 1 - rest, np.array([2.0, -1.0]), np.array([1e3, 1e-2])
    cov = np.outer(scale, scale) * np.array([[1, rho], [rho, 1]])
    expected = (error[0] ** 2 - 2 * rho * error[0] * error[1] + error[1] ** 2) / ((1 - rho) * (1 + rho))
    found = mahalanobis(np.stack([scale * error] * 2), np.stack([cov, np.diag(scale**2)]))
    np.testing.assert_allclose(found, [expected, error @ error], rtol=1e-15 / rest + 1e-12)


@pytest.mark.parametrize("rank", [1, 2])
def test_a_singular_covariance_is_infinitely_far_from_an_error(rank):
    truth, estimate = drawn()
    root = np.random.default_rng(1).standard_normal((STEPS, RUNS, 3, rank))
    estimate.cov = np.moveaxis(root @ np.swapaxes(root, 2, 3), 1, -1)
    assert np.isinf(Evidence(CARD, truth, estimate).distance).all()


def test_rounding_is_neither_error_nor_doubt():
    """A component that is known to rounding has a covariance of rounding with the others, too."""
    truth, estimate = drawn()
    exact = known(truth, estimate, 2)
    junk = 1e-13 * np.random.default_rng(2).standard_normal((STEPS, 3, RUNS))
    mean, cov = exact.mean.copy(), exact.cov.copy()
    mean[:, 2] += junk[:, 0]
    cov[:, 2] += junk
    cov[:, :, 2] = cov[:, 2]
    cov[:, 2, 2] = np.abs(junk[:, 2]) ** 2
    found, expected = (Evidence(CARD, truth, Estimate(*pair)) for pair in ((mean, cov), (exact.mean, exact.cov)))
    np.testing.assert_array_equal(found.dimension, 2)
    np.testing.assert_allclose(found.distance, expected.distance, rtol=1e-12)


def test_heading_and_speed_of_the_vehicle_are_certain():
    """Only its position is disturbed: a filter that knows the start knows heading and speed."""
    case = CASES["vehicle/1"]
    truth = case.simulate(3, seed=1)
    estimate = ESTIMATORS["ekf"].run(case.model, truth.y)
    found = Evidence(case, truth, estimate)
    np.testing.assert_array_equal(found.certain.all((0, 2)), [False, False, True, True])
    np.testing.assert_array_equal(found.dimension, 2)
    np.testing.assert_allclose(found.distance, by_scipy(truth, estimate, [0, 1]), rtol=1e-9)


def test_unknown_truth_is_neither_certain_nor_at_a_distance():
    truth, estimate = drawn()
    x = truth.x.copy()
    x[2, 1, 0] = np.nan
    found = Evidence(CARD, Truth(x, truth.y), estimate)
    assert np.isnan(found.distance[2, 0])
    assert np.isnan(found.distance).sum() == 1
    np.testing.assert_array_equal(found.dimension, 3)


MATRICES = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).standard_normal((3, 3)))


@given(MATRICES.filter(lambda a: np.linalg.cond(a) < 1e3), st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_linear_maps_of_the_state_leave_distances(a, seed):
    truth, estimate = drawn(seed)
    mapped = Estimate(np.einsum("ij,kjr->kir", a, estimate.mean), np.einsum("ij,kjlr,ml->kimr", a, estimate.cov, a))
    found = Evidence(CARD, Truth(np.einsum("ij,kjr->kir", a, truth.x), truth.y), mapped)
    np.testing.assert_allclose(found.distance, Evidence(CARD, truth, estimate).distance, rtol=1e-6)


@given(st.floats(-6, 6), st.floats(-6, 6), st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_units_of_the_state_do_not_matter_to_what_has_none(position, speed, seed):
    """Metres or kilometres, and another unit for speed: all that compares errors with their like stays."""
    truth, estimate = drawn(seed)
    estimate = known(truth, estimate, *([1] if seed % 2 else []))
    factor = 10.0 ** np.array([position, position, speed])
    scaled = Estimate(factor[:, None] * estimate.mean, np.outer(factor, factor)[..., None] * estimate.cov)
    value = np.abs(np.random.default_rng(seed).standard_normal((STEPS, 2))) + 0.5
    bounds = [BlockBound("posterior", "", value, 0 * value, np.zeros((STEPS, 3, 3)))]
    other = [dataclasses.replace(bounds[0], value=value * factor[[0, 2]])]
    for name in ("nees", "crlb-ratio", "efficiency", "skill", "lag"):
        expected = METRICS[name](CARD, truth, estimate, bounds=bounds)
        found = METRICS[name](CARD, Truth(factor[:, None] * truth.x, truth.y), scaled, bounds=other)
        assert [*found] == [*expected]
        for block, score in found.items():
            for field in ("value", "low", "high"):
                assert getattr(score, field) == pytest.approx(getattr(expected[block], field), rel=1e-6), (name, block)
