"""The examination of an estimator: all rules of suite/conformance.py on some cases, and what to say of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from suite.case import Case
from suite.conformance import CHECKS, NEEDED, Check, accepts, run
from suite.errors import BadInput, one_line
from suite.estimator import Estimator
from suite.linalg import Array
from suite.trial import Finding, Trial


@dataclass(frozen=True)
class Verdict:
    """What became of a check on a case: ok, refused with a reason, or what was found and the rule that it breaks."""

    check: str
    case: str
    words: str = "ok"
    broken: bool = False


def examine(estimator: Estimator, problems: Sequence[tuple[Case, Array]]) -> Iterator[Verdict]:
    """The verdicts of all checks on cases with their measurements [T, m, R]; never raises for an estimator's faults."""
    refused = 0
    for case, y in problems:
        trial = Trial(estimator, case, y)
        for check in CHECKS:
            if check is run and trial.refusal:
                refused += 1
                yield Verdict(title(check), case.name, f"refused: {' '.join(trial.refusal.split())}")
                break
            try:
                check(trial)
            except Exception as error:
                what = str(error) if isinstance(error, Finding | BadInput) else one_line(error)
                rule = (check.__doc__ or "").strip(" .")
                yield Verdict(title(check), case.name, f"{what}; {rule[0].lower()}{rule[1:]}", broken=True)
                if check in NEEDED:
                    break
            else:
                yield Verdict(title(check), case.name)
    if refused == len(problems):
        words = "every case on offer is refused, so nothing was run; name one that is accepted"
        yield Verdict(title(accepts), "", words, broken=True)


def title(check: Check) -> str:
    """Name of a check in words."""
    return check.__name__.replace("_", " ")


def summary(verdicts: Sequence[Verdict]) -> list[tuple[str, str, str]]:
    """Rows (check, cases, words) in the order of the checks; cases with the same words share a row."""
    merged: dict[tuple[str, str], list[str]] = {}
    for verdict in verdicts:
        merged.setdefault((verdict.check, verdict.words), []).append(verdict.case)
    order = [title(check) for check in CHECKS]
    rows = [(check, _some(cases), words) for (check, words), cases in merged.items()]
    return sorted(rows, key=lambda row: order.index(row[0]))


def _some(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
