"""A robot: a Pinocchio model of a URDF, an MJCF, DH rows, or bundled, or of a known package.

``Robot.bundled("ur5").chain()`` is the serial chain that every symbolic problem is stated on.

Robots of the `example-robot-data` package: the URDF files that Pinocchio's own examples use.

The package holds files and no code; it is optional (``pip install "plumbline-robotics[robots]"``,
some 430 MB with its meshes). A robot is called as its file is, without a closing ``_robot``.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import resources
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, best_matches
from plumbline.kinematics.chain import Chain, Joint
from plumbline.kinematics.constants import (
    LARGEST_URDF,
    LONGEST_NAME,
    MOST_ATTRIBUTES,
    MOST_JOINTS,
    STANDARD_GRAVITY,
)
from plumbline.kinematics.dh import DHRow, model_from_dh
from plumbline.kinematics.dynamics import Dynamics, dynamics_of
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.files import read_file, reason
from plumbline.kinematics.linkage import linked, mimics_of
from plumbline.kinematics.mjcf import model_from_mjcf
from plumbline.kinematics.oracle import pin

PACKAGE = "example-robot-data"
EXTRA = 'pip install "plumbline-robotics[robots]"'
SUFFIX = "_robot"


def descriptions() -> dict[str, Path]:
    """URDF files by the name of their robot (PlumblineError: the package is not installed)."""
    try:
        found = distribution(PACKAGE)
    except PackageNotFoundError:
        raise PlumblineError(f"robot descriptions need {PACKAGE}: {EXTRA}") from None
    files = sorted(f for f in found.files or () if f.suffix == ".urdf")
    # A file that is called as its robot is may be an empty head beside the robot's own: the longer
    # name comes later in the order, and wins.
    return {f.stem.removesuffix(SUFFIX): Path(str(found.locate_file(f))) for f in files}


STDERR = 2
# Tags and substitutions of xacro: any one of them makes a file no URDF yet; what xacro expanded
# keeps its comments, substitutions in them included. One that never ends is looked through once.
COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
XACRO = re.compile(r"<\s*xacro:\w|\$\{[^}]*\}|\$\((?:find|arg|env)\s")


def _models() -> dict[str, resources.abc.Traversable]:
    folder = resources.files("plumbline.kinematics") / "models"
    return {f.name[:-5]: f for f in folder.iterdir() if f.name.endswith(".toml")}


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot of any tree shape; a measurement always speaks of one chain of it."""

    model: pin.Model  #: the Pinocchio model, all branches
    name: str  #: what it is called
    default_tip: str  #: the tip frame meant when none is named
    gravity: Array  #: gravity (3,) in the base frame [m/s^2]
    urdf: str | None = None  #: text of the URDF it came from, if it did
    dh: tuple[DHRow, ...] | None = None  #: its DH rows, if it came from DH rows
    mjcf: str | None = None  #: text of the MJCF it came from, if it did

    def __repr__(self) -> str:
        joints = f"{self.model.njoints - 1} joints, tip {self.default_tip[:60]!r}"
        return f"<Robot {self.name[:60]!r}: {joints}>"

    @classmethod
    def from_urdf(
        cls, source: str | Path, *, name: str | None = None, gravity: ArrayLike = STANDARD_GRAVITY
    ) -> Self:
        """From a URDF file (a path), or from its text (a string that starts with ``<``).

        Raises:
            PlumblineError: The file is missing, is no URDF, or has no movable joint or too many.
        """
        text, where = _read_xml(source, "URDF")
        refuse_xacro(text, where)
        _refuse_large(text, where)
        try:
            with _unheard():
                model = pin.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            reason = str(error).splitlines()[0] if str(error) else "Pinocchio cannot read it"
            raise PlumblineError(
                f"{where}: not a readable URDF ({reason}); check it with check_urdf"
            ) from None
        weight = np.asarray(gravity, dtype=float)
        return cls(
            model, name or model.name or "robot", _last_link(model, where), weight, urdf=text
        )

    @classmethod
    def from_mjcf(
        cls, source: str | Path, *, name: str | None = None, gravity: ArrayLike | None = None
    ) -> Self:
        """From MuJoCo's XML: a file, or its text; gravity is the file's own unless given.

        Raises:
            PlumblineError: The file is missing, is no MJCF, or has no movable joint or too many.
        """
        text, where = _read_xml(source, "MJCF")
        _refuse_large(text, where)
        model, own = model_from_mjcf(text, where, MOST_JOINTS)
        stated = gravity if gravity is not None else STANDARD_GRAVITY if own is None else own
        weight = np.asarray(stated, dtype=float)
        return cls(
            model, name or model.name or "robot", _last_link(model, where), weight, mjcf=text
        )

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[Mapping[str, object] | DHRow],
        *,
        name: str = "dh",
        tip_frame: str = "flange",
        gravity: ArrayLike = STANDARD_GRAVITY,
    ) -> Self:
        """From standard DH rows, as mappings or as :class:`plumbline.kinematics.dh.DHRow`.

        Raises:
            PlumblineError: A row cannot be read, no row moves, or there are too many.
        """
        table = tuple(
            row if isinstance(row, DHRow) else DHRow.parse(row, number)
            for number, row in enumerate(rows, start=1)
        )
        _refuse_many(len(table), name, "DH rows")
        if not any(row.kind != "fixed" for row in table):
            raise PlumblineError(f"{name}: {len(table)} DH rows, none of which moves; add a joint")
        if tip_frame in {f"link{number}" for number in range(1, len(table))}:
            raise PlumblineError(f"{name}: tip frame {tip_frame!r} is a link's name too; change it")
        model = model_from_dh(table, tip_frame)
        return cls(model, name, tip_frame, np.asarray(gravity, float), dh=table)

    @classmethod
    def bundled(cls, name: str) -> Self:
        """One of the robots that come with the package: see :func:`bundled_names`.

        Raises:
            PlumblineError: There is no robot of that name.
        """
        table = _model(name)
        return cls.from_dh(
            table["dh"],
            name=table.get("name", name),
            tip_frame=table.get("tip_frame", "flange"),
            gravity=table.get("gravity", STANDARD_GRAVITY),
        )

    @classmethod
    def described(cls, name: str) -> Self:
        """One of the robots of the `example-robot-data` package, such as ``ur10`` or ``panda``.

        Raises:
            PlumblineError: The package is not installed, or has no robot of that name.
        """
        try:
            files = descriptions()
        except PlumblineError as error:
            there = ", ".join(bundled_names())
            raise PlumblineError(f"{error}; without it there are {there}") from None
        if name not in files:
            raise PlumblineError(_not_recognised("Robot", name, sorted(files)))
        return cls.from_urdf(files[name], name=name)

    def with_gravity(self, gravity: ArrayLike) -> Self:
        """The same robot mounted otherwise: gravity (3,) in its base frame [m/s^2]."""
        return replace(self, gravity=np.asarray(gravity, dtype=float))

    @property
    def tip_frames(self) -> tuple[str, ...]:
        """Every frame of the model that can serve as a tip."""
        return tuple(_tip_kinds(self.model))

    def chain(self, tip_frame: str | None = None) -> Chain:
        """The serial chain from the base to a tip frame; other joints are locked at neutral.

        Raises:
            PlumblineError: There is no such frame, no joint moves it, or a joint is of a kind that
                is neither revolute nor prismatic.
        """
        tip = tip_frame or self.default_tip
        if tip not in self.tip_frames:
            raise PlumblineError(_not_recognised("Tip frame", tip, self.tip_frames))
        kind = _tip_kinds(self.model)[tip]
        frame_id = self.model.getFrameId(tip, kind)
        path = [j for j in self.model.supports[self.model.frames[frame_id].parentJoint] if j > 0]
        locked = [j for j in range(1, self.model.njoints) if j not in path]
        model = pin.Model(self.model)  # a copy: gravity is this chain's own
        if locked:
            model = pin.buildReducedModel(model, locked, pin.neutral(model))
        model.gravity.linear = self.gravity
        joints = tuple(read_joint(model, j) for j in range(1, model.njoints))
        joints = linked(joints, mimics_of(self.urdf))
        if self.dh is not None:  # a row's normal is the x axis of the joint that it moves
            joints = tuple(replace(joint, normal=np.eye(3)[0]) for joint in joints)
        T_last_tip = model.frames[model.getFrameId(tip, kind)].placement.homogeneous
        return Chain(model, joints, T_last_tip, tip, self.gravity)

    def dynamics(self) -> Dynamics:
        """All joints of all branches and what they carry; a base that floats is held.

        Raises:
            PlumblineError: A joint is of a kind that is neither revolute nor prismatic.
        """
        model = pin.Model(self.model)  # a copy: gravity is this one's own
        model.gravity.linear = self.gravity
        joints = [read_joint(model, j) for j in range(1, model.njoints)]
        return dynamics_of(model, joints, self.gravity)


