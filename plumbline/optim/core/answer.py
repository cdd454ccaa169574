"""What every method answers with: it is judged, shown, drawn, stored and brought back.

An answer is a frozen dataclass. :meth:`Answer.to_dict` holds its figures for whoever reads JSON;
:meth:`Answer.save` stores them beside the fields themselves, from which :meth:`Answer.load` brings
the same answer back without solving anything again. Nothing that is read is ever run.

Frozen dataclasses as JSON and back, by their annotations: data only, nothing is ever run.

Arrays are stored as shape and values, what is not finite as a word, so that JSON holds every
number; a type that is not data (a robot, a symbolic problem) registers how it is made again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, get_args, get_origin, get_type_hints

import cattrs
import numpy as np

from plumbline.errors import PlumblineError, best_matches, fault, listed, one_line, shown
from plumbline.kinematics.files import new_file, read_file, reason
from plumbline.optim.core.constants import LARGEST_ANSWER
from plumbline.pictures import CARDS, DRAWN

if TYPE_CHECKING:
    from plumbline.optim.core.judged import Judgement


T = TypeVar("T")
_KINDS: dict[Any, dict[str, type[Any]]] = {}


def stored(value: Any) -> Any:
    """Plain data of a dataclass, every number told to the last bit; JSON without NaN."""
    return _converter(_number).unstructure(value)


def plain(value: Any) -> Any:
    """Plain data for a reader: arrays as nested lists, what is not finite as None."""
    return _converter(_finite).unstructure(value)


def restored(data: Any, kind: type[T]) -> T:
    """A value of a type again, from what :func:`stored` made of it (KeyError, TypeError)."""
    try:
        found: T = _converter(_number).structure(data, kind)
    except cattrs.BaseValidationError as error:
        raise _said(error) from None
    return found


def _said(error: cattrs.BaseValidationError) -> PlumblineError:
    """The house's own error that others are raised about, with its way out, else all in words."""
    own: BaseException | None = error.subgroup(PlumblineError)
    while isinstance(own, BaseExceptionGroup):
        own = own.exceptions[0]
    words = "; ".join(cattrs.transform_error(error))
    return own if isinstance(own, PlumblineError) else PlumblineError(words)


def parts_of(value: Any, *without: str) -> dict[str, Any]:
    """Fields of a dataclass by their names, but for those that are made again."""
    return {f.name: getattr(value, f.name) for f in fields(value) if f.name not in without}


def restored_parts(data: Mapping[str, Any], kind: type[Any], *without: str) -> dict[str, Any]:
    """The same again, of those that are data of the dataclass (errors of :func:`restored`)."""
    kinds = get_type_hints(kind)
    known = [name for name in data if name in kinds and name not in without]
    return {name: restored(data[name], kinds[name]) for name in known}


def register(kind: type[Any], take: Callable[[Any], Any], make: Callable[[Any], Any]) -> None:
    """Say how a type that is not a dataclass of data, or a family, is stored and made again."""
    for number in (_number, _finite):
        converter = _converter(number)
        converter.register_unstructure_hook(kind, _then(take, converter.unstructure))
    _converter(_number).register_structure_hook_func(
        lambda asked: asked is kind, lambda data, _: make(data)
    )


