"""The command line: list, check, run, score, compare, detect, verify, report."""

import argparse
import contextlib
import io
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cases
from estimators import ESTIMATORS
from suite import benchmarks, operating, parameters, plan, recording, results, sampling, score, verdicts
from suite.arguments import parse
from suite.case import Case
from suite.compare import compare, nothing_to_compare, ranking
from suite.errors import BadInput, near
from suite.estimator import Estimator
from suite.examination import examine, summary
from suite.metrics import METRICS
from suite.notices import BAD, DONE, INTERRUPTED, TROUBLE, announce, complain, conclude, show
from suite.problems import PROBLEMS
from suite.progress import Progress
from suite.registry import Catalog, catalog, matches
from suite.run import Outcome, execute
from suite.state_tests import TRUTH, state_tests
from suite.store import Store
from suite.tables import (
    describe,
    frame_of,
    print_comparisons,
    print_frame,
    print_operating_points,
    print_scores,
    print_state_tests,
    print_table,
    print_verdicts,
)
from suite.trial import measured
from suite.worker import Context

MANY = 1000
"""Stored blocks from which on scoring is spread over processes, which take a second or two to start."""
BLOCKS = 40
"""Into about so many blocks the runs of a cell are divided that --until asks for."""
Chosen = Mapping[Case, Sequence[Estimator]]
"""The estimators to run on each case."""
Runs = dict[Case, int]
"""How many runs each case gets."""


def load_catalog(plugins: Sequence[str] = ()) -> Catalog:
    """All estimators and cases: those of the project, of installed plug-ins, and of plug-in files."""
    return catalog(ESTIMATORS, cases.MODULES).with_plugins(plugins)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns 0 when done, 1 when something failed in a cell or a check, 2 for bad input."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that the terminal's encoding lacks is shown escaped
            stream.reconfigure(errors="backslashreplace")
    commands = {
        "list": _list,
        "check": _check,
        "run": _run,
        "score": _score,
        "compare": _compare,
        "detect": _detect,
        "verify": _verify,
        "report": _report,
    }
    try:
        options = parse(arguments)
        options.command_line = shlex.join(["filterbench", *arguments])
        if options.command in ("check", "run"):
            _take_recordings(options)
        code = commands[options.command](options)
        sys.stdout.flush()
    except BadInput as error:
        complain(str(error))
        return BAD
    except KeyboardInterrupt:
        complain("interrupted; what is finished is kept, repeat the command to go on")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        _drop_output()
        return DONE
    except OSError as error:
        complain(str(error))
        return BAD
    return code


def _list(options: argparse.Namespace) -> int:
    known = load_catalog(options.plugin)
    registries: dict[str, Any] = {"estimators": known.estimators, "cases": known.cases, "metrics": METRICS}
    for kind in [options.kind] if options.kind else list(registries):
        rows = [(entry.name, describe(entry)) for entry in registries[kind].select([options.pattern])]
        print_table(kind, ("name", "what it is"), rows)
    return DONE


def _check(options: argparse.Namespace) -> int:
    known = load_catalog(options.plugin)
    estimators = known.estimators.select(options.estimator)
    cases = known.cases.extended(PROBLEMS).select(options.case or ["check/*"])
    problems = [measured(case) for case in cases]
    broken = []
    for estimator in estimators:
        label, verdicts = parameters.label(estimator), list(examine(estimator, problems))
        print_table(label, ("check", "cases", "verdict"), summary(verdicts))
        if any(v.broken for v in verdicts):
            broken.append(label)
    print(f"{len(estimators) - len(broken)} of {len(estimators)} estimators keep all rules")
    if broken:
        complain(f"rules are broken by {', '.join(broken)}")
    return TROUBLE if broken else DONE


def _take_recordings(options: argparse.Namespace) -> None:
    """Replace the TOML files among the cases by the names of the recordings they describe, loaded as plug-ins are."""
    files = [pattern for pattern in options.case if pattern.endswith(".toml")]
    options.plugin = [*options.plugin, *files]
    options.case = [recording.name_of(p) if p in files else p for p in options.case]


