"""What is taken home as TOML that a person can read, whole or not at all, and the way back.

The fields are stored as those of any answer are (:mod:`plumbline.optim.core.answer`): all values to
the last bit, nothing that is read is run, and a model is tried at one posture before it is handed
out.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from plumbline.errors import PlumblineError, fault, one_line, shown
from plumbline.kinematics.effects.effect import FIDUCIALS, OF_AN_ARM, RANGES
from plumbline.kinematics.files import new_file
from plumbline.kinematics.toml_text import document
from plumbline.optim.core.answer import again, stored
from plumbline.optim.core.problem import Array
from plumbline.optim.model import constants
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.rows import SCALARS, VECTORS
from plumbline.optim.recording.kinds import KINDS
from plumbline.optim.recording.settings import read_settings_file

SAVE_IT = "save it again"
UNITS = "SI units: m, rad, s, kg, N, degC. Read it with plumbline.load."
T = TypeVar("T")


def save(
    path: str | Path, found: Any, form: tuple[str, int], remarks: Iterable[str], *, overwrite: bool
) -> None:
    """Store it in a format of some version, remarks for the reader in front."""
    head = [f"# {one_line(words)}" for words in (repr(found), UNITS, *remarks)]
    named = {"format": form[0], "version": form[1]}
    text = "\n".join([*head, document(named | stored(found))])
    new_file(path, text, overwrite=overwrite)


def load(path: str | Path, kind: type[T], form: tuple[str, int]) -> T:
    """What was stored (PlumblineError: no such file, of another format, or damaged)."""
    top = read_settings_file(Path(path), constants.LARGEST_MODEL)
    for key, value in zip(("format", "version"), form, strict=True):
        if top.values.get(key) != value:
            raise top.fault(key, repr(value), "give what --model or save wrote, or save it again")
    return again(top.values, kind, top.file, SAVE_IT)


def refuse_odd(file: str, pieces: Mapping[str, tuple[Array, tuple[int, ...]]]) -> None:
    """Refuse numbers that are not of their shape, or not finite."""
    for name, (values, shape) in pieces.items():
        far = values[~(np.abs(values) <= constants.LARGEST)]
        if values.shape != shape or far.size:
            odd = f"{far[0]:.6g}" if far.size else f"numbers of shape {values.shape}"
            raise fault(f"{file}, {name}", odd, f"finite numbers of shape {shape}", SAVE_IT)


def refuse_words(file: str, *words: str) -> None:
    """Refuse names that no one line holds."""
    for word in words:
        if len(word) > constants.LONGEST_WORD or not word.isprintable():
            raise fault(file, f"the name {shown(word)}", "a short one, on a line", SAVE_IT)


def refuse_damaged(file: str, arm: Arm) -> None:
    """Refuse a model whose parts do not fit together, or that gives no finite tip."""
    refuse_words(file, arm.recording, arm.tip_frame, *arm.nuisance_names)
    if arm.observation not in (*KINDS, *RANGES, *FIDUCIALS):
        raise fault(f"{file}, observation", arm.observation, ", ".join(KINDS), SAVE_IT)
    if (count := len(arm.effects)) > constants.MOST_EFFECTS:
        raise fault(
            f"{file}, effects", f"{count:,}", f"at most {constants.MOST_EFFECTS:,}", SAVE_IT
        )
    refuse_odd(file, dict(_pieces(arm)))
    for name, R in (("R_tip_tool", arm.R_tip_tool), ("T_device_base", arm.T_device_base[:3, :3])):
        if np.abs(R @ R.T - np.eye(3)).max() > constants.AGREES or np.linalg.det(R) < 0.0:
            raise fault(f"{file}, {name}", "no rotation", "one, orthonormal to 1e-9", SAVE_IT)
    if (np.diag(arm.covariance) < 0.0).any():
        raise fault(f"{file}, covariance", "a negative variance", "at least 0", SAVE_IT)
    _try_it(file, arm)


def _pieces(arm: Arm) -> Iterator[tuple[str, tuple[Array, tuple[int, ...]]]]:
    """Numbers of a model by name, each with the shape that it must have."""
    n, E = arm.chain.n, sum(len(effect.parameters) for effect in arm.effects)
    P = len(arm.nuisance_names) + E
    yield "values", (arm.values, (E,))
    yield "covariance", (arm.covariance, (P, P))
    yield "T_device_base", (arm.T_device_base, (4, 4))
    yield "R_tip_tool", (arm.R_tip_tool, (3, 3))
    for name in ("centre", "tool_offset", "tool"):
        yield name, (getattr(arm, name), (3,))
    for label, place in arm.sockets.items():
        yield f"sockets.{label}", (place, (3,))
    widths = {"q": n, "force": 3} | dict.fromkeys(SCALARS, 1) | dict.fromkeys(VECTORS, n)
    for title, columns, rows in (
        ("samples", arm.samples, len(arm.samples["q"])), ("ranges", arm.ranges, 2),
    ):  # fmt: skip
        for name, values in columns.items():
            yield f"{title}.{name}", (values, (rows, widths[name]))


def _try_it(file: str, arm: Arm) -> None:
    """Ask the model once: refused if an effect is of no joint of it, or no finite tip comes."""
    n = arm.chain.n
    for number, effect in enumerate(arm.effects, start=1):
        of_arm = effect.stage in OF_AN_ARM  # others may be of a plane
        if of_arm and effect.element is not None and not 1 <= effect.element <= n:
            where = f"{file}, effects {number}"
            raise fault(where, f"element {effect.element}", f"1 to {n}", SAVE_IT)
    try:
        tips = arm.tip(arm.samples["q"][:1])
    except (IndexError, RuntimeError, KeyError, ValueError, TypeError, ArithmeticError) as error:
        why = f"effects that cannot be evaluated ({one_line(str(error))[:80]})"
        raise fault(file, why, "those of the robot", SAVE_IT) from None
    if not np.isfinite(tips).all():
        raise fault(file, "values that give no finite tip", "finite ones", SAVE_IT)


def in_file(path: str | Path, error: Exception) -> PlumblineError:
    """An error of what a file holds, with the file's name in front."""
    return PlumblineError(one_line(f"{Path(path).name}: {error}"))
