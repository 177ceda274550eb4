"""A small results folder written in this process, and a reader of pages."""

import json
import re
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cases.linear_gaussian import MODEL
from reports.folder import MANIFEST
from suite import results
from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.case_bounds import bounds_of
from suite.estimator import FAILED, LOST, Estimate
from suite.plan import BOUND, ESTIMATE, REFUSAL, TIMING, TRUTH, WorkBlock
from suite.published import Published
from suite.record import Recorder
from suite.registry import Catalog, Registry
from suite.store import Store
from suite.work import Timing, compute

STEPS = 12


def small_case(name="easy", blocks=("position", "velocity"), **changes):
    """The linear case over a few steps."""
    fields = {
        "title": f"Title of {name}",
        "summary": "A short case.",
        "steps": STEPS,
        "interval": 0.5,
        "state": ("x", "vx", "y", "vy"),
        "blocks": (StateBlock(blocks[0], (0, 2), "m"), StateBlock(blocks[1], (1, 3), "m/s")),
        "divergence": Divergence(blocks[0], 1000.0, 3),
        "reference": "A book",
        "equations": (Equation("Motion", r"x_k = \begin{pmatrix} 1 & T \\ 0 & 1 \end{pmatrix} x_{k-1}"),),
        "assumptions": ("Made for `tests`.",),
        "published": (Published("Kalman", "position error", 8.25, "m", "Table 2", "another site"),),
        "plane": (0, 2),
        "landmarks": (("Radar", 0.0, -50.0),),
        "model": MODEL,
        "generate": lambda rng: draw(MODEL, STEPS, rng),
    }
    return Case(name=name, **{**fields, **changes})


class Scripted:
    """An estimator that takes the measurement for the position, shifted, and fails as it is told."""

    reference = "none"

    def __init__(self, name="plain", shift=0.0, variance=100.0, refusal=None, error="", bad=(), status=FAILED, value=0.0):
        self.name, self.shift, self.variance, self.refusal = name, shift, variance, refusal
        self.error, self.bad, self.status, self.value = error, bad, status, value

    def accepts(self, model):
        return self.refusal

    def run(self, model, y, seed):
        if self.error:
            raise RuntimeError(self.error)
        steps, _, runs = y.shape
        mean = np.full((steps, 4, runs), self.value)
        mean[:, [0, 2]] += y + self.shift
        cov = np.tile(self.variance * np.eye(4)[None, :, :, None], (steps, 1, 1, runs))
        status = [self.status if r in self.bad else "ok" for r in range(runs)]
        return Estimate(mean, cov, status=status, reason=["step 3: gone" if s != "ok" else "" for s in status])


@dataclass
class Written:
    """A results folder in the making."""

    folder: Path
    command: str = "filterbench run"
    catalog: Catalog = field(default_factory=lambda: Catalog(Registry("estimator", ()), Registry("case", ()), {}))

    def add(self, cases: Sequence[Case], estimators: Sequence[Scripted], runs: int = 4, seconds: float = 1e-4):
        """Store all combinations; seconds is the time of a step of the first estimator, others take longer."""
        Store(self.folder, create=True)
        recorder = Recorder(str(self.folder), self.command, Catalog(Registry("e", estimators), Registry("c", cases), {}))
        for case in cases:
            recorder.truth(self._block(TRUTH, case, None, runs), case.simulate(runs, 1))
            recorder.bounds(self._block(BOUND, case, None, 1), bounds_of(case, 1))
            for place, estimator in enumerate(estimators):
                if estimator.refusal:
                    recorder.refusal(self._block(REFUSAL, case, estimator, 1))
                    continue
                recorder.estimate(self._block(ESTIMATE, case, estimator, runs), compute(case, estimator, 1, 0, runs))
                if seconds and not estimator.error:
                    times = seconds * (1 + place) * (1 + 0.01 * np.arange(8)[None]) * np.ones((5, 1))
                    recorder.timing(self._block(TIMING, case, estimator, 1), Timing(times, (1,) * 4 + (20,) * 4))
        return self

    def load(self):
        """The results as a command would load them."""
        return results.load(self.folder)

    @staticmethod
    def _block(kind, case, estimator, count):
        truth = f"truth of {case.name}"
        if estimator is None:
            return WorkBlock(kind, case.name, None, 1, 0, count, truth, truth)
        version = f"{kind} of {estimator.name} on {case.name}"
        return WorkBlock(kind, case.name, estimator.name, 1, 0, count, version, truth, estimator.refusal or "")