def _run(options: argparse.Namespace) -> int:
    known = load_catalog(options.plugin)
    profile, named = plan.PROFILES[options.profile], known.estimators.select(options.estimator)
    goals = [sampling.goal(*words) for words in options.until]
    chosen = {
        case: named if options.estimator else profile.estimators_of(case, known.estimators)
        for case in known.cases.select(options.case)
    }
    runs = {case: options.runs or profile.runs_of(case) for case in chosen}
    store = Store(options.results, create=True) if not options.dry_run else _store_if_any(options.results)
    entries, damages = store.scan() if store else ([], [])
    if store and not options.dry_run:
        store.sweep()
        for damage in damages:
            complain(f"set aside {damage.path}: {damage.reason}; it is now {store.set_aside(damage)}")
    size, effort = options.block or profile.block, profile.effort
    planned = plan.make(known, chosen, runs, options.seed, size, entries, options.retry_failed, effort)
    announce(planned, [len(e) for e in chosen.values()], list(runs.values()), options.seed, options.results)
    if options.dry_run:
        show(planned)
        for damage in damages:
            complain(f"would set aside {damage.path}: {damage.reason}")
        return DONE
    outcome = _compute(planned, options)
    while goals and (more := _short(chosen, runs, goals, options)):
        runs |= more
        again = {case: chosen[case] for case in more}
        size = options.block or max(profile.block, max(more.values()) // BLOCKS)
        planned = plan.make(known, again, runs, options.seed, size, Store(options.results).scan()[0], effort=effort)
        announce(planned, [len(e) for e in again.values()], list(more.values()), options.seed, options.results)
        outcome.reports += _compute(planned, options).reports
    return conclude(outcome, known, options.results)


def _compute(planned: plan.Plan, options: argparse.Namespace) -> Outcome:
    """Run a plan in worker processes."""
    profile = plan.PROFILES[options.profile]
    context = Context(options.results, load_catalog, tuple(options.plugin), options.command_line, profile.effort)
    time_limit = options.time_limit or profile.time_limit
    try:
        with Progress(len(planned.blocks), "blocks") as progress:
            return execute(planned, context, options.jobs, time_limit, lambda r: progress.advance(_words(r.block)))
    finally:  # a worker that was stopped may have been writing
        Store(options.results).sweep()


def _words(block: plan.WorkBlock) -> str:
    return f"{block.estimator or 'truth'} on {block.case}"


def _short(chosen: Chosen, runs: Mapping[Case, int], goals: Sequence[sampling.Goal], options: argparse.Namespace) -> Runs:
    """The cases whose intervals are too wide yet, with the runs they need; where there is none, says how wide all are."""
    loaded = results.load(options.results, seed=options.seed)
    found = {
        case: sampling.reaches(loaded.cases[case.name], map(parameters.label, estimators), goals)
        for case, estimators in chosen.items()
        if case.name in loaded.cases
    }
    more = {case: n for case, each in found.items() if (n := sampling.needed(each, runs[case], options.most_runs)) > runs[case]}
    if not more:
        print_table("sampled", sampling.HEADER, sampling.summary(found.values(), options.most_runs))
    return more


def _store_if_any(folder: str) -> Store | None:
    """The results folder; None when it does not exist yet or is empty."""
    path = Path(folder)
    return None if not path.exists() or (path.is_dir() and not any(path.iterdir())) else Store(path)


def _score(options: argparse.Namespace) -> int:
    loaded = _load(options)
    metrics = METRICS.select(options.metric)
    chosen = _matching("case", loaded.cases, options.case), _matching("estimator", loaded.labels, options.estimator)
    jobs = (os.cpu_count() or 1) if len(loaded.entries) > MANY else 1
    frame = score.table(loaded, metrics, *chosen, jobs)
    timed = benchmarks.select(options.benchmarks, options.case, options.estimator, options.metric)
    whole = benchmarks.joined(frame, timed) if options.benchmarks else frame
    print_frame(whole, options.format, lambda _: print_scores(frame))
    if options.format == "table":
        benchmarks.show(timed)
    return TROUBLE if loaded.damages else DONE


def _compare(options: argparse.Namespace) -> int:
    loaded, reference = _load(options), options.reference
    chosen = [loaded.cases[name] for name in _matching("case", loaded.cases, options.case)]
    labels = _matching("estimator", loaded.labels, options.estimator)
    if reference not in [*loaded.labels, TRUTH]:
        raise BadInput(f"no stored estimator is {reference!r}; {near(reference, loaded.labels)}")
    show: Any = print_state_tests if options.states else print_comparisons
    if options.states:
        found: list[Any] = [t for case in chosen for label in labels for t in state_tests(case, label, reference, options.run)]
    else:
        found = [c for m in ranking(options.metric or ["rmse"]) for c in compare(chosen, m, reference, labels, options.zone)]
    if not found:
        raise nothing_to_compare(chosen, reference, labels)
    print_frame(frame_of(found), options.format, lambda _: show(found))
    return TROUBLE if loaded.damages else DONE


def _detect(options: argparse.Namespace) -> int:
    loaded = _load(options)
    chosen = [loaded.cases[name] for name in _matching("case", loaded.cases, options.case)]
    frame = operating.table(chosen, _matching("estimator", loaded.labels, options.estimator), options.level)
    print_frame(frame, options.format, print_operating_points)
    return TROUBLE if loaded.damages else DONE


def _verify(options: argparse.Namespace) -> int:
    loaded = _load(options)
    chosen = _matching("case", loaded.cases, options.case)
    found = list(verdicts.verdicts([loaded.cases[name] for name in chosen], cases.FINDINGS))
    print_verdicts(found)
    told = [v.agrees for v in found if v.agrees is not None]
    counts = f"{len(told)} measured here: {sum(told)} agree, {len(told) - sum(told)} differ"
    print(f"{len(found)} published figures and claims, {counts}; where all agree in truth, 5 of 100 differ by chance")
    broken = [v for v in found if v.broken]
    for v in broken:
        now = "agree" if v.agrees else "do not agree"
        complain(
            f"{v.case}, {v.published.estimator}, {v.published.quantity}: recorded as {v.recorded}, but these results {now}"
        )
    return TROUBLE if broken or loaded.damages else DONE


def _report(options: argparse.Namespace) -> int:
    from reports.inputs import Inputs
    from reports.site import build  # matplotlib takes a second to import; no other command needs it

    out, folders = Path(options.out), [Path(folder) for folder in (options.results, options.against) if folder]
    for folder in folders:
        if folder.resolve() in [out.resolve(), *out.resolve().parents]:
            raise BadInput(f"--out {out} lies in the results folder {folder}; name a folder outside it")
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise BadInput(f"--against {options.against} is the folder of the results themselves; name that of other results")
    loaded = _load(options, required=False)
    against = _load(argparse.Namespace(**vars(options) | {"results": options.against})) if options.against else None
    inputs = Inputs(loaded, options.command_line, cases.FINDINGS, benchmarks.select(options.benchmarks, (), (), ()), against)
    print((build(inputs, out, options.jobs) / "index.html").resolve())
    return TROUBLE if loaded.damages or (against and against.damages) else DONE


def _load(options: argparse.Namespace, required: bool = True) -> results.Results:
    loaded = results.load(options.results, list(cases.CASES), list(ESTIMATORS), options.seed)
    if (required or options.seed is not None) and not loaded.entries and not loaded.damages:
        which = "" if options.seed is None else f" with seed {options.seed}"
        raise BadInput(
            f"no block{which} is finished yet in {options.results}; run `filterbench run --results {options.results}` first"
        )
    for damage in loaded.damages:
        complain(f"left out {damage.path}: {damage.reason}; `filterbench run` sets it aside and recomputes it")
    return loaded


def _matching(kind: str, known: Any, patterns: Sequence[str]) -> list[str]:
    """Stored names that match any pattern. Raises BadInput where a pattern matches none."""
    names = list(known)
    found = [n for n in names if matches(n, patterns)]
    for pattern in patterns:
        if not any(matches(n, [pattern]) for n in names):
            raise BadInput(f"no stored {kind} matches {pattern!r}; {near(pattern.strip('*?'), names)}")
    return found


def _drop_output() -> None:
    """Send what is left in the buffer of standard output nowhere, since it cannot be written."""
    with contextlib.suppress(OSError), Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
