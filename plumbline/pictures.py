"""How an answer is drawn is filled in from outside: an answer knows nothing of pictures."""

from __future__ import annotations

PICTURES: dict[str, str] = {}  # class of an answer -> "module:function"
