"""A stored model read again, strictly: what is missing, damaged or hostile gets one line.

Nothing that is read is run; every number is checked, and the model is tried at one posture before
it is handed out.
"""

import re
from collections.abc import Mapping
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, fault, one_line, shown
from plumbline.kinematics.constants import LARGEST
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.effects.effect import FIDUCIALS, OF_AN_ARM, RANGES
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.storing import effect_named
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.constants import (
    AGREES,
    LARGEST_MODEL,
    LONGEST_CHAIN,
    LONGEST_WORD,
    MOST_EFFECTS,
)
from plumbline.optim.model.fitted import Held, chain_of
from plumbline.optim.model.rows import CONTEXT, SCALARS, VECTORS
from plumbline.optim.model.stored import FORMAT, VERSION
from plumbline.optim.recording.kinds import KINDS
from plumbline.optim.recording.settings import Section, read_settings_file

SAVE_IT = "save the model again"
NUISANCE = re.compile(r"(frame|tool|socket)( \S+)? r?[xyz]")


def read(path: str | Path) -> dict[str, Any]:
    """The fields of a stored model (PlumblineError: no such file, no model, or a damaged one)."""
    top = settings_of(path, FORMAT, VERSION)
    robot, tip = robot_of(top.section("robot"))
    effects, values = _effects(top)
    found = _parts(top, robot, tip) | {"effects": effects, "values": values}
    found["covariance"] = _covariance(top, len(found["nuisance_names"]) + len(values))
    _try_it(top, found)
    return found


def settings_of(path: str | Path, form: str, version: int) -> Section:
    """What a file of TOML says (PlumblineError: it cannot be read, or is of another form)."""
    top = read_settings_file(Path(path), LARGEST_MODEL)
    if top.values.get("format") != form:
        raise top.fault("format", f"{form!r}", "give what --model or save wrote")
    if top.values.get("version") != version:
        raise top.fault("version", str(version), SAVE_IT)
    return top


def tables_of(section: Section, key: str, title: str) -> list[dict[str, object]]:
    """The tables of a list, which only effects may lack; refused if it is something else."""
    blocks = section.values.get(key, [] if key == "effects" else None)
    if not isinstance(blocks, list) or not all(isinstance(block, dict) for block in blocks):
        raise section.fault(key, f"tables [[{title}]]", SAVE_IT)
    return blocks


def robot_of(section: Section) -> tuple[Robot, str]:
    """A stored robot, and the tip frame meant; refused if it cannot be made."""
    tip, name = word_of(section, "tip_frame"), word_of(section, "name")
    gravity = array_of(section, "gravity", (3,))
    urdf, mjcf, rows = section.word("urdf"), section.word("mjcf"), section.values.get("dh")
    try:
        if urdf is not None:
            robot = Robot.from_urdf(urdf.lstrip(), name=name, gravity=gravity)
        elif mjcf is not None:
            robot = Robot.from_mjcf(mjcf.lstrip(), name=name, gravity=gravity)
        elif isinstance(rows, list) and all(isinstance(row, dict) for row in rows):
            last = word_of(section, "last_frame")
            robot = Robot.from_dh(rows, name=name, tip_frame=last, gravity=gravity)
        else:
            raise section.fault("dh", "urdf, mjcf or [[robot.dh]]", SAVE_IT)
        chain = robot.chain(tip)
    except PlumblineError as error:
        raise PlumblineError(one_line(f"{section.file}, [robot]: {error}")) from None
    if chain.n > LONGEST_CHAIN:
        raise fault(
            f"{section.file}, [robot]", f"{chain.n} joints", f"at most {LONGEST_CHAIN}", SAVE_IT
        )
    return robot, tip


def _effects(top: Section) -> tuple[tuple[Effect, ...], Array]:
    blocks = tables_of(top, "effects", "effects")
    if len(blocks) > MOST_EFFECTS:
        raise fault(
            f"{top.file}, [[effects]]", f"{len(blocks):,}", f"at most {MOST_EFFECTS:,}", SAVE_IT
        )
    made = [_effect(top.file, k, block) for k, block in enumerate(blocks, start=1)]
    values = [v for _, own in made for v in own]
    return tuple(effect for effect, _ in made), np.array(values, dtype=float)


