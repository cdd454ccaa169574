"""What is really wrong with a case, as its truth file says."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS, REGISTRY
from plumbline.kinematics.effects.effect import Stage
from plumbline.kinematics.files import read_file, reason
from plumbline.optim.diagnosis.findings import Key

LISTED = {*REGISTRY, *(effect.name for effect in MOTION_EFFECTS)}
FAINT_BELOW, SLIGHT_BELOW = 0.7, 1.0  # gaps over the noise that end a level
OF_JOINTS = (Stage.JOINT, Stage.ACTUATION)  # stages whose elements are joints


class Sort(StrEnum):
    """What a case is to a library that lacks the effects left out."""

    NONE = "none"
    SINGLE = "single"
    SEVERAL = "several"
    OUTSIDE = "outside"
    PARTLY = "partly outside"


@dataclass(frozen=True)
class Truth:
    """The truth about one case."""

    case: str  # name of the case
    causes: tuple[Key, ...]  # effect and element of all that is wrong
    unknown: tuple[Key, ...] = ()  # those of them that the library lacks
    # pairs (cause, rival of the library) that the recording cannot tell apart
    confounded: frozenset[tuple[Key, Key]] = frozenset()
    # faint, slight or clear, by the weakest cause; ``no gap``, or ``unstated``
    level: str = "unstated"
    rows: int = 0  # number of readings; 0 where not stated
    observation: str = ""  # what a row measured; empty where not stated
    noise_std: float | None = None  # 1 sigma of one axis [m or rad]; None where not stated
    # what noise added to these very readings, rms per axis, gross errors aside [m or rad]; None
    # where not stated
    noise_rms: float | None = None
    depends_on: tuple[str, ...] = ()  # on what the unknown effects depend
    joints: tuple[int, ...] = ()  # joints whose own the unknown effects are

    @property
    def known(self) -> tuple[Key, ...]:
        """The causes that the library has."""
        return tuple(cause for cause in self.causes if cause not in self.unknown)

    @property
    def sort(self) -> Sort:
        """What the case is to the library."""
        if not self.causes:
            return Sort.NONE
        if self.unknown:
            return Sort.PARTLY if self.known else Sort.OUTSIDE
        return Sort.SINGLE if len(self.causes) == 1 else Sort.SEVERAL

    @property
    def size(self) -> str:
        """The number of rows, in words that a table can show."""
        if not self.rows:
            return "unstated"
        return "under 60" if self.rows < 60 else "60 to 140" if self.rows <= 140 else "over 140"


def read_truth(path: Path, without: tuple[str, ...] = ()) -> Truth:
    """Read a truth file (PlumblineError: it is not there, or its effects cannot be understood)."""
    try:
        content = json.loads(read_file(path))
        truth = _truth(path.stem, content, without)
    except OSError as error:
        raise PlumblineError(f"{path}: the truth cannot be read ({reason(error)})") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise PlumblineError(
            f'{path}: no truth; expected {{"effects": [{{"effect": "backlash", "element": 2}}]}}'
        ) from None
    _check_spelling(path, truth.causes)
    return truth


def _truth(case: str, content: dict[str, Any], without: tuple[str, ...]) -> Truth:
    effects = content["effects"]
    causes = tuple(key_of(effect) for effect in effects)
    unknown = tuple(key for key in causes if key[0] not in LISTED or key[0] in without)
    gaps = [float(e["gap_to_noise"]) for e in effects if e.get("gap_to_noise") is not None]
    depends = [
        str(word)
        for effect, key in zip(effects, causes, strict=True)
        if key in unknown
        for word in (effect.get("parameters") or {}).get("depends_on", ())
    ]
    pairs = [_pair(entry) for entry in content.get("confounded", content.get("twins", ()))]
    joints = [
        key[1]
        for effect, key in zip(effects, causes, strict=True)
        if key in unknown and key[1] is not None and _stage(effect) in OF_JOINTS
    ]
    return Truth(
        case=case,
        causes=causes,
        unknown=unknown,
        confounded=frozenset(t for t in pairs if t[1][0] in LISTED and t[1][0] not in without),
        level=_level(gaps, len(effects)),
        rows=int(content.get("rows", 0)),
        observation=str(content.get("observation", "")),
        noise_std=number_of(content, "noise_std"),
        noise_rms=number_of(content, "noise_rms"),
        depends_on=tuple(depends),
        joints=tuple(joints),
    )


def _stage(effect: dict[str, Any]) -> str:
    """Where along the chain an effect acts: as it says itself, or as the library has it."""
    said = (effect.get("parameters") or {}).get("stage")
    listed = REGISTRY.get(str(effect["effect"]))
    return str(said if listed is None else listed.stage)


def number_of(content: dict[str, Any], key: str) -> float | None:
    """A number that may be missing; written as a word it is read as a number."""
    found = content.get(key)
    return None if found is None else float(found)


def _level(gaps: list[float], effects: int) -> str:
    if not effects:
        return "no gap"
    if len(gaps) < effects:
        return "unstated"
    return "faint" if min(gaps) < FAINT_BELOW else "slight" if min(gaps) < SLIGHT_BELOW else "clear"


def key_of(entry: dict[str, Any]) -> Key:
    """Effect and element, a whole number or none, of an entry (PlumblineError: it is another)."""
    element = entry.get("element")
    if element is not None and (isinstance(element, bool) or int(element) != float(element)):
        raise PlumblineError(f"element: found {element}, expected a whole number; mend it")
    return (str(entry["effect"]), None if element is None else int(element))


def _check_spelling(path: Path, causes: Iterable[Key]) -> None:
    """A name of the library in another spelling would count as unknown to it."""
    plain = {name.replace("_", ""): name for name in LISTED}
    for name, _ in causes:
        meant = plain.get("".join(filter(str.isalnum, name.lower())))
        if meant and name != meant:
            raise PlumblineError(f"{path}: found the effect {name!r}, expected {meant}")


def _pair(entry: dict[str, Any]) -> tuple[Key, Key]:
    effect, element = entry["of"]
    return (str(effect), None if element is None else int(element)), key_of(entry)
