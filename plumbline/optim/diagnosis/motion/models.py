r"""The models of one joint's drive that were fitted so far, and the climb over them.

Effects go in one by one while the evidence grows; then every neighbour of where that ends (one
effect less, one more, one exchanged) is fitted too, and the search moves on if one is better. All
this looks at a few windows on a coarse clock. Where more than noise is left, the search climbs
from the best pair of effects, too. What may win is fitted to all windows, from where those fits
ended.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Self

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect, Seen
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.motion.constants import (
    CONTENDS,
    ENOUGH,
    LEAST_GAIN,
    LEAST_SHARE,
    MOVES,
    PRESENT,
    RACE,
    SEARCH_ITERATIONS,
    STEPS,
    WORTH_A_FIT,
)
from plumbline.optim.diagnosis.motion.fit import JointFit, correlation_time, fitted
from plumbline.optim.diagnosis.motion.unlisted import NO_FORM, UnlistedFunction, exceeds
from plumbline.optim.diagnosis.motion.windows import Effects, Windows
from plumbline.optim.diagnosis.prior import EARNED

Key = frozenset[MotionEffect]
SAME = frozenset(("actuation_play", "actuation_deadband"))  # one operator: `twins`
YIELDS = frozenset(("servo_stiffness",))  # in either form
ODDS = float(np.log(PRESENT / (1 - PRESENT)))


def names_of(key: Key) -> frozenset[str]:
    """Names of a model's effects."""
    return frozenset(effect.name for effect in key)


def twins(effects: Effects, law: Law, forms: Effects) -> Iterator[Effects]:
    """The same drive by other forms: play and a dead band are one where nothing lags or limits it.

    In the forms that leave their width of every error they always are. Nor does it matter there
    whether a servo yields inside of its loop or behind it.

    Args:
        effects: What a drive has.
        law: What its command is.
        forms: Forms to consider.
    """
    limits = any(e.is_limit and not e.plans for e in effects)
    at_once = law.ideal and not limits and not any(e.lags for e in effects)
    for names in (SAME, YIELDS):
        own = [e for e in effects if e.name in names]
        if len(own) != 1 or not law.follows:
            continue
        for form in forms:
            alike = at_once or (bool(own[0].variant) and bool(form.variant))
            if form.name in names and form != own[0] and alike:
                yield tuple(form if e == own[0] else e for e in effects)


