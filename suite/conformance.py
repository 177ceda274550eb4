"""What every estimator owes: a list of rules, each a function of one estimator on one case, checked on small problems.

A check raises `Finding` when its rule, which is its docstring, is broken.
"""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from suite import parameters
from suite.estimator import Estimate, told
from suite.problems import PROBLEMS
from suite.trial import (
    ALL,
    RUNS,
    SPOILT,
    Finding,
    Trial,
    demand_blocks,
    demand_no_failure,
    demand_same,
    demand_sound,
    demand_within,
    difference,
    numbers,
    opinion,
)

Check = Callable[[Trial], None]
WORD = r"[a-z0-9.+_]+(-[a-z0-9.+_]+)*"


# Rules for an entry of the registry.


def name(trial: Trial) -> None:
    """A name is lower-case words joined by hyphens, with a peer library's name and a colon before it if need be."""
    if not isinstance(trial.estimator.name, str) or not re.fullmatch(f"({WORD}:)?{WORD}", trial.estimator.name):
        raise Finding(f"the name is {trial.estimator.name!r}")


def reference(trial: Trial) -> None:
    """The reference says in words where the method was published."""
    if not isinstance(trial.estimator.reference, str) or not trial.estimator.reference.strip():
        raise Finding(f"the reference is {trial.estimator.reference!r}")


def parameter_ranges(trial: Trial) -> None:
    """Each parameter has a type of int, float, bool or str, and a value in its range."""
    parameters.check(trial.estimator)


def parameter_descriptions(trial: Trial) -> None:
    """Each parameter is described, by suite.parameters.parameter(default, description)."""
    for known, field in parameters.fields(trial.estimator).items():
        if not str(field.metadata.get("doc", "")).strip():
            raise Finding(f"the parameter {known} has no description")


def accepts(trial: Trial) -> None:
    """For every model accepts returns None or the reason why not, as text, and leaves the model as it is."""
    for case in PROBLEMS:
        opinion(trial.estimator, case)
    _ = trial.refusal


# Rules for a run on measurements as they come.


def run(trial: Trial) -> None:
    """On a model that accepts takes, run returns an Estimate; it draws random numbers through Streams.of(seed)."""
    if not isinstance(trial.outcome.returned, Estimate):
        raise Finding(f"run returned {type(trial.outcome.returned).__name__}")


def silence(trial: Trial) -> None:
    """Nothing is written to the terminal, and no warning is raised; what there is to say belongs into the estimate."""
    if trial.outcome.written:
        raise Finding(f"run wrote {' '.join(trial.outcome.written.split())[:200]!r}")


def shapes(trial: Trial) -> None:
    """Every part of an estimate has the shape, and every status the value, that suite/estimator.py states."""
    _ = trial.plain


def finiteness(trial: Trial) -> None:
    """Means and covariances are finite, and these symmetric, in all runs but those marked lost."""
    demand_no_failure(trial.plain)
    if not trial.plain.ok.any():
        raise Finding(f"all runs were lost on ordinary measurements, the first at {trial.plain.reason[0]}")


def covariances(trial: Trial) -> None:
    """Covariances are positive semidefinite, to rounding."""
    stack = np.moveaxis(trial.plain.cov, (1, 2), (-2, -1))[:, trial.plain.ok]
    variances = np.diagonal(stack, axis1=-2, axis2=-1)
    top = variances.max(-1, keepdims=True)
    scale = np.sqrt(np.maximum(np.where(top > 0, top, 1.0) * 1e-12, variances))  # components may differ by many orders
    lowest = np.linalg.eigvalsh(stack / (scale[..., None] * scale[..., None, :]))[..., 0]
    if (lowest < -1e-6).any():
        step = int(np.argmax((lowest < -1e-6).any(1))) + 1
        raise Finding(f"a covariance of step {step} has the negative eigenvalue {lowest.min():.2g} when scaled to correlations")


def log_likelihood(trial: Trial) -> None:
    """The log-likelihood is finite in every step of a run that is not lost."""
    demand_within(trial, "loglik", -np.finfo(float).max, np.finfo(float).max)


def ess(trial: Trial) -> None:
    """The effective sample size lies between 1 and the number of particles."""
    demand_within(trial, "ess", 1.0, _particles(trial))


def ancestors(trial: Trial) -> None:
    """The number of ancestors lies between 1 and the number of particles."""
    demand_within(trial, "ancestors", 1.0, _particles(trial))


def acceptance(trial: Trial) -> None:
    """The acceptance lies between 0 and 1, and is NaN where no move was tried."""
    demand_within(trial, "acceptance", 0.0, 1.0, or_nan=True)


def innovation(trial: Trial) -> None:
    """The innovation is finite for every measurement of a run that is not lost."""
    found, ok = trial.plain.innovation, trial.plain.ok
    if found is not None and not np.isfinite(found[:, :, ok][np.isfinite(trial.y[:, :, ok])]).all():
        raise Finding("innovation is not finite where something was measured")


def mode_probabilities(trial: Trial) -> None:
    """Mode probabilities lie between 0 and 1 and sum to one, in every step of a run that is not lost."""
    modes = trial.plain.mode
    if modes is not None:
        modes = modes[:, :, trial.plain.ok]
        if not ((modes >= -1e-9) & (modes <= 1 + 1e-9)).all() or (np.abs(modes.sum(1) - 1) > 1e-6).any():
            raise Finding("mode holds numbers that are no probabilities, or do not sum to one")


