"""A verdict as a notebook shows it: a compact card of HTML, every word of the data escaped."""

from collections.abc import Iterable
from html import escape

from plumbline.experiments.report.diagnosis.phrases import MOST_CAUSES, further
from plumbline.optim.core.quantities import chance, counted, percent
from plumbline.optim.diagnosis.findings import Cause, Outcome, Place, Verdict
from plumbline.optim.diagnosis.verdict import words

COLOURS = {
    Outcome.NO_GAP: "#00795a",
    Outcome.EXPLAINED: "#00795a",
    Outcome.PARTLY: "#0072b2",
    Outcome.OUTSIDE: "#b34700",
}
MOST_LINES = 8
_LEFT = "text-align:left;vertical-align:top"


def card(verdict: Verdict) -> str:
    """The verdict as a piece of HTML that needs nothing else; colours suit light and dark."""
    parts = [_heading(verdict)]
    parts += [f"<div><b>{escape(line)}</b></div>" for line in verdict.warnings]
    if verdict.causes:
        parts.append(_causes(verdict))
    if verdict.outside_probability > 0.5 or verdict.outside_depends_on:
        parts.append(f"<div style='margin-top:.6em'>{escape(_outside(verdict))}</div>")
    if verdict.tree:
        parts.append(_tree(words.tree_lines(verdict)))
    if verdict.where:
        parts.append(f"<div style='margin-top:.6em'>{_where(verdict.where)}</div>")
    parts.append(_list("Cannot tell", _unknown(verdict)))
    parts.append(_list("Notes", verdict.notes))
    return f"<div style='max-width:52em;line-height:1.45'>{''.join(parts)}</div>"


def _heading(verdict: Verdict) -> str:
    name = escape(verdict.verdict.value.replace("-", " "))
    rows, colour = counted(verdict.rows, "row"), COLOURS[verdict.verdict]
    return (
        f"<div style='opacity:.7'>{escape(verdict.recording)}, {rows}</div>"
        f"<div style='font-size:1.5em;font-weight:700;color:{colour}'>{name}</div>"
        f"<div>{escape(verdict.meaning)} {escape(words.gap_words(verdict))}</div>"
        f"<div style='opacity:.7'>{escape(words.shrink_words(verdict))}</div>"
    )


def _causes(verdict: Verdict) -> str:
    titles = ("cause", "probability", "its part", "parameters")
    head = "".join(f"<th style='{_LEFT}'>{title}</th>" for title in titles)
    first, more = (
        f"<table style='margin-top:.6em'><tr>{head}</tr>{''.join(map(_cause, some))}</table>"
        for some in (verdict.causes[:MOST_CAUSES], verdict.causes[MOST_CAUSES:])
    )
    folded = further(verdict.causes[MOST_CAUSES:])
    return first + (_folded(folded, more) if len(verdict.causes) > MOST_CAUSES else "")


def _cause(cause: Cause) -> str:
    meaning = escape(words.cause_words(cause))
    name = f"<b>{escape(cause.label)}</b><br><span style='opacity:.7'>{meaning}</span>"
    found = words.ripples(cause)
    plain = words.plain_parameters(cause).items()
    lines = [f"{escape(key)} {escape(words.estimate_words(e))}" for key, e in plain]
    lines += [escape(words.ripple_words(found))] if found else []
    cells = (
        name,
        chance(cause.probability),
        escape(words.without_words(cause)),
        "<br>".join(lines),
    )
    return f"<tr>{''.join(f'<td style={_LEFT!r}>{cell}</td>' for cell in cells)}</tr>"


def _outside(verdict: Verdict) -> str:
    """How probable something is that the library lacks, and what it depends on if that is seen."""
    said = f"Something outside of the library: {chance(verdict.outside_probability)}"
    depends_on = verdict.outside_depends_on
    parts = [said, words.shared_words(verdict), words.left_over(depends_on) if depends_on else ""]
    return f"{'; '.join(filter(None, parts))}."


def _tree(lines: Iterable[str]) -> str:
    """Place by place, what may be at work."""
    shown = "<br>".join(escape(line) for line in lines)
    return f"<div style='margin-top:.6em'><b>What may be at work:</b><br>{shown}</div>"


def _where(places: Iterable[Place]) -> str:
    shown = [f"{escape(words.place_words(p.stage, p.element))} {percent(p.share)}" for p in places]
    return f"<b>Where:</b> {', '.join(shown[:MOST_LINES])}"


def _unknown(verdict: Verdict) -> list[str]:
    """What cannot be told apart, then what cannot be seen, and why."""
    rivals = [
        f"cannot tell {c.label} from {', '.join(words.merged(c.confounded_with, why=False))}"
        for c in verdict.causes
        if c.confounded_with
    ]
    unseen = words.merged(verdict.unobservable)
    lines = [f"cannot see {line}" for line in unseen[:MOST_LINES]]
    if len(unseen) > MOST_LINES:
        lines.append(f"cannot see {len(unseen) - MOST_LINES} more, listed in JSON and report")
    return [*rivals, *lines]


def _list(title: str, lines: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return _folded(title, f"<ul>{items}</ul>") if items else ""


def _folded(title: str, body: str) -> str:
    return f"<details><summary>{title}</summary>{body}</details>"
