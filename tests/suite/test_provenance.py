"""Fingerprints of sources, of plug-ins above all; versions and the machine."""

import importlib
import json
import sys

import pytest

from suite import provenance
from suite.provenance import fingerprint


@pytest.fixture(autouse=True)
def fresh():
    fingerprint.cache_clear()
    yield
    fingerprint.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Write a package of modules and make it importable."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(**sources):
        folder = tmp_path / "fbt_package"
        folder.mkdir(exist_ok=True)
        for name, text in {"__init__": "", **sources}.items():
            (folder / f"{name}.py").write_text(text)
        for name in [n for n in sys.modules if n.partition(".")[0] == "fbt_package"]:
            monkeypatch.delitem(sys.modules, name)
        importlib.invalidate_caches()
        fingerprint.cache_clear()
        return fingerprint("fbt_package.filters")

    return write


def test_what_a_module_imports_from_its_package_enters(package):
    for line in ("from fbt_package import maths", "import fbt_package.maths", "from .maths import x", "from . import maths"):
        before = package(filters=line, maths="x = 1")
        assert package(filters=line, maths="x = 1") == before
        assert package(filters=line, maths="x = 2") != before, line


def test_an_import_within_a_function_enters(package):
    before = package(filters="def f():\n    from fbt_package.maths import x\n", maths="x = 1")
    assert package(filters="def f():\n    from fbt_package.maths import x\n", maths="x = 2") != before


def test_what_it_does_not_import_does_not_enter(package):
    before = package(filters="import math", other="x = 1")
    assert package(filters="import math", other="x = 2") == before


def test_a_file_without_a_version_enters_by_its_source(package, tmp_path):
    """A module beside a plug-in, of no distribution."""
    (tmp_path / "fbt_helper.py").write_text("x = 1")
    before = package(filters="import fbt_helper")
    (tmp_path / "fbt_helper.py").write_text("x = 2")
    assert package(filters="import fbt_helper") != before


def test_a_library_enters_by_its_version(package, monkeypatch):
    real = provenance.version
    before = package(filters="import pebble")
    monkeypatch.setattr(provenance, "version", lambda name: "0" if name == "pebble" else real(name))
    assert package(filters="import pebble") != before


def test_the_place_of_a_data_file_does_not_enter_but_its_contents_do(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "track.csv").write_text("1,2")
    one, other = (fingerprint("suite.case", data=(tmp_path / n / "track.csv",)) for n in ("a", "b"))
    assert one == other != fingerprint("suite.case")


def test_versions_and_host_are_plain_data():
    versions = provenance.versions()
    assert {"python", "numpy", "filterbench"} <= versions.keys()
    assert all(v and v != "unknown" for v in versions.values())
    host = provenance.host()
    assert set(host) == {"system", "processor", "node"}
    json.dumps([versions, host])
