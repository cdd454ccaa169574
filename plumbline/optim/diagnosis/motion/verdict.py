"""From joints to a verdict: the same object that every other recording gets."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.effects.link_inertia import LinkInertia
from plumbline.kinematics.effects.payload import Payload
from plumbline.kinematics.law import Law
from plumbline.optim.core.constants import STILL
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis import findings
from plumbline.optim.diagnosis.findings import Cause
from plumbline.optim.diagnosis.motion.carried import Off
from plumbline.optim.diagnosis.motion.carrying import MassFindings, Where, place_of
from plumbline.optim.diagnosis.motion.constants import (
    AXIS_LEVER,
    CONFOUNDED,
    CORRELATED,
    OWN_PAST,
)
from plumbline.optim.diagnosis.motion.fit import to_go
from plumbline.optim.diagnosis.motion.left_out import LeftOut
from plumbline.optim.diagnosis.motion.proposals import one_operator, proposals
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.units import in_unit, levers_of
from plumbline.optim.diagnosis.motion.windows import Array
from plumbline.optim.diagnosis.of_recordings import JointGap
from plumbline.optim.diagnosis.posterior.parts import Mechanism
from plumbline.optim.diagnosis.predict.shrink import gap_between, shrink_interval
from plumbline.optim.diagnosis.prior import EARNED, FINEST, LEAST_NAMED, PART_OF_UNLISTED
from plumbline.optim.diagnosis.verdict.lack_of_fit import quieter
from plumbline.optim.diagnosis.verdict.tree import tree_of

STAGE = "actuation"
OWN = {"angle": "own angle"}  # as effects call what an unlisted function goes by
Bodies = Sequence[tuple[Off, float]]


@dataclass(frozen=True, eq=False)
class MotionFindings:
    """All that is known when a verdict is due."""

    recording: MotionRecording  # the data
    joints: Sequence[JointFindings]  # what the search found at each joint that moved
    judged: Sequence[LeftOut]  # how that does on what was left out, joint by joint
    still: Sequence[int]  # joints, from 1, that were neither moved nor asked to
    by: str  # what was left out together
    seed: int  # of the interval's draws
    unlisted: float  # prior probability of a mechanism that nobody has listed
    averaged: float = 1.0  # noise of a sample on the even clock, as a share of a reading's
    mass: MassFindings | None = None  # what was found of bodies that weigh other than stated

    @cached_property
    def levers(self) -> dict[int, float]:
        """What each joint's places are divided by, to be told in one figure with all others."""
        return dict(enumerate(levers_of(self.recording.slides).tolist(), start=1))

    @cached_property
    def together(self) -> Sequence[LeftOut]:
        """What was left out, as it is told in one figure."""
        pairs = zip(self.joints, self.judged, strict=True)
        return [judged.over(self.levers[joint.number]) for joint, judged in pairs]

    @cached_property
    def bodies(self) -> Bodies:
        """Those that weigh other than stated, with their probability.

        Of what is unlisted and at work they may be parts.
        """
        if self.mass is None:
            return []
        spared = 1 - PART_OF_UNLISTED * max((joint.outside for joint in self.joints), default=0.0)
        pairs = zip(self.mass.carried.bodies, self.mass.probability, strict=True)
        return [(body, p * spared) for body, p in pairs]


def verdict_of(found: MotionFindings) -> findings.Verdict:
    """Put the verdict together."""
    r, noise = found.recording, _noise(found)
    gap, counted = _gap(found, noise), sum(joint.effective for joint in found.joints)
    causes = (*causes_of(found.mass, found.bodies, found.together), *_causes(found))
    outside, depends = _outside(found, noise)
    missed = noise.source != "fit" and gap.after > EARNED * noise.sigma
    beyond, judged = outside > LEAST_NAMED or missed, _judgement(found)
    stuck = any(e.at_bound for cause in causes for e in cause.parameters.values())
    shown = gap.shrink_ci95[0] >= 0.0
    earned = noise.source != "fit" and judged.converged and shown and not stuck
    kind = findings.Outcome.of(bool(causes), beyond=beyond, earned=earned and not beyond)
    where = _where(found) if causes else ()
    if kind == findings.Outcome.OUTSIDE:
        worst = max(zip(found.joints, found.together, strict=True), key=lambda x: x[1].after.mean())
        where = (findings.Place(STAGE, worst[0].number, 1.0),)
    # What was considered and is not named, most probable first
    named = {(c.effect, c.element) for c in causes}
    rest = [
        findings.Cause(e, STAGE, j.number, probability=p, before=math.nan)
        for j in found.joints
        for e, p in sorted(j.probability.items())
        if (e, j.number) not in named and e not in j.unseen
    ]
    return findings.Verdict(
        verdict=kind,
        gap=gap,
        where=where,
        causes=causes,
        candidates=(*causes, *sorted(rest, key=lambda c: -c.probability)),
        outside_probability=outside,
        outside_depends_on=depends if outside > LEAST_NAMED else "",
        tree=_tree(found),
        unlisted_prior=found.unlisted,
        unobservable=tuple(_unseen(found)),
        next=tuple(proposals(found.joints)),
        staircase=_staircase(found, gap),
        noise=noise,
        notes=(*r.notes, *_notes(found), *quieter(noise, counted, r.unit)),
        judged=judged,
        recording=r.name,
        rows=len(r),
        sha256=r.sha256,
        joints=tuple(_joints(found)),
    )


