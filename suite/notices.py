"""What the `run` command says before and after, and the exit codes of all commands."""

import sys
from collections.abc import Sequence

from suite.plan import ESTIMATE, TRUTH, Plan
from suite.record import Report
from suite.registry import Catalog
from suite.run import Outcome
from suite.tables import print_table

DONE, TROUBLE, BAD = 0, 1, 2
INTERRUPTED = 130


def complain(message: str) -> None:
    """Say on standard error, in one line, what went wrong."""
    print(f"filterbench: {' '.join(message.split())}", file=sys.stderr)


def announce(planned: Plan, estimators: Sequence[int], runs: Sequence[int], seed: int, results: str) -> None:
    """Say how much there is to run, for so many estimators and runs on each case."""
    each, columns = (" to ".join(map(str, sorted({min(n), max(n)}))) for n in (runs, estimators))
    print(
        f"{planned.cells} cells ({columns} estimators x {len(runs)} cases, {planned.refused} refused), {each} runs each, "
        f"seed {seed}: {len(planned.blocks)} blocks to run, {planned.stored} stored already in {results}"
    )
    if planned.stored_failures:
        print(f"{planned.stored_failures} of the stored blocks hold failures; --retry-failed runs them again")


def show(planned: Plan) -> None:
    """Print which cells have blocks to run."""
    rows: dict[tuple[str, str, str], int] = {}
    for block in planned.blocks:
        key = (block.case, block.estimator or "", block.kind)
        rows[key] = rows.get(key, 0) + 1
    print_table("would run", ("case", "estimator", "kind", "blocks"), [(*key, str(n)) for key, n in rows.items()])


def conclude(outcome: Outcome, known: Catalog, results: str) -> int:
    """Say what went wrong, cell by cell, one line each, and choose the exit code.

    A plug-in that fails in every run it was given is bad input; anything else that fails is a result.
    """
    cells: dict[tuple[str, str], list[Report]] = {}
    for report in outcome.reports:
        cells.setdefault((report.block.case, report.block.estimator or ""), []).append(report)
    unsound = {case for (case, estimator), reports in cells.items() if not estimator and any(r.failed for r in reports)}
    tally: dict[str, list[tuple[int, int]]] = {}
    for (case, estimator), reports in cells.items():
        culprit = f"case {case}" if case in unsound or not estimator else f"estimator {estimator.partition('[')[0]}"
        counted = [r for r in reports if r.block.kind in (TRUTH, ESTIMATE)]
        failed, total = sum(r.failed for r in counted), sum(r.block.count for r in counted)
        tally.setdefault(culprit, []).append((failed, total))
        reason = next((r.reason for r in [*counted, *reports] if r.failed), "")
        if reason:
            other = "it could not be timed" if estimator else "its bounds could not be computed"
            what = f"{failed} of {total} runs failed or were lost" if failed else other
            source = f" (plug-in {known.plugins[culprit]})" if culprit in known.plugins else ""
            complain(f"{estimator or 'simulation'} on {case}{source}: {what}; {reason}")
    print(f"{len(outcome.reports)} blocks finished; `filterbench score --results {results}` shows the scores")
    hopeless = [c for c, counts in tally.items() if 0 < sum(f for f, _ in counts) == sum(n for _, n in counts)]
    if any(culprit in known.plugins for culprit in hopeless):
        return BAD
    return TROUBLE if any(r.failed for r in outcome.reports) else DONE
