r"""Which effects of the library a joint's drive has: a search, and the posterior over what it saw.

Effects go in one by one while the evidence grows; then every neighbour of where that ends (one
effect less, one more, one exchanged) is fitted too, and the search moves on if one is better. With
prior odds p a cause, the probability of a cause is the share of the models that have it,

.. math:: P(c) = \frac{\sum_{m \ni c} Z_m p^{|m|}}{\sum_m Z_m p^{|m|}},

among them models in which a function that nobody has listed stands in its place. So two effects
that a recording cannot tell apart share one probability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect, Seen
from plumbline.optim.diagnosis.motion.constants import (
    ALIKE,
    LEAST_GAIN,
    LEAST_SHARE,
    MOVES,
    PRESENT,
    REMEMBERS,
    RIVAL_FROM,
    SEARCHED,
)
from plumbline.optim.diagnosis.motion.fit import Fit, correlation_time, fitted
from plumbline.optim.diagnosis.motion.rollout import Array, Effects, Windows
from plumbline.optim.diagnosis.motion.signals import spread
from plumbline.optim.diagnosis.motion.unlisted import VARIABLES, Unlisted, rivals

Key = frozenset[MotionEffect]


@dataclass(frozen=True, eq=False)
class Joint:
    """What a search found at one joint.

    Attributes:
        number: The joint, from 1.
        windows: What was fitted.
        fit: The effects that were found, with their values.
        probability: Of every effect that was considered, by name.
        instead: By name of an effect found: what may stand in its place, with its probability.
        unlisted: What a function beside all that was found would explain, by variable.
        outside: Probability that something beside it is at work.
        mechanisms: Probability of every effect and of every function that nobody has listed, the
            latter as ``?`` and its variable.
        anything: Probability that any of these is at work.
        effective: Samples that count as independent.
    """

    number: int
    windows: Windows
    fit: Fit
    probability: Mapping[str, float]
    instead: Mapping[str, Mapping[str, float]]
    unlisted: tuple[Unlisted, ...]
    outside: float
    mechanisms: Mapping[str, float]
    anything: float
    effective: float

    @property
    def std(self) -> Array:
        """Standard errors of the values (P,)."""
        return np.sqrt(np.diag(self.fit.covariance(self.effective)))


class _Search:
    """The models of one joint that were fitted so far."""

    def __init__(
        self,
        windows: Windows,
        library: Effects,
        seen: Seen,
        floor: float,
        alike: dict[MotionEffect, set[MotionEffect]] | None = None,
    ) -> None:
        self.windows, self.library, self.seen, self.floor = windows, library, seen, floor
        self.found: dict[Key, Fit] = {frozenset(): fitted(windows, (), np.empty(0))}
        self.alike: dict[MotionEffect, set[MotionEffect]] = alike or {}

    @property
    def time(self) -> float:
        """Correlation time of the best model's residual [samples]."""
        best = min(self.found.values(), key=lambda fit: fit.square)
        return correlation_time(best.residual)

    def score(self, key: Key, time: float) -> float:
        """Log of evidence times prior."""
        fit = self.found[key]
        if fit.at_bound:
            return -np.inf  # beyond what such a thing can be, or nothing at all
        odds = len(key) * np.log(PRESENT / (1 - PRESENT))
        return fit.evidence(fit.residual.size / time, self.floor) + float(odds)

    def fit(self, key: Key, near: Fit) -> None:
        """Fit a model, from one that it differs from by an effect or two."""
        if key in self.found or len({e.name for e in key}) < len(key):
            return
        effects = tuple(e for e in self.library if e in key)
        known = dict(zip(near.effects, near.theta, strict=True))
        new = [e for e in effects if e not in known]
        starts = [[known.get(e, np.nan) for e in effects]]
        for e in new:
            values = np.multiply(e.starts(self.seen), self.windows.sizes((e,)))
            at = effects.index(e)
            starts = [[*s[:at], v, *s[at + 1 :]] for s in starts for v in values]
        fits = [fitted(self.windows, effects, np.array(s), search=True) for s in starts]
        self.found[key] = min(fits, key=lambda fit: fit.square)

    def climb(self) -> Key:
        """Add effects while that pays, one by one, and by twos where none pays alone."""
        here: Key = frozenset()
        while True:
            names = {e.name for e in here}
            more = [here | {e} for e in self.library if e.name not in names]
            there, moved = self._best(here, more)
            if not moved:
                more = self._pairs(here)
                there, moved = self._best(here, more)
            if not moved:
                return here
            self._compare(here, there, more)
            here = there

    def _pairs(self, here: Key) -> list[Key]:
        """Models with two linear effects more, where what is left still has a past.

        A gain hides a delay from a lag that stands for both: either alone brings next to nothing.
        """
        if self.time < REMEMBERS:
            return []
        names = {e.name for e in here}
        more = [e for e in self.library if e.linear and e.name not in names]
        return [here | {a, b} for a, b in combinations(more, 2) if a.name != b.name]

    def settle(self, here: Key, start: Fit) -> Key:
        """Exchange, add and drop while that pays, from where a search on fewer windows ended."""
        self.fit(here, start)
        for _ in range(MOVES):
            more = [here | {e} for e in self.library]
            here, moved = self._best(here, [*self.around(here), *more])
            if not moved:
                break
        return here

    def _compare(self, here: Key, there: Key, tried: list[Key]) -> None:
        """Note which effects would have brought nearly as much as those that were taken."""
        gained = {k: self.found[here].square - self.found[k].square for k in tried}
        near = [k for k in tried if gained[k] > ALIKE * gained[there]]
        for taken in there - here:
            rest = there - {taken}
            self.alike[taken] = {e for k in near if rest < k for e in k - rest}

    def around(self, key: Key) -> list[Key]:
        """Models with one effect less, or with one exchanged for another that does alike."""
        found = [key - {e} for e in key]
        for effect in key:
            others = self.alike.get(effect, set(self.library)) - key
            found += [(key - {effect}) | {other} for other in others]
        return found

    def _best(self, here: Key, others: list[Key]) -> tuple[Key, bool]:
        for key in others:
            self.fit(key, self.found[here])
        time = self.time
        known = [k for k in others if k in self.found]
        best = max(known, key=lambda k: self.score(k, time), default=here)
        if len(best) > len(here):
            grows = self.found[here].square - self.found[best].square
            if grows < LEAST_GAIN * (self.found[here].square + self.floor**2):
                return here, False
        better = self.score(best, time) > self.score(here, time)
        return (best, True) if better else (here, False)


