r"""What may be at work besides the chosen causes, in one linear problem about the fit.

Beside every candidate of the library stand the unlisted mechanisms of
:mod:`plumbline.optim.diagnosis.discrepancy.dependences`, rows that may be gross, and one shift of
the tool that such rows may share. The prior probability that a term is of no effect of the library
is one number u, shared alike among kinds of dependence, then elements, then forms that no effect of
the library has; that shares 1 - u as it does without (Kennedy and O'Hagan 2001, JRSS B 63(3), on
why there must be one).
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.discrepancy.dependence import Dependence, OfAnySize
from plumbline.optim.diagnosis.discrepancy.dependences import dependences
from plumbline.optim.diagnosis.discrepancy.design import FamilyDesign, looks
from plumbline.optim.diagnosis.discrepancy.listed import listed_at, not_listed
from plumbline.optim.diagnosis.discrepancy.resembling import resembled, resembling
from plumbline.optim.diagnosis.discrepancy.spectra import Spectrum, orders_of, spectra
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.linearise.linear import Columns, Linear
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.correlation import Left
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.joint_problem import JointProblem, Parts
from plumbline.optim.diagnosis.posterior.parts import Mechanism, apart
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import LEAST_SPREAD, NOISE_NEGLIGIBLE
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import row_numbers

Names = tuple[tuple[Mechanism, ...], tuple[tuple[str, int | None], ...], tuple[str, ...]]
GROSS: Mechanism = ("", None, "", None)  # a row on its own, which has no place


@dataclass(frozen=True, eq=False)
class Unlisted(OfAnySize):
    """A mechanism that the library lacks, as columns of the linear problem."""

    family: Dependence  # what it depends on, and where
    columns: Columns  # its columns (k,)

    @property
    def limits(self) -> Array:
        """Any size is possible (k, 2), but of what resembles an effect only its sizes."""
        return np.array(self.family.limits) if self.family.limits else super().limits


@dataclass(frozen=True, eq=False)
class GrossRow(OfAnySize):
    """A row that may be displaced on its own."""

    row: int  # its number, from 0
    columns: Columns  # its columns (m,)


AnyTerm = Candidate | Unlisted | GrossRow | Spectrum


@dataclass(frozen=True, eq=False)
class Alternatives:
    """The joint problem and what its terms and labels mean."""

    problem: JointProblem  # what is sampled
    # names of the labels of its first level: stage, element, dependence, effect
    mechanisms: tuple[Mechanism, ...]
    # names of the labels of its second level: stage and element
    places: tuple[tuple[str, int | None], ...]
    # names of the labels of its third level: what each unlisted mechanism says; the last level is
    # whether a term is of no effect of the library
    words: tuple[str, ...]
    library: int  # how many of the terms are the pool's candidates; they come first
    rows: NDArray[np.intp]  # numbers of the rows that are looked at (n,)
    # what some terms, at their widths, leave and take up of these rows, at a noise variance
    left: Callable[[Sequence[SelectedTerm], float], Left]
    # how far blocks (n,) of these rows agree about some terms; 1 if wholly
    agreement: Callable[[NDArray[np.intp], Sequence[SelectedTerm], float], float]
    spread: Array  # of the noise of each component (m,), in which that is
    # candidates of the pool that stand for all orders of a gear in a fit
    orders: Callable[[Effect], Sequence[SelectedTerm]] = lambda _: ()

    def term(self, index: int) -> AnyTerm:
        """A term by its number."""
        found = self.problem.candidates[index]
        assert isinstance(found, AnyTerm)
        return found

    def listed(self, state: Sequence[SelectedTerm]) -> tuple[SelectedTerm, ...]:
        """The pool's candidates in a state, single orders in place of a whole spectrum."""
        found = {t.index: t for t in state if t.index < self.library}
        for term in state:
            if isinstance(own := self.problem.candidates[term.index], Spectrum):
                found = {t.index: t for t in self.orders(own.effect)} | found
        return tuple(found.values())

    def with_spectra(self, state: Sequence[SelectedTerm]) -> list[SelectedTerm]:
        """A state with a gear's whole spectrum in place of all orders that it has of it."""
        causes, terms = self.problem.labels[0], self.problem.candidates
        whole = {causes[k]: k for k, term in enumerate(terms) if isinstance(term, Spectrum)}
        mine = dict.fromkeys(whole[causes[t.index]] for t in state if causes[t.index] in whole)
        rest = (t for t in state if causes[t.index] not in whole)
        return [*rest, *(SelectedTerm(k, 1.0) for k in mine)]

    @property
    def kinds(self) -> Array:
        """Of every mechanism (L,) the number of its kind: what depends on the same at one place."""
        kinds = [m[:3] for m in self.mechanisms]
        return np.array([kinds.index(kind) for kind in kinds])

    @property
    def gross_rows(self) -> dict[int, list[int]]:
        """Numbers of the terms of rows that may be gross, by row."""
        found: dict[int, list[int]] = {}
        for i, term in enumerate(self.problem.candidates):
            if isinstance(term, GrossRow):
                found.setdefault(term.row, []).append(i)
        return found


