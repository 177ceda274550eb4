"""Verdicts on published figures: when ours could be theirs repeated, and what a result set says against the record."""

import dataclasses

import numpy as np
import pytest

import suite.cli
from cases import CASES, FINDINGS
from estimators import ESTIMATORS
from suite import parameters
from suite.estimator import told
from suite.metrics import METRICS, Score
from suite.published import NOT_COMPARABLE, NOT_REPRODUCED, REPRODUCED, VERDICTS, Finding, Published, findings
from suite.verdicts import Verdict
from tests.oracles import generators

FIGURE = Published("kalman", "position error", 10.01, "m", "Table 1", metric="rmse", block="position", runs=100)
ALL = [(case.name, p) for case in CASES.values() for p in case.published]


PLUGIN = """
import dataclasses
from cases.linear_gaussian import CASES as PLAIN
from suite.published import Published

near, far = (
    Published("kalman", quantity, value, "m", "Table 1", metric="rmse", block="position")
    for quantity, value in (("near", 8.1), ("far", 80.0))
)
CASES = (dataclasses.replace(PLAIN[0], name="printed", published=(near, far)),)
"""


@pytest.mark.parametrize(
    ("value", "half", "runs", "theirs", "expected"),
    [
        (10.01, 0.0, 100, 100, True),
        (11.0, 0.01, 100, 100, False),
        (11.0, 0.06, 100, 0, False),  # sqrt(2) · 0.06 < log(11 / 10.01) = 0.0943
        (11.0, 0.07, 100, 0, True),
        (11.0, 0.02, 100, 4, True),  # their four runs scatter five times as much as our hundred
        (11.0, 0.02, 100, 10, False),
        (10.014, 0.0, 100, 100, True),  # 10.01 is printed for all from 10.005 to 10.015
        (10.016, 0.0, 100, 100, False),
        (11.0, 0.28, 100, 100, True),  # sqrt(2) · 0.28 < log(1.5) = 0.405
        (11.0, 0.30, 100, 100, None),
        (30.0, 0.30, 100, 100, False),
    ],
)
def test_a_figure_agrees_when_a_repetition_could_have_given_it(value, half, runs, theirs, expected):
    score = Score(value, value * np.exp(-half), value * np.exp(half), "m", runs, runs)
    assert Verdict("case", dataclasses.replace(FIGURE, runs=theirs), None, score).agrees == expected


@pytest.mark.parametrize(
    ("count", "runs", "printed", "theirs", "expected"),
    [
        (0, 100, 0.0, 100, True),
        (1, 300, 0.0, 100, True),
        (20, 100, 0.0, 100, False),
        (3, 100, 0.3, 10, False),
        (3, 10, 0.3, 10, True),
    ],
)
def test_rates_are_compared_by_their_counts(count, runs, printed, theirs, expected):
    figure = dataclasses.replace(FIGURE, value=printed, runs=theirs, metric="divergence", block="runs")
    assert Verdict("case", figure, None, Score(count / runs, 0.0, 1.0, "", runs, runs)).agrees == expected


@pytest.mark.parametrize(("low", "printed"), [(0.0, 10.0), (9.0, 0.0), (9.0, -1.0)])
def test_without_a_scale_nothing_is_decided(low, printed):
    assert Verdict("case", dataclasses.replace(FIGURE, value=printed), None, Score(10.0, low, 11.0, "m", 9, 9)).agrees is None


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_published_value_is_a_number(value):
    with pytest.raises(ValueError, match="'position error' of kalman must be a number or None"):
        dataclasses.replace(FIGURE, value=value)


def test_repetitions_of_an_experiment_agree_at_the_stated_rate():
    """Root mean square errors of exponential squares, theirs of 25 runs and ours of 100: 95 of 100 pairs agree.

    The band is five standard deviations of a binomial about 0.95, wider by 0.02 since t and logarithm are approximations.
    """
    rng, pairs = generators(1, "repetitions").of([0]), 2000
    squares = -np.log(rng.random((125, 1, pairs)))[:, 0]
    count = 0
    for theirs, ours in zip(squares[:25].T, squares[25:].T, strict=True):
        score = METRICS["rmse"].score(ours[None], "m", 100)
        count += bool(
            Verdict("", dataclasses.replace(FIGURE, value=float(np.sqrt(theirs.mean())), runs=25), None, score).agrees
        )
    assert abs(count / pairs - 0.95) < 0.02 + 5 * np.sqrt(0.95 * 0.05 / pairs)


