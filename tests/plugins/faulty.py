"""Estimators that go wrong, each in its own way. They expect a case of 20 steps."""

import os
import sys
import threading
import time

import numpy as np

from suite.estimator import Estimate, Filter, Readout
from suite.random import Streams


def estimate(y, n=2):
    """An estimate of the right shape."""
    cov = np.broadcast_to(np.eye(n)[None, :, :, None], (len(y), n, n, y.shape[2]))
    return Estimate(np.zeros((len(y), n, y.shape[2])), cov.copy())


class Faulty:
    """Base of the faulty estimators."""

    reference = "none"

    def accepts(self, model):
        return None


class WrongShape(Faulty):
    """Leaves a step out."""

    name = "wrong-shape"

    def run(self, model, y, seed=0):
        return estimate(y[1:])


class WrongType(Faulty):
    """Returns an array."""

    name = "wrong-type"

    def run(self, model, y, seed=0):
        return np.zeros((len(y), 2, y.shape[2]))


class NotFinite(Faulty):
    """Returns NaN from step 6 on."""

    name = "not-finite"

    def run(self, model, y, seed=0):
        made = estimate(y)
        made.mean[5:] = np.nan
        return made


class Raises(Filter):
    """Raises in step 17."""

    name = "raises"
    reference = "none"

    def init(self, model, rng):
        return np.zeros((2, rng.runs))

    def step(self, model, belief, y, k, rng):
        if k == 17:
            raise ArithmeticError("the matrix is\nnot positive definite")
        return belief

    def read(self, belief):
        return Readout(belief, np.broadcast_to(np.eye(2)[:, :, None], (2, *belief.shape)))


class RaisesOnce(Faulty):
    """Raises in any batch that holds run 3; gives random numbers for the others."""

    name = "raises-once"

    def run(self, model, y, seed=0):
        streams, runs = Streams.of(seed), y.shape[2]
        if streams.first <= 3 < streams.first + runs:
            raise ArithmeticError("run 3 is not to my taste")
        made = estimate(y)
        made.mean[:, 0] = streams.batch(0, runs).standard_normal((len(y), runs))
        return made


class Exits(Faulty):
    """Calls sys.exit."""

    name = "exits"

    def run(self, model, y, seed=0):
        sys.exit("good bye")


class Dies(Faulty):
    """Ends its process."""

    name = "dies"

    def run(self, model, y, seed=0):
        os._exit(7)


class Hangs(Faulty):
    """Never returns."""

    name = "hangs"

    def run(self, model, y, seed=0):
        while True:
            time.sleep(0.1)


class LeavesThread(Faulty):
    """Leaves a thread behind that never ends."""

    name = "leaves-thread"

    def run(self, model, y, seed=0):
        threading.Thread(target=lambda: [time.sleep(0.1) for _ in range(6000)]).start()
        return estimate(y)


ESTIMATORS = (
    WrongShape(), WrongType(), NotFinite(), Raises(), RaisesOnce(), Exits(), Dies(), Hangs(), LeavesThread(),
)  # fmt: skip
