"""Numbers and lists in words."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.text import count, listed, quantity, slugs, tick
from suite.digits import THIN, number, place
from suite.metrics import METRICS, Score

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def back(text):
    """The number that a text shows."""
    text = text.replace(THIN, "").replace("−", "-")
    mantissa, times, power = text.partition(" × 10")
    return float(mantissa) * 10.0 ** int(power.translate(SUPERSCRIPTS)) if times else float(text)


def shown(name, value, low, high, unit="", runs=12, total=12):
    words = quantity(Score(value, low, high, unit, runs, total), METRICS[name])
    return words.value, words.unit, words.interval


@pytest.mark.parametrize(
    ("name", "score", "expected"),
    [
        ("rmse", (8.1862, 7.85, 8.69, "m"), ("8.2", "m", "7.8 to 8.7")),
        ("rmse", (26.82, 26.68, 27.02, "m"), ("26.8", "m", "26.7 to 27.0")),
        ("nees", (185.4, 1.5, 872.7, ""), ("190", "", "1.5 to 870")),
        ("nees", (math.inf, 3.415e31, math.inf, ""), ("∞", "", "3.4 × 10³¹ to ∞")),
        ("nees", (0.000123, 0.000121, 0.000126, ""), ("1.23 × 10⁻⁴", "", "1.21 × 10⁻⁴ to 1.26 × 10⁻⁴")),
        ("divergence", (0.0, 0.0, 0.2646, ""), ("0", "%", "0 to 26 %")),
        ("auc", (0.56, 7.5e-15, 1.0, ""), ("0.56", "", "0 to 1.00")),
        ("divergence", (1 / 12, 0.0021, 0.385, ""), ("8.3", "%", "0.21 to 38.5 %")),
        ("latency", (242.3, 228.9, 268.8, "µs"), ("240", "µs", "230 to 270")),
        ("latency", (1260.0, 1197.0, 1433.0, "µs"), ("1.26", "ms", "1.20 to 1.43")),
        ("throughput", (67290.0, 66780.0, 67720.0, "run-steps/s"), ("67 300", "run-steps/s", "66 800 to 67 700")),
        ("eta", (3.989, 3.741, 4.272, "mixed"), ("4.0", "mixed units", "3.7 to 4.3")),
        ("rmse", (13.49, 13.489999, 14.54, "m"), ("13.5", "m", "13.5 to 14.5")),
        ("nees", (7000.0, 16.0, 2.428e9, ""), ("7000", "", "16 to 2.43 × 10⁹")),
        ("rmse", (1.0, 1.0, 1.0, "m"), ("1.000", "m", "1.000 to 1.000")),
    ],
)
def test_scores_have_the_digits_that_their_interval_supports(name, score, expected):
    value, low, high, unit = score
    assert tuple(part.replace(THIN, " ") for part in shown(name, value, low, high, unit)) == expected


def test_a_score_without_interval_says_why():
    assert shown("rmse", 8.1862, math.nan, math.nan, "m", runs=1, total=1) == ("8.19", "m", "one run")
    assert shown("rmse", math.nan, math.nan, math.nan, "m", runs=0) == ("none", "", "")
    assert shown("rmse", 8.0, math.nan, 9.0, "m")[2] == "no interval"


ANY = st.floats(min_value=-1e300, max_value=1e300, allow_nan=False)


@given(st.tuples(ANY, ANY, ANY).map(sorted))
def test_what_is_shown_keeps_its_order(values):
    low, value, high = values
    last = place(value, low, high)
    texts = [back(number(x, last)) for x in (low, value, high)]
    assert texts[0] <= texts[1] * (1 + 1e-12 * math.copysign(1, texts[1]))
    assert texts[1] <= texts[2] * (1 + 1e-12 * math.copysign(1, texts[2]))


@given(st.floats(min_value=1e-300, max_value=1e300), st.integers(-320, 320))
def test_a_number_is_off_by_less_than_a_twentieth(x, last):
    assert back(number(x, last)) == pytest.approx(x, rel=0.0501)


@given(st.floats())
def test_every_float_has_a_text(x):
    assert number(x)
    assert tick(x)


@pytest.mark.parametrize(
    ("x", "expected"),
    [(0, "0"), (0.001, "0.001"), (-1200, "−1200"), (1e5, "10⁵"), (2e6, "2 × 10⁶"), (1e-7, "10⁻⁷"), (1.5e21, "1.5 × 10²¹")],
)
def test_ticks(x, expected):
    assert tick(x) == expected


def test_lists_and_counts():
    assert listed(["a"]) == "a"
    assert listed("abc") == "a, b and c"
    assert listed("abcdef", 3) == "a, b and 4 others"
    assert listed([]) == "none"
    assert (count(1, "run"), count(12, "run"), count(0, "entry", "entries")) == ("1 run", "12 runs", "0 entries")


@given(st.lists(st.text(), unique=True))
def test_slugs_are_unique_and_fit_for_files(names):
    found = slugs(names)
    assert len(set(found.values())) == len(names)
    assert all(s and set(s) <= set("abcdefghijklmnopqrstuvwxyz0123456789-") and len(s) < 160 for s in found.values())


def test_a_slug_does_not_depend_on_the_order():
    assert slugs(["A b", "a-b", "c"]) == slugs(["c", "a-b", "A b"])
