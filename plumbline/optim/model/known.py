"""A number that a fit found, with its standard error, its unit and its meaning."""

from dataclasses import dataclass

from plumbline.optim.core.quantities import measured

MEANING = {
    "frame": "origin of the robot's base in the device's frame",
    "frame r": "rotation vector from the robot's base to the device's frame",
    "tool": "tip in the tip frame",
    "tool r": "rotation vector of the tool in the tip frame",
    "socket": "place of the socket in the robot's base frame",
}


@dataclass(frozen=True)
class Known:
    """A found number."""

    value: float  # its value [unit]
    std: float  # its standard error [unit]
    unit: str  # its unit
    doc: str = ""  # what it is, in a few words

    def __str__(self) -> str:
        """``0.2403 ± 0.0061 mm``."""
        return measured(self.value, self.std, self.unit)


def meaning_of(name: str) -> tuple[str, str]:
    """Unit and meaning of a nuisance by its name, such as ``frame rx`` or ``socket 3 x``."""
    kind, last = name.split()[0], name.split()[-1]
    turning = last.startswith("r")
    return ("rad" if turning else "m"), MEANING[f"{kind} r" if turning else kind]
