"""Which motion would tell apart what a recording leaves open, joint by joint.

Delay and lag are one thing at low frequency, and part in a chirp; an offset and a droop part where
the load changes; a play and a dead band in slow ramps to and fro; a limit shows in fast steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from plumbline.optim.diagnosis.motion.search import Joint

# What parts two effects: a motion's kind, and what it is in words.
PARTED: dict[frozenset[str], tuple[str, str]] = {
    frozenset(("actuation_delay", "actuation_lag")): ("chirp", "0.1 to 5 Hz in 30 s"),
    frozenset(("actuation_offset", "servo_stiffness")): ("hold", "5 s at postures of other loads"),
    frozenset(("actuation_play", "actuation_deadband")): ("ramp", "slowly to and fro, twice"),
    frozenset(("actuation_play", "actuation_lag")): ("ramp", "slowly to and fro, twice"),
    frozenset(("velocity_limit", "torque_limit")): (
        "steps",
        "small and large ones, with two loads",
    ),
    frozenset(("actuation_gain", "servo_stiffness")): ("hold", "5 s at postures of other loads"),
}
LIKELY = 0.05  # of an effect that may stand in another's place


def proposals(joints: Sequence[Joint]) -> Iterator[dict[str, Any]]:
    """One entry a joint and pair of effects that it leaves open."""
    for joint in joints:
        for name, instead in joint.instead.items():
            for other, p in instead.items():
                kind = PARTED.get(frozenset((name, other)))
                if kind is not None and p > LIKELY:
                    motion = f"{kind[0]}, {kind[1]}"
                    yield {"joint": joint.number, "motion": motion, "tells": f"{name} from {other}"}
