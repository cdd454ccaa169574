r"""What a diagnosis found of an arm, as data: effects and their values, frame, tool, covariance.

Numbers that a fit found, and those of frame, tool and sockets among them.

The fit knows small changes: a shift s and a turn w about the middle c of the data. What a reader
wants is the origin t and the rotation vector :math:`\varphi` of the frame:

.. math:: \delta t = s + w \times (t - c), \qquad \delta\varphi = J_l(\varphi)^{-1} w

with the left Jacobian of the rotation vector (Sola, Deray, Atchuthan 2018, eq. 145).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np
import scipy

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect, Stage
from plumbline.kinematics.effects.effect import RANGES
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import counted, measured, quantity
from plumbline.optim.measurement.observation import loaded_chain, names_of
from plumbline.optim.model.constants import NO_TURN
from plumbline.optim.model.rows import Columns
from plumbline.optim.recording.kinds import EFFORTS

MEANING = {
    "frame": "origin of the robot's base in the device's frame",
    "frame r": "rotation vector from the robot's base to the device's frame",
    "tool": "tip in the tip frame",
    "tool r": "rotation vector of the tool in the tip frame",
    "socket": "place of the socket in the robot's base frame",
}


@dataclass(frozen=True)
class Known:
    """A found number."""

    value: float  # its value [unit]
    std: float  # its standard error [unit]
    unit: str  # its unit
    doc: str = ""  # what it is, in a few words

    def __str__(self) -> str:
        """``0.2403 ± 0.0061 mm``."""
        return measured(self.value, self.std, self.unit)


def meaning_of(name: str) -> tuple[str, str]:
    """Unit and meaning of a nuisance by its name, such as ``frame rx`` or ``socket 3 x``."""
    kind, last = name.split()[0], name.split()[-1]
    turning = last.startswith("r")
    return ("rad" if turning else "m"), MEANING[f"{kind} r" if turning else kind]


def told(
    names: tuple[str, ...],
    covariance: Array,
    T_device_base: Array,
    centre: Array,
    tool: Array,
    R_tip_tool: Array,
    sockets: Mapping[int, Array],
) -> dict[str, Known]:
    """Every nuisance by its name, such as ``frame rx``, ``tool z`` or ``socket 3 x``.

    Of what :class:`~plumbline.optim.model.fitted.Fitted` holds; the covariance (k, k) is that of
    small changes of these unknowns (k), turns of the frame about the centre.
    """
    size = len(names)
    A = np.eye(size)
    at = {name: k for k, name in enumerate(names)}
    values = dict.fromkeys(names, 0.0)
    if "frame x" in at:
        phi, t = _rotation_vector(T_device_base[:3, :3]), T_device_base[:3, 3]
        turn = [at[f"frame r{c}"] for c in "xyz"]
        A[np.ix_([at[f"frame {c}"] for c in "xyz"], turn)] = -_cross(t - centre)
        A[np.ix_(turn, turn)] = np.linalg.inv(left_jacobian(phi))
        values |= _named("frame ", t) | _named("frame r", phi)
    if "tool x" in at:
        values |= _named("tool ", tool)
    if "tool rx" in at:
        turned = _rotation_vector(R_tip_tool)
        turn = [at[f"tool r{c}"] for c in "xyz"]
        A[np.ix_(turn, turn)] = np.linalg.inv(left_jacobian(turned))
        values |= _named("tool r", turned)
    for label, place in sockets.items():
        values |= _named(f"socket {label} ", place)
    variance = np.diag(A @ covariance @ A.T)
    std = np.sqrt(np.maximum(variance, 0.0))
    return {
        name: Known(float(values[name]), float(s), *meaning_of(name))
        for name, s in zip(names, std, strict=True)
    }


def left_jacobian(phi: Array) -> Array:
    """The left Jacobian (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(phi))
    hat = _cross(phi)
    if angle < NO_TURN:
        return np.eye(3) + hat / 2
    a = (1 - np.cos(angle)) / angle**2
    b = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * hat + b * hat @ hat)