def _tree(found: MotionFindings) -> tuple[dict[str, Any], ...]:
    """Drive, what its error depends on, mechanism: of equals what is named comes first."""
    joints = found.joints
    places: dict[Where, float] = {(STAGE, j.number): j.anything for j in joints}
    on = {effect.name: effect.depends_on for effect in MOTION_EFFECTS}
    on[LinkInertia.name] = LinkInertia.depends_on
    mechanisms: dict[Mechanism, float] = {}
    for joint in joints:
        fitted = {e.name: joint.mechanisms.get(e.name, 0.0) for e in joint.fit.effects}
        for name, p in (fitted | dict(joint.mechanisms)).items():
            listed = not name.startswith("?")
            depends = on.get(name, "nothing") if listed else OWN.get(name[1:], name[1:])
            mechanisms[STAGE, joint.number, depends, name if listed else None] = p
    for body, p in found.bodies:
        place = place_of(body)
        places[place] = 1 - (1 - places.get(place, 0.0)) * (1 - p)
        mechanisms[*place, Payload.depends_on, body.effect.name] = p
    return tree_of(places, mechanisms)


def _noise(found: MotionFindings) -> findings.NoiseLevel:
    levers = [found.levers[j.number] for j in found.joints]
    pairs = zip(found.joints, levers, strict=True)
    left = _rms([(j.fit.residual.ravel() / lever) ** 2 for j, lever in pairs])
    stated = found.recording.noise_std
    if stated is None:
        return findings.NoiseLevel(left, "fit", 1.0)
    stated *= found.averaged * _rms([1.0 / np.square(levers)])
    return findings.NoiseLevel(stated, "given", left / stated)


def _rms(squares: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(squares)))))


def _gap(found: MotionFindings, noise: findings.NoiseLevel) -> findings.Gap:
    """Root mean squares of one reading, over all joints, of what was left out."""
    before, after = (
        np.concatenate(x) for x in zip(*((j.before, j.after) for j in found.together), strict=True)
    )
    each = np.sqrt(before)[:, None], np.sqrt(after)[:, None]  # of every window
    interval = shrink_interval(*each, np.arange(len(before)), found.seed)
    sides = float(np.sqrt(before.mean())), float(np.sqrt(after.mean()))
    return gap_between(found.recording.unit, sides, noise, noise.sigma, interval, found.by)


def _causes(found: MotionFindings) -> tuple[findings.Cause, ...]:
    """What earns its probability, most important first: by the square that is left without it.

    What was left out need not show it: of a limit that one window reached no other window tells.
    """
    made = []
    for joint, judged in zip(found.joints, found.together, strict=True):
        for k, effect in enumerate(joint.fit.effects):
            if _alike(joint, effect.name) >= LEAST_NAMED:
                more = judged.without[effect.name].sum() - judged.after.sum()
                made.append((more, _cause(found, joint, judged, k)))
    return tuple(cause for _, cause in sorted(made, key=lambda pair: -pair[0]))


def _alike(joint: JointFindings, name: str) -> float:
    """Probability of an effect, or of listed ones that the recording cannot tell from it."""
    others = (p for e, p in joint.instead[name].items() if e[0] != "?" and p > CONFOUNDED)
    return joint.probability[name] + sum(others)


def _cause(found: MotionFindings, joint: JointFindings, judged: LeftOut, k: int) -> findings.Cause:
    effect, r = joint.fit.effects[k], found.recording
    p = effect.parameter
    value, std = float(joint.fit.theta[k]), float(joint.std[k])
    unit, width = in_unit(effect.unit(r.law), r.units[joint.number - 1]), float(joint.fit.scales[k])
    stuck = effect.name in joint.fit.at_bound
    return findings.Cause(
        effect.name,
        STAGE,
        joint.number,
        probability=joint.probability[effect.name],
        parameters={p.name: findings.Estimate(value, std, unit, stuck, p.doc, std < width)},
        before=float(np.sqrt(judged.without[effect.name].mean())),
        after=float(np.sqrt(judged.after.mean())),
        confounded_with=_confounded(joint, k),
        words=effect.words.replace("joint", r.noun).format(element=joint.number),
        variant=effect.variant,
    )


