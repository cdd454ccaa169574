r"""Whether bodies weigh other than a robot's file says: asked of all joints together.

A mass at the tip, or a link's, changes what moves every body, and each drive alone finds a gain, an
offset or friction in its place. So before drives are believed, masses are asked by ideal ones, with
a clock that leads beside them: if they are more probable than what drives were found to do instead,
states are found anew with them, until they stand still, and drives are searched again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects.link_inertia import LEAST_MASS
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.effects.payload import CarriedMass
from plumbline.optim.diagnosis.findings import Blame, Cause, Estimate
from plumbline.optim.diagnosis.motion import constants
from plumbline.optim.diagnosis.motion.carried import Carried, Off
from plumbline.optim.diagnosis.motion.fit import correlation_time, evaluated
from plumbline.optim.diagnosis.motion.masses import MassFit, Telling, fitted_mass, path_of
from plumbline.optim.diagnosis.motion.models import ODDS
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.search import Begun, JointFindings
from plumbline.optim.diagnosis.motion.settled import carrying
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of
from plumbline.optim.diagnosis.motion.windows import Array, Drives, Effects

Where = tuple[str, int | None]
STAGE = str(MotionEffect.stage)


def drives_of_all(found: Sequence[Begun | JointFindings], n: int) -> Drives:
    """What every joint's drive was found to do, so far or in the end; ideal where one stood."""
    drives: list[tuple[Effects, Array]] = [((), np.empty(0))] * n
    for one in found:
        fit = one.near if isinstance(one, Begun) else one.fit
        drives[one.number - 1] = fit.effects, fit.theta
    return tuple(drives)


def states_by(r: MotionRecording, drives: Drives) -> Signals | None:
    """States by bodies that may be far from what they are; none where they run off."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = signals_of(r, drives=drives)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return found if found.finite else None


def refined(signals: Signals, begun: Sequence[Begun]) -> Carried:
    """Masses that were found, by drives that were; nothing where none were."""
    now = signals.recording.carried
    if not now.bodies:
        return now
    fit = told_by(signals, begun)
    return fit.carried if fit.real else now


def told_by(signals: Signals, begun: Sequence[Begun]) -> MassFit:
    """The masses that were found, by drives that were."""
    telling = Telling(signals, drives_of_all(begun, signals.recording.n), signals.training)
    return fitted_mass(telling, signals.recording.carried, clock=False)


def candidates(r: MotionRecording, without: Sequence[str] = ()) -> tuple[Off, ...]:
    """Bodies that may weigh other than the file says, in all forms, where a fit may begin.

    At the tip, if the robot has one, and links on the way to it that weigh anything.
    """
    if not r.law.pushes or r.robot.default_tip not in r.robot.tip_frames:
        return ()
    path, model = path_of(r).tolist(), r.robot.model
    weight = sum(model.inertias[j].mass for j in path)
    found = [Off((CarriedMass.mass.scale * weight, *[0.0] * (k - 1))) for k in constants.OF_A_TIP]
    for k, place in enumerate(r.index, start=1):
        if place + 1 in path and model.inertias[place + 1].mass > LEAST_MASS:
            found += [Off((0.0,) * count, k) for count in constants.OF_A_LINK]
    return tuple(body for body in found if weight > 0 and body.effect.name not in without)


def odds(carried: Carried) -> float:
    """Prior log odds of bodies that are off: forms share those of an effect."""
    forms = (
        len(constants.OF_A_LINK if body.link else constants.OF_A_TIP) for body in carried.bodies
    )
    return float(sum(ODDS - np.log(count) for count in forms))


def likeliest(
    telling: Telling, asked: Sequence[Off], enough: Callable[[MassFit], bool] = lambda _: True
) -> MassFit:
    """The most probable bodies, from those of the states on; a clock may lead.

    One more, one less or one exchanged at a time until that is enough, which one is unless it is
    said: where states are far off, more bodies would stand for what the first leaves of them.
    """
    here = fitted_mass(telling, telling.recording.carried, clock=True)
    for _ in range(constants.MOVES):
        tried = [fitted_mass(telling, other, clock=True) for other in _others(here.carried, asked)]
        times = min((here, *tried), key=lambda fit: float(np.log(fit.squares).sum())).times
        counted = [fit for fit in tried if not _negligible(fit, here)]
        best = max((here, *counted), key=lambda fit: fit.score(times) + odds(fit.carried))
        if best is here:
            break
        here = best
        if enough(here):
            break
    return here


def _others(now: Carried, asked: Sequence[Off]) -> Iterator[Carried]:
    """The same with one body less, one more, or one exchanged for another."""
    yield from (now.without(body) for body in now.bodies)
    for less in (now, *(now.without(body) for body in now.bodies)):
        there = {body.link for body in less.bodies}
        for body in asked:
            other = less.with_one(body)
            if body.link not in there and not other.alike(now):
                yield other


def _negligible(fit: MassFit, given: MassFit) -> bool:
    """Whether more values take next to nothing of what any joint is missed by."""
    more = len(fit.carried.values) - len(given.carried.values)
    return bool(more > 0 and (1 - fit.squares / given.squares).max() < constants.LEAST_GAIN)


Move = tuple[Array, Array]  # values of masses (P,), and by how much those of their states are off


def further(signals: Signals, fit: MassFit, before: Move | None) -> tuple[Signals | None, Move]:
    """States with masses moved on, none where they run off: by this move and the one before it.

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
    ahead = r.carried.valued(values)
    moved_on = replace(r, carried=ahead if ahead.is_real(r.robot, r.index) else fit.carried)
    return states_by(moved_on, signals.drives), (now, off)


