"""Prints, at the end of the bench, what its tests have left in `benchmark.extra_info` under the name of a table."""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import pandas
import pytest

ROWS = pytest.StashKey[dict[str, list[dict[str, Any]]]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = defaultdict(list)


@pytest.fixture(autouse=True)
def kept(benchmark, pytestconfig: pytest.Config) -> Iterator[None]:
    """A benchmark's figures become a row of its table; those of no table are left to pytest-benchmark's own."""
    yield
    if benchmark.stats is not None:
        benchmark.stats.group = benchmark.group  # pytest-benchmark takes the one from before the call
    if "table" in benchmark.extra_info:
        row = {name: value for name, value in benchmark.extra_info.items() if name != "turns"}
        pytestconfig.stash[ROWS][row.pop("table")].append(row)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    for title, rows in config.stash[ROWS].items():
        terminalreporter.section(title)
        terminalreporter.write_line(pandas.DataFrame(rows).to_string(index=False, float_format="{:.2f}".format, na_rep=""))
