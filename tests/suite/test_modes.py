"""Probabilities of modes against the plain formulas of the linear domain, and where these underflow against numbers by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suite import modes
from suite.jump import JumpModel
from tests.jump_oracles import TWO


def logarithm(p):
    with np.errstate(divide="ignore"):
        return np.log(np.asarray(p, float))


def column(*p):
    """Log-probabilities [M, 1]."""
    return logarithm(p)[:, None]


def chain(transition):
    """A jump-Markov model of which only the chain matters."""
    initial = np.full(len(transition), 1 / len(transition))
    return JumpModel((TWO.model.modes[0],) * len(transition), transition, initial)


@st.composite
def chains(draw):
    """A transition matrix and mode probabilities [M, R], with zeros in both, and what else is random of their shapes."""
    count, runs = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    zeros = draw(st.sampled_from([0.0, 0.3, 0.7]))

    def probabilities(*shape):
        p = rng.dirichlet(np.full(count, draw(st.sampled_from([0.1, 1.0, 10.0]))), shape) + 1e-12
        p *= rng.random(p.shape) >= zeros
        p[..., 0] += p.sum(-1) == 0
        return p / p.sum(-1, keepdims=True)

    return chain(probabilities(count)), probabilities(runs).T, rng


@given(chains())
@settings(max_examples=100, deadline=None)
def test_prediction_is_that_of_the_linear_domain(drawn):
    model, p, _ = drawn
    ahead, mixing = modes.predicted(model, logarithm(p))
    expected = model.transition.T @ p
    np.testing.assert_allclose(np.exp(ahead), expected, rtol=1e-12, atol=0)
    np.testing.assert_allclose(np.exp(ahead).sum(0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(mixing.sum(0), 1.0, rtol=1e-12)
    joint = model.transition[:, :, None] * p[:, None]
    for j, r in np.ndindex(expected.shape):
        weights = joint[:, j, r] / expected[j, r] if expected[j, r] else p[:, r]
        np.testing.assert_allclose(mixing[:, j, r], weights, rtol=1e-12, atol=0)


@given(chains())
@settings(max_examples=100, deadline=None)
def test_the_posterior_is_that_of_the_linear_domain(drawn):
    _, p, rng = drawn
    loglik = rng.normal(0, 20, p.shape)
    logp, evidence = modes.posterior(logarithm(p), loglik)
    joint = p * np.exp(loglik)
    np.testing.assert_allclose(np.exp(evidence), joint.sum(0), rtol=1e-11)
    np.testing.assert_allclose(np.exp(logp), joint / joint.sum(0), rtol=1e-11, atol=0)


@given(chains(), st.sampled_from([0.0, -1e3, -1e8, -1e17, -1e200]), st.sampled_from([1.0, 1e3, 1e17]))
@settings(max_examples=100, deadline=None)
def test_probabilities_sum_to_one_however_small_the_likelihoods(drawn, level, spread):
    model, p, rng = drawn
    loglik = level + rng.normal(0, spread, p.shape)
    logp, evidence = modes.posterior(logarithm(p), loglik)
    assert np.isfinite(evidence).all()
    np.testing.assert_allclose(np.exp(logp).sum(0), 1.0, rtol=1e-12)
    ahead, mixing = modes.predicted(model, logp)
    assert not np.isnan(ahead).any()
    np.testing.assert_allclose(np.exp(ahead).sum(0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(mixing.sum(0), 1.0, rtol=1e-12)
    assert np.isfinite(modes.log_odds(logp, 0)).all()


def test_far_off_measurements_still_tell_modes_apart():
    """Likelihoods of e^-1e9 and e^-(1e9 + 2): their ratio and the logarithm of their weighted sum are as for e^0 and e^-2.

    Numbers of 1e9 are 1e-7 apart.
    """
    logp, evidence = modes.posterior(column(0.25, 0.75), np.array([[-1e9], [-1e9 - 2]]))
    weights = np.array([0.25, 0.75 * np.exp(-2)])
    np.testing.assert_allclose(np.exp(logp[:, 0]), weights / weights.sum(), rtol=1e-6)
    assert evidence[0] == pytest.approx(-1e9 + np.log(weights.sum()), rel=1e-15)


def test_a_mode_whose_likelihood_is_lost_has_probability_zero():
    logp, evidence = modes.posterior(column(0.25, 0.75), np.array([[np.nan], [-1.0]]))
    assert logp[0, 0] == -np.inf
    assert logp[1, 0] == 0
    assert evidence[0] == pytest.approx(np.log(0.75) - 1)


@pytest.mark.parametrize("nothing", [np.nan, -np.inf])
def test_a_run_in_which_all_modes_are_lost_is_lost_alone(nothing):
    logp = np.repeat(column(0.25, 0.75), 2, axis=1)
    after, evidence = modes.posterior(logp, np.array([[nothing, 0.0], [nothing, 0.0]]))
    assert np.isnan(after[:, 0]).all()
    assert evidence[0] == -np.inf
    np.testing.assert_allclose(np.exp(after[:, 1]), [0.25, 0.75])
    assert evidence[1] == pytest.approx(0.0, abs=1e-15)
    model = chain(np.eye(2))
    assert np.isnan(modes.predicted(model, after)[0][:, 0]).all()
    assert np.isnan(modes.log_odds(after, 0)[0])


def test_log_odds_are_those_of_all_other_modes_together():
    np.testing.assert_allclose(modes.log_odds(column(0.2, 0.5, 0.3), 1), np.log(0.5 / 0.5), atol=1e-15)
    np.testing.assert_allclose(modes.log_odds(column(0.2, 0.5, 0.3), 2), np.log(0.7 / 0.3))


def test_log_odds_do_not_saturate():
    """At probabilities that are 1 - e^-500 in the linear domain 1, and the other way about."""
    np.testing.assert_allclose(modes.log_odds(np.array([[0.0], [-500.0]]), 0), -500.0)
    np.testing.assert_allclose(modes.log_odds(np.array([[-500.0], [0.0]]), 0), 500.0)


@pytest.mark.parametrize(
    ("p", "expected"), [((1.0, 0.0), -modes.LARGEST), ((0.0, 1.0), modes.LARGEST), ((1.0,), -modes.LARGEST)]
)
def test_log_odds_of_certainties_are_finite(p, expected):
    assert modes.log_odds(column(*p), 0)[0] == expected


def test_the_initial_law_is_the_model_s_in_every_run():
    model = replace(chain(np.eye(3)), initial=np.array([0.0, 0.4, 0.6]))
    np.testing.assert_array_equal(np.exp(modes.initial(model, 3)), np.repeat([[0.0], [0.4], [0.6]], 3, axis=1))


@given(chains())
@settings(max_examples=50, deadline=None)
def test_a_run_has_the_same_bits_alone(drawn):
    model, p, rng = drawn
    logp, loglik = logarithm(p), rng.normal(-1e4, 100, p.shape)
    for function in (lambda a, _: modes.predicted(model, a), modes.posterior, lambda a, _: (modes.log_odds(a, 0),)):
        for together, alone in zip(function(logp, loglik), function(logp[:, :1], loglik[:, :1]), strict=True):
            np.testing.assert_array_equal(together[..., :1], alone)
