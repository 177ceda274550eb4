"""Cases that go wrong when they are simulated."""

import importlib.util
from pathlib import Path

from suite.case import Truth, draw

_spec = importlib.util.spec_from_file_location("filterbench_tests_tiny", Path(__file__).with_name("tiny.py"))
_tiny = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_tiny)


def _raise(rng):
    raise ArithmeticError("no truth today")


def _short(rng):
    truth = draw(_tiny.MODEL, _tiny.STEPS, rng)
    return Truth(truth.x[1:], truth.y)


CASES = (_tiny.tiny("raising", _raise), _tiny.tiny("short", _short), _tiny.tiny("sound"))
