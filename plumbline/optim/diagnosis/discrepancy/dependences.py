r"""What an unknown effect may depend on, as families of smooth functions at the ports of the chain.

A port is a place where something may give way: a joint, a link's frame, the base, the reading. At
port columns :math:`P` (what one unit there moves) and functions :math:`f_k` of what was recorded,
a dependence spans

.. math:: \delta y_n = \sum_{k,p} w_{kp}\, f_k(\text{row } n)\, P_p(\text{row } n), \qquad
          w_{kp} \sim N(0, s^2)

a Gaussian process in its weights' view (Rasmussen and Williams 2006, sec. 2.1): harmonics of an
angle, cosines and steps of time, polynomials and random Fourier features of several inputs (Rahimi
and Recht 2007), play operators of a path (Brokate and Sprekels 1996, eq. 2.1.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects.joint_tilt import across, upright
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import UNMOVED
from plumbline.optim.diagnosis.discrepancy.functions import (
    as_angles,
    cosines,
    courses,
    jumps,
    level,
    loads,
    memories,
    nearness,
    normal,
    plays,
    polynomials,
    random_features,
    spots,
    steps,
    turns,
    waves,
    weights,
)
from plumbline.optim.diagnosis.discrepancy.part_dependences import part_functions
from plumbline.optim.diagnosis.discrepancy.torque_dependences import torque_functions
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.constants import NO_SOCKET
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Dependence:
    """A family of smooth functions, as columns (k, N, m) in units of the usual size.

    Attributes:
        words: On what the error depends, as the verdict says it.
        on: The same in a word or two: ``"own angle"``, ``"load"``, ``"time"``.
        stage: Where it would sit.
        element: Joint or link, from 1, or None.
        columns: Its columns.
        log_prior: Log share among the forms of one dependence; where the data have chosen it from
            many, of these.
        sides: Sign that each column's number has, 0 where either; empty where all may be either.
    """

    words: str
    on: str
    stage: str
    element: int | None
    columns: Array
    log_prior: float = 0.0
    sides: tuple[float, ...] = ()


def dependences(recording: Recording, ports: Ports, seed: int) -> Iterator[Dependence]:
    """All that an unknown effect may depend on, given what the recording holds.

    Args:
        recording: N rows.
        ports: Its ports on these rows.
        seed: Of the random features.
    """
    if recording.kind.efforts:
        for words, on, j, own in torque_functions(recording):
            port = ports.joint[[j]]
            yield from _one_of(_at(words, on, "actuation", j + 1, form, port) for form in own)
        return
    rng = np.random.default_rng(seed)
    if recording.element is not None:
        for o in part_functions(recording, rng):
            forms = (_at(o.words, o.on, o.stage, o.element, f, ports.shift) for f in o.forms)
            yield from _one_of(forms)
    if recording.stand_in:
        return
    kind = recording.kind
    if not (kind.encoders or kind.sockets or kind.ranges):
        yield from _of_place(recording, ports, rng)
    if not kind.encoders:
        posture = random_features(normal(recording.q), prior.REACHES[-1], rng)
        yield _at("the posture", "posture", "link", None, posture, ports.shift)
        yield from _of_links(recording, ports)
        yield from _of_time(recording, ports)
        yield from _of_base_load(recording, ports)
    yield from _of_angles(recording, ports)
    yield from _of_load(recording, ports)
    yield from _of_mounting(recording, ports)
    yield from _of_payload(recording, ports)
    yield from _of_motion(recording, ports)


def _of_place(recording: Recording, ports: Ports, rng: np.random.Generator) -> Iterator[Dependence]:
    """The tip's place, as a whole and around one spot.

    Not of a tip that rests in sockets: there the place holds the very error that is looked for.
    """
    place = recording.chain.placement(recording.q)[:, :3, 3]
    words, on = "the place of the tip, locally", "place, locally"
    local = [random_features(normal(place), prior.REACHES[0], rng)]
    local += [form for bump in spots(place) for form in (bump[:1], bump)]
    yield from _one_of(_at(words, on, "sensor", None, form, ports.shift) for form in local)
    forms = [(polynomials(normal(place), degree), ports.shift) for degree in (1, 2, 3)]
    forms.append((np.ones((1, len(place))), _grown(place, ports)))
    words = "the place of the tip"
    yield from _one_of(_at(words, "place", "sensor", None, *form) for form in forms)


def _grown(place: Array, ports: Ports) -> Array:
    """What a like growth of all lengths to the places (N, 3) [m] moves (1, N, m)."""
    return np.einsum("nk,knm->nm", place, ports.body[:3])[None]


def _of_links(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every link's place in its joint as it gives way to gravity.

    Where it is as such is no unlisted mechanism: joint offsets and the link's geometry are that,
    and one term with a constant would stand for several. So all are about their means. What sits
    on the last one moves as that does: a tool in its seat.
    """
    last = len(ports.link) - 1
    for i, (port, (weight, _)) in enumerate(zip(ports.link, weights(recording), strict=True)):
        words = f"the shape of link {i + 1}, or its weight"
        words = f"how the tool sits, or {words}" if i == last else words
        stage, element = ("tool", None) if i == last else ("link", i + 1)
        if np.ptp(weight, axis=1).max() > UNMOVED:  # about upright axes it is as if it was still
            yield _at(words, "load", stage, element, level(weight), port)


