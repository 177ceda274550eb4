"""Everything one does with filterbench, each in an environment of its own: `nox -s report`, `nox -s tests`, ..."""

import os
from pathlib import Path

import nox

nox.options.sessions = ["lint", "types", "tests"]
nox.options.reuse_existing_virtualenvs = True

JOBS = str(os.cpu_count() or 1)


def install(session: nox.Session, extras: str = "") -> None:
    """Install the project as it stands in the working tree."""
    session.install("--quiet", "-e", f".[{extras}]" if extras else ".")


@nox.session
def report(session: nox.Session) -> None:
    """Run the bench and build the report; further arguments go to `filterbench run`, such as --profile paper."""
    install(session)
    session.run("filterbench", "run", "--jobs", JOBS, *session.posargs, success_codes=[0, 1])
    timed = sorted(map(str, Path("bench").glob("*/*.json")))
    session.run("filterbench", "report", *(["--benchmarks", *timed] if timed else []), success_codes=[0, 1])


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests, spread over the processors; further arguments go to pytest."""
    install(session, "test")
    session.run("pytest", "-n", JOBS, *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and format."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types of the engine, strictly."""
    install(session, "types")
    session.run("mypy")


@nox.session
def bench(session: nox.Session) -> None:
    """Time the estimators, also against other libraries; the figures are kept in bench/ as JSON, one file a run.

    A library that does not install on this machine is skipped. `particles` asks for NumPy 1 but works with 2 (its answers
    are checked before it is timed), so it is installed without its dependencies, which the extra `peers` names.
    """
    install(session, "test")
    session.install("--quiet", "-e", ".[peers]", success_codes=[0, 1])
    session.install("--quiet", "--no-deps", "particles==0.4", success_codes=[0, 1])
    Path("bench").mkdir(exist_ok=True)
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    session.run(
        "pytest",
        "tests/benchmarks",
        "--benchmark-only",
        "--benchmark-columns=median,iqr,rounds",
        "--benchmark-storage=file://bench",
        "--benchmark-autosave",
        "--benchmark-save-data",
        "-rs",
        *session.posargs,
        env=one_thread,
    )
