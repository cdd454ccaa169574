"""A sweep and a map of angles as a notebook shows them: compact HTML that needs nothing else."""

from __future__ import annotations

from collections import Counter
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from plumbline.optim.pointing.given import Array
from plumbline.optim.pointing.status import MEANING, Status

if TYPE_CHECKING:
    from plumbline.optim.pointing.angle_map import AngleMap
    from plumbline.optim.pointing.sweep import Sweep

GOOD, BAD = "#00795a", "#b34700"
NEAREST = 3  # pairs that a card shows
_LEFT = "text-align:left;vertical-align:top"


def sweep_card(sweep: Sweep) -> str:
    """The sweep as a piece of HTML; colours suit light and dark."""
    safe = int(sweep.safe.sum())
    lines = (
        ("distance from the lesion", _most(sweep.rcm_error, 1e3, "mm", "{:.1e}")),
        ("direction", _most(sweep.direction_error, 180 / np.pi, "deg", "{:.1e}")),
        ("smallest singular value", _least(sweep.singular_value, 1.0, "", "{:.3f}")),
        ("clearance", _least(sweep.clearance, 1e3, "mm", "{:.1f}")),
        *((f"nearest, {k}", pair.words) for k, pair in enumerate(sweep.pairs[:NEAREST], 1)),
        ("step between angles", _most(sweep.step, 180 / np.pi, "deg", "{:.2f}")),
        ("drift between angles", _most(sweep.drift, 1e3, "mm", "{:.2g}")),
        ("solve", "; ".join(one.words for one in sweep.judged.fits)),
        ("planned in front of", ", ".join(sweep.constrained) or "nothing: all pairs judged alone"),
        ("not judged", ", ".join(sweep.left_out) or "nothing"),
    )
    counts = Counter(sweep.status).most_common()
    return _card(
        f"Sweep of {len(sweep)} angles, arm of {sweep.aim.chain.n} joints",
        f"{safe} of {len(sweep)} angles safe",
        safe == len(sweep),
        lines,
        counts,
    )


def map_card(found: AngleMap) -> str:
    """The map as a piece of HTML; colours suit light and dark."""
    safe, total = int(found.safe.sum()), found.safe.size
    cone = "none" if np.isnan(found.cone) else f"up to {np.degrees(found.cone):.0f} deg"
    lines = (
        ("theta", f"{_degrees(found.theta)}"),
        ("beta", f"{_degrees(found.beta)}"),
        ("cone that is safe all around", cone),
        ("least clearance of a safe angle", _least(found.clearance[found.safe], 1e3, "mm")),
    )
    title = f"Map of {total} angles, arm of {found.aim.chain.n} joints"
    return _card(title, f"{safe} of {total} angles safe", safe > 0, lines, list(found.counts()))


def _card(
    title: str, headline: str, good: bool, lines: tuple[tuple[str, str], ...],
    counts: list[tuple[Status, int]],
) -> str:  # fmt: skip
    rows = "".join(
        f"<tr><td style='{_LEFT}'>{escape(name)}</td><td style='{_LEFT}'>{escape(words)}</td></tr>"
        for name, words in lines
    )
    items = "".join(
        f"<li><b>{number}</b> {escape(kind.value)}: {escape(MEANING[kind])}</li>"
        for kind, number in counts
    )
    return (
        "<div style='max-width:52em;line-height:1.45'>"
        f"<div style='opacity:.7'>{escape(title)}</div>"
        f"<div style='font-size:1.5em;font-weight:700;color:{GOOD if good else BAD}'>"
        f"{escape(headline)}</div><table>{rows}</table><ul>{items}</ul></div>"
    )


def _most(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    found = values[np.isfinite(values)]
    return f"at most {form.format(factor * found.max())} {unit}".strip() if len(found) else "none"


def _least(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    found = values[np.isfinite(values)]
    return f"at least {form.format(factor * found.min())} {unit}".strip() if len(found) else "none"


def _degrees(values: Array) -> str:
    low, high = np.degrees(values.min()), np.degrees(values.max())
    return f"{len(values)} from {low:.0f} to {high:.0f} deg"
