r"""A robot from MuJoCo's XML (MJCF), read by Pinocchio and mended where the two differ.

Against MuJoCo, Pinocchio's reader takes the axis of ``axisangle`` as it stands, without its
:math:`1/|a|`; counts limits of a joint from its ``ref`` on; and turns limits of slides from degrees
into radians. A base that floats is held where the file puts it.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

import re
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from plumbline.errors import PlumblineError, one_line
from plumbline.kinematics.constants import LARGEST
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.oracle import pin

PLACE = re.compile(r"(?i)^(from file|in function|at line|message:)")  # of what Pinocchio says first
# Numbers of the attributes that make a robot: Pinocchio takes what it finds in memory for others.
COUNTS = {"pos": 3, "axis": 3, "euler": 3, "zaxis": 3, "diaginertia": 3, "quat": 4, "axisangle": 4,
          "xyaxes": 6, "fullinertia": 6, "range": 2, "mass": 1, "ref": 1}  # fmt: skip
PARTS = ("body", "joint", "inertial", "geom", "site", "frame")
FREE = 6  # degrees of freedom of a base that floats
FLATTEN = (
    "python -c \"import mujoco as m; m.mj_saveLastXML('flat.xml', "
    "m.MjModel.from_xml_path('FILE'))\""
)


def model_from_mjcf(text: str, where: str, most_joints: int) -> tuple[pin.Model, Array | None]:
    """A Pinocchio model (PlumblineError: none), and the file's gravity (3,) [m/s^2], if any."""
    root = _parsed(text, where, most_joints)
    for element in root.iter():
        if "axisangle" in element.attrib:
            element.set("axisangle", _normalised(element.get("axisangle", ""), where))
    try:
        with tempfile.TemporaryDirectory() as scratch:
            file = Path(scratch) / "robot.xml"
            file.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
            model = pin.buildModelFromMJCF(str(file))
    except (ValueError, RuntimeError, KeyError, IndexError) as error:
        said = [s for s in map(str.strip, str(error).splitlines()) if s and not PLACE.match(s)]
        why = one_line(said[0] if said else "Pinocchio cannot read it")
        raise PlumblineError(
            f"{where}: not a readable MJCF ({why[:80]}); see that MuJoCo loads it, then flatten "
            f"it: {FLATTEN}"
        ) from None
    _mend_limits(model, root)
    free = [j for j in range(1, model.njoints) if model.joints[j].nv == FREE]
    held = pin.buildReducedModel(model, free, pin.neutral(model)) if free else model
    return held, _gravity(root)


def _parsed(text: str, where: str, most_joints: int) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise PlumblineError(f"{where}: broken XML ({error}); copy the file again") from None
    if root.tag != "mujoco":
        raise PlumblineError(f"{where}: <{root.tag}> found, <mujoco> expected; give an MJCF")
    if root.find(".//include") is not None:
        raise PlumblineError(
            f"{where}: it includes other files, one file expected; flatten it: {FLATTEN}"
        )
    if root.find("worldbody/body") is None:
        raise PlumblineError(f"{where}: no body found, at least 1 expected that moves")
    for element in (e for e in root.iter() if e.tag in PARTS):
        _refuse_odd_numbers(element, where)
    count = len(root.findall(".//worldbody//joint"))
    if count > most_joints:
        raise PlumblineError(f"{where}: {count:,} joints, at most {most_joints} expected")
    return root


def _refuse_odd_numbers(element: ElementTree.Element, where: str) -> None:
    """Refuse an attribute that does not hold as many finite numbers as it must."""
    for key in (k for k in element.attrib if k in COUNTS):
        words = element.get(key, "").split()
        try:
            good = len(words) == COUNTS[key] and all(abs(float(word)) < LARGEST for word in words)
        except ValueError:
            good = False
        if not good:
            found = f"<{element.tag}> {key}={one_line(' '.join(words))[:40]!r}"
            raise PlumblineError(
                f"{where}: {found}, {COUNTS[key]} finite numbers expected; mend it"
            )


def _normalised(words: str, where: str) -> str:
    """``axisangle`` with an axis of length one."""
    try:
        *axis, angle = map(float, words.split())
    except ValueError:
        axis, angle = [], 0.0
    length = float(np.linalg.norm(axis))
    if len(axis) != 3 or not length > 0.0:
        found = f"axisangle={one_line(words)[:40]!r}"
        raise PlumblineError(f"{where}: {found}, an axis and an angle expected")
    return " ".join(repr(float(value)) for value in (*(np.array(axis) / length), angle))


def _mend_limits(model: pin.Model, root: ElementTree.Element) -> None:
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    refs = {j.get("name", ""): float(j.get("ref", 0.0)) for j in root.iter("joint")}
    for j in range(1, model.njoints):
        joint = model.joints[j]
        if joint.nq != 1:
            continue
        slides = "JointModelP" in joint.shortname()
        ref = refs.get(model.names[j], 0.0) * (np.pi / 180.0 if degrees and not slides else 1.0)
        factor = 180.0 / np.pi if degrees and slides else 1.0
        for limit in (model.lowerPositionLimit, model.upperPositionLimit):
            limit[joint.idx_q] = factor * limit[joint.idx_q] + ref


def _gravity(root: ElementTree.Element) -> Array | None:
    option = root.find("option")
    words = (option.get("gravity") or "").split() if option is not None else []
    try:
        return np.array([float(word) for word in words]) if len(words) == 3 else None
    except ValueError:
        return None