def alternatives(pool: Pool, chosen: Sequence[SelectedTerm], unlisted: float) -> Alternatives:
    """Everything that may be at work, about the fit of a pool.

    Args:
        pool: The candidates of the library, linearised.
        chosen: Those that a search has chosen: what unlisted mechanisms are tried with.
        unlisted: Prior probability that a term is of no effect of the library.
    """
    rows = rows_compared(pool)
    ports = Ports.about(pool.model, pool.x, rows, pool.always)
    recording = pool.model.recording.select(rows)
    found = _families(pool, recording, ports)
    shares = _log_shares(found)
    design = _design(pool, chosen, ports, rows, found, shares + np.log(unlisted))
    listed = resembled(pool, looks(pool, chosen))

    def without(near: Candidate) -> Callable[[Array], Array]:
        return design.without(ports.base[near.columns], listed_at(pool, ports, near.effect))

    near = list(resembling(listed, found, recording, ports, design.visible, without))
    if near:
        own = np.array([f.log_prior for f in near])
        shares = np.concatenate([shares + np.log1p(-prior.RESEMBLING), own])
        found += near
    gross = ports.own_shifts(parts := 2 if recording.kind.oriented else 1)
    kept = design.worth_trying(found, shares, pool, chosen, gross)
    found, shares = [found[i] for i in kept], shares[kept]
    gears, blocks = spectra(pool, recording, ports)
    design, spans = design.with_listed(blocks)
    added = [*(f.columns for f in found), *gross]
    linear, columns = design.with_more(added)
    terms = _terms(pool, found, columns, np.repeat(rows[ports.gross], parts))
    terms += tuple(map(Spectrum, (pool.candidates[k].effect for k in gears), spans))
    names, numbers = _labels(terms)
    priors = _log_priors(pool, shares, gears, len(terms), unlisted)
    problem = _problem(pool, linear, terms, priors, numbers, _parts(design, ports, names))
    asked = (partial(design.left, added, terms), partial(design.agreement, added, terms))
    orders = cache(partial(orders_of, pool, chosen))
    return Alternatives(problem, *names, len(pool.candidates), rows, *asked, design.spread, orders)


def _families(pool: Pool, recording: Recording, ports: Ports) -> list[Dependence]:
    """What the library may lack: functions at every port, but those that are a listed effect."""
    found = [f for f in dependences(recording, ports) if f.columns.any()]
    if recording.element is None:
        found += list(_shared_shift(recording.chain.placement(recording.q)[:, :3, :3], ports))
    return not_listed(pool, ports, found)


def _terms(
    pool: Pool,
    found: Sequence[Dependence],
    columns: Sequence[NDArray[np.intp]],
    gross: NDArray[np.intp],
) -> tuple[AnyTerm, ...]:
    """The library's candidates, then what it may lack, then gross rows by their numbers.

    Args:
        pool: The candidates.
        found: What the library may lack (F).
        columns: Columns of those, then of the gross rows.
        gross: Numbers of these rows, of each as often as it has parts.
    """
    listed = (replace(c, columns=c.columns - pool.always) for c in pool.candidates)
    lacked = (Unlisted(f, c) for f, c in zip(found, columns, strict=False))
    alone = (GrossRow(int(r), c) for r, c in zip(gross, columns[len(found) :], strict=True))
    return (*listed, *lacked, *alone)


