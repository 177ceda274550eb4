"""Numbers in words: no more digits than their interval supports."""

import math

THIN = "\u202f"  # narrow no-break space, between groups of three digits
MOST_DIGITS, FEWEST_DIGITS = 4, 2
PLAIN_FROM, PLAIN_BELOW = 1e-3, 1e6
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


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
    if not sides:
        return finest
    # An end that all but touches the value, since the interval was widened to hold it, supports no digits by itself.
    return min(max(_exponent(max(min(sides), max(sides) / 10)), finest), coarsest)


def number(x: float, last: int | None = None) -> str:
    """A number to the decimal place `last`, but with two digits at least; three when no place is given."""
    if math.isnan(x):
        return "none"
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    if x == 0:
        return "0"
    exponent = _exponent(x)
    last = exponent - 2 if last is None else max(min(last, exponent - FEWEST_DIGITS + 1), exponent - MOST_DIGITS + 1)
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


def with_ends(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and the ends of its interval, in the digits that it supports: an end far off has one more than the value."""
    last = place(value, low, high)
    digits = _exponent(value) - last + 1 if math.isfinite(value) and value else MOST_DIGITS
    low_words, high_words = (
        number(x, max(last, _exponent(x) - max(digits, FEWEST_DIGITS)) if math.isfinite(x) and x else last) for x in (low, high)
    )
    return number(value, last), low_words, high_words


def within(value: float, low: float, high: float, unit: str) -> str:
    """A value with its interval, and its unit."""
    shown = with_ends(value, low, high)
    return f"{shown[0]} ({shown[1]} to {shown[2]}){' ' + unit if unit else ''}"