def search(
    number: int,
    windows: Windows,
    library: Effects,
    seen: Seen,
    floor: float,
    prior: float,
) -> Joint:
    """Find a joint's causes.

    Args:
        number: The joint, from 1.
        windows: What it did.
        library: Effects to consider, in the order in which they act.
        seen: Where fits may start.
        floor: The least noise that is believed [rad].
        prior: Probability that something that nobody has listed is at work at this joint.
    """
    few = replace(windows, start=spread(windows.start, SEARCHED))
    quick = _Search(few, library, seen, floor)
    key = quick.climb()
    models = _Search(windows, library, seen, floor, quick.alike)
    key = models.settle(key, quick.found[key])
    rough = models.found[key]
    fit = fitted(windows, rough.effects, rough.theta)
    time = correlation_time(fit.residual)
    effective = fit.residual.size / time
    weights = _weights(models, key, time, prior)
    total = np.logaddexp.reduce([w for _, w in weights])
    share = [(names, float(np.exp(w - total))) for names, w in weights]
    listed = {e.name for e in library}
    probability = {name: sum(p for names, p in share if name in names) for name in listed}
    found = {e.name for e in fit.effects}
    instead = {name: _instead(name, found, share) for name in found}
    beside = rivals(windows, fit, effective, floor)
    gains = [u.gain for u in beside if u.share > LEAST_SHARE]
    odds = np.logaddexp.reduce(gains) - np.log(len(VARIABLES)) if gains else -np.inf
    odds += np.log(prior / (1 - prior))
    outside = float(1 / (1 + np.exp(-np.clip(odds, -500, 500))))
    every, anything = _mechanisms(share, found, beside)
    return Joint(
        number, windows, fit, probability, instead, beside, outside, every, anything, effective
    )


def _mechanisms(
    share: list[tuple[frozenset[str], float]], found: set[str], beside: Sequence[Unlisted]
) -> tuple[dict[str, float], float]:
    """Probability of each mechanism by name, and that any of them is at work.

    A function beside what was found that takes next to nothing counts for none, as it does in the
    probability of something outside.
    """
    nothing = {f"?{u.on}" for u in beside if u.share <= LEAST_SHARE}
    every: dict[str, float] = {}
    anything = 0.0
    for names, p in share:
        told = names - nothing if names - nothing == found else names
        anything += p * bool(told)
        for name in told:
            every[name] = every.get(name, 0.0) + p
    return every, min(anything, 1.0)


def _weights(
    models: _Search, key: Key, time: float, prior: float
) -> list[tuple[frozenset[str], float]]:
    """Names of the effects in each model, a function of a variable among them, and log weights."""
    found = [(frozenset(e.name for e in k), models.score(k, time)) for k in models.found]
    each = np.log(prior / (1 - prior) / len(VARIABLES))
    best = models.score(key, time)
    for less in (key, *(key - {effect} for effect in key)):
        models.fit(less, models.found[key])
        score = models.score(less, time)
        effective = models.found[less].residual.size / time
        if best - score > RIVAL_FROM * effective:
            continue  # far too much for any function to make up for
        names = frozenset(e.name for e in less)
        for u in rivals(models.windows, models.found[less], effective, models.floor):
            found.append((names | {f"?{u.on}"}, score + u.gain + float(each)))
    return found


def _instead(
    name: str, found: set[str], share: list[tuple[frozenset[str], float]]
) -> dict[str, float]:
    """What stands in a cause's place where it is not, and with what probability."""
    out: dict[str, float] = {}
    for names, p in share:
        if name not in names:
            for other in names - found:
                out[other] = out.get(other, 0.0) + p
    return out
