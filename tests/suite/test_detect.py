"""The command that prints operating points, on detectors that are run for it."""

import csv
import io
import json

import pytest

NAMES = ("auc", "pauc", "detection-rate", "detection-delay")
CASE = "manoeuvre-detection/naval-loose"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("detectors")


@pytest.fixture
def stored(cli, inline, folder, monkeypatch):
    """Results of detectors on a case, and of two of them on its twin; of a filter that detects nothing too."""
    if not any(folder.iterdir()):
        common = ("--runs", 10, "--block", 10, "--results", folder)
        assert cli("run", "-e", "imm-ekf", "pf-cusum", "nis-chi2", "ekf", "-c", CASE, *common).code == 0
        assert cli("run", "-e", "imm-ekf", "nis-chi2", "-c", f"{CASE}-straight", *common).code == 0
    return folder


def test_detect_prints_the_operating_points_of_every_detector(cli, stored):
    said = cli("detect", "--results", stored)
    assert (said.code, said.errors) == (0, [])
    assert "Nothing is stored of pf-cusum on manoeuvre-detection/naval-loose-straight: run that too" in said.out
    rows = [[part.strip() for part in line.split("│")[1:-1]] for line in said.out.splitlines() if line.startswith("│")]
    assert {(row[0], row[1]) for row in rows} == {
        (label, level) for label in ("imm-ekf", "nis-chi2", "pf-cusum") for level in ("0.1", "0.2", "0.5")
    }
    for row in rows:
        assert row[-1] == ("before manoeuvres" if row[0].startswith("pf") else "10 of the twin")
        assert (row[4] == row[6] == "") == row[0].startswith("pf")


def test_detect_prints_csv_and_json(cli, stored):
    chosen = ("--results", stored, "-e", "nis-chi2", "-c", CASE, "--level", "0.5", "0.1")
    table = list(csv.DictReader(io.StringIO(cli("detect", *chosen, "--format", "csv").out)))
    found = json.loads(cli("detect", *chosen, "--format", "json").out)
    assert [(row["level"], row["threshold"]) for row in found] == [
        (float(row["level"]), pytest.approx(float(row["threshold"]))) for row in table
    ]
    assert [row["level"] for row in found] == [0.5, 0.1]
    assert found[0]["twin"] == f"{CASE}-straight"
    assert found[0]["threshold"] < found[1]["threshold"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["-c", f"{CASE}-straight"],
            "nothing has both a decision statistic and manoeuvres; run detectors on such a case",
        ),
        (["-e", "ekf"], "-c manoeuvre-detection/naval manoeuvre-detection/naval-straight`"),
        (["--level", "0.01"], "level of 0.01 needs 99 runs without manoeuvres, there are 10; run more, or name a higher level"),
        (["--level", "10%"], "argument --level: must be between 0 and 1, got '10%'"),
        (["--level", "1"], "argument --level: must be between 0 and 1, got '1'"),
        (["-e", "imm"], "no stored estimator matches 'imm'"),
    ],
)
def test_what_cannot_be_detected_gives_one_line(cli, stored, arguments, words):
    said = cli("detect", "--results", stored, *arguments)
    assert said.code == 2
    assert len(said.errors) == 1
    assert words in said.errors[0]


def test_the_twin_is_found_in_the_store(cli, stored):
    rows = json.loads(cli("score", "--results", stored, "-c", CASE, "-m", *NAMES, "--format", "json").out)
    held = {(row["estimator"], row["metric"]) for row in rows if row.get("metric") and row["block"] == "manoeuvre"}
    both = {"imm-ekf", "nis-chi2"}
    areas = {(label, name) for label in (*both, "pf-cusum") for name in ("auc", "pauc")}
    assert held == areas | {(label, name) for label in both for name in ("detection-rate", "detection-delay")}
