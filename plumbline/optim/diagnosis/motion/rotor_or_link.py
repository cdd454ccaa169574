r"""A rotor that torques turn may be its link, which weighs other than the file says.

Of what turns about one upright axis a joint feels one number: the rotor's inertia and the link's
are a sum. Both are asked beside all that was found, and share their probability by the evidence.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects.link_inertia import LinkInertia
from plumbline.kinematics.effects.rotor_inertia import RotorInertia
from plumbline.optim.diagnosis.motion.carried import Carried, Off
from plumbline.optim.diagnosis.motion.carrying import drives_of_all, odds, states_by
from plumbline.optim.diagnosis.motion.masses import MassFit, Telling, fitted_mass
from plumbline.optim.diagnosis.motion.models import ODDS
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Signals
from plumbline.optim.diagnosis.motion.windows import Drives

ROTOR, LINK = RotorInertia.name, LinkInertia.name


def or_links(
    signals: Signals, joints: Sequence[JointFindings], asked: Sequence[Off]
) -> Iterator[JointFindings]:
    """What was found of each joint, a rotor sharing its probability with what its link may weigh.

    Args:
        signals: States by all that was found.
        joints: What was found of their drives.
        asked: Bodies that may weigh other than the file says.
    """
    there = {body.link for body in signals.recording.carried.bodies}
    for joint in joints:
        links = [body for body in asked if body.link == joint.number and body.link not in there]
        found = ROTOR in joint.instead and links
        yield _shared(joint, _share(signals, joints, joint, links)) if found else joint


def _share(
    signals: Signals, joints: Sequence[JointFindings], own: JointFindings, links: Sequence[Off]
) -> float:
    """Probability of a link in the place of a rotor."""
    k = [effect.name for effect in own.fit.effects].index(ROTOR)
    carried, drives = signals.recording.carried, drives_of_all(joints, signals.recording.n)
    if (rotor := _told(signals, drives, carried)) is None:
        return 0.0
    effects, theta = drives[own.number - 1]
    less = (*effects[:k], *effects[k + 1 :]), np.delete(theta, k)
    others = (*drives[: own.number - 1], less, *drives[own.number :])
    occam = float(np.log(max(own.fit.scales[k] / own.std[k], 1.0)))
    here = rotor.score(rotor.times) - occam + ODDS + odds(carried)
    fits = [_told(signals, others, carried.with_one(link)) for link in links]
    logs = [f.score(rotor.times) + odds(f.carried) - here for f in fits if f]
    return 1 - float(np.exp(-np.logaddexp.reduce([0.0, *logs])))


def _told(signals: Signals, drives: Drives, carried: Carried) -> MassFit | None:
    """What is carried, at states found with it; none where these run off, or no body is so."""
    first = fitted_mass(Telling(signals, drives, signals.training), carried, clock=False)
    now = replace(signals.recording, carried=first.carried)
    if not first.real or (there := states_by(now, drives)) is None:
        return None
    return fitted_mass(Telling(there, drives, there.training), first.carried, clock=False)


def _shared(joint: JointFindings, p: float) -> JointFindings:
    """The same, the link having so much of the rotor's probability."""
    whole = joint.probability[ROTOR]
    return replace(
        joint,
        probability={**joint.probability, ROTOR: (1 - p) * whole},
        instead={**joint.instead, ROTOR: {**joint.instead[ROTOR], LINK: p * whole}},
        mechanisms={**joint.mechanisms, ROTOR: (1 - p) * joint.mechanisms.get(ROTOR, 0.0),
                    LINK: p * joint.mechanisms.get(ROTOR, 0.0)},
    )  # fmt: skip