def _log_priors(
    pool: Pool, shares: Array, own: Sequence[int], count: int, unlisted: float
) -> Array:
    """Log priors (C,) of all terms; gross rows have theirs from their number.

    A gear's spectrum is one more form of its cause, as probable as a single order.
    """
    library = pool.selection.log_priors + np.log1p(-unlisted)
    spectra = np.array([pool.candidates[k].log_prior for k in own]) + np.log1p(-unlisted)
    gross = np.full(count - len(library) - len(shares) - len(own), -np.inf)
    return np.concatenate([library, np.log(unlisted) + shares, gross, spectra])


def _problem(
    pool: Pool,
    linear: Linear,
    terms: Sequence[AnyTerm],
    priors: Array,
    numbers: NDArray[np.intp],
    parts: Parts,
) -> JointProblem:
    """The joint problem; its last label is whether a term is of no effect of the library."""
    lacked, gross = (
        np.array([isinstance(t, kind) for t in terms], dtype=bool) for kind in (Unlisted, GrossRow)
    )
    labels = np.vstack([numbers, lacked])
    listed = pool.selection.of_effect
    kinds = np.full(len(terms), -1)
    kinds[: len(listed)] = listed
    names = [c.effect.name for c in pool.candidates]
    for k, term in enumerate(terms):
        if isinstance(term, Spectrum):
            kinds[k] = listed[names.index(term.effect.name)]
    own = kinds >= 0
    mass = np.asarray(np.bincount(kinds[own], np.exp(priors[own])), dtype=float)
    return JointProblem(
        linear, tuple(terms), pool.noise, priors, gross, labels, lacked, parts,
        of_effect=kinds, effect_shares=mass,
    )  # fmt: skip


def _parts(design: FamilyDesign, ports: Ports, names: Names) -> Parts:
    """What tells parts of an unlisted mechanism from causes of their own."""
    mechanisms, places, _ = names

    def beyond(where: frozenset[int]) -> Linear:
        moved = np.concatenate([ports.at(*places[p]) for p in sorted(where)])
        return design.beyond(moved).with_more([])[0]

    return Parts(prior.PART_OF_UNLISTED, apart(mechanisms), beyond)


def _labels(terms: Sequence[AnyTerm]) -> tuple[Names, NDArray[np.intp]]:
    """Mechanisms, places and words of unlisted dependences, and which of each a term has (3, C)."""
    own = [_mechanism(t) for t in terms]
    said = [t.family.words if isinstance(t, Unlisted) else "" for t in terms]
    mechanisms = tuple(dict.fromkeys(own))
    places = tuple(dict.fromkeys(m[:2] for m in own))
    words = tuple(dict.fromkeys(["", *said]))
    numbers = [[mechanisms.index(m) for m in own], [places.index(m[:2]) for m in own]]
    numbers.append([words.index(w) for w in said])
    return (mechanisms, places, words), np.array(numbers, dtype=np.intp)


def _design(
    pool: Pool,
    chosen: Sequence[SelectedTerm],
    ports: Ports,
    rows: NDArray[np.intp],
    found: Sequence[Dependence],
    log_priors: Array,
) -> FamilyDesign:
    """The columns, in units of each component's noise."""
    shared = Linear.about(pool.shared, pool.x, pool.model.problem.scale)
    slot = float(np.log(prior.NEXT_SLOT_ODDS if chosen else prior.FIRST_SLOT_ODDS))

    def unlisted(spread: Array) -> float:
        one = FamilyDesign.of(ports, spread, shared, pool, rows)
        return float(np.logaddexp(0.0, slot + one.most(found, log_priors, pool, chosen)))

    return FamilyDesign.of(
        ports, spread_of_noise(pool, chosen, ports, unlisted), shared, pool, rows
    )


def _mechanism(term: object) -> Mechanism:
    if isinstance(term, Candidate | Spectrum):
        effect: Effect = term.effect
        return str(effect.stage), effect.element, effect.depends_on, effect.name
    if isinstance(term, Unlisted):
        return term.family.stage, term.family.element, term.family.on, None
    return GROSS