def register_kinds(family: Any, *kinds: type[Any]) -> None:
    """Say which dataclasses a field of some protocol may hold; they are told by their names.

    What was said of the family before still holds.
    """
    known = _KINDS.setdefault(family, {})
    known |= {kind.__name__: kind for kind in kinds}

    def make(data: Any, _: Any) -> Any:
        if data["kind"] not in known:
            raise fault("kind", shown(data["kind"]), ", ".join(known), SAVE_IT)
        return _converter(_number).structure(data["fields"], known[data["kind"]])

    def named(fields: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda value: {"kind": type(value).__name__, "fields": fields(value)}

    for number in (_number, _finite):
        converter = _converter(number)
        hook = named(converter.unstructure)
        converter.register_unstructure_hook_func(lambda kind: kind is family, hook)
    _converter(_number).register_structure_hook_func(lambda kind: kind is family, make)


@cache
def _converter(number: Callable[[float], Any]) -> cattrs.Converter:
    converter = cattrs.Converter()
    converter.register_unstructure_hook(float, number)
    converter.register_structure_hook(float, lambda data, _: _read(data))
    for kind in (bool, int):
        converter.register_structure_hook(kind, _exactly)
    converter.register_structure_hook_func(lambda kind: kind == float | str, lambda data, _: data)
    array = _of_array if number is _number else _nested
    converter.register_unstructure_hook(np.ndarray, array)
    converter.register_unstructure_hook_func(_is_array, array)
    converter.register_structure_hook_func(_is_array, _to_array)
    converter.register_unstructure_hook(np.generic, lambda v: converter.unstructure(v.item()))
    return converter


def _then(first: Callable[[T], Any], last: Callable[[Any], Any]) -> Callable[[T], Any]:
    return lambda value: last(first(value))


def _number(value: float) -> float | str:
    return float(value) if math.isfinite(value) else str(float(value))


def _read(data: Any) -> float:
    """A number; the one NaN that is equal to itself inside of a tuple."""
    value = float(data)
    return math.nan if math.isnan(value) else value


def _exactly(data: Any, kind: type[Any]) -> Any:
    """A whole number, which may be a key, or yes or no: nothing that merely can be made one."""
    value = int(data) if kind is int and isinstance(data, str) else data
    if type(value) is not kind:
        raise TypeError(f"{shown(data)}, expected {kind.__name__}")
    return value


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _of_array(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    flat = values.ravel().tolist()
    told = [_number(one) if isinstance(one, float) else one for one in flat]
    return {"shape": list(values.shape), "values": told}


def _nested(values: np.ndarray[Any, Any]) -> Any:
    if values.dtype.kind != "f":
        return values.tolist()
    cells = values.astype(object)
    cells[~np.isfinite(values)] = None
    return cells.tolist()


def _is_array(kind: Any) -> bool:
    return get_origin(kind) is np.ndarray


def _to_array(data: Any, kind: Any) -> np.ndarray[Any, Any]:
    dtype = get_args(get_args(kind)[1])[0]
    return np.array(data["values"], dtype=dtype).reshape(data["shape"])


FORMAT = "plumbline answer"
SAVE_IT = "save the answer again: answer.save(FILE) in Python, not --json"


class Answer:
    """The base of every answer; what differs is :attr:`judged`, :meth:`card` and the fields."""

    kinds: ClassVar[dict[str, type[Answer]]] = {}

    def __init_subclass__(cls) -> None:
        Answer.kinds[cls.__name__] = cls

    if TYPE_CHECKING:  # a field or a property of each answer

        @property
        def judged(self) -> Judgement:
            """Every solve behind it: converged? By stationarity, feasibility and bounds."""

    def card(self) -> str:
        """A compact piece of HTML that needs nothing else, every word of the data escaped."""
        return str(import_module(CARDS[-1]).card_of(self))

    def _repr_html_(self) -> str:
        return self.card()

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures that :meth:`plot` draws, the first of them unless one is named."""
        return tuple(_drawers(self))

    def plot(self, name: str = "") -> Any:
        """The picture that says most about it, or the one of a name.

        Args:
            name: One of :attr:`pictures`.

        Raises:
            PlumblineError: Nobody draws this kind of answer, there is no picture of that name, or
                the data have nothing for it.
        """
        made = _drawers(self)
        if not made:
            raise PlumblineError(f"plot of a {type(self).__name__}: none; use its figures instead")
        if name and name not in made:
            raise PlumblineError(
                f"picture {shown(name)}: not one of a {type(self).__name__}. Best matches are "
                f"{best_matches(name, made) or 'none'}"
            )
        picture = made[name or next(iter(made))]()
        if picture is None:
            raise PlumblineError(
                f"picture {name}: the data have nothing for it, such as a column that was not "
                f"recorded; others are {listed(k for k in made if k != name)}"
            )
        return picture

    def to_dict(self) -> dict[str, Any]:
        """Its figures as plain numbers, strings, lists and dictionaries in SI units.

        What is not finite becomes None, so that it is JSON.
        """
        found = plain(self)
        assert isinstance(found, dict)
        return found

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store it as JSON, whole or not at all.

        Args:
            path: The file.
            overwrite: Whether a file that is there may go.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        content = {
            "format": FORMAT,
            "kind": type(self).__name__,
            "figures": self.to_dict(),
            "fields": stored(self),
        }
        text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        new_file(path, text, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Bring back what :meth:`save` stored.

        Raises:
            PlumblineError: No such file, no answer of this kind, or a damaged one.
        """
        content = _content(Path(path))
        kind = content.get("kind")
        if kind != cls.__name__:
            near = best_matches(str(kind), Answer.kinds)
            raise fault(str(path), f"kind {shown(kind)}", cls.__name__, f"load it as {near}")
        return again(content.get("fields"), cls, str(path), SAVE_IT)


def again(data: Any, kind: type[T], where: str, mend: str) -> T:
    """A value of a type from what a file holds of it (PlumblineError: it is damaged)."""
    try:
        return restored(data, kind)
    except (KeyError, TypeError, ValueError) as error:
        words = one_line(str(error)) or type(error).__name__
        found = f"damaged fields ({words[:160]})"
        remedy = getattr(error, "remedy", None) or mend
        raise fault(where, found, "what save wrote", remedy) from None


def _drawers(answer: Answer) -> Mapping[str, Callable[[], Any]]:
    """The pictures of an answer by name, undrawn; none where nobody draws its kind."""
    known = [module.DRAWN for module in map(import_module, DRAWN)]
    return next((d[k](answer) for d in known if (k := type(answer).__name__) in d), {})


def _content(path: Path) -> dict[str, Any]:
    """The JSON object of a file."""
    try:
        data = read_file(path, LARGEST_ANSWER)
    except OSError as error:
        raise PlumblineError(f"{path}: cannot be read ({reason(error)}); check the path") from None
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        raise fault(str(path), "no JSON", "what save wrote", SAVE_IT) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise fault(str(path), "other JSON", f"format {FORMAT!r}", SAVE_IT)
    return content


def kind_of(path: str | Path) -> str:
    """The kind of a stored answer (PlumblineError: it is none)."""
    return str(_content(Path(path)).get("kind"))
