"""What is said of a fit of links: misfits, what the readings tell, what they do not, worst rows."""

from collections.abc import Callable, Sequence

import numpy as np

from plumbline.errors import listed
from plumbline.experiments.report.page.page import Grid, Page, Part, Picture, Tile
from plumbline.optim.dh_fit import DHFit, HeldOut, Quantity, Status
from plumbline.optim.dh_fit.answer import UNITS
from plumbline.optim.recording.constants import FIRST_ROW
from plumbline.optim.recording.table import HEADER

MM = 1e3  # in a metre
SHOWN = 12  # worst rows, and gross ones that are named one by one
TERMS = 5  # of a sum that are written out
STRONG, PAIRS = 0.9, 6  # correlations that are said, and how many of them


def page(fit: DHFit, unseen: HeldOut | None = None, files: Sequence[str] = ()) -> Page:
    """The page of a fit, of rows that no fit has seen if asked for, and of files written of it."""
    good = not fit.remarks
    before, after = (fit.before, fit.after) if unseen is None else (unseen.before, unseen.after)
    on = "" if unseen is None else " on rows that the fit has not seen"
    return Page(
        name=fit.recording.name,
        verdict="Links fitted" if good else "Links fitted, with doubts",
        tone="explained" if good else "outside-library",
        lead=(
            f"The drawing's links miss by {MM * before.rms:.3g} mm, the fitted ones by "
            f"{MM * after.rms:.3g} mm{on}.",
        ),
        tiles=[
            Tile("before", f"{MM * before.rms:.3g} mm", "root mean square"),
            Tile("after", f"{MM * after.rms:.3g} mm", f"largest {MM * after.max:.3g} mm"),
            Tile("noise of one axis", f"{MM * fit.noise:.3g} mm", _stated(fit)),
            Tile("readings", f"{len(fit.readings)}", f"{len(fit.gross_rows)} gross"),
            Tile("told", f"{len(fit.quantities)}", "quantities"),
        ],
        parts=(_misfits(fit, unseen), *_pictures(fit), _quantities(fit), _worst(fit),
               _frame(fit), *_untold(fit), *([Part("Files", (), None, files)] if files else [])),
        warnings=(*fit.remarks, *_gross(fit)),
        sha256=fit.recording.sha256,
    )  # fmt: skip


def _stated(fit: DHFit) -> str:
    stated = fit.recording.noise_std
    return "by what the fit leaves" + (f"; stated: {MM * stated:.3f} mm" if stated else "")


def _gross(fit: DHFit) -> list[str]:
    """Rows that no links explain, by the number that an editor gives them."""
    rows, sizes = fit.gross_rows, np.linalg.norm(fit.misfits()[fit.gross], axis=1)
    if not rows:
        return []
    pairs = sorted(zip(sizes, rows, strict=True), reverse=True)
    named = listed((f"{row + FIRST_ROW} ({MM * size:.3g} mm)" for size, row in pairs), SHOWN)
    many = "rows are" if len(pairs) > 1 else "row is"
    said = f"{len(pairs)} {many} grossly off, {HEADER}: {named}"
    return [f"{said}; look at them, or mark them held_out"]


def _misfits(fit: DHFit, unseen: HeldOut | None) -> Part:
    rows = [("nominal links", fit.before), ("fitted links", fit.after)]
    if unseen is not None:
        rows += [("nominal, rows not seen", unseen.before), ("fitted, rows not seen", unseen.after)]
    if fit.registered is not None:
        labels = ("nominal, registration points", "fitted, registration points")
        rows += list(zip(labels, fit.registered, strict=True))
    cells = [
        [label, *(f"{MM * v:.3f}" for v in (misfit.mean, misfit.max, misfit.std, misfit.rms))]
        for label, misfit in rows
    ]
    return Part(
        "Misfits", ("In mm.",), Grid(("", "mean", "largest", "std", "RMS"), cells, range(1, 5))
    )


