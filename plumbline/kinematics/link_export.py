r"""A table of links written down again: as DH rows in TOML, and as URDF.

A tilt between parallel axes is no standard parameter, but two rows hold it exactly:

.. math:: R_y(\beta) = R_z(\pi/2)\, R_x(\beta)\, R_z(-\pi/2),

a fixed row with theta = 90 deg and alpha = beta, and 90 deg less in the row behind it.
"""

from __future__ import annotations  # which would load Pinocchio before it is asked

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.constants import SAME, SHORT, UNLIMITED
from plumbline.kinematics.dh import DHRow
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.link_table import LinkTable, row_matrix
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.toml_text import pairs

QUARTER = np.pi / 2
NAME = "calibrated_tip"
ORIGIN = ("xyz", "rpy")


def standard_rows(table: LinkTable) -> tuple[DHRow, ...]:
    """The table as standard DH rows, more of them than its own where an axis is tilted."""
    found: list[DHRow] = []
    pending = 0.0
    for row, mass in zip(table.rows, _masses(table), strict=True):
        found.append(replace(mass, theta=mass.theta + pending))
        pending = 0.0
        if row.beta:
            found.append(DHRow(theta=QUARTER, alpha=row.beta, kind="fixed"))
            pending = -QUARTER
    if pending:
        found.append(DHRow(theta=pending, kind="fixed"))
    return tuple(found)


def _masses(table: LinkTable) -> list[DHRow]:
    """Rows with centres of mass in their own frames before any tilt."""
    found, j = [], 0
    for row in table.rows:
        moves = row.dh.kind != "fixed"
        j += moves
        if not moves or not row.dh.mass or any(row.dh.com):
            found.append(row.dh)
            continue
        com = table.anchors[j] @ np.append(table.chain.joints[j - 1].com, 1.0)
        local = np.linalg.inv(row_matrix(replace(row, beta=0.0))) @ com
        found.append(replace(row.dh, com=(float(local[0]), float(local[1]), float(local[2]))))
    return found


def safe_tip(name: str) -> str:
    """A tip frame's name that no row can have."""
    return NAME if re.fullmatch(r"link\d+", name) else name


def dh_toml(table: LinkTable, *, name: str, source: str, comment: str = "") -> str:
    """The table as a TOML file of DH rows, as those of the bundled robots are.

    ``source`` says in one line where its numbers are from, lines of ``comment`` stand on top.
    """
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    head += [
        "#",
        "# Standard DH rows: T_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha); a prismatic q adds to d.",
        "# Lengths in m, angles in rad, masses in kg; com is the centre of mass in the row's own",
        "# frame. A fixed row with theta = pi/2 tilts the next axis about y by its alpha.",
        "",
        *pairs({"name": name, "source": source, "tip_frame": safe_tip(table.chain.tip_frame)}),
        *(f"{line}  # m/s^2, base frame" for line in pairs({"gravity": table.chain.gravity})),
    ]
    blocks = ["\n".join(_toml_row(row)) for row in standard_rows(table)]
    return "\n\n".join(["\n".join(head), *blocks]) + "\n"


def _toml_row(row: DHRow) -> list[str]:
    kept = ["d", "a", "alpha", "theta", "kind"]
    limited = row.kind != "fixed" and np.isfinite([row.lower, row.upper]).all()
    kept += ["lower", "upper"] if limited else []
    kept += ["mass", "com"] if row.mass else []
    return ["[[dh]]", *pairs({key: getattr(row, key) for key in kept})]


def urdf_text(table: LinkTable, robot: Robot) -> str:
    """The table as a URDF: the robot's own with other joint origins, or one made from the rows.

    In the robot's own, links, meshes, inertias and limits stay as they are. Where the tip itself
    has moved, a link ``calibrated_tip`` is added.
    """
    if robot.urdf is None:
        return made_urdf(table, robot.name)
    return edited_urdf(table.chain, table.placements(), robot.urdf)


def made_urdf(table: LinkTable, name: str) -> str:
    """A URDF made from the table's rows alone."""
    root = ElementTree.Element("robot", name=name)
    ElementTree.SubElement(root, "link", name="base_link")
    parent, T, movable = "base_link", np.eye(4), list(table.chain.joints)
    rows = standard_rows(table)
    for number, row in enumerate(rows, start=1):
        last = number == len(rows)
        child = safe_tip(table.chain.tip_frame) if last else f"link{number}"
        T = T @ row.before().homogeneous
        com = np.array(row.com)
        if row.kind != "fixed":
            joint = movable.pop(0)
            link = f"{child}_joint" if last else child
            root.append(_moving(joint.name, (parent, link), T, row))
            com = row.after().act(com)
            root.append(_link(link, row.mass, com))
            parent, T = link, row.after().homogeneous
            if last:
                root.append(_joint(f"{child}_fixed", "fixed", (parent, child), T))
                root.append(_link(child, 0.0, com))
        else:
            T = T @ row.after().homogeneous
            root.append(_joint(f"{child}_fixed", "fixed", (parent, child), T))
            root.append(_link(child, row.mass, com))
            parent, T = child, np.eye(4)
    return xml_text(root)


def edited_urdf(chain: Chain, placements: Sequence[Array], text: str) -> str:
    """A URDF with the joints of a chain, and its tip, placed anew (n + 1, 4, 4) [m]."""
    root = _parsed(text)
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    *moved, T_last_tip = placements
    for joint, new in zip(chain.joints, moved, strict=True):
        # Fixed joints before this one keep their place: the change goes behind them.
        change = np.linalg.inv(joint.T_parent_joint) @ new
        _move(joints[joint.name], change)
    change = np.linalg.inv(chain.T_last_tip) @ T_last_tip
    if not np.allclose(change, np.eye(4), rtol=0.0, atol=SAME):
        ElementTree.SubElement(root, "link", name=NAME)
        root.append(_joint(f"{NAME}_joint", "fixed", (chain.tip_frame, NAME), change))
    return xml_text(root)


