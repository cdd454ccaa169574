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
from itertools import product

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.functions import (
    STILL,
    cosines,
    loads,
    normal,
    plays,
    polynomials,
    random_features,
    spots,
    steps,
    turns,
    waves,
    weight_directions,
)
from plumbline.optim.diagnosis.discrepancy.jumps import find_jumps
from plumbline.optim.diagnosis.discrepancy.torque_dependences import torque_functions
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.prior import COSINES, EDGE, JUMPS, STEPS, TURNS, USUAL
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Dependence:
    """A family of smooth functions, as columns (k, N, m) in units of the usual size.

    Attributes:
        words: On what the error depends.
        stage: Where it would sit.
        element: Joint or link, from 1, or None.
        columns: Its columns.
        extends: Effects of the library that it holds in a richer form: evidence for it is none
            against them.
        log_prior: Log share among all of its kind, where the data have chosen it from many.
    """

    words: str
    stage: str
    element: int | None
    columns: Array
    extends: frozenset[Key] = frozenset()
    log_prior: float = 0.0


def dependences(
    recording: Recording, ports: Ports, noise: NoisePrior, seed: int
) -> Iterator[Dependence]:
    """All that an unknown effect may depend on, given what the recording holds.

    Args:
        recording: N rows.
        ports: Its ports on these rows.
        noise: The prior of the noise.
        seed: Of the random features.
    """
    if recording.observation == "joint_torque":
        for words, j, functions, same in torque_functions(recording):
            yield _at(words, "joint", j + 1, functions, ports.joint[[j]], same)
        return
    rng = np.random.default_rng(seed)
    if recording.observation not in ("joint_position", "fixed_point"):
        yield from _of_place(recording, ports, rng)
    if recording.observation != "joint_position":
        posture = random_features(normal(recording.q), 1.5, rng)
        yield _at("the posture", "link", None, posture, ports.shift)
        yield from _of_links(recording, ports)
        yield from _of_time(recording, ports)
    yield from _of_angles(recording, ports)
    yield from _of_load(recording, ports)
    yield from _of_payload(recording, ports)
    yield from _of_motion(recording, ports)
    if not scope_of(recording).moving:
        yield from _of_jumps(recording, ports, noise)


def _of_place(recording: Recording, ports: Ports, rng: np.random.Generator) -> Iterator[Dependence]:
    """The tip's place, as a whole and around one spot.

    Not of a tip that rests in sockets: there the place holds the very error that is looked for.
    """
    place = recording.chain.placement(recording.q)[:, :3, 3]
    words = "the place of the tip, locally"
    local = random_features(normal(place), 0.35, rng)
    yield _at(words, "sensor", None, local, ports.shift)
    forms = [form for bump in spots(place) for form in (bump[:1], bump)]
    yield from _one_of(_at(words, "sensor", None, form, ports.shift) for form in forms)
    forms = [polynomials(normal(place), degree) for degree in (1, 2, 3)]
    words = "the place of the tip"
    yield from _one_of(_at(words, "sensor", None, form, ports.shift) for form in forms)


