"""The tiny case with an estimator that takes its time: something to interrupt."""

import importlib.util
import time
from pathlib import Path

_spec = importlib.util.spec_from_file_location("filterbench_tests_tiny", Path(__file__).with_name("tiny.py"))
_tiny = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_tiny)


class Slow(_tiny.Last):
    """The last measurement, after a while."""

    name = "slow"

    def run(self, model, y, seed=0):
        time.sleep(0.03 if y.shape[2] == 1 and len(y) == _tiny.STEPS else 0.0)
        return super().run(model, y, seed)


CASES = _tiny.CASES
ESTIMATORS = (Slow(),)
