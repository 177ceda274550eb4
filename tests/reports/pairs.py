"""Results whose estimators differ by noise of a known size, and readers of what pages and commands say of them."""

import contextlib
import dataclasses
import json
import re

import numpy as np
import pytest

import suite.cli
from reports.pages import case
from reports.pages.case_figures import CaseFigures
from tests.reports.conftest import Scripted, Written, small_case
from tests.reports.test_faults import plain
from tests.reports.test_text import back


class Noisy(Scripted):
    """Scripted, with errors of its own of a size."""

    size, stream = 0.0, 0

    def run(self, model, y, seed):
        found = super().run(model, y, seed)
        noise = np.random.default_rng(self.stream).normal(0, self.size, found.mean.shape)
        return dataclasses.replace(found, mean=found.mean + noise)


def noisy(name, size, stream=0, **more):
    made = Noisy(name, **more)
    made.size, made.stream = size, stream
    return made


def written(place):
    """A folder of results: estimators that are alike, better, worse, undecided, lost in two runs, and two that refuse."""
    estimators = [
        noisy("first", 9.0),
        noisy("same", 9.0, shift=1e-3),
        noisy("sharp", 1.0, 1),
        noisy("blunt", 40.0, 2),
        noisy("nearly", 9.5, 3),
        noisy("frail", 9.0, bad=(1, 4), status="lost"),
        Scripted("choosy", refusal="the model is too hard"),
        Scripted("picky", refusal="the model is too hard"),
    ]
    return Written(place / "r").add([small_case("easy")], estimators, runs=8).folder


@contextlib.contextmanager
def undrawn():
    """Pages of cases without figures, which take time and have tests of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(case, "case_figures", lambda *_: CaseFigures((), (), (), None))
        yield


def printed(capsys, *arguments):
    """What a command prints as JSON."""
    assert suite.cli.main([*map(str, arguments), "--format", "json"]) == 0
    return json.loads(capsys.readouterr().out)


def rows_of(page, table):
    """The cells of each row of a table, in words, by the row's first word."""
    markup = re.search(rf'<table[^>]*id="{table}".*?</table>', page, re.S)[0].partition("<tbody>")[2]
    rows = [
        [plain(cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", row, re.S)]
        for row in re.findall(r"<tr.*?</tr>", markup, re.S)
    ]
    return {row[0].split()[0]: row[1:] for row in rows}


NUMBER = r"(−?[\d.\u202f]+(?: × 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?|∞)"


def agrees(words, value, low, high, scale=1.0):
    """Whether words such as '8.3 (7.8 to 9.1) m' or '8.3 m 7.8 to 9.1' say a number and its interval."""
    found = [back(text) for text in re.findall(NUMBER, words)]
    np.testing.assert_allclose(found[:3], [scale * x for x in (value, low, high)], rtol=0.0501, err_msg=words)