def _confounded(joint: JointFindings, k: int) -> tuple[findings.Blame, ...]:
    """What may stand in a cause's place, and what the rows tell only together with it."""
    name = joint.fit.effects[k].name
    instead = {e: p for e, p in joint.instead[name].items() if p > CONFOUNDED and e[0] != "?"}
    covariance = joint.fit.covariance(joint.effective)
    std = np.sqrt(np.diag(covariance))
    tied = np.abs(covariance[k] / (std[k] * std)) > CORRELATED
    others = [e.name for i, e in enumerate(joint.fit.effects) if tied[i] and i != k]
    return tuple(findings.Blame(e, STAGE, joint.number) for e in dict.fromkeys([*instead, *others]))


def _unseen(found: MotionFindings) -> Iterator[findings.Blame]:
    """Limits that no row comes near, and joints that did nothing."""
    effects = {e.name: e for e in MOTION_EFFECTS}
    for joint in found.joints:
        for name, most in joint.unseen.items():
            unit = in_unit(effects[name].parameter.unit, found.recording.units[joint.number - 1])
            why = f"what was asked for, {quantity(most, unit)}, is within it"
            yield findings.Blame(name, STAGE, joint.number, why)
    for j in found.still:
        yield findings.Blame("actuation", STAGE, j, "it was neither moved nor asked to")


def _outside(found: MotionFindings, noise: findings.NoiseLevel) -> tuple[float, str]:
    """Probability that something else is at work, and what it depends on."""
    spared, words = 1.0, []
    for joint in found.joints:
        p, on = _outside_of(joint, noise)
        spared *= 1 - p
        words.append((p, f"{on} of joint {joint.number}" if on else ""))
    most = max(words, default=(0.0, ""), key=lambda pair: pair[0])
    return float(1 - spared), most[1]


def _outside_of(joint: JointFindings, noise: findings.NoiseLevel) -> tuple[float, str]:
    unlisted = {name[1:]: p for name, p in joint.mechanisms.items() if name.startswith("?")}
    on = max(unlisted, key=unlisted.__getitem__, default="")
    if noise.source != "fit" or joint.fit.square <= FINEST**2:
        return joint.outside, on
    r = joint.fit.residual
    past = float(np.sum(r[:, 1:] * r[:, :-1]) / np.sum(r[:, 1:] ** 2))
    if past > OWN_PAST and joint.outside < LEAST_NAMED:
        return 1 - OWN_PAST / past * LEAST_NAMED, "its own past"
    return joint.outside, on


def _where(found: MotionFindings) -> tuple[findings.Place, ...]:
    """Shares of the square that each joint's causes take."""
    drops: dict[Where, float] = {
        (STAGE, joint.number): max(float(judged.begun.sum() - judged.after.sum()), 0.0)
        for joint, judged in zip(found.joints, found.together, strict=True)
        if joint.fit.effects
    }
    for body, share in shares(found.bodies, found.together):
        drops[place_of(body)] = drops.get(place_of(body), 0.0) + share
    total = sum(drops.values()) or 1.0
    places = [findings.Place(*place, drop / total) for place, drop in drops.items()]
    return tuple(sorted(places, key=lambda place: -place.share))


def _staircase(found: MotionFindings, gap: findings.Gap) -> tuple[findings.Step, ...]:
    """The gap as the joints' causes go in, joint by joint."""
    pairs = list(zip(found.joints, found.together, strict=True))
    count = sum(len(judged.before) for _, judged in pairs)
    square = sum(float(judged.before.sum()) for _, judged in pairs)
    steps = [findings.Step("before", gap.before)]
    if found.mass is not None:
        square -= taken(found.together)
        labels = " + ".join(body.label for body in found.mass.carried.bodies)
        steps.append(findings.Step(labels, math.sqrt(square / count)))
    for joint, judged in sorted(pairs, key=lambda x: x[1].after.sum() - x[1].begun.sum()):
        if joint.fit.effects:
            square += float(judged.after.sum() - judged.begun.sum())
            steps.append(findings.Step(f"drive {joint.number}", math.sqrt(square / count)))
    return tuple(steps)


