r"""Is a motion's set-up right? What was told, as places, beside what was read.

Positions are places, velocities are once they are added up, :math:`\sum u\,\Delta t`, each run from
its own start and without a slope, which an offset of a velocity makes. A drive delays, lags, scales
and shifts; it makes no degrees of radians, no position of a velocity, and no turn of nothing.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import scipy

from plumbline.errors import fault
from plumbline.kinematics.effects.actuation_deadband import ActuationDeadband
from plumbline.kinematics.effects.actuation_offset import ActuationOffset
from plumbline.kinematics.law import Law
from plumbline.optim.core.problem import Flags
from plumbline.optim.diagnosis.motion.constants import ALIKE, LATEST, LENGTH, SAME_UNIT, STATED
from plumbline.optim.diagnosis.motion.units import in_unit
from plumbline.optim.recording import constants
from plumbline.optim.recording.mixed_up import latest_cosine, refuse_mixed_up, refuse_repeated
from plumbline.optim.recording.table import Array, Origin

Motion = Any  # a MotionRecording, whose own module asks this one


def refuse_wrong_set_up(r: Motion, origin: Origin) -> None:
    """Refuse what no drive makes of its commands.

    Raises:
        PlumblineError: It names the column and the way out.
    """
    _refuse_sizes(r, origin)
    _refuse_frozen(r, origin)
    refuse_repeated(r.command, r.q, _letter(r), origin)
    # Refuse a clock of which a window, in which drives settle, holds fewer than ten rows
    step, most = float(np.median(np.diff(r.time))), LENGTH[r.law] / 10
    if step > most:
        mend = "divide by 1000 if in ms, or log more often"
        raise fault(origin.at("time"), f"rows {step:.3g} s apart", f"at most {most:.3g} s", mend)
    if r.law.pushes:
        return
    _refuse_mixed_up(r, origin)
    _refuse_other_commands(r, origin)
    _refuse_units(r, origin)
    if r.law.follows and r.unit == "rad":
        _refuse_turns(r, origin)


def doubted_units(r: Motion) -> Iterator[str]:
    """What is said of joints that turn more often than arms do, as far as their file lets them."""
    far = np.abs(r.q).max(axis=0)
    many = np.flatnonzero((far > constants.TURNS) & ~np.array(r.slides))
    if len(many):
        j = int(many[0])
        yield (
            f"q{j + 1} is read up to {far[j]:.4g} rad, {far[j] / (2 * np.pi):.3g} turns, as the "
            "robot's limits allow: divide places, commands and limits by 57.3 if in degrees"
        )


def _letter(r: Motion) -> str:
    return r.joints[0][0] if r.noun == "axis" else "q"


def _refuse_frozen(r: Motion, origin: Origin) -> None:
    """A column without any noise while its command moves was never measured, or has no drive."""
    still, asked = np.ptp(r.q, axis=0) == 0.0, np.ptp(r.command, axis=0) > 0.0
    if still.all() and not asked.any():
        found, mend = "the same commands and positions in every row", "record one"
        raise fault(origin.at("u1"), found, "a motion", mend)
    for j in np.flatnonzero(asked & (still | _undriven(r))):
        number, stands = j + 1, np.median(r.q[:, j])
        within = f" within {np.ptp(r.q[:, j]):.2g} {r.unit}" if not still[j] else ""
        found = f"{stands:.4g}{within} in every row while u{number} moves"
        mend = f"look at drive and encoder, or write into u{number} where the joint is held"
        raise fault(
            origin.at(f"{_letter(r)}{number}"), found, "measured positions that follow", mend
        )


def _undriven(r: Motion) -> Flags:
    """Joints (n,) told to go farther than any dead band lets them, whose readings are noise alone.

    Of noise rows differ from the next by more than from their mean; a way's differ by far less.
    """
    if not r.law.follows:
        return np.zeros(r.n, bool)
    noise = np.mean(np.diff(r.q, axis=0) ** 2, axis=0) > np.var(r.q, axis=0)
    told = np.abs(r.command - np.median(r.q, axis=0)).max(axis=0) > 2 * ActuationDeadband.band.upper
    return np.asarray(
        noise & told & (np.ptp(r.command, axis=0) > constants.MIXED_UP * np.ptp(r.q, axis=0))
    )


def _refuse_sizes(r: Motion, origin: Origin) -> None:
    """Refuse places beyond what a joint or a tip reaches, and commands that no drive can follow."""
    columns = product(((_letter(r), r.q, True), ("u", r.command, r.law.follows)), range(r.n))
    for (letter, values, places), j in columns:
        most, unit = _most(r, j, places)
        far = float(np.abs(values[:, j]).max())
        if far > most:
            what = "positions" if places else "commands"
            where, found = origin.at(f"{letter}{j + 1}"), f"{what} up to {far:.4g}"
            mend = (
                "divide by 57.3 if in degrees; of an encoder's counts, by counts a radian"
                if unit == "rad"
                else "mend the unit"
            )
            raise fault(where, found, f"at most {most:.4g} {unit}", mend)


def _refuse_other_commands(r: Motion, origin: Origin) -> None:
    """Refuse positions that are told as velocities, or the other way round, however late."""
    follows = r.law.follows
    told, other, read, added = (
        _levelled(r, x) for x in (_places(r, follows), _places(r, not follows), r.q, _added(r, r.q))
    )
    moved = np.flatnonzero((np.ptp(told, axis=0) > 0) & (np.ptp(read, axis=0) > 0))
    latest = round(LATEST / float(np.median(np.diff(r.time))))
    own, better, rates = (
        np.median([1.0 - latest_cosine(x[:, j], y[:, j], latest) for j in moved] or [0.0])
        for x, y in ((told, read), (other, read), (told, added))
    )
    if follows and min(own, better) > constants.MIXED_UP * max(rates, constants.ROUNDING):
        found = f"{_letter(r)} that moves as its velocity does"
        mend = f"write places into {_letter(r)}1, {_letter(r)}2, ..."
        raise fault(origin.at(f"{_letter(r)}1"), found, "places of joints", mend)
    if own > constants.MIXED_UP * max(better, constants.ROUNDING):
        word = "velocity" if r.law.follows else "position"
        found = (
            f"commands that move {_letter(r)} as {word} does (cosine {min(1.0 - better, 1.0):.2f})"
        )
        mend = f'write command = "{word}"' if r.unit == "rad" else "record rates, in m/s"
        mend += "" if follows else f", or places into {_letter(r)} if it holds velocities"
        raise fault(origin.key("[motion] command"), found, f"commands of {r.law}", mend)


def _refuse_units(r: Motion, origin: Origin) -> None:
    """Refuse a joint that moves as its command does, but in another unit, or by another clock."""
    told, read = _levelled(r, _places(r, r.law.follows)), _levelled(r, r.q)
    turning, sliding = [(float(np.degrees(1.0)), "57.3 if in degrees")], [(1e3, "1000 if in mm")]
    if not r.law.follows:
        turning.append((1e3, "1000: time in ms?"))
    asked = [(j, one) for j in range(r.n) for one in (sliding if r.slides[j] else turning)]
    for j, (factor, mend) in asked:
        u, q = np.linalg.norm(told[:, j]), np.linalg.norm(read[:, j])
        if not told[:, j] @ read[:, j] > ALIKE * u * q > 0.0:
            continue
        times = float(q / u)
        if abs(abs(np.log(times)) - np.log(factor)) < np.log(SAME_UNIT):
            names = f"{_letter(r)}{j + 1}", f"u{j + 1}"
            column, other = names if times > 1 else names[::-1]
            found = f"{max(times, 1 / times):.3g} times the motion of {other}"
            raise fault(origin.at(column), found, f"{r.units[j]} in both", f"divide by {mend}")


def _refuse_mixed_up(r: Motion, origin: Origin) -> None:
    """Refuse joints that run against their commands, or with another's, where commands lead."""
    told, latest = _places(r, r.law.follows), round(LATEST / float(np.median(np.diff(r.time))))
    told, read = told - told.mean(axis=0), r.q - r.q.mean(axis=0)
    refuse_mixed_up(told, read, ("u", _letter(r)), origin, latest)


