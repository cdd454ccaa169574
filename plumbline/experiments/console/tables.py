"""Tables that come with the package, as TOML beside the code that reads them."""

import tomllib
from importlib import resources
from typing import Any


def table(module: str, name: str) -> dict[str, Any]:
    """A file beside a module of that dotted name, or within a package of that name."""
    room = resources.files(module)
    return tomllib.loads((room / name).read_text(encoding="utf-8"))