def carrying_more(
    signals: Signals, begun: Sequence[Begun], drives: Drives, asked: Sequence[Off]
) -> Signals | None:
    """The same with bodies that weigh other than the file says, where that may be more probable.

    Args:
        signals: States by bodies as the file has them.
        begun: What drives were found to do there.
        drives: By which masses are asked; none if ideal.
        asked: Which, see :func:`candidates`.
    """
    n = signals.recording.n
    own = drives or drives_of_all((), n)
    telling = Telling(signals, own, begun[0].quick.windows.start)  # as their odds are by
    fit = likeliest(telling, asked, lambda fit: more_probable(fit, begun) > 0)
    was = lead = signals.recording.lead
    if more_probable(fit, begun) < 0:
        return None
    row = float(np.median(np.diff(signals.recording.time)))
    for _ in range(2 * constants.MOVES):
        if not (fit.carried.bodies and fit.real and np.isfinite(fit.squares).all()):
            return None
        bodies = replace(signals.recording, carried=fit.carried, lead=lead)
        if (moved := states_by(bodies, drives)) is None:
            return None
        signals = moved
        fit = likeliest(Telling(signals, own, signals.training), asked)
        ahead = _lead(fit, was, lead, row)
        if fit.off < 1.0 and abs(ahead - lead) <= fit.late_std:
            break
        lead = ahead
    return signals


def _lead(fit: MassFit, was: float, lead: float, row: float) -> float:
    """By how long a clock leads [s]: as before but for what stands out, of a row so long [s]."""
    ahead = float(np.clip(lead - fit.late, 0.0, row))
    significant = ((ahead - was) / fit.late_std) ** 2 / 2 > constants.WORTH_A_FIT
    return ahead if significant and abs(ahead - was) > constants.ROUNDED * row else was


def more_probable(fit: MassFit, begun: Sequence[Begun]) -> float:
    """Log odds of masses against what drives were found to do without any."""
    if not fit.carried.bodies:
        return -np.inf
    found = odds(fit.carried) - fit.occam
    for one in begun:
        j = one.number - 1
        square, time = fit.squares[j], fit.times[j]
        if square > one.near.square:
            time = correlation_time(one.near.residual)
        effective = fit.residuals[j].size / time
        alone = -effective / 2 * float(np.log(square)) - one.quick.score(one.key, time)
        found += max(alone, 0.0)  # what its drive was found to do it may do beside
    return found


def lesser(signals: Signals, begun: Sequence[Begun], body: Off) -> Iterator[Carried]:
    """The same bodies without one, and with it told by fewer values."""
    carried, drives = signals.recording.carried, drives_of_all(begun, signals.recording.n)
    less = carried.without(body)
    yield less
    for count in constants.OF_A_LINK if body.link else constants.OF_A_TIP:
        if count < len(body.values):
            form = replace(body, values=body.values[:count])
            telling = Telling(signals, drives, signals.training)
            yield fitted_mass(telling, less.with_one(form), clock=False).carried


def felt_by_one(signals: Signals, begun: Sequence[Begun], other: Carried) -> Signals | None:
    """The same with fewer masses, where one joint alone feels that: its drive may be what is off.

    A rotor, and what turns about one upright axis, are one and the same to that joint.
    """
    less, felt = carrying(signals, other), []
    if not (less.finite and other.is_real(less.recording.robot, less.recording.index)):
        return None
    for one in begun:
        windows, near = less.windows(one.number - 1, one.quick.windows.start), one.near
        square = evaluated(windows, near.effects, near.theta, slopes=False).square
        effective = near.residual.size / correlation_time(near.residual)
        felt.append(max(effective / 2 * float(np.log(square / near.square)), 0.0))
    return less if max(felt) > (1 - constants.LEAST_SHARE) * sum(felt) else None


