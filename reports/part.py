"""Parts of a site: pages and data that are made together, each from what can be named, so that what is right stays."""

import functools
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from reports.folder import Files, Folder
from suite.errors import BadInput
from suite.progress import Progress

LIBRARIES = ("jinja2", "latex2mathml", "markupsafe", "matplotlib", "numpy", "scipy")


@dataclass(frozen=True)
class Part:
    """Files of a site that are made together by a function of some arguments, perhaps in another process.

    depends: all that the files follow from but for the sources, as plain data. size: how long it takes, roughly.
    """

    name: str
    depends: Any
    make: Callable[..., Files]
    arguments: tuple[Any, ...]
    size: int = 0

    @property
    def key(self) -> str:
        """What stands for all that the files follow from."""
        return hashlib.sha256(json.dumps([_sources(), self.name, self.depends]).encode()).hexdigest()[:24]


def produce(parts: Sequence[Part], folder: Folder, pool: Executor | None, what: str) -> None:
    """Make the parts that the folder does not hold, the large ones first, and write each to it."""
    due = sorted((part for part in parts if not folder.holds(part.name, part.key)), key=lambda part: -part.size)
    with Progress(len(due), what) as progress:
        for part, made in _made(due, pool):
            folder.write(part.name, part.key, made)
            progress.advance(part.name)


def _made(parts: Sequence[Part], pool: Executor | None) -> Iterator[tuple[Part, Files]]:
    """Parts with their files, as they are finished; a single one is made at once, since processes take time to start."""
    if pool is None or len(parts) < 2:
        yield from ((part, part.make(*part.arguments)) for part in parts)
        return
    try:
        waiting = {pool.submit(part.make, *part.arguments): part for part in parts}
        for future in as_completed(waiting):
            yield waiting[future], future.result()
    except BrokenProcessPool as error:
        raise BadInput("a process that drew pages died, perhaps for want of memory; try again with --jobs 1") from error


@functools.lru_cache
def _sources() -> str:
    """Hash of all that turns results into pages."""
    found = [f"{name} {version(name)}" for name in LIBRARIES]
    for package in ("reports", "suite"):
        found += sorted(_hashes(files(package)))
    return hashlib.sha256("\n".join(found).encode()).hexdigest()


def _hashes(folder: Traversable) -> Iterable[str]:
    for each in folder.iterdir():
        if each.is_dir():
            yield from _hashes(each)
        elif each.name.endswith((".py", ".j2", ".js", ".css")):
            yield f"{each.name} {hashlib.sha256(each.read_bytes()).hexdigest()}"