def _refuse_turns(r: Motion, origin: Origin) -> None:
    """Refuse readings that leap by a turn, and zeros that are farther off than an offset may be."""
    leap = np.abs(np.diff(r.q - r.command, axis=0)) > np.pi
    leap &= np.abs(np.diff(r.q, axis=0)) > np.pi
    if leap.any():
        row, j = np.argwhere(leap)[0]
        found = f"{r.q[row + 1, j]:.4g} after {r.q[row, j]:.4g} rad, which u{j + 1} does not do"
        mend = "count it on from turn to turn (numpy.unwrap)"
        raise fault(origin.at(f"q{j + 1}", row + 1), found, "a joint's way", mend)
    for j, off in enumerate(np.median(r.q - r.command, axis=0).tolist()):
        both = np.column_stack([r.command[:, j], r.q[:, j]])
        alike = np.ptp(both, axis=0).all() and np.corrcoef(both.T)[0, 1] > ALIKE
        if alike and abs(off) > ActuationOffset.offset.upper:
            found = f"{off:+.4g} rad off u{j + 1}, in the median"
            expected = f"zeros at most {ActuationOffset.offset.upper:g} rad apart"
            raise fault(origin.at(f"q{j + 1}"), found, expected, "take it off this column")


def _places(r: Motion, positions: bool) -> Array:
    """Commands (N, n) as places: as they are, or as rates that add up."""
    return r.command if positions else _added(r, r.command)


def _added(r: Motion, rates: Array) -> Array:
    """Rates (N, n) as places: what they add up to."""
    step = np.append(0.0, np.diff(r.time).clip(min=0.0))[:, None]  # a group starts anew
    return np.asarray(np.cumsum(step * rates, axis=0))


def _levelled(r: Motion, places: Array) -> Array:
    """Places (N, n) of each run without their mean and slope."""
    group = np.zeros(len(r)) if r.group is None else r.group
    bounds = np.flatnonzero(np.diff(group) != 0) + 1
    return np.asarray(scipy.signal.detrend(places, axis=0, bp=bounds))


def _most(r: Motion, j: int, places: bool) -> tuple[float, str]:
    """The largest size of a joint's or axis' place or command, and its unit."""
    if not places:
        held = r.law in (Law.VELOCITY, Law.RATE)
        return (
            (constants.LARGEST_SPEED, f"{r.units[j]}/s")
            if held
            else (constants.LARGEST_EFFORT, in_unit("N m", r.units[j]))
        )
    if r.slides[j]:
        return constants.LARGEST_ARM, "m"
    model = r.robot.model  # no limit is known where coordinates and joints are not numbered alike
    limit = float(model.upperPositionLimit[r.index[j]]) if model.nq == model.nv else 0.0
    return max(constants.TURNS, limit if limit < STATED else 0.0), "rad"
