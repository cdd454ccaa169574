r"""Are these SI units? Degrees, millimetres and kelvin betray themselves by their size.

A rigid frame changes no distance and no angle between rows, so whatever the device's frame is, the
spread of the measured tips must be that of the predicted ones: a ratio near 1000 is millimetres.
Nothing here refuses a robot that merely disagrees with its model.
"""

from collections.abc import Callable, Iterator
from itertools import combinations, product

import numpy as np

from plumbline.errors import fault, shown
from plumbline.optim.recording import constants as at
from plumbline.optim.recording.disagreement import (
    quaternions_are_in_order,
    quaternions_are_unit,
    rows_meet_the_model,
)
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Array, Flags, Origin
from plumbline.optim.rigid import misfit, some_of, spread


def robot_is_in_metres(r: Recording, origin: Origin) -> None:
    """The arm, its tool and its sockets have the size of an arm's."""
    reach, tool = r.chain.reach, float(np.linalg.norm(r.tool_offset))
    _check_size(origin.key("[robot]"), "a reach of ", reach, at.LARGEST_ARM, "m")
    _check_size(origin.key("[tool] offset"), "a length of ", tool, max(reach, at.LARGEST_TOOL), "m")
    if r.socket_distance is not None:
        where, most = origin.key("[sockets] distance"), 2.0 * r.reach
        _check_size(where, "", r.socket_distance, most, "m")
        if not r.socket_distance > 0.0:
            raise fault(where, shown(r.socket_distance), "more than 0 m", "mend it or leave it out")


def gravity_is_the_earths(r: Recording, origin: Origin) -> Iterator[str]:
    """Gravity is m/s^2; another planet's is a note."""
    where, size = origin.key("[robot] gravity"), float(np.linalg.norm(r.robot.gravity))
    _check_size(where, "", size, at.LARGEST_GRAVITY, "m/s^2")
    if not at.EARTH[0] < size < at.EARTH[1]:
        yield f"{where}: {size:.4g} m/s^2 is not the earth's 9.81"


def _check_size(where: str, what: str, size: float, most: float, unit: str) -> None:
    if not size <= most:
        mend = f"looks like m{unit}: divide by 1000" if size / 1e3 <= most else "mend it"
        raise fault(where, f"{what}{size:.4g} {unit}", f"at most {most:.3g} {unit}", mend)


def noise_is_plausible(r: Recording, origin: Origin) -> Iterator[str]:
    """Noise is positive and smaller than what it is the noise of."""
    limit = {"m": r.reach, "rad": 1.0, "N m": at.LARGEST}  # drives differ by decades
    for key, value, unit in (
        ("noise_std", r.noise_std, r.kind.unit),
        ("noise_std_rotation", r.noise_std_rotation, "rad"),
    ):
        if value is None:
            continue
        if not 0.0 < value < limit[unit]:
            mend = f"give 1 sigma per axis in {unit}, or leave it out: then it is estimated"
            expected = f"between 0 and {limit[unit]:.3g} {unit}"
            raise fault(origin.key(key), shown(float(value)), expected, mend)
        if value < at.LEAST_NOISE:
            yield (
                f"{origin.key(key)}: {value:.3g} {unit} is less than any device reads; leave it "
                "out if it is not known: then it is estimated"
            )
        if value > at.COARSE * limit[unit]:
            said = f"{value:.3g} {unit} is coarse; is it in {unit}? No gap shows beside it"
            yield f"{origin.key(key)}: {said}: the noise is taken from what a fit leaves"
    if r.noise_std_rotation is not None and not r.kind.oriented:
        yield "noise_std_rotation: not used, only a pose has rotations"


def joints_are_in_si(r: Recording, origin: Origin) -> Iterator[str]:
    """Joint readings are rad and m; slightly beyond a limit is a note."""
    sides = [("q", r.q)]
    if r.kind.encoders:
        sides.append(("m", np.where(np.isnan(r.measured), r.q, r.measured)))
    for prefix, values in sides:
        _check_turns(r, prefix, values, origin)
        _check_slides(r, prefix, values, origin)
    lower, upper = r.chain.lower, r.chain.upper
    over = np.maximum(lower - r.q, r.q - upper)
    row, joint = np.unravel_index(np.argmax(over), over.shape)
    if over[row, joint] > at.BEYOND_LIMIT:
        count = int((over > at.BEYOND_LIMIT).any(axis=1).sum())
        where = origin.at(f"q{joint + 1}", row)
        yield (
            f"{where}: {r.q[row, joint]:.4g} is outside of the joint's limits "
            f"{lower[joint]:.4g} to {upper[joint]:.4g}, as are {count} of {len(r)} rows"
        )