def _rotation_vector(R: Array) -> Array:
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(R).as_rotvec())


def _cross(v: Array) -> Array:
    return np.cross(v, np.eye(3)).T


def _named(begin: str, values: Array) -> dict[str, float]:
    return {f"{begin}{c}": float(v) for c, v in zip("xyz", values, strict=True)}


def by_effect(effects: Sequence[Effect], values: Any) -> list[tuple[Effect, Any]]:
    """The effects, each with its own of their stacked parameters (E,)."""
    edges = pairwise(np.cumsum([0, *(len(effect.parameters) for effect in effects)]))
    return [(effect, values[a:b]) for effect, (a, b) in zip(effects, edges, strict=True)]


def chain_of(robot: Robot, tip_frame: str, observation: str, ranges: Columns) -> Chain:
    """The joints that a recording speaks of: to its tip, or of all limbs where efforts are."""
    if observation == EFFORTS:
        return tree_of(robot, ranges["q"].shape[1], tip_frame)
    return robot.chain(tip_frame)


@dataclass(frozen=True)
class HeldOutGap:
    """How large the gap was on the recording, on rows left out."""

    before: float  # RMS without the causes [unit]
    after: float  # RMS with them [unit]
    floor: float  # RMS of noise alone [unit]; NaN where it is not known
    unit: str  # ``"m"`` or ``"rad"``
    sigma: float  # noise of one axis that the covariance rests on [unit]


