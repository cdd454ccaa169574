"""Bounded DH fit for a surgical space: five groups of readings, fifty points, and outliers.

The paper's arm and camera are not to be had, so both are simulated, by code that shares nothing
with the fit: an arm with manufacturing errors whose size is set so that the mean misfit *before*
the fit is the paper's, group by group. What follows is then measured, not set.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plumbline.experiments.reality.tip_readings import SURGICAL, Box, Session, poses
from plumbline.experiments.reproduce import Compared, Reproduction, Table, figure
from plumbline.experiments.reproduce import dh_fit_sessions as sessions
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.dh_fit import DHFit, DHOptions, Misfit, Norms, Readings, Squares, fit_dh

REPEATABILITY, ABSOLUTE = 1.0, 2.0  # [mm] within which the paper's fifty points lie
POINTS, VISITS, FRESH = 50, 5, 300  # the paper's points and visits, poses that no fit has seen
GROSS_SHARE, GROSS = 0.1, (3e-3, 15e-3)  # share of readings, range of their errors [m]

Three = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Group:
    """One group of readings and its fits."""

    session: Session  # the simulated arm and camera
    fits: tuple[DHFit, ...]  # the published form, with tilts, and with a free camera frame
    fresh: tuple[Misfit, ...]  # misfits of poses in the same space that no fit has seen, fit by fit
    floor: float  # mean misfit of the readings from the arm as it was built [m]
    fresh_floor: float  # the same of the fresh poses [m]


def run(
    seed: int, progress: Progress | None = None, *, several: int = len(sessions.PAPER)
) -> Reproduction:
    """Simulate, fit and tabulate; ``several`` of the paper's groups, or all."""
    tell = progress or silent
    groups, fine = [], []
    for k in range(several):
        tell(f"group {k + 1} of {several}", k / 8.0)
        groups.append(_group(seed, k, sessions.NOISE, sessions.WANDER, SURGICAL))
        fine.append(_group(seed, k, sessions.FINE_NOISE, sessions.FINE_WANDER, SURGICAL))
    tell("beyond the paper", 5 / 8.0)
    beyond = [
        sessions.look_beyond(seed, k, group.session, group.fits) for k, group in enumerate(groups)
    ]
    tell("fifty points", 6 / 8.0)
    points = [_fifty(seed, k) for k in range(several)]
    tell("outliers", 7 / 8.0)
    outliers = [_outliers(seed, k) for k in range(several)]
    tell("done", 1.0)
    paper = ("paper", f"within {REPEATABILITY:g}", "", f"within {ABSOLUTE:g}")
    found = Reproduction.of(
        "dh-fit",
        _figures(groups, beyond, fine, points, outliers),
        (
            _groups_table(groups),
            _forms_table(groups, fine),
            *sessions.beyond_tables([group.fits[1] for group in groups], beyond),
            Table.of("dh-fit.fifty", [*_threes(points), paper]),
            Table.of("dh-fit.outliers", _threes(outliers)),
        ),
        noise=1e3 * sessions.NOISE,
        visits=VISITS,
    )
    shown = Compared("Misfits before and after the fit", tuple(_shown(groups)))
    return replace(found, compared=(shown,))


def _group(seed: int, k: int, noise: float, wander: tuple[float, float], box: Box) -> Group:
    session = sessions.draw(seed, k, noise, wander, box)
    recording, four = sessions.recording_of(session), sessions.registration_of(session)
    fits = tuple(
        fit_dh(recording, o, registration=four)
        for o in (sessions.PUBLISHED, sessions.WITH_TILTS, sessions.JOINT)
    )
    rng = np.random.default_rng([seed, k, 2])
    q = poses(FRESH, rng, box)
    seen = Readings(q, session.visit(q, rng))
    fresh = tuple(Misfit.of(fit.misfits(seen)) for fit in fits)
    own = Readings(session.q, session.tips)
    return Group(session, fits, fresh, _floor(session, own), _floor(session, seen))


def _floor(session: Session, seen: Readings) -> float:
    """Mean misfit [m] of readings from the arm as it was built, the camera where it stands."""
    camera = session.camera
    misfits = session.built.tips(seen.q) - seen.tips @ camera.R.T - camera.t
    return float(np.linalg.norm(misfits, axis=1).mean())


def _fifty(seed: int, k: int) -> Three:
    """Fifty points over the workspace [mm]: repeatability, mean and largest misfit."""
    session = sessions.draw(seed, k, sessions.NOISE, sessions.WANDER, None)
    recording, four = sessions.recording_of(session), sessions.registration_of(session)
    fit = fit_dh(recording, sessions.WITH_TILTS, registration=four)
    rng = np.random.default_rng([seed, k, 3])
    q = poses(POINTS, rng)
    visits = np.array([session.visit(q, rng) for _ in range(VISITS)])
    away = np.linalg.norm(visits - visits.mean(axis=0), axis=2)
    repeatability = away.mean(axis=0) + 3.0 * away.std(axis=0, ddof=1)
    sizes = np.linalg.norm(fit.misfits(Readings(q, visits[0])), axis=1)
    return 1e3 * float(repeatability.mean()), 1e3 * float(sizes.mean()), 1e3 * float(sizes.max())


