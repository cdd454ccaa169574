"""A model as TOML that a person can read, whole or not at all; see ``reading`` for the way back.

Matrices and rows stand as lines of numbers in a literal string: the covariance as its lower
triangle, to nine digits; all values to the last bit.
"""

import json
from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from plumbline.errors import fault, one_line
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.toml_text import pairs, quoted, value_text
from plumbline.optim.model.fitted import Fitted, Known

FORMAT = "plumbline model"
VERSION = 2
MAKE_IT = "make it by Robot.from_urdf, from_mjcf or from_dh"


def text_of(model: Fitted) -> str:
    """The file's text."""
    head = [
        f"# {one_line(repr(model))}",
        "# SI units: m, rad, s, kg, N, degC. Read it with plumbline.Model.load.",
        *pairs(
            {
                "format": FORMAT,
                "version": VERSION,
                "recording": model.recording,
                "observation": model.observation,
                "always": list(model.always),
            }
        ),
    ]
    T = model.T_device_base
    tool = {"nominal": model.tool_offset, "offset": model.tool, "rotation": model.R_tip_tool}
    frame = {"rotation": T[:3, :3], "translation": T[:3, 3], "centre": model.centre}
    sockets = {str(k): place for k, place in model.sockets.items()}
    blocks = [
        head,
        ["[gap]", *pairs(vars(model.held))],
        *robot_blocks(model.robot, model.tip_frame),
        ["[tool]", *pairs(tool)],
        ["[frame]  # of the robot's base in the device's frame", *pairs(frame)],
        ["[sockets]", *pairs(sockets)] if sockets else [],
        *_effects(model),
        _nuisances(model),
        ["[ranges]  # smallest and largest of what was fitted", *pairs(dict(model.ranges))],
        _samples(model),
        _covariance(model),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def robot_blocks(robot: Robot, tip_frame: str) -> Iterator[list[str]]:
    """A robot as blocks of lines: its URDF or MJCF whole, or its DH rows."""
    head = {"name": robot.name, "tip_frame": tip_frame, "gravity": robot.gravity}
    for kind, text in (("urdf", robot.urdf), ("mjcf", robot.mjcf)):
        if text is not None:
            yield ["[robot]", *pairs(head), f"{kind} = {_text(text)}"]
            return
    if robot.dh is None:
        raise fault(robot.name, "a robot made of no file", "URDF, MJCF or DH rows", MAKE_IT)
    yield ["[robot]", *pairs(head | {"last_frame": robot.default_tip})]
    for row in robot.dh:
        values = {f.name: getattr(row, f.name) for f in fields(row)}
        limits = np.isfinite([row.lower, row.upper])
        for key, kept in zip(("lower", "upper"), limits, strict=True):
            if not kept:
                del values[key]
        yield ["[[robot.dh]]", *pairs(values)]


def _effects(model: Fitted) -> Iterator[list[str]]:
    first = 0
    known = list(model.parameters.values())
    for effect in model.effects:
        said = {f.name: getattr(effect, f.name) for f in fields(effect)}
        own = {key: value for key, value in said.items() if value is not None}
        lines = [
            "[[effects]]",
            *pairs({"effect": effect.name, "form": type(effect).__name__} | own),
        ]
        for p in effect.parameters:
            lines.append(
                f"values.{p.name} = {value_text(known[first].value)}  # {_said(known[first])}"
            )
            first += 1
        yield lines


def _said(known: Known) -> str:
    return one_line(f"{known.unit}, std {known.std:.3g}" + (f"; {known.doc}" if known.doc else ""))


def _nuisances(model: Fitted) -> list[str]:
    """For the reader alone: the same numbers stand in frame, tool and sockets."""
    found = {n: k for n, k in model.nuisances.items() if n in model.nuisance_names}
    lines = [f"# {name}: {known}; {known.doc}" for name, known in found.items()]
    return [*lines, f"[unknowns]\nnuisances = {json.dumps(list(model.nuisance_names))}"]


def _samples(model: Fitted) -> list[str]:
    widths = {name: v.shape[1] for name, v in model.samples.items()}
    rows = np.hstack(list(model.samples.values()))
    inline = ", ".join(f"{name} = {width}" for name, width in widths.items())
    lines = "\n".join(" ".join(f"{v:.10g}" for v in row) for row in rows)
    return ["[samples]  # some rows of the recording", f"columns = {{ {inline} }}",
            f"rows = '''\n{lines}\n'''"]  # fmt: skip


def _covariance(model: Fitted) -> list[str]:
    C = model.covariance
    lower = [f"{v:.8e}" for v in C[np.tril_indices(len(C))]]
    lines = "\n".join(" ".join(lower[k : k + 8]) for k in range(0, len(lower), 8))
    return ["[covariance]  # of the nuisances' small changes, then of the effects' values",
            f"lower = '''\n{lines}\n'''"]  # fmt: skip


def _text(text: str) -> str:
    printable = all(c.isprintable() or c in "\n\t" for c in text)
    plain = "'''" not in text and not text.endswith("'") and printable
    return f"'''\n{text}'''" if plain else quoted(text)
