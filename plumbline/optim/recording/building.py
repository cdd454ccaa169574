"""From loose arrays to a checked :class:`~.recording.Recording`: shapes, types, then physics.

Both ways in, folders and arrays, end here, so that both meet the same checks; the
:class:`~.recording.table.Origin` lets a message name the row of the file where there is one.
"""

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, best_matches, fault, one_line, shown
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.recording import checks, units
from plumbline.optim.recording.columns import JOINTWISE, with_noise_shape
from plumbline.optim.recording.constants import LARGEST
from plumbline.optim.recording.disagreement import counted_from_one_turn, far_from_base, normalised
from plumbline.optim.recording.efforts import with_motion
from plumbline.optim.recording.kinds import ALWAYS, ELSEWHERE, KINDS
from plumbline.optim.recording.recording import Recording, hash_of
from plumbline.optim.recording.table import Array, Flags, Origin, as_integers

WHOLE = ("socket", "group")
SETTING = ("scale_std", "noise_std", "noise_std_rotation", "socket_distance")


class Context(TypedDict, total=False):
    """What a recording may say besides, as in :class:`~.recording.recording.Recording`."""

    time: ArrayLike
    temperature: ArrayLike
    direction: ArrayLike
    velocity: ArrayLike
    acceleration: ArrayLike
    effort: ArrayLike
    force: ArrayLike
    payload: ArrayLike
    socket: ArrayLike
    group: ArrayLike
    held_out: ArrayLike
    noise_std: float | None
    noise_axes: ArrayLike
    noise_rows: ArrayLike
    noise_by_joint: ArrayLike
    noise_std_rotation: float | None
    scale_std: float | None
    lever: float | None
    always: str | Iterable[str]
    socket_distance: float | None
    socket_pairs: tuple[tuple[int, int], ...]
    measured_joints: tuple[int, ...]
    notes: tuple[str, ...]


def build_recording(
    *,
    observation: str,
    robot: Robot | str,
    q: ArrayLike,
    measured: ArrayLike | None = None,
    tip_frame: str | None = None,
    tool_offset: ArrayLike = (0.0, 0.0, 0.0),
    name: str = "arrays",
    **context: Unpack[Context],
) -> Recording:
    """A checked recording from arrays.

    Args:
        observation: Kind of observation.
        robot: The robot, or the name of a bundled one.
        q: Joint readings (N, n) [rad or m].
        measured: Measured values (N, m), see :class:`~.recording.recording.Recording`; not for
            ``fixed_point``.
        tip_frame: Name of the tip frame; the robot's own by default.
        tool_offset: Nominal tip (3,) in the tip frame [m].
        name: What to call it.
        **context: ``time``, ``group``, ``noise_std``, ...: see :class:`Context`.

    Raises:
        PlumblineError: The arrays cannot be used; the message says why and what to do.
    """
    return build(
        Origin(),
        name=name,
        observation=observation,
        robot=robot_of(robot),
        tip_frame=tip_frame,
        q=q,
        measured=measured,
        tool_offset=tool_offset,
        **context,
    )


