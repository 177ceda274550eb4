"""Numbers and lists as a reader expects them: no more digits than the interval supports."""

import hashlib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from suite.digits import grouped as grouped
from suite.digits import number as number
from suite.digits import power, with_ends
from suite.digits import within as within
from suite.metrics import Metric, Score

NEGLIGIBLE = 1e-3
"""So many times the value, and less, the lower end of the interval of a share is shown as 0."""
_LARGER_UNITS = {"µs": ((1e6, "s"), (1e3, "ms"))}


@dataclass(frozen=True)
class Quantity:
    """A score in words: its value, its unit and its interval."""

    value: str
    unit: str
    interval: str


def quantity(score: Score, metric: Metric) -> Quantity:
    """A score with the digits that its interval supports; rates in percent, long times in larger units."""
    scale, unit = _scale(score, metric)
    value, low, high = (x * scale for x in (score.value, score.low, score.high))
    low = 0.0 if 0 < low < NEGLIGIBLE * value and high <= 1 and not metric.unit else low
    finite = [x for x in (value, low, high) if math.isfinite(x)]
    shown = with_ends(value, low, high)
    if score.runs == 0 or math.isnan(value):
        return Quantity("none", "", "")
    if score.runs == 1 and math.isnan(low):
        return Quantity(shown[0], unit, "one run")
    if math.isnan(low) or math.isnan(high):
        return Quantity(shown[0], unit, "no interval")
    percent = " %" if unit == "%" and finite else ""
    return Quantity(shown[0], unit, f"{shown[1]} to {shown[2]}{percent}")


def _scale(score: Score, metric: Metric) -> tuple[float, str]:
    if metric.binomial:
        return 100.0, "%"
    for size, name in _LARGER_UNITS.get(score.unit, ()):
        if math.isfinite(score.value) and score.value >= size:
            return 1 / size, name
    return 1.0, "mixed units" if score.unit == "mixed" else score.unit


def tick(x: float, _position: int = 0) -> str:
    """A number at a tick of an axis: short, powers of ten as such from a hundred thousand on."""
    if x == 0 or not math.isfinite(x):
        return number(x)
    if 1e-4 < abs(x) < 1e5:
        return f"{x:.6g}".replace("-", "−")
    return scientific(x)


def scientific(x: float) -> str:
    """A number other than zero with a power of ten: '2 × 10⁵', '10⁻⁴'."""
    mantissa, _, exponent = f"{x:.2e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    factor = "" if mantissa == "1" else f"{mantissa} × ".replace("-", "−")
    return f"{factor}10{power(int(exponent))}"


def listed(names: Iterable[str], most: int = 0) -> str:
    """Names as a list in words: 'a, b and c'; from `most` on, the rest is counted."""
    names = list(names)
    if most and len(names) > most:
        names = [*names[: most - 1], f"{len(names) - most + 1} others"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "none"


def count(n: int, one: str, many: str = "") -> str:
    """'1 run', '12 runs'."""
    return f"{grouped(n)} {one if n == 1 else many or one + 's'}"


def breakable(name: str) -> Markup:
    """A name that a line may break after its slashes."""
    return Markup("/<wbr>").join(name.split("/"))


def slug(name: str) -> str:
    """A name as a part of a file name or of an anchor: lower-case letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:60].strip("-") or "unnamed"


def slugs(names: Sequence[str]) -> dict[str, str]:
    """A slug for each name, none twice; names that slug alike get a hash, so that no order matters."""
    plain = [slug(name) for name in names]
    found: dict[str, str] = {}
    for name, short in zip(names, plain, strict=True):
        length = 0 if plain.count(short) == 1 else 8
        digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()
        candidate = f"{short}-{digest[:length]}" if length else short
        while candidate in found.values():
            length += 8
            candidate = f"{short}-{digest[:length]}"
        found[name] = candidate
    return found
