"""Options of the net below the controller: time, patience, and what is known of the plant."""

from __future__ import annotations

from dataclasses import dataclass, field

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.plant import Plant


@dataclass(frozen=True)
class Safety:
    """Options of the net."""

    budget: float = 0.02  # time that a plan may take [s]; a later one is not used
    patience: int = 5  # steps without a usable measurement, after which motion stops
    delay: int = 0  # steps that a command is known to take until it acts
    # what else is known of what carries commands out, its delay beyond these steps; a diagnosed
    # ``tracking`` recording tells: :meth:`.plant.Plant.of`
    plant: Plant = field(default_factory=Plant)

    def __post_init__(self) -> None:
        """Refuse what cannot be.

        Raises:
            PlumblineError: A number below zero, or none.
        """
        for name in ("budget", "patience", "delay"):
            if not getattr(self, name) >= 0:
                raise PlumblineError(
                    f"{name}: found {getattr(self, name)}, expected at least 0; use the default"
                )
