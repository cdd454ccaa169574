r"""Units of a laboratory, each as :math:`v_{SI} = a\,v + b`.

Exact by definition: the inch (25.4 mm) and the pound (0.45359237 kg) by the international yard and
pound agreement (1959), the pound-force and the kilogram-force with standard gravity 9.80665 m/s^2
(3rd CGPM, 1901), degrees Fahrenheit by 32 degF = 0 degC.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

from plumbline.errors import PlumblineError, best_matches, shown

INCH, POUND, GRAVITY = 0.0254, 0.45359237, 9.80665  # [m], [kg], [m/s^2]
BRACKETS = re.compile(r"^(?P<name>.*?\S)[\s_]*[\[(<](?P<unit>[^\[\]()<>]*)[\])>]\s*$")
SUFFIX = re.compile(r"^(?P<name>.*[^_])_(?P<unit>mm|cm|um|deg|rad|mrad|ms|us|ns|s|degC|kg)$")
INDEX = re.compile(r"\S[\[(<]1[\])>]$")  # ``q[1]``: one of several; ``qw [1]``: a plain number


@dataclass(frozen=True)
class Unit:
    """A unit: what it measures, and how a value becomes one in SI."""

    name: str  # as it is shown
    dimension: str  # what it is a unit of
    factor: float = 1.0  # what a value is multiplied with
    offset: float = 0.0  # what is then added, in SI


SI: Mapping[str, str] = {
    "length": "m", "angle": "rad", "time": "s", "temperature": "degC", "mass": "kg", "force": "N",
    "torque": "N m", "current": "A", "angular velocity": "rad/s", "velocity": "m/s",
    "angular acceleration": "rad/s^2", "acceleration": "m/s^2", "number": "1",
}  # fmt: skip
TABLE: tuple[tuple[str, str, float], ...] = (
    ("m", "length", 1.0), ("mm", "length", 1e-3), ("cm", "length", 1e-2), ("um", "length", 1e-6),
    ("in", "length", INCH), ("ft", "length", 12.0 * INCH),
    ("rad", "angle", 1.0), ("mrad", "angle", 1e-3), ("deg", "angle", pi / 180.0),
    ("turn", "angle", 2.0 * pi),
    ("s", "time", 1.0), ("ms", "time", 1e-3), ("us", "time", 1e-6), ("ns", "time", 1e-9),
    ("min", "time", 60.0), ("h", "time", 3600.0),
    ("degC", "temperature", 1.0), ("kg", "mass", 1.0), ("g", "mass", 1e-3), ("lb", "mass", POUND),
    ("N", "force", 1.0), ("kN", "force", 1e3), ("lbf", "force", POUND * GRAVITY),
    ("kgf", "force", GRAVITY),
    ("N m", "torque", 1.0), ("N mm", "torque", 1e-3), ("N cm", "torque", 1e-2),
    ("lbf in", "torque", POUND * GRAVITY * INCH), ("kgf cm", "torque", GRAVITY * 1e-2),
    ("A", "current", 1.0), ("mA", "current", 1e-3),
    ("rad/s", "angular velocity", 1.0), ("deg/s", "angular velocity", pi / 180.0),
    ("rpm", "angular velocity", pi / 30.0),
    ("m/s", "velocity", 1.0), ("mm/s", "velocity", 1e-3),
    ("rad/s^2", "angular acceleration", 1.0), ("deg/s^2", "angular acceleration", pi / 180.0),
    ("m/s^2", "acceleration", 1.0), ("mm/s^2", "acceleration", 1e-3), ("1", "number", 1.0),
)  # fmt: skip
UNITS: Mapping[str, Unit] = {
    **{name: Unit(name, dimension, factor) for name, dimension, factor in TABLE},
    "K": Unit("K", "temperature", 1.0, -273.15),
    "degF": Unit("degF", "temperature", 5.0 / 9.0, -32.0 * 5.0 / 9.0),
}
SPELT = {
    "metre": "m", "meter": "m", "millimetre": "mm", "millimeter": "mm", "micron": "um",
    "inch": "in", '"': "in", "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad",
    "radians": "rad", "rev": "turn", "sec": "s", "seconds": "s", "C": "degC", "°C": "degC",
    "celsius": "degC", "F": "degF", "°F": "degF", "kelvin": "K", "lbs": "lb", "Nm": "N m",
    "N*m": "N m", "N.m": "N m", "Nmm": "N mm", "Ncm": "N cm", "lbf.in": "lbf in",
    "kgf.cm": "kgf cm", "°/s": "deg/s", "µm": "um", "μm": "um", "µs": "us", "-": "1",
    "m/s2": "m/s^2", "rad/s2": "rad/s^2", "deg/s2": "deg/s^2",
}  # fmt: skip


def known(word: str) -> Unit | None:
    """The unit that a word means, or None."""
    plain = word.strip()
    return UNITS.get(SPELT.get(plain, SPELT.get(plain.lower(), plain)))


def unit(word: str) -> Unit:
    """The unit that a word means (PlumblineError: there is none of that name)."""
    found = known(word)
    if found is None:
        raise PlumblineError(
            f"unit {shown(word)} not recognised. Best matches are {best_matches(word, UNITS)}"
        )
    return found


def of_header(header: str) -> tuple[str, Unit | None]:
    """A column's name without its unit, and the unit: of ``x [mm]``, ``x (mm)`` or ``x_mm``."""
    for form in (BRACKETS, SUFFIX):
        match = form.match(header.strip())
        found = known(match["unit"]) if match else None
        if match and found and not INDEX.search(header.strip()):
            return match["name"].strip(), found
    return header.strip(), None