def xml_text(root: ElementTree.Element) -> str:
    """An element as the text of a file, indented."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def words(values: Array) -> str:
    """Numbers of an attribute, to the last bit."""
    return " ".join(repr(float(v)) for v in values)


def _parsed(text: str) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    return ElementTree.fromstring(text.encode(), parser)


def _move(joint: ElementTree.Element, change: Array) -> None:
    if np.allclose(change, np.eye(4), rtol=0.0, atol=SAME):
        return
    T, origin = origin_of(joint) @ change, joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    origin.set("xyz", words(T[:3, 3]))
    origin.set("rpy", words(_angles(T[:3, :3])))


def _link(name: str, mass: float, com: Array) -> ElementTree.Element:
    link = ElementTree.Element("link", name=name)
    if mass > 0.0:
        _state(link, com, mass, dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "0"))
    return link


def _state(link: ElementTree.Element, com: Array, mass: float, moments: dict[str, str]) -> None:
    """Say what a link weighs, about its centre of mass."""
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=words(com), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    ElementTree.SubElement(inertial, "inertia", moments)


def _moving(name: str, links: tuple[str, str], T: Array, row: DHRow) -> ElementTree.Element:
    limited = bool(np.isfinite([row.lower, row.upper]).all())
    kind = row.kind if limited or row.kind == "prismatic" else "continuous"
    joint = _joint(name, kind, links, T)
    ElementTree.SubElement(joint, "axis", xyz="0 0 1")
    if kind != "continuous":
        lower, upper = (row.lower, row.upper) if limited else (-UNLIMITED, UNLIMITED)
        limits = {"lower": repr(float(lower)), "upper": repr(float(upper))}
        ElementTree.SubElement(joint, "limit", limits, effort="1e3", velocity="1e3")
    return joint


def _joint(name: str, kind: str, links: tuple[str, str], T: Array) -> ElementTree.Element:
    joint = ElementTree.Element("joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=links[0])
    ElementTree.SubElement(joint, "child", link=links[1])
    xyz, rpy = words(T[:3, 3]), words(_angles(T[:3, :3]))
    ElementTree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    return joint


def weighed_urdf(
    text: str, more: Mapping[str, Array], drives: Mapping[str, Mapping[str, float]]
) -> str:
    """A URDF whose bodies weigh more, and whose joints have damping and friction.

    By a joint's name, ten parameters more (10,) of the body behind it, in its frame (m, hx, hy, hz,
    Jxx, Jxy, Jyy, Jxz, Jyz, Jzz); and its ``damping`` [N m s/rad] and ``friction`` [N m].
    """
    root = _parsed(text)
    links = {str(link.get("name")): link for link in root.findall("link")}
    for joint in root.findall("joint"):
        name, child = str(joint.get("name")), joint.find("child")
        if name in more and child is not None:
            _weigh(links[str(child.get("link"))], more[name])
        own = drives.get(name, {})
        stated = joint.find("dynamics")
        if stated is None and own:
            stated = ElementTree.SubElement(joint, "dynamics")
        if stated is not None and name in drives:
            stated.attrib |= {k: repr(float(own.get(k, 0.0))) for k in ("damping", "friction")}
    return xml_text(root)


def _weigh(link: ElementTree.Element, more: Array) -> None:
    """Add to what a link weighs, about its own frame."""
    found = link.find("inertial")
    own = np.zeros(10) if found is None else _inertia_of(found).toDynamicParameters()
    if found is not None:
        link.remove(found)
    body = pin.Inertia.FromDynamicParameters(own + more)
    pairs = ((i, j) for i in range(3) for j in range(i, 3))
    moments = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(body.inertia[i, j])) for i, j in pairs}
    _state(link, body.lever, body.mass, moments)


def _inertia_of(inertial: ElementTree.Element) -> pin.Inertia:
    """What an ``<inertial>`` states, in the link's frame."""
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        return pin.Inertia.Zero()
    rows = [[float(inertia.get(f"i{min(a, b)}{max(a, b)}", 0.0)) for a in "xyz"] for b in "xyz"]
    about = pin.Inertia(float(mass.get("value", 0.0)), np.zeros(3), np.array(rows))
    return about.se3Action(pin.SE3(origin_of(inertial)))


def origin_of(element: ElementTree.Element) -> Array:
    """Placement (4, 4) [m] that the ``<origin>`` of an element states."""
    origin = element.find("origin")
    given = ("0 0 0", "0 0 0") if origin is None else (origin.get(k, "0 0 0") for k in ORIGIN)
    xyz, rpy = (np.array([float(word) for word in said.split()]) for said in given)
    return homogeneous(pin.rpy.rpyToMatrix(*rpy), xyz)


def with_frame(text: str, parent: str, name: str, T: Array) -> str:
    """A URDF with one link more, fixed to another: ``T_parent_name`` (4, 4) [m]."""
    root = _parsed(text)
    ElementTree.SubElement(root, "link", name=name)
    root.append(_joint(f"{name}_joint", "fixed", (parent, name), T))
    return xml_text(root)


def _angles(R: Array) -> Array:
    """Roll, pitch and yaw (3,), exact at a pitch of 90 deg too: roll takes up what yaw leaves."""
    yaw = np.arctan2(R[1, 0], R[0, 0]) if np.hypot(R[1, 0], R[0, 0]) > SHORT else 0.0
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    rest = pin.rpy.rpyToMatrix(0.0, pitch, yaw).T @ R
    return np.array([np.arctan2(rest[2, 1], rest[1, 1]), pitch, yaw])
