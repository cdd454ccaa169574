"""How markers are registered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plumbline.errors import best_matches, fault, shown
from plumbline.optim.registration.anisotropic import Anisotropic
from plumbline.optim.registration.markers import MarkerNoise
from plumbline.optim.registration.method import Method
from plumbline.optim.registration.rigid import Kabsch
from plumbline.optim.registration.robust import Robust
from plumbline.optim.registration.three_point import ThreePoint
from plumbline.optim.registration.triples import BestTriple, CombinedTriples

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        ThreePoint(), Kabsch(), Anisotropic(), Robust(), BestTriple(), CombinedTriples(),
    )
}  # fmt: skip


@dataclass(frozen=True)
class RegistrationOptions:
    """By which method, and how well markers were read.

    Attributes:
        method: A method such as ``ThreePoint((0, 2, 1))``, or the name of one: ``robust``, the
            weighted fit of the markers that agree; ``anisotropic``, ``kabsch``, ``three-point``,
            ``best-triple`` (for the recording's first target) or ``combined``.
        noise: How well markers were read; None takes what the recording states.

    Raises:
        PlumblineError: There is no such method.
    """

    method: Method | str = "robust"
    noise: MarkerNoise | None = None

    def __post_init__(self) -> None:
        """Refuse what is no method."""
        if isinstance(self.method, str):
            known = self.method in METHODS
        else:
            known = isinstance(self.method, Method)
        if not known:
            near = f"Best matches are {best_matches(str(self.method), METHODS)}"
            raise fault("method", shown(self.method), "a method or its name", near)

    @property
    def chosen(self) -> Method:
        """The method itself."""
        return METHODS[self.method] if isinstance(self.method, str) else self.method
