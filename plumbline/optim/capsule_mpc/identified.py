r"""A plant as a log has it: what was diagnosed axis by axis, fitted again with all axes at once.

The model is that of :mod:`.plant`, rolled out exactly between the rows. Of what it leaves,
:math:`e_k = x_k - \hat x_k(\theta)`, what half a second adds is weighed: places that wander weigh
little,

.. math:: \min_\theta \sum_k \rho\Big(\frac{e_{k+h} - e_k}{s}\Big)
          + \sum_j \frac{(\theta_j - \theta_j^0)^2}{\sigma_j^2}

with the diagnosis as the prior mean :math:`\theta^0`, zero for what axes take of each other, which
no diagnosis axis by axis can see, weights of Huber and s by the median. Steps are Gauss and
Newton's, by differences. A dead band has an edge that no derivative sees: it is scanned, and there
is none unless it takes a twentieth of the square of what is off away. Friction or play that was not
diagnosed stays out: a log hardly tells one from the other.

Drives that turn a shaft about its trocar and slide it lag and rub along its own axes
(:mod:`.shafts`). The same fit is made along these, by rates of where they come to rest, and the one
is kept that leaves less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

import numpy as np

from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.constants import FITTED
from plumbline.optim.capsule_mpc.shafts import Shafts, along
from plumbline.optim.core.problem import Array, Flags

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.motion.recording import MotionRecording

# Times, rates, places, which of them are used, and rows of half a second.
Run = tuple[Array, Array, Array, Flags, int]
Values = dict[str, Array]  # of plants (P, n), and "mix" (P, n, n)


class Axes(Protocol):
    """A ``Plant``, which has more of the kind; each one number or one for every axis."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def delay(self) -> Any:
        """Time until a rate acts [s]."""

    @property
    def lag(self) -> Any:
        """Time constant [s]."""

    @property
    def gain(self) -> Any:
        """Share by which rates are exceeded."""


class Stated(Protocol):
    """A ``Statement``."""

    @property
    def bodies(self) -> Sequence[object]:
        """What moves."""

    @property
    def n(self) -> int:
        """Number of states of all bodies."""


P = TypeVar("P", bound=Axes)


def identified(diagnosed: P, recording: MotionRecording, statement: Stated | None = None) -> P:
    """The plant of a ``tracking`` recording that is nearest to what was diagnosed of it.

    Along the axes of shafts, where drives turn and slide them and the log is nearer to that.
    """
    runs = _runs(recording)
    if not runs:
        return diagnosed
    found, off = _nearest(diagnosed, runs)
    if statement is not None and statement.n == recording.n:
        shafts = Shafts(statement.bodies, 1.0)
        turned, less = _nearest(diagnosed, [_turned(run, shafts, diagnosed) for run in runs])
        more: dict[str, Any] = {"turned": True}
        if less < off:
            return replace(turned, **more)
    return found


def _turned(run: Run, shafts: Shafts, diagnosed: Axes) -> Run:
    """A motion along the axes of shafts: rates by those of where they come to rest."""
    t, u, x, kept, over = run
    late = np.broadcast_to(np.add(diagnosed.delay, diagnosed.lag), x.shape[1:])
    late = np.repeat(late.reshape(-1, 3).mean(axis=1), 3)
    ahead = [np.interp(t + more, t, own) for own, more in zip(x.T, late, strict=True)]
    frames = shafts.frames(x)
    ways = along((frames[1:] + frames[:-1]) / 2, np.diff(x, axis=0))
    way = np.concatenate([0.0 * x[:1], np.cumsum(ways, axis=0)])
    return t, along(shafts.frames(np.column_stack(ahead)), u), way, kept, over


def _nearest(diagnosed: P, runs: list[Run]) -> tuple[P, float]:
    """A plant, and the mean square of what it leaves off [m^2]."""
    n = runs[0][1].shape[1]
    names = (*FITTED, "band")
    first: Values = {k: np.broadcast_to(getattr(diagnosed, k), n).astype(float) for k in names}
    first["mix"] = np.eye(n) + np.diag(np.broadcast_to(np.asarray(diagnosed.gain, float), n))
    found = _fitted(first, first, runs)
    for edges in constants.EDGES:
        found = _fitted(_scanned(found, runs, edges), first, runs)
    off = float((_clipped(_copies(found, 1), runs) ** 2).mean())
    mix = found.pop("mix")
    gain, across = np.diag(mix) - 1.0, mix - np.diag(np.diag(mix))
    more: dict[str, Any] = {**found, "gain": gain, "across": across}
    return replace(diagnosed, **more), off


