"""The command line: list, run, score, report."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console
from rich.table import Table
from rich.text import Text

import cases
from estimators import ESTIMATORS
from suite import parameters, plan, results, score
from suite.case import Case
from suite.errors import BadInput, near
from suite.metrics import METRICS
from suite.progress import Progress
from suite.registry import Catalog, catalog
from suite.run import Outcome, execute
from suite.store import Store
from suite.worker import Context

DONE, TROUBLE, BAD = 0, 1, 2
INTERRUPTED = 130


def load_catalog(plugins: Sequence[str] = ()) -> Catalog:
    """All estimators and cases: those of the project, of installed plug-ins, and of plug-in files."""
    return catalog(ESTIMATORS, cases.MODULES).with_plugins(plugins)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns 0 when done, 1 when something failed in a cell, 2 for bad input."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options = _parser().parse_args(arguments)
        options.command_line = shlex.join(["filterbench", *arguments])
        return int(options.action(options))
    except BadInput as error:
        _complain(str(error))
        return BAD
    except KeyboardInterrupt:
        _complain("interrupted; what is finished is kept, repeat the command to go on")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        sys.stderr.close()
        return DONE


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as all errors of this program."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message}; see `{self.prog} --help`")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="filterbench", description="Compare nonlinear Bayesian filters for target tracking.", allow_abbrev=False
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)
    pattern = "glob pattern; give the option several times for several"
    folder = {"default": "results", "metavar": "DIR", "help": "results folder (default: results)"}

    def command(name: str, action: Any, words: str) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=words, description=words, allow_abbrev=False)
        made.set_defaults(action=action)
        return made

    def selection(made: argparse.ArgumentParser) -> None:
        made.add_argument(
            "-e", "--estimator", action="extend", nargs="+", default=[], metavar="PATTERN", help=f"estimators, {pattern}"
        )
        made.add_argument("-c", "--case", action="extend", nargs="+", default=[], metavar="PATTERN", help=f"cases, {pattern}")

    def plugin(made: argparse.ArgumentParser) -> None:
        made.add_argument(
            "--plugin", action="append", default=[], metavar="FILE", help="Python file with more estimators or cases"
        )

    listing = command("list", _list, "show what there is to run and to measure")
    listing.add_argument("kind", nargs="?", choices=("estimators", "cases", "metrics"), help="what to show (default: all)")
    listing.add_argument("pattern", nargs="?", default="*", metavar="PATTERN", help="glob pattern")
    plugin(listing)

    run = command("run", _run, "run estimators on cases and store what comes out")
    selection(run)
    plugin(run)
    run.add_argument(
        "--profile", choices=tuple(plan.PROFILES), default="quick", help="quick: 12 runs a cell, wide intervals; paper: 100"
    )
    run.add_argument("--runs", type=_integer(1), metavar="N", help="Monte Carlo runs of each cell (default: the profile's)")
    run.add_argument("--seed", type=_integer(0), default=1, metavar="S", help="seed of all random streams (default: 1)")
    run.add_argument("--jobs", type=_integer(1), default=1, metavar="J", help="worker processes (default: 1)")
    run.add_argument("--block", type=_integer(1), metavar="N", help="runs in a block of work (default: the profile's)")
    run.add_argument(
        "--time-limit", type=_seconds, default=600.0, metavar="SECONDS", help="for one block of work (default: 600)"
    )
    run.add_argument("--results", **folder)  # type: ignore[arg-type]
    run.add_argument("--retry-failed", action="store_true", help="run again the stored blocks in which something failed")
    run.add_argument("--dry-run", action="store_true", help="say what would run, and run nothing")

    scoring = command("score", _score, "compute metrics from stored results")
    selection(scoring)
    scoring.add_argument(
        "-m", "--metric", action="extend", nargs="+", default=[], metavar="PATTERN", help=f"metrics, {pattern}"
    )
    scoring.add_argument("--results", **folder)  # type: ignore[arg-type]
    scoring.add_argument("--format", choices=("table", "csv", "json"), default="table", help="how to print (default: table)")

    report = command("report", _report, "render stored results as a static HTML site")
    report.add_argument("--results", **folder)  # type: ignore[arg-type]
    report.add_argument("--out", default="site", metavar="DIR", help="folder of the site (default: site)")
    return parser


def _list(options: argparse.Namespace) -> int:
    known = load_catalog(options.plugin)
    registries: dict[str, Any] = {"estimators": known.estimators, "cases": known.cases, "metrics": METRICS}
    for kind in [options.kind] if options.kind else list(registries):
        rows = [(entry.name, _describe(entry)) for entry in registries[kind].select([options.pattern])]
        _print_table(kind, ("name", "what it is"), rows)
    return DONE


def _describe(entry: Any) -> str:
    if isinstance(entry, Case):
        blocks = ", ".join(f"{b.name} ({b.unit})" for b in entry.blocks)
        return f"{entry.title}; {entry.steps} steps; {blocks}"
    if entry.name in METRICS and entry is METRICS[entry.name]:
        better = entry.better if isinstance(entry.better, str) else f"target {entry.better:g}"
        return f"{entry.title} ({better}); {entry.words}"
    lines = [(type(entry).__doc__ or "").strip().partition("\n")[0]]
    for name, value in parameters.values(entry).items():
        lines.append(f"  {name}={value}  {parameters.fields(entry)[name].metadata.get('doc', '')}")
    return "\n".join(lines)


def _run(options: argparse.Namespace) -> int:
    known = load_catalog(options.plugin)
    estimators, chosen = known.estimators.select(options.estimator), known.cases.select(options.case)
    store = (
        Store(options.results, create=not options.dry_run) if not options.dry_run or Path(options.results).exists() else None
    )
    entries, damages = store.scan() if store else ([], [])
    if store and not options.dry_run:
        store.sweep()
        for damage in damages:
            _complain(f"set aside {damage.path}: {damage.reason}; it is now {store.set_aside(damage)}")
    profile = plan.PROFILES[options.profile]
    runs, size = options.runs or profile.runs, options.block or profile.block
    planned = plan.make(known, estimators, chosen, runs, options.seed, size, entries, options.retry_failed)
    _announce(planned, len(estimators), len(chosen), runs, options)
    if options.dry_run:
        for damage in damages:
            _complain(f"would set aside {damage.path}: {damage.reason}")
        return DONE
    context = Context(options.results, load_catalog, tuple(options.plugin), options.command_line)
    with Progress(len(planned.blocks)) as progress:
        outcome = execute(planned, context, options.jobs, options.time_limit, progress.advance)
    return _conclude(outcome, known, options)


def _announce(planned: plan.Plan, estimators: int, chosen: int, runs: int, options: argparse.Namespace) -> None:
    print(
        f"{planned.cells} cells ({estimators} estimators x {chosen} cases, {planned.refused} refused), {runs} runs each, "
        f"seed {options.seed}: {len(planned.blocks)} blocks to run, {planned.stored} stored already in {options.results}"
    )
    if planned.stored_failures:
        print(f"{planned.stored_failures} of the stored blocks hold failures; --retry-failed runs them again")
    if options.dry_run:
        rows: dict[tuple[str, str, str], int] = {}
        for block in planned.blocks:
            key = (block.case, block.estimator or "(truth)", block.kind)
            rows[key] = rows.get(key, 0) + 1
        _print_table("would run", ("case", "estimator", "kind", "blocks"), [(*key, str(n)) for key, n in rows.items()])


def _conclude(outcome: Outcome, known: Catalog, options: argparse.Namespace) -> int:
    """Say what went wrong, cell by cell, one line each, and choose the exit code.

    A plug-in that fails in every run it was given is bad input; anything else that fails is a result.
    """
    troubled: dict[tuple[str, str], list[Any]] = {}
    for report in outcome.trouble:
        troubled.setdefault((report.block.case, report.block.estimator or ""), []).append(report)
    code = TROUBLE if troubled else DONE
    for (case, estimator), reports in troubled.items():
        counted = [r for r in reports if r.block.kind != plan.TIMING] or reports
        failed, total = sum(r.failed for r in counted), sum(r.block.count for r in counted)
        origin = known.plugins.get(f"estimator {estimator.partition('[')[0]}") or known.plugins.get(f"case {case}")
        source = f" (plug-in {origin})" if origin else ""
        _complain(
            f"{estimator or 'simulation'} on {case}{source}: {failed} of {total} runs failed or were lost; {counted[0].reason}"
        )
        if origin and failed == total:
            code = BAD
    print(f"{outcome.finished} blocks finished; `filterbench score --results {options.results}` shows the scores")
    return code


def _score(options: argparse.Namespace) -> int:
    loaded = _load(options.results)
    metrics = METRICS.select(options.metric)
    frame = score.table(
        loaded, metrics, _matching("case", loaded.cases, options.case), _matching("estimator", loaded.labels, options.estimator)
    )
    if options.format == "csv":
        frame.to_csv(sys.stdout, index=False)
    elif options.format == "json":
        print(score.to_json(frame))
    else:
        _print_scores(frame)
    return TROUBLE if loaded.damages else DONE


def _report(options: argparse.Namespace) -> int:
    from reports.site import build  # matplotlib takes a second to import; no other command needs it

    out, folder = Path(options.out), Path(options.results)
    if folder.resolve() in [out.resolve(), *out.resolve().parents]:
        raise BadInput(f"--out {out} lies in the results folder {folder}; name a folder outside it")
    loaded = _load(options.results)
    print((build(loaded, out, options.command_line) / "index.html").resolve())
    return TROUBLE if loaded.damages else DONE


def _load(folder: str) -> results.Results:
    loaded = results.load(folder, list(cases.CASES), list(ESTIMATORS))
    for damage in loaded.damages:
        _complain(f"left out {damage.path}: {damage.reason}; `filterbench run` sets it aside and recomputes it")
    return loaded


def _matching(kind: str, known: Any, patterns: Sequence[str]) -> list[str]:
    """Stored names that match any pattern; a name in full, brackets included, matches itself."""
    names = list(known)
    found = [n for n in names if not patterns or any(n == p or fnmatchcase(n, p) for p in patterns)]
    for pattern in patterns:
        if not any(n == pattern or fnmatchcase(n, pattern) for n in names):
            raise BadInput(f"no stored {kind} matches {pattern!r}; {near(pattern.strip('*?'), names)}")
    return found


def _print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in header:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _print_scores(frame: Any) -> None:
    for case, group in frame.groupby("case", sort=False):
        rows = []
        for r in group.itertuples():
            if r.status in ("refused", "not run") or not isinstance(r.metric, str):
                rows.append((r.estimator, r.status, r.reason, "", "", ""))
                continue
            mark = {score.BEST: "best", score.TIED: "tied for best"}.get(r.standing, "")
            value = f"{r.value:.4g} {r.unit}" if r.value == r.value else "none"
            interval = f"[{r.low:.4g}, {r.high:.4g}]" if r.low == r.low else "one run" if r.runs == 1 else ""
            rows.append((r.estimator, f"{r.metric}:{r.block}", value, interval, f"{r.runs}/{r.total}", mark))
        _print_table(str(case), ("estimator", "metric", "value", "95 % interval", "runs", "standing"), rows)


def _integer(low: int) -> Any:
    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be an integer of at least {low}, got {text!r}") from None
        if value < low:
            raise argparse.ArgumentTypeError(f"must be at least {low}, got {value}")
        return value

    return parse


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a positive number of seconds, got {text!r}")
    return value


def _complain(message: str) -> None:
    print(f"filterbench: {message}", file=sys.stderr)
