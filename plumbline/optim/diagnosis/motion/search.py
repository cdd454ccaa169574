r"""Which effects of the library a joint's drive has: a search, and the posterior over what it saw.

With prior odds p a cause, the probability of a cause is the share of the models that have it,

.. math:: P(c) = \frac{\sum_{m \ni c} Z_m p^{|m|}}{\sum_m Z_m p^{|m|}},

among them models in which a function that nobody has listed stands in its place. So two effects
that a recording cannot tell apart share one probability.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plumbline.optim.diagnosis.motion import constants
from plumbline.optim.diagnosis.motion.fit import JointFit, correlation_time, fitted
from plumbline.optim.diagnosis.motion.models import Key, Models, names_of
from plumbline.optim.diagnosis.motion.unlisted import (
    VARIABLES,
    FunctionRivals,
    UnlistedFunction,
    own_past,
)
from plumbline.optim.diagnosis.motion.windows import Array, Windows
from plumbline.optim.diagnosis.prior import DEVIATIONS, NO_EVIDENCE, PART_OF_UNLISTED

IS_PART = DEVIATIONS[0]  # of an effect's size: what is unlisted and as large may be all of both


@dataclass(frozen=True, eq=False)
class JointFindings:
    """What a search found at one joint."""

    number: int  # the joint, from 1
    windows: Windows  # what was fitted
    fit: JointFit  # the effects that were found, with their values
    probability: Mapping[str, float]  # of every effect that was considered, by name
    # by name of an effect found: what may stand in its place, with its probability
    instead: Mapping[str, Mapping[str, float]]
    # what a function more than all that was found would explain, by variable
    unlisted: tuple[UnlistedFunction, ...]
    outside: float  # probability that something else is at work with it
    # probability of every effect and of every function that nobody has listed, the latter as ``?``
    # and its variable
    mechanisms: Mapping[str, float]
    anything: float  # probability that any of these is at work
    effective: float  # samples that count as independent
    # by name of a limit that no row came near: what was hardly exceeded, in its parameter's unit
    unseen: Mapping[str, float]
    std: Array  # standard errors of the values (P,)


@dataclass(frozen=True, eq=False)
class Begun:
    """Where a joint's search stands on a few windows."""

    number: int  # the joint, from 1
    windows: Windows  # what it did
    quick: Models  # fits to fewer windows, on a coarser clock: where the search looks first
    key: Key  # the best of those
    sigma: float | None  # stated noise of their samples [rad], if any is

    @property
    def near(self) -> JointFit:
        """The best of those, on fewer windows."""
        return self.quick.found[self.key]


def search(begun: Begun, prior: float, sigma: float | None = None) -> JointFindings:
    """Find a joint's causes.

    Args:
        begun: The joint, and where its search stands.
        prior: Probability that something that nobody has listed is at work at this joint.
        sigma: Stated noise of a position [rad], if any is.
    """
    number, windows, quick = begun.number, begun.windows, begun.quick
    library, seen = quick.library, quick.seen
    models = Models(windows, library, seen)
    key = models.completed(models.again(quick, begun.key), sigma)
    key = models.likeliest(key)
    if (spared := models.spared(key)) != key:  # of which others contend than of more
        quick.fit(spared, models.found[spared])
        key = models.spared(models.likeliest(models.again(quick, spared)))
    key = models.finished(key)
    rough = models.found[key]
    fit = fitted(windows, rough.effects, rough.theta)
    time = correlation_time(fit.residual)
    effective = fit.residual.size / time
    weights = _weights(models, key, time, prior, sigma)
    total = np.logaddexp.reduce([w for _, w in weights])
    share = [(names, float(np.exp(w - total))) for names, w in weights]
    listed = dict.fromkeys(e.name for e in library)  # in order: files are the same in every run
    probability = {name: sum(p for names, p in share if name in names) for name in listed}
    found = dict.fromkeys(e.name for e in fit.effects)  # in order: proposals are told in it
    instead = {name: _instead(name, found, share) for name in found}
    std = np.hypot(errors_of(models, fit, prior, sigma), _apart(models, key, fit, time))
    added = FunctionRivals(windows, fit, effective).conditional()
    if sigma is not None:
        added = (*added, own_past(windows, fit, models.floor(fit, sigma)))
    outside = sum(p for names, p in share if any(name[0] == "?" for name in names))
    every, anything = _mechanisms(share)
    near = {name for name, p in probability.items() if p > constants.CONFOUNDED}
    unseen = {
        e.name: size * e.starts(seen)[0]
        for e, size in zip(library, windows.sizes(library), strict=True)
        if e.is_limit and e.name not in near
    }
    return JointFindings(
        number, windows, fit, probability, instead, added, outside, every, anything, effective,
        unseen, std,
    )  # fmt: skip


def errors_of(models: Models, fit: JointFit, prior: float, sigma: float | None) -> Array:
    """Standard errors (P,) of a fit, with what nobody has listed at work as well or not."""
    models.keep(fit)
    effective = fit.residual.size / correlation_time(fit.residual)
    rivals = FunctionRivals(
        models.windows, fit, effective, stated=0.0 if sigma is None else sigma**2
    )
    return rivals.errors(models.sizes(frozenset(fit.effects)), odds_of_each(prior))


