"""Registries: estimators, cases and metrics by name, chosen by patterns, extended by plug-ins."""

import dataclasses
import importlib
import importlib.util
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from hashlib import sha256
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from suite import parameters, recording
from suite.case import Case
from suite.errors import BadInput, UnknownName, near, one_line
from suite.estimator import Estimator

T = TypeVar("T")


def matches(name: str, patterns: Sequence[str]) -> bool:
    """Whether a name matches any of the patterns, or there are none; a name in full, brackets included, matches itself."""
    return not patterns or any(name == pattern or fnmatchcase(name, pattern) for pattern in patterns)


class Registry(Mapping[str, T], Generic[T]):
    """Entries by name, in report order. `registry["name[parameter=value]"]` gives a variant of an estimator."""

    def __init__(self, kind: str, entries: Iterable[T]):
        self.kind = kind
        self._entries: dict[str, T] = {}
        for entry in entries:
            name = str(getattr(entry, "name"))  # noqa: B009 - T has no common base
            if name in self._entries:
                raise BadInput(f"two {kind}s are named {name!r}; rename one")
            self._entries[name] = entry

    def __getitem__(self, name: str) -> T:
        stem, settings = split_variant(name)
        if stem not in self._entries:
            raise UnknownName(f"unknown {self.kind} {stem!r}; {near(stem, self._entries)}")
        return self._variant(self._entries[stem], settings)

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def select(self, patterns: Sequence[str]) -> list[T]:
        """Entries that match any of the glob patterns, in registry order, each once; all when no pattern is given.

        A pattern may end in settings in brackets: 'boot*[particles=500]'. Raises BadInput when one matches nothing.
        """
        found: dict[str, tuple[int, T]] = {}
        order = list(self._entries)
        for pattern in patterns or ["*"]:
            stem, settings = split_variant(pattern)
            names = [n for n in order if fnmatchcase(n, stem)]
            if not names:
                raise UnknownName(f"no {self.kind} matches {pattern!r}; {near(stem.strip('*?'), order)}")
            for name in names:
                entry = self._variant(self._entries[name], settings)
                found.setdefault(parameters.label(entry) if settings else name, (order.index(name), entry))
        return [entry for _, entry in sorted(found.values(), key=lambda pair: pair[0])]

    def _variant(self, entry: T, settings: Mapping[str, str]) -> T:
        if not settings:
            return entry
        if self.kind != "estimator":
            raise BadInput(f"a {self.kind} takes no settings in brackets; only estimators have parameters")
        return parameters.variant(entry, settings)  # type: ignore[no-any-return]

    def extended(self, entries: Iterable[T]) -> "Registry[T]":
        """A registry with more entries behind these."""
        return Registry(self.kind, [*self._entries.values(), *entries])


def split_variant(text: str) -> tuple[str, dict[str, str]]:
    """Name or pattern, and the settings in the brackets behind it. Raises BadInput when they are malformed.

    Brackets without '=' are a glob's character set and stay part of the pattern.
    """
    match = re.fullmatch(r"(.*?)\[([^\]]*=[^\]]*)\]", text)
    if not match or "=" in match[1]:
        if "=" in text:
            raise BadInput(f"cannot read {text!r}; write settings as name[parameter=value,...]")
        return text, {}
    settings: dict[str, str] = {}
    for item in match[2].split(","):
        name, equals, value = (s.strip() for s in item.partition("="))
        if not name or not equals or not value or name in settings:
            raise BadInput(f"cannot read {item.strip()!r} in {text!r}; write settings as name[parameter=value,...]")
        settings[name] = value
    return match[1], settings


