r"""The candidate that a closed list lacks: an unknown, smooth dependence on something recorded.

The verdict's model M competes with M beside one family f of :mod:`optim.diagnosis.dependences`, and
with every model in which f takes the place of some causes S, so that no impostor hides the unknown:

.. math:: \log\frac{p(M \setminus S + f)}{p(M)} = \log B_f + \log\pi_f
          - \sum_{c \in S} (\log B_c + \log\pi_c)

each Bayes factor beside what is there already. What these models weigh together gives the
probability of the unknown, of what it depends on, and of every cause beside it. Components of a
reading may be noisier than others; both kinds of noise are weighed, so that no family is paid for
explaining the noise of one axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import expit, logsumexp

from optim.diagnosis.dependences import Dependence, Key, Ports, dependences
from optim.diagnosis.evidence import (
    LEAST_VARIANCE,
    LOG_SCALE_WEIGHTS,
    NoisePrior,
    block_evidence,
)
from optim.diagnosis.search import Found
from optim.diagnosis.selection import FIRST_SLOT_ODDS, NEXT_SLOT_ODDS
from optim.observation import Model
from optim.problem import Array

PRIOR_ODDS = 0.1
MOST_ROWS = 600
WIDE = 10.0
SURE = 5.0
FEW_CAUSES, MANY_CAUSES = 4, 12
WORTH_TRYING = 12
NEGLIGIBLE = 5.0
RICHER = 1.0
LEAST_SPREAD = 0.05


@dataclass(frozen=True, eq=False)
class Outside:
    """What was found beyond the model's own effects.

    Attributes:
        log_odds: Log odds of any family, whatever it stands beside or in place of, against none.
        words: On what the best family depends.
        stage: Where it would sit.
        element: Its joint or link.
        standing: Probability of each cause beside or against the families.
        richer: The best family that holds a cause in a richer form and is more probable than its
            plain form, in words, by cause.
    """

    log_odds: float
    words: str
    stage: str
    element: int | None
    standing: Mapping[Key, float] = field(default_factory=dict)
    richer: Mapping[Key, str] = field(default_factory=dict)

    @classmethod
    def slipped(cls, rows: Sequence[int], standing: Mapping[Key, float]) -> Outside:
        """What rows (from 0) say that one shift of the tool displaced."""
        listed = ", ".join(str(k + 1) for k in rows)
        words = f"rows {listed}: one shift of the tool explains them"
        return cls(SURE, words, "tool", None, standing)

    @property
    def probability(self) -> float:
        """Probability that something smooth and unknown is at work."""
        return float(expit(self.log_odds))


def look_outside(
    model: Model,
    x: Array,
    noise: NoisePrior,
    fixed: int,
    seed: int = 0,
    log_priors: Mapping[Key, float] | None = None,
) -> Outside:
    """Let the families compete beside a fitted model, and in place of its causes.

    Args:
        model: Nuisances, then ``fixed`` effects that count as nuisances, then the chosen ones.
        x: Its fit (P,).
        noise: The prior of the noise.
        fixed: How many of its effects are always fitted.
        seed: Of the random features.
        log_priors: Log odds of each chosen cause before the data; even odds if not given.
    """
    rows = _spread(len(model.recording))
    rows = rows[model.problem.weights[rows] > 0]
    ports = Ports.about(model, x, rows)
    found = list(dependences(model.recording.select(rows), ports, seed))
    causes = _causes(model, fixed)
    flat = min((int(c.min()) for c in causes.values()), default=model.problem.size)
    priors = np.array([(log_priors or {}).get(key, 0.0) for key in causes])
    contests = [Contest.of(ports, found, flat, noise)]
    spread = _spread_of_noise(ports, x / model.problem.scale)
    uneven = Contest.of(ports.divided(spread), found, flat, noise, spread)
    likely = np.array([c.log_likelihood for c in (contests[0], uneven)])
    if likely[1] > likely[0] - NEGLIGIBLE:
        contests.append(uneven)
    likely = likely[: len(contests)] - logsumexp(likely[: len(contests)])
    answers = [c.weights(list(causes.values()), priors) for c in contests]
    weighed = [share + log for share, (_, log) in zip(likely, answers, strict=True)]
    return _summed(found, list(causes), answers[0][0], logsumexp(weighed, axis=0))


def look_beyond(found: Found, noise: NoisePrior, seed: int = 0) -> Outside:
    """The same beside and in place of what a search has found.

    Args:
        found: Where the search ended.
        noise: The prior of the noise.
        seed: Of the random features.
    """
    odds = np.log(NEXT_SLOT_ODDS if len(found.chosen) > 1 else FIRST_SLOT_ODDS)
    priors: dict[Key, float] = {}
    for choice in found.chosen:
        candidate = found.question.candidates[choice.index]
        priors[candidate.key] = priors.get(candidate.key, 0.0) + candidate.log_prior + odds
    return look_outside(found.model, found.best.x, noise, len(found.fixed), seed, priors)


def _causes(model: Model, fixed: int) -> dict[Key, NDArray[np.intp]]:
    """Columns of every cause of a model, variants together."""
    found: dict[Key, NDArray[np.intp]] = {}
    for term in model.terms[fixed:]:
        key = (term.effect.name, term.effect.element)
        mine = np.arange(term.columns.start, term.columns.stop)
        found[key] = np.concatenate([found[key], mine]) if key in found else mine
    return found


def _summed(
    found: Sequence[Dependence],
    causes: Sequence[Key],
    sets: Sequence[tuple[int, ...]],
    log_weights: Array,
) -> Outside:
    """From log weights (S, F) of every family in place of every set, against the model itself.

    A family that holds a cause of the model in a richer form is no unknown; it is told apart.
    """
    same = np.array([[key in f.extends for f in found] for key in causes], dtype=bool)
    same = same.reshape(len(causes), len(found))
    unknown = ~same.any(axis=0)
    by_family = logsumexp(log_weights, axis=0)
    known = float(np.logaddexp(0.0, logsumexp(np.where(unknown, -np.inf, by_family))))
    best = found[int(np.argmax(np.where(unknown, by_family, -np.inf)))]
    log_odds = float(logsumexp(np.where(unknown, by_family, -np.inf))) - known
    whole = float(np.logaddexp(0.0, logsumexp(by_family)))
    standing, richer = {}, {}
    for i, key in enumerate(causes):
        gone = np.array([i in members for members in sets])[:, None]
        lost = float(logsumexp(np.where(gone & ~same[i], log_weights, -np.inf)))
        standing[key] = float(1.0 - np.exp(min(lost - whole, 0.0)))
        mine = np.where(same[i], by_family, -np.inf)
        if mine.max(initial=-np.inf) > max(0.0, whole - RICHER):
            richer[key] = found[int(np.argmax(mine))].words
    return Outside(log_odds, best.words, best.stage, best.element, standing, richer)


def _spread_of_noise(ports: Ports, z: Array) -> Array:
    """RMS of every component of the residual (m,), over that of all."""
    r = ports.target - np.einsum("pnm,p->nm", ports.base, z)
    each = np.mean(r**2, axis=0)
    return np.asarray(np.sqrt(np.maximum(each / max(float(each.mean()), 1e-300), LEAST_SPREAD)))


def _spread(count: int) -> NDArray[np.intp]:
    """At most :data:`MOST_ROWS` rows, evenly spread."""
    if count <= MOST_ROWS:
        return np.arange(count)
    return np.linspace(0, count - 1, MOST_ROWS).astype(np.intp)


@dataclass(frozen=True, eq=False)
class Contest:
    """A model's columns and the families that compete with them, as products once worked out.

    Attributes:
        G: Gram matrix of the model's columns (P, P).
        b: Their correlation with the target (P,).
        tt: Square of the target.
        n: Number of equations.
        precision: Flat priors for the nuisances, wide ones for the effects (P,).
        groups: Families of equally many columns: which, their blocks (C, k, k), their products
            with the model's columns (P, C, k) and with the target (C, k).
        log_prior: Log odds of one family.
        noise: The prior of the noise.
        log_likelihood: Of the model, noise integrated out, up to what all kinds of noise share.
    """

    G: Array
    b: Array
    tt: float
    n: float
    precision: Array
    groups: tuple[tuple[NDArray[np.intp], Array, Array, Array], ...]
    log_prior: float
    noise: NoisePrior
    log_likelihood: float

    @classmethod
    def of(
        cls,
        ports: Ports,
        found: Sequence[Dependence],
        flat: int,
        noise: NoisePrior,
        spread: Array | None = None,
    ) -> Contest:
        """From a model's columns; those from ``flat`` on are effects.

        Args:
            ports: The model's columns and target, divided by ``spread`` already.
            found: The families.
            flat: First column of an effect.
            noise: The prior of the noise.
            spread: Relative noise of every component of a reading (m,); alike if not given.
        """
        spread = np.ones(ports.target.shape[1]) if spread is None else spread
        A, t = ports.base.reshape(len(ports.base), ports.target.size), ports.target.ravel()
        G, b, tt, n = A @ A.T, A @ t, float(t @ t), float(t.size)
        floor = 1e-11 * max(float(np.diag(G).max(initial=0.0)), 1e-300)
        precision = np.full(len(A), floor)
        left = tt - float(b @ np.linalg.solve(G + np.diag(precision), b)) if len(A) else tt
        precision[flat:] = max(float(noise.variance(max(left, 0.0), n)) / WIDE**2, floor)
        groups = []
        sizes = np.array([len(f.columns) for f in found])
        for k in np.unique(sizes):
            members = np.flatnonzero(sizes == k)
            C = np.stack([(found[int(i)].columns / spread).reshape(k, -1) for i in members])
            cross = np.einsum("pe,cke->pck", A, C, optimize=True)
            groups.append((members, C @ C.transpose(0, 2, 1), cross, C @ t))
        log_prior = float(np.log(PRIOR_ODDS / max(len(found), 1)))
        variance = float(noise.variance(max(left, 0.0), n))
        likely = -0.5 * (noise.freedom + n) * np.log(max(variance, LEAST_VARIANCE))
        likely -= len(ports.target) * float(np.log(spread).sum())
        likely -= 0.5 * float((spread != 1.0).sum()) * np.log(len(ports.target))  # Schwarz (1978)
        return cls(G, b, tt, n, precision, tuple(groups), log_prior, noise, float(likely))

    def weights(
        self, causes: Sequence[NDArray[np.intp]], log_priors: Array
    ) -> tuple[list[tuple[int, ...]], Array]:
        """Sets of causes that give up their place, and log weights (S, F) of every family there.

        Of few causes all sets are tried, of more each alone, all, and all but one, of many each
        alone. Where not all families are tried, they are those that do well in the first sets.
        """
        numbers = range(len(causes))
        few, many = len(causes) <= FEW_CAUSES, len(causes) > MANY_CAUSES
        alone = [(i,) for i in numbers]
        whole = [] if many else [tuple(numbers)]
        thorough = list(dict.fromkeys([(), *whole, *(alone if few else [])]))
        sizes: Sequence[int] = (
            range(1, len(causes)) if few else (1,) if many else (1, len(causes) - 1)
        )
        sets = [c for size in sizes for c in combinations(numbers, size)]
        rest = [gone for gone in sets if gone not in thorough]
        found = [self._in_place_of(gone, causes, log_priors) for gone in thorough]
        count = len(found[0])
        good = {int(i) for w in found for i in np.argsort(-w)[:WORTH_TRYING]}
        narrow = self.only(np.array(sorted(good), dtype=np.intp))
        found += [narrow._in_place_of(gone, causes, log_priors, count) for gone in rest]
        return [*thorough, *rest], np.stack(found)

    def only(self, kept: NDArray[np.intp]) -> Contest:
        """The same contest among fewer families; each keeps its number and its odds."""
        groups = []
        for members, blocks, cross, products in self.groups:
            mine = np.flatnonzero(np.isin(members, kept))
            if len(mine):
                groups.append((members[mine], blocks[mine], cross[:, mine], products[mine]))
        return replace(self, groups=tuple(groups))

    def _in_place_of(
        self,
        gone: tuple[int, ...],
        causes: Sequence[NDArray[np.intp]],
        log_priors: Array,
        count: int | None = None,
    ) -> Array:
        """Log weights (F,) of every family in place of some causes, against the whole model."""
        kept = np.ones(len(self.b), dtype=bool)
        for i in gone:
            kept[causes[i]] = False
        against = 0.0
        beside = _Beside.of(self, kept)
        found = beside.families(count) + self.log_prior
        for i in gone:
            against += beside.cause(causes[i]) + log_priors[i]
            kept = kept.copy()
            kept[causes[i]] = True
            beside = _Beside.of(self, kept)
        return found - against


@dataclass(frozen=True, eq=False)
class _Beside:
    """What some of a model's columns leave of a contest."""

    contest: Contest
    kept: NDArray[np.bool_]
    lower: Array
    hidden: Array
    tt: float
    n: float

    @classmethod
    def of(cls, contest: Contest, kept: NDArray[np.bool_]) -> _Beside:
        A, precision = contest.G[np.ix_(kept, kept)], contest.precision[kept]
        lower = np.asarray(np.linalg.cholesky(A + np.diag(precision)))
        hidden = _solved(lower, contest.b[kept])
        inverse = _solved(lower, np.eye(len(A)))
        used = len(A) - float(np.sum(precision * np.sum(inverse**2, axis=0)))
        tt = max(contest.tt - float(hidden @ hidden), 0.0)
        return cls(contest, kept, lower, hidden, tt, contest.n - used)

    def _evidence(self, blocks: Array, cross: Array, products: Array) -> Array:
        """Log evidence (C,) of blocks (C, k, k) with products (P, C, k) and (C, k)."""
        P, C, k = cross.shape
        seen = _solved(self.lower, cross.reshape(P, C * k)[self.kept]).reshape(
            len(self.hidden), C, k
        )
        block = blocks - np.einsum("pci,pcj->cij", seen, seen, optimize=True)
        b = products - np.einsum("pci,p->ci", seen, self.hidden)
        by_scale = block_evidence(block, b, self.tt, self.n, self.contest.noise)
        return np.asarray(logsumexp(by_scale + LOG_SCALE_WEIGHTS, axis=1))

    def families(self, count: int | None = None) -> Array:
        """Log evidence (F,) of every family; none for those that are not tried."""
        groups = self.contest.groups
        out = np.full(count or sum(len(g[0]) for g in groups), -np.inf)
        for members, blocks, cross, products in groups:
            out[members] = self._evidence(blocks, cross, products)
        return out

    def cause(self, columns: NDArray[np.intp]) -> float:
        """Log evidence of one cause of the model beside what is kept."""
        contest = self.contest
        block = contest.G[np.ix_(columns, columns)][None]
        cross = contest.G[:, None, columns]
        return float(self._evidence(block, cross, contest.b[columns][None])[0])


def _solved(lower: Array, values: Array) -> Array:
    """What a triangular factor (K, K) makes of columns (K, ...); of none, none."""
    if not len(lower):
        return values
    return np.asarray(solve_triangular(lower, values, lower=True))
