"""Parameters of estimators: fields of a frozen dataclass, with documentation, type and range."""

import dataclasses
import typing
from collections.abc import Mapping
from typing import Any

from suite.errors import BadInput, near

_KINDS: dict[type, str] = {int: "an integer", float: "a number", bool: "true or false", str: "text"}


def parameter(
    default: Any,
    doc: str,
    *,
    low: float | None = None,
    above: float | None = None,
    high: float | None = None,
    choices: tuple[Any, ...] | None = None,
) -> Any:
    """A field of an estimator's dataclass that users may set, with its range (low and high included, above not)."""
    limits = {"doc": doc, "low": low, "above": above, "high": high, "choices": choices}
    return dataclasses.field(default=default, metadata=limits)


def fields(estimator: Any) -> dict[str, "dataclasses.Field[Any]"]:
    """The parameters of an estimator by name; none when it is not a dataclass."""
    if not dataclasses.is_dataclass(estimator):
        return {}
    return {f.name: f for f in dataclasses.fields(estimator) if f.init}


def values(estimator: Any) -> dict[str, Any]:
    """The values of an estimator's parameters by name."""
    return {name: getattr(estimator, name) for name in fields(estimator)}


def label(estimator: Any) -> str:
    """Name of the estimator, with those parameters in brackets that differ from their defaults."""
    changed = [f"{n}={getattr(estimator, n)}" for n, f in fields(estimator).items() if getattr(estimator, n) != f.default]
    return f"{estimator.name}[{','.join(changed)}]" if changed else str(estimator.name)


def check(estimator: Any) -> None:
    """Raise BadInput when a parameter's value is of the wrong type or out of its range."""
    kinds = typing.get_type_hints(type(estimator))
    for name, field in fields(estimator).items():
        value, kind, limits = getattr(estimator, name), kinds[name], field.metadata
        if kind not in _KINDS:
            raise BadInput(f"{estimator.name}: {name} is a parameter of type {_kind_name(kind)}; use int, float, bool or str")
        accepted = (int, float) if kind is float else kind
        if not isinstance(value, accepted) or (kind is not bool and isinstance(value, bool)):
            raise BadInput(f"{estimator.name}: {name} must be {_kind_name(kind)}, got {value!r}")
        if kind is float and not abs(value) < float("inf"):
            raise BadInput(f"{estimator.name}: {name} must be finite, got {value!r}")
        for key, broken, words in (
            ("low", lambda v, limit: v < limit, "at least"),
            ("above", lambda v, limit: v <= limit, "above"),
            ("high", lambda v, limit: v > limit, "at most"),
            ("choices", lambda v, limit: v not in limit, "one of"),
        ):
            limit = limits.get(key)
            if limit is not None and broken(value, limit):
                raise BadInput(f"{estimator.name}: {name} must be {words} {limit}, got {value!r}")


def variant(estimator: Any, settings: Mapping[str, str]) -> Any:
    """The estimator with parameters set from text. Raises BadInput for an unknown name, a wrong type or range."""
    known = fields(estimator)
    for name in settings:
        if name not in known:
            hint = near(name, known) if known else "it has no parameters"
            raise BadInput(f"{estimator.name} has no parameter {name!r}; {hint}")
    kinds = typing.get_type_hints(type(estimator))
    parsed = {name: _parse(estimator.name, name, kinds[name], text) for name, text in settings.items()}
    made = dataclasses.replace(estimator, **parsed) if parsed else estimator
    check(made)
    return made


def _parse(owner: str, name: str, kind: type, text: str) -> Any:
    try:
        if kind is bool:
            return {"true": True, "false": False}[text.lower()]
        return kind(text)
    except (ValueError, KeyError):
        raise BadInput(f"{owner}: {name} must be {_kind_name(kind)}, got {text!r}") from None


def _kind_name(kind: type) -> str:
    return _KINDS.get(kind, str(kind))
