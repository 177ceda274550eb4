"""Running times from the JSON that pytest-benchmark writes, as one source of the table of scores beside the store."""

import itertools
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from suite.errors import BadInput, one_line
from suite.metrics import METRICS
from suite.metrics.cost import quantile_ranks
from suite.notices import complain
from suite.registry import matches
from suite.tables import print_table

Row = dict[str, Any]
ABOUT = ("date", "machine", "commit")
COLUMNS = ("source", *ABOUT, "name", "group", "batch", "steps", "rounds")
"""What a row of a benchmark tells beyond those of the store; batch is how many runs a call carried."""
WHOLE = ("seed", "runs", "total", "lost", "failed", "batch", "steps", "rounds")
STORED = "stored"
RATIO = re.compile(r".+[ _]to[ _](.+)")
"""Names of ratios that a benchmark tells: of its time to that of what it is held against, for the same work."""
HEADER = ("benchmark", "runs", "metric", "value", "95 % interval", "rounds")


def read(path: str) -> list[Row]:
    """A row for each benchmark of a file, with the median over its rounds. Raises BadInput when it cannot be read.

    A benchmark that says its estimator, case, runs and steps gives a latency (one run) or a throughput; of the whole call,
    so with all that it does beside its steps. Any other gives the duration of its call in seconds. Beside the columns of a
    table a row has `node`, `python`, `dirty` (whether changes were not committed), `against` (ratios of its time to that of
    others, by name, with low and high: of those that `tests/benchmarks/timing.py` times in turns with it) and `told` (all else
    that the benchmark says).
    """
    mend = "name a file that pytest-benchmark wrote, such as those of `nox -s bench` in bench/"
    try:
        said = json.loads(Path(path).read_text(encoding="utf-8"))
        machine, commit = said["machine_info"], said["commit_info"]
        about: Row = {"source": path, "date": str(said["datetime"]), "commit": str(commit["id"])}
        about["machine"] = str(machine.get("cpu", {}).get("brand_raw") or machine["machine"])
        about["dirty"] = bool(commit.get("dirty"))
        about |= {name: str(machine.get(key, "unknown")) for name, key in (("node", "node"), ("python", "python_version"))}
        return [about | _row(benchmark) for benchmark in said["benchmarks"]]
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}; {mend}") from error
    except Exception as error:  # whatever a damaged file makes the reader raise
        raise BadInput(f"{path} is damaged or no JSON of pytest-benchmark ({one_line(error)}); {mend}") from error


def select(paths: Iterable[str], cases: Sequence[str], estimators: Sequence[str], metrics: Sequence[str]) -> list[Row]:
    """The rows of some files that match the patterns given; no patterns match all. Says so of a file that has none."""
    wanted = {"case": cases, "estimator": estimators, "metric": metrics}
    found = []
    for path in paths:
        rows = read(path)
        chosen = [row for row in rows if all(matches(row.get(kind, ""), patterns) for kind, patterns in wanted.items())]
        if not chosen:
            asked = " and ".join(f"{kind} {' '.join(map(repr, p))}" for kind, p in wanted.items() if p)
            complain(f"none of the {len(rows)} benchmarks in {path} is of {asked}" if rows else f"{path} holds no benchmark")
        found += chosen
    return found


def joined(frame: pandas.DataFrame, rows: Sequence[Row]) -> pandas.DataFrame:
    """A table of scores with rows of benchmarks below it, and the source of each; what a row does not tell is missing."""
    columns = [*frame.columns, *COLUMNS]
    stored = [record | {"source": STORED} for record in frame.to_dict("records")]
    return pandas.DataFrame([*stored, *rows], columns=columns).astype(dict.fromkeys(WHOLE, "Int64"))


def show(rows: Iterable[Row]) -> None:
    """Print a table for each file, with where and when it was measured."""
    for (source, *about), group in itertools.groupby(rows, lambda row: [row[name] for name in ("source", *ABOUT)]):
        print_table(f"{source}: {', '.join(map(str, about))}", HEADER, [_words(row) for row in group])


def _words(row: Row) -> tuple[str, ...]:
    interval = "" if math.isnan(row["low"]) else f"[{row['low']:.4g}, {row['high']:.4g}]"
    value = f"{row['value']:.4g} {row['unit']}"
    return row["name"], str(row.get("batch", "")), f"{row['metric']}:{row['block']}", value, interval, str(row["rounds"])


def _row(benchmark: Mapping[str, Any]) -> Row:
    """The row of a benchmark; raises what damage makes it raise."""
    stats, told = benchmark["stats"], benchmark["extra_info"]
    seconds = np.array([stats["median"], *_interval(stats)], float)
    if not 0 <= seconds[0] < math.inf:
        raise ValueError(f"the median of {benchmark['name']} is {stats['median']!r} s")
    row: Row = {
        "name": str(benchmark["name"]),
        "group": benchmark["group"] and str(benchmark["group"]),
        "rounds": int(stats["rounds"]),
    }
    row["against"] = dict(_against(told, told.get("turns", {})))
    row["told"] = {str(k): v for k, v in told.items() if isinstance(v, str | int | float) and k not in row["against"]}
    if not {"estimator", "case", "runs", "steps"} <= told.keys():
        return row | _figures("duration", "call", "s", *seconds)
    runs, steps = int(told["runs"]), int(told["steps"])
    if runs < 1 or steps < 1:
        raise ValueError(f"{benchmark['name']} is said to have {runs} runs and {steps} steps")
    row |= {"estimator": str(told["estimator"]), "case": str(told["case"]), "batch": runs, "steps": steps}
    if runs == 1:
        return row | _figures("latency", "step", METRICS["latency"].unit, *(1e6 * seconds / steps))
    with np.errstate(divide="ignore"):  # by a time below the resolution of the clock
        value, high, low = runs * steps / seconds
    return row | _figures("throughput", "step", METRICS["throughput"].unit, value, low, high)


def _against(told: Mapping[str, Any], turns: Mapping[str, Sequence[float]]) -> Iterator[tuple[str, tuple[float, float, float]]]:
    """The ratios among what is told, with their intervals where the rival was timed in turns.

    A rival may do a part of the work, as one run of many: the ratio told is that for the same work, and its interval in
    proportion.
    """
    for name, value in told.items():
        match = RATIO.fullmatch(name)
        if match and (name.startswith("ratio") or match[1] in turns):
            ratio, low, high = turns.get(match[1], (math.nan,) * 3)
            yield name, (float(value), low * value / ratio, high * value / ratio)


def _figures(metric: str, block: str, unit: str, value: float, low: float, high: float) -> Row:
    figures = {"value": float(value), "low": float(low), "high": float(high)}
    return {"metric": metric, "block": block, "unit": unit, **figures}


def _interval(stats: Mapping[str, Any]) -> tuple[float, float]:
    """The exact 95 % interval of the median over rounds; NaN when there are too few, or their times were not kept.

    Without all times the least and the largest are known, which are the interval of six to eight rounds.
    """
    times = sorted(stats["data"]) if stats.get("data") else [stats["min"], stats["max"]]
    low, high = quantile_ranks(int(stats["rounds"]), 0.5)
    if low < 1 or (low > 1 and len(times) != stats["rounds"]):
        return math.nan, math.nan
    return (times[low - 1], times[high - 1]) if low > 1 else (times[0], times[-1])