def _effect(file: str, number: int, block: Mapping[str, object]) -> tuple[Effect, list[float]]:
    where = f"{file}, [[effects]] {number}"
    name = str(block.get("effect"))
    try:
        kind = effect_named(name, str(block.get("form", "")))
    except PlumblineError as error:
        raise PlumblineError(f"{where}: {error}") from None
    own = {f.name: f for f in fields(kind)}
    extra = [key for key in block if key not in {*own, "effect", "form", "values"}]
    if extra:
        raise fault(f"{where}, {extra[0][:40]}", "an unknown key", ", ".join(own), SAVE_IT)
    arguments = {key: _field(f"{where}, {key}", block[key], f)
                 for key, f in own.items() if key in block}  # fmt: skip
    try:
        effect = kind(**arguments)
        names = [p.name for p in effect.parameters]
    except (TypeError, ValueError, IndexError) as error:
        raise fault(where, f"fields that do not fit ({error})", f"a {name}", SAVE_IT) from None
    given = block.get("values")
    if not isinstance(given, dict) or list(given) != names:
        raise fault(f"{where}, values", shown(given), ", ".join(names), SAVE_IT)
    return effect, [number_of(f"{where}, {key}", value) for key, value in given.items()]


def _field(where: str, value: object, of: Field[Any]) -> object:
    """A field's value, of the kind that it is declared to be."""
    if isinstance(of.default, bool):
        if isinstance(value, bool):
            return value
        raise fault(where, shown(value), "true or false", SAVE_IT)
    if isinstance(value, list) and str(of.type).startswith("tuple"):
        return tuple(number_of(where, v) for v in value)
    if isinstance(value, str) and isinstance(of.default, str):
        return value
    number = number_of(where, value)
    return value if isinstance(value, int) else number


