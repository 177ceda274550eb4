"""One colour, one marker and one dash pattern for each estimator, the same on every page."""

from dataclasses import dataclass

from markupsafe import Markup

COLOURS = 10
DASHES: tuple[tuple[float, ...], ...] = ((), (6, 2.2), (1.6, 1.6), (8, 2, 1.6, 2), (3.5, 1.5))
MARKERS = "os^DvP*Xph"
_SHAPES = {
    "o": "M-3.2,0a3.2,3.2 0 1,0 6.4,0a3.2,3.2 0 1,0 -6.4,0z",
    "s": "M-3,-3h6v6h-6z",
    "^": "M0,-3.8L3.6,3H-3.6z",
    "D": "M0,-4L4,0L0,4L-4,0z",
    "v": "M0,3.8L3.6,-3H-3.6z",
    "P": "M-1.3,-3.8h2.6v2.5h2.5v2.6h-2.5v2.5h-2.6v-2.5h-2.5v-2.6h2.5z",
    "*": "M0,-4.4L1.1,-1.4L4.2,-1.4L1.7,0.5L2.6,3.6L0,1.7L-2.6,3.6L-1.7,0.5L-4.2,-1.4L-1.1,-1.4z",
    "X": "M-3.6,-2L-2,-3.6L0,-1.6L2,-3.6L3.6,-2L1.6,0L3.6,2L2,3.6L0,1.6L-2,3.6L-3.6,2L-1.6,0z",
    "p": "M0,-3.8L3.6,-1.2L2.2,3H-2.2L-3.6,-1.2z",
    "h": "M0,-3.9L3.4,-2V2L0,3.9L-3.4,2V-2z",
}


@dataclass(frozen=True)
class Mark:
    """How a series is drawn: number of its colour (from 1), marker, dash pattern in points."""

    series: int
    colour: int
    marker: str
    dash: tuple[float, ...]

    @property
    def swatch(self) -> Markup:
        """A small drawing of the line and its marker, for legends and table rows."""
        dash = f' stroke-dasharray="{" ".join(f"{1.4 * d:g}" for d in self.dash)}"' if self.dash else ""
        return Markup(  # nothing in it comes from a name
            f'<svg class="swatch" width="34" height="12" viewBox="-17 -6 34 12" aria-hidden="true" '
            f'style="color: var(--s{self.colour})">'
            f'<path d="M-17,0H17" stroke="currentColor" stroke-width="2" fill="none"{dash}/>'
            f'<path d="{_SHAPES[self.marker]}" fill="currentColor"/></svg>'
        )


def marks(labels: list[str]) -> dict[str, Mark]:
    """The mark of each estimator; after ten colours the dash patterns shift, so that no pair comes twice."""
    return {
        label: Mark(
            i, i % COLOURS + 1, MARKERS[(i + 3 * (i // COLOURS)) % len(MARKERS)], DASHES[(i + i // COLOURS) % len(DASHES)]
        )
        for i, label in enumerate(labels)
    }
