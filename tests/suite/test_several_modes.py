"""Cases with several modes from end to end: who is told what, what is stored, and what is said of it."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite.estimator import told
from suite.results import load
from suite.work import compute

CASE = CASES["jump-linear"]
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
    assert re.findall(r'class="name">(\S+?)</span><span class="under">told the mode straight alone', page) == ["kalman"]
    assert "straight (nominal), manoeuvre" in page


def test_a_case_with_modes_of_a_wrong_shape_is_named():
    truth = CASE.simulate(2)
    wrong = replace(CASE, generate=lambda rng: replace(truth, mode=truth.mode[:-1]))
    with pytest.raises(ValueError, match=r"case jump-linear: mode has shape \(11, 2\), not \(12, 2\)"):
        wrong.simulate(2)