@pytest.mark.parametrize(
    ("recorded", "value", "broken"),
    [(REPRODUCED, 10.0, False), (REPRODUCED, 20.0, True), (REPRODUCED, 10.18, False),
     (NOT_REPRODUCED, 20.0, False), (NOT_REPRODUCED, 10.0, True),
     (NOT_COMPARABLE, 20.0, False), (NOT_COMPARABLE, 10.0, False), (None, 20.0, False)],
)  # fmt: skip
def test_results_break_a_verdict_that_they_contradict(recorded, value, broken):
    """Figures are 1.41 % apart at most where they agree; the record is of as many runs."""
    finding = Finding(recorded, "because", runs=100) if recorded else None
    score = Score(value, 0.99 * value, 1.01 * value, "m", 100, 100)
    assert Verdict("case", FIGURE, finding, score).broken == broken
    assert not Verdict("case", FIGURE, finding, None).broken
    assert not Verdict("case", FIGURE, finding, dataclasses.replace(score, runs=99)).broken, "of fewer runs than the record"
    assert not Verdict("case", dataclasses.replace(FIGURE, value=None), finding, score).broken, "a claim"


def test_verify_prints_the_verdicts_and_exits_1_when_one_is_broken(cli, inline, tmp_path, monkeypatch):
    """The error of the Kalman filter is about 8 m: it agrees with 8.0 recorded as such, and not with 80."""
    results = tmp_path / "results"
    plugin = tmp_path / "plugin.py"
    plugin.write_text(PLUGIN)
    assert cli("run", "--plugin", plugin, "-c", "printed", "-e", "kalman", "--runs", 12, "--results", results).code == 0
    for verdict, code in ((NOT_REPRODUCED, 0), (REPRODUCED, 1)):
        recorded = {
            ("printed", "kalman", "near"): Finding(REPRODUCED, "so"),
            ("printed", "kalman", "far"): Finding(verdict, "so"),
        }
        monkeypatch.setattr(suite.cli.cases, "FINDINGS", recorded)
        said = cli("verify", "--results", results)
        assert said.code == code
        assert "agrees" in said.out
        assert "differs" in said.out
        assert "2 published figures and claims, 2 measured here: 1 agree, 1 differ" in said.out
        assert len(said.errors) == code
    assert said.errors == ["filterbench: printed, kalman, far: recorded as reproduced, but these results do not agree"]


@pytest.mark.parametrize(
    "table",
    ['verdict = "perhaps"\nreason = "so"', 'verdict = "reproduced"', 'verdict = "reproduced"\nreason = "so"\nour = 1',
     'verdict = "reproduced"\nreason = "so"\n[[finding]]\ncase = "a"\nestimator = "b"\nquantity = "c"'],
)  # fmt: skip
def test_a_finding_that_is_not_sound_is_named(tmp_path, table):
    path = tmp_path / "findings.toml"
    path.write_text(f'[[finding]]\ncase = "a"\nestimator = "b"\nquantity = "c"\n{table}\n')
    with pytest.raises(ValueError, match=r"findings\.toml: the finding on \('a', 'b', 'c'\) is not sound"):
        findings(path)


def test_every_published_figure_has_its_finding_and_every_finding_its_figure():
    keys = [(name, p.estimator, p.quantity) for name, p in ALL]
    assert len(set(keys)) == len(keys)
    assert set(keys) == set(FINDINGS)
    assert all(found.verdict in VERDICTS for found in FINDINGS.values())


@pytest.mark.parametrize(("name", "published"), ALL, ids=[f"{name}-{i}" for i, (name, _) in enumerate(ALL)])
def test_a_published_figure_can_be_measured_or_is_not_called_reproduced(name, published):
    """An estimator of ours goes by its label, a metric by its name and a block that the case has; the paper profile runs it."""
    case, stem = CASES[name], published.estimator.partition("[")[0]
    if published.metric and stem in ESTIMATORS:
        assert parameters.label(ESTIMATORS[published.estimator]) == published.estimator
        assert published.metric in METRICS
        block, _, where = published.block.partition(", ")
        assert block in [b.name for b in case.blocks] or published.metric in ("eta", "divergence")
        assert not where or where in [f"{side} {r.name}" for r in case.regions for side in ("inside", "outside")]
        assert case.experiment is not None
        assert published.estimator in case.experiment.estimators
    elif published.value is not None:
        assert FINDINGS[name, published.estimator, published.quantity].verdict != REPRODUCED


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.experiment])
def test_an_experiment_names_estimators_that_accept_the_case(name):
    case = CASES[name]
    assert case.experiment.runs > 0
    for label in case.experiment.estimators:
        estimator = ESTIMATORS[label]
        assert parameters.label(estimator) == label
        assert estimator.accepts(told(estimator, case.model)) is None
