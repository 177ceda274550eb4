"""Estimators that break one rule each, in ways as others do; `BROKEN` says which."""

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suite.parameters import parameter
from suite.random import Streams

_spec = importlib.util.spec_from_file_location("filterbench_tests_sound", Path(__file__).with_name("sound.py"))
_sound = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_sound)
Sound = _sound.Sound


def broken(rule, spoil=None, **methods):
    """A sound estimator but for one method, named after the rule that it breaks."""
    if spoil:
        methods["spoil"] = spoil
    kind = type("Broken", (Sound,), {"name": f"breaks-{rule.replace(' ', '-')}", **methods})
    return kind()


def put(part, where, value):
    """Replaces some numbers of an estimate."""

    def spoil(self, estimate, model, y, seed):
        getattr(estimate, part)[where] = value

    return spoil


def only(condition, effect=lambda estimate: estimate.mean.__setitem__(..., np.nan)):
    """Spoils the estimates of some calls only; without an effect, means become NaN."""

    def spoil(self, estimate, model, y, seed):
        if condition(self, y, seed):
            effect(estimate)

    return spoil


def one_mode(probability):
    """Gives a mode, the only one there is, some probability."""

    def spoil(self, estimate, model, y, seed):
        estimate.mode = np.full((len(y), 1, y.shape[2]), probability)

    return spoil


def shift(estimate):
    estimate.mean += 1.0


def drop(estimate):
    estimate.ess = None


def throw(kind, words=""):
    def method(self, *inputs):
        raise kind(words)

    return method


def change_model(self, estimate, model, y, seed):
    model.prior.mean[0] = 77.0


def change_noise(self, estimate, model, y, seed):
    model.sensor.noise.cov[:] *= 2


def change_measurements(self, estimate, model, y, seed):
    y[0] = 0.0


def fresh_numbers(self, estimate, model, y, seed):
    if not isinstance(seed, Streams):
        estimate.mean += np.random.default_rng().standard_normal()


def look_ahead(self, estimate, model, y, seed):
    estimate.mean[0] += np.tanh(np.where(np.isfinite(y), y, 0.0)[-1, 0] / 100)


def empty_is_news(self, estimate, model, y, seed):
    estimate.loglik[np.isnan(y).all(1)] = -3.0


def lose_all(self, estimate, model, y, seed):
    estimate.status = ["lost"] * y.shape[2]
    estimate.reason = ["step 1: everything was lost"] * y.shape[2]
    estimate.mean[:] = np.nan


def lose_where_empty(self, estimate, model, y, seed):
    for r in np.flatnonzero(np.isnan(y).all(1).any(0) & ~np.isnan(y).all((0, 1))):
        estimate.status[r], estimate.mean[..., r] = "lost", np.nan


def mix_when_odd(self, estimate, model, y, seed):
    odd = np.isnan(y).any() or (np.abs(y) > 1e200).any()
    estimate.mean[..., 0] += 0.25 * odd


def slow_clock(self, estimate):
    estimate.seconds *= 1000


def no_division(self, estimate):
    estimate.seconds *= len(estimate.status)


def negative_time(self, estimate):
    estimate.seconds[0] = -1e-9


def no_batch(self, estimate):
    estimate.batch = [0] * len(estimate.status)


def taken_model(self, model):
    model.prior.cov[0, 0] = 7.0


@dataclass(frozen=True)
class Bare(Sound):
    """Has a parameter that nobody explains."""

    gain: float = 0.5
    name = "breaks-parameter-descriptions"


@dataclass(frozen=True)
class Beyond(Sound):
    """Has a parameter whose default is out of its range."""

    gain: float = parameter(2.0, "a gain", high=1)
    name = "breaks-parameter-ranges"


@dataclass(frozen=True)
class NeedsTwo(Sound):
    """Says nothing of the least number of particles that it needs."""

    particles: int = parameter(20, "particles, two or more")
    name = "breaks-fewest-particles"

    def __post_init__(self):
        if self.particles < 2:
            raise ValueError("too few")


