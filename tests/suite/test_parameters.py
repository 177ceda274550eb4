"""Types and ranges of parameters, labels, text to values."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from suite import parameters
from suite.errors import BadInput
from suite.parameters import parameter


@dataclass(frozen=True)
class Knobs:
    """One parameter of every type."""

    count: int = parameter(5, "a count", low=1, high=9)
    gain: float = parameter(0.5, "a gain", above=0, high=1)
    fast: bool = parameter(False, "whether to hurry")
    scheme: str = parameter("systematic", "a scheme", choices=("systematic", "residual"))
    name = "knobs"


class Bare:
    """Nothing to set."""

    name = "bare"


def test_values_and_label():
    assert parameters.values(Knobs()) == {"count": 5, "gain": 0.5, "fast": False, "scheme": "systematic"}
    assert parameters.values(Bare()) == {}
    assert parameters.label(Knobs()) == "knobs"
    assert parameters.label(Knobs(count=6, fast=True)) == "knobs[count=6,fast=True]"
    assert parameters.label(Bare()) == "bare"


def test_the_label_of_a_variant_gives_the_variant_back():
    made = Knobs(3, 1 / 3, True, "residual")
    settings = dict(item.split("=") for item in parameters.label(made)[len("knobs[") : -1].split(","))
    assert parameters.variant(Knobs(), settings) == made


def test_text_becomes_values():
    made = parameters.variant(Knobs(), {"count": "7", "gain": "1e-3", "fast": "TRUE", "scheme": "residual"})
    assert made == Knobs(7, 1e-3, True, "residual")
    assert type(made.count) is int
    assert type(made.gain) is float
    assert type(made.fast) is bool


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("count", "x", "count must be an integer, got 'x'"),
        ("count", "1.0", "count must be an integer, got '1.0'"),
        ("count", "0", "count must be at least 1, got 0"),
        ("count", "10", "count must be at most 9, got 10"),
        ("gain", "x", "gain must be a number, got 'x'"),
        ("gain", "0", "gain must be above 0, got 0"),
        ("gain", "1.5", "gain must be at most 1, got 1.5"),
        ("gain", "nan", "gain must be finite, got nan"),
        ("gain", "-inf", "gain must be finite, got -inf"),
        ("fast", "yes", "fast must be true or false, got 'yes'"),
        ("scheme", "best", "scheme must be one of .*, got 'best'"),
        ("coutn", "1", "knobs has no parameter 'coutn'; did you mean 'count'"),
    ],
)
def test_wrong_text_is_named(name, text, words):
    with pytest.raises(BadInput, match=words):
        parameters.variant(Knobs(), {name: text})


def test_nothing_to_set():
    with pytest.raises(BadInput, match="bare has no parameter 'gain'; it has no parameters"):
        parameters.variant(Bare(), {"gain": "1"})


@pytest.mark.parametrize(
    ("changes", "words"), [({"count": True}, "an integer"), ({"count": 2.0}, "an integer"), ({"fast": 1}, "true or")]
)
def test_values_of_the_wrong_type(changes, words):
    with pytest.raises(BadInput, match=words):
        parameters.check(Knobs(**changes))


def test_a_number_may_be_written_without_a_point():
    parameters.check(Knobs(gain=1))


@dataclass(frozen=True)
class Odd:
    """A parameter that no command line can set."""

    rule: Callable[[int], int] = abs
    name = "odd"


def test_types_that_no_text_can_give():
    with pytest.raises(BadInput, match=r"odd: rule is a parameter of type .*; use int, float, bool or str"):
        parameters.check(Odd())
