"""Values as TOML, which Python reads but does not write."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np


def pairs(table: Mapping[str, object]) -> Iterator[str]:
    """``key = value`` of a table, a line each."""
    for key, value in table.items():
        yield f"{_key(key)} = {value_text(value)}"


def document(data: Mapping[str, Any]) -> str:
    """A file's text: keys, then tables and lists of tables."""
    return "\n".join(tables(data)) + "\n"


def tables(data: Mapping[str, Any], title: str = "") -> Iterator[str]:
    """Lines of nested tables, values in front of what is inside; None is left out."""
    inner = {key: value for key, value in data.items() if _is_inside(value)}
    yield from pairs({k: v for k, v in data.items() if k not in inner and v is not None})
    for key, value in inner.items():
        for one in value if isinstance(value, list) else [value]:
            name = f"{title}{_key(key)}"
            yield from ("", f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            yield from tables(one, f"{name}.")


def _is_inside(value: Any) -> bool:
    """Whether it is a table, or a list of such, and no array of numbers."""
    one = value[0] if isinstance(value, list) and value else value
    return isinstance(one, Mapping) and set(one) != {"shape", "values"}


def _key(key: object) -> str:
    """A key, in quotes where it needs them."""
    text = str(key)
    plain = text.isascii() and text.replace("_", "").replace("-", "").isalnum()
    return text if plain else quoted(text)


def value_text(value: object) -> str:
    """A value as TOML writes it; an array as lists."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _plain(value) if "\n" in value else quoted(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(value_text(v) for v in value) + "]"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(pairs(value)) + " }"
    if isinstance(value, np.ndarray | np.generic):
        return value_text(value.tolist())
    raise TypeError(f"{type(value).__name__} has no place in TOML")


def _number(value: float) -> str:
    text = repr(float(value))
    return text if text in ("nan", "inf", "-inf") or any(c in text for c in ".e") else f"{text}.0"


def _plain(text: str) -> str:
    """Lines as they stand, where TOML allows it."""
    printable = all(c.isprintable() or c in "\n\t" for c in text)
    plain = "'''" not in text and not text.endswith("'") and printable
    return f"'''\n{text}'''" if plain else quoted(text)


def quoted(text: str) -> str:
    """A string in quotes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
