"""A fit of links in words and a table, for a terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table

from plumbline.optim.dh_fit import DHFit, HeldOut, Misfit, Quantity, Status
from plumbline.optim.dh_fit.answer import FIRST_ROW, UNITS

STRONG = 0.9
SHOWN = 12  # gross rows that are named one by one
TERMS = 5  # of a sum that are written out
PAIRS = 6  # correlated ones that are named one by one


def print_fit(fit: DHFit, unseen: HeldOut | None, console: Console) -> None:
    """Print what was fitted, how well, and what cannot be told."""
    recording = fit.recording
    console.print(
        f"{recording.name}: {len(fit.readings)} readings of {recording.robot.name}; "
        f"{fit.options.loss.name}, frame by {fit.options.frame}, {fit.solver}",
        markup=False,
    )
    console.print(_misfits(fit, unseen))
    console.print(
        f"noise of one axis, from what the fit leaves: {1e3 * fit.noise:.3f} mm{_stated(fit)}"
    )
    for line in (*fit.remarks, *_gross(fit)):
        console.print(f"  ! {line}", markup=False, soft_wrap=True)
    console.print(_quantities(fit))
    untold = [p for p in fit.parameters if p.status == Status.NOT_IDENTIFIABLE]
    if untold:
        console.print("\n[bold]What these poses cannot tell[/bold]")
    for parameter in untold:
        console.print(f"  • {parameter.words}", markup=False)
    for line in _correlated(fit):
        console.print(f"  • {line}", markup=False)
    for name in fit.at_bound:
        console.print(f"  • {name} is at its bound: widen it, or doubt the reading", markup=False)


def _stated(fit: DHFit) -> str:
    stated = fit.recording.noise_std
    return f"; stated: {1e3 * stated:.3f} mm" if stated else ""


def _gross(fit: DHFit) -> list[str]:
    """Rows that no links explain, by the number that an editor gives them."""
    rows, sizes = fit.gross_rows, np.linalg.norm(fit.misfits()[fit.gross], axis=1)
    if not rows:
        return []
    pairs = sorted(zip(sizes, rows, strict=True), reverse=True)
    named = [f"{row + FIRST_ROW} ({1e3 * size:.3g} mm)" for size, row in pairs[:SHOWN]]
    rest = f" and {len(pairs) - SHOWN} more" if len(pairs) > SHOWN else ""
    many = "rows are" if len(pairs) > 1 else "row is"
    return [
        f"{len(pairs)} {many} grossly off (the header being row 1): {', '.join(named)}{rest}; "
        "look at them, or mark them held_out"
    ]


def _misfits(fit: DHFit, unseen: HeldOut | None) -> Table:
    table = Table("misfit, mm", "mean", "largest", "std", "RMS")
    rows = [("nominal links", fit.before), ("fitted links", fit.after)]
    if unseen is not None:
        rows += [("nominal, rows not seen", unseen.before), ("fitted, rows not seen", unseen.after)]
    if fit.registered is not None:
        labels = ("nominal, registration points", "fitted, registration points")
        rows += list(zip(labels, fit.registered, strict=True))
    for label, misfit in rows:
        table.add_row(label, *_four(misfit))
    return table


def _four(misfit: Misfit) -> list[str]:
    return [f"{1e3 * value:.3f}" for value in (misfit.mean, misfit.max, misfit.std, misfit.rms)]


def _quantities(fit: DHFit) -> Table:
    """Every number that the readings tell, and no other: a parameter alone, or a sum."""
    table = Table(
        "what the readings tell", "unit", "nominal", "fitted", "change", "std. error", "share"
    )
    for quantity in fit.quantities:
        table.add_row(*_cells(quantity, fit.shares.get(quantity.name)))
    for p in fit.parameters:
        if p.status == Status.AT_BOUND and p.value is not None:
            factor, unit = UNITS[p.unit]
            numbers = (p.nominal, p.value, p.value - p.nominal)
            cells = [f"{factor * v:.4f}" for v in numbers]
            table.add_row(p.name, unit, *cells, "", p.words)
    table.caption = (
        "share: how far the mean squared misfit of the nominal links comes back without this one "
        f"alone; all explain {100 * fit.shares['together']:.1f} %"
    )
    return table


def _cells(quantity: Quantity, share: float | None) -> list[str]:
    factor, unit = UNITS[quantity.unit]
    numbers = (quantity.value, quantity.value - quantity.nominal)
    value, change = (factor * v for v in numbers)
    said = "" if share is None else f"{100 * share:.1f} %"
    head = [_short(quantity), unit, f"{factor * quantity.nominal:.3f}", f"{value:.4f}"]
    return [*head, f"{change:+.4f}", f"{factor * quantity.std:.4f}", said]


def _short(quantity: Quantity) -> str:
    """The sum's name, cut where it has many terms."""
    if len(quantity.parts) <= TERMS:
        return quantity.name
    more = ", ".join(name for name, _ in quantity.parts[1:TERMS])
    return f"{quantity.parts[0][0]} with {more} and {len(quantity.parts) - TERMS} more"


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