def _check_turns(r: Recording, prefix: str, values: Array, origin: Origin) -> None:
    turning = r.chain.turning
    lower, upper = r.chain.lower, r.chain.upper
    limit = np.maximum(np.abs(lower), np.abs(upper))
    widest = np.maximum(at.TURNS, np.where(np.isfinite(limit), limit + at.SLACK, 0.0))
    extreme = (np.abs(values) > widest) & turning
    outside = _outside(values, lower, upper) & turning
    as_degrees = _outside(np.radians(values), lower, upper) & turning
    cells = max(1, len(values) * int(turning.sum()))
    explained = as_degrees.sum() < at.AS_DEGREES * cells
    looks = explained and (extreme.sum() > at.EXTREME * cells or outside.sum() > at.OUTSIDE * cells)
    if extreme.any() or (looks and outside.any()):
        row, joint = np.argwhere(extreme if extreme.any() else outside)[0]
        mend = "mend or delete the row, or count the joint from within one turn"
        if looks:
            mend = "looks like degrees: multiply revolute joints by pi/180"
        allowed = f"{max(lower[joint], -at.TURNS):.4g} to {min(upper[joint], at.TURNS):.4g} rad"
        where = origin.at(f"{prefix}{joint + 1}", row)
        raise fault(where, shown(float(values[row, joint])), allowed, mend)


def _check_slides(r: Recording, prefix: str, values: Array, origin: Origin) -> None:
    """Slides read many times their travel, or the arm's reach, are in millimetres.

    A linear axis may go well beyond what is stated, and as far as a hall is long where nothing is:
    that much alone makes no millimetres of it. Shorter ones are told by the tips, where there are.
    """
    limits = np.maximum(np.abs(r.chain.lower), np.abs(r.chain.upper))
    for joint in [j for j, kind in enumerate(r.chain.kinds) if kind == "prismatic"]:
        free = not np.isfinite(limits[joint])
        travel = max(r.chain.reach, at.LARGEST_TOOL) if free else float(limits[joint])
        if np.median(np.abs(values[:, joint])) > at.MILLIMETRES * travel:
            row = int(np.argmax(np.abs(values[:, joint])))
            where = origin.at(f"{prefix}{joint + 1}", row)
            allowed = f"up to {travel:.4g} m or somewhat more"
            mend = "looks like millimetres: divide by 1000"
            raise fault(where, shown(float(values[row, joint])), allowed, mend)


def joints_meet_the_tips(r: Recording, origin: Origin) -> None:
    """Degrees and millimetres may stay within limits, but only converted do they meet the tips."""
    if not r.kind.device:
        return
    some = some_of(len(r))
    q, tips = r.q[some], r.measured[some, :3]
    as_given = misfit(r.chain.tips(q, r.tool_offset), tips)
    meets = at.MEETS * spread(tips)
    if as_given <= meets:
        return
    turning = r.chain.turning
    for there, factor, unit, si, mend in (
        (turning, np.pi / 180.0, "degrees", "rad", "multiply revolute joints by pi/180"),
        (~turning, 1e-3, "millimetres", "m", "divide by 1000"),
    ):
        converted = misfit(r.chain.tips(np.where(there, factor * q, q), r.tool_offset), tips)
        if there.any() and converted < min(meets, at.CONVERTED * as_given):
            found = (
                f"tips {as_given:.3g} m off the predicted ones, {converted:.3g} m if q is in {unit}"
            )
            where = origin.at(f"q{int(np.argmax(there)) + 1}", 0)
            raise fault(where, found, f"joint readings in {si}", f"looks like {unit}: {mend}")


def tips_are_in_metres(r: Recording, origin: Origin) -> None:
    """Measured tips spread as predicted ones do, and no wider than the arm can reach."""
    if not r.kind.device:
        return
    tips = r.measured[:, :3]
    away = np.linalg.norm(tips - np.median(tips, axis=0), axis=1)
    some = some_of(len(r))
    predicted = r.chain.tips(r.q[some], r.tool_offset)
    ratio = spread(tips[some]) / max(spread(predicted), 1e-12)
    if spread(predicted) > at.SMALLEST_SPREAD:
        if ratio > at.NEAR_SCALE:
            _check_columns(predicted, tips[some], origin)
        if spread(tips[some]) < at.STILL:
            found = "the same tip in most rows, while the joints move"
            mend = "the device stood still, or its columns were copied: record it again"
            raise fault(origin.at("x"), found, "tips that move with the joints", mend)
        _check_scale(r, away, ratio, origin)
    most = at.FARTHEST * r.reach
    row = int(np.argmax(away))
    if away[row] > most:
        column = "xyz"[int(np.argmax(np.abs(tips[row] - np.median(tips, axis=0))))]
        found = f"a tip {away[row]:.4g} m from the middle of the others"
        mend = "mend or delete the row; if all are like it, positions must be in m"
        raise fault(origin.at(column, row), found, f"at most {most:.3g} m", mend)