def bundled_names() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(sorted(_models()))


def makers_joints(name: str) -> tuple[str, ...]:
    """What the driver of a bundled robot calls its joints; empty where that is not known."""
    return tuple(_model(name).get("joints", ()))


def _model(name: str) -> dict[str, Any]:
    """The file of a bundled robot (PlumblineError: there is no robot of that name)."""
    models = _models()
    if name not in models:
        raise PlumblineError(_not_recognised("Robot", name, sorted(models)))
    return tomllib.loads(models[name].read_text(encoding="utf-8"))


def _tip_kinds(model: pin.Model) -> dict[str, pin.FrameType]:
    """Frames that a joint moves, by name; a link goes before a fixed joint of the same name."""
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME, pin.FrameType.FIXED_JOINT)
    frames = [f for f in model.frames if f.type in kinds and f.parentJoint > 0]
    links = {f.name for f in frames if f.type == pin.FrameType.BODY}
    return {f.name: pin.FrameType.BODY if f.name in links else f.type for f in frames}


def _last_link(model: pin.Model, where: str) -> str:
    """The tip frame meant when none is named."""
    if model.njoints < 2:
        raise PlumblineError(f"{where}: no movable joint found, at least 1 expected")
    return [f for f, kind in _tip_kinds(model).items() if kind == pin.FrameType.BODY][-1]


