"""What the detectors by innovations have in common: one run does not harm another, and statistics stay numbers."""

import numpy as np
import pytest

from estimators.glr import LikelihoodRatio
from estimators.nis_chi2 import InnovationSquared
from suite.case import draw
from suite.estimator import LOST
from tests.estimators.references import PAIR
from tests.oracles import generators, range_bearing

DETECTORS = pytest.mark.parametrize("detector", [LikelihoodRatio(), InnovationSquared()], ids=lambda d: d.name)


@DETECTORS
def test_a_run_without_hope_is_lost_alone(detector):
    model = range_bearing()
    y = draw(model, 12, generators(4, "lost")).y
    y[5, 0, 2] = np.inf
    estimate = detector.run(model, y)
    assert list(estimate.status) == ["ok", "ok", LOST, "ok"]
    assert np.isnan(estimate.statistic[5:, 2]).all()
    others = detector.run(model, y[:, :, [0, 1, 3]])
    np.testing.assert_array_equal(estimate.statistic[:, [0, 1, 3]], others.statistic)


@DETECTORS
def test_the_statistic_stays_a_number_whatever_was_measured(detector):
    _, y = PAIR.simulate(12, runs=2, seed=4)
    y[5, 0, 1] = 1e300
    estimate = detector.run(PAIR.model, y)
    assert estimate.ok.all()
    assert np.isfinite(estimate.statistic).all()
    assert estimate.statistic[5, 1] > 1e200