def build(
    origin: Origin,
    *,
    name: str,
    observation: str,
    robot: Robot,
    tip_frame: str | None,
    q: ArrayLike,
    measured: ArrayLike | None,
    tool_offset: ArrayLike,
    held_out: ArrayLike | None = None,
    notes: tuple[str, ...] = (),
    known_effects: Iterable[str] | None = None,
    **context: Any,
) -> Recording:
    """A checked :class:`~.recording.recording.Recording`, which says what the arguments are."""
    check_observation(observation, "observation")
    chain = chain_to(robot, tip_frame, "tip_frame", observation, _width(q))
    postures = _matrix(q, "q", chain.n, origin)
    if observation == "joint_torque" and measured is None:
        measured = context.pop("effort", None)
    rows = len(postures)
    context = with_noise_shape(context, observation, rows, chain.n, origin)
    columns = _context(context, rows, chain.n, origin)
    effects = tuple(REGISTRY if known_effects is None else known_effects)
    checks.check_always(columns["always"], effects, origin.key("[fit] always"))
    recording = Recording(
        name=name,
        observation=observation,
        robot=robot,
        chain=chain,
        tip_frame=chain.tip_frame,
        q=postures,
        measured=_measured(measured, observation, rows, chain.n, origin),
        tool_offset=_vector(tool_offset),
        held_out=held_flags(held_out, rows, origin),
        in_file=origin.columns,
        **columns,
    )
    assumed = _assumed_pairs(recording)
    recording = replace(recording, socket_pairs=recording.socket_pairs or assumed)
    units.refuse_fast(recording, origin)  # before what was recorded is smoothed
    recording = _completed(recording, origin)
    found = [_told(assumed, origin)] if len(assumed) > 1 else []
    for check in (*checks.CHECKS, *units.CHECKS):
        found += check(recording, origin) or ()
    recording, turned = counted_from_one_turn(recording, origin)  # of what is in radians
    found += turned
    off = 0.0 if "frame" in recording.always else far_from_base(recording)
    if off:
        recording = replace(recording, always=("frame", *recording.always))
        found.append(_frame_is_fitted(off, origin))
    if observation == "pose":
        recording = replace(recording, measured=normalised(recording.measured))
    if recording.held_out is not None and not recording.held_out.any():
        recording = replace(recording, held_out=None)
    return replace(recording, notes=(*notes, *recording.notes, *map(one_line, found)))


def _frame_is_fitted(off: float, origin: Origin) -> str:
    return (
        f"{origin.key('[fit] always')}: leaves out frame, but taken in the robot's base frame the "
        f"readings are off by {off:.2g} m: the frame is fitted all the same"
    )


def check_observation(name: str, where: str) -> None:
    """Refuse a kind of observation that is unknown, or that another command reads."""
    if name in KINDS:
        return
    if name in ELSEWHERE:
        mend = f"run: {ELSEWHERE[name].command}"
        raise fault(where, f"{name}, whose rows are read apart", ", ".join(KINDS), mend)
    near = best_matches(name, [*KINDS, *ELSEWHERE])
    raise fault(where, shown(name), f"one of {', '.join(KINDS)}", f"best matches: {near}")


def robot_of(robot: Robot | str) -> Robot:
    """A robot, or the bundled one of that name (PlumblineError: there is none)."""
    try:
        return Robot.bundled(robot) if isinstance(robot, str) else robot
    except PlumblineError as error:
        raise PlumblineError(one_line(f"robot: {error}")) from None


def chain_to(
    robot: Robot,
    tip_frame: str | None,
    where: str,
    observation: str = "",
    joints: int | None = None,
) -> Chain:
    """The robot's chain to a frame (PlumblineError: none); of efforts, with all of its limbs."""
    try:
        if observation == "joint_torque":
            return tree_of(robot, joints, tip_frame)
        return robot.chain(tip_frame)
    except PlumblineError as error:
        raise PlumblineError(one_line(f"{where}: {error}")) from None


def _completed(recording: Recording, origin: Origin) -> Recording:
    """With the joints that are measured, and a hash, where none was given."""
    r = recording
    if r.kind.efforts:
        r = with_motion(r, origin)
    elif r.kind.encoders and not r.measured_joints:
        seen = np.flatnonzero(np.isfinite(r.measured).all(axis=0))
        r = replace(r, measured_joints=tuple(int(j) for j in seen))
    if not r.sha256:
        r = replace(r, sha256=hash_of(*(array.tobytes() for array in r._arrays().values())))
    return r


def _assumed_pairs(r: Recording) -> tuple[tuple[int, int], ...]:
    """Pairs of sockets for a distance that comes without any."""
    if r.socket is None or r.socket_distance is None or r.socket_pairs:
        return ()
    return checks.paired(int(k) for k in np.unique(r.socket))


def _told(pairs: tuple[tuple[int, int], ...], origin: Origin) -> str:
    named = ", ".join(f"[{a}, {b}]" for a, b in pairs[:4]) + ", ..." * (len(pairs) > 4)
    return f"{origin.key('[sockets] distance')}: taken to hold for pairs {named}; else give pairs"


