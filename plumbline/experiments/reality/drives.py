r"""Drives that are wrong in one way or two, by small steps in NumPy: what becomes of commands.

Ten steps a sample, motor and joint apart; nothing is linear, nothing is fitted. The two joints of
the arm turn in one upright plane, so that gravity's torques are elementary:

.. math:: h_2 = g\, m_2 c_2 \cos(q_1 + q_2), \qquad
          h_1 = h_2 + g\,(m_1 c_1 + m_2 l_1) \cos q_1

Cases draw the strength of what is wrong as drives show it; the noise then follows from the gap
that it makes at its joint and the ratio asked for, sigma = gap / ratio.

Mechanisms that no library lists: breakaway (the joint sticks until the error is large, then slips
close), cogging, a drive that weakens as it warms, packets that are lost, a loop that rings.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.cases import Plan
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.recorder import Recording, numbered, write

RANGES = Ranges("drive")
FINE = 10  # steps within a sample
GRAVITY = 9.81  # m/s^2
SAMPLES = (0.005, 0.01, 0.02)  # s, of controllers of 50 to 200 Hz
JOINTS = 2  # of the plane arm
YIELDS = 4  # times that a droop changes the load that makes it: the next change is below 1e-6 rad
# Pairs that hardly any motion tells apart: of the first kind, with what stands for it.
ALIKE = {
    "actuation_play": ("actuation_deadband",),
    "actuation_deadband": ("actuation_play",),
    "actuation_delay": ("actuation_lag", "servo_bandwidth"),
    "actuation_lag": ("actuation_delay", "servo_bandwidth"),
    "servo_bandwidth": ("actuation_delay", "actuation_lag"),
}


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
        row = "[[robot.dh]]\na = {}\nmass = {}\ncom = [{}, 0.0, 0.0]\n"
        parts = zip(self.length, self.mass, strict=True)
        return "\n".join(row.format(length, mass, -length / 2) for length, mass in parts)


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
    if np.isfinite(w.steepest):
        asked = _planned(asked, h, w.steepest)
    motor = _looped(asked, h, w) if w.bandwidth or w.ringing else _motor(asked, h, w)
    motor = motor - w.compliance * np.interp(fine, t, load)
    motor = motor + w.cogging * np.sin(w.teeth * motor)
    return _joint(motor, w)[::FINE]


def _held(u: Array, lost: NDArray[np.bool_]) -> Array:
    """The last command that arrived."""
    arrived = np.where(lost, 0, np.arange(len(u)))
    return u[np.maximum.accumulate(arrived)]


def _planned(asked: Array, h: float, most: float) -> Array:
    """A way that is sped up, or braked where it would else not stop at what is asked for."""
    out = np.empty_like(asked)
    place, speed, own = float(asked[0]), 0.0, 0.5 * h * most
    for k, c in enumerate(asked):
        ahead = c - place - 0.5 * h * speed  # half a step on, at the speed before
        stops = np.copysign(np.sqrt(own**2 + 2.0 * most * abs(ahead)) - own, ahead)
        after = min(max(stops, speed - h * most), speed + h * most)
        place += 0.5 * h * (speed + after)
        speed = after
        out[k] = place
    return out


def _motor(asked: Array, h: float, w: Wrong) -> Array:
    """The servo's own shaft: dead band, lag, largest speed."""
    share = 1.0 - np.exp(-h / w.lag) if w.lag else 1.0
    out = np.empty_like(asked)
    place, last = float(asked[0]), float(asked[0])
    for k, c in enumerate(asked):
        if w.lag:
            error = _outside(0.5 * (c + last) - place, w.deadband)
        else:  # at once to the band's edge
            error = c - place - min(max(c - place, -w.deadband), w.deadband)
        last = c
        place += min(max(share * error, -w.fastest * h), w.fastest * h)
        out[k] = place
    return out


def _looped(asked: Array, h: float, w: Wrong) -> Array:
    r"""The same of a servo of second order, :math:`\ddot y = \omega^2 e - 2 d \omega\, \dot y`.

    The dead band is the error's, the largest speed the shaft's; a lag filters what it is told.
    """
    told = _motor(asked, h, replace(w, deadband=0.0, fastest=np.inf))
    f, damping = (w.ringing, 0.25) if w.ringing else (w.bandwidth, 1.0)
    pace, rate = 2.0 * np.pi * f, 4.0 * np.pi * f * damping
    fades = np.exp(-rate * h)
    out = np.empty_like(told)
    place, speed, last = float(told[0]), 0.0, float(told[0])
    for k, c in enumerate(told):
        error = _outside(0.5 * (c + last - h * speed) - place, w.deadband)
        after = fades * speed + (1.0 - fades) * pace**2 / rate * error
        after = min(max(after, -w.fastest), w.fastest)
        place += 0.5 * h * (speed + after)
        speed, last = after, c
        out[k] = place
    return out


def _outside(error: float, band: float) -> float:
    """What a servo takes of an error: nothing in its dead band, all from twice that on."""
    size = abs(error)
    return np.sign(error) * 2.0 * max(size - band, 0.0) if size < 2.0 * band else error


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


