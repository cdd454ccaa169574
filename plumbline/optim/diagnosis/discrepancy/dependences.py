r"""What an unknown effect may depend on, as families of smooth functions at the ports of the chain.

A port is a place where something may give way: a joint, a link's frame, the base, the reading. At
port columns :math:`P` (what one unit there moves) and functions :math:`f_k` of what was recorded,
a dependence spans

.. math:: \delta y_n = \sum_{k,p} w_{kp}\, f_k(\text{row } n)\, P_p(\text{row } n), \qquad
          w_{kp} \sim N(0, s^2)

a Gaussian process in its weights' view (Rasmussen and Williams 2006, sec. 2.1): harmonics of an
angle, cosines and steps of time, polynomials and leading features of several inputs (ibid., sec.
4.3), play operators of a path (Brokate and Sprekels 1996, eq. 2.1.3).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects.joint_tilt import across, upright
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import UNMOVED
from plumbline.optim.diagnosis.discrepancy.body_dependences import body_dependences
from plumbline.optim.diagnosis.discrepancy.dependence import (
    Dependence,
    acting,
    each_joint,
    levelled,
    of_joint,
    one_of,
)
from plumbline.optim.diagnosis.discrepancy.functions import (
    as_angles,
    cosines,
    jumps,
    level,
    loads,
    local,
    memories,
    nearness,
    normal,
    plays,
    turns,
    waves,
    weights,
)
from plumbline.optim.diagnosis.discrepancy.part_dependences import part_dependences
from plumbline.optim.diagnosis.discrepancy.torque_dependences import torque_functions
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording


def dependences(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """All that an unknown effect may depend on, given what the recording holds.

    Args:
        recording: N rows.
        ports: Its ports on these rows.
    """
    if recording.kind.efforts:
        for words, on, j, own in torque_functions(recording):
            port = ports.joint[[j]]
            yield from one_of(acting(words, on, "actuation", j + 1, form, port) for form in own)
        return
    if recording.element is not None:
        yield from part_dependences(recording, ports)
    if recording.stand_in:
        return
    yield from body_dependences(recording, ports)
    yield from _of_angles(recording, ports)
    yield from _of_load(recording, ports)
    yield from _of_mounting(recording, ports)
    yield from _of_payload(recording, ports)
    yield from _of_motion(recording, ports)


def _of_angles(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every joint as it turns: about its axis, and the axis itself (ISO 230-7:2015, sec. 3.2).

    About the axis about their means: with a constant, one term would stand for a zero and an
    eccentric wheel. An axis that runs out stands askew on the mean of a way too, which is nothing
    more at work. What the library has left out may be as it would have it.
    """
    q = as_angles(recording)
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on joint {j + 1}'s angle"
        few = [turns(q[:, j], count, constant=False) for count in (1, 2)]
        few = levelled([*few, level(nearness(q[:, j], prior.REACHES[1]))])
        forms = [turns(q[:, j], prior.TURNS, constant=False)]
        forms += [level(nearness(q[:, j], reach)) for reach in prior.REACHES]
        plain = [np.ones((1, len(q))), q[:, [j]].T / np.pi, turns(q[:, j], 1, constant=True)[1:]]
        yield from one_of(*(of_joint(words, "own angle", j, k, port[None]) for k in (forms, plain)))
        at_one = local(q[:, j], prior.REACHES[0])
        yield from one_of(
            of_joint(f"{words}, locally", "own angle, locally", j, at_one, port[None])
        )
        words, on = f"joint {j + 1}'s axis runs out as it turns", "own angle, across the axis"
        for link in ports.link[j : j + 1]:
            ways = _across(recording.chain.joints[j].axis, link)
            yield from one_of(*(of_joint(words, on, j, few, way) for way in ways))
    for j, port in enumerate(ports.joint):
        others = [k for k in range(len(ports.joint)) if k != j]
        yield from one_of(f for k in others for f in _of_another(q[:, k], j, k, port))
        yield from one_of(f for k in others for f in _of_two(q[:, [j, k]], j, k, port))


def _across(axis: Array, link: Array) -> tuple[Array, Array, Array]:
    """Error motions of an axis at its link's port (6, N, m): tilts, across, along it (p, N, m)."""
    shifts, turned = np.split(link, 2)
    tilts, radial = (np.einsum("kp,knm->pnm", across(axis), some) for some in (turned, shifts))
    return tilts, radial, np.tensordot(axis[None], shifts, 1)


def _of_another(angle: Array, j: int, k: int, port: Array) -> list[Dependence]:
    """Harmonics of joint k's angle as an error of joint j; with a constant where its zero is."""
    words = f"joint {j + 1}'s error depends on joint {k + 1}'s angle"
    forms = [turns(angle, count, constant=False) for count in (1, prior.TURNS)]
    forms = [*levelled(forms), angle[None] / np.pi]  # as what the library has left out would be
    return of_joint(words, "another joint's angle", j, forms, port[None])


def _of_two(angles: Array, j: int, k: int, port: Array) -> list[Dependence]:
    """Waves of joint j's own angle and joint k's, as where two wheels mesh; constant or not."""
    words = f"joint {j + 1}'s error depends on its own and joint {k + 1}'s angle"
    forms = levelled(waves(angles))
    return of_joint(words, "two angles", j, forms, port[None])


