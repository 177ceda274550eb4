"""The provenance page: which commands, sources, versions and machines the results came from, and what went wrong."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.views import CaseView
from suite.results import Results


def parts(site: Site) -> Iterator[Part]:
    """The page of where the numbers come from."""
    loaded, command = site.inputs.loaded, site.inputs.command
    blocks = [(entry.meta["address"], entry.meta["created"]) for entry in loaded.entries]
    damages = [(str(d.path), d.reason) for d in loaded.damages]
    depends = site.depends(blocks, damages, loaded.superseded, str(loaded.folder), command)
    yield Part("provenance", depends, files, (site.frame, loaded, site.cases, command))


def files(frame: Frame, loaded: Results, cases: Sequence[CaseView], command: str) -> dict[str, str]:
    """The page's file."""
    return {"provenance.html": frame.page("provenance", **context(loaded, cases), command_of_site=command)}


def context(loaded: Results, cases: Sequence[CaseView]) -> dict[str, Any]:
    """What the template of the provenance page needs."""
    metas = [entry.meta for entry in loaded.entries]
    created = sorted(str(meta["created"]) for meta in metas)
    return {
        "commands": _counted(str(meta.get("command", "")) for meta in metas),
        "seeds": _counted(str(meta["seed"]) for meta in metas),
        "kinds": _counted(str(meta["kind"]) for meta in metas),
        "hosts": _counted(_pairs(meta.get("host", {})) for meta in metas),
        "versions": _counted(_pairs(meta.get("versions", {})) for meta in metas),
        "created": (_minute(created[0]), _minute(created[-1])) if created else None,
        "blocks": _blocks(metas),
        "superseded": loaded.superseded,
        "damages": [(str(d.path), d.reason) for d in loaded.damages],
        "failures": [(case.card.name, cell) for case in cases for cell in case.cells.values() if cell.failures],
        "refusals": [(case.card.name, cell) for case in cases for cell in case.cells.values() if cell.status == "refused"],
        "estimators": _estimators(cases),
        "folder": loaded.folder,
        "total": len(metas),
    }


def _counted(texts: Iterable[Any]) -> list[tuple[Any, int]]:
    return Counter(texts).most_common()


def _pairs(values: Any) -> tuple[tuple[str, str], ...]:
    return tuple((str(k), str(v)) for k, v in dict(values).items())


def _minute(moment: str) -> str:
    """A moment as it is stored, without fractions of a second."""
    return moment.partition(".")[0].replace("T", " ") + " UTC"


def _blocks(metas: Sequence[Any]) -> list[dict[str, Any]]:
    """Blocks of the same case, estimator, kind and version together."""
    found: dict[tuple[str, ...], dict[str, Any]] = {}
    for meta in metas:
        label = meta["estimator"]["label"] if meta["estimator"] else ""
        key = (meta["case"]["name"], label, meta["kind"], str(meta["version"]))
        row = found.setdefault(key, {"case": key[0], "estimator": label, "kind": key[2], "version": key[3], "blocks": 0,
                                     "runs": 0, "seed": meta["seed"], "last": ""})  # fmt: skip
        row["blocks"] += 1
        row["runs"] += meta["count"] if meta["kind"] in ("truth", "estimate") else 0
        row["last"] = max(row["last"], _minute(str(meta["created"])))
    return list(found.values())


def _estimators(cases: Sequence[CaseView]) -> list[dict[str, Any]]:
    """What is stored of each estimator: summary, reference, parameters."""
    found: dict[str, dict[str, Any]] = {}
    for case in cases:
        for label, cell in case.cells.items():
            if cell.meta:
                values = {k: v if isinstance(v, str) else json.dumps(v) for k, v in cell.meta.get("parameters", {}).items()}
                found.setdefault(label, {"label": label, "summary": cell.meta.get("summary", ""),
                                         "reference": cell.meta.get("reference", ""), "parameters": values})  # fmt: skip
    return list(found.values())
