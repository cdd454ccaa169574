"""What of the unlisted is listed already: an effect's own column is no further mechanism."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence
from plumbline.optim.diagnosis.linearise.linear import orthonormal
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.prior import SWALLOWED


def not_listed(pool: Pool, ports: Ports, found: Sequence[Dependence]) -> list[Dependence]:
    """Without what an effect of the library is already; its other forms have its share.

    Of an effect that is physical on one side alone the other side is listed nowhere, and stays.
    """
    flat = ports.base.reshape(len(ports.base), ports.target.size)
    nuisances = orthonormal(flat[: pool.always].T)

    def left(columns: Array) -> Array:
        return columns - (columns @ nuisances) @ nuisances.T

    listed: dict[tuple[str, int | None, str], list[tuple[Array, Array]]] = {}
    for c in pool.candidates:
        key, columns = (str(c.effect.stage), c.effect.element, c.effect.depends_on), c.columns
        own, (lower, upper) = left(flat[columns]), c.limits.T
        way = ((lower == 0.0).astype(float) - (upper == 0.0)) @ own
        listed.setdefault(key, []).append((orthonormal(own.T), way))
    kept, gone = [], Counter[tuple[str, int | None, str]]()
    for f in found:
        key, k = (f.stage, f.element, f.on), len(f.columns)
        near = [(span, way) for span, way in listed.get(key, []) if k <= span.shape[1]]
        own = left(f.columns.reshape(k, -1)) if near else np.empty(0)
        limit = SWALLOWED * np.linalg.norm(own)
        same = [(s, w) for s, w in near if np.linalg.norm(own - (own @ s) @ s.T) <= limit]
        rest = _other_side(f, own, same)
        kept += rest
        gone[key] += np.exp(f.log_prior) - sum(np.exp(r.log_prior) for r in rest)
    keys = [(f.stage, f.element, f.on) for f in kept]
    of = [float(np.log1p(-gone[key])) for key in keys]
    return [replace(f, log_prior=f.log_prior - log) for f, log in zip(kept, of, strict=True)]


def _other_side(f: Dependence, own: Array, same: list[tuple[Array, Array]]) -> list[Dependence]:
    """What is left of a form that effects are, given their spans and the ways (t,) they may go."""
    if not same:
        return [f]
    sides = {float(np.sign(own[0] @ way)) if span.shape[1] == 1 else 0.0 for span, way in same}
    if len(own) > 1 or len(sides) > 1 or 0.0 in sides:
        return []
    other = (-np.inf, 0.0) if sides.pop() > 0.0 else (0.0, np.inf)
    return [replace(f, limits=(other,), log_prior=f.log_prior - float(np.log(2.0)))]