def _context(given: dict[str, Any], rows: int, n: int, origin: Origin) -> dict[str, Any]:
    """The optional arrays with their shapes and types checked; the rest as it is."""
    allowed = [field.name for field in fields(Recording)]
    unknown = next((name for name in given if name not in allowed), None)
    if unknown:
        near = best_matches(unknown, allowed)
        raise fault(unknown, "an unknown attribute", "one of a Recording", f"best matches: {near}")
    ready = {name: value for name, value in given.items() if value is not None}
    for name, value in ready.items():
        if name in JOINTWISE or name == "force":
            ready[name] = _matrix(value, name, 3 if name == "force" else n, origin, rows)
        elif name in ("time", "temperature", "payload", *WHOLE):
            column = _column(value, name, rows, origin)
            ready[name] = as_integers(column, name, origin) if name in WHOLE else column
        elif name in SETTING:
            ready[name] = float(_column([value], name, 1, Origin())[0])
    if "noise_by_joint" in ready:
        ready["noise_by_joint"] = _matrix([ready["noise_by_joint"]], "noise_std", n, origin)[0]
    always = ready.get("always", ALWAYS)
    ready["always"] = (always,) if isinstance(always, str) else tuple(always)
    return ready


def _width(q: ArrayLike) -> int | None:
    """Columns of a matrix; None of what is none, which is refused later."""
    shape = np.shape(q)
    return int(shape[1]) if len(shape) == 2 else None


def _numbers(values: ArrayLike, name: str) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise fault(name, "values that are no numbers", "numbers", "convert them") from None
    return array


def _shape_fault(name: str, array: Array, expected: str) -> PlumblineError:
    return fault(name, f"shape {array.shape}", expected, "one row a sample, one column a value")


def _matrix(
    values: ArrayLike,
    name: str,
    width: int,
    origin: Origin,
    rows: int | None = None,
    holes: bool = False,
) -> Array:
    """Numbers (N, width), finite unless holes (NaN) are allowed."""
    array = _numbers(values, name)
    wanted = "N" if rows is None else str(rows)
    if array.ndim != 2 or array.shape[1] != width or rows not in (None, len(array)):
        raise _shape_fault(name, array, f"({wanted}, {width})")
    broken = np.argwhere(~((np.abs(array) <= LARGEST) | (holes & np.isnan(array))))
    if len(broken):
        row, column = broken[0]
        where = origin.at(f"{name}{column + 1}", row)
        found = shown(float(array[row, column]))
        raise fault(where, found, f"a finite number below {LARGEST:g}", "mend or delete the row")
    return array


def _column(values: ArrayLike, name: str, rows: int, origin: Origin) -> Array:
    array = _numbers(values, name)
    if array.shape != (rows,):
        raise _shape_fault(name, array, f"({rows},)")
    return _matrix(array[:, None], name, 1, origin)[:, 0]


def _vector(values: ArrayLike) -> Array:
    array = _numbers(values, "tool_offset")
    if array.shape != (3,) or not np.isfinite(array).all():
        raise fault("tool_offset", f"{shown(array.tolist())}", "3 finite numbers", "x, y, z in m")
    return array


def held_flags(values: ArrayLike | None, rows: int, origin: Origin) -> Flags | None:
    """Which rows are held out (N,), of 0 and 1 (PlumblineError: another number, or every row)."""
    if values is None:
        return None
    numbers = as_integers(_column(values, "held_out", rows, origin), "held_out", origin)
    bad = (numbers != 0) & (numbers != 1)
    origin.refuse("held_out", bad, numbers, "0 or 1", "1 keeps the row from every fit")
    if numbers.all():
        found = "every row held out"
        raise fault(origin.at("held_out"), found, "some of them", "delete the column")
    return numbers == 1


def _measured(
    values: ArrayLike | None, observation: str, rows: int, n: int, origin: Origin
) -> Array:
    if observation == "fixed_point":
        return np.empty((rows, 0))
    width = len(KINDS[observation].columns) or n
    if values is None:
        raise fault("measured", "nothing", f"({rows}, {width})", f"give it for {observation}")
    holes = observation == "joint_position"
    return _matrix(values, "measured", width, origin, rows, holes)
