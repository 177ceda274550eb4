"""What every estimator owes, on problems small enough to hold all of them against all rules."""

import pytest

from estimators import ESTIMATORS
from suite import parameters
from suite.examination import examine
from suite.problems import PROBLEMS
from suite.trial import measured


@pytest.fixture(scope="module")
def problems():
    """The problems with their measurements."""
    return [measured(case) for case in PROBLEMS]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_all_rules_are_kept(name, problems):
    estimator = ESTIMATORS[name]
    if "particles" in parameters.fields(estimator):
        estimator = parameters.variant(estimator, {"particles": "50"})
    found = [f"{v.check} on {v.case}: {v.words}" for v in examine(estimator, problems) if v.broken]
    assert not found, "\n".join([f"{name} breaks rules", *found])
