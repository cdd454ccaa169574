"""Values as TOML, which Python reads but does not write."""

import json
from collections.abc import Iterator, Mapping

import numpy as np


def pairs(table: Mapping[str, object]) -> Iterator[str]:
    """``key = value`` of a table, a line each."""
    for key, value in table.items():
        yield f"{key} = {value_text(value)}"


def value_text(value: object) -> str:
    """A value as TOML writes it; an array as lists."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(value_text(v) for v in value) + "]"
    if isinstance(value, np.ndarray | np.generic):
        return value_text(value.tolist())
    raise TypeError(f"{type(value).__name__} has no place in TOML")


def _number(value: float) -> str:
    text = repr(float(value))
    return text if text in ("nan", "inf", "-inf") or any(c in text for c in ".e") else f"{text}.0"


def quoted(text: str) -> str:
    """A string in quotes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
