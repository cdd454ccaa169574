"""A robot's drives as data, and what they do with commands."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.kinematics.law import Law
from plumbline.kinematics.robot import Robot, joints_named
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis.motion.carried import NOTHING, Carried
from plumbline.optim.diagnosis.motion.constants import MOST_JUDGED
from plumbline.optim.diagnosis.motion.fit import evaluated
from plumbline.optim.diagnosis.motion.forward import forward
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.rollout import played
from plumbline.optim.diagnosis.motion.settled import carrying
from plumbline.optim.diagnosis.motion.signals import signals_of, spread
from plumbline.optim.diagnosis.motion.units import in_unit, levers_of, slides
from plumbline.optim.diagnosis.motion.windows import Drives as Felt
from plumbline.optim.model.apply import Applied
from plumbline.optim.model.apply import apply as apply_arm
from plumbline.optim.model.constants import LOAD_ROUNDS, MARGIN
from plumbline.optim.model.fitted import Fitted, Known
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import same_joints


@dataclass(frozen=True, eq=False)
class Servo:
    """What was found of one joint's drive."""

    effects: tuple[MotionEffect, ...]  # its causes (P,)
    values: Array  # their parameters (P,)
    std: Array  # standard errors (P,)
    inertia: float  # largest inertia about the joint that was met [kg m^2]
    span: Array  # smallest and largest command that was fitted (2,) [rad, rad/s or N m]

    def value(self, name: str, **form: object) -> float:
        """The parameter of an effect of that name and form; 0 where it was not found."""
        for effect, value in zip(self.effects, self.values, strict=True):
            if effect.name == name and all(getattr(effect, k) == v for k, v in form.items()):
                return float(value)
        return 0.0

    def of(self, keep: tuple[MotionEffect, ...]) -> Self:
        """A copy with these of its effects."""
        chosen = [k for k, effect in enumerate(self.effects) if effect in keep]
        kept = tuple(self.effects[k] for k in chosen)
        return replace(self, effects=kept, values=self.values[chosen], std=self.std[chosen])


