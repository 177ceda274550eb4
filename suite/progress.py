"""Progress of long work: a bar with the time left on a terminal, now and then a plain line elsewhere."""

import sys
import time
from types import TracebackType

from rich import progress as bars
from rich.console import Console

PLAIN_EVERY = 10.0  # s


class Progress:
    """Counts what is finished, on standard error; `what` says what is counted, such as blocks."""

    def __init__(self, total: int, what: str):
        self.total, self.what, self.done = total, what, 0
        self.begin = self.spoke = time.monotonic()
        self.bar: bars.Progress | None = None
        if total and sys.stderr.isatty():
            columns = (
                bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(), bars.TimeRemainingColumn(),
            )  # fmt: skip
            self.bar = bars.Progress(*columns, console=Console(stderr=True))
            self.task = self.bar.add_task(what, total=total)

    def __enter__(self) -> "Progress":
        if self.bar:
            self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self.bar:
            self.bar.stop()

    def advance(self, words: str) -> None:
        """One more is finished, which words describe."""
        self.done += 1
        if self.bar:
            self.bar.update(self.task, advance=1, description=words)
        elif self.done < self.total and time.monotonic() - self.spoke > PLAIN_EVERY:
            self.spoke = time.monotonic()
            left = (self.spoke - self.begin) / self.done * (self.total - self.done)
            print(f"{self.done} of {self.total} {self.what}, about {left:.0f} s left", file=sys.stderr, flush=True)
