"""Words and formulas of cases and metrics as markup: LaTeX becomes MathML, which browsers set without any script."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from latex2mathml.converter import convert
from markupsafe import Markup, escape

_ELEMENTS = {
    "math", "mrow", "mi", "mn", "mo", "mtext", "mspace", "msup", "msub", "msubsup", "munder", "mover", "munderover",
    "mfrac", "msqrt", "mroot", "mtable", "mtr", "mtd", "mstyle", "mpadded", "mphantom", "menclose", "mfenced",
}  # fmt: skip
_ATTRIBUTES = {
    "display", "mathvariant", "stretchy", "fence", "form", "accent", "accentunder", "movablelimits", "lspace", "rspace",
    "width", "height", "depth", "linethickness", "displaystyle", "scriptlevel", "columnalign", "rowspacing", "columnspacing",
    "minsize", "maxsize", "symmetric", "largeop", "separator", "notation", "rowlines", "columnlines",
}  # fmt: skip
_NAMESPACE = "{http://www.w3.org/1998/Math/MathML}"


def mathml(latex: str, display: str = "block") -> Markup:
    """The formula as a MathML element; its LaTeX source as it stands when it cannot be converted."""
    try:
        tree = ET.fromstring(convert(_upright(latex), display=display))
    except Exception:  # whatever the converter makes of faulty LaTeX
        tree = None
    if tree is None or not _harmless(tree):
        return Markup('<code class="latex">{}</code>').format(latex)
    for element in tree.iter():
        element.tag = element.tag.removeprefix(_NAMESPACE)
        if element.tag == "mi" and element.text == "~":  # the converter's sign for "is distributed as"
            element.tag, element.text = "mo", "∼"
    _draw_parentheses(tree)
    tree.set("alttext", latex)
    return Markup(ET.tostring(tree, encoding="unicode", short_empty_elements=False))  # parsed and checked above


def _draw_parentheses(tree: ET.Element) -> None:
    """Mark what stands in tall parentheses, for the style sheet to draw them.

    Browsers can stretch parentheses only where a font for mathematics is installed.
    """
    for parent in list(tree.iter("mrow")):
        parts = list(parent)
        for i in range(len(parts) - 3, -1, -1):
            opening, inside, closing = parts[i : i + 3]
            pair = (opening.tag, opening.text, closing.tag, closing.text) == ("mo", "(", "mo", ")")
            if pair and (inside.tag == "mtable" or inside.find(".//mfrac") is not None):
                inside.set("class", "parentheses")
                parent.remove(opening)
                parent.remove(closing)
        children = list(parent)
        fenced = len(children) > 3 and children[0].get("fence") == children[-1].get("fence") == "true"
        if fenced and (children[0].text, children[-1].text) == ("(", ")") and parent.find("mfrac") is not None:
            parent.remove(children[0])
            parent.remove(children[-1])
            parent.set("class", "parentheses")


def _upright(latex: str) -> str:
    r"""Words in \\mathrm as text: the converter sets a single upright letter, such as a unit, in italics."""
    return re.sub(r"\\mathrm\{([A-Za-z]+)\}", r"\\text{\1}", latex)


def _harmless(tree: ET.Element) -> bool:
    """Whether a tree holds nothing but MathML: formulas may come from a plug-in's case."""
    return all(
        element.tag.removeprefix(_NAMESPACE) in _ELEMENTS and set(element.attrib) <= _ATTRIBUTES for element in tree.iter()
    )


def prose(text: str, pages: Mapping[str, str]) -> Markup:
    """Text in which words in backticks are code, and names of cases among them lead to their pages."""

    def code(word: str) -> Markup:
        made = Markup("<code>{}</code>").format(word)
        return Markup('<a href="{}">{}</a>').format(pages[word], made) if word in pages else made

    parts = text.split("`")
    if len(parts) % 2 == 0:  # a backtick without its partner
        return escape(text)
    return Markup("").join(code(part) if i % 2 else escape(part) for i, part in enumerate(parts))