@dataclass(frozen=True, eq=False, repr=False)
class Driven:
    """A robot's drives as a diagnosis found them."""

    recording: str  # what it was found on
    robot: Robot  # the robot
    joints: tuple[str, ...]  # names of the joints that were commanded (n)
    index: tuple[int, ...]  # their places among the coordinates of the robot's model (n)
    law: Law  # what a command is, and whether the servo's gains are known
    kp: Array  # known gains (n,) [N m/rad]; zeros where they are not
    kd: Array  # known dampings (n,) [N m s/rad]
    servos: Mapping[int, Servo]  # what was found, by the joint's number from 1
    before: float  # RMS of the ideal drives on what no fit has seen [rad]
    after: float  # the same with the causes [rad]
    lead: float = 0.0  # by how long its clock read positions after their rows' times [s]
    felt: Felt = ()  # under torques, by what drives of its neighbours each was found; none if ideal
    carried: Carried = NOTHING  # what the tip carries that the robot's file lacks
    carried_std: Array = field(default_factory=lambda: np.empty(0))  # standard errors (P,)

    def __repr__(self) -> str:
        count = len(self.carried.bodies)
        count += sum(len(servo.effects) for servo in self.servos.values())
        gap = f"{quantity(self.before, self.unit)} -> {quantity(self.after, self.unit)}"
        return f"<Drives of {self.robot.name[:40]!r}: {count} causes, {gap}>"

    @property
    def of_axes(self) -> bool:
        """Whether these are a controlled tip's axes: drives of no robot's joints."""
        return not set(self.joints) & set(self.robot.model.names)

    @property
    def unit(self) -> str:
        """Unit of what is told of all: ``"rad"``, or ``"m"`` where all joints slide."""
        return "m" if all(slides(self.robot, self.index)) else "rad"

    @property
    def parameters(self) -> dict[str, Known]:
        """Every number found, by ``"actuation_delay 2"``."""
        units = ["m" if one else "rad" for one in slides(self.robot, self.index)]
        masses = [(body, p) for body in self.carried.bodies for p in body.declared]
        told = zip(masses, self.carried.values, self.carried_std, strict=True)
        return {
            f"{body.label} {p.name}": Known(float(v), float(s), p.unit, p.doc)
            for (body, p), v, s in told
        } | {
            f"{effect.name} {number}": Known(
                float(v),
                float(s),
                in_unit(effect.unit(self.law), units[number - 1]),
                effect.parameter.doc,
            )
            for number, servo in self.servos.items()
            for effect, v, s in zip(servo.effects, servo.values, servo.std, strict=True)
        }

    def rollout(self, time: ArrayLike, command: ArrayLike, *, start: ArrayLike = ()) -> Array:
        """What the joints do (N, n) [rad or m] when they are told so.

        Args:
            time: Time (N,) [s], ascending.
            command: Commands (N, n) [rad, rad/s or N m].
            start: Where the joints are at first (n,) [rad or m]; by default where commands of
                position put them, else at zero.

        Raises:
            PlumblineError: Commands of another number of joints, too few of them, none that are
                finite or by far too large, or a clock that does not go on.
        """
        n = len(self.joints)
        t, u = _numbers("time", time), _numbers("command", command)
        if t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0.0).all():
            found = f"an array {t.shape}" if t.ndim != 1 or len(t) < 2 else "no step forwards"
            raise fault("time", found, "2 or more, ascending", "give each row its time")
        if u.shape != (len(t), n):
            raise fault("command", f"an array {u.shape}", f"({len(t)}, {n})", "a column a joint")
        if np.shape(start) not in ((0,), (n,)):
            raise fault("start", f"an array {np.shape(start)}", f"({n},)", "give one a joint")
        start = _numbers("start", start)
        places = self.law.follows
        first = start if start.size else u[0] if places else 0 * u[0]
        q = u - u[0] + first if places else np.broadcast_to(first, u.shape)
        if self.law.pushes:
            return self._pushed(t, u, q)
        for _ in range(LOAD_ROUNDS):
            q = self._played(t, u, np.vstack([first, q[1:]]))
        return np.asarray(q)

    def _asked(self, time: Array, command: Array, q: Array) -> MotionRecording:
        return MotionRecording(
            self.recording, self.robot, self.joints, self.index, self.law, time, command, q,
            None, None, self.kp, self.kd, carried=self.carried,
        )  # fmt: skip

    def _pushed(self, time: Array, command: Array, q: Array) -> Array:
        """Positions (N, n) [rad or m] of bodies that torques move from the first of q (N, n)."""
        ideal = (), np.empty(0)
        drives = ((s.effects, s.values) if (s := self.servos.get(j + 1)) else ideal
                  for j in range(len(self.joints)))  # fmt: skip
        found = forward(self._asked(time, command, q), tuple(drives), q[0])
        if not (sane := np.isfinite(found).all(axis=1)).all():
            at = f"command, rows before {int(np.argmin(sane)) + 1}"
            raise fault(at, "torques that no state comes of", "such as an arm takes", "give N m")
        return found

    def _played(self, time: Array, command: Array, q: Array) -> Array:
        """Positions (N, n) [rad or m], loads being those of the postures q (N, n)."""
        signals = signals_of(self._asked(time, command, q))
        found = q.copy()
        for number, servo in self.servos.items():
            windows = signals.windows(number - 1, np.zeros(1, np.int64))
            even = played(windows, servo.effects, servo.values)
            found[:, number - 1] = np.interp(time, signals.time, even)
        return found

    def tried(self, other: MotionRecording) -> Applied:
        """How they do on another motion, of the same kind and joints; nothing is fitted again."""
        before, after = self.gaps(other)
        seen = np.isfinite(before)
        outside = np.zeros((len(other), len(self.joints)), dtype=bool)
        for number, servo in self.servos.items():
            low, high = servo.span + MARGIN * np.ptp(servo.span) * np.array([-1.0, 1.0])
            u = other.command[:, number - 1]
            outside[:, number - 1] = (u < low) | (u > high)
        columns = {f"u{j + 1}": float(outside[:, j].mean()) for j in range(len(self.joints))}
        levers = levers_of(slides(self.robot, self.index))[seen]
        was, left = (
            float(np.sqrt(np.mean((values[seen] / levers) ** 2))) for values in (before, after)
        )
        rows = tuple(int(k) + 1 for k in np.flatnonzero(outside.any(axis=1)))
        shares = {name: share for name, share in columns.items() if share}
        both, promised = (was, left), self.after
        return Applied(other.name, len(other), self.unit, *both, promised, (), (), rows, shares, ())

    def gaps(self, other: MotionRecording) -> tuple[Array, Array]:
        """Root mean squares (n,) on another motion, ideal and with causes [rad]; NaN at rest."""
        n = len(self.joints)
        both = (other.law, self.law)
        alike = other.law == self.law or all(x.known for x in both) or all(x.ideal for x in both)
        if other.n != n or not alike:
            raise PlumblineError(
                f"{other.name}: {other.n} joints by {other.law}, expected {n} by {self.law} "
                f"as in {self.recording}; give a motion of the same drives"
            )
        moved = (joints_named(one.robot, one.joints) for one in (self, other))
        if not same_joints(*moved):
            found = f"{other.robot.name} with joints placed or turning otherwise"
            mend = "give a motion of the same drives"
            raise fault(f"{other.name}, robot", found, self.robot.name, mend)
        read = replace(other, law=self.law, lead=self.lead, carried=self.carried)
        signals = signals_of(read, drives=self.felt)
        bare = carrying(signals, NOTHING) if self.carried.bodies else signals
        starts = spread(signals.starts, MOST_JUDGED)
        before, after = np.full((2, n), np.nan)
        for number, servo in self.servos.items():
            windows = signals.windows(number - 1, starts)
            ideal = bare.windows(number - 1, starts)
            before[number - 1] = np.sqrt(evaluated(ideal, (), np.empty(0)).square)
            after[number - 1] = np.sqrt(evaluated(windows, servo.effects, servo.values).square)
        return before, after

    def without(self, lacked: Mapping[int, tuple[MotionEffect, ...]]) -> Self:
        """A copy without some effects, by the joint's number."""
        kept = {
            number: servo.of(tuple(e for e in servo.effects if e not in lacked.get(number, ())))
            for number, servo in self.servos.items()
        }
        return replace(self, servos=kept)


def _numbers(name: str, values: ArrayLike) -> Array:
    """An array of finite numbers, or refused."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise fault(name, "no numbers", "an array of them", "give numbers in SI units") from None
    if not np.isfinite(array).all():
        raise fault(name, "a value that is not finite", "finite ones", "mend or leave it out")
    return array


def apply(
    model: Fitted | Driven, other: Recording | MotionRecording, *, force: bool = False
) -> Applied:
    """Try a model on another recording of the robot; with force on one set up otherwise, too.

    Raises:
        PlumblineError: It is of another robot, or measures something else, or another simple set-up
            explains its rows far better.
    """
    if isinstance(model, Driven):
        if isinstance(other, MotionRecording):
            return model.tried(other)
        like, mend = f"a motion as in {model.recording}", "give a motion of the same drives"
        raise fault(f"{other.name}, observation", other.observation, like, mend)
    if isinstance(other, MotionRecording):
        like, mend = f"{model.observation} as in {model.recording}", "give one of the same robot"
        raise fault(f"{other.name}, observation", other.observation, like, mend)
    return apply_arm(model, other, force=force)