@dataclasses.dataclass(frozen=True)
class Catalog:
    """All estimators and cases of a session, with those that came from plug-ins marked by where they came from."""

    estimators: Registry[Estimator]
    cases: Registry[Case]
    modules: Mapping[str, str]
    """Module that defines each case, by the case's name."""
    plugins: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Where each plug-in entry came from, by 'estimator NAME' or 'case NAME'."""

    def with_plugins(self, files: Sequence[str]) -> "Catalog":
        """The catalog with the entries of installed entry points and of the given files. Raises BadInput."""
        catalog = self
        distinct = {Path(file).resolve(): file for file in files}
        for module, origin in [*_installed(), *((_load_file(f), f) for f in distinct.values())]:
            catalog = catalog._with_module(module, origin)
        return catalog

    def _with_module(self, module: ModuleType, origin: str) -> "Catalog":
        made = [_checked_estimator(e, origin) for e in _listed(module, "ESTIMATORS", origin)]
        cases = [_checked_case(c, origin) for c in _listed(module, "CASES", origin)]
        if not made and not cases:
            raise BadInput(f"plug-in {origin} defines neither ESTIMATORS nor CASES; list its entries in such a tuple")
        try:
            estimators, known_cases = self.estimators.extended(made), self.cases.extended(cases)
        except BadInput as error:
            raise BadInput(f"plug-in {origin}: {error}") from None
        new = {f"estimator {e.name}": origin for e in made} | {f"case {c.name}": origin for c in cases}
        modules = dict(self.modules) | {c.name: module.__name__ for c in cases}
        return Catalog(estimators, known_cases, modules, dict(self.plugins) | new)


def catalog(estimators: Registry[Estimator], case_modules: Sequence[ModuleType]) -> Catalog:
    """The catalog of the estimators and of the cases that the given modules list under CASES."""
    cases = [(case, module) for module in case_modules for case in module.CASES]
    return Catalog(estimators, Registry("case", [c for c, _ in cases]), {case.name: module.__name__ for case, module in cases})


def _listed(module: ModuleType, name: str, origin: str) -> list[object]:
    entries = getattr(module, name, ())
    if not isinstance(entries, list | tuple):
        raise BadInput(f"plug-in {origin}: {name} must be a tuple of entries, got {type(entries).__name__}")
    return list(entries)


def _checked_estimator(entry: object, origin: str) -> Estimator:
    if isinstance(entry, type):
        raise BadInput(f"plug-in {origin}: ESTIMATORS holds the class {entry.__name__}, not an instance")
    for attribute in ("name", "reference", "accepts", "run"):
        try:
            getattr(entry, attribute)
        except Exception as error:  # a property may raise anything
            what = f"an entry of type {type(entry).__name__} without a readable {attribute!r}"
            raise BadInput(f"plug-in {origin}: ESTIMATORS holds {what}: {one_line(error)}") from None
    estimator: Estimator = entry  # type: ignore[assignment]
    _check_name(estimator.name, origin)
    if not isinstance(estimator.reference, str):
        raise BadInput(f"plug-in {origin}: the reference of {estimator.name} must be text, got {estimator.reference!r}")
    try:
        parameters.check(estimator)
    except BadInput as error:
        raise BadInput(f"plug-in {origin}: {error}") from None
    except Exception as error:  # an annotation or a range that cannot be read
        raise BadInput(f"plug-in {origin}: the parameters of {estimator.name} have no types: {one_line(error)}") from None
    return estimator


def _checked_case(entry: object, origin: str) -> Case:
    if not isinstance(entry, Case):
        raise BadInput(f"plug-in {origin}: CASES holds {entry!r}, which is not a suite.case.Case")
    _check_name(entry.name, origin)
    for path in entry.data:
        if not isinstance(path, Path) or not path.is_file():
            raise BadInput(f"plug-in {origin}: data of case {entry.name} must be paths of files, got {path!r}")
    try:
        json.dumps(entry.to_dict())
    except (TypeError, ValueError) as error:
        raise BadInput(f"plug-in {origin}: case {entry.name} holds what is not plain data: {one_line(error)}") from None
    return entry


def _check_name(name: object, origin: str) -> None:
    """Names are typed in shells, stand in tables and patterns: no spaces, quotes, brackets or wildcards."""
    if not isinstance(name, str) or not re.fullmatch(r"[\w.:+-]+(/[\w.:+-]+)*", name):
        raise BadInput(f"plug-in {origin}: the name {name!r} must consist of letters, digits and . : + - _, and / within")


def _installed() -> Iterator[tuple[ModuleType, str]]:
    seen: set[str] = set()
    for group in ("filterbench.estimators", "filterbench.cases"):
        for point in entry_points(group=group):
            if point.value in seen:
                continue
            seen.add(point.value)
            origin = f"{point.name} ({point.value})"
            try:
                module = importlib.import_module(point.value)
            except (Exception, SystemExit) as error:
                raise BadInput(f"plug-in {origin} does not import: {one_line(error)}") from error
            yield module, origin


def _load_file(file: str) -> ModuleType:
    path = Path(file).resolve()
    if not path.is_file():
        raise BadInput(f"plug-in {file} is no file")
    if path.suffix == ".toml":
        described = ModuleType(recording.__name__)  # whose sources, with its files, are what the case comes from
        vars(described)["CASES"] = (recording.load(file),)
        return described
    name = f"filterbench_plugin_{path.stem}_{sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadInput(f"plug-in {file} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise BadInput(f"plug-in {file} does not import: {one_line(error)}") from error
    return module
