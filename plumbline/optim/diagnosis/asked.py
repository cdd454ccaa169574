"""How a diagnosis was asked for, as it is stored with the answer."""

from __future__ import annotations

from dataclasses import dataclass

from plumbline.optim.core.solvers import Solver
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.measurement.storing import effect_named


@dataclass(frozen=True)
class Asked:
    """Options, the library by its effects' names."""

    held_out: str
    seed: int
    without: tuple[str, ...]
    library: tuple[str, ...]
    solver: Solver
    unlisted: float
    force: bool

    @classmethod
    def of(cls, o: DiagnosisOptions) -> Asked:
        """What is stored of them."""
        names = tuple(effect.name for effect in o.library)
        return cls(o.held_out, o.seed, tuple(o.without), names, o.solver, o.unlisted, o.force)

    @property
    def options(self) -> DiagnosisOptions:
        """The options again.

        Raises:
            PlumblineError: The library had an effect that is not known here.
        """
        library = tuple(effect_named(name) for name in self.library)
        return DiagnosisOptions(
            self.held_out, self.seed, self.without, library, self.solver, self.force, self.unlisted
        )