def _apart(models: Models, key: Key, fit: JointFit, time: float) -> Array:
    r"""How far off a fit's values (P,) other models with the same effects have them, on average.

    :math:`\sum_m P(m) (\theta_m - \hat\theta)^2` over models of listed effects, the part of a
    value's variance that is between these: a lag is another beside a delay than beside a servo of
    second order.
    """
    known = [k for k in models.found if not models.negligible(k, key)]
    fits = [models.found[k] for k in known]
    values = [{e.name: v for e, v in zip(f.effects, f.theta, strict=True)} for f in fits]
    scores = np.array([models.score(k, time) for k in known])
    found = []
    for effect, own in zip(fit.effects, fit.theta, strict=True):
        has = np.array([effect.name in one for one in values])
        off = np.array([one.get(effect.name, own) - own for one in values])
        weights = np.where(has, np.exp(scores - scores.max()), 0.0)
        found.append(float(np.sqrt(np.average(off**2, weights=weights))))
    return np.array(found)


def odds_of_each(prior: float) -> float:
    """Prior log odds of something unlisted at a joint that goes by one variable."""
    return float(np.log(prior / (1 - prior) / len(VARIABLES)))


def prior_at(unlisted: float, joints: int) -> float:
    """Prior probability of something unlisted at each of so many joints."""
    return float(1 - (1 - unlisted) ** (1 / max(joints, 1)))


def _mechanisms(share: list[tuple[frozenset[str], float]]) -> tuple[dict[str, float], float]:
    """Probability of each mechanism by name, and that any of them is at work."""
    every: dict[str, float] = {}
    for names, p in share:
        for name in names:
            every[name] = every.get(name, 0.0) + p
    return every, min(sum(p for names, p in share if names), 1.0)


def _weights(
    models: Models, key: Key, time: float, prior: float, sigma: float | None
) -> list[tuple[frozenset[str], float]]:
    """Names of the effects in each model, a function of a variable among them, and log weights.

    A model that leaves more than the stated noise is of that noise all the same, and so much less
    probable, or something that nobody has listed is at work with it, of whatever form.
    """
    counted = [k for k in models.found if not models.negligible(k, key)]
    lacking = {k: models.lacking(k, time, sigma) for k in (*counted, key)}
    found = [(names_of(k), models.score(k, time) - lacking[k].gain) for k in counted]
    each = odds_of_each(prior)
    resembles = float(np.log(constants.RESEMBLES / max(len(models.odds), 1)))
    best, own = models.score(key, time), models.found[key]
    stated = 0.0 if sigma is None else sigma**2
    for k, lack in lacking.items():
        if lack.share > constants.LEAST_SHARE and best - models.score(k, time) < NO_EVIDENCE:
            large = (lack.share * models.found[k].square) ** 0.5
            found += _with_parts(models.sizes(k), large, lack.on, models.score(k, time) + each)
    for less in (key, *(key - {effect} for effect in key)):
        models.fit(less, own)
        score, fit = models.score(less, time), models.found[less]
        effective = fit.residual.size / time
        if best - score > constants.RIVAL_FROM * effective:
            continue  # far too much for any function to make up for
        beside: list[tuple[frozenset[str], float]] = []
        rivals = FunctionRivals(models.windows, fit, effective, own.square, stated)
        added = rivals.conditional()
        past: tuple[UnlistedFunction, ...] = ()
        told = any(u.share > constants.LEAST_SHARE and u.gain > NO_EVIDENCE for u in added)
        if sigma is not None and not told:  # by a function that is not just as probable as chance
            past = (own_past(models.windows, fit, models.floor(fit, sigma)),)
        sizes = models.sizes(less)
        for u in (*added, *past):
            if u.share > constants.LEAST_SHARE:
                large = (u.share * fit.square) ** 0.5
                beside += _with_parts(sizes, large, u.on, score + u.gain + each)
        for i, effect in enumerate(fit.effects):
            weight = score + each - np.log(2)  # functions, and the effect modulated
            instead = weight + resembles - models.odds[effect.name]
            size, rest = sizes[effect.name], {n: s for n, s in sizes.items() if n != effect.name}
            for u in (*rivals.resembling(i, size), *past):  # with the effect, or instead
                if u.share > constants.LEAST_SHARE:
                    beside.append((names_of(less) | {f"?{u.on}"}, weight + u.gain))
                    beside += _with_parts(rest, size, u.on, instead + u.gain)
        found += beside
        for gone, new, other in models.other_forms(less):
            more = models.score(other, time) - score
            found += [(names - {gone} | {new}, w + more) for names, w in beside if gone in names]
    return found


def _with_parts(
    sizes: Mapping[str, float], large: float, on: str, weight: float
) -> list[tuple[frozenset[str], float]]:
    """A model with which something unlisted is at work: some of its effects may be parts of it.

    What nobody has listed need not be one function; an effect than which it is no smaller by far
    may fit what the function leaves of it.

    Args:
        sizes: The model's effects, with what it leaves more without each [rad].
        large: The same of what is unlisted [rad].
        on: What that goes by.
        weight: Log weight of both.
    """
    names = frozenset(sizes)
    parts = {name for name, size in sizes.items() if IS_PART * size <= large}
    shares = ((names, 1 - PART_OF_UNLISTED), (names - parts, PART_OF_UNLISTED))
    return [
        (held | {f"?{on}"}, weight + float(np.log(share)))
        for held, share in (shares if parts else ((names, 1.0),))
    ]


def _instead(
    name: str, found: Mapping[str, None], share: list[tuple[frozenset[str], float]]
) -> dict[str, float]:
    """What stands in a cause's place where it is not, and with what probability."""
    out: dict[str, float] = {}
    for names, p in share:
        if name not in names:
            for other in sorted(names - found.keys()):
                out[other] = out.get(other, 0.0) + p
    return out
