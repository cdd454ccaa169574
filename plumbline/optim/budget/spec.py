"""A chain written down: links by plain figures, or by answers and models that were stored.

[[link]]
name = "calculation"
mean_length = 1.43e-3      # m; or rms, or mean = [x, y, z] with std
dof = 9
origin = "mean misfit of five markers"
cured = 0.4e-3             # its RMS once mended [m]

[[link]]
name = "hand-eye"
answer = "handeye.json"    # what save or --json wrote, named from where the spec lies
range = 0.35               # m

Links by what ``handeye --json`` and ``register --json`` wrote.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault, listed, shown
from plumbline.kinematics.files import is_file, read_file
from plumbline.optim.budget.constants import MOST_LINKS, SAME_PLACE
from plumbline.optim.budget.shares import Budget, add_up
from plumbline.optim.budget.sources import Source, size_of
from plumbline.optim.core.constants import LARGEST_ANSWER
from plumbline.optim.core.problem import Array
from plumbline.optim.loading import load
from plumbline.optim.recording.settings import Section, read_settings_file

ASK_AGAIN = "write it again with --json"


@dataclass(frozen=True, eq=False)
class BeamFigures:
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
        """The link at a target, by its label or its place in CT (3,) [m] (PlumblineError)."""
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


def told(path: Path) -> BeamFigures | Targets | None:
    """What a command wrote into a file (PlumblineError: damaged); None if it is anything else."""
    try:
        content = json.loads(read_file(path, LARGEST_ANSWER))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or "format" in content:
        return None
    try:
        if {"planes", "covariance", "observability"} <= set(content):
            rows = [int(plane["rows"]) for plane in content["planes"]]
            return BeamFigures(
                path.name, _numbers(content["covariance"], 6, 6), sum(rows), len(rows)
            )
        if {"targets", "T_RC", "noise"} <= set(content):
            dof = content["noise"]["dof"]
            found = Targets(path.name, tuple(content["targets"]), np.inf if dof is None else dof)
            for one in found.targets:
                if not one["unknown"]:
                    found.source("", one["label"])
            return found
    except (KeyError, TypeError, ValueError) as error:
        damaged = f"damaged figures ({str(error)[:80]})"
        raise fault(path.name, damaged, "what --json wrote", ASK_AGAIN) from None
    return None


def _numbers(values: Any, *shape: int) -> Array:
    found = np.array(values, dtype=float)
    if found.shape != shape or not np.isfinite(found).all():
        raise PlumblineError(f"{np.size(found)} figures, {shape} finite ones expected")
    return found


T = TypeVar("T")
FIGURES = ("rms", "mean_length", "mean", "std")
COMMON = ("name", "origin", "cured")


def read_budget(path: str | Path) -> Budget:
    """The budget that a TOML file asks for.

    Args:
        path: The file; answers are named from where it lies, and only read.

    Raises:
        PlumblineError: It cannot be read, or a link cannot be used; one line says where and why.
    """
    file = Path(path)
    settings = read_settings_file(file)
    settings.refuse_unknown(("link",))
    links = settings.values.get("link")
    if not isinstance(links, list) or not all(isinstance(link, dict) for link in links):
        raise settings.fault("link", "tables [[link]]", "write [[link]] before each link")
    if len(links) > MOST_LINKS:
        raise fault(f"{file.name}, link", f"{len(links)}", f"at most {MOST_LINKS}", "join some")
    return add_up([_source(_section(settings, k, link), file) for k, link in enumerate(links)])


def _section(settings: Section, index: int, values: Mapping[str, object]) -> Section:
    """One link; of the text its own lines alone are left, so that rows are found in them."""
    lines, seen = settings.text.split("\n"), -1
    for row, line in enumerate(lines):
        seen += line.replace(" ", "").startswith("[[link]]")
        if seen != index:
            lines[row] = ""
    return Section(settings.file, "\n".join(lines), values, "link")


def _source(link: Section, file: Path) -> Source:
    name = link.word("name")
    if name is None:
        raise fault(link.where("name"), "a link without one", "a name", 'write name = "..."')
    given = [key for key in ("answer", *FIGURES) if key in link.values]
    if not given:
        known = f"answer, or one of {', '.join(FIGURES)}"
        raise fault(f"{file.name}, link {shown(name)}", "no figure", known, "add one")
    source = _stored(name, link, file) if given[0] == "answer" else _plain(name, link)
    if "cured" not in link.values:
        return source
    return source.mended(_named(link, "cured", lambda: Source.of_rms(name, _number(link, "cured"))))


def _plain(name: str, link: Section) -> Source:
    """A link by figures."""
    link.refuse_unknown((*COMMON, *FIGURES, "dof"))
    kind = next(key for key in FIGURES if key in link.values)
    other = [k for k in FIGURES if k in link.values and {k, kind} != {"mean", "std"} and k != kind]
    if other:
        raise link.fault(other[0], f"not beside {kind}", "leave one of them out")
    dof = link.number("dof")
    known: dict[str, Any] = {"dof": np.inf if dof is None else dof}
    known["origin"] = link.word("origin") or ""
    if kind in ("rms", "mean_length"):
        make = Source.of_rms if kind == "rms" else Source.of_mean_length
        return _named(link, kind, lambda: make(name, _number(link, kind), **known))
    mean = link.vector("mean")
    std = link.number("std") or 0.0
    if std < 0.0:
        raise link.fault("std", "at least 0", "give one axis' standard deviation, m")
    where = np.zeros(3) if mean is None else mean
    for key, size in (("mean", float(np.abs(where).max())), ("std", std)):
        _named(link, key, partial(size_of, f"source {name}, {key}", size))
    return _named(link, kind, lambda: Source.of(name, mean=where, covariance=std**2, **known))


def _stored(name: str, link: Section, file: Path) -> Source:
    """A link by an answer that was saved, or by a model."""
    named = link.word("answer") or ""
    if not is_file(file.parent / named):
        expected = "the file of an answer that was saved, or of a model"
        raise fault(link.where("answer"), shown(named), expected, "check the path")
    found = told(file.parent / named) or load(file.parent / named)
    kind = type(found).__name__
    if kind not in STORED:
        known = ", ".join(READABLE)
        raise fault(link.where("answer"), f"a {kind}", f"one of {known}", "name another file")
    keys, make = STORED[kind]
    link.refuse_unknown(("answer", *COMMON, *keys))
    source = _named(link, "answer", lambda: make(name, found, link))
    return replace(source, origin=link.word("origin") or f"{source.origin}, {named}")


def _target(link: Section) -> str | Array:
    """A target by its label, or by its place in CT (3,) [m]."""
    if isinstance(link.values.get("target"), str):
        return link.word("target") or ""
    target = link.vector("target")
    if target is None:
        mend = 'write target = [x, y, z], or "its label"'
        raise fault(link.where("target"), "nothing", "a place in CT, m", mend)
    return target


def _registration(name: str, found: Any, link: Section) -> Source:
    target, targets = _target(link), found.recording.targets
    if isinstance(target, str):
        if target not in targets.labels:
            known = f"one of {listed(targets.labels) or 'none'}"
            raise link.fault("target", known, "write target = [x, y, z]")
        target = targets.ct[targets.labels.index(target)]
    return Source.of_target(name, found.tre(target, None))


def _hand_eye(name: str, found: Any, link: Section) -> Source:
    return Source.of_hand_eye(name, found, _number(link, "range"))


def _arm(name: str, found: Any, link: Section) -> Source:
    """A model at the postures given, or at those of its own recording, as they were reached."""
    if "q" not in link.values:
        rows = {key: v for key, v in found.samples.items() if key in CONTEXT}
        return Source.of_arm(name, found, found.samples["q"], **rows)
    try:
        q = np.array(link.values["q"], dtype=float)
    except (TypeError, ValueError):
        raise link.fault("q", "postures of numbers", "write q = [[...], [...]]") from None
    return Source.of_arm(name, found, q)


CONTEXT = ("direction",)  # of a stored row that is not the same all the time
# Answer -> keys of its link, and who makes the source
STORED: Mapping[str, tuple[tuple[str, ...], Callable[[str, Any, Section], Source]]] = {
    "Registration": (("target",), _registration),
    "HandEye": (("range",), _hand_eye),
    "Targets": (("target",), lambda name, found, link: found.source(name, _target(link))),
    "BeamFigures": (
        ("range",),
        lambda name, found, link: found.source(name, _number(link, "range")),
    ),
    "Model": (("q",), _arm),
}
READABLE = ("Registration", "HandEye", "Model")


def _number(link: Section, key: str) -> float:
    value = link.number(key)
    if value is None:
        raise fault(link.where(key), "nothing", "a length, m", f"write {key} = 0.001")
    return value


def _named(link: Section, key: str, make: Callable[[], T]) -> T:
    """What is made, its error told with the file and the row, if it has none of its own."""
    try:
        return make()
    except PlumblineError as error:
        if str(error).startswith(link.file):
            raise
        raise PlumblineError(f"{link.where(key)}: {error}") from None
