"""Options are of the kind and in the range that their declaration says; else one line says so.

A field's annotation is its whole statement, and what a reader sees is what is checked::

    @dataclass(frozen=True)
    class Options(Declared):
        steps: Annotated[int, Range(1, 500)] = 10
        clearance: Annotated[float, Range(0.0, 0.1, mend="give it in m")] = 0.002
        form: Annotated[str, Among(("planes", "scalar"))] = "planes"
        solver: Solver = Ipopt()

A number is finite and no truth value; a protocol is something that has its methods, and no class.
"""

import dataclasses
import types
import typing
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from math import inf, isfinite
from numbers import Integral, Real
from typing import Annotated, Any, TypeAlias, Union, get_args, get_origin

import numpy as np

from plumbline.errors import Spot, fault, shown

# What a value of a plain type has to be an instance of, and what a message calls it.
PLAIN: dict[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool, np.bool_), "True or False"),
    int: ((Integral,), "a whole number"),
    float: ((Real,), "a finite number"),
    str: ((str,), "text"),
    type(None): ((type(None),), "None"),
}
MEND = "give it so, or take the default"
Wrong: TypeAlias = tuple[str, str]  # what was expected, and the way out


@dataclasses.dataclass(frozen=True)
class Range:
    """Where a number may lie; ``open`` lists those of its ends, ``(`` or ``)``, that it lacks."""

    least: float = -inf
    most: float = inf
    open: str = ""
    mend: str = MEND  #: the way out that a message names

    def holds(self, value: float) -> bool:
        """Whether a number lies in it."""
        above = value > self.least if "(" in self.open else value >= self.least
        return above and (value < self.most if ")" in self.open else value <= self.most)

    def __str__(self) -> str:
        ends = f"{self.least:.12g}", f"{self.most:.12g}"
        if isfinite(self.least) and isfinite(self.most) and self.open in ("", "()"):
            return f"between {' and '.join(ends)}" if self.open else " to ".join(ends)
        low = f"{'more than' if '(' in self.open else 'at least'} {ends[0]}"
        high = f"{'less than' if ')' in self.open else 'at most'} {ends[1]}"
        told = ((low, isfinite(self.least)), (high, isfinite(self.most)))
        return " and ".join(words for words, there in told if there)


@dataclasses.dataclass(frozen=True)
class Among:
    """The words that a text may be."""

    known: tuple[str, ...]
    mend: str = "choose one of them"

    def holds(self, value: str) -> bool:
        """Whether a text is one of them."""
        return value in self.known

    def __str__(self) -> str:
        return f"one of {', '.join(self.known)}"


Count = Annotated[int, Range(0)]
AtLeastOne = Annotated[int, Range(1)]
Positive = Annotated[float, Range(0.0, open="(")]
NotNegative = Annotated[float, Range(0.0)]
Portion = Annotated[float, Range(0.0, 1.0, "(")]
Point = tuple[float, float, float]


class Declared:
    """A dataclass of options that refuses values which are not as its fields declare."""

    def __post_init__(self) -> None:
        """Refuse the first field that is not as declared."""
        expect_fields(self)


def expect_fields(options: Any) -> None:
    """Refuse the first field of a dataclass that is not as declared."""
    for name, kind in _kinds(options.__class__).items():
        expect(name, getattr(options, name), kind)


def expect(name: str, value: object, kind: Any) -> None:
    """Refuse what is given by a name unless it is of a kind, as an annotation states it."""
    wrong = _wrong(value, kind)
    if wrong:
        raise fault(Spot(name, column=name), shown(value), *wrong)


@cache
def _kinds(options: Any) -> dict[str, Any]:
    """What each field of a class is declared as."""
    hints: dict[str, Any] = {}
    for part in reversed(options.__mro__):
        with suppress(
            NameError
        ):  # a type that is named inside a function: its values are not checked
            hints |= typing.get_type_hints(part, include_extras=True)
    fields = dataclasses.fields(options) if dataclasses.is_dataclass(options) else ()
    return {field.name: hints.get(field.name, Any) for field in fields if field.init}


def _wrong(value: Any, kind: Any) -> Wrong | None:
    """What was expected of a value instead, and the way out; None of one that is as declared."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        wrong, limits = _wrong(value, parts[0]), parts[1]
        if wrong or not limits.holds(value):
            return f"{wrong[0]}, {limits}" if wrong else str(limits), limits.mend
        return None
    if origin in (Union, types.UnionType):
        return _none_of(value, parts)
    if origin in (tuple, list, Sequence):
        return _wrong_items(value, parts)
    if origin is type:
        fits = isinstance(value, type) and issubclass(value, parts[0])
        return None if fits else (f"a class of {parts[0].__name__}", MEND)
    return _wrong_plain(value, origin if isinstance(origin, type) else kind)


def _none_of(value: Any, kinds: Sequence[Any]) -> Wrong | None:
    """What was expected of a value that is of none of several kinds."""
    wrongs = [_wrong(value, kind) for kind in kinds]
    told = [wrong for wrong in wrongs if wrong]
    return None if len(told) < len(wrongs) else (" or ".join(w for w, _ in told), told[0][1])


def _wrong_items(value: Any, parts: tuple[Any, ...]) -> Wrong | None:
    """The same of a list, whose items are all of one kind, or as many as there are kinds."""
    if not isinstance(value, (tuple, list)) and getattr(value, "ndim", 0) != 1:
        return "a list", "put it in brackets"
    kinds = parts[:1] * len(value) if len(parts) == 1 or parts[-1] is ... else parts
    if len(kinds) != len(value):
        return f"{len(kinds)} items", MEND
    wrongs = (_wrong(item, kind) for item, kind in zip(value, kinds, strict=True))
    return next((wrong for wrong in wrongs if wrong), None)


def _wrong_plain(value: Any, kind: Any) -> Wrong | None:
    """The same of a truth value, a number, a text, a protocol or a class of ours."""
    if kind in PLAIN:
        classes, words = PLAIN[kind]
        fits = isinstance(value, classes) and (kind is bool or not isinstance(value, bool))
        return None if fits and (not isinstance(value, Real) or isfinite(value)) else (words, MEND)
    if kind is np.ndarray and isinstance(value, kind):
        finite = value.dtype.kind in "iuf" and np.isfinite(value).all()
        return None if finite else ("finite numbers", MEND)
    if kind is Any or not isinstance(kind, type):
        return None
    asked = _asked(kind)
    fits = all(hasattr(value, name) for name in asked) if asked else isinstance(value, kind)
    if fits and not isinstance(value, type):
        return None
    return f"a {kind.__name__}", f"make one: {value.__name__}(...)" if fits else MEND


def _asked(kind: type) -> list[str]:
    """The names that a protocol asks for; of another class, none."""
    bases = [base for base in kind.__mro__ if getattr(base, "_is_protocol", False)]
    names = [name for base in bases for name in {**vars(base), **base.__annotations__}]
    return [name for name in names if not name.startswith("_")]
