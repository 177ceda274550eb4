"""Where a number came from: hashes of the sources that produced it, versions of libraries, the machine."""

import ast
import functools
import hashlib
import importlib.util
import platform
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

OURS = frozenset({"suite", "estimators", "cases"})
UNKNOWN = "unknown"
LIBRARIES = ("filterbench", "numpy", "scipy", "pandas", "pyarrow", "filterpy")


@functools.lru_cache
def fingerprint(*modules: str, data: tuple[Path, ...] = ()) -> str:
    """Hash of the source of modules and of all that they import from this project, and of data files.

    Other libraries enter by their version, or by their source where they have none: a new one may change the numbers. The
    place of a file does not enter, so that a plug-in may move. A package's `__init__` enters only when
    it is imported itself, so that adding an entry to a registry leaves the fingerprints of the others alone.
    """
    local = OURS | {m.partition(".")[0] for m in modules}
    sources: dict[str, str] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in sources:
            continue
        if name.partition(".")[0] in local or _version(name) == UNKNOWN:
            text = _source(name)
            sources[name] = hashlib.sha256(text.encode()).hexdigest()
            waiting += _imports(name, text, local)
        else:
            sources[name] = f"{name} {_version(name)}"
    for path in data:
        sources[f"data {path}"] = f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"
    return hashlib.sha256("\n".join(sorted(sources.values())).encode()).hexdigest()[:16]


@functools.lru_cache
def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on."""
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    found = {"python": platform.python_version()} | {name: _version(name) for name in LIBRARIES}
    return found | {"blas": f"{blas['name']} {blas['version']}"}


def host() -> dict[str, str]:
    """The machine: system, processor, name of the node."""
    return {"system": platform.platform(), "processor": _processor(), "node": platform.node()}


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _file(module: str) -> Path | None:
    loaded = sys.modules.get(module)
    file = getattr(loaded, "__file__", None)
    if file is None:
        try:
            spec = importlib.util.find_spec(module)
        except (ImportError, ValueError):
            return None
        file = spec.origin if spec else None
    return Path(file) if file and file.endswith(".py") else None


def _source(module: str) -> str:
    file = _file(module)
    return file.read_text(encoding="utf-8") if file else ""


def _version(module: str) -> str:
    try:
        return version(module)
    except PackageNotFoundError:
        return str(getattr(sys.modules.get(module), "__version__", UNKNOWN))


@functools.cache  # most modules are imported by many others
def _imports(module: str, source: str, local: frozenset[str]) -> tuple[str, ...]:
    """Modules that a source imports: ours in full, others by their top-level name, the standard library left out."""
    return tuple(_imported(module, source, local))


def _imported(module: str, source: str, local: frozenset[str]) -> Iterator[str]:
    package = module.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parent = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*parent, *([node.module] if node.module else [])])
            inside = [f"{base}.{alias.name}" for alias in node.names]
            submodules = [n for n in inside if base.partition(".")[0] in local and _file(n)]
            names = submodules if len(submodules) == len(inside) else [base, *submodules]
        else:
            continue
        for name in names:
            top = name.partition(".")[0]
            if top in local:
                yield name
            elif top not in sys.stdlib_module_names:
                yield top