def key_of(mechanism: Mechanism) -> Key | None:
    """The cause that a mechanism is; none for what the library lacks."""
    return None if mechanism[3] is None else (mechanism[3], mechanism[1])


def _log_shares(found: Sequence[Dependence]) -> Array:
    """Log prior shares (F,): alike for every kind of dependence, then its elements, then forms."""
    kinds = {(f.stage, f.on) for f in found}
    elements = Counter((stage, on) for stage, _, on in {(f.stage, f.element, f.on) for f in found})
    each = [elements[f.stage, f.on] * len(kinds) for f in found]
    return np.array([f.log_prior for f in found]) - np.log(each)


def rows_compared(pool: Pool) -> NDArray[np.intp]:
    """Rows that are looked at: distrusted ones too, if few and not far off.

    Nothing smooth moves one row by a hundred times what it moves the others; with such a row no
    width of a prior would fit both.
    """
    problem = pool.model.problem
    count = len(pool.model.recording)
    rows = np.arange(count)
    if count > prior.MOST_COMPARED_ROWS:
        rows = np.linspace(0, count - 1, prior.MOST_COMPARED_ROWS).astype(np.intp)
    gross = problem.weights[rows] == 0
    if not gross.any():
        return rows
    if gross.sum() > prior.MOST_GROSS_ROWS or gross.all():
        return rows[~gross]
    missed = np.linalg.norm(Mapped(problem).residuals(pool.x)[rows], axis=1)
    usual = float(np.sqrt(np.mean(missed[~gross] ** 2)))
    return rows[~gross | (missed <= prior.EXTREME * usual)]


def _shared_shift(R_base_tip: Array, ports: Ports) -> list[Dependence]:
    """Rows that may be gross displaced by one shift of the tool: it slipped and came back.

    Which rows was chosen from many, so its share is that of these rows among all as many.
    """
    count, of = int(ports.gross.sum()), len(ports.gross)
    if count < 2 or ports.shift.shape[0] != 3 or not len(ports.body):
        return []
    # In the device's frame the shift is turned as the base's own translation is.
    turned = np.einsum("nkj,knm->jnm", R_base_tip, ports.body[:3])
    columns = prior.USUAL * np.where(ports.gross[:, None], turned, 0.0)
    ways = gammaln(of + 1) - gammaln(count + 1) - gammaln(of - count + 1)
    listed = ", ".join(map(str, row_numbers(ports.gross)))
    words = f"rows {listed}: one shift of the tool explains them"
    return [Dependence(words, "moment", "tool", None, columns, -float(ways))]


def spread_of_noise(
    pool: Pool,
    chosen: Sequence[SelectedTerm],
    ports: Ports,
    unlisted: Callable[[Array], float] | None = None,
) -> Array:
    """RMS of every component of what the causes leave (m,), over that of all; ones if alike.

    Components may be noisier than others, and no mechanism is to be paid for explaining the noise
    of one axis. Unequal noise is taken only where the data ask for it (Schwarz 1978), each kind of
    noise together with what the library may lack: a joint's own encoder may err alone.

    Args:
        pool: The candidates.
        chosen: The causes.
        ports: Of these rows.
        unlisted: Log evidence of what the library may lack, under such a spread.
    """
    columns = pool.columns(chosen)
    A = ports.base[columns][:, ~ports.gross]
    t = ports.target[~ports.gross]
    flat = A.reshape(len(columns), t.size)
    z = np.linalg.lstsq(flat.T, t.ravel(), rcond=1e-10)[0]
    r = t - np.einsum("pnm,p->nm", A, z)
    if not ports.live.all():  # a component is not one thing in rows of several kinds
        return np.ones(r.shape[1])
    noise = pool.noise
    each = np.maximum(np.mean(r**2, axis=0), noise.least**2)
    ratio = each / float(each.mean())
    gain = -0.5 * len(r) * float(np.log(ratio).sum())
    price = 0.5 * (len(ratio) - 1) * np.log(max(len(r), 2)) + NOISE_NEGLIGIBLE
    alike, spread = np.ones(len(ratio)), np.sqrt(np.maximum(ratio, LEAST_SPREAD))
    if gain < price:
        return alike
    if unlisted is not None and unlisted(alike) > gain - price + unlisted(spread):
        return alike
    return np.asarray(spread)
