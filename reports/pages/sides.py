"""Two result sets beside each other: where they come from, which cells came or went, and what became of the others."""

from collections.abc import Iterable, Sequence
from typing import Any

from reports.inputs import Inputs
from reports.text import count, listed
from suite.changes import ABSENT, CaseChanges, State
from suite.results import Results

MOST_NAMES = 6


def shared(inputs: Inputs) -> list[str]:
    """Names of the cases that both result sets hold."""
    return [name for name in inputs.loaded.cases if inputs.against and name in inputs.against.cases]


def came_and_went(inputs: Inputs, cases: Sequence[CaseChanges]) -> list[tuple[str, str, str]]:
    """Cells and cases of one side alone, and refusals and failures that came or went: what, which, and how."""
    assert inputs.against
    before, after = inputs.against.cases, inputs.loaded.cases
    alone = ("new cases", [name for name in after if name not in before]), ("cases gone", [n for n in before if n not in after])
    found = [(word, listed(names, MOST_NAMES), "") for word, names in alone if names]
    moved: dict[tuple[str, str, str], list[str]] = {}
    for case in cases:
        for label, (was, now) in case.states.items():
            if word := _turn(was, now):
                moved.setdefault((word, label, _how(was, now)), []).append(case.case)
    alike: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for (word, label, how), names in moved.items():
        alike.setdefault((word, how, tuple(names)), []).append(label)
    return found + [
        (word, listed(labels, MOST_NAMES), f"on {listed(names, MOST_NAMES)}{how}")
        for (word, how, names), labels in sorted(alike.items(), key=lambda item: item[0][0])
    ]


def _turn(was: State, now: State) -> str:
    """What happened to a cell in a word or two; nothing where it is as it was."""
    if ABSENT in (was, now):
        return "new" if was == ABSENT else "gone"
    if (was.status == "refused") != (now.status == "refused"):
        return "refusal" if now.status == "refused" else "no longer refused"
    bad = was.lost + was.failed, now.lost + now.failed
    if (bad[0] > 0) != (bad[1] > 0):
        return "failures came" if bad[1] else "failures went"
    return "failures changed" if (was.lost, was.failed) != (now.lost, now.failed) else ""


def _how(was: State, now: State) -> str:
    if ABSENT in (was, now):
        return ""
    return f": {_words(was)} before, {_words(now)} after"


def _words(state: State) -> str:
    wrong = listed([f"{n} {what}" for what, n in (("lost", state.lost), ("failed", state.failed)) if n])
    told = f"{wrong} of {count(state.total, 'run')}" if state.lost + state.failed else state.status
    return f"{told} ({state.reason})" if state.reason else told


def sides(inputs: Inputs) -> list[tuple[str, str, str]]:
    """Where the numbers of before and after come from, fact by fact."""
    if inputs.against is None:
        return []
    before, after = _facts(inputs.against), _facts(inputs.loaded)
    return [(name, before.get(name, "none"), after.get(name, "none")) for name in before | after]


def _facts(results: Results) -> dict[str, str]:
    metas = [entry.meta for entry in results.entries]
    made = sorted(str(meta["created"])[:16].replace("T", " ") + " UTC" for meta in metas)
    facts: dict[str, Iterable[Any]] = {"made": dict.fromkeys([made[0], made[-1]]) if made else ()}
    facts["seeds"] = sorted({case.seed for case in results.cases.values()})
    facts |= {name: _told(metas, "host", name) for name in _names(metas, "host")}
    facts |= {name: _told(metas, "versions", name) for name in _names(metas, "versions")}
    return {name: " to ".join(map(str, said)) if name == "made" else listed(map(str, said)) for name, said in facts.items()}


def _names(metas: Sequence[Any], part: str) -> list[str]:
    return list(dict.fromkeys(name for meta in metas for name in meta.get(part, {})))


def _told(metas: Sequence[Any], part: str, name: str) -> list[str]:
    return sorted({str(meta.get(part, {}).get(name, "none")) for meta in metas})


def versions(inputs: Inputs) -> tuple[int, int]:
    """Of how many cells that both hold the sources, parameters and seed are the same, and how many there are."""
    assert inputs.against
    before, after = inputs.against.cases, inputs.loaded.cases
    pairs = [
        (before[n].cells[label], cell)
        for n in shared(inputs)
        for label, cell in after[n].cells.items()
        if label in before[n].cells
    ]
    told = [{entry.meta["version"] for cell in pair for entry in cell.estimates} for pair in pairs]
    return sum(len(versions) == 1 for versions in told), sum(len(versions) > 0 for versions in told)