def _not_recognised(what: str, name: str, known: Sequence[str]) -> str:
    best = best_matches(name, known) or "too long to be shown"
    return f"{what} {name[:LONGEST_NAME]!r} not recognised. Best matches are {best}"


@contextmanager
def _unheard() -> Iterator[None]:
    """Nothing reaches the process's standard error: urdfdom writes there what it then raises."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
    except OSError:  # shut in, where nothing may be written: then it is heard
        yield
        return
    try:
        kept = os.dup(STDERR)
    except OSError:  # closed already
        os.close(nowhere)
        yield
        return
    try:
        os.dup2(nowhere, STDERR)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, STDERR)
        os.close(kept)


def refuse_xacro(text: str, where: str) -> None:
    """Refuse what a URDF is yet to be made of: xacro; the message has the command for it."""
    if XACRO.search(COMMENT.sub("", text)):
        name = "FILE" if where == "URDF text" else where
        raise PlumblineError(
            f"{where}: xacro found, URDF expected; expand it: xacro {name} > robot.urdf (the "
            "command is of ROS, or: pip install xacro)"
        )


def _read_xml(source: str | Path, what: str) -> tuple[str, str]:
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return source, f"{what} text"
    path = Path(source)
    try:
        return read_file(path, LARGEST_URDF).decode("utf-8-sig"), path.name
    except (OSError, ValueError) as error:
        raise PlumblineError(f"{path.name}: {what} cannot be read ({reason(error)})") from None


def _refuse_large(text: str, where: str) -> None:
    """Refuse what would bring the reader down; what is no XML at all is left to it."""
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, LookupError, ValueError):
        return
    _refuse_many(len(root.findall("joint")), where, "joints")
    for element in root.iter():
        if len(element.attrib) > MOST_ATTRIBUTES:
            raise PlumblineError(
                f"{where}: <{str(element.tag)[:LONGEST_NAME]}> has {len(element.attrib):,} "
                f"attributes, at most {MOST_ATTRIBUTES} expected; delete those that no URDF has"
            )


def joints_named(robot: Robot, names: Sequence[str]) -> tuple[Joint, ...]:
    """Those of these joints that it has, in their order; none of what is no robot's."""
    known = [str(name) for name in robot.model.names]
    return tuple(read_joint(robot.model, known.index(name)) for name in names if name in known)


def _refuse_many(count: int, where: str, what: str) -> None:
    if count > MOST_JOINTS:
        raise PlumblineError(
            f"{where}: {count:,} {what}, at most {MOST_JOINTS} expected; leave out those that the "
            "chain to the tip does not need"
        )


def read_joint(model: pin.Model, j: int) -> Joint:
    """The joint of that number, or refused if it is none that turns or slides."""
    joint = model.joints[j]
    name = model.names[j]
    if joint.nv != 1:
        raise PlumblineError(
            f"Joint {name!r}: {joint.nv} degrees of freedom, 1 expected (revolute or prismatic)"
        )
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    subspace = np.array(data.S, dtype=float).ravel()  # a copy: data dies with this call
    linear, angular = subspace[:3], subspace[3:]
    if not subspace.any():
        raise PlumblineError(f"Joint {name!r}: its axis is 0 0 0; give it a direction")
    if np.any(linear) and np.any(angular):
        raise PlumblineError(f"Joint {name!r}: a screw joint; revolute or prismatic expected")
    lower, upper = -np.inf, np.inf
    if joint.nq == 1:
        lower, upper = (
            float(limit[joint.idx_q])
            for limit in (model.lowerPositionLimit, model.upperPositionLimit)
        )
    if lower == upper:  # what a URDF does not state is zero there, and no joint has no travel
        lower, upper = -np.inf, np.inf
    return Joint(
        name=name,
        kind="revolute" if np.any(angular) else "prismatic",
        axis=angular if np.any(angular) else linear,
        T_parent_joint=model.jointPlacements[j].homogeneous,
        lower=lower,
        upper=upper,
        mass=float(model.inertias[j].mass),
        com=np.array(model.inertias[j].lever),
    )
