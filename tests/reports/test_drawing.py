"""Marks, formulas and figures."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from reports.figures import beyond, frame, over_time
from reports.formula import mathml, prose
from reports.marks import COLOURS, DASHES, marks
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


def test_what_is_far_from_a_target_does_not_hide_what_is_near():
    """An axis with a target ends at a thousand times it, unless nothing would be left; one without reaches everything."""
    near, far = series("a", [0.5, 1, 2]), series("b", [1, 1e6, 1e9])
    assert beyond([near, far], 1.0) == 1000
    assert "1000" in texts(draw(near, far, target=1.0))
    assert "10⁸" not in texts(draw(near, far, target=1.0))
    assert "10⁸" in texts(draw(near, far))
    assert beyond([near], 1.0) == beyond([near, far], None) == beyond([series("c", [1e6, 1e9])], 1.0) == np.inf
    assert "10⁸" in texts(draw(series("c", [1e6, 1e9]), target=1.0))


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
