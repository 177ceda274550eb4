"""The command that makes the results of a case's page again."""

import shlex
from collections.abc import Iterator

from reports.views import CaseView

KEPT = ("--profile", "--time-limit")
"""Options of the command that made the results which are told again, beside plug-ins, runs and seed."""


def command(case: CaseView) -> str:
    """The command that makes the results of the page again; a line for each number of runs, where estimators differ in it."""
    by_runs: dict[int, list[str]] = {}
    most = case.runs or max((cell.total for cell in case.cells.values()), default=0) or 1
    for label, cell in case.cells.items():
        if cell.status != "not run" or cell.failures:
            by_runs.setdefault(cell.total or most, []).append(label)
    calm = case.results.calm
    names = [case.card.name, *([calm.card.name] if calm else [])]
    rest = ["--seed", str(case.results.seed), *_options(case)]
    lines = [
        ["filterbench", "run", "-c", *map(_quoted, names), "-e", *map(shlex.quote, labels), "--runs", str(runs), *rest]
        for runs, labels in sorted(by_runs.items(), reverse=True)
    ]
    return "\n".join(" ".join(line) for line in lines)


def compare_command(case: CaseView, reference: str) -> str:
    """The command that prints the paired differences of the page."""
    return f"filterbench compare {shlex.quote(reference)} -c {_quoted(case.card.name)} -m rmse"


def _quoted(name: str) -> str:
    """A name in quotes, as a shell needs them for most names of cases."""
    return "'" + name.replace("'", "'\"'\"'") + "'"


def _options(case: CaseView) -> Iterator[str]:
    """Options that the stored commands have: plug-ins of any, others where all say the same."""
    entries = [entry for cell in case.results.cells.values() for entry in [*cell.estimates, *cell.timings]]
    found = [_given(str(entry.meta.get("command", ""))) for entry in entries]
    for option in KEPT:
        values = {tuple(value for name, value in given if name == option) for given in found}
        if len(values) == 1 and (value := values.pop()):
            yield from (option, shlex.quote(value[-1]))
    for plugin in dict.fromkeys(value for given in found for name, value in given if name == "--plugin"):
        yield from ("--plugin", shlex.quote(plugin))


def _given(text: str) -> list[tuple[str, str]]:
    """Options of a command with their values, as far as they matter here."""
    try:
        words = shlex.split(text)
    except ValueError:
        return []
    found = []
    for word, following in zip(words, [*words[1:], ""], strict=True):
        name, equals, value = word.partition("=")
        if name in (*KEPT, "--plugin") and (equals or following):
            found.append((name, value if equals else following))
        elif word.endswith(".toml"):  # a recording that was named among the cases is a plug-in too
            found.append(("--plugin", word))
    return found
