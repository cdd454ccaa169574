r"""What an unknown effect of a whole body may depend on: links, the tool, the base, the reading.

Beside what may be anything each has what is as simple as a listed effect: a body that yields in one
measure :math:`c`, a shift along the force and a turn about the moment that it bears,

.. math:: \delta = c_1 F, \qquad \varphi = c_2 M,

and a weight at the tip, or a force on it, that twists all drives in one measure,
:math:`\delta q = c\, \tau`.
"""

from collections.abc import Iterator

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import UNMOVED
from plumbline.optim.diagnosis.discrepancy.dependence import (
    Dependence,
    acting,
    levelled,
    of_joint,
    one_of,
)
from plumbline.optim.diagnosis.discrepancy.functions import (
    bending,
    cosines,
    courses,
    level,
    loads,
    normal,
    on_tip,
    overturning,
    polynomials,
    smooth,
    spots,
    steps,
    weights,
)
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.recording.constants import NO_SOCKET
from plumbline.optim.recording.recording import Recording

Place = tuple[str, int | None]  # stage, and joint or link, from 1
TIP: Place = ("tool", None)
BASE: Place = ("base", None)


def body_dependences(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Of the tip's place and posture, and of every body but a joint's own."""
    kind = recording.kind
    if not (kind.encoders or kind.sockets or kind.ranges):
        yield from _of_place(recording, ports)
    if not kind.encoders:
        posture = smooth(normal(recording.q), prior.REACHES[-1])
        yield acting("the posture", "posture", "link", None, posture, ports.shift)
    yield from _of_links(recording, ports)
    if not kind.encoders:
        yield from _of_time(recording, ports)
        yield from _of_base_load(recording, ports)


def _of_place(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """The tip's place, as a whole and around one spot.

    Not of a tip that rests in sockets: there the place holds the very error that is looked for.
    """
    place = recording.chain.placement(recording.q)[:, :3, 3]
    words, on = "the place of the tip, locally", "place, locally"
    local = [smooth(normal(place), prior.REACHES[0])]
    local += [form for bump in spots(place) for form in (bump[:1], bump)]
    yield from one_of(acting(words, on, "sensor", None, form, ports.shift) for form in local)
    forms = [(polynomials(normal(place), degree), ports.shift) for degree in (1, 2, 3)]
    forms.append((np.ones((1, len(place))), _grown(place, ports)))
    words = "the place of the tip"
    yield from one_of(acting(words, "place", "sensor", None, *form) for form in forms)


def _grown(place: Array, ports: Ports) -> Array:
    """What a like growth of all lengths to the places (N, 3) [m] moves (1, N, m)."""
    return np.einsum("nk,knm->nm", place, ports.body[:3])[None]


def _of_links(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every link's place in its joint as it gives way to gravity.

    Where it is as such is no unlisted mechanism: joint offsets and the link's geometry are that,
    and one term with a constant would stand for several. So all are about their means. What sits
    on the last one moves as that does: a tool in its seat.
    """
    links, tool = len(ports.link), list(_of_tip(recording, ports))
    bent = bending(recording) if links else np.empty(0)
    for i, (port, (weight, _)) in enumerate(zip(ports.link, weights(recording), strict=False)):
        words = f"the shape of link {i + 1}, or its weight"
        at: Place = ("link", i + 1) if i + 1 < links else TIP
        words = f"how the tool sits, or {words}" if at == TIP else words
        any_way, plain = [], tool if at == TIP else []
        if np.ptp(weight, axis=1).max() > UNMOVED:  # about upright axes it is as if it was still
            any_way = [acting(words, "load", *at, level(weight), port)]
        if np.ptp(bent[i], axis=1).max() > UNMOVED:
            plain = [_along(words, at, level(bent[i] / np.abs(bent[i]).max()), port), *plain]
        yield from one_of(any_way, plain)
    if not links:
        yield from one_of(tool)


def _along(words: str, at: Place, functions: Array, ports: Array) -> Dependence:
    """Each function (p, N) acting on its own port (p, N, m), all in one measure."""
    alike = np.einsum("pn,pnm->nm", functions, ports)[None]
    return acting(words, "load", *at, np.ones((1, functions.shape[1])), alike)


def _of_tip(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """What hangs at the tip, or presses on it: in all joints, or as the tool gives way to it."""
    drives = np.array([kind == "revolute" for kind in recording.chain.kinds])
    for words, torque, bent in on_tip(recording):
        torque = torque[drives]
        if np.ptp(torque, axis=1).max(initial=0.0) > UNMOVED:
            yield _along(words, TIP, torque / np.abs(torque).max(), ports.joint[drives])
        if len(ports.link) and np.ptp(bent, axis=1).max() > UNMOVED:
            yield _along(words, TIP, level(bent / np.abs(bent[:3]).max()), ports.link[-1])


def _of_time(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Whatever changes with the clock or the temperature: base, reading, links and joints."""
    time, temperature = recording.time, recording.temperature
    if time is not None and np.ptp(time) > 0:
        functions = np.concatenate([cosines(time, prior.FORMS), steps(time, prior.FORMS)])
        yield acting("time", "time", "base", None, functions, ports.body)
        yield acting("time", "time", "sensor", None, functions, ports.shift)
        yield from _each_part(ports, time, "time", functions)
    if temperature is not None and np.ptp(temperature) > 0:
        place, on = _true_places(recording), "temperature"
        spread = np.concatenate([np.ones((1, len(place))), normal(place).T])
        rise = np.stack([np.ones(len(place)), normal(temperature)])
        grown = [warmth[:, None] * spread for warmth in (rise, cosines(temperature, prior.WARMTH))]
        forms = [(form.reshape(-1, len(place)), ports.shift) for form in grown]
        forms += [(form, _grown(place, ports)) for form in (rise[1:], rise)]
        yield from one_of(acting(on, on, "link", None, *form) for form in forms)
        yield from _each_part(ports, temperature, on, cosines(temperature, prior.WARMTH))


def _each_part(ports: Ports, values: Array, on: str, functions: Array) -> Iterator[Dependence]:
    """Each joint and each link on its own, as it changes with time or temperature."""
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on {on}"
        kinds = (functions, functions[:1]), levelled(courses(values))
        yield from one_of(*(of_joint(words, on, j, forms, port[None]) for forms in kinds))
    for i, port in enumerate(ports.link):
        words = f"the place of link {i + 1} depends on {on}"
        yield acting(words, on, "link", i + 1, cosines(values, prior.WARMTH), port)


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
    any_way = [acting(words, "load", *BASE, form, ports.body) for form in (tilting, squared)]
    moment = overturning(recording)
    tilt = level(moment / np.abs(moment).max())
    each = Dependence(words, "load", *BASE, prior.USUAL * tilt[:, :, None] * ports.body[3:])
    yield from one_of(any_way, [_along(words, BASE, tilt, ports.body[3:]), each])