def _pictures(fit: DHFit) -> list[Callable[[], Picture]]:
    return [
        lambda: Picture.of("dh_fit.rows", fit.plot("rows")),
        lambda: Picture.of("dh_fit.correlations", fit.plot("correlations")),
    ]


def _quantities(fit: DHFit) -> Part:
    rows = []
    for q in fit.quantities:
        factor, unit = UNITS[q.unit]
        change, share = factor * (q.value - q.nominal), fit.shares.get(q.name)
        numbers = [f"{factor * q.nominal:.3f}", f"{factor * q.value:.4f}", f"{change:+.4f}"]
        said = "" if share is None else f"{100 * share:.1f} %"
        rows.append([_short(q), unit, *numbers, f"{factor * q.std:.4f}", said])
    for p in fit.parameters:
        if p.status == Status.AT_BOUND and p.value is not None:
            factor, unit = UNITS[p.unit]
            numbers = [f"{factor * v:.4f}" for v in (p.nominal, p.value, p.value - p.nominal)]
            rows.append([p.name, unit, *numbers, p.words, ""])
    columns = ("quantity", "unit", "nominal", "fitted", "change", "std. error", "share")
    words = (
        "Sums of parameters that the readings tell, most of one term. Share: how far the mean "
        f"squared misfit comes back without this one alone; all explain "
        f"{100 * fit.shares['together']:.1f} %.",
    )
    return Part("What the readings tell", words, Grid(columns, rows, range(2, 7)))


def _short(quantity: Quantity) -> str:
    """The sum's name, cut where it has many terms."""
    if len(quantity.parts) <= TERMS:
        return quantity.name
    more = ", ".join(name for name, _ in quantity.parts[1:TERMS])
    return f"{quantity.parts[0][0]} with {more} and {len(quantity.parts) - TERMS} more"


def _worst(fit: DHFit) -> Part:
    before, after = (np.linalg.norm(v, axis=1) for v in (fit.nominal_misfits(), fit.misfits()))
    rows = []
    for k in np.argsort(-after, kind="stable")[:SHOWN]:
        left = [f"{MM * v:+.3f}" for v in fit.misfits()[k]]
        sizes = [f"{MM * after[k]:.3f}", f"{MM * before[k]:.3f}"]
        rows.append([str(k + FIRST_ROW), *sizes, *left, "gross" if fit.gross[k] else ""])
    columns = ("row", "after", "before", "dx", "dy", "dz", "")
    words = (f"Rows as an editor counts, {HEADER}; in mm, largest first.",)
    grid = Grid(columns, rows, range(6))
    return Part("The rows that are missed most", words, grid, on_paper=True)


def _frame(fit: DHFit) -> Part:
    rows = [[f"{v:.8f}" for v in row] for row in fit.T_robot_camera]
    tool = ", ".join(f"{MM * v:.3f}" for v in fit.tool)
    words = (f"Tool ({tool}) mm in the tip frame. T_robot_camera, lengths in m:",)
    return Part("Frame and tool", words, Grid(("", "", "", ""), rows, range(4), sorts=False))


def _untold(fit: DHFit) -> list[Part]:
    lines = [p.words for p in fit.parameters if p.status == Status.NOT_IDENTIFIABLE]
    lines += _correlated(fit)
    lines += [f"{name} is at its bound: widen it, or doubt the reading" for name in fit.at_bound]
    return [Part("What these poses cannot tell", (), None, lines)] if lines else []


def _correlated(fit: DHFit) -> list[str]:
    """Pairs of estimates that the data hardly tell apart, strongest first."""
    names, C = fit.statement.names, fit.correlations
    pairs = [
        (abs(C[i, j]), f"{names[i]} and {names[j]} are correlated: {C[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(C[i, j]) and abs(C[i, j]) > STRONG
    ]
    lines = [words for _, words in sorted(pairs, reverse=True)]
    more = len(lines) - PAIRS
    rest = [f"and {more} more pairs above {STRONG:g}: vary the poses more"] if more > 0 else []
    return [*lines[:PAIRS], *rest]