def _outliers(seed: int, k: int) -> Three:
    """Mean misfits [mm] of clean poses by norms, by squares, and by squares without outliers."""
    session = sessions.draw(seed, k, sessions.NOISE, sessions.WANDER, SURGICAL)
    rng = np.random.default_rng([seed, k, 4])
    clean = sessions.recording_of(session)
    bad = rng.choice(sessions.READINGS, round(GROSS_SHARE * sessions.READINGS), replace=False)
    push = rng.normal(size=(len(bad), 3))
    push *= (rng.uniform(*GROSS, len(bad)) / np.linalg.norm(push, axis=1))[:, None]
    measured = session.tips.copy()
    measured[bad] += push
    spoilt = replace(clean, measured=measured)
    q = poses(FRESH, rng, SURGICAL)
    seen = Readings(q, session.visit(q, rng))
    asked = (spoilt, Norms()), (spoilt, Squares()), (clean, Squares())
    fits = [fit_dh(recording, DHOptions(loss=loss)) for recording, loss in asked]
    norms, squares, clean_squares = (1e3 * Misfit.of(fit.misfits(seen)).mean for fit in fits)
    return norms, squares, clean_squares


def _figures(
    groups: list[Group],
    beyond: list[sessions.Beyond],
    fine: list[Group],
    points: list[Three],
    outliers: list[Three],
) -> dict[str, Any]:
    repeatability, mean, _ = np.mean(points, axis=0)
    kinds = zip(("norms", "squares", "without_outliers"), np.mean(outliers, axis=0), strict=True)
    absolute = max(largest for _, _, largest in points)
    return {
        "groups": [
            {**_group_figures(k, group), **sessions.beyond_figures(more)}
            for k, (group, more) in enumerate(zip(groups, beyond, strict=True))
        ],
        "fine": [
            {
                "unit": "mm",
                "after": sessions.in_mm(group.fits[1].after),
                "noise_floor": 1e3 * group.floor,
                "fresh": sessions.in_mm(group.fresh[1]),
                "fresh_free_frame": sessions.in_mm(group.fresh[2]),
                "fresh_noise_floor": 1e3 * group.fresh_floor,
            }
            for group in fine
        ],
        "repeatability": figure(repeatability, "mm", REPEATABILITY),
        "absolute": figure(absolute, "mm", ABSOLUTE, mean=float(mean)),
        "outliers": {"unit": "mm"} | {kind: float(value) for kind, value in kinds},
    }


def _group_figures(k: int, group: Group) -> dict[str, Any]:
    published, tilted, joint = group.fits
    paper = (dict(zip(("mean", "max", "std"), v, strict=True)) for v in sessions.PAPER[k])
    return {
        "unit": "mm",
        "before": sessions.in_mm(tilted.before),
        "after": sessions.in_mm(tilted.after),
        "paper": dict(zip(("before", "after"), paper, strict=True)),
        "published_form": sessions.in_mm(published.after),
        "free_frame": sessions.in_mm(joint.after),
        "fresh": sessions.in_mm(group.fresh[1]),
        "noise_floor": 1e3 * group.floor,
    }


def _shown(groups: list[Group]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Mean misfits with their spread, and the paper's."""
    for k, group in enumerate(groups):
        both = group.fits[1].before, group.fits[1].after
        for when, own, paper in zip(("before", "after"), both, sessions.PAPER[k], strict=True):
            own_std = 1e3 * own.std
            yield f"group {k + 1}, {when}", figure(1e3 * own.mean, "mm", paper[0], std=own_std)


def _groups_table(groups: list[Group]) -> Table:
    rows = []
    for k, group in enumerate(groups):
        paper = [" / ".join(f"{value:.3f}" for value in values) for values in sessions.PAPER[k]]
        own = [sessions.words(m) for m in (group.fits[1].before, group.fits[1].after)]
        rows.append((f"{k + 1}", paper[0], own[0], paper[1], own[1]))
    return Table.of("dh-fit.groups", rows)


def _forms_table(groups: list[Group], fine: list[Group]) -> Table:
    rows = []
    for noise, several in ((sessions.NOISE, groups), (sessions.FINE_NOISE, fine)):
        for k, g in enumerate(several):
            cells = [f"{1e3 * fit.after.mean:.3f}" for fit in g.fits]
            fresh = [f"{1e3 * g.fresh[j].mean:.3f}" for j in (1, 2)]
            floors = [f"{1e3 * g.floor:.3f}", f"{1e3 * g.fresh_floor:.3f}"]
            head = f"{k + 1}, {1e3 * noise:g} mm"
            rows.append((head, *cells, floors[0], *fresh, floors[1]))
    return Table.of("dh-fit.forms", rows)


def _threes(rows: list[Three]) -> tuple[tuple[str, ...], ...]:
    return tuple((f"{k}", *(f"{v:.3f}" for v in row)) for k, row in enumerate(rows, start=1))
