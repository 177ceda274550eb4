"""Tables of a TOML file, whose numbers are written with their units: every fault is named with its file, table and key."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from suite.errors import BadInput, near

Vector = tuple[float, ...]
Units = Mapping[str, float]
"""Units of one kind of quantity, each as a multiple of the one in m, s and rad."""

LENGTH: Units = {"m": 1.0, "km": 1e3, "ft": 0.3048, "nmi": 1852.0}
ANGLE: Units = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180}
SPEED: Units = {"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852 / 3600, "ft/s": 0.3048}
ACCELERATION: Units = {"m/s^2": 1.0}
TURN_RATE: Units = {"rad/s": 1.0, "deg/s": math.pi / 180}


@dataclass(frozen=True)
class Section:
    """A table of a TOML file, or the whole of it where the name is empty; all that it is asked for raises BadInput."""

    file: Path
    name: str
    data: Mapping[str, Any]

    @property
    def where(self) -> str:
        """File and name of the table."""
        return f"{self.file}, [{self.name}]" if self.name else str(self.file)

    def only(self, *known: str) -> None:
        """Raise BadInput when there are other keys than the known ones."""
        for key in self.data:
            if key not in known:
                raise BadInput(f"{self.where}: unknown key {key!r}; {near(key, known)}")

    def value(self, key: str) -> Any:
        """A value of any type."""
        if key not in self.data:
            raise BadInput(f"{self.where}: the key {key!r} is missing")
        return self.data[key]

    def section(self, key: str) -> "Section":
        """The table of that name."""
        if not isinstance(self.value(key), dict):
            raise self._bad(key, "a table")
        return Section(self.file, f"{self.name}.{key}" if self.name else key, self.data[key])

    def text(self, key: str) -> str:
        """A text."""
        value = self.value(key)
        if not isinstance(value, str) or not value.strip():
            raise self._bad(key, "a text")
        return value

    def choice(self, key: str, known: Sequence[str]) -> str:
        """One of the known names."""
        value = self.text(key)
        if value not in known:
            raise BadInput(f"{self.where}: unknown {key} {value!r}; {near(value, known)}")
        return value

    def count(self, key: str, least: int, most: float = math.inf) -> int:
        """A whole number within bounds."""
        value = self.value(key)
        if type(value) is not int or not least <= value <= most:
            raise self._bad(key, f"a whole number from {least} on" if most == math.inf else f"{least} to {most}")
        return value

    def scales(self, key: str, units: Sequence[Units]) -> Vector:
        """Units by name, as multiples of m, s and rad."""
        return tuple(self._scale(key, item, known) for item, known in zip(self._items(key, len(units)), units, strict=True))

    def quantities(self, key: str, units: Sequence[Units], low: float = -math.inf, above: float = -math.inf) -> Vector:
        """Numbers with their units, such as "1.5 km", none below `low`, all above `above`."""
        found = []
        for item, known in zip(self._items(key, len(units)), units, strict=True):
            number, _, unit = str(item).strip().partition(" ")
            try:
                value = math.nan if "_" in number else float(number)
            except ValueError:
                value = math.nan
            if not isinstance(item, str) or not unit or not math.isfinite(value):
                raise self._bad(key, f"a number with its unit, such as '1.5 {next(iter(known))}'")
            if value < low or value <= above:
                raise self._bad(key, "above zero" if value <= above else "zero or above")
            found.append(value * self._scale(key, unit.strip(), known))
        return tuple(found)

    def _items(self, key: str, count: int) -> list[Any]:
        """A list of that many items; one item alone stands for all."""
        value = self.value(key)
        items = value if isinstance(value, list) else [value] * count
        if len(items) != count:
            raise self._bad(key, f"a list of {count}")
        return items

    def _scale(self, key: str, unit: object, known: Units) -> float:
        if not isinstance(unit, str) or unit not in known:
            raise BadInput(f"{self.where}: unknown unit {unit!r} in {key}; known: {', '.join(known)}")
        return known[unit]

    def _bad(self, key: str, demand: str) -> BadInput:
        return BadInput(f"{self.where}: {key} must be {demand}, got {self.data[key]!r}")


def parse(path: Path) -> Section:
    """The whole of a TOML file. Raises BadInput when it cannot be read."""
    try:
        return Section(path, "", tomllib.loads(path.read_text(encoding="utf-8-sig")))
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: is no TOML: {' '.join(str(error).split())}") from error
