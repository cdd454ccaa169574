"""How well a joint's causes foretell what no fit has seen: whole groups or stretches left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED, SEARCH_ITERATIONS
from plumbline.optim.diagnosis.motion.fit import JointFit, evaluated, fitted
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.signals import Integers, Signals, spread
from plumbline.optim.diagnosis.motion.windows import Array, Effects


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Mean squares of windows that were left out (W,) [rad^2], of one joint."""

    starts: Integers  # where the windows start (W,)
    before: Array  # of the ideal drive
    after: Array  # of the causes
    without: Mapping[str, Array]  # of all causes but one, by its name
    residual_before: Array  # residuals (W, K) of the ideal drive [rad]
    residual_after: Array  # residuals (W, K) of the causes [rad]

    def over(self, lever: float) -> LeftOut:
        """Mean squares of places that are divided by so much; residuals stay."""
        square = lever**2
        without = {name: one / square for name, one in self.without.items()}
        return replace(
            self, before=self.before / square, after=self.after / square, without=without
        )


def left_out(signals: Signals, joint: JointFindings) -> LeftOut:
    """Every fold's windows, by fits of the joint's causes to all others."""
    j, found = joint.number - 1, joint.fit
    parts = [_fold(signals, j, found, *fold) for fold in _folds(signals)]
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

    n = range(len(found.effects))
    less = [missed(_without(found.effects, found.effects[k]), np.delete(found.theta, k)) for k in n]
    whole = fitted(training, found.effects, found.theta)
    after = evaluated(test, found.effects, whole.theta, slopes=False).residual
    return judge.astype(float), missed((), np.empty(0)), after, less


def _without(effects: Effects, one: MotionEffect) -> Effects:
    return tuple(e for e in effects if e != one)
