"""A parameter of an effect: its unit, its bounds, its physical scale and its null value."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, declared as a class attribute of it.

    Attributes:
        unit: SI unit, e.g. ``"rad"`` or ``"rad/(N m)"``.
        lower: Lower bound [unit].
        upper: Upper bound [unit].
        scale: Size to be expected on a real robot [unit]; the prior's width.
        null: The value at which the effect is absent [unit].
        doc: What it is, in a few words.
        name: Filled in by the effect that declares it.
    """

    unit: str
    lower: float
    upper: float
    scale: float
    null: float = 0.0
    doc: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse a declaration that contradicts itself."""
        if not self.lower <= self.null <= self.upper:
            raise ValueError(
                f"Parameter {self.name or self.doc!r}: null {self.null} is outside of its bounds "
                f"{self.lower} <= x <= {self.upper}; widen the bounds"
            )
        if self.scale <= 0.0:
            raise ValueError(f"Parameter {self.name or self.doc!r}: scale {self.scale} must be > 0")
