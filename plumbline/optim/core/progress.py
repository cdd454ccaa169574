"""How work that takes a while says how far it is."""

from collections.abc import Callable

Progress = Callable[[str, float], None]  # words for the step at hand, and the share done, 0 to 1


def silent(words: str, share: float) -> None:
    """Tell nobody how far it is."""
