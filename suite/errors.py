"""The errors that a user can mend: one line, naming the culprit and the mend."""

import difflib
from collections.abc import Iterable


class BadInput(Exception):
    """Something given to filterbench is wrong; the message is one line and says how to mend it."""


class UnknownName(BadInput, KeyError):
    """A name that is in no registry."""

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])


class StoreError(BadInput):
    """The results folder cannot be read or written."""


def near(name: str, known: Iterable[str]) -> str:
    """A hint with the known names nearest to `name`, or all of them when none is near."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    if close:
        return "did you mean " + " or ".join(repr(c) for c in close) + "?"
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f"known: {shown}" if known else "none is known"


def one_line(error: BaseException) -> str:
    """Type and message of an error on one line of bearable length."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}"[:300] if text else type(error).__name__
