"""A family of what nobody has listed, and how one is made: functions at ports, forms that share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import UNMOVED
from plumbline.optim.diagnosis.linearise.linear import Columns

ANY = (-np.inf, np.inf)  # bounds of what has none


class OfAnySize:
    """A term of the linear problem whose numbers may have any size."""

    columns: Columns  # its columns (k,)

    @property
    def limits(self) -> Array:
        """Any size is possible (k, 2)."""
        return np.array([ANY] * len(self.columns))

    @property
    def widths(self) -> Array:
        """A size is meant to within a decade (S,)."""
        return prior.SCALES


@dataclass(frozen=True, eq=False)
class Dependence:
    """A family of smooth functions, as columns (k, N, m) in units of the usual size.

    Attributes:
        words: On what the error depends, as the verdict says it.
        on: The same in a word or two: ``"own angle"``, ``"load"``, ``"time"``.
        stage: Where it would sit.
        element: Joint or link, from 1, or None.
        columns: Its columns.
        log_prior: Log share among the forms of one dependence; where the data have chosen it from
            many, of these.
        limits: Bounds of each column's number; empty where all may be any.
    """

    words: str
    on: str
    stage: str
    element: int | None
    columns: Array
    log_prior: float = 0.0
    limits: tuple[tuple[float, float], ...] = ()

    def sharing(self, log_prior: float) -> Dependence:
        """The same with another share."""
        kept = self.words, self.on, self.stage, self.element, self.columns
        return Dependence(*kept, log_prior, self.limits)


def one_of(*kinds: Iterable[Dependence]) -> Iterator[Dependence]:
    """Forms of one dependence, which share its odds: kinds of them alike, then the forms of each.

    Beside what may be anything stands what is as simple as a listed effect: the price of a freedom
    that it does not use (MacKay 1992) would else hide it behind a listed effect of another place.
    """
    for forms in (groups := [forms for kind in kinds if (forms := list(kind))]):
        share = -float(np.log(len(forms) * len(groups)))
        yield from (f.sharing(share) for f in forms)


def of_joint(words: str, on: str, j: int, forms: Iterable[Array], ports: Array) -> list[Dependence]:
    """Forms (K, N) of one dependence of the joint j, from 0."""
    return [acting(words, on, "joint", j + 1, form, ports) for form in forms]


def acting(
    words: str, on: str, stage: str, element: int | None, functions: Array, ports: Array
) -> Dependence:
    """Every function (K, N) acting on every port (p, N, m)."""
    columns = prior.USUAL * (functions[:, None, :, None] * ports[None])
    flat = columns.reshape(-1, *ports.shape[1:])
    return Dependence(words, on, stage, element, leading(flat))


def each_joint(words: str, on: str, values: Array, ports: Array) -> list[Dependence]:
    """All joints that have values (N, n), at their ports (n, N, m): as each likes, or all alike."""
    acts = np.abs(values).max(axis=0) > UNMOVED
    own = prior.USUAL * values.T[acts, :, None] * ports[acts]
    forms = [own] if len(own) < 2 else [own, own.sum(axis=0, keepdims=True)]
    return [Dependence(words, on, "joint", None, form) for form in forms]


def leading(columns: Array) -> Array:
    """The same process (k, N, m) in fewer columns: those of its covariance that matter."""
    if len(columns) <= prior.FULLEST:
        return columns
    flat = columns.reshape(len(columns), -1)
    vectors = np.linalg.eigh(flat @ flat.T)[1]
    return np.asarray(
        (vectors[:, -prior.FULLEST :].T @ flat).reshape(prior.FULLEST, *columns.shape[1:])
    )


def levelled(forms: Iterable[Array]) -> list[Array]:
    """Each form (K, N) as it is, and with a constant."""
    both = ((form, np.concatenate([np.ones((1, form.shape[1])), form])) for form in forms)
    return [one for pair in both for one in pair]
