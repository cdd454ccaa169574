"""What can be wrong with a set of withheld cases, said in one line."""

from __future__ import annotations


class WithheldError(ValueError):
    """A set that cannot be made, run or scored; the message is one line."""