Rivals = dict[str, tuple[float, list[tuple[str, int]]]]


def against(signals: Signals, begun: Sequence[Begun]) -> float:
    """What masses that were found take from the log odds of what all joints did."""
    carried = signals.recording.carried
    return odds(carried) - told_by(signals, begun).occam if carried.bodies else 0.0


@dataclass(frozen=True, eq=False)
class MassFindings:
    """What was found of bodies that weigh other than the file says."""

    carried: Carried  # which, with their values
    std: Array  # standard errors of these (P,)
    widths: Array  # their priors' widths (P,)
    probability: tuple[float, ...]  # that each body is off
    # what may stand in each one's place: effects, with joint or link, 0 for none, and probability
    instead: tuple[tuple[tuple[str, int, float], ...], ...]
    off: float  # standard errors that values would still move

    def cause(self, k: int, probability: float, before: float, after: float) -> Cause:
        """One body as a cause, left-out errors being so large without and with it [rad]."""
        body, first = self.carried.bodies[k], sum(len(b.values) for b in self.carried.bodies[:k])
        own = slice(first, first + len(body.values))
        told = zip(body.declared, body.values, self.std[own], self.widths[own], strict=True)
        instead = (
            Blame(name, STAGE if j else str(CarriedMass.stage), j or None)
            for name, j, p in self.instead[k]
            if p > constants.CONFOUNDED
        )
        return Cause(
            body.effect.name,
            *place_of(body),
            probability=probability,
            parameters={
                p.name: Estimate(v, float(s), p.unit, False, p.doc, bool(s < width))
                for p, v, s, width in told
            },
            before=before,
            after=after,
            confounded_with=tuple(instead),
            words=body.effect.words.format(element=body.link),
            variant=body.form,
        )


def place_of(body: Off) -> Where:
    """Stage and element that a body is blamed on."""
    return str(body.effect.stage), body.link or None


def mass_findings(
    signals: Signals,
    joints: Sequence[JointFindings],
    more: float,
    plain: Sequence[Begun],
    asked: Sequence[Off],
    rivals: Rivals,
) -> MassFindings | None:
    """What was found of masses, by all windows.

    Args:
        signals: States by them.
        joints: What was found at each joint.
        more: Log odds of them against none.
        plain: What drives were found to do without them.
        asked: Which were considered.
        rivals: By a body's label its log odds against what a drive may do in its place.
    """
    r = signals.recording
    if not r.carried.bodies:
        return None
    telling = Telling(signals, drives_of_all(joints, r.n), signals.training)
    fit = fitted_mass(telling, r.carried, clock=False)
    rest = float(np.exp(-np.logaddexp(0.0, more)))
    own = {(e.name, j.number) for j in joints for e in j.fit.effects}
    there = [(e.name, one.number, rest) for one in plain for e in one.near.effects
             if (e.name, one.number) not in own]  # fmt: skip
    found = []
    for k, body in enumerate(r.carried.bodies):
        p, alike = _exchanged(telling, fit, k, asked)
        sure, effects = rivals.get(body.label, (np.inf, []))
        other = float(np.exp(-np.logaddexp(0.0, sure)))
        alike += [(*key, other) for key in effects if key not in own]
        found.append(((1 - rest) * (1 - other) * p, (*alike, *there)))
    probability, instead = zip(*found, strict=True)
    return MassFindings(
        r.carried, np.sqrt(np.diag(fit.covariance)), telling.scales(r.carried), probability,
        instead, fit.off,
    )  # fmt: skip


def _exchanged(
    telling: Telling, fit: MassFit, k: int, asked: Sequence[Off]
) -> tuple[float, list[tuple[str, int, float]]]:
    """Probability of a body among all that may stand in its place, and those with theirs."""
    if not fit.real:
        return 1.0, []
    body = fit.carried.bodies[k]
    less = fit.carried.without(body)
    there = {one.link for one in less.bodies}
    others = [one for one in asked if one.link not in there and one.link != body.link]
    fits = [fitted_mass(telling, less.with_one(one), clock=False) for one in others]
    own = fit.score(fit.times) + odds(fit.carried)
    scores = np.array([0.0, *(f.score(fit.times) + odds(f.carried) - own for f in fits)])
    weights = np.exp(scores - np.logaddexp.reduce(scores))
    by: dict[int, float] = {}
    for one, p in zip(others, weights[1:], strict=True):
        by[one.link] = by.get(one.link, 0.0) + float(p)
    names = {one.link: one.effect.name for one in others}
    return float(weights[0]), [(names[link], link, p) for link, p in by.items()]