@dataclass(frozen=True, eq=False)
class Fitted:
    """An arm as a diagnosis found it. P unknowns: E of effects behind those of frame and tool."""

    recording: str  # name of the recording that it was fitted to
    observation: str  # what that recording measured
    robot: Robot  # the nominal robot
    tip_frame: str  # name of its tip frame
    effects: tuple[Effect, ...]  # the effects: those that are always fitted, then the causes
    values: Array  # their parameters (E,), stacked
    # of all unknowns (P, P); a frame's and a tool's are small changes of it, turns of the frame
    # about ``centre``
    covariance: Array
    nuisance_names: tuple[str, ...]  # names of the frame's, tool's and sockets' unknowns (P - E)
    # what every fit of the recording took along, such as ``frame``, ``joint_offset``
    always: tuple[str, ...]
    T_device_base: Array  # the robot's base in the device's frame (4, 4) [m]
    centre: Array  # middle of the data (3,) in the device's frame [m]
    tool_offset: Array  # the nominal tip in the tip frame (3,) [m]
    tool: Array  # the tip in the tip frame as found (3,) [m]
    R_tip_tool: Array  # the tool's orientation as found (3, 3)
    sockets: dict[int, Array]  # places of the sockets (3,) in the base frame [m], by number
    samples: Columns  # some rows of the recording, by column (S, k)
    ranges: Columns  # smallest and largest value of every column that was fitted (2, k)
    # how large the gap was
    held: HeldOutGap = field(
        default_factory=lambda: HeldOutGap(np.nan, np.nan, np.nan, "m", np.nan)
    )

    def __repr__(self) -> str:
        sizes = " -> ".join(
            quantity(v, self.held.unit) for v in (self.held.before, self.held.after)
        )
        of = f"{self.robot.name[:40]} by {self.recording[:40]}"
        return f"<{type(self).__name__} of {of}: {counted(len(self.labels), 'effect')}; {sizes}>"

    @cached_property
    def chain(self) -> Chain:
        """The nominal chain, with masses."""
        return loaded_chain(chain_of(self.robot, self.tip_frame, self.observation, self.ranges))

    @property
    def labels(self) -> tuple[str, ...]:
        """The effects by name and element, each once."""
        return tuple(dict.fromkeys(effect.label for effect in self.effects))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns (P)."""
        return (*self.nuisance_names, *names_of(self.effects))

    @property
    def unknowns(self) -> Array:
        """Values of all unknowns (P,): nought for those of frame, tool and sockets."""
        return np.concatenate([np.zeros(len(self.nuisance_names)), self.values])

    @property
    def usual(self) -> dict[str, float]:
        """What is assumed where nothing is said: mean temperature and payload, the end of time."""
        means = ("temperature", "payload")
        usual = {n: float(self.samples[n].mean()) for n in means if n in self.samples}
        ends = {n: float(self.ranges[n][1, 0]) for n in ("time", "group") if n in self.ranges}
        return usual | ends

    @cached_property
    def nominal(self) -> Self:
        """The arm without any effect, with the same frame and tool."""
        size = len(self.nuisance_names)
        part = self.covariance[:size, :size]
        return replace(self, effects=(), values=np.empty(0), covariance=part)

    def without(self, *names: str) -> Self:
        """The model without the effects of some names, or labels such as ``backlash 2``."""
        return self.of([k for k, e in enumerate(self.effects)
                        if e.name not in names and e.label not in names])  # fmt: skip

    def of(self, kept: Sequence[int]) -> Self:
        """The model with some of its effects, by index."""
        first, parts = len(self.nuisance_names), by_effect(self.effects, range(len(self.values)))
        own = [i for k in kept for i in parts[k][1]]
        columns = [*range(first), *(first + i for i in own)]
        return replace(
            self,
            effects=tuple(self.effects[k] for k in kept),
            values=self.values[own],
            covariance=self.covariance[np.ix_(columns, columns)],
        )

    def asked(self, k: int) -> Self:
        """The model with one of its effects alone, of the usual size: to see what it does."""
        alone = self.of([k])
        usual = [p.null + p.scale for e in alone.effects for p in e.parameters]
        return replace(alone, values=np.array(usual, dtype=float))

    def kinds_that(self, do: Callable[[Self, Effect], bool]) -> set[type[Effect]]:
        """Kinds of its effects that do something, whatever the element.

        Some of them may do it by chance: an upright axis, which bears no load, never yields.
        """
        kinds: dict[type[Effect], dict[int | None, int]] = {}
        for k, effect in enumerate(self.effects):
            kinds.setdefault(type(effect), {})[effect.element] = k
        return {kind for kind, each in kinds.items()
                if all(do(self.asked(k), self.effects[k]) for k in each.values())}  # fmt: skip

    def lasting(self) -> Self:
        """The model without what belongs to its session: base drifted or bumped, tool slipped."""
        return self.of([k for k, e in enumerate(self.effects) if not _of_a_session(e)])

    @cached_property
    def nuisances(self) -> dict[str, Known]:
        """Frame, tool, sockets and what else was always fitted, by name."""
        always = {n: k for n, k in self.parameters.items() if n.split()[0] in self.always}
        size = len(self.nuisance_names)
        found = told(
            self.nuisance_names, self.covariance[:size, :size], self.T_device_base, self.centre,
            self.tool, self.R_tip_tool, self.sockets,
        )  # fmt: skip
        return found | always

    @cached_property
    def parameters(self) -> dict[str, Known]:
        """The effects' parameters by name."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))[len(self.nuisance_names) :]
        pairs = [(e, p) for e in self.effects for p in e.parameters]
        known = [
            Known(float(v), float(s), e.unit_of(p, self.chain), p.doc)
            for (e, p), v, s in zip(pairs, self.values, std, strict=True)
        ]
        return dict(zip(self.names[len(self.nuisance_names) :], known, strict=True))


def _of_a_session(effect: Effect) -> bool:
    """Whether it says when a base or a tool moved, or how one plane is."""
    if effect.element is not None and effect.observations == RANGES:
        return True  # of a plane, which stands in one room
    read = {*effect.needs, *effect.needs_one_of}
    return effect.stage in (Stage.BASE, Stage.TOOL) and bool({"time", "group"} & read)
