"""Figures as inline SVG: text as text, colours of the page's theme, small, and the same bytes every time."""

import io
import re
import warnings

import matplotlib
from markupsafe import Markup, escape
from matplotlib.figure import Figure

INK, FAINT, PAPER = "#0a0b00", "#0a0b01", "#0a0b02"
"""Stand-ins for the colours of text, of grid lines and of the background, which the style sheet decides."""
_VARIABLES = {INK: "var(--ink)", FAINT: "var(--grid)", PAPER: "var(--paper)"}
STYLE = {
    "svg.fonttype": "none",
    "text.parse_math": False,  # a name may hold dollar signs
    "path.simplify_threshold": 0.3,
    "font.size": 11,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.bottom": False,  # the grid shows where they are
    "ytick.left": False,
    "grid.color": FAINT,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def colour(number: int) -> str:
    """Stand-in for the colour of a series (from 1)."""
    return f"#0a0c{number:02x}"


def inline(figure: Figure, name: str, title: str, description: str) -> Markup:
    """The figure as an SVG element, named uniquely on its page by `name`."""
    sink = io.StringIO()
    metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    # Glyphs that matplotlib's own font lacks are measured wrongly at worst: the browser draws the text.
    with warnings.catch_warnings(), matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        warnings.simplefilter("ignore")
        figure.savefig(sink, format="svg", metadata=metadata, transparent=True)
    return Markup(_cleaned(sink.getvalue(), name, title, description))


def _cleaned(text: str, name: str, title: str, description: str) -> str:
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.S)
    text = re.sub(r"#0a0c([0-9a-f]{2})", lambda m: f"var(--s{int(m[1], 16)})", text)
    for stand_in, variable in _VARIABLES.items():
        text = text.replace(stand_in, variable)
    text = re.sub(r'id="series-(\d+)[^"]*"', r'class="series" data-series="\1"', text)
    text = text.replace('id="chance"', 'class="chance"')
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', text))
    text = re.sub(r' id="([^"]*)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", text)
    text = re.sub(r'(url\(#|href="#)([^")]+)', rf"\1{name}-\2", text)
    text = re.sub(r'( d|points)="([^"]*)"', lambda m: f'{m[1]}="{_shorter(m[2])}"', text)
    text = re.sub(r"<[^>]*>", lambda tag: re.sub(r"-?\d+\.\d{3,}", lambda m: f"{float(m[0]):.2f}", tag[0]), text)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", text)
    text = re.sub(r" ?font-family: [^;\"]*;?", "", text)  # the page's own
    text = re.sub(r' transform="rotate\(-0 [^"]*"', "", text)
    text = re.sub(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", "", text, flags=re.S)  # stands on the whole drawing
    text = re.sub(r"\n\s*", "\n", text)
    text = re.sub(r"<g([^>]*)>\n((?:<(?:use|path)[^>]*/>\n){2,})</g>", _shared, text)
    head, _, rest = text.partition(">")
    size = re.search(r'viewBox="[^"]*"', head)
    opening = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {size[0] if size else ""} '
        f'stroke-linejoin="round" role="img" aria-labelledby="{name}-title {name}-desc">'
    )
    words = f'<title id="{name}-title">{escape(title)}</title><desc id="{name}-desc">{escape(description)}</desc>'
    return opening + words + rest


def _shared(group: re.Match[str]) -> str:
    """A group that says by itself what all its members say alike; bare lines are one path."""
    head, members = group[1], group[2]
    for name in ("clip-path", "style"):
        found = set(re.findall(rf' {name}="[^"]*"', members))
        if len(found) == 1 and f" {name}=" not in head and members.count(f" {name}=") == members.count("\n"):
            head, members = head + found.pop(), re.sub(rf' {name}="[^"]*"', "", members)
    bare = re.findall(r'<path d="([^"]*)"/>\n', members)
    if "fill: none" in head and len(bare) == members.count("\n"):
        members = f'<path d="{" ".join(bare)}"/>\n'
    return f"<g{head}>\n{members}</g>"


def _shorter(path: str) -> str:
    """Coordinates to a tenth of a point, which is finer than a screen shows."""
    path = re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.1f}", path)
    return re.sub(r"\s*\n\s*", " ", path).strip()
