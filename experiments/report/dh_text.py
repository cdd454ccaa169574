"""A fit of links in words and a table, for a terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table

from optim.dh_fit import DHFit, DHParameter, HeldOut, Misfit, Status

UNITS = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}
STRONG = 0.9


def print_fit(fit: DHFit, unseen: HeldOut | None, console: Console) -> None:
    """Print what was fitted, how well, and what cannot be told."""
    recording = fit.recording
    console.print(
        f"{recording.name}: {len(fit.readings)} readings of {recording.robot.name}; "
        f"{fit.options.loss.name}, frame by {fit.options.frame}, {fit.options.solver.name}",
        markup=False,
    )
    console.print(_misfits(fit, unseen))
    console.print(f"noise of one axis, from what the fit leaves: {1e3 * fit.noise:.3f} mm\n")
    console.print(_parameters(fit))
    held = [p for p in fit.parameters if p.status == Status.NOT_IDENTIFIABLE]
    if held:
        console.print("\n[bold]What these poses cannot tell[/bold]")
    for parameter in held:
        console.print(f"  • {parameter.words}", markup=False)
    for line in _correlated(fit):
        console.print(f"  • {line}", markup=False)
    for name in fit.at_bound:
        console.print(f"  • {name} is at its bound: widen it, or doubt the reading", markup=False)


def _misfits(fit: DHFit, unseen: HeldOut | None) -> Table:
    table = Table("misfit, mm", "mean", "largest", "std", "RMS")
    rows = [("nominal links", fit.before), ("fitted links", fit.after)]
    if unseen is not None:
        rows += [("nominal, rows not seen", unseen.before), ("fitted, rows not seen", unseen.after)]
    for label, misfit in rows:
        table.add_row(label, *_four(misfit))
    return table


def _four(misfit: Misfit) -> list[str]:
    return [f"{1e3 * value:.3f}" for value in (misfit.mean, misfit.max, misfit.std, misfit.rms)]


def _parameters(fit: DHFit) -> Table:
    table = Table("parameter", "unit", "nominal", "fitted", "change", "std. error", "")
    for parameter in fit.parameters:
        if parameter.status != Status.NOT_IDENTIFIABLE:
            table.add_row(*_cells(parameter))
    return table


def _cells(parameter: DHParameter) -> list[str]:
    factor, unit = UNITS[parameter.unit]
    value = np.nan if parameter.value is None else parameter.value
    change = factor * (value - parameter.nominal)
    std = "" if parameter.std is None else f"{factor * parameter.std:.4f}"
    head = [parameter.name, unit, f"{factor * parameter.nominal:.3f}", f"{factor * value:.4f}"]
    return [*head, f"{change:+.4f}", std, parameter.words]


def _correlated(fit: DHFit) -> list[str]:
    """Pairs of estimates that the data hardly tell apart, strongest first."""
    names, C = fit.statement.names, fit.correlations
    pairs = [
        (abs(C[i, j]), f"{names[i]} and {names[j]} are correlated: {C[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(C[i, j]) and abs(C[i, j]) > STRONG
    ]
    return [words for _, words in sorted(pairs, reverse=True)]
