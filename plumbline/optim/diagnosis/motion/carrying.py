r"""Whether the tip carries a mass that the robot's file lacks: asked of all joints together.

A mass changes what moves every body, and each drive alone finds a gain, an offset or friction in
its place. So before drives are believed, it is asked by ideal ones, with a clock that leads beside
it: if that is more probable than what they were found to do instead, states are found anew with
the mass, until it stands still, and drives are searched again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.optim.diagnosis.findings import Blame, Cause, Estimate
from plumbline.optim.diagnosis.motion.carried import Carried
from plumbline.optim.diagnosis.motion.constants import (
    CONFOUNDED,
    FORMS,
    MOVES,
    ROUNDED,
    WORTH_A_FIT,
)
from plumbline.optim.diagnosis.motion.fit import correlation_time
from plumbline.optim.diagnosis.motion.masses import MassFit, Telling, fitted_mass
from plumbline.optim.diagnosis.motion.models import ODDS
from plumbline.optim.diagnosis.motion.search import Begun, JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of
from plumbline.optim.diagnosis.motion.windows import Array, Drives, Effects

Where = tuple[str, int | None]
PLACE: Where = (str(CarriedMass.stage), None)  # where a mass is
STAGE = str(MotionEffect.stage)
ODDS_OF_FORM = ODDS - float(np.log(len(FORMS)))  # which share an effect's odds


def drives_of_all(begun: Sequence[Begun], n: int) -> Drives:
    """What every joint's drive was found to do so far; those that stood are ideal."""
    drives: list[tuple[Effects, Array]] = [((), np.empty(0))] * n
    for one in begun:
        drives[one.number - 1] = one.near.effects, one.near.theta
    return tuple(drives)


def refined(signals: Signals, begun: Sequence[Begun]) -> Carried:
    """What the tip carries, by drives that were found; nothing where it carries nothing."""
    now = signals.recording.carried
    return told_by(signals, begun).carried if now.values else now


def told_by(signals: Signals, begun: Sequence[Begun]) -> MassFit:
    """What the tip carries, by drives that were found."""
    telling = Telling(signals, drives_of_all(begun, signals.recording.n), signals.training)
    return fitted_mass(telling, signals.recording.carried.values, clock=False)


def likeliest(telling: Telling) -> tuple[MassFit, float]:
    """Of a point at the tip, a point elsewhere and any body the most probable; a clock may lead.

    And its log odds against none, of a clock that may lead as well.
    """
    now = list(telling.recording.carried.values) or [float(telling.scales[0])]
    fits = [fitted_mass(telling, (now + [0.0] * n)[:n], clock=True) for n in FORMS]
    times = fits[int(np.argmin([fit.squares.sum() for fit in fits]))].times
    best, none = max(fits, key=lambda fit: fit.score(times)), fitted_mass(telling, (), clock=True)
    return best, best.score(times) - none.score(times) + ODDS_OF_FORM


Move = tuple[Array, Array]  # values of a mass (P,), and by how much those of their states are off


def further(signals: Signals, fit: MassFit, before: Move | None) -> tuple[Signals, Move]:
    """States with a mass moved on, by this move and the one before it.

    Of what bodies hardly tell states follow what is carried, and one move is a part of the way
    (Anderson 1965, J. ACM 12(4):547, of one move before; in standard errors).
    """
    r = signals.recording
    now, off = np.array(r.carried.values), np.array(fit.carried.values) - r.carried.values
    values = now + off
    if before is not None:
        moved, change = now - before[0], off - before[1]
        precise = np.linalg.solve(fit.covariance, change)
        share = float(precise @ off) / max(float(precise @ change), 1e-300)
        values = values - share * (moved + change)
    carried = Carried((*values.tolist(),))
    return signals_of(replace(r, carried=carried), drives=signals.drives), (now, off)


def is_asked(signals: Signals, without: Sequence[str]) -> bool:
    """Whether a mass may show: where torques push bodies whose file has masses, to a tip."""
    r = signals.recording
    asked = r.law.pushes and signals.has_masses and r.robot.default_tip in r.robot.tip_frames
    return asked and CarriedMass.name not in without


