"""What of the unlisted is listed already: an effect's own column is no further mechanism."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.sensor_scale import SensorScale
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence
from plumbline.optim.diagnosis.linearise.linear import orthonormal
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.prior import SAME_FORM, SWALLOWED


def not_listed(pool: Pool, ports: Ports, found: Sequence[Dependence]) -> list[Dependence]:
    """Without what a listed effect is, or it and the device's scale; other forms have its share.

    Of an effect that is physical on one side alone the other side is listed nowhere, and stays.
    What all joints do is no further mechanism either where each joint's share in it is listed: two
    drives that are equally soft are two soft drives.
    """
    flat = ports.base.reshape(len(ports.base), ports.target.size)
    nuisances = orthonormal(flat[: pool.always].T)

    def left(columns: Array) -> Array:
        return columns - (columns @ nuisances) @ nuisances.T

    scale = left(scale_of(pool, ports).reshape(1, -1))
    listed: dict[tuple[str, int | None, str], list[tuple[int, Array, Array]]] = {}
    alike: dict[tuple[str, str, str], list[tuple[Array, Array]]] = {}
    for c in pool.candidates:
        stage, element, on = str(c.effect.stage), c.effect.element, c.effect.depends_on
        own, (lower, upper) = left(flat[c.columns]), c.limits.T
        way = ((lower == 0.0).astype(float) - (upper == 0.0)) @ own * (len(own) == 1)
        span = orthonormal(np.concatenate([own, scale]).T)
        listed.setdefault((stage, element, on), []).append((len(own), span, way))
        if element is not None and len(own) == 1:
            alike.setdefault((stage, on, c.effect.name), []).append((own[0], way))
    for (stage, on, _), each in alike.items():
        columns, ways = (np.stack(some) for some in zip(*each, strict=True))
        one = len(columns), orthonormal(columns.T), ways.sum(axis=0)
        listed.setdefault((stage, None, on), []).append(one)
    kept, gone = [], Counter[tuple[str, int | None, str]]()
    for f in found:
        key, k = (f.stage, f.element, f.on), len(f.columns)
        near = [one for one in listed.get(key, []) if k <= one[1].shape[1]]
        own = left(f.columns.reshape(k, -1)) if near else np.empty(0)
        same = [way for n, span, way in near if _is_within(own, span, further=n > k)]
        rest = _other_side(f, own, same)
        kept += rest
        gone[key] += np.exp(f.log_prior) - sum(np.exp(r.log_prior) for r in rest)
    keys = [(f.stage, f.element, f.on) for f in kept]
    of = [float(np.log1p(-gone[key])) for key in keys]
    pairs = zip(kept, of, strict=True)
    return [replace(f, log_prior=f.log_prior - log) if log else f for f, log in pairs]


def _is_within(own: Array, span: Array, *, further: bool) -> bool:
    """Whether columns (k, t) are in a span (t, r), up to their form.

    Of more numbers an effect may come near to much that it is not.
    """
    size, within = np.sum(own**2), own @ span
    if size - np.sum(within**2) > 2.0 * SAME_FORM**2 * size:
        return False  # by far, which costs next to nothing
    least = SWALLOWED if further else SAME_FORM
    return bool(np.linalg.norm(own - within @ span.T) <= least * np.linalg.norm(own))


def _other_side(f: Dependence, own: Array, same: list[Array]) -> list[Dependence]:
    """What is left of a form that effects are, given the ways (t,) they may go; 0 if any."""
    if not same:
        return [f]
    sides = {float(np.sign(own[0] @ way)) for way in same}
    if len(own) > 1 or len(sides) > 1 or 0.0 in sides:
        return []
    other = (-np.inf, 0.0) if sides.pop() > 0.0 else (0.0, np.inf)
    return [replace(f, limits=(other,), log_prior=f.log_prior - float(np.log(2.0)))]


def scale_of(pool: Pool, ports: Ports) -> Array:
    """What the device's scale does (N, m), nothing if that is not listed."""
    own = [c.columns for c in pool.candidates if c.effect.name == SensorScale.name]
    nothing = np.zeros(ports.target.shape)
    return next((ports.base[at[0]] for at in own if len(at) == 1), nothing)


def listed_at(pool: Pool, ports: Ports, effect: Effect) -> Array:
    """What listed effects at an effect's place do, and the device's scale (s, N, m).

    Of those that are scanned over a number, such as ripples of all orders, there is no end.
    """
    place = (effect.stage, effect.element)
    there = (c for c in pool.candidates if (c.effect.stage, c.effect.element) == place)
    own = [ports.base[c.columns] for c in there if not c.effect.scanned]
    return np.concatenate([scale_of(pool, ports)[None], *own])
