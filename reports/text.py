"""Numbers and lists as a reader expects them: no more digits than the interval supports."""

import hashlib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from suite.metrics import Metric, Score

THIN = "\u202f"  # narrow no-break space, between groups of three digits
MOST_DIGITS, FEWEST_DIGITS = 4, 2
PLAIN_FROM, PLAIN_BELOW = 1e-3, 1e6
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
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
    finite = [x for x in (value, low, high) if math.isfinite(x)]
    shown = [number(x, place(value, low, high)) for x in (value, low, high)]
    if score.runs == 0 or math.isnan(value):
        return Quantity("none", "", "")
    if score.runs == 1 and math.isnan(low):
        return Quantity(shown[0], unit, "one run")
    if math.isnan(low) or math.isnan(high):
        return Quantity(shown[0], unit, "no interval")
    percent = " %" if unit == "%" and finite else ""
    return Quantity(shown[0], unit, f"{shown[1]} to {shown[2]}{percent}")


def within(value: float, low: float, high: float, unit: str) -> str:
    """A value with its interval, in the digits that the interval supports, and its unit."""
    shown = [number(x, place(value, low, high)) for x in (value, low, high)]
    return f"{shown[0]} ({shown[1]} to {shown[2]}){' ' + unit if unit else ''}"


def _scale(score: Score, metric: Metric) -> tuple[float, str]:
    if metric.binomial:
        return 100.0, "%"
    for size, name in _LARGER_UNITS.get(score.unit, ()):
        if math.isfinite(score.value) and score.value >= size:
            return 1 / size, name
    return 1.0, "mixed units" if score.unit == "mixed" else score.unit


def place(value: float, low: float = math.nan, high: float = math.nan) -> int:
    """Decimal place (0 for units, -1 for tenths) of the last digit that an interval supports."""
    if not math.isfinite(value) or value == 0:
        value = next((x for x in (low, high) if math.isfinite(x) and x != 0), 0.0)
    if value == 0:
        return 0
    sides = [abs(value - x) for x in (low, high) if math.isfinite(x) and x != value]
    finest = _exponent(value) - MOST_DIGITS + 1
    coarsest = _exponent(value) - FEWEST_DIGITS + 1
    if not (math.isfinite(low) and math.isfinite(high)):
        return finest + 1 if math.isnan(low) and math.isnan(high) else coarsest
    return min(max(_exponent(min(sides)) if sides else finest, finest), coarsest)


def number(x: float, last: int | None = None) -> str:
    """A number to the decimal place `last`, but with two digits at least; three when no place is given."""
    if math.isnan(x):
        return "none"
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    if x == 0:
        return "0"
    last = _exponent(x) - 2 if last is None else min(last, _exponent(x) - FEWEST_DIGITS + 1)
    last = max(last, _exponent(x) - MOST_DIGITS + 1)
    sign = "−" if x < 0 else ""
    if not PLAIN_FROM <= abs(x) < PLAIN_BELOW:
        return sign + _scientific(abs(x), last)
    rounded = round(abs(x), -last)
    return sign + grouped(rounded, max(0, -last))


def grouped(x: float, decimals: int = 0) -> str:
    """A number in plain digits, in groups of three from ten thousand on."""
    text = f"{x:.{decimals}f}"
    return f"{x:,.{decimals}f}".replace(",", THIN) if x >= 10_000 else text


def _scientific(x: float, last: int) -> str:
    mantissa, _, exponent = f"{x:.{max(0, _exponent(x) - last)}e}".partition("e")
    return f"{mantissa} × 10{power(int(exponent))}"


def power(exponent: int) -> str:
    """An exponent in superscript digits."""
    return str(exponent).translate(_SUPERSCRIPTS)


def _exponent(x: float) -> int:
    return math.floor(math.log10(abs(x)))


def tick(x: float, _position: int = 0) -> str:
    """A number at a tick of an axis: short, powers of ten as such from a hundred thousand on."""
    if x == 0 or not math.isfinite(x):
        return number(x)
    if 1e-4 < abs(x) < 1e5:
        return f"{x:.6g}".replace("-", "−")
    mantissa, _, exponent = f"{x:.3g}".partition("e") if "e" in f"{x:.3g}" else f"{x:.2e}".partition("e")
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
