r"""Links added up, covariances counted to both sides in halves.

.. math:: E|e|^2 = \Big|\sum_k b_k\Big|^2 + \sum_{kl} \operatorname{tr} C_{kl}, \qquad
          s_k = \frac{b_k \cdot \sum_l b_l + \sum_l \operatorname{tr} C_{kl}}{E|e|^2}

the allocation of Euler (Tasche 1999, Risk contributions and performance measurement, sec. 3): the
shares sum to one. Their intervals are those of draws of every mean and of every covariance's size,
:math:`C_k\, \nu_k / \chi^2_{\nu_k}`.

What a gap budget says: parts that sum to one, now and after the cure, and what to mend first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.budget.constants import DRAWS, ROUNDING
from plumbline.optim.budget.sources import Source
from plumbline.optim.core.answer import Answer
from plumbline.optim.core.constants import SIDES
from plumbline.optim.core.judged import Judgement, root_of
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import percent, quantity

COLUMNS = ("link", "alone", "share", "95 %", "cured", "share then", "95 % then", "to gain")


@dataclass(frozen=True)
class Part:
    """One link of the chain."""

    name: str  # its name
    # its share of the mean square error, covariances with others in halves; of links that
    # compensate each other it may be below nought
    share: float
    interval: tuple[float, float]  # 95 % of the shares that its own uncertainty allows
    rms: float  # RMS of its own error, were it alone [m]
    rms_after: float  # the same after the cure [m]
    share_after: float  # its share after all cures
    interval_after: tuple[float, float]  # 95 % of that
    # by how much the RMS falls if this link alone is mended, or taken away where nothing mends it
    # [m]
    gain: float
    curable: bool  # whether something mends it
    origin: str = ""  # where its figures are from


@dataclass(frozen=True)
class Budget(Answer):
    """Who contributes how much to the error."""

    parts: tuple[Part, ...]  # the links in the order of the chain
    rms: float  # RMS of the error now [m]
    interval: tuple[float, float]  # 95 % of it [m]
    rms_after: float  # RMS after all cures [m]
    interval_after: tuple[float, float]  # 95 % of it [m]
    points: int  # at how many points it was taken

    @property
    def first(self) -> tuple[Part, ...]:
        """What to mend first: links by how far the error falls."""
        return tuple(sorted(self.parts, key=lambda part: -part.gain))

    def to_gain(self, length: float = 1e-4) -> dict[str, float]:
        """What each link must come down to, alone, for the whole to fall by so much [m].

        Args:
            length: By how much the RMS shall fall [m].

        Returns:
            RMS of the link's own error by its name, the one that must fall least first; links that
            cannot do it alone are left out.

        Raises:
            PlumblineError: No length between nought and the error now.
        """
        if not 0.0 < length < self.rms:
            raise fault("budget", f"{length} m", f"0 to {self.rms:.3g} m", "ask for another gain")
        scales = {part.name: _scale(part, self.rms, length) for part in self.parts}
        can = {name: s for name, s in scales.items() if s is not None}
        own = {part.name: part.rms for part in self.parts}
        return {name: can[name] * own[name] for name in sorted(can, key=lambda n: -can[n])}

    def next_step(self, length: float = 1e-4) -> str:
        """The same in words."""
        if not 0.0 < length < self.rms:
            return f"All of it is less than {quantity(length, 'm')}."
        now = {part.name: part.rms for part in self.parts}
        ways = [
            f"{name} from {quantity(now[name], 'm')} to {quantity(goal, 'm')}"
            for name, goal in self.to_gain(length).items()
        ]
        return (
            f"For the next {quantity(length, 'm')}: " + (", or ".join(ways) or "no link alone will")
        ) + "."

    @property
    def judged(self) -> Judgement:
        """Nothing is solved here: sums alone."""
        return Judgement()

    @property
    def headline(self) -> str:
        """The error now and after, and what to mend first."""
        sizes = " -> ".join(quantity(v, "m") for v in (self.rms, self.rms_after))
        return f"{sizes}; mend {self.first[0].name[:60]} first ({percent(self.first[0].share)})"

    def __repr__(self) -> str:
        return f"<Budget of {len(self.parts)} links: {self.headline}>"

    def table(self) -> str:
        """The links as lines of plain text."""
        rows = [COLUMNS, *(row_of(part) for part in self.parts)]
        whole = (quantity(self.rms, "m"), "100 %", "", quantity(self.rms_after, "m"), "100 %")
        rows.append(("all", *whole, "", ""))
        widths = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
        return "\n".join(
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )


def _scale(part: Part, rms: float, length: float) -> float | None:
    """The share of its own error that a link may keep; None if it cannot save that alone."""
    own, square = part.rms**2, rms**2
    cross = part.share * square - own  # with all other links
    # own s^2 + 2 cross s + rest = goal, at the root below one that is nearest to it
    roots = np.roots([own, 2.0 * cross, square - own - 2.0 * cross - (rms - length) ** 2])
    fit = [float(z.real) for z in roots if abs(z.imag) < ROUNDING and 0.0 <= z.real < 1.0]
    return max(fit, default=None)


def row_of(part: Part) -> tuple[str, ...]:
    """A link as the cells of :data:`COLUMNS`."""
    now, then = (" to ".join(map(percent, v)) for v in (part.interval, part.interval_after))
    after = quantity(part.rms_after, "m") if part.curable else "no cure"
    own = (part.name, quantity(part.rms, "m"), percent(part.share), now, after)
    return (*own, percent(part.share_after), then, quantity(part.gain, "m"))


def add_up(
    sources: Sequence[Source],
    together: Mapping[tuple[str, str], ArrayLike] | None = None,
    *,
    seed: int = 0,
) -> Budget:
    """The budget of links.

    Args:
        sources: The links in the order of the chain; those told at N points, and those that are the
            same everywhere.
        together: Cross-covariances (3, 3) [m^2] of two links by their names, of the first's error
            with the second's, where they are not independent. They last as long as neither is
            cured.
        seed: Of the draws behind the intervals.

    Raises:
        PlumblineError: No link, two of one name, other numbers of points, or links that are
            together but not there.
    """
    names = [source.name for source in sources]
    points = _points(sources, names)
    cross = _cross(together or {}, names)
    now = _Sum(sources, cross)
    cured = [source.cured or source for source in sources]
    lasting = {(a, b): C for (a, b), C in cross.items()
               if sources[a].cured is None and sources[b].cured is None}  # fmt: skip
    after = _Sum(cured, lasting)
    rng = np.random.default_rng(seed)
    drawn, squares = now.drawn(rng)
    drawn_after, squares_after = after.drawn(rng)
    spans, spans_after = (np.quantile(d, SIDES, axis=0).T for d in (drawn, drawn_after))
    square, square_after = now.parts().sum(), after.parts().sum()
    shares, shares_after = now.parts() / _some(square), after.parts() / _some(square_after)
    gains = [_gain(sources, cross, k) for k in range(len(sources))]
    parts = tuple(
        Part(
            name=name,
            share=float(shares[k]),
            interval=(float(spans[k, 0]), float(spans[k, 1])),
            rms=now.alone(k),
            rms_after=after.alone(k),
            share_after=float(shares_after[k]),
            interval_after=(float(spans_after[k, 0]), float(spans_after[k, 1])),
            gain=gains[k],
            curable=sources[k].cured is not None,
            origin=sources[k].origin,
        )
        for k, name in enumerate(names)
    )
    return Budget(
        parts=parts,
        rms=_root(square),
        interval=_interval(squares),
        rms_after=_root(square_after),
        interval_after=_interval(squares_after),
        points=points,
    )


class _Sum:
    """Mean squares of links and of all of them, over the points.

    With means m + R u, u a draw, products of two links' means are quadratic in the draws: averages
    over the points are taken once, whatever the number of draws.
    """

    def __init__(self, sources: Sequence[Source], cross: Mapping[tuple[int, int], Array]) -> None:
        count = max(source.points for source in sources)
        m = np.array([np.broadcast_to(s.mean, (count, 3)) for s in sources])
        roots = [root_of(s.mean_covariance) for s in sources]
        R = np.array([np.broadcast_to(root, (count, 3, 3)) for root in roots])
        self.products = np.einsum("kni,lni->kl", m, m) / count
        self.slopes = np.einsum("knij,lni->klj", R, m) / count
        self.bends = np.einsum("knij,lnim->kljm", R, R, optimize=True) / count
        own = [np.trace(s.covariance, axis1=1, axis2=2).mean() for s in sources]
        self.traces = np.diag(own)
        for pair, C in cross.items():
            self.traces[pair] = self.traces[pair[::-1]] = np.trace(C)
        self.dof = np.array([source.dof for source in sources])

    def parts(self) -> Array:
        """What each link contributes to the mean square (K,) [m^2]."""
        return np.asarray((self.products + self.traces).sum(axis=1))

    def alone(self, k: int) -> float:
        """RMS of one link's error, were it alone [m]."""
        return _root(float(self.products[k, k] + self.traces[k, k]))

    def drawn(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Shares (D, K) and mean squares (D,) as the links' uncertainties allow."""
        # One draw a link: a mean is off everywhere by what the same parameters do.
        u = rng.standard_normal((DRAWS, len(self.dof), 3))
        half = np.einsum("dkj,klj->dkl", u, self.slopes)
        bent = np.einsum("dkj,kljm,dlm->dkl", u, self.bends, u, optimize=True)
        dots = self.products + half + half.transpose(0, 2, 1) + bent
        root = np.sqrt(np.column_stack([_sizes(dof, rng) for dof in self.dof]))
        parts = (dots + root[:, :, None] * root[:, None, :] * self.traces).sum(axis=2)
        squares = parts.sum(axis=1)
        return parts / np.maximum(squares, np.finfo(float).tiny)[:, None], squares


def _sizes(dof: float, rng: np.random.Generator) -> Array:
    return np.ones(DRAWS) if np.isinf(dof) else np.asarray(dof / rng.chisquare(dof, DRAWS))


def _gain(sources: Sequence[Source], cross: Mapping[tuple[int, int], Array], k: int) -> float:
    """How far the RMS falls if one link is cured, or taken away where it has no cure [m]."""
    gone = Source.of(sources[k].name)
    others = [source if i != k else source.cured or gone for i, source in enumerate(sources)]
    kept = {pair: C for pair, C in cross.items() if k not in pair}
    return _root(_Sum(sources, cross).parts().sum()) - _root(_Sum(others, kept).parts().sum())


def _points(sources: Sequence[Source], names: Sequence[str]) -> int:
    if not sources:
        raise fault("budget", "no link", "at least one", "give its sources")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise fault("budget", f"two links {twice[0]!r}", "one a name", "rename one of them")
    counts = {source.points for source in sources} | {
        source.cured.points for source in sources if source.cured is not None
    }
    if len(counts - {1}) > 1:
        told = " and ".join(map(str, sorted(counts)))
        raise fault("budget", f"links at {told} points", "as many", "take the same points")
    return max(counts)


def _cross(
    together: Mapping[tuple[str, str], ArrayLike], names: Sequence[str]
) -> dict[tuple[int, int], Array]:
    found: dict[tuple[int, int], Array] = {}
    for (one, two), values in together.items():
        C = np.asarray(values, dtype=float)
        if one not in names or two not in names or one == two:
            known = ", ".join(names)
            raise fault(
                "budget, together", f"{one!r} and {two!r}", f"two of {known}", "check names"
            )
        if C.shape != (3, 3) or not np.isfinite(C).all():
            raise fault("budget, together", f"shape {C.shape}", "(3, 3), finite", "give m^2")
        found[names.index(one), names.index(two)] = C
    return found


def _root(square: float) -> float:
    return float(np.sqrt(max(square, 0.0)))


def _some(square: float) -> float:
    return max(float(square), float(np.finfo(float).tiny))


def _interval(squares: Array) -> tuple[float, float]:
    low, high = np.sqrt(np.maximum(np.quantile(squares, SIDES), 0.0))
    return float(low), float(high)
