"""A card of HTML for notebooks: a title, a headline, lines of name and words, and notes."""

from collections.abc import Iterable
from html import escape

GOOD, FAIR, BAD = "#00795a", "#0072b2", "#b34700"  # legible on light and on dark
LEFT = "text-align:left;vertical-align:top"


def card(
    title: str,
    headline: str,
    lines: Iterable[tuple[str, str]],
    notes: Iterable[str] = (),
    colour: str = GOOD,
) -> str:
    """A piece of HTML that needs nothing else; every word is escaped.

    Args:
        title: What was asked.
        headline: The answer in a few words.
        lines: Names and words.
        notes: What must be known to read it.
        colour: Of the headline.
    """
    rows = "".join(
        f"<tr><td style='{LEFT}'>{escape(name)}</td><td style='{LEFT}'>{escape(words)}</td></tr>"
        for name, words in lines
    )
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    listed = f"<ul>{items}</ul>" if items else ""
    return (
        "<div style='max-width:52em;line-height:1.45'>"
        f"<div style='opacity:.7'>{escape(title)}</div>"
        f"<div style='font-size:1.5em;font-weight:700;color:{colour}'>{escape(headline)}</div>"
        f"<table>{rows}</table>{listed}</div>"
    )