def carrying_more(signals: Signals, begun: Sequence[Begun], drives: Drives) -> Signals | None:
    """The same with a mass that the tip carries, where that may be the more probable.

    Args:
        signals: States by which nothing is carried.
        begun: What drives were found to do there.
        drives: By which the mass is asked; none if ideal.
    """
    n = signals.recording.n
    own = drives or drives_of_all((), n)
    fit, more = likeliest(Telling(signals, own, begun[0].quick.windows.start))  # as their odds are
    if min(more, more_probable(fit, begun)) < 0:
        return None
    was = lead = signals.recording.lead
    row = float(np.median(np.diff(signals.recording.time)))
    for _ in range(MOVES):
        bodies = replace(signals.recording, carried=fit.carried, lead=lead)
        signals = signals_of(bodies, drives=drives)
        fit, _ = likeliest(Telling(signals, own, signals.training))
        ahead = float(np.clip(lead - fit.late, 0.0, row))
        significant = ((ahead - was) / fit.late_std) ** 2 / 2 > WORTH_A_FIT
        if not significant or abs(ahead - was) < ROUNDED * row:
            ahead = was
        if fit.off < 1.0 and abs(ahead - lead) <= fit.late_std:
            break
        lead = ahead
    return signals


def more_probable(fit: MassFit, begun: Sequence[Begun]) -> float:
    """Log odds of a mass against what drives were found to do without one."""
    found = ODDS_OF_FORM - fit.occam
    for one in begun:
        j = one.number - 1
        square, time = fit.squares[j], fit.times[j]
        if square > one.near.square:
            time = correlation_time(one.near.residual)
        effective = fit.residuals[j].size / time
        found -= effective / 2 * float(np.log(square)) + one.quick.score(one.key, time)
    return found


def against(signals: Signals, begun: Sequence[Begun]) -> float:
    """What a mass that is carried takes from the log odds of what all joints did."""
    if not signals.recording.carried.values:
        return 0.0
    return ODDS_OF_FORM - told_by(signals, begun).occam


@dataclass(frozen=True, eq=False)
class MassFindings:
    """What was found of a mass that the tip carries."""

    carried: Carried  # its values
    std: Array  # their standard errors (P,)
    widths: Array  # their priors' widths (P,)
    probability: float  # that one is carried
    # what may stand in its place: effects of joints, from 1, with their probability
    instead: tuple[tuple[str, int, float], ...]
    off: float  # standard errors that its values would still move

    def cause(self, probability: float, before: float, after: float) -> Cause:
        """It as a cause, left-out errors being so large without and with it [rad]."""
        told = zip(self.carried.declared, self.carried.values, self.std, self.widths, strict=True)
        instead = (Blame(name, STAGE, j) for name, j, p in self.instead if p > CONFOUNDED)
        return Cause(
            CarriedMass.name,
            *PLACE,
            probability=probability,
            parameters={
                p.name: Estimate(v, float(s), p.unit, False, p.doc, bool(s < width))
                for p, v, s, width in told
            },
            before=before,
            after=after,
            confounded_with=tuple(instead),
            words=CarriedMass.words,
            variant=self.carried.form,
        )


def mass_findings(
    signals: Signals, joints: Sequence[JointFindings], more: float, plain: Sequence[Begun]
) -> MassFindings | None:
    """What was found of a mass, by all windows.

    Args:
        signals: States by which it is carried.
        joints: What was found at each joint.
        more: Log odds of it against none.
        plain: What drives were found to do without it.
    """
    r = signals.recording
    if not r.carried.values:
        return None
    drives = fits_of_all(joints, r.n)
    telling = Telling(signals, drives, signals.training)
    fit = fitted_mass(telling, r.carried.values, clock=False)
    rest = float(np.exp(-np.logaddexp(0.0, more)))
    own = {(e.name, j.number) for j in joints for e in j.fit.effects}
    there = ((e.name, one.number) for one in plain for e in one.near.effects)
    instead = tuple((*key, rest) for key in there if key not in own)
    std = np.sqrt(np.diag(fit.covariance))
    return MassFindings(r.carried, std, telling.scales[: len(std)], 1 - rest, instead, fit.off)


def fits_of_all(joints: Sequence[JointFindings], n: int) -> Drives:
    """Causes of every joint's drive with their values; those that stood are ideal."""
    drives: list[tuple[Effects, Array]] = [((), np.empty(0))] * n
    for joint in joints:
        drives[joint.number - 1] = joint.fit.effects, joint.fit.theta
    return tuple(drives)