def _joints(found: MotionFindings) -> Iterator[JointGap]:
    for joint, judged in zip(found.joints, found.judged, strict=True):
        before, after = (float(np.sqrt(s.mean())) for s in (judged.before, judged.after))
        label = f"{found.recording.noun} {joint.number}"
        yield JointGap(joint.number, label, before, after, found.recording.units[joint.number - 1])


def _notes(found: MotionFindings) -> list[str]:
    told = [
        f"drive {joint.number}: play and a dead band are one and the same as they act here"
        for joint in found.joints
        if one_operator(joint)
    ]
    step = float(np.median(np.diff(found.recording.time)))  # an even clock may be slower
    if found.recording.law in (Law.HELD, Law.HELD_SERVO):
        told.append(
            "commands are taken to stand until the next row, as a controller holds them: were "
            f"they to run on, joints would be late by half a row, {500 * step:.3g} ms"
        )
    if found.recording.law == Law.SMOOTH:
        told.append(
            "commands are taken to run smoothly between rows: were they straight, a lag would look "
            f"like a servo of second order of {1e3 * step * np.pi / 3**0.5:.3g} ms"
        )
    if (lead := found.recording.lead) > 0:
        told.append(
            f"joints lead by {1e3 * lead:.3g} ms, taken for one clock of all, as no drive can: a "
            "simulator's step leads by half of it, a row that states what acted since the one "
            "before by half a row"
        )
    if any(found.recording.slides) and not all(found.recording.slides):
        told.append(
            f"in figures of all joints together a slide's metres are divided by {AXIS_LEVER:g} m"
        )
    late = ((joint, _delay(joint)) for joint in found.joints)
    return [*told, *(_held(joint, 1e3 * step, d) for joint, d in late if d < step)]


def _delay(joint: JointFindings) -> float:
    """How late a drive whose commands are not known to be held is [s]; infinite if it is not."""
    values = zip(joint.fit.effects, joint.fit.theta, strict=True)
    late = (float(d) for e, d in values if e.name == "actuation_delay")
    return math.inf if joint.windows.law.holds else next(late, math.inf)


def _held(joint: JointFindings, step: float, late: float) -> str:
    """What a delay [s] by less than a row [ms] may be."""
    law = joint.windows.law
    if late < 0:
        return (
            f"drive {joint.number} leads its commands: a row that states what acted since the one "
            f"before leads by half a row, {step / 2:.3g} ms; farther ahead commands are logged late"
        )
    mend = {Law.VELOCITY: "rate", Law.SAMPLED_TORQUE: "torque"}.get(law)
    said = f'; if yours does, write command = "{mend}"' if mend else ""
    return (
        f"drive {joint.number} is late by less than a row's {step:.3g} ms, between which commands "
        f"are taken to run on: one that a controller holds is late by {step / 2:.3g} ms{said}"
    )


def _judgement(found: MotionFindings) -> Judgement:
    fits = []
    if found.mass is not None:
        fits.append(Judged("the fit of masses", found.mass.off <= STILL, found.mass.off, 0.0, ()))
    for joint in found.joints:
        go = to_go(joint.windows, joint.fit, joint.effective)
        bound = tuple(f"{name} {joint.number}" for name in joint.fit.at_bound)
        fits.append(Judged(f"the fit of joint {joint.number}", go <= STILL, go, 0.0, bound))
    return Judgement(all(f.converged for f in fits), tuple(fits))


def causes_of(
    mass: MassFindings | None, bodies: Bodies, together: Sequence[LeftOut]
) -> Iterator[Cause]:
    """Those that are probable as causes, by what all joints were left out of."""
    for k, (body, p) in enumerate(bodies):
        if mass is not None and p >= LEAST_NAMED:
            pairs = ((judged.without[body.label], judged.after) for judged in together)
            roots = (np.sqrt(np.concatenate(x).mean()) for x in zip(*pairs, strict=True))
            without, after = map(float, roots)
            yield mass.cause(k, p, without, after)


def taken(together: Sequence[LeftOut]) -> float:
    """What masses take of the square of what is left, of all joints [rad^2]."""
    return sum(float(judged.before.sum() - judged.begun.sum()) for judged in together)


def shares(bodies: Bodies, together: Sequence[LeftOut]) -> Iterator[tuple[Off, float]]:
    """Of that, each body's part: by what is left more without it alone [rad^2]."""
    more = [
        max(sum(float((j.without[b.label] - j.after).sum()) for j in together), 0.0)
        for b, _ in bodies
    ]
    for (body, _), own in zip(bodies, more, strict=True):
        yield body, max(taken(together), 0.0) * own / (sum(more) or 1.0)
