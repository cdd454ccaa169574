"""A URDF looked over before it is built, so that its fault is one line that names the element.

Only what a chain and its weights need is looked at (http://wiki.ros.org/urdf/XML/joint, .../link):
joints of a known type between links that exist, once each, with limits where the type asks for
them; masses that are not below zero; numbers that are finite.
"""

import math
from collections import Counter
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.parsers import expat

from plumbline.errors import Spot, fault, shown
from plumbline.optim.recording.table import decode

LIMITED = ("revolute", "prismatic")
INERTIAL = (  # element, attribute, count of numbers, and whether a weight must have it
    ("mass", "value", 1, True), ("origin", "xyz", 3, False), ("origin", "rpy", 3, False),
    *(("inertia", key, 1, True) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
)  # fmt: skip
TYPES = (*LIMITED, "continuous", "fixed", "floating", "planar")


def check_urdf(file: str, data: bytes) -> None:
    """Refuse a URDF, given its bytes, that is none, or a joint of which cannot be."""
    text = decode(file, data).encode()
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        where: str = Spot.at(file, error.position[0])
        found = f"broken XML ({expat.ErrorString(error.code)})"
        raise fault(where, found, "a URDF", "mend that line or copy the file again") from None
    except (LookupError, ValueError):  # expat asks Python for encodings that it does not know
        where, mend = f"{file}, row 1", 'write encoding="utf-8", or leave it out'
        raise fault(where, "an encoding that XML has not", "UTF-8", mend) from None
    if root.tag != "robot":
        raise fault(f"{file}, row 1", f"<{root.tag}>", "<robot>", "give a URDF")
    links = _names(file, root, "link")
    _names(file, root, "joint")
    for link in root.findall("link"):
        _check_inertial(file, link)
    children = [_check_joint(file, joint, links) for joint in root.findall("joint")]
    doubled = next((name for name, count in Counter(children).items() if count > 1), None)
    if doubled is not None:
        where = f"{file}, link {shown(doubled)}"
        raise fault(where, "two joints that carry it", "a tree", "delete one of them")
    if len(links) - len(children) != 1:
        found = f"{len(links)} links and {len(children)} joints"
        raise fault(file, found, "one joint for every link but the first", "join all links")


def _names(file: str, root: ElementTree.Element, tag: str) -> set[str]:
    names: set[str] = set()
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name or name in names:
            found = "no name" if not name else f"a second {tag} {shown(name)}"
            raise fault(f"{file}, <{tag}>", found, "a name of its own", "name it")
        names.add(name)
    return names


def _check_joint(file: str, joint: ElementTree.Element, links: set[str]) -> str:
    """The name of the link that a joint carries."""
    where = f"{file}, joint {shown(joint.get('name', ''))}"
    kind = joint.get("type", "")
    if kind not in TYPES:
        raise fault(where, f"type {shown(kind)}", f"one of {', '.join(TYPES)}", "mend its type")
    for tag in ("parent", "child"):
        link = _attribute(joint, tag, "link")
        if link not in links:
            found = f"{tag} {shown(link or 'none')}"
            raise fault(where, found, "a link of the file", "mend its name or add the link")
    if kind in LIMITED and joint.find("limit") is None:
        mend = 'add <limit lower="..." upper="..." effort="..." velocity="..."/>'
        raise fault(where, "no <limit>", f"one, as every {kind} joint has", mend)
    for tag, key, size, needed in _numbers(kind):
        text = _attribute(joint, tag, key)
        if text is None and not needed:
            continue
        _check_vector(where, tag, key, text or "", size)
    if kind in LIMITED:
        _check_limits(where, joint)
    return _attribute(joint, "child", "link") or ""


def _check_limits(where: str, joint: ElementTree.Element) -> None:
    """Refuse a lower limit above the upper one; one that is not given is zero."""
    lower, upper = (float(_attribute(joint, "limit", key) or 0.0) for key in ("lower", "upper"))
    if lower > upper:
        found = f"lower {lower:.6g} above upper {upper:.6g}"
        raise fault(f"{where}, <limit>", found, "lower <= upper", "swap them")


def _check_inertial(file: str, link: ElementTree.Element) -> None:
    """Check the weight of a link, if it has one."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"{file}, link {shown(link.get('name', ''))}, <inertial>"
    for tag, key, size, needed in INERTIAL:
        text = _attribute(inertial, tag, key)
        if needed or text is not None:
            _check_vector(where, tag, key, text or "", size)
    mass = float(_attribute(inertial, "mass", "value") or 0.0)
    if mass < 0.0:
        raise fault(where, f"a mass of {mass:.6g} kg", "0 kg or more", "mend <mass>")


def _numbers(kind: str) -> Iterator[tuple[str, str, int, bool]]:
    """Element, attribute, count of numbers, and whether a joint of that type must have it."""
    yield from (("origin", "xyz", 3, False), ("origin", "rpy", 3, False), ("axis", "xyz", 3, False))
    for key in ("effort", "velocity"):
        yield "limit", key, 1, kind in LIMITED
    for key in ("lower", "upper"):
        yield "limit", key, 1, False


def _attribute(joint: ElementTree.Element, tag: str, key: str) -> str | None:
    element = joint.find(tag)
    return None if element is None else element.get(key)


def _check_vector(where: str, tag: str, key: str, text: str, size: int) -> None:
    """Refuse what is not as many finite numbers as there should be."""
    if not _is_vector(text, size):
        what = "number" if size == 1 else "numbers"
        raise fault(where, f"<{tag} {key}={shown(text)}>", f"{size} finite {what}", f"mend <{tag}>")


def _is_vector(text: str, size: int) -> bool:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == size and all(map(math.isfinite, values))
