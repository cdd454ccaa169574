"""Which motion would tell apart what a recording leaves open, joint by joint.

Delay and lag are one thing at low frequency, and part in a chirp; an offset and a droop part where
the load changes; a play and a dead band where a lag brings the joint to rest, in steps that are
held, and without one, or inside of the loop, in no motion, but under a hand; a limit shows in fast
steps.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from plumbline.kinematics.effects.actuation_deadband import ActuationDeadband
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.optim.diagnosis.findings import Cause
from plumbline.optim.diagnosis.motion.constants import CHIRP, CONFOUNDED, SECONDS
from plumbline.optim.diagnosis.motion.models import SAME, twins
from plumbline.optim.diagnosis.motion.search import JointFindings
from plumbline.optim.diagnosis.motion.windows import Array

BY_HAND = ("hold", "pushed by hand either way: play gives way, a dead band does not")
# What parts two effects: a motion's kind, and what it is in words.
PARTED: dict[frozenset[str], tuple[str, str]] = {
    frozenset(("actuation_delay", "actuation_lag")): ("chirp", "0.1 to 5 Hz in 30 s"),
    frozenset(("actuation_delay", "servo_bandwidth")): ("chirp", "0.1 to 5 Hz in 30 s"),
    frozenset(("actuation_lag", "servo_bandwidth")): ("chirp", "0.1 to 5 Hz in 30 s"),
    frozenset(("actuation_offset", "servo_stiffness")): ("hold", "5 s at postures of other loads"),
    SAME: ("steps", "small and large ones, each held"),
    frozenset(("actuation_play", "actuation_lag")): ("ramp", "slowly to and fro, twice"),
    frozenset(("velocity_limit", "torque_limit")): (
        "steps",
        "small and large ones, with two loads",
    ),
    frozenset(("actuation_gain", "servo_stiffness")): ("hold", "5 s at postures of other loads"),
}
# The same of torques, measured or told, by the first of these that has either effect.
PARTED_EFFORTS: tuple[tuple[str, str, frozenset[str]], ...] = (
    ("chirp", "0.1 to 5 Hz in 30 s", frozenset(("rotor_inertia",))),
    (
        "ramp",
        "slowly to and fro, twice, through standstill",
        frozenset(
            ("coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction",
             "torque_offset", "cable_spring")
        ),
    ),
    (
        "hold",
        "5 s at postures of other loads, and again with a known weight at the tip",
        frozenset(("payload", "link_inertia", "gravity_direction", "torque_scale")),
    ),
)  # fmt: skip


def proposals(joints: Sequence[JointFindings]) -> Iterator[dict[str, Any]]:
    """One entry a joint and pair of effects that it leaves open."""
    for joint in joints:
        parted = PARTED | {SAME: BY_HAND} if one_operator(joint) else PARTED
        for name, instead in joint.instead.items():
            for other, p in instead.items():
                kind = _parts(frozenset((name, other)), parted)
                if kind is not None and p > CONFOUNDED:
                    unlisted = f"something unlisted that goes by {other[1:]}"
                    tells = f"{name} from {unlisted if other[0] == '?' else other}"
                    yield {"joint": joint.number, "motion": ", ".join(kind), "tells": tells}


def _parts(
    pair: frozenset[str], parted: Mapping[frozenset[str], tuple[str, str]]
) -> tuple[str, str] | None:
    """What motion parts two effects, its kind and what it is in words."""
    of_torques = ((kind, how) for kind, how, effects in PARTED_EFFORTS if pair & effects)
    return parted[pair] if pair in parted else next(of_torques, None)


def one_operator(joint: JointFindings) -> bool:
    """Whether play and a dead band do the same to a joint."""
    kinds = (ActuationPlay, ActuationDeadband)
    forms = tuple(e for kind in kinds for e in kind.candidates(joint.windows.law, masses=False))
    return any(True for _ in twins(joint.fit.effects, joint.windows.law, forms))


def proposals_of_efforts(causes: Sequence[Cause], joints: int) -> Iterator[dict[str, Any]]:
    """The same for causes of an arm's efforts; a load is held by the last of so many joints."""
    for cause in causes:
        for other in cause.confounded_with:
            kind = _parts(frozenset((cause.effect, other.effect)), {})
            if kind is not None:
                tells = f"{cause.label} from {other.label}"
                joint = cause.element or other.element or joints
                yield {"joint": joint, "motion": ", ".join(kind), "tells": tells}


def motion_of(kind: str, q: Array, dt: float, fastest: float) -> Array:
    """Commands (N,) of one joint [rad] for a kind of motion, within the range recorded so far.

    Args:
        kind: ``"chirp"``, ``"ramp"``, ``"hold"`` or ``"steps"``.
        q: Where the joint was (M,) [rad].
        dt: Time from sample to sample [s].
        fastest: Largest speed that was asked for [rad/s]; none of these exceeds it but steps.
    """
    low, middle, high = np.quantile(q, [0.02, 0.5, 0.98])
    t = np.arange(0.0, SECONDS, dt)
    if kind == "chirp":
        f = CHIRP[0] * (CHIRP[1] / CHIRP[0]) ** (t / SECONDS)
        size = np.minimum(0.1 * (high - low), fastest / (2 * np.pi * f))
        return np.asarray(middle + size * np.sin(2 * np.pi * np.cumsum(f) * dt))
    if kind == "ramp":
        corners = np.array([middle, low, high, low, high, middle])
        pace = max(SECONDS, 4.0 * (high - low) / fastest)
        return np.interp(np.arange(0.0, pace, dt), np.linspace(0.0, pace, 6), corners)
    if kind == "hold":
        corners = np.repeat([middle, low, high, middle], 2)
        ends = np.array([0.0, 0.1, 0.25, 0.45, 0.55, 0.75, 0.9, 1.0])
        pace = max(SECONDS, (high - low) / fastest / 0.1)
        return np.interp(np.arange(0.0, pace, dt), pace * ends, corners)
    levels = middle + np.array([0.0, 0.05, -0.05, 0.25, -0.25, 0.0]) * (high - low)
    return np.asarray(levels[np.minimum((t / SECONDS * 6).astype(int), 5)])


def commanded(
    wanted: Sequence[tuple[int, str]], time: Array, command: Array
) -> tuple[Array, Array]:
    """Times (N,) [s] and commands (N, n) of these motions, one joint after the other.

    Args:
        wanted: Joint, from 1, and kind of motion of each.
        time: Times (M,) of the recording [s].
        command: Its commands (M, n) [rad]; joints that wait do so at their medians.
    """
    dt = float(np.median(np.diff(time)))
    rest = np.median(command, axis=0)
    parts = []
    for joint, kind in wanted:
        u = command[:, joint - 1]
        speed = float(np.quantile(np.abs(np.gradient(u, time)), 0.99))
        moved = motion_of(kind, u, dt, max(speed, 1e-3))
        part = np.tile(rest, (len(moved), 1))
        part[:, joint - 1] = moved
        parts.append(part)
    u = np.concatenate(parts)
    return np.asarray(np.arange(len(u)) * dt, dtype=float), u
