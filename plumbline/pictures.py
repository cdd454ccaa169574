"""How an answer is drawn is filled in from outside: an answer knows nothing of pictures."""

from __future__ import annotations

# Class of an answer -> "module:function"
PICTURES: dict[str, str] = {}
# Class of an answer -> "module:function" that gives its pictures by name, each undrawn
NAMED: dict[str, str] = {}
CARDS: dict[str, str] = {}  # of answers that do not make their own
