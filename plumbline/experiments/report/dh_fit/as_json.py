"""A fit of links for JSON: lengths in m, angles in rad, None where nothing is known.

What is reported are ``quantities``: sums of parameters that the readings tell, most of one term.
"""

from __future__ import annotations

from typing import Any

from plumbline.optim.dh_fit import DHFit, DHParameter, Misfit, Readings
from plumbline.optim.dh_fit import HeldOut as HeldOutMisfits
from plumbline.optim.dh_fit.export import Exported

FIRST_ROW = 2  # of a table: the header is row 1


def content(
    fit: DHFit, unseen: HeldOutMisfits | None, files: dict[str, Exported]
) -> dict[str, Any]:
    """For JSON: lengths in m, angles in rad, None where nothing is known."""
    known = fit.identifiability
    return {
        "name": fit.recording.name,
        "robot": fit.recording.robot.name,
        "rows": len(fit.readings),
        "unit": "m",
        "objective": {"name": fit.options.loss.name, "value": fit.objective},
        "solver": {"name": fit.solver, "iterations": fit.iterations},
        "frame": fit.options.frame,
        "before": _numbers(fit.before),
        "after": _numbers(fit.after),
        "held_out": None
        if unseen is None
        else {"before": _numbers(unseen.before), "after": _numbers(unseen.after)},
        "registration_points": None
        if fit.registered is None
        else dict(zip(("before", "after"), map(_numbers, fit.registered), strict=True)),
        "marked_rows": _marked(fit),
        "noise": fit.noise,
        "noise_stated": fit.recording.noise_std,
        "chi_square": _chi_square(fit),
        "remarks": list(fit.remarks),
        "gross_rows": _gross(fit),
        "rank": known.rank,
        "quantities": _quantities(fit),
        "explained_together": fit.shares["together"],
        "parameters": [_parameter(p) for p in fit.parameters],
        "moves_together": [held.words for held in known.held],
        "at_bound": list(fit.at_bound),
        "tool": fit.tool.tolist(),
        "T_robot_camera": fit.T_robot_camera.tolist(),
        "files": {
            option: {"tip_frame": e.tip_frame, "largest_error": e.error}
            for option, e in files.items()
        },
    }


def _quantities(fit: DHFit) -> list[dict[str, Any]]:
    return [
        {
            "name": q.name,
            "parts": [{"name": name, "coefficient": c} for name, c in q.parts],
            "unit": q.unit,
            "nominal": q.nominal,
            "value": q.value,
            "std": q.std,
            "ci95": list(q.ci95),
            "share": fit.shares.get(q.name),
        }
        for q in fit.quantities
    ]


def _parameter(p: DHParameter) -> dict[str, Any]:
    return {
        "name": p.name,
        "unit": p.unit,
        "nominal": p.nominal,
        "value": p.value,
        "std": p.std,
        "status": p.status.value,
        "why": p.words,
    }


def _chi_square(fit: DHFit) -> dict[str, Any] | None:
    if fit.chi_square is None:
        return None
    return {"value": fit.chi_square, "freedom": fit.freedom, "agrees": fit.agrees}


def _gross(fit: DHFit) -> list[dict[str, Any]]:
    """Rows as an editor counts lines, the header being row 1, and by place, counted from 0."""
    found = [float((e @ e) ** 0.5) for e in fit.misfits()[fit.gross]]
    return [
        {"row": FIRST_ROW + k, "index": k, "misfit": size}
        for k, size in zip(fit.gross_rows, found, strict=True)
    ]


def _numbers(misfit: Misfit) -> dict[str, float]:
    return {key: getattr(misfit, key) for key in ("mean", "max", "std", "rms")}


def _marked(fit: DHFit) -> dict[str, Any] | None:
    """Misfits of the rows that the recording itself marks as held out."""
    flags = fit.recording.held_out
    if flags is None or not flags.any():
        return None
    rows = Readings(fit.recording.q, fit.recording.measured[:, :3]).select(flags)
    before, after = Misfit.of(fit.nominal_misfits(rows)), Misfit.of(fit.misfits(rows))
    return {"rows": len(rows), "before": _numbers(before), "after": _numbers(after)}