def _check_columns(predicted: Array, tips: Array, origin: Origin) -> None:
    """One or two columns in a unit of their own: in metres they meet the predicted tips."""
    parts = [some for count in (1, 2) for some in combinations(range(3), count)]
    tried = [
        (misfit(predicted, tips / np.where(np.isin(range(3), some), scale, 1.0)), some, words)
        for (scale, words), some in product(at.SCALES, parts)
    ]
    left, some, words = min(tried)
    if left < at.MEETS * spread(predicted):
        named = " and ".join("xyz"[k] for k in some)
        found = f"{named} in another unit than the rest: in it the tips meet the model"
        raise fault(origin.at("xyz"[some[0]]), found, "x, y, z in m", f"looks like {words}")


def _check_scale(r: Recording, away: Array, ratio: float, origin: Origin) -> None:
    row = int(np.argmax(away))
    column = "xyz"[int(np.argmax(np.ptp(r.measured[:, :3], axis=0)))]
    expected = "the spread that the joints predict"
    found = f"tips that spread {ratio:.3g} times as far"
    scale, words = min(at.SCALES, key=lambda known: abs(np.log(max(ratio, 1e-12) / known[0])))
    if 1 / at.NEAR_SCALE < ratio / scale < at.NEAR_SCALE:
        raise fault(origin.at(column, row), found, expected, f"looks like {words}")
    if 1 / at.NEAR_SCALE < ratio * 1e3 < at.NEAR_SCALE:
        mend = "a thousand times too small: multiply positions by 1000"
        raise fault(origin.at(column, row), found, expected, mend)


def second_encoders_move(r: Recording, origin: Origin) -> None:
    """Second encoders move with the joints that they are on."""
    if not r.kind.encoders or not r.measured_joints:
        return
    seen = list(r.measured_joints)
    moved = np.ptp(r.q[:, seen], axis=0) > at.SMALLEST_SPREAD
    if moved.any() and not (np.ptp(r.measured[:, seen], axis=0)[moved] > at.STILL).any():
        where = origin.at(f"m{seen[int(np.argmax(moved))] + 1}")
        mend = "the encoders stood still, or their columns were copied: record them again"
        raise fault(where, "one reading in every row", "readings that move with q", mend)


def temperature_is_celsius(r: Recording, origin: Origin) -> Iterator[str]:
    """Temperatures are those of a room or a machine, in degC."""
    if r.temperature is None:
        return
    if np.median(r.temperature) > at.KELVIN:
        found, mend = shown(float(r.temperature[0])), "looks like kelvin: subtract 273.15"
        raise fault(origin.at("temperature", 0), found, "degC", mend)
    _refuse_beyond(r.temperature, *at.TEMPERATURES, "degC", "temperature", origin)
    if np.median(r.temperature) > at.FAHRENHEIT:
        yield f"{origin.file}: a temperature of {np.median(r.temperature):.0f} degC: Fahrenheit?"


def payload_is_in_kilograms(r: Recording, origin: Origin) -> None:
    """Payloads are not negative, and what an arm can carry."""
    if r.payload is not None:
        _refuse_beyond(r.payload, 0.0, at.LARGEST_PAYLOAD, "kg", "payload", origin)


def refuse_fast(r: Recording, origin: Origin) -> None:
    """Refuse speeds, accelerations and efforts beyond any drive's, as they were recorded."""
    efforts = r.measured if r.kind.efforts else r.effort
    for name, values, most, unit in (
        ("velocity", r.velocity, at.LARGEST_SPEED, "rad/s or m/s"),
        ("acceleration", r.acceleration, at.LARGEST_ACCELERATION, "rad/s^2 or m/s^2"),
        ("effort", efforts, at.LARGEST_EFFORT, "N m or N"),
    ):
        for joint, column in enumerate([] if values is None else values.T, start=1):
            _refuse_beyond(column, -most, most, unit, f"{name}{joint}", origin)


def _refuse_beyond(
    values: Array, low: float, high: float, unit: str, column: str, origin: Origin
) -> None:
    expected, bad = f"{low:g} to {high:g} {unit}", (values < low) | (values > high)
    origin.refuse(column, bad, values, expected, "mend the cell or its unit")


def _outside(values: Array, lower: Array, upper: Array) -> Flags:
    return (values < lower - at.SLACK) | (values > upper + at.SLACK)


CHECKS: tuple[Callable[[Recording, Origin], Iterator[str] | None], ...] = (
    robot_is_in_metres, gravity_is_the_earths, noise_is_plausible, joints_are_in_si,
    joints_meet_the_tips, tips_are_in_metres, second_encoders_move, quaternions_are_unit,
    quaternions_are_in_order, temperature_is_celsius, payload_is_in_kilograms, rows_meet_the_model,
)  # fmt: skip
