r"""Drives that are wrong in one way or two, by small steps in NumPy: what becomes of commands.

Ten steps a sample, motor and joint apart; nothing is linear, nothing is fitted. The two joints of
the arm turn in one upright plane, so that gravity's torques are elementary:

.. math:: h_2 = g\, m_2 c_2 \cos(q_1 + q_2), \qquad
          h_1 = h_2 + g\,(m_1 c_1 + m_2 l_1) \cos q_1

Mechanisms that no library lists: breakaway (the joint sticks until the error is large, then slips
close), cogging, a drive that weakens as it warms, packets that are lost, a loop that rings.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FINE = 10  # steps within a sample
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Plane:
    """An arm of two joints in an upright plane."""

    length: tuple[float, float]  # of the links [m]
    mass: tuple[float, float]  # of the links [kg], each in its middle

    def load(self, q: Array) -> Array:
        """Gravity's torques (N, 2) at postures (N, 2) [N m]."""
        (l1, l2), (m1, m2) = self.length, self.mass
        far = GRAVITY * m2 * l2 / 2 * np.cos(q[:, 0] + q[:, 1])
        near = GRAVITY * (m1 * l1 / 2 + m2 * l1) * np.cos(q[:, 0])
        return np.column_stack([far + near, far])

    def toml(self) -> str:
        """Its DH rows."""
        rows = []
        for length, mass in zip(self.length, self.mass, strict=True):
            rows.append(
                f"[[robot.dh]]\na = {length}\nmass = {mass}\ncom = [{-length / 2}, 0.0, 0.0]\n"
            )
        return "\n".join(rows)


@dataclass(frozen=True)
class Wrong:
    """What is wrong with one joint's drive; nothing unless said."""

    delay: float = 0.0  # s
    lag: float = 0.0  # s
    gain: float = 0.0  # share
    offset: float = 0.0  # rad
    play: float = 0.0  # half of it [rad]
    deadband: float = 0.0  # rad
    fastest: float = np.inf  # rad/s
    steepest: float = np.inf  # rad/s^2 of the way that the servo plans
    compliance: float = 0.0  # rad/(N m)
    breakaway: float = 0.0  # rad
    cogging: float = 0.0  # rad
    teeth: float = 40.0  # of the cogging, a turn
    fading: float = 0.0  # share of the motion that is lost in the end
    lost: float = 0.0  # share of packets
    ringing: float = 0.0  # Hz
    bandwidth: float = 0.0  # Hz of a loop that does not ring


def follow(t: Array, u: Array, load: Array, wrong: Wrong, rng: np.random.Generator) -> Array:
    """Where a joint goes (N,) under commands u (N,) at times t (N,), with its load (N,)."""
    w = wrong
    fine = np.linspace(t[0], t[-1], (len(t) - 1) * FINE + 1)
    h = float(fine[1] - fine[0])
    if w.lost:
        u = _held(u, rng.random(len(u)) < w.lost)
    asked = (1.0 + w.gain) * np.interp(fine - w.delay, t, u) + w.offset
    if w.fading:
        share = 1.0 - w.fading * (1.0 - np.exp(-2.0 * (fine - t[0]) / (t[-1] - t[0])))
        asked = asked[0] + share * (asked - asked[0])
    for f, damping in ((w.ringing, 0.25), (w.bandwidth, 1.0)):
        asked = _rung(asked, 2.0 * np.pi * f * h, damping) if f else asked
    if np.isfinite(w.steepest):
        asked = _planned(asked, h, w.steepest)
    motor = _motor(asked, h, w)
    motor = motor - w.compliance * np.interp(fine, t, load)
    motor = motor + w.cogging * np.sin(w.teeth * motor)
    return _joint(motor, w)[::FINE]


def _held(u: Array, lost: NDArray[np.bool_]) -> Array:
    """The last command that arrived."""
    arrived = np.where(lost, 0, np.arange(len(u)))
    return u[np.maximum.accumulate(arrived)]


def _rung(asked: Array, step: float, damping: float) -> Array:
    """Through a loop of second order, so damped; ``step`` is its phase a step."""
    out = np.empty_like(asked)
    place, speed = asked[0], 0.0
    for k, c in enumerate(asked):
        speed += step * (step * (c - place) - 2.0 * damping * speed) if k else 0.0
        place += speed
        out[k] = place
    return out


def _planned(asked: Array, h: float, most: float) -> Array:
    """A way that is sped up, or braked where it would else not stop at what is asked for."""
    out = np.empty_like(asked)
    place, speed = float(asked[0]), 0.0
    for k, c in enumerate(asked):
        beyond = c - place - h * speed - speed * abs(speed) / (2.0 * most)
        speed += h * most * np.sign(beyond) * min(1.0, abs(beyond) / (most * h * h))
        place += h * speed
        out[k] = place
    return out


def _motor(asked: Array, h: float, w: Wrong) -> Array:
    """The servo's own shaft: dead band, lag, largest speed."""
    share = 1.0 - np.exp(-h / w.lag) if w.lag else 1.0
    out = np.empty_like(asked)
    place, last = float(asked[0]), float(asked[0])
    for k, c in enumerate(asked):
        error = 0.5 * (c + last) - place if w.lag else c - place
        last = c
        size = abs(error)
        if w.deadband and size < 2.0 * w.deadband:
            error = np.sign(error) * 2.0 * max(size - w.deadband, 0.0)
        place += min(max(share * error, -w.fastest * h), w.fastest * h)
        out[k] = place
    return out


def _joint(motor: Array, w: Wrong) -> Array:
    """What the motor drags along: play, or a joint that sticks and slips."""
    if not w.play and not w.breakaway:
        return motor
    out = np.empty_like(motor)
    place = float(motor[0])
    for k, y in enumerate(motor):
        if w.breakaway:
            if abs(y - place) > w.breakaway:
                place = y - 0.1 * w.breakaway * np.sign(y - place)
        else:
            place = min(max(place, y - w.play), y + w.play)
        out[k] = place
    return out
