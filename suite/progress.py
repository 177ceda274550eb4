"""Progress of long work: a bar with the time left on a terminal, now and then a plain line elsewhere."""

import sys
import time
from types import TracebackType

from rich import progress as bars
from rich.console import Console

from suite.record import Report

PLAIN_EVERY = 10.0  # s


class Progress:
    """Counts finished blocks, on standard error."""

    def __init__(self, total: int):
        self.total, self.done = total, 0
        self.begin = self.spoke = time.monotonic()
        self.bar: bars.Progress | None = None
        if total and sys.stderr.isatty():
            columns = (
                bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(), bars.TimeRemainingColumn(),
            )  # fmt: skip
            self.bar = bars.Progress(*columns, console=Console(stderr=True))
            self.task = self.bar.add_task("blocks", total=total)

    def __enter__(self) -> "Progress":
        if self.bar:
            self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self.bar:
            self.bar.stop()

    def advance(self, report: Report) -> None:
        """One more block is finished."""
        self.done += 1
        if self.bar:
            words = f"{report.block.estimator or 'truth'} on {report.block.case}"
            self.bar.update(self.task, advance=1, description=words)
        elif self.done < self.total and time.monotonic() - self.spoke > PLAIN_EVERY:
            self.spoke = time.monotonic()
            left = (self.spoke - self.begin) / self.done * (self.total - self.done)
            print(f"{self.done} of {self.total} blocks, about {left:.0f} s left", file=sys.stderr, flush=True)
