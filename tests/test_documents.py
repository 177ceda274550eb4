"""The README and the contributor's guide hold what they say: their files run as plug-ins, their commands as written."""

import re
import shlex
from pathlib import Path

import numpy as np
import pandas
import pytest

from estimators.ekf import Extended
from suite.case import RECORDED
from suite.cli import main
from suite.description import KINDS, MOTIONS, TIME
from suite.metrics import METRICS
from suite.recording import load
from suite.section import ANGLE, LENGTH, SPEED

ROOT = Path(__file__).parents[1]


def blocks(document: str) -> list[tuple[str, str, str]]:
    """Fenced blocks of a document: (language, file name or '', text)."""
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(r"^```(\w+) ?(\S*)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def write_track(folder: Path) -> None:
    """A recording with the columns that the README asks for, and a gap in it."""
    rng = np.random.default_rng(0)
    true = np.cumsum(np.tile([3.0, 1.0], (40, 1)) + rng.normal(size=(40, 2)), axis=0)
    fixes = true + 5 * rng.normal(size=true.shape)
    fixes[10:13] = np.nan
    frame = pandas.DataFrame(np.round(np.hstack([fixes, true]), 2), columns=["x", "y", "true_x", "true_y"])
    frame.to_csv(folder / "my_track.csv", index=False)


@pytest.mark.long
@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md"])
def test_commands_run_as_written(document, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write_track(tmp_path)
    commands = []
    for language, name, text in blocks(document):
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
        if language == "sh":
            commands += [line for line in text.splitlines() if line.startswith("filterbench ")]
    assert len(commands) >= 4
    for command in commands:
        assert main(shlex.split(command)[1:]) == 0, command
    out, err = capfd.readouterr()
    if document == "README.md":
        assert re.search(r"harbour, seed 1.*ekf *│ rmse:position *│ [\d.]+ m .*whiteness:innovation *│ [\d.]+ ", out, re.DOTALL)
    assert "failed" not in err
    assert ("alpha-beta" if document == "README.md" else "enkf[members=20]") in out


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    """The README's recording in a folder, its description changed; the path of that."""
    texts = {name: text for _, name, text in blocks("README.md") if name.startswith("harbour")}
    assert set(texts) == {"harbour.toml", "harbour.csv", "harbour_truth.csv"}
    for old, new in changes:
        assert texts["harbour.toml"].count(old) == 1
        texts["harbour.toml"] = texts["harbour.toml"].replace(old, new)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "harbour.toml"


def test_the_recording_of_the_readme_is_what_it_says(tmp_path):
    case = load(written(tmp_path))
    assert case.origin == RECORDED
    assert np.diff(case.time).max() > 30
    assert case.landmarks[0][0] == "radar"
    truth = case.simulate(1)
    assert np.isfinite(truth.x[:, :2]).all()
    assert np.isnan(truth.x[:, 2:]).all()
    found = Extended().run(case.model, truth.y, 0)
    # The GPS is good to 3 m on each axis; in half a minute without any the launch may be a few times that off.
    assert np.sqrt(((found.mean - truth.x)[:, :2] ** 2).sum(1)).max() < 15
    names = "rmse", "nis", "whiteness", "loglik"
    unknown = load(written(tmp_path, ('truth = "harbour_truth.csv"', "")))
    scores = [METRICS[name](unknown, unknown.simulate(1), found) for name in names]
    assert [[score.runs for score in by_block.values()] for by_block in scores] == [[0, 0, 0, 0], [1], [1], [1]]


def test_kinds_and_units_of_the_readme_are_the_ones_there_are():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (sensors,) = re.findall(r"^- \*\*Sensors\*\*(.*?);", text, flags=re.MULTILINE | re.DOTALL)
    assert set(re.findall(r"`(.*?)`", sensors)) == set(KINDS)
    (units,) = re.findall(r"stands with its unit: (.*?)\.", text, flags=re.DOTALL)
    groups = [group.split(", ") for group in " ".join(units.split()).split("; ")]
    assert groups == [[*LENGTH], [*ANGLE], [*SPEED]]
    (kinds,) = re.findall(r'^kind = "constant-velocity" *# or (.*)$', text, flags=re.MULTILINE)
    assert {"constant-velocity", *kinds.split(", ")} == set(MOTIONS)
    (times,) = re.findall(r'^time = "s" *# or (.*)$', text, flags=re.MULTILINE)
    assert {"s", *times.split(", ")} == set(TIME)


def test_notebook_lines_run_as_written(capsys):
    (text,) = [text for language, name, text in blocks("README.md") if language == "python" and not name]
    exec(compile(text, "README.md", "exec"), {})
    assert re.search(r"[\d.]+ m \[[\d.]+, [\d.]+\] \(20 of 20 runs\)", capsys.readouterr().out)