LATE = slice(2, None)
partly = lambda self, y, seed: bool((np.isnan(y).any(1) & ~np.isnan(y).all(1)).any())  # noqa: E731
wholly = lambda self, y, seed: bool(np.isnan(y).all((0, 1)).any())  # noqa: E731

BROKEN = {
    "name": [(broken("name", name="Breaks_Name"), "the name is 'Breaks_Name'")],
    "reference": [(broken("reference", reference=" "), "the reference is ' '")],
    "parameter ranges": [(Beyond(), "breaks-parameter-ranges: gain must be at most 1, got 2.0")],
    "parameter descriptions": [(Bare(), "the parameter gain has no description")],
    "accepts": [
        (broken("accepts", accepts=lambda self, model: ""), "accepts returned '' for the model of check/"),
        (broken("accepts", accepts=lambda self, model: True), "accepts returned True"),
        (
            broken("accepts", accepts=throw(AttributeError, "no mean")),
            "accepts raised AttributeError: no mean for the model of",
        ),
        (
            broken("accepts", accepts=lambda self, model: None if model.n > 1 else 1),
            "accepts returned 1 for the model of check/sc",
        ),
        (broken("accepts", accepts=throw(SystemExit, "3")), "accepts raised SystemExit: 3"),
        (broken("accepts", accepts=taken_model), "accepts changed model.prior.cov of check/"),
    ],
    "run": [
        (broken("run", throw(ZeroDivisionError, "one\ntwo")), "run raised ZeroDivisionError: one two"),
        (broken("run", throw(SystemExit, "bye")), "run raised SystemExit: bye"),
        (broken("run", run=lambda self, model, y, seed=0: np.zeros(3)), "run returned ndarray"),
        (broken("run", run=lambda self, model, y, seed=0: None), "run returned NoneType"),
    ],
    "silence": [
        (broken("silence", lambda self, *rest: print("junk", 3)), "run wrote 'junk 3'"),
        (broken("silence", lambda self, *rest: print("junk", file=sys.stderr)), "run wrote 'junk'"),
    ],
    "shapes": [
        (
            broken("shapes", lambda self, e, *rest: setattr(e, "mean", e.mean[1:])),
            "mean has shape (4, 4, 4), expected (5, 4, 4)",
        ),
        (broken("shapes", lambda self, e, *rest: setattr(e, "mean", "junk")), "mean has shape ()"),
        (broken("shapes", spoil_time=negative_time), "seconds"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "ess", e.ess[:, 0])), "ess has shape (5,), expected (5, 4)"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "cov", e.cov * 1j)), "cov is complex"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "cov", np.full(e.cov.shape, "x"))), "could not convert"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "status", ["fine"] * 4)), "status must be one of"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "status", 3)), "status has shape ()"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "status", [[], [], [], []])), "status has shape (4, 0)"),
        (broken("shapes", lambda self, e, *rest: setattr(e, "reason", ["one"])), "reason has shape (1,)"),
    ],
    "finiteness": [
        (broken("finiteness", put("mean", LATE, np.nan)), "run 0, step 3: mean is not finite"),
        (broken("finiteness", put("cov", LATE, np.inf)), "run 0, step 3: cov is not finite"),
        (broken("finiteness", put("cov", (LATE, 0, 1), 0.5)), "run 0, step 3: cov is not symmetric"),
        (broken("finiteness", put("cov", (LATE, 0, 0), -1.0)), "run 0, step 3: cov has a negative variance"),
        (
            broken("finiteness", lose_all),
            "all runs were lost on ordinary measurements, the first at step 1: everything was lost",
        ),
    ],
    "covariances": [
        (
            broken("covariances", put("cov", (LATE, [0, 1], [1, 0]), 1.5)),
            "a covariance of step 3 has the negative eigenvalue -0.5",
        ),
    ],
    "log likelihood": [
        (broken("log likelihood", put("loglik", 0, -np.inf)), "loglik is -inf"),
        (broken("log likelihood", put("loglik", 0, np.nan)), "loglik is nan"),
    ],
    "ess": [(broken("ess", put("ess", 0, 0.5)), "ess is 0.5"), (broken("ess", put("ess", 0, 20.5)), "ess is 20.5")],
    "ancestors": [
        (broken("ancestors", put("ancestors", 0, 0)), "ancestors is 0"),
        (broken("ancestors", put("ancestors", 0, 21)), "ancestors is 21"),
    ],
    "acceptance": [
        (broken("acceptance", put("acceptance", 0, -0.1)), "acceptance is -0.1"),
        (broken("acceptance", put("acceptance", 0, 50)), "acceptance is 50"),
    ],
    "innovation": [(broken("innovation", put("innovation", 0, np.nan)), "innovation is not finite where something")],
    "mode probabilities": [
        (broken("mode probabilities", one_mode(0.5)), "mode holds numbers that are no probabilities"),
        (broken("mode probabilities", one_mode(np.nan)), "mode holds numbers that are no probabilities"),
    ],
    "statistic": [
        (broken("statistic", put("statistic", 0, np.inf)), "statistic is inf"),
        (broken("statistic", put("statistic", 0, np.nan)), "statistic is nan"),
    ],
    "seconds": [
        (broken("seconds", spoil_time=slow_clock), "seconds add up to"),
        (broken("seconds", spoil_time=no_division, spoil=lambda self, *rest: np.ones(300_000).cumsum()), "seconds add up to"),
        (broken("seconds", spoil_time=no_batch), "batch is [0, 0, 0, 0] for 4 runs"),
    ],
    "measurements untouched": [(broken("measurements untouched", change_measurements), "run wrote to the measurements")],
    "model untouched": [
        (broken("model untouched", change_model), "run changed model.prior.mean"),
        (broken("model untouched", change_noise), "run changed model.sensor.noise.cov"),
    ],
    "repetition": [(broken("repetition", fresh_numbers), "a call repeated with the same seed: mean is another")],
    "single runs": [
        (broken("single runs", only(lambda self, y, seed: y.shape[2] == 1, drop)), "runs 1 to 1 computed by themselves: ess"),
        (broken("single runs", only(lambda self, y, seed: y.shape[2] == 1, shift)), "runs 1 to 1 computed by themselves: mean"),
        (
            broken("single runs", only(lambda self, y, seed: y.shape[2] == 1)),
            "runs 1 to 1 computed by themselves: the status is",
        ),
    ],
    "blocks": [
        (broken("blocks", only(lambda self, y, seed: y.shape[2] == 2, shift)), "runs 0 to 1 computed by themselves: mean"),
        (broken("blocks", only(lambda self, y, seed: y.shape[2] == 3, shift)), "runs 1 to 3 computed by themselves: mean"),
    ],
    "causality": [(broken("causality", look_ahead), "another last measurement changed earlier estimates")],
    "empty step": [
        (broken("empty step", empty_is_news), "loglik is -3, -3 in a step without measurements"),
        (broken("empty step", lose_where_empty), "run 1 was lost"),
    ],
    "missing component": [(broken("missing component", only(partly)), "the status is")],
    "empty run": [(broken("empty run", only(wholly)), "the status is")],
    "impossible measurements": [
        (broken("impossible measurements", only(lambda self, y, seed: np.isinf(y).any())), "the status is"),
        (broken("impossible measurements", only(lambda self, y, seed: (y == 1e300).any())), "the status is"),
        (
            broken("impossible measurements", only(lambda self, y, seed: np.isinf(y).any(), throw(ValueError, "inf"))),
            "run raised ValueError: inf",
        ),
    ],
    "one step": [
        (broken("one step", only(lambda self, y, seed: len(y) == 1)), "run 0, step 1: mean is not finite"),
        (broken("one step", only(lambda self, y, seed: len(y) == 1, throw(IndexError, "1"))), "run raised IndexError: 1"),
    ],
    "fewest particles": [
        (broken("fewest particles", only(lambda self, y, seed: self.particles == 1)), "run 0, step 1: mean is not finite"),
        (NeedsTwo(), "ValueError: too few"),
    ],
}
"""By rule: estimators that break it and no other, with words of what is found. They fit the first of the problems."""

ESTIMATORS = tuple(entries[0][0] for rule, entries in BROKEN.items() if rule != "parameter ranges")
