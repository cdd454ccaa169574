"""The simulated sessions of the link fit's paper, and what the paper does not say of them.

Its figures before the fit set their size. The published form has 24 numbers, d, a, alpha and theta
of six rows. Where two axes are parallel it cannot hold a tilt in the plane of both: they would meet
at a / beta, metres away. How much of a fit is lost so is measured on the same arm with all, half, a
quarter and none of its tilts, each time scaled to the paper's misfit before the fit, and with
bounds ten times as wide.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plumbline.experiments.reality import tip_readings as reality
from plumbline.experiments.reproduce import Table
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import DHFit, DHOptions, Misfit, Readings, fit_dh
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording

# Mean, maximum and standard deviation [mm] of five sets of 30 readings, before and after.
PAPER = (
    ((6.782, 14.051, 2.584), (0.687, 1.982, 0.405)),
    ((8.124, 12.086, 1.781), (0.741, 1.423, 0.264)),
    ((7.328, 11.869, 2.841), (0.912, 1.824, 0.415)),
    ((7.948, 11.842, 1.794), (0.804, 1.607, 0.481)),
    ((8.425, 13.408, 2.108), (0.938, 1.414, 0.281)),
)
READINGS = 30  # of a group, as in the paper
NOISE = 2.5e-4  # [m] of one axis: 0.43 mm in space, an optical tracker's 0.35 and the arm's own
FINE_NOISE = 2e-5  # [m]
WANDER = (2e-5, 5e-5)  # [m], [rad]
FINE_WANDER = (2e-6, 5e-6)  # [m], [rad]
PUBLISHED = DHOptions(frame="registration", parameters="all", hayati=False)
WITH_TILTS = DHOptions(frame="registration")
JOINT = DHOptions(frame="joint")
FORMS = ("published", "with_tilts", "free_frame")
LESS = (0.5, 0.25, 0.0)  # parts of its tilts that an arm is given
WIDER = 10.0  # times the bounds
WORKSPACE = 2000  # poses over the whole workspace
PARALLEL = 3  # rows of the drawing whose axis is parallel to the next
NAMED = 0.005  # share below which a sum is left out of the table


def recording_of(session: reality.Session, name: str = "simulated") -> Recording:
    """A session as a recording of the bundled arm."""
    return build_recording(
        observation="tip_position",
        robot=Robot.bundled("bh7"),
        q=session.q,
        measured=session.tips,
        always=("frame",),
        name=name,
    )


def registration_of(session: reality.Session) -> Readings:
    """Its four registration points."""
    return Readings(session.registration_q, session.registration_tips)


def draw(
    seed: int,
    k: int,
    noise: float,
    wander: tuple[float, float],
    box: reality.Box | None,
    *,
    tilt: float = 1.0,
) -> reality.Session:
    """Group k (from 0) of a seed, with errors of the size that the paper's misfits have.

    Camera's noise [m], joints' wander [m, rad], box and part of the tilts are those of
    :func:`~plumbline.experiments.reality.tip_readings.draw_session`.
    """
    before, own = 1e-3 * PAPER[k][0][0], 1000 * seed + k
    return reality.draw_session(
        own, readings=READINGS, before=before, noise=noise, wander=wander, box=box, tilt=tilt
    )


def in_mm(misfit: Misfit) -> dict[str, float]:
    """Mean, maximum and standard deviation [mm]."""
    return {"mean": 1e3 * misfit.mean, "max": 1e3 * misfit.max, "std": 1e3 * misfit.std}


def words(misfit: Misfit) -> str:
    """The same in one cell."""
    return " / ".join(f"{value:.3f}" for value in in_mm(misfit).values())


@dataclass(frozen=True)
class Tilted:
    """Tilts of parallel axes [rad RMS], and the mean misfit that the 24 numbers leave [m]."""

    part: float
    size: float
    published: float


@dataclass(frozen=True, eq=False)
class Beyond:
    """What the paper does not say of one group."""

    # the 24 numbers, by how much of the tilts the arm has, all of them first
    tilts: tuple[Tilted, ...]
    wider: float  # mean misfit that they leave with bounds ten times as wide [m]
    with_tilts: float  # mean misfit with Hayati's tilts free [m]
    # share of the misfit before that every sum explains, published form and with tilts
    shares: tuple[dict[str, float], dict[str, float]]
    # misfits of the four registration points before and after, with tilts
    registration: tuple[Misfit, Misfit]
    inside: tuple[Misfit, ...]  # errors in the surgical space of each form, noise left out
    outside: tuple[Misfit, ...]  # the same over the rest of the workspace


def look_beyond(seed: int, k: int, session: reality.Session, fits: Sequence[DHFit]) -> Beyond:
    """Look at one group beyond the paper's figures."""
    published, tilted, _ = fits
    four = registration_of(session)
    q = reality.poses(WORKSPACE, np.random.default_rng([seed, k, 5]))
    true = session.built.tips(q)
    exact = Readings(q, (true - session.camera.t) @ session.camera.R)
    errors, within = [fit.misfits(exact) for fit in fits], reality.SURGICAL.holds(true).astype(bool)
    length, angle = WIDER * PUBLISHED.delta_length, WIDER * PUBLISHED.delta_angle
    wide = replace(PUBLISHED, delta_length=length, delta_angle=angle)
    tilts = [_tilted(1.0, session, published)]
    for part in LESS:
        less = draw(seed, k, NOISE, WANDER, reality.SURGICAL, tilt=part)
        fit = fit_dh(recording_of(less), PUBLISHED, registration=registration_of(less))
        tilts.append(_tilted(part, less, fit))
    return Beyond(
        tuple(tilts),
        fit_dh(recording_of(session), wide, registration=four).after.mean,
        tilted.after.mean,
        (published.shares, tilted.shares),
        (Misfit.of(tilted.nominal_misfits(four)), Misfit.of(tilted.misfits(four))),
        tuple(Misfit.of(e[within]) for e in errors),
        tuple(Misfit.of(e[~within]) for e in errors),
    )


