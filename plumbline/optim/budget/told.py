"""Links by what ``handeye --json`` and ``register --json`` wrote."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import fault, listed, shown
from plumbline.kinematics.files import read_file
from plumbline.optim.budget.constants import SAME_PLACE
from plumbline.optim.budget.sources import Source
from plumbline.optim.core.constants import LARGEST_ANSWER
from plumbline.optim.core.problem import Array

ASK_AGAIN = "write it again with --json"


@dataclass(frozen=True, eq=False)
class Beam:
    """A hand-eye calibration's figures."""

    file: str  # its file's name
    covariance: Array  # of origin and direction (6, 6) [m, 1]
    readings: int  # that count
    boards: int  # that they are on

    def source(self, name: str, distance: float) -> Source:
        """The link at a range [m]."""
        return Source.of_beam(name, self.covariance, self.readings, self.boards, distance)


@dataclass(frozen=True, eq=False)
class Targets:
    """A registration's targets."""

    file: str  # its file's name
    targets: tuple[Mapping[str, Any], ...]  # each as it was told
    dof: float  # freedoms of the noise's size

    def source(self, name: str, target: str | ArrayLike) -> Source:
        """The link at a target, by its label or by its place in CT (3,) [m].

        Raises:
            PlumblineError: The answer tells no such target, or no error of it.
        """
        one = self._at(target)
        if one["unknown"]:
            mend = "register more markers"
            raise fault(f"source {name}", str(one["unknown"]), "a known error", mend)
        mean, covariance = _numbers(one["mean"], 3), _numbers(one["covariance"], 3, 3)
        return Source.of(
            name, mean=mean, covariance=covariance, dof=self.dof, origin="registration"
        )

    def _at(self, target: str | ArrayLike) -> Mapping[str, Any]:
        for one in self.targets:
            label, place = one["label"], _numbers(one["ct"], 3)
            if isinstance(target, str):
                there = target == label
            else:
                there = bool(np.abs(place - np.asarray(target)).max() <= SAME_PLACE)
            if there:
                return one
        known = listed(
            f"{one['label']} at {_numbers(one['ct'], 3).tolist()}" for one in self.targets
        )
        raise fault(
            f"{self.file}, target",
            shown(target if isinstance(target, str) else np.asarray(target).tolist()),
            f"one of {known or 'none'}",
            "add it to the recording as a target and register again",
        )


def told(path: Path) -> Beam | Targets | None:
    """What a command wrote into a file; None where it is anything else.

    Raises:
        PlumblineError: It is of a command, but its figures are damaged.
    """
    try:
        content = json.loads(read_file(path, LARGEST_ANSWER))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or "format" in content:
        return None
    try:
        if {"planes", "covariance", "observability"} <= set(content):
            rows = [int(plane["rows"]) for plane in content["planes"]]
            return Beam(path.name, _numbers(content["covariance"], 6, 6), sum(rows), len(rows))
        if {"targets", "T_RC", "noise"} <= set(content):
            dof = content["noise"]["dof"]
            found = Targets(path.name, tuple(content["targets"]), np.inf if dof is None else dof)
            for one in found.targets:
                if not one["unknown"]:
                    found.source("", one["label"])
            return found
    except (KeyError, TypeError, ValueError) as error:
        found_words = f"damaged figures ({type(error).__name__})"
        raise fault(path.name, found_words, "what --json wrote", ASK_AGAIN) from None
    return None


def _numbers(values: Any, *shape: int) -> Array:
    found = np.array(values, dtype=float)
    if found.shape != shape or not np.isfinite(found).all():
        raise ValueError("no finite numbers of that shape")
    return found
