"""Where the gap between a robot and its model lies, what causes it, and how far it shrinks.

``import plumbline`` is all that a user needs: ``plumbline.diagnose("my-robot")`` asks a recording,
``register``, ``hand_eye``, ``fit_dh`` and ``plan_sweep`` ask the four methods. The parts of a
method stand behind one name: ``registration``, ``pointing``, ``range_finder``, ``dh``, ``mpc``,
``effects``, ``solvers``; what is made up in ``simulate``, published trials in ``reproduce``,
pictures in ``figures``. What is asked for is loaded on first use, so that ``import plumbline``
costs nothing; where it lives is said once, in ``__init__.pyi``, which type checkers read as well.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import Any


def _stated() -> dict[str, tuple[str, str]]:
    """Module and name there of all that the face offers, by the name that it has here."""
    offered, other = dict[str, tuple[str, str]](), dict[str, tuple[str, str]]()
    for line in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        match line:
            case ast.ImportFrom(module=str(module), names=names):
                for name in names:
                    (offered if name.asname else other)[name.name] = module, name.name
            case ast.Assign(targets=[ast.Name(id=here)], value=ast.Name(id=there)):
                offered[here] = other[there]
    return offered


_HOME = _stated()
__all__ = sorted([*_HOME, "__version__"])

# Who shows what a method answers with.
_SHOWN = import_module(f"{__name__}.pictures")
_SHOWN.CARDS.append(f"{__name__}.experiments.report.writing")
_SHOWN.DRAWN.append(f"{__name__}.experiments.report.drawn")


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name == "__version__":
        return _version()
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place, own = _HOME[name]
    module = import_module(place)
    return vars(module)[own] if own in vars(module) else import_module(f"{place}.{own}")


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted({*globals(), *__all__})


def _version() -> str:
    from importlib.metadata import version

    return version("plumbline-robotics")
