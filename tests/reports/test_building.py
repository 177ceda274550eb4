"""Building a site: only what changed is made again, in several processes or in one, and what was made is never lost."""

import json

import pytest

from reports import digest, part
from reports.folder import MANIFEST, Folder
from reports.frame import Frame
from reports.inputs import Inputs
from reports.pages import case as case_page
from reports.plot import Column, Plot, tex, to_csv, to_latex
from reports.site import build as build_in
from reports.views import private, view
from suite.plan import REFUSAL
from suite.published import Finding
from suite.record import Recorder
from suite.registry import Catalog, Registry
from tests.reports.conftest import Written, build


def made_at(out):
    return {path.relative_to(out).as_posix(): path.stat().st_mtime_ns for path in out.rglob("*.*") if path.name != MANIFEST}


def touched(out, before):
    after = made_at(out)
    return {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}


@pytest.fixture
def written(tools, tmp_path):
    return tools.written(tmp_path / "r").add([tools.case("one"), tools.case("two")], [tools.scripted("a"), tools.scripted("b")])


def test_what_follows_from_the_same_is_not_drawn_again(written, tools, tmp_path):
    out = build(written.load(), tmp_path / "site")
    before = made_at(out)
    build(written.load(), out)
    assert touched(out, before) == set()
    Written(written.folder).add([tools.case("three")], [tools.scripted("a"), tools.scripted("b")])
    build(written.load(), out)
    changed = touched(out, before)
    assert {"case-three.html", "index.html", "provenance.html"} <= changed
    assert not {"case-one.html", "data/one.json", "case-two.html", "static/site.js"} & changed


def test_a_page_that_was_changed_or_removed_is_made_again(written, tmp_path):
    out = build(written.load(), tmp_path / "site")
    right = (out / "case-one.html").read_bytes()
    (out / "case-one.html").write_text("mine")
    (out / "data/two.json").unlink()
    before = made_at(out)
    build(written.load(), out)
    assert (out / "case-one.html").read_bytes() == right
    assert (out / "data/two.json").exists()
    assert "index.html" not in touched(out, before)


def test_new_findings_or_sources_or_estimators_make_pages_anew(written, tools, tmp_path, monkeypatch):
    out = build(written.load(), tmp_path / "site")
    before = made_at(out)
    finding = Finding("not comparable", "for a reason")
    build(written.load(), out, findings={("one", "Kalman", "position error"): finding})
    assert "case-one.html" in touched(out, before)
    assert "case-two.html" not in touched(out, before)
    monkeypatch.setattr(part, "_sources", lambda: "other")
    build(written.load(), out, findings={("one", "Kalman", "position error"): finding})
    assert {"case-one.html", "case-two.html", "index.html", "static/site.js"} <= touched(out, before)
    before = made_at(out)
    Written(written.folder).add([tools.case("one")], [tools.scripted("c")])
    build(written.load(), out)
    assert "case-two.html" in touched(out, before)


def test_several_processes_make_the_same_files(written, tmp_path):
    one = build(written.load(), tmp_path / "one")
    two = build_in(Inputs(written.load(), "filterbench report", {}), tmp_path / "two", jobs=2)
    assert made_at(one).keys() == made_at(two).keys()
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in made_at(one))


def test_an_interrupted_build_is_taken_up_where_it_stopped(written, tmp_path, monkeypatch):
    out = tmp_path / "site"
    write, parts = Folder.write, []

    def interrupted(folder, name, key, files):
        if len(parts) == 1:
            raise KeyboardInterrupt
        parts.append(name)
        write(folder, name, key, files)

    monkeypatch.setattr(Folder, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build(written.load(), out)
    monkeypatch.undo()
    before = made_at(out)
    assert parts[0] in before
    build(written.load(), out)
    assert parts[0] not in touched(out, before)
    assert "case-one.html" in made_at(out)
    assert "case-two.html" in made_at(out)


def plain(scores):
    """Scores as text, in which a NaN is like another."""
    return [(key, *map(float, (s.value, s.low, s.high)), s.unit, s.runs, s.total).__repr__() for key, s in scores.items()]


def test_the_digest_of_a_case_holds_all_that_is_shown(variety):
    frame = Frame.of(variety)
    for name, results in variety.cases.items():
        case = view(private(results), frame.labels)
        text = digest.to_json(case)
        again = digest.from_json(text, results)
        assert digest.to_json(again) == text
        json.loads(text, parse_constant=lambda constant: pytest.fail(f"{constant} is no JSON"))
        for label, cell in case.cells.items():
            found = again.cells[label]
            assert (found.status, found.reason, found.lost, found.failed, found.total) == (
                cell.status, cell.reason, cell.lost, cell.failed, cell.total,
            )  # fmt: skip
            assert found.standing == cell.standing
            assert found.remarks == cell.remarks
            assert plain(found.scores) == plain(cell.scores)
            assert found.meta == cell.meta
        assert again.keys == case.keys
        assert case_page.digest_name(frame, name) == f"data/{frame.stems[name]}.json"


PLOT = Plot(
    "a", "A", "Ratio_{x} of 5 % & more", None, ["u"],
    [Column("time (s)", [0.5, 1.0]), Column("u, \"low\"", [float("nan"), 2.123456789], "u", "low"), Column("u", [1, 2.0], "u")],
    y="RMSE (m)", log="y",
)  # fmt: skip


def test_data_of_a_figure_are_comma_separated():
    assert to_csv(PLOT) == 'time (s),"u, ""low""",u\n0.5,,1\n1,2.123457,2\n'


def test_a_figure_for_latex_reads_its_data_and_escapes_its_words():
    text = to_latex(PLOT, "a.csv")
    assert r"\begin{semilogyaxis}" in text
    assert r"xlabel={time (s)}, ylabel={RMSE (m)}" in text
    assert text.count(r"\addplot") == 1
    assert r"y index=2]{a.csv}" in text
    assert r"\caption{Ratio\_\{x\} of 5 \% \& more}" in text
    assert tex("a\\b~c^d") == r"a\textbackslash{}b\textasciitilde{}c\textasciicircum{}d"


def test_every_figure_has_its_files(site, tools):
    for page in site.glob("case-*.html"):
        links = [link for link in tools.read(page).links if link.startswith("data/")]
        assert all((site / link).is_file() for link in links)
    assert (site / "data/easy-one-rmse-0.csv").read_text().startswith('time (s),plain,"plain, low","plain, high"')


def test_a_refusal_that_came_later_is_told(written, tools, tmp_path):
    written.add([tools.case("two")], [tools.scripted("c")])
    out = build(written.load(), tmp_path / "site")
    assert "not today" not in (out / "case-one.html").read_text(encoding="utf-8")
    case, choosy = tools.case("one"), tools.scripted("c", refusal="not today")
    recorder = Recorder(str(written.folder), "x", Catalog(Registry("e", (choosy,)), Registry("c", (case,)), {}))
    recorder.refusal(written._block(REFUSAL, case, choosy, 1))
    build(written.load(), out)
    assert "not today" in (out / "case-one.html").read_text(encoding="utf-8")
