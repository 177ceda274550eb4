"""Names, patterns, variants."""

from dataclasses import dataclass

import pytest

from suite.errors import BadInput, UnknownName
from suite.parameters import parameter
from suite.registry import Registry, split_variant


class Plain:
    """An entry without parameters."""

    name = "plain"


@dataclass(frozen=True)
class Tuned:
    """An entry whose name is no parameter."""

    gain: float = parameter(0.5, "a gain", low=0)
    count: int = parameter(3, "a count", low=1)
    name = "tuned"


class Other:
    """An entry that comes later."""

    name = "other"


REGISTRY = Registry("estimator", [Plain(), Tuned()])


def test_order_and_length():
    assert list(REGISTRY) == ["plain", "tuned"]
    assert len(REGISTRY) == 2
    assert list(REGISTRY.extended([Other()])) == ["plain", "tuned", "other"]
    assert list(REGISTRY) == ["plain", "tuned"], "a registry does not change"


def test_two_entries_of_one_name():
    with pytest.raises(BadInput, match="two estimators are named 'plain'; rename one"):
        REGISTRY.extended([Plain()])


def test_variants():
    assert REGISTRY["tuned"].gain == 0.5
    assert REGISTRY["tuned[gain=0.25]"] == Tuned(gain=0.25)
    assert REGISTRY["tuned[ gain = 0.25 , count=4 ]"] == Tuned(0.25, 4)


def test_unknown_names_suggest_near_ones():
    with pytest.raises(UnknownName, match=r"unknown estimator 'tund'; did you mean 'tuned'\?"):
        REGISTRY["tund"]
    with pytest.raises(UnknownName, match="known: plain, tuned"):
        REGISTRY["xyz"]


def test_patterns_select_each_entry_once_in_registry_order():
    names = [e.name for e in REGISTRY.select(["t*", "*", "plain"])]
    assert names == ["plain", "tuned"]
    assert [e.name for e in REGISTRY.select([])] == ["plain", "tuned"]
    assert [e.name for e in REGISTRY.select(["[pq]lain"])] == ["plain"], "brackets without '=' are a set of characters"


def test_patterns_with_settings():
    found = REGISTRY.select(["tuned[gain=1]", "tuned", "t*[gain=1.0]", "tuned[gain=2]"])
    assert sorted(e.gain for e in found) == [0.5, 1.0, 2.0], "the same variant counts once, however it is written"


def test_settings_equal_to_the_defaults_are_the_plain_entry():
    assert REGISTRY.select(["tuned[gain=0.5]", "tuned"]) == [Tuned()]


def test_only_estimators_take_settings():
    with pytest.raises(BadInput, match="a case takes no settings"):
        Registry("case", [Plain()]).select(["plain[a=1]"])


@pytest.mark.parametrize(
    "text", ["a[b=1", "a]b=1[", "a[b=]", "a[=1]", "a[b=1,]", "a[b=1,b=2]", "a[b=1]c", "a[b=1][c=2]", "a[b=1,c]"]
)
def test_malformed_settings(text):
    with pytest.raises(BadInput, match="write settings as"):
        split_variant(text)


def test_names_without_settings():
    assert split_variant("peer:name-1.5") == ("peer:name-1.5", {})
    assert split_variant("*[ab]*") == ("*[ab]*", {})
