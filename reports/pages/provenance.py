"""The provenance page: which commands, sources, versions and machines the results came from, and what went wrong."""

import platform
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from typing import Any

from reports.frame import Frame
from reports.inputs import Site
from reports.part import LIBRARIES, Part
from reports.plot import Column, table_csv
from reports.views import CaseView, CellView
from suite.plan import ESTIMATE, PROFILES, TIMING, TRUTH
from suite.results import Results

BLOCKS = "data/provenance-blocks.csv"
"""The file that lists all blocks."""
FEW = 20
"""So many failures are not folded away."""
NAMED = 3
"""Reasons of a cell that stand in the table; the others are counted."""


def parts(site: Site) -> Iterator[Part]:
    """The page of where the numbers come from."""
    loaded, command = site.inputs.loaded, site.inputs.command
    blocks = [(entry.meta["address"], entry.meta["created"]) for entry in loaded.entries]
    damages = [(str(d.path), d.reason) for d in loaded.damages]
    made_by = versions()
    depends = site.depends(blocks, damages, loaded.superseded, str(loaded.folder), command, made_by)
    yield Part("provenance", depends, files, (site.frame, loaded, site.cases, command, made_by))


def versions() -> dict[str, str]:
    """Versions of what draws the pages."""
    return {"python": platform.python_version()} | {name: version(name) for name in ("filterbench", *LIBRARIES)}


def files(frame: Frame, loaded: Results, cases: Sequence[CaseView], command: str, made_by: dict[str, str]) -> dict[str, str]:
    """The page, and the list of all blocks."""
    said = context(loaded, cases)
    page = frame.page("provenance", **said, command_of_site=command, made_by=made_by, data=BLOCKS)
    return {"provenance.html": page, **({BLOCKS: table_csv(_blocks(loaded))} if loaded.entries else {})}


def context(loaded: Results, cases: Sequence[CaseView]) -> dict[str, Any]:
    """What the template of the provenance page needs."""
    metas = [entry.meta for entry in loaded.entries]
    created = sorted(str(meta["created"]) for meta in metas)
    commands = _counted(str(meta.get("command", "")) for meta in metas)
    failed = [(case.card.name, cell) for case in cases for cell in case.cells.values() if cell.failures]
    return {
        "commands": [(text, profile(text), n) for text, n in commands],
        "seeds": _counted(str(meta["seed"]) for meta in metas),
        "kinds": _counted(str(meta["kind"]) for meta in metas),
        "hosts": _counted(_pairs(meta.get("host", {})) for meta in metas),
        "versions": _counted(_pairs(meta.get("versions", {})) for meta in metas),
        "created": (_minute(created[0]), _minute(created[-1])) if created else None,
        "held": _held(metas),
        "superseded": loaded.superseded,
        "damages": [(str(d.path), d.reason) for d in loaded.damages],
        "failures": failed,
        "tracebacks": _tracebacks(failed),
        "refusals": _refusals(cases),
        "folder": loaded.folder,
        "total": len(metas),
        "few": FEW,
        "named": NAMED,
    }


def profile(command: str) -> str:
    """The profile of a command that ran estimators, as it names it or the usual one; else nothing."""
    try:
        words = shlex.split(command)
    except ValueError:
        words = command.split()
    if words[1:2] != ["run"]:
        return ""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        if word == "--profile":
            return following
        if word.startswith("--profile="):
            return word.partition("=")[2]
    return next(iter(PROFILES))


def _counted(texts: Iterable[Any]) -> list[tuple[Any, int]]:
    return Counter(texts).most_common()


def _pairs(values: Any) -> tuple[tuple[str, str], ...]:
    return tuple((str(k), str(v)) for k, v in dict(values).items())


def _minute(moment: str) -> str:
    """A moment as it is stored, without fractions of a second."""
    return moment.partition(".")[0].replace("T", " ") + " UTC"


def _label(meta: Any) -> str:
    return str(meta["estimator"]["label"]) if meta["estimator"] else ""


def _blocks(loaded: Results) -> list[Column]:
    """All blocks as columns of a table."""
    metas = [entry.meta for entry in loaded.entries]
    rows = [
        (
            meta["case"]["name"], _label(meta), meta["kind"], meta["version"], str(meta["seed"]), str(meta["first"]),
            str(meta["count"]), meta["created"], meta.get("command", ""), meta.get("host", {}).get("node", ""), meta["address"],
        )
        for meta in metas
    ]  # fmt: skip
    heads = ("case", "estimator", "kind", "version", "seed", "first run", "runs", "made", "command", "machine", "block")
    return [Column(head, [str(x) for x in column]) for head, column in zip(heads, zip(*rows, strict=True), strict=True)]


def _held(metas: Sequence[Any]) -> dict[str, dict[str, Any]]:
    """By case what is held: of each estimator, and of the truth, the runs and the version of each kind of block."""
    found: dict[str, dict[str, Any]] = {}
    for meta in metas:
        case = found.setdefault(meta["case"]["name"], {"blocks": 0, "seeds": {}, "rows": {}})
        case["blocks"] += 1
        case["seeds"][str(meta["seed"])] = None
        kind = meta["kind"]
        label = _label(meta) if kind in (ESTIMATE, TIMING) else kind
        row = case["rows"].setdefault(label, {"runs": 0, "version": "", "timing": "", "last": ""})
        row["runs"] += meta["count"] if kind in (TRUTH, ESTIMATE) else 0
        row["timing" if kind == TIMING else "version"] = str(meta["version"])
        row["last"] = max(row["last"], _minute(str(meta["created"])))
    for case in found.values():
        case["rows"].pop("refusal", None)
    return found


def _tracebacks(failed: Sequence[tuple[str, CellView]]) -> dict[str, dict[str, Any]]:
    """All tracebacks, each once, with its number and the cells that gave it."""
    found: dict[str, dict[str, Any]] = {}
    for name, cell in failed:
        for text in cell.tracebacks:
            said = found.setdefault(text, {"number": len(found) + 1, "last": text.strip().rpartition("\n")[2], "cells": []})
            said["cells"].append(f"{cell.label} on {name}")
    return found


def _refusals(cases: Sequence[CaseView]) -> dict[str, dict[str, list[str]]]:
    """By reason the cases that each estimator refused."""
    found: dict[str, dict[str, list[str]]] = {}
    for case in cases:
        for cell in case.cells.values():
            if cell.status == "refused":
                found.setdefault(cell.reason, {}).setdefault(cell.label, []).append(case.card.name)
    return found
