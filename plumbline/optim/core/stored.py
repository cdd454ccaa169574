"""Frozen dataclasses as JSON and back, by their annotations: data only, nothing is ever run.

Arrays are stored as shape and values, what is not finite as a word, so that JSON holds every
number; a type that is not data (a robot, a symbolic problem) registers how it is made again.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import cattrs
import numpy as np

T = TypeVar("T")
_KINDS: dict[type[Any], dict[str, type[Any]]] = {}


def stored(value: Any) -> Any:
    """Plain data of a dataclass, every number told to the last bit; JSON without NaN."""
    return _converter(_number).unstructure(value)


def plain(value: Any) -> Any:
    """Plain data for a reader: arrays as nested lists, what is not finite as None."""
    return _converter(_finite).unstructure(value)


def restored(data: Any, kind: type[T]) -> T:
    """A value of a type again, from what :func:`stored` made of it.

    Raises:
        KeyError: A field is missing.
        TypeError: Data of another shape than the type.
        ValueError: A value that the type cannot hold.
    """
    try:
        found: T = _converter(_number).structure(data, kind)
    except cattrs.BaseValidationError as error:
        raise ValueError("; ".join(cattrs.transform_error(error))) from None
    return found


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


def register_kinds(family: type[Any], *kinds: type[Any]) -> None:
    """Say which dataclasses a field of some protocol may hold; they are told by their names.

    What was said of the family before still holds.
    """
    known = _KINDS.setdefault(family, {})
    known |= {kind.__name__: kind for kind in kinds}

    def make(data: Any, _: Any) -> Any:
        if data["kind"] not in known:
            raise ValueError(f"{data['kind']!r} is none of {', '.join(known)}")
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
