"""The bounds of a case: computed once, from trajectories of its model or along its given track, and stored beside the truth."""

from dataclasses import dataclass, replace

import numpy as np

from suite import fisher
from suite.bounds import KNOWN_MODES, POSTERIOR, Bound, Trajectories, best_fitting_gaussian, bound, trajectories
from suite.case import FROM_MODEL, Case, Truth
from suite.effort import FULL, Effort
from suite.jump import JumpModel
from suite.linalg import Array
from suite.random import Streams

FEWEST = 100
"""Trajectories of a bound at least."""
UNKNOWN = "the truth, about which the model would have to be linearised, is not known at all steps"
SEQUENCES = 100
"""Sequences of modes, over which trajectories are spread where slopes differ among those of one sequence."""


@dataclass(frozen=True)
class BlockBound:
    """A bound on the RMSE of each block of a case's state: value[T, B] and its Monte Carlo standard error[T, B], in its units.

    kind and reason as of `suite.bounds.Bound`; without a bound the numbers are NaN. cov[T, n, n] is the whole of it.
    """

    kind: str
    reason: str
    value: Array
    error: Array
    cov: Array

    @property
    def strict(self) -> bool:
        """Whether no estimator can have smaller errors in the long run."""
        return self.kind in (POSTERIOR, KNOWN_MODES) and not self.reason


def bounds_of(case: Case, seed: int, effort: Effort = FULL) -> tuple[BlockBound, ...]:
    """The bounds of a case; of a model with several modes, that of known modes and that of the Gaussian that fits best."""
    drawn, y = _drawn(case, seed, effort)
    found = [bound(case.model, drawn, y)]
    if isinstance(case.model, JumpModel):
        found.append(best_fitting_gaussian(case.model, drawn, y))
    if case.origin != FROM_MODEL:
        said = f"the truth is {case.origin}: this is what the model allows for, and filters may fall below it"
        found = [replace(each, reason="; ".join(filter(None, (said, each.reason)))) for each in found]
    if np.isnan(drawn.x).any():
        found = [replace(each, reason=UNKNOWN) for each in found]
    return tuple(_of_blocks(case, each) for each in found)


def _drawn(case: Case, seed: int, effort: Effort) -> tuple[Trajectories, Array | None]:
    """Trajectories about which to linearise, and measurements that show what is missing; None where nothing is.

    They are drawn from the model where the truth is and nothing is missing, or where the state does not matter. Else they are
    the case's own truths: what is missing may depend on the state.
    """
    linear, several = _linear(case), isinstance(case.model, JumpModel)
    runs = max(FEWEST, min(effort.trajectories, effort.slopes // (case.steps * case.model.n**2)))
    if linear and not several and not np.isnan(case.simulate(1, seed).y).any():
        runs = 2  # all are alike
    truth = case.simulate(runs, seed)
    y = truth.y if np.isnan(truth.y).any() else None
    streams = Streams((seed, case.name, "bound"))
    if (case.origin == FROM_MODEL and y is None) or (linear and not several):
        copies = runs // SEQUENCES if several and not linear else 1
        return trajectories(case.model, case.steps, streams.batch(0, runs // copies), copies), y
    return _along(case, truth, streams), y


def _linear(case: Case) -> bool:
    """Whether slopes are the same at all states."""
    modes = case.model.modes if isinstance(case.model, JumpModel) else (case.model,)
    return all(fisher.refusal(mode, case.steps) is None and fisher.constant(mode) for mode in modes)


def _along(case: Case, truth: Truth, streams: Streams) -> Trajectories:
    """The truths as trajectories, from states drawn from the prior. Modes that nobody knows count as the nominal one."""
    runs = truth.x.shape[2]
    start = trajectories(case.model, 0, streams.batch(0, runs))
    nominal = case.model.nominal if isinstance(case.model, JumpModel) else 0
    mode = np.full((case.steps, runs), nominal) if truth.mode is None else truth.mode
    return Trajectories(np.concat([start.x, truth.x]), np.concat([mode[:1], mode]))


def _of_blocks(case: Case, found: Bound) -> BlockBound:
    pairs = [found.rmse(block.components) for block in case.blocks]
    value, error = (np.stack(part, axis=-1) for part in zip(*pairs, strict=True))
    return BlockBound(found.kind, found.reason, value, error, found.cov)