def _runs(recording: MotionRecording) -> list[Run]:
    """Motions that are longer than a difference."""
    group = np.zeros(len(recording.time)) if recording.group is None else recording.group
    kept = np.ones(len(group), bool) if recording.held_out is None else ~recording.held_out
    found, rows = [], 0
    for number in np.unique(group):
        own = np.flatnonzero(group == number)[: constants.ROWS - rows]
        if len(own) < 2:
            continue
        t = recording.time[own]
        back = max(1, round(constants.OVER / float(np.median(np.diff(t)))))
        if len(own) > 2 * back:
            found.append((t, recording.command[own], recording.q[own], kept[own], back))
            rows += len(own)
    return found


def _left(values: Values, runs: list[Run]) -> Array:
    """What differences of places are off (K, P, n) [m]."""
    found = []
    for t, u, x, kept, back in runs:
        off = x[:, None] - _rolled(values, t, u)
        found.append((off[back:] - off[:-back])[kept[back:] & kept[:-back]])
    return np.concatenate(found)


def _copies(values: Values, count: int) -> Values:
    return {k: np.repeat(v[None], count, axis=0) for k, v in values.items()}


def _scanned(values: Values, runs: list[Run], edges: tuple[float, ...]) -> Values:
    """The same with the likeliest of dead bands so much wider, or none where that is as likely."""
    tried = _copies(values, 1 + len(edges))
    tried["band"] = np.maximum(values["band"] + np.array([-1.0, *edges])[:, None], 0.0)
    off = (_clipped(tried, runs) ** 2).mean(axis=0)
    best = off.argmin(axis=0), np.arange(off.shape[1])
    rows = off[0] / off[best] - 1.0
    return values | {"band": np.where(rows > constants.TELLS, tried["band"][best], 0.0)}


def _clipped(values: Values, runs: list[Run]) -> Array:
    """The sizes of what is off (K, P, n), of readings that leap no more than of others [m]."""
    off = np.abs(_left(values, runs))
    return np.minimum(off, constants.STANDARD * constants.MEDIAN * np.median(off, axis=(0, 1)))


def _fitted(values: Values, first: Values, runs: list[Run]) -> Values:
    """Some steps of Gauss and Newton's."""
    n = len(values["band"])
    sizes = np.array([step for step, _ in FITTED.values()] + [constants.SHARE] * n)
    for _ in range(constants.STEPS):
        tried = _copies(values, 1 + len(sizes))
        for k, name in enumerate(FITTED):
            tried[name][1 + k] += sizes[k]
        for j in range(n):
            tried["mix"][1 + len(FITTED) + j, :, j] += constants.SHARE
        off = _left(tried, runs)
        slopes = (off[:, :1] - off[:, 1:]) / sizes[:, None]
        values = {k: v.copy() for k, v in values.items()}
        for i in range(n):
            _improve(values, first, i, off[:, 0, i], slopes[..., i])
    return values


def _improve(values: Values, first: Values, i: int, off: Array, slopes: Array) -> None:
    """One step of axis i, by what is off (K,) and its slopes (K, p)."""
    s = max(constants.MEDIAN * float(np.median(np.abs(off))), constants.FINEST)
    weight = np.minimum(1.0, constants.STANDARD * s / np.maximum(np.abs(off), s))
    n = len(values["band"])
    sigma = np.array([own for _, own in FITTED.values()] + [constants.ACROSS_AXES] * n)
    sigma[len(FITTED) + i] = constants.GAINS
    here, there = (
        np.array([*(v[name][i] for name in FITTED), *v["mix"][i]]) for v in (values, first)
    )
    # Of each other a log hardly tells friction and play: what was not diagnosed stays out.
    out = [name in ("dry", "play") and not first[name][i] for name in FITTED]
    on = np.flatnonzero(~np.append(out, np.zeros(n, bool)))
    J = slopes[:, on] * weight[:, None]
    H = J.T @ slopes[:, on] / s**2 + np.diag(1.0 / sigma[on] ** 2)
    here[on] += np.linalg.solve(H, J.T @ off / s**2 - (here - there)[on] / sigma[on] ** 2)
    for k, name in enumerate(FITTED):
        values[name][i] = here[k] if name == "offset" else max(here[k], 0.0)
    values["mix"][i] = here[len(FITTED) :]