def _of_time(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Whatever changes with the clock or the temperature: base, reading, links and joints."""
    time, temperature = recording.time, recording.temperature
    if time is not None and np.ptp(time) > 0:
        functions = np.concatenate([cosines(time, prior.COSINES), steps(time, prior.STEPS)])
        yield _at("time", "time", "base", None, functions, ports.body)
        yield _at("time", "time", "sensor", None, functions, ports.shift)
        yield from _each_part(ports, time, "time", functions)
    if temperature is not None and np.ptp(temperature) > 0:
        place, on = _true_places(recording), "temperature"
        spread = np.concatenate([np.ones((1, len(place))), normal(place).T])
        rise = np.stack([np.ones(len(place)), normal(temperature)])
        grown = [warmth[:, None] * spread for warmth in (rise, cosines(temperature, prior.WARMTH))]
        forms = [(form.reshape(-1, len(place)), ports.shift) for form in grown]
        forms += [(form, _grown(place, ports)) for form in (rise[1:], rise)]
        yield from _one_of(_at(on, on, "link", None, *form) for form in forms)
        yield from _each_part(ports, temperature, on, cosines(temperature, prior.WARMTH))


def _each_part(ports: Ports, values: Array, on: str, functions: Array) -> Iterator[Dependence]:
    """Each joint and each link on its own, as it changes with time or temperature."""
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on {on}"
        kinds = (functions, functions[:1]), _levelled(courses(values))
        yield from _one_of(*(_kind(words, on, j, forms, port[None]) for forms in kinds))
    for i, port in enumerate(ports.link):
        words = f"the place of link {i + 1} depends on {on}"
        yield _at(words, on, "link", i + 1, cosines(values, prior.WARMTH), port)


def _true_places(recording: Recording) -> Array:
    """The tip's places (N, 3) [m]; of a tip in sockets the sockets', which hold no error."""
    place = recording.chain.placement(recording.q)[:, :3, 3]
    if recording.socket is None:
        return place
    _, which = np.unique(recording.socket, return_inverse=True)
    mean = np.stack([np.bincount(which, x) for x in place.T], axis=1)
    rests = (recording.socket != NO_SOCKET)[:, None]  # all do, but of several recordings
    return np.where(rests, (mean / np.bincount(which)[:, None])[which], place)


def _of_base_load(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """The base, as it gives way to what the arm's weight and posture do to it."""
    load = loads(recording)
    first = load[:, : min(2, load.shape[1])]
    if np.ptp(first, axis=0).max(initial=0.0) <= UNMOVED or not len(ports.body):
        return
    q1 = recording.q[:, :1]
    around = np.concatenate([np.cos(q1), np.sin(q1)], axis=1)
    moment = normal(first[:, -1:])
    tilting = np.concatenate([moment, moment * around, around], axis=1).T
    squared = np.concatenate([tilting, tilting[:1] ** 2])
    words = "the load on the base"
    forms = [tilting, squared]
    yield from _one_of(_at(words, "load", "base", None, form, ports.body) for form in forms)


def _of_angles(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every joint as it turns: about its axis, and the axis itself (ISO 230-7:2015, sec. 3.2).

    About the axis about their means: with a constant, one term would stand for a zero and an
    eccentric wheel. An axis that runs out stands askew on the mean of a way too, which is nothing
    more at work. What the library has left out may be as it would have it.
    """
    q = as_angles(recording)
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on joint {j + 1}'s angle"
        few = _levelled(turns(q[:, j], count, constant=False) for count in (1, 2))
        forms = [turns(q[:, j], prior.TURNS, constant=False)]
        forms += [level(nearness(q[:, j], reach)) for reach in prior.REACHES]
        plain = [np.ones((1, len(q))), q[:, [j]].T / np.pi, turns(q[:, j], 1, constant=True)[1:]]
        yield from _one_of(*(_kind(words, "own angle", j, k, port[None]) for k in (forms, plain)))
        words, on = f"joint {j + 1}'s axis runs out as it turns", "own angle, across the axis"
        for link in ports.link[j : j + 1]:
            ways = _across(recording.chain.joints[j].axis, link)
            yield from _one_of(*(_kind(words, on, j, few, way) for way in ways))
    for j, port in enumerate(ports.joint):
        others = [k for k in range(len(ports.joint)) if k != j]
        yield from _one_of(f for k in others for f in _of_another(q[:, k], j, k, port))
        yield from _one_of(f for k in others for f in _of_two(q[:, [j, k]], j, k, port))


def _across(axis: Array, link: Array) -> tuple[Array, Array, Array]:
    """Error motions of an axis at its link's port (6, N, m): tilts, across, along it (p, N, m)."""
    shifts, turned = np.split(link, 2)
    tilts, radial = (np.einsum("kp,knm->pnm", across(axis), some) for some in (turned, shifts))
    return tilts, radial, np.tensordot(axis[None], shifts, 1)


def _of_another(angle: Array, j: int, k: int, port: Array) -> list[Dependence]:
    """Harmonics of joint k's angle as an error of joint j; with a constant where its zero is."""
    words = f"joint {j + 1}'s error depends on joint {k + 1}'s angle"
    forms = _levelled(turns(angle, count, constant=False) for count in (1, prior.TURNS))
    return _kind(words, "another joint's angle", j, forms, port[None])


def _of_two(angles: Array, j: int, k: int, port: Array) -> list[Dependence]:
    """Waves of joint j's own angle and joint k's, as where two wheels mesh; constant or not."""
    words = f"joint {j + 1}'s error depends on its own and joint {k + 1}'s angle"
    forms = _levelled(waves(angles))
    return _kind(words, "two angles", j, forms, port[None])


def _levelled(forms: Iterable[Array]) -> list[Array]:
    """Each form (K, N) as it is, and with a constant."""
    both = ((form, np.concatenate([np.ones((1, form.shape[1])), form])) for form in forms)
    return [one for pair in both for one in pair]


def _of_load(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every joint about its axis, and that itself, as what is carried bears on it."""
    load, borne, axes = loads(recording), weights(recording), recording.chain.joints
    for j, port in enumerate(ports.joint):
        words, any_way, plain = f"joint {j + 1}'s error depends on its load", [], []
        if bends := np.ptp(load[:, j]) > UNMOVED:
            share = load[:, j] / np.abs(load).max()
            forms = np.stack([share, np.sign(share), np.abs(share), share**2])
            any_way = _kind(words, "load", j, [cosines(load[:, j], 4)], port[None])
            plain = _kind(words, "load", j, forms[np.ptp(forms, axis=1) > 0.0, None], port[None])
        moment = across(axes[j].axis).T @ borne[j, 1]
        # A first axis that stands upright tilts as the base does.
        if len(ports.link) and np.ptp(moment) > UNMOVED and not upright(recording.chain, j + 1):
            words, moment = f"joint {j + 1}'s axis gives way to its load", moment / np.ptp(moment)
            tilts = _across(axes[j].axis, ports.link[j])[0]
            any_way += _kind(words, "load", j, [moment], tilts)
            alike = np.einsum("pn,pnm->nm", moment, tilts)[None]
            plain += _kind(words, "load", j, [np.ones((1, len(load)))], alike)
        yield from _one_of(any_way, plain)
        if bends:
            words = f"joint {j + 1}'s error depends on its angle and its load"
            around = turns(as_angles(recording)[:, j], 2, constant=True)
            both = around * normal(load[:, [j]]).T
            on = "own angle and load"
            yield _at(words, on, "joint", j + 1, np.concatenate([around, both]), port[None])
    if np.abs(load).max() > UNMOVED:
        shares = load / np.abs(load).max()
        yield _each("the loads of the joints", "load", shares, ports.joint)


def _of_mounting(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Loads of the joints under gravity from a side: that the arm is on a wall may be unsaid."""
    down = np.abs(recording.chain.gravity)
    sides = (axis for axis in np.eye(3) if 2.0 * (down @ axis) < down.max())
    load = [own for axis in sides if np.abs(own := loads(recording, axis)).max() > UNMOVED]
    load, on = [own / np.abs(own).max() for own in load], "load, mounted otherwise"
    other = "in another mounting than [robot] gravity states"
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on its load {other}"
        yield from _one_of(_kind(words, on, j, [own[None, :, j] for own in load], port[None]))
    words = f"the loads of the joints {other}"
    yield from _one_of(_each(words, on, own, ports.joint) for own in load)


def _of_payload(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """What is carried, joint by joint, apart from the torque that it makes."""
    if recording.payload is None or np.ptp(recording.payload) < UNMOVED:
        return
    carried = normal(recording.payload[:, None]).T
    forms = _levelled([carried, np.concatenate([carried, carried**2])])
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on the payload"
        yield from _one_of(_kind(words, "payload", j, forms, port[None]))


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
        yield from _one_of(*(_kind(words, "direction", j, kind, port[None]) for kind in kinds))
    order = place.astype(float)
    # Along one motion whatever is smooth in time looks like a memory; without a clock nobody says
    # that the rows stand in the order in which they were taken.
    still = recording.time is not None and not scope_of(recording).moving
    for j, port in enumerate(ports.joint if still else []):
        words = f"joint {j + 1}'s error depends on what went before"
        functions = memories(recording.q[:, [j]], order, prior.JUMPS)
        yield _at(words, "history", "joint", j + 1, functions, port[None])
        once = jumps(order)[:, None]
        yield from _one_of(
            _kind(f"joint {j + 1}'s zero jumped once", "moment", j, once, port[None])
        )
    if side.any():
        yield _each("the side of approach", "direction", side, ports.joint)
        for j, port in enumerate(ports.joint):
            words = f"joint {j + 1}'s error depends on its angle and the side of approach"
            on = "own angle and direction"
            sided = turns(as_angles(recording)[:, j], 2, constant=True) * side[:, j]
            if side[:, j].any():
                yield _at(words, on, "joint", j + 1, sided, port[None])
    if recording.velocity is not None and recording.velocity.any():
        speed = recording.velocity / np.abs(recording.velocity).max()
        yield _each("the speed of the joints", "velocity", speed, ports.joint)
        for j, port in enumerate(ports.joint):
            v = speed[:, j]
            functions = np.stack([v, np.abs(v), np.sign(v), v * np.abs(v)])
            words = f"joint {j + 1}'s error depends on its speed"
            yield _at(words, "velocity", "joint", j + 1, functions, port[None])


def _one_of(*kinds: Iterable[Dependence]) -> Iterator[Dependence]:
    """Forms of one dependence, which share its odds: kinds of them alike, then the forms of each.

    Beside what may be anything stands what is as simple as a listed effect: the price of a freedom
    that it does not use (MacKay 1992) would else hide it behind a listed effect of another place.
    """
    for forms in (groups := [forms for kind in kinds if (forms := list(kind))]):
        share = -float(np.log(len(forms) * len(groups)))
        yield from (replace(f, log_prior=share) for f in forms)


def _kind(words: str, on: str, j: int, forms: Iterable[Array], ports: Array) -> list[Dependence]:
    """Forms (K, N) of one dependence of the joint j, from 0."""
    return [_at(words, on, "joint", j + 1, form, ports) for form in forms]


def _at(
    words: str, on: str, stage: str, element: int | None, functions: Array, ports: Array
) -> Dependence:
    """Every function (K, N) acting on every port (p, N, m)."""
    columns = prior.USUAL * (functions[:, None, :, None] * ports[None])
    flat = columns.reshape(-1, *ports.shape[1:])
    return Dependence(words, on, stage, element, leading(flat))


def _each(words: str, on: str, values: Array, ports: Array) -> Dependence:
    """Every joint's own value (N, n) acting on its own port (n, N, m)."""
    return Dependence(words, on, "joint", None, prior.USUAL * values.T[:, :, None] * ports)


def leading(columns: Array) -> Array:
    """The same process (k, N, m) in fewer columns: those of its covariance that matter."""
    if len(columns) <= prior.FULLEST:
        return columns
    flat = columns.reshape(len(columns), -1)
    vectors = np.linalg.eigh(flat @ flat.T)[1]
    return np.asarray(
        (vectors[:, -prior.FULLEST :].T @ flat).reshape(prior.FULLEST, *columns.shape[1:])
    )
