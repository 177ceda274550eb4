"""The site: pages and static files in one folder, each file whole or not there."""

import dataclasses
import json
import os
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from reports.formula import prose
from reports.marks import marks
from reports.pages import case as case_page
from reports.pages import overview, provenance
from reports.sentences import headline
from reports.text import count, grouped, listed, slugs
from reports.views import PERCENT, private, view
from suite.errors import BadInput
from suite.published import Finding, Key
from suite.results import Results

MANIFEST = "_filterbench_site.json"
NONE: Mapping[Key, Finding] = {}
STATIC = ("static/style.css", "static/site.js")
_OURS = re.compile(r"(index|provenance|case-[a-z0-9-]+)\.html|static/(style\.css|site\.js)")
_TEMPORARY = re.compile(r"\.filterbench-(\d+)\..+\.tmp")


def build(loaded: Results, out: Path, command: str, findings: Mapping[Key, Finding] = NONE) -> Path:
    """Write the site of the results to the folder `out`, with what was found of published figures, and return it.

    Pages of a former site that are no longer due are removed, other files left alone. Raises BadInput when `out` is
    a file, a folder that holds other things, or cannot be written.
    """
    former = _former(out)
    pages = render(loaded, command, findings)
    try:
        (out / "static").mkdir(parents=True, exist_ok=True)
        _sweep(out)
        # The names of both sites first: a build that is interrupted is known for what it is, and can be cleaned up.
        _write(out / MANIFEST, _manifest(sorted({*former, *pages})))
        for name, content in pages.items():
            _write(out / name, content)
        for name in former - pages.keys():
            (out / name).unlink(missing_ok=True)
        _write(out / MANIFEST, _manifest(sorted(pages)))
    except OSError as error:
        raise _unwritable(out, error) from error
    return out


def render(loaded: Results, command: str, findings: Mapping[Key, Finding] = NONE) -> dict[str, str]:
    """All files of the site by name."""
    environment = _environment()
    labels = loaded.labels
    marked = marks(labels)
    names = list(loaded.cases)
    stems = slugs(names)
    pages = {name: f"case-{stems[name]}.html" for name in names}
    shared = {
        "labels": labels,
        "marks": marked,
        "anchors": slugs(labels),
        "pages": pages,
        "command_of_site": command,
        "percent": PERCENT,
        "count": count,
        "listed": listed,
        "grouped": grouped,
        "prose": prose,
    }
    cases = []
    found: dict[str, str] = {}
    for name in names:  # one case after the other, so that the estimates of one only are held
        case = view(private(loaded.cases[name]), labels)
        found[pages[name]] = _page(environment, "case", shared | case_page.context(case, labels, marked, findings))
        cases.append(dataclasses.replace(case, results=loaded.cases[name]))
    matrix = overview.context(cases, labels, pages)
    found["index.html"] = _page(environment, "overview", shared | matrix | {"headline": headline(cases), "cases": cases})
    found["provenance.html"] = _page(environment, "provenance", shared | provenance.context(loaded, cases))
    for name in STATIC:
        found[name] = files("reports").joinpath(name).read_text(encoding="utf-8")
    return found


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _page(environment: Environment, kind: str, context: Mapping[str, Any]) -> str:
    return environment.get_template(f"{kind}.html.j2").render(context)


def _former(out: Path) -> set[str]:
    """Names of the files that a former build left in `out`. Raises BadInput when it is no place for a site."""
    if out.exists() and not out.is_dir():
        raise BadInput(f"--out {out} is a file; name a folder")
    try:
        if not out.is_dir() or not any(out.iterdir()):
            return set()
        manifest = out / MANIFEST
        if not manifest.is_file():
            raise BadInput(f"--out {out} holds other files and no filterbench site; name an empty or new folder")
        return _listed_in(manifest.read_text(encoding="utf-8", errors="replace"))
    except OSError as error:
        raise _unwritable(out, error) from error


def _listed_in(manifest: str) -> set[str]:
    """Names in a manifest that can be ours; none when it is damaged."""
    try:
        names = json.loads(manifest)["files"]
        return {name for name in names if isinstance(name, str) and _OURS.fullmatch(name)}
    except (ValueError, KeyError, TypeError):
        return set()


def _manifest(names: Sequence[str]) -> str:
    return json.dumps({"site": "filterbench", "files": names}, indent=1) + "\n"


def _write(path: Path, content: str) -> None:
    """Write a file under another name and rename it: what carries the name is whole."""
    temporary = path.with_name(f".filterbench-{os.getpid()}.{path.name}.tmp")
    try:
        with temporary.open("w", encoding="utf-8", errors="replace", newline="\n") as sink:
            sink.write(content)
            sink.flush()
            os.fsync(sink.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _sweep(out: Path) -> None:
    """Remove what builds that were killed left half written."""
    for folder in (out, out / "static"):
        for path in folder.iterdir():
            match = _TEMPORARY.fullmatch(path.name)
            if match and not _alive(int(match[1])):
                path.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _unwritable(out: Path, error: OSError) -> BadInput:
    return BadInput(f"cannot write the site to {out}: {error.strerror or error}; make it writable or name another folder")