class Models:
    """Fits to the same windows, by their effects."""

    def __init__(self, windows: Windows, library: Effects, seen: Seen) -> None:
        self.windows, self.library, self.seen = windows, library, seen
        self.found: dict[Key, JointFit] = {frozenset(): fitted(windows, (), np.empty(0))}
        self.began: dict[Key, float] = {}  # what was left where the fit of a model began
        self.before: Mapping[Key, JointFit] = {}  # fits of another search, which these begin from
        forms = Counter(e.name for e in library)  # which share an effect's odds
        self.odds = {name: ODDS - float(np.log(count)) for name, count in forms.items()}

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
        found = fit.evidence(fit.residual.size / time) + sum(self.odds[e.name] for e in key)
        return found if np.isfinite(found) else -np.inf  # a way that ran off

    def floor(self, fit: JointFit, sigma: float) -> float:
        """What a fit leaves where nothing is missing [rad]: noise, and steps of a planned way."""
        return float(np.hypot(sigma, self._steps(fit) ** 0.5))

    def _steps(self, fit: JointFit) -> float:
        """What steps of a planned way change, a mean square [rad^2]."""
        planned = any(e.plans for e in fit.effects)
        return STEPS**2 * self.found[frozenset()].square if planned else 0.0

    def lacking(self, key: Key, time: float, sigma: float | None) -> UnlistedFunction:
        """What a fit leaves beyond an explained gap, of no form; none without a stated noise."""
        fit = self.found[key]
        least = 0.0 if sigma is None else (EARNED * self.floor(fit, sigma)) ** 2
        x = max(fit.square / least, 1.0) if least else 1.0
        return UnlistedFunction(NO_FORM, exceeds(x, fit.residual.size / time), 1.0 - 1.0 / x)

    def sizes(self, key: Key) -> dict[str, float]:
        """What a model leaves more without each of its effects, root of squares [rad]."""
        own, found = self.found[key], {}
        for effect in own.effects:
            self.fit(key - {effect}, own)
            more = self.found[key - {effect}].square - own.square
            found[effect.name] = max(more, 0.0) ** 0.5
        return found

    def fit(self, key: Key, near: JointFit) -> None:
        """Fit a model, from one that it differs from by an effect or two."""
        if key in self.found:
            self._go_on(key, near)
        if key in self.found or len({e.name for e in key}) < len(key):
            return
        self.began[key] = near.square
        effects = tuple(e for e in self.library if e in key)
        known = dict(zip(near.effects, near.theta, strict=True))
        new = [e for e in effects if e not in known]
        starts = [[known.get(e, np.nan) for e in effects]]
        if key in self.before:
            starts, new = [self.before[key].theta.tolist()], []
        for e in new:
            values = np.multiply(e.starts(self.seen), self.windows.sizes((e,)))
            at = effects.index(e)
            starts = [[*s[:at], v, *s[at + 1 :]] for s in starts for v in values]
        steps = RACE if len(starts) > 1 else SEARCH_ITERATIONS
        fits = [fitted(self.windows, effects, np.array(s), steps) for s in starts]
        first = min(fits, key=lambda fit: fit.square)
        if len(starts) > 1:
            first = fitted(self.windows, effects, first.theta, SEARCH_ITERATIONS)
        self.keep(first)

    def _go_on(self, key: Key, near: JointFit) -> None:
        """A fit of a planned way again, from a better one than it began from.

        Little is seen of what else a servo does before the way that it plans is as it is.
        """
        fit = self.found[key]
        if near.square < self.began.get(key, 0.0) and any(e.plans for e in key):
            self.began[key] = near.square
            known = dict(zip(near.effects, near.theta, strict=True))
            start = np.array([known.get(e, v) for e, v in zip(fit.effects, fit.theta, strict=True)])
            again = fitted(self.windows, fit.effects, start, SEARCH_ITERATIONS)
            if again.square < fit.square:
                self.keep(again)

    def keep(self, fit: JointFit) -> None:
        """A fit, and as that of the same drive by other forms."""
        for effects in (*twins(fit.effects, self.windows.law, self.library), fit.effects):
            self.found[frozenset(effects)] = replace(fit, effects=effects)

    def other_forms(self, key: Key) -> Iterator[tuple[str, str, Key]]:
        """The same drive by other forms, with the name that goes and the one that comes."""
        for effects in twins(self.found[key].effects, self.windows.law, self.library):
            other = frozenset(effects)
            (gone,), (new,) = key - other, other - key
            yield gone.name, new.name, other

    def climb(self, here: Key = frozenset()) -> Key:
        """Add effects one by one while that pays."""
        while True:
            here, moved = self._best(here, self.with_one_more(here))
            if not moved:
                return here

    def begun_by(self, other: Self, key: Key) -> Key:
        """Where a search begins that knows what another found, of the same motion."""
        self.before = other.found
        self.fit(key, other.found[key])
        return key

    def from_pairs(self, key: Key, sigma: float | None) -> Key:
        """Where the best pair of effects leads, if that is better and more than noise is left.

        Of two that are worth little alone, a lag and a droop that makes up for what it takes, the
        first to be added would be something else, from where no exchange leads on.
        """
        if self.is_noise(self.found[key], sigma):
            return key
        nothing: Key = frozenset()
        pair, _ = self._best(nothing, self.pairs())
        return self._better(key, [self.settle(self.climb(pair))])[0]

    def pairs(self) -> list[Key]:
        """Two effects each, but those whose ways are planned: their fits cost ten times as much."""
        cheap = [e for e in self.library if not e.plans]
        return [frozenset(pair) for pair in combinations(cheap, 2)]

    def is_noise(self, fit: JointFit, sigma: float | None) -> bool:
        """Whether what a fit leaves may be noise, of a stated one that is known."""
        least = 0.0 if sigma is None else self.floor(fit, sigma) ** 2
        return (1 - LEAST_SHARE) * fit.square <= least

    def settle(self, here: Key) -> Key:
        """Exchange, add and drop while that pays, at last in other forms too."""
        for _ in range(MOVES):
            here, moved = self._best(here, [*self.around(here), *self.with_one_more(here)])
            if not moved:
                here, moved = self._best(here, self.in_another_form(here))
            if not moved:
                break
        return here

    def around(self, key: Key) -> list[Key]:
        """Models with one effect less, or with one exchanged for another, of all its forms."""
        less = [form - {effect} for form in self._forms(key) for effect in form]
        every = [*less, *(rest | {other} for rest in less for other in self.library)]
        return [k for k in dict.fromkeys(every) if k != key]

    def with_one_more(self, key: Key) -> list[Key]:
        """Models with one effect more, of all its forms: beside a lag these are not the same."""
        return [form | {e} for form in self._forms(key) for e in self.library]

    def in_another_form(self, key: Key) -> list[Key]:
        """Models with one effect in another form and one more: forms worse alone may need it."""
        forms = [(e, new) for e in key for new in self.library if new.name == e.name and new != e]
        more = [e for e in self.library if e.name not in names_of(key)]
        return [key - {e} | {new, other} for e, new in forms for other in more]

    def _forms(self, key: Key) -> list[Key]:
        return [key, *(other for *_, other in self.other_forms(key))]

    def _best(self, here: Key, others: list[Key]) -> tuple[Key, bool]:
        for key in others:
            self.fit(key, self.found[here])
        return self._better(here, [k for k in others if k in self.found])

    def _better(self, here: Key, others: Iterable[Key]) -> tuple[Key, bool]:
        """The best of them, if it is better than where the search stands."""
        time = self.time
        counted = [k for k in others if not self.negligible(k, here)]
        best = max(counted, key=lambda k: self.score(k, time), default=here)
        better = self.score(best, time) > self.score(here, time)
        return (best, True) if better else (here, False)

    def likeliest(self, here: Key) -> Key:
        """Of models that do alike, one by whose names most of the probability goes.

        Of names that tie, the one of more forms: what the rows tell is true of each of them; then
        what acts nearest to the joint.
        """
        time = self.time
        known = [k for k in self.found if not self.negligible(k, here)]
        forms: dict[frozenset[str], list[float]] = {}
        for k in known:
            forms.setdefault(names_of(k), []).append(self.score(k, time))

        acts = [e.name for e in self.library]

        def rank(names: frozenset[str]) -> tuple[float, int, int]:
            score = round(float(np.logaddexp.reduce(forms[names])), 3)
            return score, len(forms[names]), sum(acts.index(name) for name in names)

        first = max(forms, key=rank)
        return max((k for k in known if names_of(k) == first), key=lambda k: self.score(k, time))

    def negligible(self, key: Key, given: Key) -> bool:
        """Whether a model has more effects than another, which take next to nothing each."""
        other = self.found[given]
        grows = other.square - self.found[key].square
        more = len(key) - len(given)
        return more > 0 and grows < max(more * LEAST_GAIN * other.square, self._steps(other))

    def spared(self, key: Key) -> Key:
        """The model without effects that take next to nothing, alone or two together.

        A climb that began with what stands for two others keeps it with them: of many samples
        what little they leave, a simulator's steps or an encoder's, is evidence for more.
        """
        whole = key
        while True:
            some = [key - set(gone) for n in (1, 2) for gone in combinations(key, n)]
            for less in some:
                self.fit(less, self.found[key])
            spared = [less for less in some if self.negligible(whole, less)]
            if not spared:
                return key
            key = min(spared, key=lambda k: (len(k), self.found[k].square))

    def contenders(self, key: Key) -> list[Key]:
        """What may be better than a model once all windows count, itself first.

        What holds a model and more must already bring more than chance makes of noise.
        """
        time = self.time
        least = self.score(key, time) - CONTENDS
        own = self.found[key]
        effective = own.residual.size / time
        found = [key]
        for k, fit in self.found.items():
            gained = effective / 2 * float(np.log(own.square / fit.square))
            if k != key and self.score(k, time) > least and not (k > key and gained < WORTH_A_FIT):
                found.append(k)
        return found

    def again(self, few: Self, key: Key) -> Key:
        """Fit to these windows what contends on fewer of them; where that leads, look around."""
        for _ in range(MOVES):
            for k in few.contenders(key):
                if k not in self.found:
                    start = few.found[k]
                    self.keep(fitted(self.windows, start.effects, start.theta, SEARCH_ITERATIONS))
            key, moved = self._better(key, self.found)
            if not moved:
                break
            few.fit(key, self.found[key])  # which may have been found here alone
            for k in (*few.around(key), *few.with_one_more(key)):
                few.fit(k, few.found[key])
        return key

    def finished(self, key: Key) -> Key:
        """The likeliest once what contends is fitted to the end.

        Steps by a way's rough slopes end a search's fits nats short of their best, and one begun
        anew goes on.
        """
        for k in self.contenders(key):
            more = any(e.plans for e in k)
            for _ in range(MOVES * more):
                fit = self.found[k]
                self.keep(fitted(self.windows, fit.effects, fit.theta))
                if self.found[k].square > (1 - ENOUGH) * fit.square:
                    break
        return self.likeliest(key)

    def completed(self, key: Key, sigma: float | None) -> Key:
        """With effects that a coarser clock did not show, where more than noise is left."""
        for _ in range(MOVES):
            if sigma is None or self.is_noise(self.found[key], sigma):
                break
            key, moved = self._best(key, self.with_one_more(key))
            if not moved:
                break
        return key


def nested(windows: Windows, near: JointFit, seen: Seen) -> tuple[Models, Key]:
    """A fit's effects fitted to windows, with those that these rather do without dropped."""
    models = Models(windows, near.effects, seen)
    models.fit(frozenset(near.effects), near)
    fit = models.found[frozenset(near.effects)]
    left = frozenset(e for e in fit.effects if e.name not in fit.at_bound)
    models.fit(left, fit)
    return models, models.settle(left)
