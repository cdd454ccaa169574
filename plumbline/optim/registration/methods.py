"""All methods of registration by their names."""

from __future__ import annotations

from collections.abc import Mapping

from plumbline.optim.registration.anisotropic import Anisotropic
from plumbline.optim.registration.method import Method
from plumbline.optim.registration.rigid import Kabsch
from plumbline.optim.registration.robust import Robust
from plumbline.optim.registration.three_point import ThreePoint
from plumbline.optim.registration.triples import BestTriple, CombinedTriples

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        ThreePoint(),
        Kabsch(),
        Anisotropic(),
        Robust(),
        BestTriple(),
        CombinedTriples(),
    )
}