def _rolled(values: Values, t: Array, u: Array) -> Array:
    """Places (N, P, n) of plants under rates (N, n) that are held, from rest at zero [m]."""
    asked = np.einsum("pij,kj->kpi", values["mix"], u) + values["offset"]
    rate = np.where(np.abs(asked) < values["band"], 0.0, asked)
    dry, lag, play = values["dry"], np.maximum(values["lag"], constants.NO_LAG), values["play"]
    place, behind = (np.zeros((len(t) + 1, *rate.shape[1:])) for _ in range(2))
    for k, dt in enumerate(np.diff(t)):
        way, behind[k + 1] = _moved(behind[k], rate[k], dry, lag, play, dt)
        place[k + 1] = place[k] + way
    then = t[:, None, None] - values["delay"]
    at = np.searchsorted(t, then.ravel(), side="right").reshape(then.shape) - 1
    into = np.where(at < 0, 0.0, then - t[np.maximum(at, 0)])
    at, own = np.maximum(at, 0), np.indices(then.shape)[1:]
    here = (at, *own)
    return np.asarray(place[here] + _moved(behind[here], rate[here], dry, lag, play, into)[0])


def _moved(
    behind: Array, rate: Array, dry: Array, lag: Array, play: Array, dt: Array | float
) -> tuple[Array, Array]:
    """Way after a time, and what each axis is behind by: a rate [m/s], or with play a place [m]."""
    way, after = advanced(behind, rate, dry, lag, dt)
    if not play.any():
        return way, after
    left = np.sign(rate) * np.maximum(np.abs(rate) - dry, 0.0)
    loose = drawn(behind, left, play, lag, dt)
    return np.where(play > 0.0, loose[0], way), np.where(play > 0.0, loose[1], after)


def drawn(
    behind: Array, rate: Array, play: Array, lag: Array, dt: Array | float
) -> tuple[Array, Array]:
    r"""Way after a time of what follows a drive, and what it is behind it by then [m].

    A position loop whose friction stops it at b short of its command, or what stays behind by play,
    goes at :math:`(|d| - b)\, \operatorname{sign} d / T` where it is behind by more than b, and
    rests where not; the drive goes on at its rate.
    """
    left, d = np.broadcast_to(np.asarray(dt, float), np.shape(behind)), np.asarray(behind)
    for _ in range(3):  # it may come to rest, and set off again
        side = np.where(np.abs(d) > play, np.sign(d), 0.0)
        edge = np.sign(rate) * play
        side = np.where((d == edge) & (rate != 0.0), np.sign(rate), side)
        beyond, aim = d - side * play, rate * lag
        turns, goes = side * aim < 0.0, (side == 0.0) & (rate != 0.0)
        rests = lag * np.log1p(-beyond / np.where(turns, aim, -1.0) * turns)
        until = np.where(
            turns, rests, np.where(goes, (edge - d) / np.where(goes, rate, 1.0), np.inf)
        )
        first = np.clip(until, 0.0, left)
        moves = aim + (beyond - aim) * np.exp(-first / lag) + side * play
        after = np.where(side == 0.0, d + rate * first, moves)
        ends = until <= left
        after = np.where(ends & turns, side * play, np.where(ends & goes, edge, after))
        d, left = after, left - first
    return rate * dt - (d - behind), d


def advanced(
    v: Array, rate: Array, dry: Array, lag: Array, dt: Array | float
) -> tuple[Array, Array]:
    r"""Way and speed after a time under a rate, of what lags and rubs, from a speed v.

    The speed goes towards :math:`r - f \operatorname{sign} v`. Where it comes to zero before, it
    goes on from rest, towards what the friction leaves of the rate.
    """
    rests = np.sign(rate) * np.maximum(np.abs(rate) - dry, 0.0)
    aim = np.where(v == 0.0, rests, rate - dry * np.sign(v))
    turns = v * aim < 0.0
    until = np.where(turns, lag * np.log1p(-v / np.where(turns, aim, 1.0)), np.inf)
    first = np.minimum(until, dt)
    rest = dt - first
    fades, again = np.exp(-first / lag), np.exp(-rest / lag)
    way = aim * first + (v - aim) * lag * (1.0 - fades) + rests * (rest - lag * (1.0 - again))
    return way, np.where(rest > 0.0, rests * (1.0 - again), aim + (v - aim) * fades)
