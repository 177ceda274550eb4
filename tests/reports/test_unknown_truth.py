"""Pages of recordings whose truth is not known, or known in part: from a real run and a real report."""

import re

import pytest

import suite.cli
import suite.run
from suite import results
from suite.metrics import METRICS
from tests.conftest import InlinePool
from tests.recordings import CSV, POLAR, TOML, TRUTH, simulated, without, write
from tests.reports import conftest
from tests.reports.conftest import build

FILTERS = ("ekf", "bootstrap[particles=50]")
WITH_LIMIT = TOML + '[divergence]\nlimit = "100 km"\nsteps = 2\n'
POSITIONS = "time,x,y\n-2.5,1100,1900\n1e3,0,0\n"


def made(folder, toml, csv, truth, name):
    """The folder of results and the site of a recording, run and reported by the commands."""
    write(folder, toml, csv, truth)
    (folder / "ferry.toml").rename(folder / f"{name}.toml")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite.run, "ProcessPool", InlinePool)
        case = ["-c", str(folder / f"{name}.toml")]
        assert suite.cli.main(["run", *case, "-e", *FILTERS, "--runs", "4", "--results", str(folder / "r")]) == 0
    assert suite.cli.main(["report", "--results", str(folder / "r"), "--out", str(folder / "site"), "--jobs", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    """A recording without a truth, long enough for a test of whiteness."""
    return made(tmp_path_factory.mktemp("blind"), without(WITH_LIMIT, "truth ="), simulated(POLAR)[0], None, "blind")


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """A recording with its whole truth."""
    return made(tmp_path_factory.mktemp("seen"), WITH_LIMIT, CSV, TRUTH, "seen")


def text_of(tools, folder, page):
    return " ".join(tools.read(folder / "site" / f"{page}.html").text.split())


def heads(folder, name, family=""):
    """Heads of the columns of scores: those of a family's table, or of all."""
    page = (folder / "site" / f"case-{name}.html").read_text(encoding="utf-8")
    tables = re.findall(rf'<table class="scores[^>]*id="scores-{family}.*?</thead>', page, re.S)
    found = [words for table in tables for words in re.findall(r'<th scope="col"[^>]*>(?:<a[^>]*>)?([^<]*)', table)]
    return [words.strip() for words in found]


def matrix(folder):
    return conftest.matrix(conftest.contents(folder / "site"))


UNTRUTHFUL = ["NIS", *(METRICS[name].title for name in ("whiteness", "loglik"))]
COSTS = [METRICS[name].title for name in ("latency", "throughput")]
TRUTHFUL = {"RMSE", "NEES", *(METRICS[name].title for name in ("eta", "lag", "crlb-ratio", "nees", "divergence"))}


def test_scores_that_need_no_truth_are_shown_where_there_is_none(blind):
    assert set(UNTRUTHFUL + COSTS) <= set(heads(blind, "blind"))
    assert TRUTHFUL.isdisjoint(heads(blind, "blind"))
    assert heads(blind, "blind", "consistency") == ["Estimator", *UNTRUTHFUL]
    assert heads(blind, "blind", "first") == ["Estimator", "Runs", *UNTRUTHFUL, COSTS[0]]
    score = results.load(blind / "r").cases["blind"].cells["ekf"].scores(METRICS["nis"])["innovation"]
    assert f'<span class="value">{score.value:.4g} ' in (blind / "site/case-blind.html").read_text(encoding="utf-8")


def test_errors_are_shown_where_the_truth_is_known(seen):
    assert heads(seen, "seen", "error") == ["Estimator", "RMSE", "RMSE", METRICS["eta"].title]
    assert heads(seen, "seen", "first")[:4] == ["Estimator", "Runs", "RMSE", "RMSE"]
    assert {"NEES", "NIS"} <= set(heads(seen, "seen", "consistency"))
    assert METRICS["divergence"].title in heads(seen, "seen", "robustness")
    assert set(COSTS) <= set(heads(seen, "seen", "cost"))


def test_where_only_positions_are_known_innovations_stand_in_for_the_errors_of_the_state(tmp_path):
    folder = made(tmp_path, WITH_LIMIT, CSV, POSITIONS, "half")
    shown = [title for title in UNTRUTHFUL if title != METRICS["whiteness"].title]  # four times are too few
    assert heads(folder, "half", "error") == ["Estimator", "RMSE"]
    assert heads(folder, "half", "first")[:4] == ["Estimator", "Runs", "RMSE", "NIS"]
    assert set(shown) <= set(heads(folder, "half", "consistency"))
    assert {"NEES", METRICS["whiteness"].title}.isdisjoint(heads(folder, "half"))
    page = (folder / "site/case-half.html").read_text(encoding="utf-8")
    assert "RMSE of position over time" in page
    assert "RMSE of velocity over time" not in page
    assert re.search("Truth and estimates on the (ground )?plane", page)


def test_the_page_says_that_the_truth_is_not_known(blind, tools):
    text = text_of(tools, blind, "case-blind")
    assert "The truth is not known. No error can be told" in text
    assert "Whether a run has diverged cannot be told, since the truth is not known." in text
    assert "no counted run" not in text
    assert "not drawn" not in text
    page = tools.read(blind / "site/case-blind.html")
    drawn = [found["id"] for tag, found in page.attributes if tag == "figure"]
    assert len(drawn) == 2  # the plane and the innovations: nothing of errors
    assert drawn[1] == "nis"
    assert re.search("Estimates on the (ground )?plane", text)
    assert "The truth is not known; the circle marks the first estimate" in text
    for words in ("median of the runs", "the thin line", "truth x", "Truth and estimates"):
        assert words not in text
    assert "time (s) ekf x ekf y" in text


def test_a_known_truth_is_drawn_and_told(seen, tools):
    text = text_of(tools, seen, "case-seen")
    assert "The truth is not known" not in text
    assert "It happened in no counted run." in text
    assert "The circle marks the start, the thin line without marks the truth." in text
    assert "truth x truth y ekf x" in text


def test_the_overview_claims_nothing_of_unknown_errors(blind, tools):
    text = text_of(tools, blind, "index")
    assert "On blind, nobody can be ranked by RMSE of position, since the truth is not known." in text
    assert "Of 8 runs, none failed or was lost; whether any diverged cannot be told, since the truth is not known." in text
    data = matrix(blind)
    titles = [choice["title"] for choice in data["choices"]]
    assert titles[0] == METRICS["nis"].title
    assert set(COSTS) <= set(titles)
    assert TRUTHFUL.isdisjoint(titles)
    (nis, *_) = data["cells"][0]
    assert [cell[0] for cell in nis] == ["done", "absent"]
    assert nis[1][7] == f"it has no {METRICS['nis'].title} on this case"


def test_beside_another_case_its_runs_are_not_counted_as_sound(blind, seen, tools, tmp_path):
    for folder in (blind, seen):
        for path in (folder / "r").rglob("*"):
            if path.is_file():
                target = tmp_path / "r" / path.relative_to(folder / "r")
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(path.read_bytes())
    assert suite.cli.main(["report", "--results", str(tmp_path / "r"), "--out", str(tmp_path / "site"), "--jobs", "1"]) == 0
    text = text_of(tools, tmp_path, "index")
    told = (
        "Of 16 runs, none failed or was lost and none diverged; whether 8 runs without a known truth diverged cannot be told."
    )
    assert told in text
    data = matrix(tmp_path)
    assert (data["choices"][0]["title"], data["choices"][0]["block"]) == ("RMSE", "first block of each case")
    cells = dict(zip(results.load(tmp_path / "r").cases, data["cells"], strict=True))["blind"][0]
    assert {(state, value) for state, value, *_ in cells} == {("absent", "none")}
    assert {cell[7] for cell in cells} == {"it has no Root mean square error on this case: the truth is not known"}


def test_rates_of_a_recording_have_no_interval(seen, tools):
    assert "Rates have no interval. Only running times are ranked." in text_of(tools, seen, "case-seen")
    page = (seen / "site/case-seen.html").read_text(encoding="utf-8")
    rates = re.findall(r'<span class="value">0 <span class="unit">%</span></span>\s*<span class="interval">([^<]*)<', page)
    assert len(rates) >= 2
    assert set(rates) == {""}
    assert page.count('<span class="under">lower is better; no interval</span>') >= 2


def test_the_table_of_scores_leaves_out_what_nobody_has(blind, capsys):
    assert suite.cli.main(["score", "--results", str(blind / "r")]) == 0
    out = capsys.readouterr().out
    told = set(re.findall(r"│ ([a-z-]+):", out))
    assert {"nis", "whiteness", "loglik", "latency", "throughput"} <= told
    assert {"rmse", "eta", "nees", "lag", "crlb-ratio", "divergence"}.isdisjoint(told)
    assert suite.cli.main(["score", "--results", str(blind / "r"), "-m", "rmse"]) == 0
    assert capsys.readouterr().out.count("none") == 4


def test_a_score_that_is_infinite_everywhere_is_shown(tools, tmp_path):
    """A filter that is sure of itself and wrong: nothing of it is unknown."""
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("sure", variance=0.0)], seconds=0).load()
    build(loaded, tmp_path / "site")
    assert "NEES" in heads(tmp_path, "easy")
    page = tools.read(tmp_path / "site/case-easy.html")
    assert "∞" in page.text
    assert "Nothing to draw: no estimator has a finite value here." in page.text