def _tilted(part: float, session: reality.Session, fit: DHFit) -> Tilted:
    beta = (session.built.rows - reality.Built.drawing().rows)[:PARALLEL, 4]
    return Tilted(part, float(np.sqrt(np.mean(beta**2))), fit.after.mean)


def beyond_figures(found: Beyond) -> dict[str, Any]:
    """For JSON, beside a group's other figures: lengths in mm, angles in deg."""
    before, after = found.registration
    return {
        "tilts": [
            {
                "part": t.part,
                "rms_deg": float(np.rad2deg(t.size)),
                "published_form": 1e3 * t.published,
            }
            for t in found.tilts
        ],
        "published_form_wider_bounds": 1e3 * found.wider,
        "shares": dict(zip(FORMS, found.shares, strict=False)),
        "registration_points": {"before": in_mm(before), "after": in_mm(after)},
        "workspace": {
            form: {"inside": in_mm(inside), "outside": in_mm(outside)}
            for form, inside, outside in zip(FORMS, found.inside, found.outside, strict=True)
        },
    }


def beyond_tables(fits: Sequence[DHFit], several: Sequence[Beyond]) -> tuple[Table, ...]:
    """The same for people."""
    points = _points_table(fits, several)
    return _tilts_table(several), _shares_table(several), points, _workspace_table(several)


def _tilts_table(groups: Sequence[Beyond]) -> Table:
    rows = []
    for k, g in enumerate(groups, start=1):
        steps = [f"{1e3 * t.published:.3f} at {np.rad2deg(t.size):.2f} deg" for t in g.tilts]
        rows.append((f"{k}", *steps, f"{1e3 * g.wider:.3f}", f"{1e3 * g.with_tilts:.3f}"))
    parts = (f"24, {100 * part:g} % of the tilts" for part in (1.0, *LESS))
    heads = ("group", *parts, f"24, bounds x {WIDER:g}", "with tilts")
    return Table.of("dh-fit.tilts", rows, heads)


def _shares_table(groups: Sequence[Beyond]) -> Table:
    """One row a leading parameter: sums differ a little from group to group."""
    found: dict[str, list[float]] = {}
    for k, group in enumerate(groups):
        for name, share in group.shares[1].items():
            lead = name.split(" + ")[0].split(" - ")[0]
            found.setdefault(lead, [0.0] * len(groups))[k] = share
    together = found.pop("together")
    kept = {name: row for name, row in found.items() if max(row) >= NAMED}
    ranked = sorted(kept.items(), key=lambda item: -sum(item[1]))
    rows = [(name, *(f"{100 * s:.1f}" for s in row)) for name, row in ranked]
    rows.append(("all together", *(f"{100 * s:.1f}" for s in together)))
    heads = ("sum led by", *(f"group {k}" for k in range(1, len(groups) + 1)))
    return Table.of("dh-fit.shares", rows, heads)


def _points_table(fits: Sequence[DHFit], several: Sequence[Beyond]) -> Table:
    rows = []
    for k, (fit, beyond) in enumerate(zip(fits, several, strict=True), start=1):
        before, after = beyond.registration
        rows.append((f"{k}", *(words(m) for m in (before, after, fit.before, fit.after))))
    return Table.of("dh-fit.points", rows)


def _workspace_table(groups: Sequence[Beyond]) -> Table:
    rows = []
    for k, g in enumerate(groups, start=1):
        cells = (
            f"{1e3 * part.mean:.3f} / {1e3 * part.max:.3f}"
            for pair in zip(g.inside, g.outside, strict=True)
            for part in pair
        )
        rows.append((f"{k}", *cells))
    return Table.of("dh-fit.workspace", rows, poses=WORKSPACE)
