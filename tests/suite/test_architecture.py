"""Imports point one way, files stay short, what is public is documented."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("suite", "estimators", "cases", "reports")
ALLOWED = {package: {"suite", package} for package in PACKAGES}
TOP = {ROOT / "suite" / "cli.py", ROOT / "suite" / "__main__.py"}
"""The files that bring all packages together."""
FILES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
LONGEST = 300
FILTER = {"accepts", "accepts_mode", "init", "step", "read", "runs_at_once", "run", "rule"}
"""Methods that are documented once, in the base classes."""


def imported(tree: ast.AST) -> Iterator[str]:
    """Top-level names of all modules that a source imports, wherever in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield str(node.module).partition(".")[0]


def public(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Public functions and classes of a module, and public methods of its classes."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from (n for n in node.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    allowed = set(PACKAGES) if path in TOP else ALLOWED[package]
    ours = set(imported(ast.parse(path.read_text(encoding="utf-8")))) & set(PACKAGES)
    assert ours <= allowed, f"{path.relative_to(ROOT)} imports {sorted(ours - allowed)}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_what_is_public_is_documented(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inherited = FILTER if path.is_relative_to(ROOT / "estimators") else set()
    bare = [node.name for node in public(tree) if not ast.get_docstring(node) and node.name not in inherited]
    assert not bare, f"{path.relative_to(ROOT)}: no docstring on {bare}"
    assert ast.get_docstring(tree), f"{path.relative_to(ROOT)} does not say what it is"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_stay_short(path: Path) -> None:
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= LONGEST, f"{path.relative_to(ROOT)} has {lines} lines; take it apart along its parts (at most {LONGEST})"


def test_all_packages_are_looked_at() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in FILES} >= {"suite", "estimators", "cases"}
