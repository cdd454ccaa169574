"""What is said of readings that cannot calibrate a range finder: one line, with the way out."""

from __future__ import annotations


class HandEyeError(ValueError):
    """Readings from which the beam cannot be found; the message is one line."""
