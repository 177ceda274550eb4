"""The arguments of the command line, and what is wrong with them."""

import argparse
import os
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import NoReturn

from suite.errors import BadInput
from suite.plan import PROFILES
from suite.state_tests import TRUTH

PATTERN = "glob pattern; give the option several times for several"


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of a command line, its `command` among them. Raises BadInput."""
    parser = _Parser(
        prog="filterbench", description="Compare nonlinear Bayesian filters for target tracking.", allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"filterbench {version('filterbench')}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)
    for name, words, add in (
        ("list", "show what there is to run and to measure", _list),
        ("check", "hold estimators against the rules that all of them keep", _check),
        ("run", "run estimators on cases and store what comes out", _run),
        ("score", "compute metrics from stored results", _score),
        ("compare", "compare estimators with a reference on the runs that both have", _compare),
        ("detect", "show what detectors of manoeuvres do at thresholds set on runs without any", _detect),
        ("verify", "hold stored results against published figures and the verdicts recorded on them", _verify),
        ("report", "render stored results as a static HTML site", _report),
    ):
        add(commands.add_parser(name, help=words, description=words, allow_abbrev=False))
    options = parser.parse_args(arguments)
    if options.command == "compare":
        _fit_together(options)
    return options


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as all errors of this program."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message}; see `{self.prog} --help`")


def _list(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("kind", nargs="?", choices=("estimators", "cases", "metrics"), help="what to show (default: all)")
    parser.add_argument("pattern", nargs="?", default="*", metavar="PATTERN", help="glob pattern")
    _plugin(parser)


def _check(parser: argparse.ArgumentParser) -> None:
    words = "estimators, glob pattern, with parameters in brackets behind it (default: all)"
    parser.add_argument("estimator", nargs="*", metavar="NAME", help=words)
    _several(parser, "-c", "--case", "cases", "check/*")
    _plugin(parser)


def _run(parser: argparse.ArgumentParser) -> None:
    quick, paper = PROFILES["quick"], PROFILES["paper"].runs
    words = f"quick: {quick.runs} runs a cell, {quick.fewest} where there are many steps (default); "
    words += f"paper: where a case has a paper's experiment, that one, else {paper} runs a cell"
    _selection(parser)
    _plugin(parser)
    add = parser.add_argument
    add("--profile", choices=tuple(PROFILES), default="quick", help=words)
    add("--runs", type=_integer(1), metavar="N", help="Monte Carlo runs of each cell (default: the profile's)")
    words = "add runs until the intervals of a score are as narrow as WIDTH: 5%% of the value to each side, or 0.02 in its unit"
    add("--until", action="append", nargs=2, default=[], metavar=("METRIC:BLOCK", "WIDTH"), help=words)
    add("--most-runs", type=_integer(1), default=1000, metavar="N", help="with --until: runs of a cell at most (default: 1000)")
    add("--seed", type=_integer(0), default=1, metavar="S", help="seed of all random streams (default: 1)")
    add("--jobs", type=_integer(1), default=1, metavar="J", help="worker processes (default: 1)")
    add("--block", type=_integer(1), metavar="N", help="runs in a block of work (default: the profile's)")
    add("--time-limit", type=_SECONDS, metavar="SECONDS", help="for one block of work (default: the profile's)")
    add("--results", default="results", metavar="DIR", help="results folder (default: results)")
    add("--retry-failed", action="store_true", help="run again the stored blocks in which something failed")
    add("--dry-run", action="store_true", help="say what would run, and run nothing")


def _score(parser: argparse.ArgumentParser) -> None:
    _selection(parser)
    _several(parser, "-m", "--metric", "metrics")
    _printed(parser)
    words = "JSON files of pytest-benchmark, whose times are shown below the scores"
    parser.add_argument("--benchmarks", action="extend", nargs="+", default=[], metavar="FILE", help=words)


def _compare(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("reference", metavar="REFERENCE", help="stored estimator to compare with, brackets included; with --states also truth")
    _selection(parser)
    _several(parser, "-m", "--metric", "metrics", "rmse")
    words = "differences within this do not matter: of the value, or of one unit where a value may be negative (default: 5%%)"
    add("--zone", type=_PERCENTAGE, default="5%", metavar="P%", help=words)
    words = "test the states themselves, component by component and region, as the multistatic paper does"
    add("--states", action="store_true", help=words)
    add("--run", type=_integer(0), metavar="R", help="run whose states are tested over its steps (default: the first)")
    _printed(parser)


def _detect(parser: argparse.ArgumentParser) -> None:
    _selection(parser)
    words = "probability of an alarm in a run without manoeuvres (default: of 0.01 to 0.5 what the runs are enough for)"
    parser.add_argument("--level", type=_PROBABILITY, nargs="+", action="extend", default=[], metavar="L", help=words)
    _printed(parser)


def _fit_together(options: argparse.Namespace) -> None:
    """Raise BadInput where options of `compare` contradict each other."""
    if options.states and options.metric:
        raise BadInput("--states tests the states themselves, by no metric; drop one of --states and --metric")
    if options.run is not None and not options.states:
        raise BadInput("--run names the run whose states are tested; add --states")
    if options.reference == TRUTH and not options.states:
        raise BadInput(f"only states are held against the {TRUTH}; add --states, or name a stored estimator")


def _verify(parser: argparse.ArgumentParser) -> None:
    _several(parser, "-c", "--case", "cases")
    _stored(parser)


def _report(parser: argparse.ArgumentParser) -> None:
    _stored(parser)
    add = parser.add_argument
    add("--out", default="site", metavar="DIR", help="folder of the site (default: site)")
    add("--against", metavar="DIR", help="another results folder: a page says what changed since")
    words = "JSON files of pytest-benchmark, such as those of `nox -s bench`, for the page of running times"
    add("--benchmarks", action="extend", nargs="+", default=[], metavar="FILE", help=words)
    jobs = os.cpu_count() or 1
    add("--jobs", type=_integer(1), default=jobs, metavar="J", help="worker processes (default: as many as processors)")


def _selection(parser: argparse.ArgumentParser) -> None:
    _several(parser, "-e", "--estimator", "estimators")
    _several(parser, "-c", "--case", "cases")


def _several(parser: argparse.ArgumentParser, short: str, long: str, what: str, usual: str = "all") -> None:
    words = f"{what}, {PATTERN} (default: {usual})"
    parser.add_argument(short, long, action="extend", nargs="+", default=[], metavar="PATTERN", help=words)


def _plugin(parser: argparse.ArgumentParser) -> None:
    words = "Python file with more estimators or cases"
    parser.add_argument("--plugin", action="append", default=[], metavar="FILE", help=words)


def _stored(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--results", default="results", metavar="DIR", help="results folder (default: results)")
    parser.add_argument("--seed", type=_integer(0), metavar="S", help="what was run with this seed (default: the newest)")


def _printed(parser: argparse.ArgumentParser) -> None:
    _stored(parser)
    parser.add_argument("--format", choices=("table", "csv", "json"), default="table", help="how to print (default: table)")


def _integer(low: int) -> Callable[[str], int]:
    def parse_integer(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be an integer of at least {low}, got {text!r}") from None
        if value < low:
            raise argparse.ArgumentTypeError(f"must be at least {low}, got {value}")
        return value

    return parse_integer


def _number(high: float, words: str, ending: str = "", divisor: float = 1.0) -> Callable[[str], float]:
    """Numbers between 0 and `high`, both excluded, that stand with an ending; what it stands for is divided by."""

    def parse_number(text: str) -> float:
        try:
            value = float(text.removesuffix(ending)) if text.endswith(ending) else float("nan")
        except ValueError:
            value = float("nan")
        if not 0 < value < high:
            raise argparse.ArgumentTypeError(f"must be {words}, got {text!r}")
        return value / divisor

    return parse_number


_PERCENTAGE = _number(100, "a percentage between 0% and 100%, such as 5%", "%", 100)
_PROBABILITY = _number(1, "between 0 and 1")
_SECONDS = _number(float("inf"), "a positive number of seconds")
