r"""Joints that follow another by a linkage: ``mimic`` in a URDF, such as a parallelogram's.

.. math:: q_m = k\, q_j + c

What moves joint j beyond its reading moves the joint m that follows it by k times as much, and the
drive of j bears k times what weighs on m.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from xml.etree import ElementTree

from plumbline.kinematics.chain import Joint

DEFAULTS = (("multiplier", "1"), ("offset", "0"))
Mimic = tuple[str, float, float]  # the joint that is followed, multiplier, offset [rad or m]


def mimics_of(urdf: str | None) -> dict[str, Mimic]:
    """The joints of a URDF that follow another, by name."""
    found: dict[str, Mimic] = {}
    for joint in ElementTree.fromstring(urdf).findall("joint") if urdf else ():
        mimic = joint.find("mimic")
        if mimic is not None:
            k, c = (float(mimic.get(key, default)) for key, default in DEFAULTS)
            found[str(joint.get("name"))] = (str(mimic.get("joint")), k, c)
    return found


def linked(joints: Sequence[Joint], mimics: Mapping[str, Mimic]) -> tuple[Joint, ...]:
    """The joints, base first, each with those that follow it."""
    follow = [(k, *mimics[j.name][:2]) for k, j in enumerate(joints) if j.name in mimics]
    return tuple(
        replace(j, drags=tuple((k, share) for k, leader, share in follow if leader == j.name))
        for j in joints
    )
