r"""What torques make of a motion by drives that were found, and by how long a clock leads.

No drive obeys what it was not sent yet: where joints lead their commands, it is by a clock, which
is one. Steps of a simulator that move places by the speed they end with lead by half a step; of
rows that state what acted since the row before, half a row. With each joint's own :math:`d_j < 0`
and its precision :math:`p_j`, the lead is :math:`-\sum p_j d_j / \sum p_j`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects.actuation_delay import ActuationDelay
from plumbline.optim.diagnosis.motion.carrying import refined, states_by
from plumbline.optim.diagnosis.motion.constants import MOVES, WORTH_A_FIT
from plumbline.optim.diagnosis.motion.fit import JointFit, correlation_time, fitted
from plumbline.optim.diagnosis.motion.search import Begun
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of
from plumbline.optim.diagnosis.motion.windows import Array, Effects, Windows


def others(signals: Signals, begun: Sequence[Begun]) -> Iterator[Signals]:
    """The same motion by drives that were found: of a clock that leads, and as told.

    Of a clock that leads by ideal drives first: what was found besides may have stood for its lead,
    and is what neighbours feel.
    """
    was, now = signals.recording.lead, signals
    for _ in range(MOVES):
        fits = {}
        for one in begun:
            if (fit := _leading(one, now, was)) is not None:
                fits[one.number] = fit
        if (lead := _lead(now, list(fits.values()))) == now.recording.lead:
            break
        now = _by(now, begun, (was, lead), fits)
    if now.recording.lead != was:
        yield signals_of(now.recording)
        yield now
    yield as_told(signals, begun)


def as_told(signals: Signals, begun: Sequence[Begun]) -> Signals:
    """The same motion by drives that were found, of a clock that leads as it did."""
    lead = signals.recording.lead
    return _by(signals, begun, (lead, lead), {})


def _by(
    signals: Signals,
    begun: Sequence[Begun],
    leads: tuple[float, float],
    fits: dict[int, JointFit],
) -> Signals:
    """By drives that were found; of those that lead the rest, a clock being what leads."""
    r = signals.recording
    drives: list[tuple[Effects, Array]] = [((), np.empty(0))] * r.n
    for one in begun:
        near = one.near
        if one.number in fits:
            fit = fits[one.number]
            drives[one.number - 1] = fit.effects[:-1], fit.theta[:-1]
        else:
            late = [e.name == ActuationDelay.name for e in near.effects]
            more = (leads[1] - leads[0]) * np.array(late, dtype=float)
            drives[one.number - 1] = near.effects, near.theta + more
    other = replace(r, lead=leads[1], carried=refined(signals, begun))
    if not other.carried.bodies:
        return signals_of(other, drives=tuple(drives))
    return states_by(other, tuple(drives)) or signals


def _leading(one: Begun, signals: Signals, was: float) -> JointFit | None:
    """A joint's drive with one time [s] for delay and lag, the last; None where it is late."""
    effects, theta = one.near.effects, one.near.theta
    times = np.array([e.name == ActuationDelay.name or e.lags > 0 for e in effects], dtype=bool)
    late = float(theta[times].sum())
    if late > 0:
        return None
    kept = tuple(e for e, time in zip(effects, times, strict=True) if not time)
    windows: Windows = signals.windows(one.number - 1, one.quick.windows.start)
    start = np.append(theta[~times], late + signals.recording.lead - was)
    return fitted(windows, (*kept, ActuationDelay()), start)


def _lead(signals: Signals, fits: Sequence[JointFit]) -> float:
    """By how long [s] positions are of later than their rows' times: within a row."""
    told, weight = 0.0, 0.0
    for fit in fits:
        worth = correlation_time(fit.residual) * fit.square
        variance = float(np.linalg.pinv(fit.sums[0])[-1, -1] * worth)
        precision = 1 / variance if variance > 0 else 0.0  # of no command that changes none
        told, weight = told + precision * fit.theta[-1], weight + precision
    was, row = signals.recording.lead, float(np.median(np.diff(signals.recording.time)))
    lead = float(np.clip(was - told / weight, 0.0, row)) if weight else was
    return lead if weight * (lead - was) ** 2 / 2 > WORTH_A_FIT else was