def _of_load(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every joint about its axis, and that itself, as what is carried bears on it."""
    load, borne, axes = loads(recording), weights(recording), recording.chain.joints
    for j, port in enumerate(ports.joint):
        words, any_way, plain = f"joint {j + 1}'s error depends on its load", [], []
        if bends := np.ptp(load[:, j]) > UNMOVED:
            share = load[:, j] / np.abs(load[:, j]).max()
            stiffens = np.tanh(share / prior.REACHES[1])
            forms = np.stack([share, stiffens, np.sign(share), np.abs(share)])
            any_way = of_joint(words, "load", j, [cosines(load[:, j], 4)], port[None])
            plain = of_joint(words, "load", j, forms[np.ptp(forms, axis=1) > 0.0, None], port[None])
        moment = across(axes[j].axis).T @ borne[j, 1]
        # A first axis that stands upright tilts as the base does.
        if len(ports.link) and np.ptp(moment) > UNMOVED and not upright(recording.chain, j + 1):
            words, moment = f"joint {j + 1}'s axis gives way to its load", moment / np.ptp(moment)
            tilts = _across(axes[j].axis, ports.link[j])[0]
            any_way += of_joint(words, "load", j, [moment], tilts)
            alike = np.einsum("pn,pnm->nm", moment, tilts)[None]
            plain += of_joint(words, "load", j, [np.ones((1, len(load)))], alike)
        yield from one_of(any_way, plain)
        if bends:
            words = f"joint {j + 1}'s error depends on its angle and its load"
            around = turns(as_angles(recording)[:, j], 2, constant=True)
            both = around * normal(load[:, [j]]).T
            on = "own angle and load"
            functions = level(np.concatenate([around[1:], both]))
            yield acting(words, on, "joint", j + 1, functions, port[None])
    if np.abs(load).max() > UNMOVED:
        shares = load / np.abs(load).max()
        yield from one_of(each_joint("the loads of the joints", "load", shares, ports.joint))


def _of_mounting(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Loads of the joints under gravity from a side: that the arm is on a wall may be unsaid."""
    down = np.abs(recording.chain.gravity)
    sides = (axis for axis in np.eye(3) if 2.0 * (down @ axis) < down.max())
    load = [own for axis in sides if np.abs(own := loads(recording, axis)).max() > UNMOVED]
    load, on = [own / np.abs(own).max() for own in load], "load, mounted otherwise"
    other = "in another mounting than [robot] gravity states"
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on its load {other}"
        yield from one_of(of_joint(words, on, j, [own[None, :, j] for own in load], port[None]))
    words = f"the loads of the joints {other}"
    yield from one_of(f for own in load for f in each_joint(words, on, own, ports.joint))


def _of_payload(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """What is carried, joint by joint, apart from the torque that it makes."""
    if recording.payload is None or np.ptp(recording.payload) < UNMOVED:
        return
    carried = normal(recording.payload[:, None]).T
    forms = levelled([carried, np.concatenate([carried, carried**2])])
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on the payload"
        yield from one_of(of_joint(words, "payload", j, forms, port[None]))


def _of_motion(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Sides of approach, speeds and the path so far, joint by joint and of all joints."""
    whole, place = recording.path
    step = np.sign(np.diff(whole.q, axis=0, prepend=whole.q[:1])).T[:, place]
    side = np.zeros_like(recording.q) if recording.direction is None else recording.direction
    sides = np.concatenate([step, side.T[side.any(axis=0)]])
    for j, port in enumerate(ports.joint):
        functions = np.concatenate([sides, plays(whole.q[:, j])[:, place]])
        words = f"joint {j + 1}'s error depends on the way it came"
        kinds = [functions], functions[:, None]
        yield from one_of(*(of_joint(words, "direction", j, kind, port[None]) for kind in kinds))
    order = place.astype(float)
    # Along one motion whatever is smooth in time looks like a memory; without a clock nobody says
    # that the rows stand in the order in which they were taken.
    still = recording.time is not None and not scope_of(recording).moving
    for j, port in enumerate(ports.joint if still else []):
        words = f"joint {j + 1}'s error depends on what went before"
        functions = memories(recording.q[:, [j]], order, prior.FORMS)
        yield acting(words, "history", "joint", j + 1, functions, port[None])
        once = jumps(order)[:, None]
        yield from one_of(
            of_joint(f"joint {j + 1}'s zero jumped once", "moment", j, once, port[None])
        )
    if side.any():
        yield from one_of(each_joint("the side of approach", "direction", side, ports.joint))
        for j, port in enumerate(ports.joint):
            words = f"joint {j + 1}'s error depends on its angle and the side of approach"
            on = "own angle and direction"
            sided = turns(as_angles(recording)[:, j], 2, constant=True) * side[:, j]
            if side[:, j].any():
                yield acting(words, on, "joint", j + 1, sided, port[None])
    if recording.velocity is not None and recording.velocity.any():
        speed = recording.velocity / np.abs(recording.velocity).max()
        own, *alike = each_joint("the speed of the joints", "velocity", speed, ports.joint)
        yield own
        yield from (replace(f, stage="sensor") for f in alike)  # as what reads late would
        for j, port in enumerate(ports.joint):
            v = speed[:, j]
            functions = np.stack([v, np.abs(v), np.sign(v), v * np.abs(v)])
            words = f"joint {j + 1}'s error depends on its speed"
            yield acting(words, "velocity", "joint", j + 1, functions, port[None])