# What the library lists, by the field that is wrong; ``ranges.toml`` has how much.
INSIDE: dict[str, str] = {
    "actuation_delay": "delay",
    "actuation_lag": "lag",
    "actuation_gain": "gain",
    "actuation_offset": "offset",
    "actuation_play": "play",
    "actuation_deadband": "deadband",
    "velocity_limit": "fastest",
    "acceleration_limit": "steepest",
    "servo_stiffness": "compliance",
    "servo_bandwidth": "bandwidth",
}
SIGNED = ("gain", "offset")
# What nobody lists: the field, and what it goes by.
OUTSIDE: dict[str, tuple[str, str]] = {
    "breakaway": ("breakaway", "motion"),
    "cogging": ("cogging", "angle"),
    "thermal_derating": ("fading", "time"),
    "lost_packets": ("lost", "command"),
    "ringing_loop": ("ringing", "velocity"),
}


def simulate_drives(folder: Path, plan: Plan, name: str, seed: int) -> dict[str, object]:
    """Draw a case, write its recording, return its truth (PlumblineError: it makes no gap)."""
    rng = np.random.default_rng(seed)
    plane = Plane(*(tuple(RANGES.many(name, rng, 2)) for name in ("length", "mass")))
    t, u = commands(rng)
    named = _named(plan, rng)
    fields = [_field(name) for name, _ in named]
    sizes = [
        (float(rng.choice([-1.0, 1.0])) if field in SIGNED else 1.0) * RANGES.one(field, rng)
        for field in fields
    ]
    wrongs = _wrongs(named, sizes)
    q = u
    for _ in range(YIELDS):
        load = plane.load(q)
        again = np.random.default_rng(seed)
        moved = [follow(t, u[:, j], load[:, j], wrongs[j], again) for j in range(JOINTS)]
        q = np.column_stack(moved)
    gaps = [
        _gap(t, u, load, _wrongs([(name, j)], [size])[j], j)
        for (name, j), size in zip(named, sizes, strict=True)
    ]
    ratio = float(np.exp(rng.uniform(*np.log(plan.gap))))
    noise = min(gaps) / ratio if gaps else RANGES.one("noise", rng)
    if gaps and not noise > 1e-5:
        raise PlumblineError(f"{named}: a gap of {min(gaps):.2g} rad")
    drawn = rng.normal(0.0, noise, q.shape)
    _write(folder, plane, name, t, u, q + drawn, noise if plan.known_noise else None)
    parameters = [
        {"size": size, "stage": "actuation"}
        | ({"depends_on": [OUTSIDE[effect][1]]} if effect in OUTSIDE else {})
        for (effect, _), size in zip(named, sizes, strict=True)
    ]
    return {
        "name": name, "kind": plan.kind,
        "effects": [
            {"effect": effect, "element": j + 1, "parameters": how, "gap_to_noise": gap / noise}
            for (effect, j), how, gap in zip(named, parameters, gaps, strict=True)
        ],
        "noise_std": noise, "noise_rms": float(np.sqrt(np.mean(drawn**2))),
        "rows": len(t), "arm": "plane", "observation": "motion",
        "confounded": [
            {"of": [effect, j + 1], "effect": other, "element": j + 1}
            for effect, j in named
            for other in ALIKE.get(effect, ())
        ],
        "seed": seed,
    }  # fmt: skip


def commands(rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (N,) [s] and commands (N, 2) [rad]: sines, faster ones, slow lines and holds."""
    dt = float(rng.choice(SAMPLES))
    t = np.arange(0.0, RANGES.one("lasts", rng), dt)
    u = np.zeros((len(t), JOINTS))
    for j in range(JOINTS):
        for f in RANGES.many("frequency", rng, 5):
            u[:, j] += 0.3 / (1 + 2 * f) * np.sin(2 * np.pi * (f * t + rng.random()))
        still = rng.random(max(int(t[-1] / 4), 1)) < RANGES.chances["holds"].share
        rate = np.where(still[np.minimum((t / 4).astype(int), len(still) - 1)], 0.0, 1.0)
        u[:, j] = np.interp(np.cumsum(rate) * dt, t, u[:, j])
    return t, u


def _named(plan: Plan, rng: np.random.Generator) -> list[tuple[str, int]]:
    if plan.kind == "none":
        return []
    pool = list(OUTSIDE) if plan.kind == "outside" else list(plan.effects or INSIDE)
    count = min(2 if plan.kind == "pair" else 1, len(pool))
    names = [str(name) for name in rng.choice(pool, count, replace=False)]
    return [(name, int(rng.integers(JOINTS))) for name in names]


def _wrongs(named: list[tuple[str, int]], sizes: list[float]) -> list[Wrong]:
    wrongs = [Wrong()] * JOINTS
    for (name, j), size in zip(named, sizes, strict=True):
        wrongs[j] = replace(wrongs[j], **{_field(name): size})
    return wrongs


def _field(name: str) -> str:
    return INSIDE[name] if name in INSIDE else OUTSIDE[name][0]


def _gap(t: Array, u: Array, load: Array, wrong: Wrong, j: int) -> float:
    """Root mean square of what one thing alone does to its joint [rad]."""
    q = follow(t, u[:, j], load[:, j], wrong, np.random.default_rng(0))
    return float(np.sqrt(np.mean((q - u[:, j]) ** 2)))


def _write(
    folder: Path, plane: Plane, name: str, t: Array, u: Array, q: Array, noise: float | None
) -> None:
    stated = "" if noise is None else f"noise_std = {noise:.6g}\n"
    text = (
        f'name = "{name}"\nobservation = "motion"\n{stated}\n[robot]\ngravity = [0.0, -9.81, 0.0]\n'
        f'\n{plane.toml()}\n[motion]\ncommand = "position"\n'
    )
    write(folder, Recording(text, {"time": t, **numbered("u", u), **numbered("q", q)}))
