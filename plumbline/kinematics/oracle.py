"""Pinocchio, loaded when a robot first asks it for something.

With coal it takes 48 MB and a quarter of a second, which registration, tips and markers, that have
no robot, need not pay.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pinocchio as pin
else:

    class _Pinocchio:
        """Stands for the module."""

        def __getattr__(self, name: str) -> Any:
            """What the module has of that name, looked up once."""
            value = getattr(import_module("pinocchio"), name)
            setattr(self, name, value)
            return value

    pin = _Pinocchio()

__all__ = ["pin"]
