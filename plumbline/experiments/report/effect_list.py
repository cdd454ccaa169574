"""The library of effects as a list: what each one means, where it sits and what it needs.

``plumbline list --effects`` prints it, and the README's table is :func:`markdown`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

from plumbline.kinematics.effects import EFFECTS, MOTION_EFFECTS, Effect, MotionEffect
from plumbline.kinematics.effects.drive import TORQUES
from plumbline.kinematics.effects.effect import (
    DEVICE_OBSERVATIONS,
    FIDUCIALS,
    RANGES,
    TIP_OBSERVATIONS,
    TOOL_OBSERVATIONS,
)
from plumbline.optim.diagnosis.motion.recording import OBSERVATION

SEEN_IN = {
    TIP_OBSERVATIONS: "tip readings or ranges",
    (*TIP_OBSERVATIONS, *FIDUCIALS): "tip readings, ranges or fiducials",
    TOOL_OBSERVATIONS: "tip readings",
    DEVICE_OBSERVATIONS: "a measuring device",
    (*DEVICE_OBSERVATIONS, *FIDUCIALS): "a measuring device or fiducials",
    RANGES: "ranges on planes",
    FIDUCIALS: "fiducials",
    TORQUES: "efforts",
}
Library: TypeAlias = Sequence[type[Effect] | type[MotionEffect]]
EVERY: Library = (*EFFECTS, *MOTION_EFFECTS)
NUMBER = "N"  # stands for the number of a joint or link
ANOTHER = "M"  # stands for whatever else a sentence has room for


class _Names(dict[str, str]):
    """What stands for the fields that a sentence names."""

    def __missing__(self, name: str) -> str:
        return ANOTHER


HEADINGS = ("effect", "stage", "what it means", "needs")


@dataclass(frozen=True)
class Listed:
    """An effect as a newcomer meets it."""

    name: str  # what ``--without`` and ``[fit] always`` call it
    stage: str  # where along the chain it sits
    words: str  # what it means, N standing for the number of a joint or link
    needs: str  # what a recording must have to show it, in words; empty where any will do
    columns: tuple[str, ...]  # columns that it needs, all of them
    one_of: tuple[str, ...]  # columns of which one will do
    observations: tuple[str, ...]  # kinds of observation that can show it
    reference: str  # who describes it

    @classmethod
    def of(cls, effect: type[Effect] | type[MotionEffect]) -> Self:
        """What an effect declares."""
        if issubclass(effect, MotionEffect):
            return cls._of_a_drive(effect)
        columns = tuple(c for c in effect.needs if c not in effect.needs_one_of)
        parts = [" or ".join(effect.needs_one_of), *columns]
        parts += ["one motion" if effect.in_motion else "", SEEN_IN.get(effect.observations, "")]
        return cls(
            name=effect.name,
            stage=str(effect.stage),
            words=effect.words.format_map(_Names(element=NUMBER)),
            needs=", ".join(filter(None, parts)),
            columns=columns,
            one_of=effect.needs_one_of,
            observations=effect.observations,
            reference=effect.reference,
        )

    @classmethod
    def _of_a_drive(cls, effect: type[MotionEffect]) -> Self:
        needs = "a motion of a robot with masses" if effect.needs_masses else "a motion"
        words = effect.words.format(element=NUMBER)
        stage, reference = str(effect.stage), effect.reference
        return cls(effect.name, stage, words, needs, (), (), (OBSERVATION,), reference)


def listed(library: Library = EVERY) -> tuple[Listed, ...]:
    """Every effect of a library, in its order."""
    return tuple(Listed.of(effect) for effect in library)


def markdown(library: Library = EVERY) -> str:
    """The list as a table for the README."""
    rows = [(f"`{e.name}`", e.stage, e.words, e.needs) for e in listed(library)]
    lines = [HEADINGS, ("---",) * len(HEADINGS), *rows]
    return "".join(f"| {' | '.join(cells)} |\n".replace("|  |", "| |") for cells in lines)