def number_of(where: str, value: object) -> float:
    """A finite number (PlumblineError: it is none)."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise fault(where, shown(value), "a finite number", SAVE_IT)
    return float(value)


def _parts(top: Section, robot: Robot, tip: str) -> dict[str, Any]:
    tool, frame, gap = (top.section(key) for key in ("tool", "frame", "gap"))
    T = homogeneous(_rotation(frame, "rotation"), array_of(frame, "translation", (3,)))
    observation = word_of(top, "observation")
    if observation not in (*KINDS, *RANGES, *FIDUCIALS):
        raise top.fault("observation", ", ".join(KINDS), SAVE_IT)
    ranges = _ranges(top.section("ranges"))
    n = chain_of(robot, tip, observation, ranges).n
    if ranges["q"].shape[1] != n:
        found = f"{ranges['q'].shape[1]} joints"
        raise fault(f"{top.file}, [ranges] q", found, f"{n}", SAVE_IT)
    return {
        "recording": word_of(top, "recording"),
        "observation": observation,
        "robot": robot,
        "tip_frame": tip,
        "always": top.words("always") or (),
        "nuisance_names": _nuisance_names(top.section("unknowns")),
        "T_device_base": T,
        "centre": array_of(frame, "centre", (3,)),
        "tool_offset": array_of(tool, "nominal", (3,)),
        "tool": array_of(tool, "offset", (3,)),
        "R_tip_tool": _rotation(tool, "rotation"),
        "sockets": _sockets(top.section("sockets")),
        "samples": _samples(top.section("samples"), n),
        "ranges": ranges,
        "held": _held(gap),
    }


def _nuisance_names(section: Section) -> tuple[str, ...]:
    names = section.words("nuisances")
    if names is None or not all(map(NUISANCE.fullmatch, names)):
        raise section.fault(
            "nuisances", "names such as 'frame x', 'tool rz', 'socket 1 x'", SAVE_IT
        )
    return names


def _held(section: Section) -> Held:
    unit = word_of(section, "unit")
    numbers = {}
    for key in ("before", "after", "floor", "sigma"):
        value = section.values.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise section.fault(key, "a number, or nan", SAVE_IT)
        numbers[key] = float(value)
    return Held(unit=unit, **numbers)


def _sockets(section: Section) -> dict[int, Array]:
    if any(not key.lstrip("-").isdigit() or len(key) > 18 for key in section.values):
        raise fault(f"{section.file}, [sockets]", "a key that is no number", "numbers", SAVE_IT)
    return {int(key): array_of(section, key, (3,)) for key in section.values}


def _samples(section: Section, n: int) -> dict[str, Array]:
    widths = section.values.get("columns")
    allowed = {"q": n, "force": 3} | dict.fromkeys(SCALARS, 1) | dict.fromkeys(VECTORS, n)
    fits = isinstance(widths, dict) and "q" in widths
    if not isinstance(widths, dict) or not fits or not widths.items() <= allowed.items():
        raise section.fault("columns", f"q = {n}, and context", SAVE_IT)
    rows = _lines(section, "rows")
    table = np.array(rows, dtype=float) if len({len(r) for r in rows}) == 1 else np.empty((0, 0))
    if table.ndim != 2 or table.shape[1] != sum(widths.values()):
        raise section.fault("rows", f"{sum(widths.values())} numbers a line", SAVE_IT)
    edges = np.cumsum([0, *widths.values()])
    return {k: table[:, a:b] for k, a, b in zip(widths, edges, edges[1:], strict=False)}


def _ranges(section: Section) -> dict[str, Array]:
    if "q" not in section.values or any(key not in ("q", *CONTEXT) for key in section.values):
        found = shown(list(section.values))
        raise fault(f"{section.file}, [ranges]", found, "q and context", SAVE_IT)
    n = np.shape(np.array(section.values["q"], dtype=object))[-1:]
    width = dict.fromkeys(section.values, (1,)) | dict.fromkeys(("q", *VECTORS), n)
    width["force"] = (3,)
    return {key: array_of(section, key, (2, *width[key])) for key in section.values}


def _covariance(top: Section, size: int) -> Array:
    section = top.section("covariance")
    numbers = [v for row in _lines(section, "lower") for v in row]
    if len(numbers) != size * (size + 1) // 2:
        raise section.fault("lower", f"a lower triangle of {size} rows", SAVE_IT)
    C = np.zeros((size, size))
    C[np.tril_indices(size)] = numbers
    C = np.tril(C) + np.tril(C, -1).T
    if (np.diag(C) < 0.0).any():
        raise section.fault("lower", "variances of at least 0", SAVE_IT)
    return C


def _lines(section: Section, key: str) -> list[list[float]]:
    text = section.values.get(key)
    if not isinstance(text, str):
        raise section.fault(key, "lines of numbers", SAVE_IT)
    try:
        rows = [
            [float(word) for word in line.split()] for line in text.splitlines() if line.strip()
        ]
    except ValueError:
        raise section.fault(key, "numbers alone", SAVE_IT) from None
    if not all(abs(v) <= LARGEST for row in rows for v in row):
        raise section.fault(key, "finite numbers", SAVE_IT)
    return rows


def word_of(section: Section, key: str) -> str:
    """A word that must be there (PlumblineError: it is not)."""
    word = section.word(key)
    if word is None or len(word) > LONGEST_WORD:
        raise section.fault(key, "a word in quotes", SAVE_IT)
    return one_line(word)


def array_of(section: Section, key: str, shape: tuple[int, ...]) -> Array:
    """Finite numbers of a shape (PlumblineError: there are none)."""
    try:
        values = np.array(section.values.get(key), dtype=float)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape != shape or not (np.abs(values) <= LARGEST).all():
        raise section.fault(key, f"finite numbers of shape {shape}", SAVE_IT)
    return values


def _rotation(section: Section, key: str) -> Array:
    R = array_of(section, key, (3, 3))
    if np.abs(R @ R.T - np.eye(3)).max() > AGREES or np.linalg.det(R) < 0.0:
        raise section.fault(key, "a rotation, orthonormal to 1e-9", SAVE_IT)
    return R


def _try_it(top: Section, found: Mapping[str, Any]) -> None:
    """Ask the model once: refused if an effect is of no joint of it, or no finite tip comes."""
    arm = Arm(**found)
    n = arm.chain.n
    for number, effect in enumerate(arm.effects, start=1):
        of_arm = effect.stage in OF_AN_ARM  # others may be of a plane
        if of_arm and effect.element is not None and not 1 <= effect.element <= n:
            where = f"{top.file}, [[effects]] {number}"
            raise fault(where, f"element {effect.element}", f"1 to {n}", SAVE_IT)
    try:
        tips = arm.tip(arm.samples["q"][:1])
    except (IndexError, RuntimeError, KeyError, ValueError, TypeError, ArithmeticError) as error:
        why = f"effects that cannot be evaluated ({one_line(str(error))[:80]})"
        raise fault(top.file, why, "those of the robot", SAVE_IT) from None
    if not np.isfinite(tips).all():
        raise fault(top.file, "values that give no finite tip", "finite ones", SAVE_IT)
