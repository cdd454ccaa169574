"""The held-out gap as the causes go into the model one by one: the staircase of a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.optim.diagnosis.findings import (
    Key,
    Step,
)
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.pool import Pool, settled
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.held_out import (
    Evaluation,
    counted_rows,
    square_with,
)
from plumbline.optim.diagnosis.verdict.words import blame_of
from plumbline.optim.recording.recording import Recording


@dataclass(frozen=True, eq=False)
class Stairs:
    """Held-out figures of some of the causes, by the linear problem about the final fit.

    That of all causes is the gap's own, of true residuals; what the linear problem says of fewer is
    told by its ratio to what it says of all.
    """

    pool: Pool  # the chosen effects alone
    terms: list[SelectedTerm]  # the terms in it
    variance: float  # noise variance that weighs their priors
    # the rows that the figures are of, fold by fold; only what the gap is counted in
    rows: list[Linear]
    after: float  # held-out RMS with all causes, the gap's

    @classmethod
    def of(cls, recording: Recording, selected: SelectedModel, evaluation: Evaluation) -> Stairs:
        """Linearised about the final fit, once."""
        pool, terms = settled(selected.pool, selected.chosen, selected.best.x)
        rows = counted_rows(recording, pool, evaluation)
        variance = selected.selection.variance(selected.chosen)
        return cls(pool, terms, variance, rows, evaluation.rms_after)

    def figure(self, keys: Sequence[Key]) -> float:
        """Held-out RMS with these causes and no others."""
        some = [c for c in self.terms if self.pool.candidates[c.index].key in keys]
        square, least = (
            square_with(self.pool, t, self.variance, self.rows) for t in (some, self.terms)
        )
        return self.after * float(np.sqrt(square / least)) if least > 0.0 else self.after

    @property
    def keys(self) -> list[Key]:
        """All causes."""
        return list(dict.fromkeys(c.key for c in self.pool.candidates))


def staircase(
    stairs: Stairs, keys: Sequence[Key], evaluation: Evaluation, first: str
) -> tuple[Step, ...]:
    """The held-out gap before any cause, then with each cause added to those before it."""
    steps = [Step(first, evaluation.rms_before)]
    for k, key in enumerate(keys, start=1):
        label = blame_of(key, stairs.pool.candidates).label
        steps.append(Step(label, stairs.figure(keys[:k])))
    return tuple(steps)


def always_words(recording: Recording) -> str:
    """What is fitted before any cause, as the first bar of the staircase says it."""
    if recording.kind.efforts:
        return "before"
    if recording.element is not None and not set(recording.always) - {"frame", "tool"}:
        ranges = recording.kind.ranges
        return "beam and planes alone" if ranges else "rigid transform alone"
    effects = set(recording.always) - {"frame", "tool"}
    if recording.kind.encoders:
        return "zeros of the encoders alone" if effects == {"joint_offset"} else "before"
    sockets = recording.kind.sockets  # which no frame is needed for
    fitted = {"tool"} if sockets else {"frame", "tool"}
    if effects or not fitted <= set(recording.always):
        return "before"
    return "sockets and tool alone" if sockets else "frame and tool alone"