VARIETY = (
    Scripted("plain"),
    Scripted("shifted", shift=30.0),
    Scripted("twin"),
    Scripted("choosy", refusal="the model is too hard"),
    Scripted("broken", error="no <b>luck</b>"),
    Scripted("frail", bad=(1,), status=LOST),
)


@pytest.fixture
def tools():
    """The makers above, for tests that write their own results."""
    return SimpleNamespace(case=small_case, scripted=Scripted, written=Written, read=read, variety=VARIETY, steps=STEPS)


@pytest.fixture(scope="session")
def variety(tmp_path_factory):
    """Results with two cases whose blocks differ in name, and every state a cell can have."""
    cases = (small_case("easy/one"), small_case("other", blocks=("horizontal position", "speed")))
    folder = tmp_path_factory.mktemp("variety") / "results"
    Written(folder).add(cases, VARIETY)
    Written(folder).add([small_case("lonely")], [Scripted("plain")], runs=1, seconds=0)
    return results.load(folder)


def build(loaded, out, command="filterbench report", findings=None, **inputs):
    """The site of some results in a folder, made in this process."""
    from reports import site
    from reports.inputs import Inputs

    return site.build(Inputs(loaded, command, findings or {}, **inputs), out)


def rendered(loaded, **inputs):
    """All files of the site of some results by name."""
    with tempfile.TemporaryDirectory() as folder:
        return contents(build(loaded, Path(folder) / "site", **inputs))


def contents(site):
    """All files of a site by name."""
    paths = [path for path in site.rglob("*") if path.is_file() and path.name != MANIFEST]
    return {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in paths}


class Page(HTMLParser):
    """What a test wants to know of a page: ids, links, scripts, headings and its text."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.tags, self.headings, self.handlers, self.text = [], [], [], [], [], ""
        self.cells, self.attributes, self._open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.tags.append(tag)
        self.attributes.append((tag, found))
        self._open.append(tag)
        self.handlers += [name for name in found if name.startswith("on")]
        if "id" in found:
            self.ids.append(found["id"])
        self.links += [found[name] for name in ("href", "src", "xlink:href", "action") if found.get(name)]
        if tag in ("h1", "h2", "h3"):
            self.headings.append(int(tag[1]))
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data):
        if not {"script", "style"} & set(self._open):
            self.text += f"{data} "
            if {"td", "th"} & set(self._open):
                self.cells[-1] += data


def read(path):
    """A page as a `Page`."""
    return Page(Path(path).read_text(encoding="utf-8"))


def matrix(files):
    """The matrix of a site's files: its choices, and by case and choice what each cell shows as eight texts.

    These are state, value, unit, interval, mark, count of runs, class of shading, and reason.
    """
    page = files["index.html"]
    data = json.loads(re.search(r'<script type="application/json" id="matrix-data">(.*?)</script>', page, re.S)[1])
    states = iter(re.findall(r'<td class="cell ([a-z-]+)', page))
    fixed = [[(next(states).replace("-", " "), [data["texts"][i] for i in said]) for said in row] for row in data["said"]]
    shown = [handed(files[f"data/matrix-{choice['id']}.js"]) for choice in data["choices"]]
    cells = [[_eight(rows[case], row, notes) for notes, rows in shown] for case, row in enumerate(fixed)]
    return data | {"cells": cells}


def handed(script):
    """The notes and rows that a script hands to the overview."""
    data = json.loads(re.fullmatch(r'overview\.receive\("[a-z0-9-]+", (.*)\);\n', script)[1])
    return data["notes"], data["rows"]


def _eight(row, fixed, notes):
    found = []
    for cell, (state, said) in zip(row["cells"], fixed, strict=True):
        if not cell:
            found.append([state, state, "", "", "", "", "", said[0]])
            continue
        state, value, unit, interval, mark, runs, shade, _, note, *_ = [*cell, *[0] * 8]
        why = notes[note] or next(iter(said), "")
        found.append([state, value, unit or row["unit"], interval, mark, runs, f"shade-{shade}" if shade >= 0 else "", why])
    return found


@pytest.fixture(scope="session")
def site(variety, tmp_path_factory):
    """The site of those results."""
    return build(variety, tmp_path_factory.mktemp("site") / "out")


ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium, started once."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        pytest.skip("no Chromium is installed")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser, site):
    """Opens a page of a site; at the end no page may have complained or asked for anything from outside."""
    contexts, complaints = [], []

    def open_page(name="index.html", folder=site, **options):
        context = browser.new_context(**options)
        context.set_default_timeout(8000)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: request.url.startswith(("file:", "data:")) or complaints.append(request.url))
        page.goto((folder / name.partition("#")[0]).as_uri() + "".join(name.partition("#")[1:]))
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
