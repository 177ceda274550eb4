"""Entries from outside: plug-in files and installed packages, sound ones and others."""

import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest

PLUGINS = Path(__file__).resolve().parents[1] / "plugins"
TINY = PLUGINS / "tiny.py"
ESTIMATOR = """
class Mine:
    name, reference = "mine", ""
    def accepts(self, model):
        return None
    def run(self, model, y, seed=0):
        return None
"""
CASE = f"""
import importlib.util
spec = importlib.util.spec_from_file_location("filterbench_tests_tiny", {str(TINY)!r})
tiny = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tiny)
import dataclasses
"""


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("def (", "does not import: SyntaxError"),
        ("import no_such_module", "does not import: ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise ValueError('two\\nlines')", "does not import: ValueError: two lines"),
        ("import sys; sys.exit(3)", "does not import: SystemExit: 3"),
        ("x = '\\0'\nx.y", "does not import: AttributeError"),
        ("", "defines neither ESTIMATORS nor CASES; list its entries in such a tuple"),
        ("ESTIMATORS = ()", "defines neither ESTIMATORS nor CASES"),
        (ESTIMATOR + "ESTIMATORS = Mine()", "ESTIMATORS must be a tuple of entries, got Mine"),
        (ESTIMATOR + "ESTIMATORS = {Mine()}", "ESTIMATORS must be a tuple of entries, got set"),
        (ESTIMATOR + "ESTIMATORS = (Mine,)", "ESTIMATORS holds the class Mine, not an instance"),
        ("ESTIMATORS = (3,)", "ESTIMATORS holds an entry of type int without a readable 'name'"),
        ("class A:\n    name = reference = ''\n    accepts = None\nESTIMATORS = (A(),)", "without a readable 'run'"),
        (ESTIMATOR + "ESTIMATORS = (Mine(), Mine())", "two estimators are named 'mine'; rename one"),
        (ESTIMATOR + "Mine.name = 'kalman'\nESTIMATORS = (Mine(),)", "two estimators are named 'kalman'; rename one"),
        (ESTIMATOR + "Mine.name = 'my filter'\nESTIMATORS = (Mine(),)", "the name 'my filter' must consist of"),
        (ESTIMATOR + "Mine.name = 'mine[a=1]'\nESTIMATORS = (Mine(),)", "the name 'mine[a=1]' must consist of"),
        (ESTIMATOR + "Mine.name = ''\nESTIMATORS = (Mine(),)", "the name '' must consist of"),
        (ESTIMATOR + "Mine.name = 7\nESTIMATORS = (Mine(),)", "the name 7 must consist of"),
        (ESTIMATOR + "Mine.reference = None\nESTIMATORS = (Mine(),)", "the reference of mine must be text, got None"),
        (
            "from dataclasses import dataclass\n" + ESTIMATOR.replace("class", "@dataclass\nclass")
            + "    rule: list = None\nESTIMATORS = (Mine(),)",
            "rule is a parameter of type <class 'list'>; use int, float, bool or str",
        ),
        (
            "from __future__ import annotations\nfrom dataclasses import dataclass\n"
            + ESTIMATOR.replace("class", "@dataclass\nclass") + "    gain: Number = 1\nESTIMATORS = (Mine(),)",
            "the parameters of mine have no types: NameError",
        ),
        (
            "from dataclasses import dataclass\nfrom suite.parameters import parameter\n"
            + ESTIMATOR.replace("class", "@dataclass\nclass")
            + "    gain: float = parameter(2.0, 'a gain', high=1)\nESTIMATORS = (Mine(),)",
            "mine: gain must be at most 1, got 2.0",
        ),
        (
            "class A:\n    reference = ''\n    accepts = run = None\n    name = property(lambda s: 1 / 0)\nESTIMATORS = (A(),)",
            "without a readable 'name': ZeroDivisionError",
        ),
        (
            "from dataclasses import dataclass\n" + ESTIMATOR.replace("class", "@dataclass\nclass") + "    gain: 'int |' = 3\n"
            "ESTIMATORS = (Mine(),)",
            "the parameters of mine have no types: SyntaxError",
        ),
        ("CASES = (3,)", "CASES holds 3, which is not a suite.case.Case"),
        (CASE + "CASES = tiny.CASES[0]", "CASES must be a tuple of entries, got Case"),
        (CASE + "CASES = tiny.CASES * 2", "two cases are named 'tiny'; rename one"),
        (CASE + "CASES = (dataclasses.replace(tiny.CASES[0], name='a//b'),)", "the name 'a//b' must consist of"),
        (CASE + "CASES = (dataclasses.replace(tiny.CASES[0], steps=0),)", "ValueError: case tiny: steps must be"),
        (CASE + "CASES = (dataclasses.replace(tiny.CASES[0], data=('track.csv',)),)", "data of case tiny must be paths"),
        (CASE + "CASES = (dataclasses.replace(tiny.CASES[0], plane={0, 1}),)", "case tiny holds what is not plain data"),
    ],
    ids=lambda value: re.sub(r"\W+", "-", value)[-40:],
)  # fmt: skip
def test_a_plugin_that_cannot_be_used_gives_one_line(cli, tmp_path, source, words):
    path = tmp_path / "plugin.py"
    path.write_text(source)
    said = cli("run", "--plugin", path, "--results", tmp_path / "results")
    assert said.code == 2
    assert len(said.errors) == 1, said.errors
    assert said.errors[0].startswith(f"filterbench: plug-in {path}")
    assert words in said.errors[0]
    assert not (tmp_path / "results").exists()