def _of_links(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Every link's place in its joint, as it is and as it gives way to gravity."""
    weight = weight_directions(recording)
    for i, port in enumerate(ports.link):
        still = np.ones((1, len(recording)))
        forms = [still, weight[i], np.concatenate([still, weight[i]])]
        words = f"the shape of link {i + 1}, or its weight"
        last = i + 1 == len(ports.link)
        same: set[Key] = {("link_geometry", i + 1), ("link_flex", i + 1)}
        if last:
            same.add(("needle_sag", None))
        yield from _one_of(_at(words, "link", i + 1, form, port, same) for form in forms)


def _of_time(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    time, temperature = recording.time, recording.temperature
    if time is not None and np.ptp(time) > 0:
        functions = np.concatenate([cosines(time, COSINES), steps(time, STEPS)])
        yield _at("time", "base", None, functions, ports.body)
    if temperature is not None and np.ptp(temperature) > 0:
        place = normal(_true_places(recording))
        spread = np.concatenate([np.ones((1, len(place))), place.T])
        rise = np.stack([np.ones(len(place)), normal(temperature)])
        grown = [warmth[:, None] * spread for warmth in (rise, cosines(temperature, 3))]
        forms = [form.reshape(-1, len(place)) for form in grown]
        yield from _one_of(_at("temperature", "link", None, form, ports.shift) for form in forms)


def _true_places(recording: Recording) -> Array:
    """The tip's places (N, 3) [m]; of a tip in sockets the sockets', which hold no error."""
    place = recording.chain.placement(recording.q)[:, :3, 3]
    if recording.socket is None:
        return place
    _, which = np.unique(recording.socket, return_inverse=True)
    mean = np.stack([np.bincount(which, x) for x in place.T], axis=1)
    return np.asarray((mean / np.bincount(which)[:, None])[which])


def _of_angles(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    q = recording.q
    for j, port in enumerate(ports.joint):
        for k in range(len(ports.joint)):
            yield from _one_of(_of_one_angle(q[:, k], j, k, port))
    for j, port in enumerate(ports.joint):
        for k in range(len(ports.joint)):
            if k != j:
                words = f"joint {j + 1}'s error depends on its own and joint {k + 1}'s angle"
                tones = waves(q[:, [j, k]])
                yield from _one_of(_at(words, "joint", j + 1, t, port[None]) for t in tones)


def _of_one_angle(angle: Array, j: int, k: int, port: Array) -> Iterator[Dependence]:
    """Harmonics of joint k's angle as an error of joint j, with a constant or without one."""
    words = f"joint {j + 1}'s error depends on joint {k + 1}'s angle"
    levels = (True,) if j == k else (True, False)
    for count, level in product((1, TURNS), levels):
        functions = turns(angle, count, constant=level)
        yield _at(words, "joint", j + 1, functions, port[None], _plain_forms(j, k, count))


def _plain_forms(j: int, k: int, count: int) -> set[Key]:
    """Effects that harmonics of joint k's angle, as an error of joint j, hold in a richer form.

    Over part of a turn one harmonic and a constant are a coupling's straight line, a little bent.
    """
    if j == k:
        return {("transmission_ripple", j + 1), ("joint_offset", j + 1)}
    return {("joint_coupling", j + 1)} if count == 1 else set()


def _of_load(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    load = loads(recording)
    for j, port in enumerate(ports.joint):
        if np.ptp(load[:, j]) > STILL:
            words = f"joint {j + 1}'s error depends on its load, not in proportion"
            same = ("joint_compliance", j + 1)
            yield _at(words, "joint", j + 1, cosines(load[:, j], 4), port[None], {same})
    known: set[Key] = {("joint_compliance", j + 1) for j in range(len(ports.joint))}
    if np.abs(load).max() > STILL:
        shares = load / np.abs(load).max()
        yield _each("the loads of the joints", shares, ports.joint, known | {("payload", None)})


def _of_payload(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """What is carried, joint by joint, apart from the torque that it makes."""
    if recording.payload is None or np.ptp(recording.payload) < STILL:
        return
    carried = normal(recording.payload[:, None]).T
    forms = [carried, np.concatenate([carried, carried**2])]
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on the payload"
        yield from _one_of(_at(words, "joint", j + 1, form, port[None]) for form in forms)


def _of_motion(recording: Recording, ports: Ports) -> Iterator[Dependence]:
    """Sides of approach, speeds and the path so far, joint by joint and of all joints."""
    whole, place = recording.path
    step = np.sign(np.diff(whole.q, axis=0, prepend=whole.q[:1])).T[:, place]
    for j, port in enumerate(ports.joint):
        functions = np.concatenate([step, plays(whole.q[:, j])[:, place]])
        words = f"joint {j + 1}'s error depends on the way it came"
        same = {("backlash", j + 1), ("hysteresis", j + 1)}
        yield _at(words, "joint", j + 1, functions, port[None], same)
    q, order = recording.q, place.astype(float)
    # Along one motion whatever is smooth in time looks like a memory.
    for j, port in enumerate([] if scope_of(recording).moving else ports.joint):
        functions = np.concatenate([normal(q[:, [j]]).T, steps(order, JUMPS)])
        words = f"joint {j + 1}'s error depends on what went before"
        yield _at(words, "joint", j + 1, functions, port[None])
    if recording.direction is not None and recording.direction.any():
        same = {("backlash", j + 1) for j in range(len(ports.joint))}
        yield _each("the side of approach", recording.direction, ports.joint, same)
    if recording.velocity is not None and recording.velocity.any():
        speed = recording.velocity / np.abs(recording.velocity).max()
        yield _each("the speed of the joints", speed, ports.joint)
        for j, port in enumerate(ports.joint):
            v = speed[:, j]
            functions = np.stack([v, np.abs(v), np.sign(v), v * np.abs(v)])
            words = f"joint {j + 1}'s error depends on its speed"
            yield _at(words, "joint", j + 1, functions, port[None])


def _of_jumps(recording: Recording, ports: Ports, noise: NoisePrior) -> Iterator[Dependence]:
    """Joints whose error jumps at some readings and follows the angle in between."""
    at = np.arange(len(recording))
    if len(at) < 2 * EDGE:
        return
    # A step that parts but the first or last rows from the others is an offset of those others.
    after = np.where(at > at[EDGE - 1 : -EDGE, None], 0.5, -0.5)
    target, shifts = ports.target.ravel(), ports.own_shifts()
    nuisances = ports.base[: ports.always].reshape(ports.always, target.size)
    rows = shifts.reshape(*shifts.shape[:2], target.size)
    for j, port in enumerate(ports.joint):
        words = f"joint {j + 1}'s error depends on what went before"
        own = _at(words, "joint", j + 1, normal(recording.q[:, [j]]).T, port[None])
        each = _at(words, "joint", j + 1, after, port[None])
        angle, moments = (d.columns.reshape(len(d.columns), -1) for d in (own, each))
        found = find_jumps(angle, moments, rows, target, nuisances, noise)
        if found.steps:
            mine = shifts[found.rows].reshape(-1, *port.shape)
            columns = np.concatenate([own.columns, each.columns[found.steps], mine])
            yield replace(own, columns=columns, log_prior=found.log_share)


def _one_of(found: Iterable[Dependence]) -> Iterator[Dependence]:
    """Forms of one dependence, which share its odds."""
    forms = list(found)
    yield from (replace(f, log_prior=-np.log(len(forms))) for f in forms)


def _at(
    words: str,
    stage: str,
    element: int | None,
    functions: Array,
    ports: Array,
    extends: Iterable[Key] = (),
) -> Dependence:
    """Every function (K, N) acting on every port (p, N, m)."""
    columns = USUAL * (functions[:, None, :, None] * ports[None])
    flat = columns.reshape(-1, *ports.shape[1:])
    return Dependence(words, stage, element, flat, frozenset(extends))


def _each(words: str, values: Array, ports: Array, extends: Iterable[Key] = ()) -> Dependence:
    """Every joint's own value (N, n) acting on its own port (n, N, m)."""
    columns = USUAL * values.T[:, :, None] * ports
    return Dependence(words, "joint", None, columns, frozenset(extends))
