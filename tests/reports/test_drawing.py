"""Marks, formulas and figures."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from reports import svg
from reports.canvas import axes_of, drawing, whiskers
from reports.figures import extremes, over_time, value_axis
from reports.formula import mathml, prose
from reports.marks import COLOURS, DASHES, marks
from reports.plots.over_time import beyond
from reports.plots.plane import frame
from reports.series import Series
from suite.metrics import METRICS


def test_no_colour_and_dash_come_twice():
    found = marks([f"e{i}" for i in range(COLOURS * len(DASHES))])
    assert len({(m.colour, m.dash) for m in found.values()}) == COLOURS * len(DASHES)


def series(label, value, low=None, high=None):
    value = np.asarray(value, float)
    steps = len(value)
    low, high = (value if band is None else np.asarray(band, float) for band in (low, high))
    return Series(label, np.arange(1.0, steps + 1), value, np.arange(steps), low, high, 3, 3)


def draw(*lines, target=None):
    return over_time(lines, marks([line.label for line in lines]), "fig", "RMSE (m)", "RMSE over time", target)


def texts(drawing):
    return re.findall(r"<text[^>]*>([^<]*)</text>", drawing)


def test_a_wide_range_has_a_logarithmic_axis():
    assert "1000" in texts(draw(series("a", [1, 1, 1]), series("b", [10, 100, 2000])))
    assert "2000" in texts(draw(series("a", [900, 1500, 2000]), series("b", [1000, 900, 2000])))


@pytest.mark.parametrize(
    ("low", "high", "some"),
    [
        (1e-4, 1e-1, ["0.0001", "0.001", "0.01"]),
        (1e-6, 1e1, ["10⁻⁴", "10⁻²", "10⁰"]),
        (1e3, 9e4, ["1000", "10000"]),
        (1e3, 9e5, ["10⁴", "10⁵"]),
    ],
)
def test_the_numbers_at_the_ticks_of_an_axis_are_all_plain_or_all_with_powers(low, high, some):
    found = texts(draw(series("a", np.geomspace(low, high, 9))))
    numbers = [text for text in found if re.fullmatch(r"[\d.]+( × )?[\d⁰¹²³⁴⁵⁶⁷⁸⁹⁻.]*", text)][10:]
    assert set(some) <= set(found)
    assert all(("10" in text and text[-1] in "⁰¹²³⁴⁵⁶⁷⁸⁹") == (some[0][-1] in "⁰¹²³⁴⁵⁶⁷⁸⁹") for text in numbers)


def test_one_line_far_above_the_others_leaves_the_axis_and_is_told():
    near, far = [series(f"n{i}", [1, 2, 2]) for i in range(3)], series("far", [1, 700, 8000])
    axis = value_axis([*near, far])
    assert axis.high < 10
    assert "1000" not in texts(draw(*near, far))
    assert beyond([*near, far], axis, "m") == f" The axis ends at {axis.high:.3g} m. Beyond it: far from 2 s on, up to 8000."
    assert beyond(near, axis) == ""


def test_it_is_told_when_a_line_is_beyond_the_axis():
    near = [series(f"n{i}", [1, 2, 2]) for i in range(3)]
    for values, words in (([900, 900, 900], "at all times"), ([900, 1, 900], "at times"), ([1, 1, 900], "from 3 s on")):
        line = series("far", values)
        assert f"far {words}, up to 900" in beyond([*near, line], value_axis([*near, line]))


def test_an_axis_holds_all_lines_that_are_not_far_apart():
    lines = [series("a", [1, 2, 3]), series("b", [1, 50, 60])]
    assert value_axis(lines).high > 60
    assert beyond(lines, value_axis(lines)) == ""


def test_an_axis_suits_the_lines_that_are_shown_at_first():
    """Those behind the eighth widen it to half as much again as these need at most."""
    leading = [series(f"n{i}", [1, 2, 2]) for i in range(8)]
    assert value_axis([*leading, series("last", [1, 1, 2.9])]).high > 2.9
    assert value_axis([*leading, series("last", [1, 1, 20])]).high < 3


def test_an_axis_of_a_bounded_metric_is_linear():
    line = series("a", [1e-30, 1e-30, 1.2])
    assert value_axis([line]).log
    axis = value_axis([line], most=2.0)
    assert not axis.log
    assert axis.low == 0


def test_a_target_is_within_the_axis():
    axis = value_axis([series("a", [0.1, 0.2, 0.2])], 1.0)
    assert axis.low < 1 < axis.high


def test_a_long_line_keeps_its_extremes_and_its_gaps():
    time = np.arange(5000.0)
    value = np.sin(time / 50)
    value[1234], value[4000], value[2500:2510] = 9.0, -7.0, np.nan
    at, kept = extremes(time, value)
    assert len(at) < 400
    assert (np.diff(at) > 0).all()
    assert kept[at == 1234] == 9
    assert kept[at == 4000] == -7
    assert np.isnan(kept).sum() == 10
    assert (at[0], at[-1]) == (0, 4999)
    np.testing.assert_array_equal(kept, value[at.astype(int)])
    np.testing.assert_array_equal(extremes(time[:300], value[:300])[1], value[:300])


@pytest.mark.parametrize("target", [None, 1.0])
@pytest.mark.parametrize(
    "value",
    [[0, 0, 0], [1], [5e-324, 1e308, 1], [np.inf, 1, np.nan], [-1, 2, 3], [1e-300] * 3, [1e308, 1e308, 1e307]],
)
def test_any_finite_value_is_drawn(value, target):
    drawing = draw(series("a", value, np.full(len(value), np.nan), np.full(len(value), np.inf)), target=target)
    ET.fromstring(drawing)
    assert "nan" not in drawing.lower()


@pytest.mark.parametrize("value", [[np.nan, np.inf], []])
def test_nothing_finite_gives_no_figure(value):
    assert draw(series("a", value)) is None
    assert over_time([], {}, "fig", "RMSE", "title") is None


def test_bounds_are_lines_that_widen_the_axis():
    """A bound far below a line makes the axis logarithmic; one of zero is not drawn."""
    line = series("a", [900, 1500, 2000])
    mark = marks(["a"])

    def drawn(*bounds):
        return over_time([line], mark, "fig", "RMSE (m)", "RMSE over time", bounds=bounds)

    low = drawn(np.array([1.0, 2.0, 3.0]), np.array([5.0, 5.0, 5.0]))
    assert "10" in texts(low)
    assert low.count("stroke-dasharray") >= drawn().count("stroke-dasharray") + 2
    assert "10" not in texts(drawn(np.zeros(3)))
    assert "nan" not in drawn(np.full(3, np.nan)).lower()


def test_names_stay_text_in_drawings():
    drawing = over_time(
        [series("$a$ <b>", [1, 2])], marks(["$a$ <b>"]), "fig", "$x$ <script>", "</svg><script>alert(1)</script>"
    )
    ET.fromstring(drawing)
    assert "<script" not in drawing
    assert "$x$ &lt;script&gt;" in texts(drawing)


def test_the_frame_holds_the_truth_and_the_landmarks_with_room():
    low, high = frame(np.array([[0.0, 10.0], [0.0, 0.0]]), np.array([[5.0], [20.0]]))
    assert (low < [0, 0]).all()
    assert (high > [10, 20]).all()
    low, high = frame(np.zeros((2, 3)), np.empty((2, 0)))
    assert (high > low).all()


def test_all_formulas_of_the_metrics_convert():
    for metric in METRICS.values():
        assert mathml(metric.formula).startswith("<math"), metric.name


def test_units_are_upright_and_tall_parentheses_are_drawn():
    made = mathml(r"\sigma = 10\ \mathrm{m}, \quad z \sim \begin{pmatrix} a \\ b \end{pmatrix}")
    assert "<mtext>m</mtext>" in made
    assert "<mo>∼</mo>" in made
    assert '<mtable class="parentheses">' in made
    assert "<mo>(</mo>" not in made


@pytest.mark.parametrize(
    "latex", [r"\frac{", r"\href{javascript:alert(1)}{x}", r"\begin{pmatrix}", "<script>alert(1)</script>", ""]
)
def test_a_faulty_or_hostile_formula_does_no_harm(latex):
    made = mathml(latex)
    assert made.startswith(("<math", '<code class="latex">'))
    assert "<script" not in made
    assert "javascript:" not in made or "<math" not in made


def test_words_in_backticks_are_code_and_lead_to_their_case():
    made = prose("see `a/b`, `<i>` and x", {"a/b": "case-a-b.html"})
    assert made == 'see <a href="case-a-b.html"><code>a/b</code></a>, <code>&lt;i&gt;</code> and x'
    assert prose("a ` <b>", {}) == "a ` &lt;b&gt;"


def test_lines_of_a_group_that_look_alike_are_one_path_and_marks_say_their_look_once():
    with drawing():
        axes = axes_of()
        axes.hlines([1.0, 2.0, 3.0], 0.0, [1.0, 2.0, 3.0], colors=svg.colour(1)).set_gid("series-0-whiskers")
        axes.plot([1.0, 2.0], [1.0, 2.0], "o", color=svg.colour(2))[0].set_gid("series-1-dots")
        found = svg.inline(axes.figure, "fig-x", "Title", "Words")
    lines, marks = (re.search(rf'<g class="series" data-series="{n}".*?</g>', found, re.S)[0] for n in (0, 1))
    (path,) = re.findall(r' d="([^"]*)"', lines)
    assert len(re.findall(r"M [\d.]+ [\d.]+ L [\d.]+ [\d.]+", path)) == 3
    assert lines.count("var(--s1)") == 1
    assert len(re.findall(r"<use [^>]*/>", marks)) == 2
    assert marks.count("fill: var(--s2)") == 1
    assert "<style" not in found


def test_bars_along_both_axes_are_apart_and_end_at_the_limits():
    with drawing():
        axes = axes_of()
        axes.set_xlim(0, 10)
        axes.set_ylim(0, 5)
        x, y = np.array([1.0, 5.0]), np.array([2.0, 3.0])
        across, along = np.array([[0.5, 4.0], [2.0, 20.0]]), np.array([[1.0, -3.0], [2.5, 4.0]])
        whiskers(axes, x, y, marks(["a"])["a"], across, along)
    (drawn,) = axes.lines
    bars = np.ma.clump_unmasked(np.ma.masked_invalid(drawn.get_xdata()))
    found = [[tuple(point) for point in drawn.get_xydata()[bar].tolist()] for bar in bars]
    assert found == [[(0.5, 2), (2, 2)], [(4, 3), (10, 3)], [(1, 1), (1, 2.5)], [(5, 0), (5, 4)]]
