"""How well a joint's causes foretell what no fit has seen: whole groups or stretches left out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.diagnosis.motion.carried import NOTHING
from plumbline.optim.diagnosis.motion.carrying import drives_of_all
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED, SEARCH_ITERATIONS
from plumbline.optim.diagnosis.motion.fit import JointFit, evaluated, fitted
from plumbline.optim.diagnosis.motion.masses import Telling, fitted_mass
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.settled import carrying
from plumbline.optim.diagnosis.motion.signals import Integers, Signals, spread
from plumbline.optim.diagnosis.motion.windows import Array, Drives, Effects


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Mean squares of windows that were left out (W,) [rad^2], of one joint."""

    starts: Integers  # where the windows start (W,)
    before: Array  # of the ideal drive
    after: Array  # of the causes
    without: Mapping[str, Array]  # of all causes but one, by its name
    residual_before: Array  # residuals (W, K) of the ideal drive [rad]
    residual_after: Array  # residuals (W, K) of the causes [rad]
    carrying: Array | None = None  # of the ideal drive and a mass; None where none was found

    def over(self, lever: float) -> Self:
        """Mean squares of places that are divided by so much; residuals stay."""
        square = lever**2
        without = {name: one / square for name, one in self.without.items()}
        carrying = None if self.carrying is None else self.carrying / square
        return replace(
            self, before=self.before / square, after=self.after / square, without=without,
            carrying=carrying,
        )  # fmt: skip

    @property
    def begun(self) -> Array:
        """Of the ideal drive, with a mass that is carried (W,) [rad^2]."""
        return self.before if self.carrying is None else self.carrying


def left_out(signals: Signals, joints: Sequence[JointFindings]) -> tuple[LeftOut, ...]:
    """Every fold's windows, by fits of the causes to all others, joint by joint."""
    if not signals.recording.carried.bodies:
        return tuple(side_by_side(lambda joint: _left_out(signals, joint), joints))
    drives, carried = drives_of_all(joints, signals.recording.n), signals.recording.carried
    shifts = [_moved(signals, drives, *fold) for fold in _folds(signals)]
    others = {body.label: carrying(signals, carried.without(body)) for body in carried.bodies}
    plain = carrying(signals, NOTHING)

    def judged(joint: JointFindings) -> LeftOut:
        return _with_mass(plain, others, _left_out(signals, joint, shifts), joint)

    return tuple(side_by_side(judged, joints))


def _moved(signals: Signals, drives: Drives, fit: Integers, judge: Integers) -> list[Array]:
    """What masses that were fitted without a fold change there, joint by joint (W, K) [rad]."""
    own, now = Telling(signals, drives, fit), signals.recording.carried
    shift = own.numbers(fitted_mass(own, now, clock=False).carried) - own.numbers(now)
    there = Telling(signals, drives, judge)
    return [(one.mass @ shift).reshape(one.residual.shape) for one in there.joints]


def _with_mass(
    plain: Signals, others: Mapping[str, Signals], judged: LeftOut, joint: JointFindings
) -> LeftOut:
    """The same with what all is like without any mass, and without each of them."""
    ideal = _refitted(plain, joint, (), np.empty(0))
    own = joint.fit.effects, joint.fit.theta
    without = {
        label: np.mean(_refitted(other, joint, *own) ** 2, axis=1)
        for label, other in others.items()
    }
    return replace(
        judged, before=np.mean(ideal**2, axis=1), residual_before=ideal, carrying=judged.before,
        without={**judged.without, **without},
    )  # fmt: skip


def _refitted(signals: Signals, joint: JointFindings, effects: Effects, theta: Array) -> Array:
    """Residuals (W, K) [rad] of each fold by effects fitted to all others."""
    parts = []
    for fold in _folds(signals):
        fit, judge = (signals.windows(joint.number - 1, starts) for starts in fold)
        there = fitted(fit, effects, theta, SEARCH_ITERATIONS).theta
        parts.append(evaluated(judge, effects, there, slopes=False).residual)
    return np.concatenate(parts)


def _left_out(
    signals: Signals, joint: JointFindings, shifts: Sequence[Sequence[Array]] = ()
) -> LeftOut:
    """The same of one joint, what a mass changes in each fold going in."""
    j, found = joint.number - 1, joint.fit
    parts = [_fold(signals, j, found, *fold) for fold in _folds(signals)]
    for part, moved in zip(parts, shifts, strict=bool(shifts)):
        part[2][:] += moved[j]
        for less in part[3]:
            less += moved[j]
    names = [e.name for e in found.effects]
    joined = [np.concatenate([p[k] for p in parts]) for k in range(3)]
    without = {
        name: np.concatenate([np.mean(p[3][k] ** 2, axis=1) for p in parts])
        for k, name in enumerate(names)
    }
    before, after = (np.mean(joined[k] ** 2, axis=1) for k in (1, 2))
    return LeftOut(joined[0].astype(np.int64), before, after, without, joined[1], joined[2])


def _folds(signals: Signals) -> Iterator[tuple[Integers, Integers]]:
    """Starts of the windows to fit and of those to judge by, fold by fold."""
    folds, starts = signals.folds, signals.starts
    judged = [k for k in np.unique(folds) if k >= 0]
    for k in judged:
        yield (
            spread(starts[folds != k], signals.most),
            spread(starts[folds == k], MOST_JUDGED // len(judged)),
        )


def _fold(
    signals: Signals, j: int, found: JointFit, fit: Integers, judge: Integers
) -> tuple[Array, Array, Array, list[Array]]:
    training, test = signals.windows(j, fit), signals.windows(j, judge)

    def missed(effects: Effects, start: Array) -> Array:
        theta = fitted(training, effects, start, SEARCH_ITERATIONS).theta
        return evaluated(test, effects, theta, slopes=False).residual

    less = [
        missed(tuple(e for e in found.effects if e != one), np.delete(found.theta, k))
        for k, one in enumerate(found.effects)
    ]
    whole = fitted(training, found.effects, found.theta)
    after = evaluated(test, found.effects, whole.theta, slopes=False).residual
    return judge.astype(float), missed((), np.empty(0)), after, less
