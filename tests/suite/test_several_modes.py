"""Cases with several modes from end to end: who is told what, what is stored, and what is said of it."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas
import pyarrow
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite import store
from suite.case import Card, Case
from suite.estimator import told
from suite.results import load
from suite.work import compute

CASE = CASES["jump-linear"]
TO_DICT = Card.to_dict
RUN = ("-c", "jump-linear", "-e", "kalman", "imm-ekf")


def test_an_estimator_of_one_model_is_told_the_nominal_mode():
    y = CASE.simulate(3).y
    kalman = ESTIMATORS["kalman"]
    assert told(kalman, CASE.model) is CASE.model.modes[0]
    assert told(kalman, replace(CASE.model, nominal=1)) is CASE.model.modes[1]
    whole, mode = kalman.run(CASE.model, y), kalman.run(CASE.model.modes[0], y)
    np.testing.assert_array_equal(whole.mean, mode.mean)
    np.testing.assert_array_equal(compute(CASE, kalman, 0, 0, 3).estimate.mean, mode.mean)
    assert whole.mode is None


def test_a_filter_of_modes_is_told_all_of_them():
    imm = ESTIMATORS["imm-ekf"]
    assert told(imm, CASE.model) is CASE.model
    assert imm.run(CASE.model, CASE.simulate(3).y).mode.shape == (CASE.steps, 2, 3)
    assert imm.accepts(CASE.model.modes[0]) == "the model has a single mode"


def test_the_card_names_the_modes():
    assert (CASE.modes, CASE.nominal) == (("straight", "manoeuvre"), "straight")
    other = replace(CASE, model=replace(CASE.model, nominal=1))
    assert (other.modes, other.nominal) == (("straight", "manoeuvre"), "manoeuvre")
    assert (CASES["linear-gaussian"].modes, CASES["linear-gaussian"].nominal) == ((), "")


def test_modes_and_statistics_are_stored_bit_for_bit(tiny, tmp_path):
    assert tiny(*RUN).code == 0
    cells = load(tmp_path / "results").cases["jump-linear"].cells
    truth = CASE.simulate(4, seed=1)
    direct = compute(CASE, ESTIMATORS["imm-ekf"], 1, 0, 4).estimate
    imm, kalman = cells["imm-ekf"], cells["kalman"]
    np.testing.assert_array_equal(imm.truth.mode, truth.mode)
    np.testing.assert_array_equal(imm.estimate.mode, direct.mode)
    np.testing.assert_array_equal(imm.estimate.statistic, direct.statistic)
    assert (kalman.estimate.mode, kalman.estimate.statistic) == (None, None)
    assert (imm.meta["told"], kalman.meta["told"]) == ("", "straight")
    assert kalman.case.card.modes == ("straight", "manoeuvre")


def test_pandas_reads_modes(tiny, tmp_path):
    assert tiny(*RUN).code == 0
    frame = pandas.read_parquet(tmp_path / "results")
    assert set(frame[frame.kind == "truth"].true_mode) == {0, 1}
    modes = np.stack(frame[frame.estimator == "imm-ekf"].query("kind == 'estimate'")["mode"])
    np.testing.assert_allclose(modes.sum(1), 1, rtol=1e-12)


def test_scores_and_pages_say_who_was_told_the_nominal_mode(tiny, cli, tmp_path):
    assert tiny(*RUN).code == 0
    records = json.loads(cli("score", "--results", tmp_path / "results", "--format", "json").out)
    assert {(r["estimator"], r["told"]) for r in records} == {("kalman", "straight"), ("imm-ekf", "")}
    said = cli("score", "--results", tmp_path / "results", "-m", "rmse").out
    assert "kalman (told the mode straight alone)" in said
    assert "imm-ekf (" not in said
    assert cli("report", "--results", tmp_path / "results", "--out", tmp_path / "site").code == 0
    overview = (tmp_path / "site" / "index.html").read_text()
    assert overview.count("told the nominal mode, straight, alone") >= 1
    (page,) = (p.read_text() for p in (tmp_path / "site").rglob("*jump*.html"))
    assert re.findall(
        r'<th scope="row">(?:(?!</th>).)*?>([^<>\s]+)</a>(?:(?!</th>).)*told the mode straight alone', page, re.S
    ) == ["kalman"]
    assert "straight (nominal), manoeuvre" in page
    assert "Brier score of the mode probabilities over time" in page
    assert '<figure id="brier"' in page


def test_a_case_with_modes_of_a_wrong_shape_is_named():
    truth = CASE.simulate(2)
    wrong = replace(CASE, generate=lambda rng: replace(truth, mode=truth.mode[:-1]))
    with pytest.raises(ValueError, match=r"case jump-linear: mode has shape \(11, 2\), not \(12, 2\)"):
        wrong.simulate(2)


@pytest.mark.parametrize("value", [2, -1, 0.5, np.nan])
def test_modes_that_the_model_does_not_have_are_named(value):
    truth = CASE.simulate(2)
    wrong = replace(CASE, generate=lambda rng: replace(truth, mode=np.full(truth.mode.shape, value)))
    with pytest.raises(ValueError, match="case jump-linear: mode holds other numbers than indices of its 2 modes"):
        wrong.simulate(2)


def test_a_case_of_one_model_has_no_modes():
    case = CASES["linear-gaussian"]
    truth = case.simulate(2)
    wrong = replace(case, generate=lambda rng: replace(truth, mode=np.zeros((case.steps, 2), int)))
    with pytest.raises(ValueError, match="indices of its 0 modes"):
        wrong.simulate(2)


def test_results_of_before_there_were_modes_can_be_read(tiny, cli, tmp_path, monkeypatch):
    """Cards without modes, blocks without the columns that came with them."""
    new = ("true_mode", "statistic", "mode")
    with monkeypatch.context() as patch:
        patch.setattr(store, "SCHEMA", pyarrow.schema([field for field in store.SCHEMA if field.name not in new]))
        patch.setattr(Case, "to_dict", lambda self: {k: v for k, v in TO_DICT(self).items() if k not in ("modes", "nominal")})
        assert tiny("-e", "kalman").code == 0
    said = cli("score", "--results", tmp_path / "results", "--format", "json")
    assert (said.code, said.errors) == (0, [])
    assert {(r["estimator"], r["told"]) for r in json.loads(said.out)} == {("kalman", "")}
    assert cli("report", "--results", tmp_path / "results", "--out", tmp_path / "site").code == 0
    assert tiny("-e", "kalman", "ukf").code == 0  # and added to
    assert cli("score", "--results", tmp_path / "results").code == 0
