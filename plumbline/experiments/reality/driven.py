"""Cases of motions: what is wrong in which drive, the gap that it makes, recording and truth.

The strength of what is wrong is drawn as drives show it; the noise then follows from the gap that
it makes at its joint and the ratio asked for, sigma = gap / ratio.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.cases import Plan
from plumbline.experiments.reality.drives import Array, Plane, Wrong, follow
from plumbline.experiments.reality.recorder import Recording, numbered, write

JOINTS = 2
YIELDS = 4  # times that a droop changes the load that makes it: the next change is below 1e-6 rad
Strength = Callable[[np.random.Generator], float]


def _log(low: float, high: float) -> Strength:
    return lambda rng: float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(low: float, high: float) -> Strength:
    return lambda rng: float(rng.choice([-1.0, 1.0]) * _log(low, high)(rng))


# What the library lists: the field that is wrong, and how much [rad, s, rad/s, rad/(N m) or 1].
INSIDE: dict[str, tuple[str, Strength]] = {
    "actuation_delay": ("delay", _log(0.01, 0.12)),
    "actuation_lag": ("lag", _log(0.01, 0.15)),
    "actuation_gain": ("gain", _signed(0.02, 0.2)),
    "actuation_offset": ("offset", _signed(0.005, 0.1)),
    "actuation_play": ("play", _log(0.004, 0.05)),
    "actuation_deadband": ("deadband", _log(0.005, 0.05)),
    "velocity_limit": ("fastest", _log(0.3, 0.7)),
    "acceleration_limit": ("steepest", _log(0.5, 3.0)),
    "servo_stiffness": ("compliance", _log(0.002, 0.02)),
    "servo_bandwidth": ("bandwidth", _log(1.0, 4.0)),
}
# What nobody lists, and what it goes by.
OUTSIDE: dict[str, tuple[str, Strength, tuple[str, ...]]] = {
    "breakaway": ("breakaway", _log(0.01, 0.05), ("motion",)),
    "cogging": ("cogging", _log(0.005, 0.03), ("angle",)),
    "thermal_derating": ("fading", _log(0.05, 0.3), ("time",)),
    "lost_packets": ("lost", _log(0.1, 0.6), ("command",)),
    "ringing_loop": ("ringing", _log(1.0, 3.0), ("velocity",)),
}
# Pairs that hardly any motion tells apart: of the first kind, with what stands for it.
ALIKE = {
    "actuation_play": ("actuation_deadband",),
    "actuation_deadband": ("actuation_play",),
    "actuation_delay": ("actuation_lag", "servo_bandwidth"),
    "actuation_lag": ("actuation_delay", "servo_bandwidth"),
    "servo_bandwidth": ("actuation_delay", "actuation_lag"),
}


def simulate_drives(folder: Path, plan: Plan, name: str, seed: int) -> dict[str, object]:
    """Draw a case, write its recording into a folder, and return the truth about it.

    Raises:
        PlumblineError: What was drawn makes no gap to speak of.
    """
    rng = np.random.default_rng(seed)
    plane = Plane(tuple(rng.uniform(0.2, 0.5, 2)), tuple(rng.uniform(0.5, 4.0, 2)))
    t, u = commands(rng)
    named = _named(plan, rng)
    sizes = [_drawn(name)[1](rng) for name, _ in named]
    wrongs = _wrongs(named, sizes)
    q = u
    for _ in range(YIELDS):
        load = plane.load(q)
        q = _moved(t, u, load, wrongs, np.random.default_rng(seed))
    gaps = [
        _gap(t, u, load, _wrongs([one], [size])[one[1]], one[1])
        for one, size in zip(named, sizes, strict=True)
    ]
    ratio = float(np.exp(rng.uniform(*np.log(plan.gap))))
    noise = min(gaps) / ratio if gaps else float(np.exp(rng.uniform(np.log(1e-4), np.log(5e-3))))
    if gaps and not noise > 1e-5:
        raise PlumblineError(f"{named}: a gap of {min(gaps):.2g} rad")
    drawn = rng.normal(0.0, noise, q.shape)
    _write(folder, plane, name, t, u, q + drawn, noise if plan.known_noise else None)
    effects = [
        {
            "effect": effect,
            "element": j + 1,
            "parameters": {"size": size, "stage": "actuation"}
            | ({"depends_on": list(OUTSIDE[effect][2])} if effect in OUTSIDE else {}),
            "gap_to_noise": gap / noise,
        }
        for (effect, j), size, gap in zip(named, sizes, gaps, strict=True)
    ]
    pairs = [
        {"of": [effect, j + 1], "effect": other, "element": j + 1}
        for effect, j in named
        for other in ALIKE.get(effect, ())
    ]
    return {
        "name": name,
        "kind": plan.kind,
        "effects": effects,
        "noise_std": noise,
        "noise_rms": float(np.sqrt(np.mean(drawn**2))),
        "rows": len(t),
        "arm": "plane",
        "observation": "motion",
        "confounded": pairs,
        "seed": seed,
    }


def commands(rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (N,) [s] and commands (N, 2) [rad]: sines, faster ones, slow lines and holds."""
    dt = float(rng.choice([0.005, 0.01, 0.02]))
    t = np.arange(0.0, float(rng.uniform(40.0, 80.0)), dt)
    u = np.zeros((len(t), JOINTS))
    for j in range(JOINTS):
        for f in np.exp(rng.uniform(np.log(0.03), np.log(1.5), 5)):
            u[:, j] += 0.3 / (1 + 2 * f) * np.sin(2 * np.pi * (f * t + rng.random()))
        still = rng.random(max(int(t[-1] / 4), 1)) < 0.2
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
        wrongs[j] = replace(wrongs[j], **{_drawn(name)[0]: size})
    return wrongs


def _drawn(name: str) -> tuple[str, Strength]:
    """The field of a drive that a mechanism changes, and how its strength is drawn."""
    field, strength, *_ = INSIDE.get(name) or OUTSIDE[name]
    return field, strength


def _moved(t: Array, u: Array, load: Array, wrongs: list[Wrong], rng: np.random.Generator) -> Array:
    return np.column_stack([follow(t, u[:, j], load[:, j], wrongs[j], rng) for j in range(JOINTS)])


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