def test_paths_that_are_no_plugin(cli, tmp_path):
    (tmp_path / "plugin.txt").write_text("ESTIMATORS = ()")
    for path, words in (
        (tmp_path / "none.py", "is no file"),
        (tmp_path, "is no file"),
        (tmp_path / "plugin.txt", "is not a Python file"),
    ):
        said = cli("list", "--plugin", path)
        assert (said.code, said.errors) == (2, [f"filterbench: plug-in {path} {words}"])


def test_a_plugin_twice_is_once(cli):
    said = cli("list", "estimators", "last", "--plugin", TINY, "--plugin", TINY)
    assert (said.code, said.errors) == (0, [])


def test_the_same_plugin_by_two_paths(cli, monkeypatch):
    monkeypatch.chdir(PLUGINS)
    said = cli("list", "estimators", "last", "--plugin", "tiny.py", "--plugin", TINY)
    assert said.code == 0


def test_relative_paths_and_odd_names(cli, inline, tmp_path, monkeypatch):
    folder = tmp_path / "my plug-ins é"
    folder.mkdir()
    shutil.copy(TINY, folder / "2 tiny filters.py")
    monkeypatch.chdir(folder)
    said = cli("run", "--plugin", "2 tiny filters.py", "-c", "tiny", "-e", "last", "--runs", 1, "--results", "out put")
    assert (said.code, said.errors) == (0, [])
    assert cli("score", "--results", "out put").code == 0


def test_two_plugins_of_one_file_name(cli, inline, tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "plugin.py").write_text(ESTIMATOR.replace("mine", name) + "ESTIMATORS = (Mine(),)")
    said = cli("list", "estimators", "--plugin", tmp_path / "one" / "plugin.py", "--plugin", tmp_path / "two" / "plugin.py")
    assert said.code == 0
    assert re.search(r"\bone\b", said.out)
    assert re.search(r"\btwo\b", said.out)


def test_a_plugin_that_moves_keeps_its_results(cli, inline, tmp_path):
    arguments = ("-c", "tiny", "-e", "last", "--runs", 2, "--results", tmp_path / "results")
    assert cli("run", "--plugin", TINY, *arguments).code == 0
    moved = tmp_path / "moved.py"
    shutil.copy(TINY, moved)
    assert "0 blocks to run" in cli("run", "--plugin", moved, *arguments).out
    moved.write_text(TINY.read_text() + "# changed\n")
    shutil.move(moved, tmp_path / "changed.py")
    assert "4 blocks to run" in cli("run", "--plugin", tmp_path / "changed.py", *arguments).out


def test_parameters_of_a_plugin(cli):
    assert "gain=0.5  weight of a new measurement" in cli("list", "estimators", "smoothed", "--plugin", TINY).out
    said = cli("run", "--plugin", TINY, "-e", "smoothed[gain=2]")
    assert (said.code, said.errors) == (2, ["filterbench: smoothed: gain must be at most 1, got 2.0"])


def test_an_estimator_that_does_not_say_what_it_accepts(cli, tmp_path):
    path = tmp_path / "plugin.py"
    path.write_text(ESTIMATOR.replace("return None", "return 1 / 0", 1) + "ESTIMATORS = (Mine(),)")
    said = cli("run", "--plugin", path, "-e", "mine", "-c", "linear-gaussian", "--dry-run", "--results", tmp_path / "results")
    assert said.code == 2
    assert said.errors == [
        "filterbench: mine: accepts raised for the model of linear-gaussian: ZeroDivisionError: division by zero"
    ]  # fmt: skip


# Installed packages.


@pytest.fixture
def site(tmp_path):
    """A folder as `pip install` leaves it: a package, and the metadata with its entry points."""
    shutil.copytree(PLUGINS / "package", tmp_path / "site")
    return tmp_path / "site"


def test_an_installed_package(site, shell, cli, tmp_path):
    """Its entry points bring an estimator and a case, in every command and in the workers."""
    env = {"PYTHONPATH": os.pathsep.join([str(site), str(Path(__file__).resolve().parents[2])])}
    said = shell(
        "run", "-c", "packaged-case", "-e", "packaged", "kalman", "--runs", 2, "--results", tmp_path / "results",
        env=env, cwd=tmp_path,
    )  # fmt: skip
    assert (said.code, said.errors) == (0, [])
    assert not re.search(r"[\x1b\r]", said.out), "no colours and no bar where there is no terminal"
    said = cli("score", "--format", "json", "-m", "rmse", "--results", tmp_path / "results")
    assert {r["estimator"] for r in json.loads(said.out)} == {"packaged", "kalman"}


def test_an_installed_package_is_listed_and_named_when_it_fails(site, cli, inline, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(site)
    assert "packaged" in cli("list", "estimators", "pack*").out
    assert "packaged-case" in cli("list", "cases", "pack*").out
    said = cli("run", "-c", "packaged-case", "-e", "packaged[fails=true]", "--runs", 2, "--results", tmp_path / "results")
    assert said.code == 2
    assert said.errors == [
        "filterbench: packaged[fails=True] on packaged-case (plug-in fbt_packaged (fbt_packaged.filters)): "
        "2 of 2 runs failed or were lost; RuntimeError: told to fail"
    ]


def test_an_installed_package_that_does_not_import(site, cli, monkeypatch):
    entry_points = next(site.glob("*.dist-info")) / "entry_points.txt"
    entry_points.write_text("[filterbench.cases]\nlost = no_such_package.cases\n")
    monkeypatch.syspath_prepend(site)
    said = cli("list")
    assert said.code == 2
    assert said.errors == [
        "filterbench: plug-in lost (no_such_package.cases) does not import: "
        "ModuleNotFoundError: No module named 'no_such_package'"
    ]


@pytest.fixture(autouse=True)
def forget():
    """Packages of one test are not those of the next."""
    yield
    for name in [n for n in sys.modules if n.partition(".")[0] == "fbt_packaged"]:
        del sys.modules[name]
