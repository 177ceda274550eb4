"""The README and the contributor's guide hold what they say: their files run as plug-ins, their commands as written."""

import re
import shlex
from pathlib import Path

import numpy as np
import pandas
import pytest

from suite.cli import main

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
    assert "failed" not in err
    assert ("alpha-beta" if document == "README.md" else "enkf[members=20]") in out


def test_notebook_lines_run_as_written(capsys):
    (text,) = [text for language, name, text in blocks("README.md") if language == "python" and not name]
    exec(compile(text, "README.md", "exec"), {})
    assert re.search(r"[\d.]+ m \[[\d.]+, [\d.]+\] \(20 of 20 runs\)", capsys.readouterr().out)
