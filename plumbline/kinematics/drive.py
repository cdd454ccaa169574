r"""The drive of one joint, one sample after the other: from what was asked for to where it goes.

With the command :math:`c`, delayed, scaled and shifted, a servo on position that nothing else is
known of follows it at once. Each term below is nothing at its null:

.. math:: e = \operatorname{zone}_w(c - y), \quad \tilde e = e - \operatorname{clip}(e, \pm s),
          \quad T \dot y = \tilde e, \quad |\dot y| \le \dot y_{max}, \quad
          |I \ddot y + h| \le \tau_{max}, \quad q \in [\,y - k h \pm b\,]

:math:`w` is a dead band: :math:`\operatorname{zone}_w(x)` is nothing within and all of x from 2 w
on, straight between (without a lag it is at its edge at once); :math:`s` friction or play inside
the servo's loop, :math:`T` a lag, :math:`k` the servo's compliance under the load :math:`h`,
:math:`b` half a play behind it, which the output only leaves when it is pushed. A loop that yields
itself acts on :math:`c - k\,h`, as late as on its command. One of second
order, of period :math:`2 \pi s`, has :math:`s^2 \ddot y + 2 s\,\dot y = \tilde e`, damped so that
it does not overshoot; its friction acts against its motion. A servo whose gains are known obeys
:math:`I \ddot y = k_p \tilde e - k_d \dot y - h` instead, one on velocity moves at
:math:`\dot y = c`, one on torque by :math:`I \ddot y = c - h`: of these four a lag filters the
command, :math:`T \dot c_f = c - c_f`, against dry friction :math:`- s \operatorname{sign} \dot y`
of a drive on velocity. What has inertia may rub,
:math:`- d \dot y - F \operatorname{sign} \dot y`: dry friction F takes no more speed than there is
(Moreau 1988, a step that is implicit in the speed), and may have a rotor, which adds to I. Soft
friction is a constraint of MuJoCo's, :math:`s (\ddot y + r \dot y)` up to F (Todorov 2014, ICRA).

Where the servo plans its way with a largest acceleration, what it plans stands for the command, and
so does what is told it no faster than at some speed: of a planned way that is its own largest one.
Commands run straight from sample to sample (of velocities, lines of the same mean), or stand still
where they are rates, torques or places that a digital controller holds (Franklin, Powell, Workman
1998, sec. 4.3); the step of what lags is exact for both. What has inertia takes steps by the
trapezoidal rule, which no stiffness upsets.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as cs

from plumbline.kinematics.chained import chained
from plumbline.kinematics.constants import NULL
from plumbline.kinematics.law import Law
from plumbline.kinematics.ramped import ramped

EDGE = 2.0  # slope at the edge of a dead band: twice its width away, the whole error acts

# Of soft friction, MuJoCo's where a file says no other (XML reference: `solimpfriction` .9 .95,
# `solreffriction` .02 s): its stiffness s per inertia, the joint at zero and all others free, and
# the rate at which it slows a joint.
STIFFNESS = 0.9 / (1 - 0.9)
SLOWS = 2 / (0.95 * 0.02)  # [1/s]
PARTS = 2  # steps of a sample of what has inertia: their error falls with the square

ZERO = cs.SX(0)


@dataclass(frozen=True, eq=False)
class Memory:
    """What a drive keeps from sample to sample."""

    asked: cs.SX  #: what it was last asked for [rad, rad/s or N m]
    place: cs.SX  #: where its motor is [rad]
    speed: cs.SX  #: how fast that moves [rad/s]
    output: cs.SX  #: where the joint is, behind the play [rad]
    sent: cs.SX = ZERO  #: what it was last asked for before any lag [rad, rad/s or N m]
    told: cs.SX = ZERO  #: the command before [rad]
    path: cs.SX = ZERO  #: where the servo's planned way is [rad]
    pace: cs.SX = ZERO  #: how fast that moves [rad/s]


@dataclass(frozen=True, eq=False)
class Drive:
    """One sample of a joint's drive; the null of every term is that it is not there."""

    law: Law  #: what its command is
    dt: cs.SX  #: time since the sample before [s]
    command: cs.SX  #: the command [rad, rad/s or N m]
    load: cs.SX  #: torque that gravity and the other joints ask of it [N m]
    inertia: cs.SX  #: inertia about the joint [kg m^2]
    kp: cs.SX  #: gain of a servo whose gains are known [N m/rad]
    kd: cs.SX  #: its damping [N m s/rad]
    bare: cs.SX  #: inertia about the joint at its zero, the others free [kg m^2]
    shift: cs.SX | None = None  #: how late commands are obeyed [s]
    lag: cs.SX | None = None  #: time constant [s]
    period: cs.SX | None = None  #: natural one of a servo of second order [s]
    band: cs.SX | None = None  #: error that moves nothing, either way [rad, rad/s or N m]
    stick: cs.SX | None = None  #: error that is always left, either way [rad, rad/s or N m]
    rubs: bool = False  #: whether that is taken of what moves, not of what is asked for
    damping: cs.SX | None = None  #: viscous friction of what has inertia [N m s/rad]
    rubbing: cs.SX | None = None  #: its dry friction [N m]
    soft: bool = False  #: whether that yields as MuJoCo's does
    rotor: cs.SX | None = None  #: inertia that the model lacks [kg m^2]
    compliance: cs.SX | None = None  #: by how much it yields to a load [rad/(N m)]
    sag: cs.SX | None = None  #: the same inside of its loop, where what lags yields late
    slack: cs.SX | None = None  #: half the play between motor and joint [rad]
    fastest: cs.SX | None = None  #: largest speed [rad/s]; None if there is none
    paced: cs.SX | None = None  #: largest speed of what it is told [rad/s]; None if none is known
    strongest: cs.SX | None = None  #: largest torque [N m]; None if there is none
    #: largest acceleration of a planned way [rad/s^2]; None if none is planned
    steepest: cs.SX | None = None

    def step(self, before: Memory) -> Memory:
        """One sample on."""
        if self.steepest is not None:
            path, pace = self.planned(before)
            after = self.on_its_way(path).step(before)
            return replace(after, told=self.command, path=path, pace=pace)
        if self.paced is not None:
            return self._told_no_faster(before, self.paced)
        if self.sag is not None:
            return replace(self, command=self.command - self.sag * self.load, sag=None).step(before)
        if self.law == Law.HELD:
            return replace(self, law=Law.POSITION).step(self._stood(before))
        if self.period is not None:
            return self._swung(before, self.period / (2 * math.pi))
        asked = self._outside_band(before)
        if self.law.known or self.law.pushes:
            wanted = self._lagged(asked, None, before)
            place, speed = self._driven(asked, wanted, before)
            return Memory(wanted, place, speed, self._behind_play(place, before), asked)
        own = before.place if self.law == Law.POSITION else None
        if self.law == Law.RATE:
            return self._held(asked, before)
        held = self.fastest is not None or self.strongest is not None
        wanted, rubbed = self._rubbed(self._met(asked, own, before), asked, before)
        if own is not None and self.lag is not None and self.band is not None:
            asked, wanted = self.command, self._pulled(before, self.lag, self.band)
        speed = (wanted - before.place) / self.dt if self.law == Law.POSITION else wanted
        speed = self._limited(speed, before.speed, self.dt)
        mean = speed
        if self.law == Law.VELOCITY:  # which runs straight between samples
            mean = (speed + before.speed) / 2
            if self.lag is not None and not held:
                mean += self._risen(asked, self.lag / self.dt, before) - rubbed
                mean -= (wanted + before.asked) / 2
        # An ideal position is met without rounding.
        place = wanted if own is not None and not held else before.place + self.dt * mean
        memory = asked if self.law == Law.POSITION else wanted
        return Memory(memory, place, speed, self._behind_play(place, before), asked)

    def _stood(self, before: Memory) -> Memory:
        """As if what is asked for over a sample had been asked for at its beginning: it is held."""
        if self.period is not None and self.lag is not None:
            return replace(before, sent=self.command)
        banded = self.band is not None or self.period is not None
        asked = self.command if banded else replace(self, law=Law.POSITION)._outside_band(before)
        return replace(before, asked=asked)

    def _met(self, asked: cs.SX, place: cs.SX | None, before: Memory) -> cs.SX:
        """What lags, at its largest speed if it has one, a sample on."""
        if place is not None and self.fastest is not None:
            return self._chased(asked, before, self.fastest)
        return self._lagged(asked, place, before)

    def _pulled(self, before: Memory, lag: cs.SX, band: cs.SX) -> cs.SX:
        """Place after a sample of what lags outside of a dead band.

        Half as long behind its edge up to twice the band away, as halfway through the sample.
        """
        stick, place = ZERO if self.stick is None else self.stick, before.place
        middle = (before.asked + self.command - self.dt * before.speed) / 2 - place
        errors = [x - place for x in (before.asked, self.command)]
        was, now = (place + e - clipped(e, band + stick / EDGE) for e in errors)
        close = replace(self, lag=lag / EDGE)._met(now, place, replace(before, asked=was))
        was, now = (place + e - clipped(e, stick) for e in errors)
        far = self._met(now, place, replace(before, asked=was))
        return cs.if_else(cs.fabs(middle) < EDGE * band, close, far)

    def _told_no_faster(self, before: Memory, most: cs.SX) -> Memory:
        """A sample on where what sends commands on changes them no faster than that."""
        was = self.command if self.law.holds else before.told
        chased = replace(before, asked=was, place=before.path)
        path = replace(self, lag=None)._chased(self.command, chased, most)
        law = Law.POSITION if self.law.ideal else self.law  # what is on its way stands nowhere
        after = replace(self, law=law, command=path, paced=None).step(before)
        return replace(after, told=self.command, path=path)

    def on_its_way(self, path: cs.SX) -> Self:
        """The drive behind a way that it has planned: that stands for its command."""
        law = Law.POSITION if self.law.ideal else self.law  # a way stands nowhere
        fastest = self.fastest if self.paced is None else self.paced  # of a way, its own
        return replace(self, law=law, command=path, steepest=None, paced=None, fastest=fastest)

    def planned(self, before: Memory) -> tuple[cs.SX, cs.SX]:
        """Place and speed of a way to the command that could stop there, by its steepest ramps."""
        told = (self.command if self.law.holds else before.told), self.command
        most = cs.SX(cs.inf) if self.steepest is None else self.steepest
        return ramped(before.path, before.pace, told, most, self.dt)

    def _held(self, asked: cs.SX, before: Memory) -> Memory:
        """One sample on under a rate that stood still over it: the lag's way is exact."""
        wanted, rubbed = self._rubbed(self._lagged(asked, None, before), asked, before)
        mean = self._mean(asked, before, 0.0, 1.0) - rubbed
        mean = self._limited(mean, before.speed, self.dt)
        place = before.place + self.dt * mean
        return Memory(wanted, place, mean, self._behind_play(place, before))

    def _outside_band(self, before: Memory) -> cs.SX:
        """The command that a servo which ignores small errors acts on."""
        if self.band is None and self.stick is None:
            return self.command
        at_rest = before.place if self.law.follows else cs.SX(0)
        at_once = self.law == Law.POSITION and self.lag is None
        if at_once and self.compliance is not None and self.slack is None:
            at_rest = before.output + self.compliance * self.load  # what rests does not yield
        error = self.command - at_rest
        if self.band is not None and at_once:
            error = error - clipped(error, self.band)  # at once, to the band's edge and no farther
        elif self.band is not None:
            error = _beyond(error, self.band)
        if self.stick is not None and not self.rubs:
            error = error - clipped(error, self.stick)
        return at_rest + error

    def _rubbed(self, free: cs.SX, asked: cs.SX, before: Memory) -> tuple[cs.SX, cs.SX]:
        """A speed after a sample of friction, and what that took on average, behind the lag.

        Friction holds against the speed until that turns; then no more is taken than there is.
        """
        if self.stick is None or not self.rubs:
            return free, ZERO
        if self.lag is None:
            lost = clipped(free, self.stick)
            return free - lost, lost
        h, T, speed, side = self.dt, self.lag + self.dt * NULL, before.asked, cs.sign(before.asked)
        told = asked if self.law.holds else (asked + before.sent) / 2
        goal = told - self.stick * side
        turns = goal * side < 0
        ahead = T * cs.log1p(-speed / cs.if_else(turns, goal, -side - (side == 0)))
        until = cs.if_else(turns, cs.fmin(ahead, h), h * (side != 0))
        left = h - until
        later = 1 - cs.exp(-left / T)
        sooner = 1 - later - cs.exp(-h / T)
        first = self.stick * side
        then = clipped(free - first * sooner, self.stick * later) / (later + NULL)
        mean = first * (until - T * sooner) + then * (left - T * later)
        return free - first * sooner - then * later, mean / h

    def _lagged(self, asked: cs.SX, place: cs.SX | None, before: Memory) -> cs.SX:
        """Exact for an input that runs straight from one sample to the next, or is held.

        A servo on position closes its own loop: its output is what lags. Elsewhere the command is
        filtered before it acts, and its filtered value is what is remembered.
        """
        if self.lag is None:
            return asked
        ratio = self.lag / self.dt
        stays = cs.exp(-1 / (ratio + NULL))  # null is null
        if self.law.holds:
            return stays * before.asked + (1 - stays) * asked
        late = ratio * (1 - stays)
        was, sent = (before.asked, before.sent) if place is None else (place, before.asked)
        return stays * was + (1 - late) * asked + (late - stays) * sent

    def _chased(self, asked: cs.SX, before: Memory, v: cs.SX) -> cs.SX:
        r"""Place after a sample of :math:`T \dot y = \operatorname{clip}(c - y, \pm v T)`, exactly.

        At full speed until it is near to a command that runs straight, then as it lags, then at
        full speed again behind one that is faster.
        """
        h, error = self.dt, before.asked - before.place
        T = 0 if self.lag is None else self.lag + NULL
        r, ahead = (asked - before.asked) / h, cs.sign(error)
        closing, most = cs.fmax(v - ahead * r, NULL), clipped(r, v)
        first = cs.fmin(h, cs.fmax(cs.fabs(error) - v * T, 0) / closing)
        there, rest = before.place + ahead * v * first, h - first
        if self.lag is None:
            return there + most * rest
        off = (error + (r - ahead * v) * first) / T - r  # from what lags in the end, by T
        faster = cs.fabs(r) > v
        share = cs.fmin(cs.fmax((most - r) / cs.if_else(faster, off, 1), NULL), 1)
        lags = cs.if_else(faster, cs.fmin(rest, -T * cs.log(cs.if_else(faster, share, 1))), rest)
        fades = 1 - cs.exp(-lags / T)
        return there + r * lags + T * off * fades + most * (rest - lags)

    def _swung(self, before: Memory, s: cs.SX) -> Memory:
        r"""A sample of a servo of second order, exact for an input that runs straight over it.

        In the end it is :math:`(T + 2 s)\,r` behind one of rate r; what it is off from there fades
        at the rate 1 / s, and what its lagged command is off at 1 / T. A dead band takes of the
        error what it is worth halfway, dry friction no more motion than there is.
        """
        h, a, own = self.dt, 1 / (s + NULL), 2 * s  # the guard lets null be null
        asked, sent, late = self.command, before.asked, own
        if self.lag is not None:
            asked, sent, late = self._lagged(asked, None, before), before.sent, self.lag + own
        r, stays = (self.command - sent) / h, cs.exp(-a * h)
        off, moves = before.place - sent + r * late, before.speed - r
        to_place, to_speed = 1 - stays * (1 + a * h), a**2 * h * stays  # by a held error
        # What a dead band takes of a servo's error in the middle of a sample
        error = (before.asked + asked - before.speed * self.dt) / 2 - before.place
        lost = cs.SX(0) if self.band is None else error - _beyond(error, self.band)
        went = self.command - r * late + (1 - to_place) * off + h * stays * moves - before.place
        speed = r + stays * (1 - a * h) * moves - to_speed * off - to_speed * lost
        if self.lag is not None:
            place_by, speed_by = chained(a * h, 1 / (self.lag / h + NULL), stays)
            astray = before.asked - sent + r * self.lag
            went, speed = went + place_by * astray, speed + speed_by / h * astray
        went -= to_place * lost
        if self.stick is not None:
            went, speed = (
                x - clipped(x, by * self.stick) for x, by in ((went, to_place), (speed, to_speed))
            )
        place = before.place + h * self._limited(went / h, before.speed, h / 2)
        speed = self._limited(speed, before.speed, h)
        return Memory(asked, place, speed, self._behind_play(place, before), self.command)

    def _risen(self, asked: cs.SX, ratio: cs.SX, before: Memory) -> cs.SX:
        """Mean over a sample of what lags by so many behind a line from what was sent before."""
        rise = asked - before.sent
        stays = cs.exp(-1 / (ratio + NULL))
        late = before.asked - before.sent + rise * ratio
        return before.sent + rise * (0.5 - ratio) + late * ratio * (1 - stays)

    def _mean(self, asked: cs.SX, before: Memory, start: float, end: float) -> cs.SX:
        """What acts between two shares of a sample over which the command is held, on average."""
        if self.lag is None:
            return asked
        ratio = self.lag / self.dt
        left = [cs.exp(-share / (ratio + NULL)) for share in (start, end)]
        return asked + (before.asked - asked) * ratio / (end - start) * (left[0] - left[1])

    def _driven(self, asked: cs.SX, wanted: cs.SX, before: Memory) -> tuple[cs.SX, cs.SX]:
        """Place and speed of a drive that pushes an inertia, after steps of a part of a sample."""
        h, kp, kd = self.dt / PARTS, self.kp, self.kd
        if self.compliance is not None:
            kp = kp / (1 + kp * self.compliance)
        if self.law.pushes:
            kp, kd = cs.SX(0), cs.SX(0)
        kd = kd if self.damping is None else kd + self.damping
        inertia = self.inertia if self.rotor is None else self.inertia + self.rotor
        place, speed = before.place, before.speed
        for part in range(PARTS):
            share = (part + 0.5) / PARTS
            middle = before.asked + share * (wanted - before.asked)
            if self.law.holds:
                middle = self._mean(asked, before, part / PARTS, (part + 1) / PARTS)
            push = middle if self.law.pushes else kp * (middle - place - h * speed / 4)
            if self.law.pushes and self.strongest is not None:
                push = clipped(push, self.strongest)
            free = speed + h / inertia * (push - kd * speed / 2 - self.load)
            back = 1 + h / inertia * (kd / 2 + h * kp / 4)
            if self.rubbing is not None:
                held = self._given(free, speed, back, h) if self.soft else free
                free = free - clipped(held, h / inertia * self.rubbing)
            after = free / back
            after = self._limited(after, speed, h) if self.law.known else self._slowed(after)
            place, speed = place + h * (speed + after) / 2, after
        return place, speed

    def _given(self, free: cs.SX, speed: cs.SX, back: cs.SX, h: cs.SX) -> cs.SX:
        """What soft friction takes of a step's speed where its limit does not hold it [rad/s]."""
        stiff, slows = STIFFNESS * self.bare / self.inertia, SLOWS * h / 2
        after = (free + stiff * (1 - slows) * speed) / (back + stiff * (1 + slows))
        return free - back * after

    def _limited(self, speed: cs.SX, before: cs.SX, h: cs.SX) -> cs.SX:
        """The speed that the largest torque and the largest speed allow [rad/s]."""
        if self.strongest is not None:
            torque = clipped(self.inertia * (speed - before) / h + self.load, self.strongest)
            speed = before + h / self.inertia * (torque - self.load)
        return self._slowed(speed)

    def _slowed(self, speed: cs.SX) -> cs.SX:
        return speed if self.fastest is None else clipped(speed, self.fastest)

    def _behind_play(self, place: cs.SX, before: Memory) -> cs.SX:
        pushed = place
        if self.law == Law.POSITION and self.compliance is not None:
            pushed = place - self.compliance * self.load
        if self.slack is None:
            return pushed
        return cs.fmin(cs.fmax(before.output, pushed - self.slack), pushed + self.slack)

    def changed(self, **terms: cs.SX) -> Self:
        """A copy with more of some terms; those that are not there yet are as given."""
        now = {name: getattr(self, name) for name in terms}
        both: dict[str, Any] = {k: v if now[k] is None else now[k] + v for k, v in terms.items()}
        return replace(self, **both)


def _beyond(error: cs.SX, band: cs.SX) -> cs.SX:
    """What is left of an error by a dead band: all of it from twice the band on."""
    size = cs.fabs(error)
    return cs.sign(error) * cs.fmin(cs.fmax(EDGE * (size - band), 0), size)


def clipped(value: cs.SX, most: cs.SX) -> cs.SX:
    """The value, at most so large either way."""
    return cs.fmin(cs.fmax(value, -most), most)