def statistic(trial: Trial) -> None:
    """The decision statistic of a detector is finite in every step of a run that is not lost."""
    demand_within(trial, "statistic", -np.finfo(float).max, np.finfo(float).max)


def seconds(trial: Trial) -> None:
    """The seconds of a step are those of all runs computed together divided by their number, which is in batch."""
    taken = np.asarray(trial.plain.seconds)
    if not (taken >= 0).all() or not np.isfinite(taken).all():
        raise Finding("seconds are negative or not finite")
    if taken.sum() > 1.1 * trial.outcome.elapsed + 1e-4:
        raise Finding(f"seconds add up to {taken.sum():.3g} s over steps and runs, in a call of {trial.outcome.elapsed:.3g} s")
    if not all(isinstance(b, int | np.integer) and 1 <= b <= RUNS for b in trial.plain.batch):
        raise Finding(f"batch is {list(trial.plain.batch)} for {RUNS} runs")


# Rules for inputs and repetitions.


def measurements_untouched(trial: Trial) -> None:
    """The measurements stay as they are; work on a copy."""
    if trial.outcome.y.tobytes() != trial.y.tobytes():
        raise Finding("run wrote to the measurements")


def model_untouched(trial: Trial) -> None:
    """The model stays as it is; work on a copy."""
    if changed := difference(numbers(told(trial.estimator, trial.case.model)), numbers(trial.outcome.model)):
        raise Finding(f"run changed {changed}")


def repetition(trial: Trial) -> None:
    """The same seed gives the same bits; keep no state between calls and use no global random numbers."""
    begin = trial.y[:3]
    demand_same(trial.run(begin, 7), trial.run(begin, 7), "a call repeated with the same seed")


def single_runs(trial: Trial) -> None:
    """A run computed alone has the same bits as in a batch; it draws through Streams.of(seed).batch(0, 1)."""
    demand_blocks(trial, [slice(r, r + 1) for r in range(1, RUNS)])


def blocks(trial: Trial) -> None:
    """Runs have the same bits whatever block they are computed in; no number may mix runs."""
    demand_blocks(trial, [slice(0, 2), slice(1, RUNS)])


def causality(trial: Trial) -> None:
    """An estimate of step k depends on the measurements up to step k, not on later ones."""
    y = trial.y.copy()
    y[-1] += 1.0
    other = trial.run(y)
    if not np.array_equal(other.mean[:-1, :, other.ok], trial.plain.mean[:-1, :, other.ok], equal_nan=True):
        raise Finding("another last measurement changed earlier estimates")


# Rules for measurements that are missing or cannot be.


def empty_step(trial: Trial) -> None:
    """A step without measurements (NaN) in some runs predicts, and adds nothing to their log-likelihood."""
    step = len(trial.y) // 2
    found = trial.spoilt(step, ALL, np.nan)
    demand_sound(found, trial.plain)
    if found.loglik is not None:
        added = found.loglik[step, SPOILT][found.ok[SPOILT]]
        if not (np.abs(added) < 1e-9).all():
            raise Finding(f"loglik is {', '.join(f'{v:.3g}' for v in added)} in a step without measurements")


def missing_component(trial: Trial) -> None:
    """A missing component (NaN) of a measurement drops out; the other components count."""
    if trial.case.model.m > 1:
        demand_sound(trial.spoilt(len(trial.y) // 2, 0, np.nan), trial.plain)


def empty_run(trial: Trial) -> None:
    """A run without any measurement is predicted from the prior."""
    demand_sound(trial.spoilt(ALL, ALL, np.nan), trial.plain)


def impossible_measurements(trial: Trial) -> None:
    """Measurements of 1e300 or infinity give estimates that are finite, or runs marked lost; other runs keep their bits."""
    demand_no_failure(trial.spoilt(len(trial.y) // 2, ALL, np.array([1e300, np.inf])))


# Rules for the smallest of all.


def one_step(trial: Trial) -> None:
    """A single step is enough."""
    demand_no_failure(trial.run(trial.y[:1]))


def fewest_particles(trial: Trial) -> None:
    """The least number of particles that is allowed gives finite estimates, or runs marked lost."""
    if field := parameters.fields(trial.estimator).get("particles"):
        fewest = parameters.variant(trial.estimator, {"particles": str(field.metadata.get("low") or 1)})
        demand_no_failure(replace(trial, estimator=fewest).run(trial.y))


CHECKS: tuple[Check, ...] = (
    name, reference, parameter_ranges, parameter_descriptions, accepts,
    run, silence, shapes, finiteness, covariances, log_likelihood, ess, ancestors, acceptance, innovation,
    mode_probabilities, statistic, seconds,
    measurements_untouched, model_untouched, repetition, single_runs, blocks, causality,
    empty_step, missing_component, empty_run, impossible_measurements, one_step, fewest_particles,
)  # fmt: skip
"""All rules in order; from `run` on they are checked on the cases that the estimator accepts."""
NEEDED = (parameter_ranges, accepts, run, shapes, finiteness)
"""When one of these is broken, the ones after it tell nothing."""


def _particles(trial: Trial) -> float:
    return float(parameters.values(trial.estimator).get("particles", np.finfo(float).max))
