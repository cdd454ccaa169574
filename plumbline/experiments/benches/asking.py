"""How the benches of the diagnosis ask it, and what they read in its answer: the verdict's JSON."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

from plumbline.errors import fault
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.recording import Recording

Verdict = Mapping[str, Any]
Asked = Callable[[Recording], Verdict]
T = TypeVar("T")
SURE, RULED_OUT = 0.95, 0.05


def asking(seed: int, inference: str | None = None) -> Asked:
    """The library's own diagnosis.

    Args:
        seed: Of all that it draws.
        inference: How it infers; its own default if not given.

    Raises:
        PlumblineError: It has no choice of inference.
    """
    options: dict[str, Any] = {"seed": seed, "force": True}
    if inference is not None:
        if "inference" not in {field.name for field in fields(DiagnosisOptions)}:
            mend = "leave --inference out"
            raise fault("--inference", inference, "nothing, there being one way", mend)
        options["inference"] = inference
    chosen = DiagnosisOptions(**options)
    return lambda recording: diagnose(recording, chosen).verdict.to_dict()


def key_of(cause: Mapping[str, Any]) -> Key:
    """Effect and element of what a verdict lists."""
    return str(cause["effect"]), cause["element"]


def probability_of(verdict: Verdict, key: Key) -> float:
    """The largest probability that a verdict gives an effect at an element; 0 if it lists none."""
    listed = (*verdict["causes"], *verdict.get("candidates", ()))
    return max((float(c["probability"]) for c in listed if key_of(c) == key), default=0.0)


def surest(verdict: Verdict) -> float:
    """Probability of the surest statement that anything is wrong."""
    causes = [float(cause["probability"]) for cause in verdict["causes"]]
    return max([*causes, float(verdict.get("outside_probability") or 0.0)])


def counted(things: Sequence[T], words: str) -> Iterator[T]:
    """The things one by one; says on standard error which one is at hand."""
    for number, thing in enumerate(things, start=1):
        if sys.stderr is not None and sys.stderr.isatty():
            print(f"\r{words} {number} of {len(things)} ", end="", file=sys.stderr, flush=True)
        yield thing
    if sys.stderr is not None and sys.stderr.isatty():
        print(file=sys.stderr)
