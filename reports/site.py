"""The site: pages, data and static files in one folder, each file whole or not there."""

import contextlib
import gc
import multiprocessing
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from importlib.resources import files
from pathlib import Path

from reports.digest import from_json
from reports.folder import Files, Folder
from reports.frame import Frame
from reports.inputs import Inputs, Site, digest_of
from reports.pages import case, changes, detection, estimators, overview, provenance, reproduction, timing
from reports.part import Part, produce

PAGES = (overview, estimators, reproduction, detection, timing, provenance)
"""Kinds of pages about several cases."""


def build(inputs: Inputs, out: Path, jobs: int = 1) -> Path:
    """Write the site of some inputs to the folder `out`, in so many processes, and return the folder.

    Pages that a former build left are kept where they still follow from the same; those no longer due are removed, other
    files left alone. Raises BadInput when `out` is a file, a folder that holds other things, or cannot be written.
    """
    folder, frame = Folder(out), Frame.of(inputs.loaded)
    with _workers(jobs) as pool:
        parts = [case.part(frame, results, inputs.findings) for results in inputs.loaded.cases.values()]
        produce([*parts, *changes.case_parts(frame, inputs)], folder, pool, "cases")
        said = {name: folder.text(case.digest_name(frame, name)) for name in inputs.loaded.cases}
        cases = [from_json(text, inputs.loaded.cases[name]) for name, text in said.items()]
        site = Site(frame, inputs, cases, digest_of(list(said.values())))
        changed = [folder.text(changes.digest_name(frame, name)) for name in changes.shared(inputs)]
        several = [part for page in PAGES for part in page.parts(site)]
        produce([Part("static", "", _static, ()), *several, changes.page(frame, inputs, changed)], folder, pool, "pages")
    folder.finish()
    return out


def _static() -> Files:
    """The style sheet and the scripts."""
    found = files("reports").joinpath("static")
    return {f"static/{each.name}": each.read_text(encoding="utf-8") for each in sorted(found.iterdir(), key=lambda f: f.name)}


@contextlib.contextmanager
def _workers(jobs: int) -> Iterator[Executor | None]:
    """So many processes, which start when there is work; none for a single job. Interrupted, none begins another part."""
    if jobs == 1:
        yield None
        return
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_prepared)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _prepared() -> None:
    """A process that draws: deaf to interrupts, which are for the process that asked, and seldom looking for garbage.

    A figure is made of thousands of objects; with the usual thresholds a tenth of the time goes into walking them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
