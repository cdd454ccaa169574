r"""What was sent and is not yet carried out: by what is known of the plant, and by what is seen.

Rates r that are sent sum up to places z; through what is known of the plant's lag they come to
:math:`p = z - T v`. What is measured is, with an origin c that wanders as the stated noise lets it,

.. math:: y_k = c_k + \gamma\, p(t_k - d - \tau) + e_k

so the state comes to rest :math:`\gamma\, (z - p(t_k - d - \tau))` beyond y, if nothing more is
sent. The delay d is what was told; :math:`\tau`, one for every body, is how much later it is, or
sooner, and :math:`\gamma` is an axis' gain. Both are looked for as the loop runs. The innovations
of y and of p, by the same Kalman filter of c, are :math:`\tilde y` and
:math:`\tilde p_\tau`, and

.. math:: J(\tau) = \min_\gamma \sum_k \frac{(\tilde y_k - \gamma\, \tilde p_{\tau, k})^2}{s_k^2}
          + \frac{(\gamma - 1)^2}{\sigma_\gamma^2} + \frac{\tau^2}{\sigma_\tau^2}

on a grid, refined by a parabola. Rows that no :math:`\tau` explains within three standard errors
count the less, by the square of how far they are off: a load that came on, or a drive that stuck,
tells of no lateness. The sum forgets by the way gone: nothing is learnt at rest, and nothing lost.
Every :math:`\tau` with :math:`J - \min J \le 9\, \max(1, \min J / N)` may be true;
how far the state may come to rest from where it is thought to, by any of them, is a bias that the
distances are widened for. At the beginning that is all that was sent.

A body that is seen in one place to the last bit, since :math:`t_0`, is seen no more, because its
reading repeats itself or it is held, where by the latest :math:`\tau` that was possible then its
tip went on by more than is kept between two,

.. math:: |\Delta p| - \tfrac{1}{10}\, v_{max}\, (t - t_0) > d_s

axis by axis, with what the dry friction of a drive that nobody told may keep a slow one from. It
stays so until it is seen elsewhere, and what was learnt of it meanwhile is forgotten.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.constants import TINY
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import Obstacle
from plumbline.optim.capsule_mpc.compiled import Compiled
from plumbline.optim.capsule_mpc.events import Event, acts_late, astray, unseen
from plumbline.optim.capsule_mpc.linearised import norms
from plumbline.optim.capsule_mpc.obeying import Obeying
from plumbline.optim.capsule_mpc.planning import tracked_function
from plumbline.optim.capsule_mpc.plant import Plant
from plumbline.optim.capsule_mpc.shafts import Shafts, along, back
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.core.problem import Array


class Underway:
    """Rates that were sent and are not yet carried out."""

    def __init__(self, plant: Plant, statement: Statement) -> None:
        """For what a statement moves."""
        self.statement, self._parts, self.plant = statement, statement.parts, plant
        n, parts, noise = statement.n, statement.parts, statement.settings.noise
        self.dt = dt = statement.settings.dt
        self._tracked = Compiled(tracked_function(statement.shape), False)
        self._owner = np.repeat(np.arange(len(parts)), [part.stop - part.start for part in parts])
        for name, value in vars(plant).items():
            if name == "turned":
                continue
            shape = (n, n) if name == "across" else (n,)
            if np.shape(value) not in ((), shape):
                raise PlumblineError(
                    f"plant {name}: found shape {np.shape(value)}, expected a number or "
                    f"{str(shape).replace(' ', '')}; give one for each axis"
                )
        delay, self._lag = (np.broadcast_to(np.asarray(v), n) for v in (plant.delay, plant.lag))
        sooner = int(delay.min() / constants.GRAIN + constants.ROUNDING)
        self._later = constants.GRAIN * np.arange(
            -sooner, round(constants.LATEST / constants.GRAIN) + 1
        )
        self._told, self._known = sooner, np.asarray(delay + self._lag)
        back = (delay + self._later[:, None]) / dt  # (T, n), in steps
        self._whole, self._axes = np.floor(back + constants.ROUNDING).astype(int), np.arange(n)
        # How far into the step that ended so many whole ones ago, and what a lag keeps of it.
        self._into = dt * np.minimum(1.0 + self._whole - back, 1.0)
        lag = np.maximum(self._lag, np.finfo(float).tiny)
        self._kept, self._stays = -lag * np.expm1(-self._into / lag), np.exp(-dt / lag)
        self._measured = (constants.MM * noise.measured) ** 2 + constants.SEEN_FROM**2
        self._wanders = ((constants.MM * noise.step) ** 2 + constants.SEEN_FROM**2) / self._measured
        self._shafts = Shafts(statement.bodies, 1 / constants.MM) if plant.turned else None
        self._band = constants.PASSED * np.asarray(plant.band) / statement.unit
        self._banded, self._loose = bool(self._band.any()), bool(np.any(plant.play))
        self._dry = np.asarray(plant.dry) / statement.unit
        self._obeying = Obeying(statement, constants.MM * noise.measured)
        self.reset()

    def reset(self) -> None:
        """Nothing was sent, and nothing seen."""
        n, count = len(self._lag), len(self._later)
        self._sent = np.zeros(n)
        self._side = np.zeros(n)  # of its play, where each axis is [m]
        self._owed = np.zeros(n)  # of what was meant, what a dead band has not done yet
        # Rate, and place and speed through the lag after it, of every step; newest first.
        self._past = np.zeros((int(self._whole.max()) + 2, 3, n))
        self._then = np.zeros((count, n))
        self._origin: Array | None = None  # of y, then of p
        self._spread = 0.0
        self._sums = np.zeros((3, count, n))  # of squares of y, of products, of squares of p
        self._count = np.zeros(n)
        self._gain = np.ones((count, n))
        self.later = np.zeros(len(self._parts))
        self._may = np.ones((count, len(self._parts)), dtype=bool)
        self._place: Array | None = None  # (n,), as seen last
        # Its way (n,) along the axes of the plant, and their frames: there, and ahead of it.
        self._gone: Array | None = None
        self._frames: tuple[Array, Array] | None = None
        # Steps for which each body was seen there, the latest lateness, and the place sent, then.
        self._still = np.zeros(len(self._parts))
        self._latest = np.full(len(self._parts), count - 1)
        self._left = np.zeros(n)
        self._unseen: dict[int, Event] = {}
        self._steps = 0
        self._obeying.reset()
        self._weigh()

    @property
    def late(self) -> Array:
        """How late (n,) rates act [s]."""
        return np.asarray(self._known + self.later[self._owner])

    def sent(self, rate: Array) -> Array:
        """One step on, at whose beginning a rate (n,) is meant; what to send [m/s, or rad/s]."""
        self._steps += 1
        ahead = self._frames[1] if self._frames else None
        rate = self._done(rate if ahead is None else along(ahead, rate))
        speed = rate + (self._past[0, 2] - rate) * self._stays
        self._sent = self._sent + self.dt * rate
        fresh = np.stack([rate, self._sent - self._lag * speed, speed])
        self._past = np.concatenate([fresh[None], self._past[:-1]])
        rates = self._past[self._whole, 0, self._axes]
        places, speeds = (self._past[self._whole + 1, k, self._axes] for k in (1, 2))
        self._then = places + rates * (self._into - self._kept) + speeds * self._kept
        sent = self._out(rate)
        return sent if ahead is None else back(ahead, sent)

    def _done(self, meant: Array) -> Array:
        """Of a rate (n,), what a dead band lets be done: its edge, or nothing, and what is owed.

        What is sent against friction besides moves a tip where there is none: with it, too, a tip
        is no faster than it may be.
        """
        if self._dry.any():
            rubs = self._dry * np.sign(meant)
            meant = self._within(rubs, meant) - rubs
        if not self._banded:
            return meant
        wanted = self._within(meant, np.where(meant == 0.0, 0.0, self._owed / self.dt))
        size = np.abs(wanted)
        edge = np.where(size > self._band / 2, np.sign(wanted) * self._band, 0.0)
        done = np.where(size < self._band, edge, wanted)
        self._owed = self._owed + self.dt * (meant - done)
        return np.asarray(done)

    def _within(self, rate: Array, more: Array) -> Array:
        """A rate (n,) and as much of another as leaves it no faster than it may be, or it is."""
        own, groups = self.statement, self.statement.groups
        fast = np.maximum(own.speed, norms(rate, groups)) ** 2
        a, c = (norms(v, groups) ** 2 for v in (more, rate))
        b = (norms(rate + more, groups) ** 2 - a - c) / 2
        root = np.sqrt(np.maximum(b * b + a * (fast - c), 0.0))
        return np.asarray(rate + np.clip((root - b) / np.maximum(a, TINY), 0.0, 1.0) * more)

    def _out(self, rate: Array) -> Array:
        """What to send [m/s, or rad/s] so that a rate (n,) is carried out, across its play."""
        unit, dt = self.statement.unit, self.dt
        if not self._loose:
            return self.plant.rate(rate * unit)
        across = (self.plant.taken_up(dt * rate * unit, self._side) - self._side) / dt
        both = self._within(rate, across / unit)
        self._side = self._side + dt * (both - rate) * unit
        return self.plant.rate(both * unit)

    def seen(self, state: Array) -> None:
        """The state (n,) as it was measured."""
        gone = self._along(state)
        self._compare(state)
        self._obeying.look(gone, self._then, self._steps)
        now = np.concatenate([gone[None], self._then])
        if self._origin is None:
            self._origin, self._spread = now, 1.0 + self._wanders
            return
        off = now - self._origin
        share, size = self._spread / (self._spread + 1.0), self._measured * (self._spread + 1.0)
        self._origin = self._origin + share * off
        self._spread = share + self._wanders
        y, p = off[0], off[1:]
        moves = (np.abs(p) > self._measured**0.5).any(axis=0)
        if not moves.any():
            return
        kept = np.where(moves, np.exp(-np.abs(p[self._told]) / constants.LEARNT), 1.0)
        # What no lateness explains, such as a load that comes on, tells of none.
        least = ((y - self._gain * p) ** 2).min(axis=0)
        most = constants.STANDARD**2 * size
        moves = moves * most / np.maximum(least, most)
        fresh = np.stack([np.broadcast_to(y * y, p.shape), y * p, p * p]) / size
        self._sums = kept * self._sums + moves * fresh
        self._count = kept * self._count + moves
        self._weigh()

    def _along(self, state: Array) -> Array:
        """How far (n,) the state has gone along the axes of the plant [mm, or units]."""
        if self._shafts is None:
            return state
        here, last = self._shafts.frames(state), self._frames
        if last is None or self._gone is None or self._place is None:
            self._gone = np.zeros(len(state))
        else:
            self._gone = self._gone + along((last[0] + here) / 2, state - self._place)
        self._frames = here, here
        self._frames = here, self._shafts.frames(state + self.way())
        return self._gone

    def _back(self, ways: Array) -> Array:
        """Ways (..., n) along the axes of the state, from some that the plant goes on."""
        if self._frames is None:
            return ways
        here, ahead = self._frames
        return back((here + ahead) / 2, ways)

    def _compare(self, state: Array) -> None:
        """Which bodies are seen where they were seen last, to the last bit."""
        old, self._place = self._place, state.copy()
        for b, part in enumerate(self._parts):
            if old is not None and (state[part] == old[part]).all():
                self._still[b] += 1
                continue
            self._still[b] = 0
            if self._unseen.pop(b, None):
                self._origin, self._sums[..., part], self._count[part] = None, 0.0, 0.0
                self._weigh()
            self._latest[b] = len(self._may) - 1 - int(self._may[::-1, b].argmax())
            self._left[part] = self._then[self._latest[b], part]

    def unseen(self) -> list[Event]:
        """Bodies that, for certain, are not seen to go where they were sent."""
        for b in np.flatnonzero(self._still).tolist():
            if b in self._unseen or self._sent_on(b) > constants.MM * self.statement.settings.safe:
                self._unseen[b] = unseen(b, self._sent_on(b), int(self._still[b]))
        found = self._obeying.astray.items()
        off = [astray(int(self._owner[j]), self.statement.unit[j], one) for j, one in found]
        return [*(self._unseen[b] for b in sorted(self._unseen)), *off]

    def _sent_on(self, b: int) -> float:
        """How far the tip of a body, from 0, was sent since it was last seen elsewhere [mm]."""
        part, here = self._parts[b], self._place
        assert here is not None  # seen at least twice
        way = self._then[self._latest[b], part] - self._left[part]
        slow = constants.HELD * self.statement.speed[part] * self.dt * self._still[b]
        on = np.zeros(len(here))
        on[part] = np.sign(way) * np.maximum(np.abs(way) - slow, 0.0)
        there = here + self._back(on)
        tips = [self._tracked(at, self.statement.blank)[0].copy() for at in (here, there)]
        return float(np.linalg.norm(_points(tips[1] - tips[0]), axis=1).max())

    def _weigh(self) -> None:
        """What is now most likely, and what is possible."""
        yy, yp, pp = self._sums
        gain = (yp + 1 / constants.GAINS**2) / (pp + 1 / constants.GAINS**2)
        self._gain = gain
        each = yy - 2 * gain * yp + gain**2 * pp + ((gain - 1) / constants.GAINS) ** 2
        for b, part in enumerate(self._parts):
            J = each[:, part].sum(axis=1) + (self._later / constants.LATE) ** 2
            k = int(J.argmin())
            scale = max(1.0, J[k] / max(self._count[part].sum(), 1.0))
            self._may[:, b] = J - J[k] <= constants.STANDARD**2 * scale
            self.later[b] = self._later[k]
            if 0 < k < len(J) - 1:
                before, after = J[k - 1] - J[k], J[k + 1] - J[k]
                self.later[b] += constants.GRAIN / 2 * (before - after) / max(before + after, TINY)

    def way(self) -> Array:
        """How far (n,) the state still goes by itself [mm]."""
        at = self.later[self._owner] / constants.GRAIN + self._told
        k = np.minimum(at.astype(int), len(self._later) - 2)
        ways = self._ways()
        way = ways[k, self._axes] * (1 - at + k) + ways[k + 1, self._axes] * (at - k)
        return self._back(np.asarray(way + self._owed))

    def said(self) -> list[Event]:
        """Bodies that are for certain later or sooner than told by more than a bias stated."""
        if self._may[self._told].all():
            return []
        off = np.where(self._may, np.abs(self._later)[:, None], np.inf).min(axis=0)
        stated = constants.MM * self.statement.settings.noise.bias / self.statement.speed.max()
        return [acts_late(k, self.later[k]) for k in np.flatnonzero(off > stated).tolist()]

    def stray(self, state: Array) -> float:
        """How far a tip may come to rest from where it is thought to, beyond a bias stated [mm]."""
        ways, may = self._ways(), self._may[:, self._owner]
        soon, late = may.argmax(axis=0), len(may) - 1 - may[::-1].argmax(axis=0)
        both = (ways[k, self._axes] + self._owed for k in (soon, late))
        ends = [self.way(), *map(self._back, both)]
        tips = [self._tracked(state + way, self.statement.blank)[0].copy() for way in ends]
        off = np.subtract(tips[1:], tips[0])
        most = float(np.linalg.norm(_points(off), axis=1).max())
        return max(most - constants.MM * self.statement.settings.noise.bias, 0.0)

    def _ways(self) -> Array:
        """How far (T, n) it still goes, by every lateness [mm]."""
        return np.asarray(self._gain * (self._sent - self._then))

    def then(self, goal: Array, p: int) -> Array:
        """A goal as it will be when the state is there: (g,), or of a path (m, g) p points.

        What lags follows a path in time where it is led by as much as the path goes meanwhile.
        """
        if goal.ndim == 1:
            return goal
        if goal.shape[1] != len(self._lag):
            return _at(goal, np.full(goal.shape[1], self.late.max()) / self.dt, p)
        if not self._lag.any() and self._frames is None:
            return _at(goal, self.late / self.dt, p)
        wait, ways = (self.late - self._lag) / self.dt, self._ways_of(goal)
        if self._frames is None:
            return _at(goal, wait, p) + self._lag / self.dt * _at(ways, wait, p)
        R = self._frames[1]
        parts = (along(R[None], part) for part in (goal, ways))
        there, on = (_at(part, wait, p) for part in parts)
        return back(R[None], there + self._lag / self.dt * on)

    def _ways_of(self, path: Array) -> Array:
        """How far (m, n) a path goes in a step, where it goes as fast as a tip may."""
        own, ways = self.statement, np.gradient(path, axis=0) if len(path) > 1 else 0.0 * path
        fast = norms(ways, own.groups) / (own.speed * self.dt)
        return np.asarray(ways / np.maximum(fast, 1.0))

    def moved(self, obstacles: Sequence[Obstacle]) -> list[Obstacle]:
        """Obstacles as they will be by then."""
        late = float(self.late.max() + self.late.min()) / 2  # Plant.bias counts from there
        return [_later(o, late) if late and o.usable and any(o.velocity) else o for o in obstacles]


def _at(path: Array, later: Array, p: int) -> Array:
    """Points (p, n) of a path (m, n), those of each axis so many steps later (n,)."""
    known, wanted = np.arange(len(path)), np.arange(p)
    columns = zip(path.T, later, strict=True)
    return np.column_stack([np.interp(wanted + more, known, g) for g, more in columns])


def _points(tracked: Array) -> Array:
    """What is tracked (..., g) as points (K, 3), or numbers (K, 1)."""
    return tracked.reshape(-1, 3 if tracked.shape[-1] % 3 == 0 else 1)


def _later(o: Obstacle, seconds: float) -> Obstacle:
    a, b = (np.add(end, np.multiply(seconds, o.velocity)) for end in (o.a, o.b))
    return replace(o, a=(a[0], a[1], a[2]), b=(b[0], b[1], b[2]))
