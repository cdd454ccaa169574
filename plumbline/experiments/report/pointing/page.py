"""What is said of many angles: a sweep of a needle that was planned, or a map of safe angles."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from plumbline.experiments.report.page.page import Grid, Page, Part, Picture
from plumbline.experiments.report.pointing.figures import angle_map, joint_path
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import AngleMap, Sweep
from plumbline.optim.pointing.constants import NEAREST
from plumbline.optim.pointing.status import MEANING, Status


def sweep_page(answer: Sweep) -> Page:
    """How well the needle is held, what comes near, and what becomes of the angles."""
    pairs = enumerate(answer.pairs[:NEAREST], start=1)
    lines = [
        ("distance from the lesion", _most(answer.rcm_error, 1e3, "mm", "{:.1e}")),
        ("direction", _most(answer.direction_error, 180 / np.pi, "deg", "{:.1e}")),
        ("smallest singular value", _least(answer.singular_value, 1.0, "", "{:.3f}")),
        ("clearance", _least(answer.clearance, 1e3, "mm", "{:.1f}")),
        *((f"nearest, {k}", pair.words) for k, pair in pairs),
        ("step between angles", _most(answer.step, 180 / np.pi, "deg", "{:.2f}")),
        ("drift between angles", _most(answer.drift, 1e3, "mm", "{:.2g}")),
        ("solve", answer.solve.words),
        ("planned in front of", ", ".join(answer.constrained) or "nothing: all pairs judged alone"),
        ("not judged", ", ".join(answer.left_out) or "nothing"),
    ]
    counts, all_safe = Counter(answer.status).most_common(), bool(answer.safe.all())
    return _page(answer, "Sweep", all_safe, lines, counts, "pointing.joints", joint_path)


def map_page(answer: AngleMap) -> Page:
    """How many angles are safe, how wide the cone is, and what becomes of the others."""
    cone = "none" if np.isnan(answer.cone) else f"up to {np.degrees(answer.cone):.0f} deg"
    lines = [
        ("theta", _span(answer.theta)),
        ("beta", _span(answer.beta)),
        ("cone that is safe all around", cone),
        ("least clearance of a safe angle", _least(answer.clearance[answer.safe], 1e3, "mm")),
    ]
    any_safe = bool(answer.safe.any())
    return _page(answer, "Map", any_safe, lines, answer.counts(), "pointing.angles", angle_map)


def _page(
    answer: Sweep | AngleMap,
    kind: str,
    good: bool,
    lines: Sequence[tuple[str, str]],
    counts: Iterable[tuple[Status, int]],
    key: str,
    draw: Callable[[Any], Figure],
) -> Page:
    safe, total = int(answer.safe.sum()), answer.safe.size
    meant = [f"{number} {status.value}: {MEANING[status]}" for status, number in counts]
    return Page(
        name=f"{kind} of {total} angles, arm of {answer.aim.chain.n} joints",
        verdict=f"{safe} of {total} angles safe",
        tone="explained" if good else "outside-library",
        lead=(),
        tiles=(),
        parts=(
            Part("What was looked at", table=Grid(("", ""), lines, sorts=False)),
            Part("What becomes of the angles", points=meant),
            lambda: Picture.of(key, draw(answer)),
        ),
        warnings=answer.judged.failures,
    )


def _most(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    """The largest finite one of some values, in words."""
    found = values[np.isfinite(values)]
    return f"at most {form.format(factor * found.max())} {unit}".strip() if len(found) else "none"


def _least(values: Array, factor: float, unit: str, form: str = "{:.3g}") -> str:
    """The least finite one of some values, in words."""
    found = values[np.isfinite(values)]
    return f"at least {form.format(factor * found.min())} {unit}".strip() if len(found) else "none"


def _span(angles: Array) -> str:
    """How many angles [rad], and from where to where."""
    low, high = np.degrees(angles.min()), np.degrees(angles.max())
    return f"{len(angles)} from {low:.0f} to {high:.0f} deg"
