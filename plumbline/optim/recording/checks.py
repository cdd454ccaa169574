"""What a recording must be before anything is fitted to it: enough rows, in order, consistent.

Each check takes a recording and its origin, raises on a fault and yields notes on what is merely
odd, if anything is. Those on units are in :mod:`plumbline.optim.recording.units`.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.optim.core.quantities import counted
from plumbline.optim.recording.constants import BETTER_ROWS, COARSE, SAME_POSTURE
from plumbline.optim.recording.kinds import ALWAYS
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Array, Origin


def has_enough_rows(r: Recording, origin: Origin) -> Iterator[str]:
    """More equations than unknowns, on the rows that are fitted."""
    sockets = 0 if r.socket is None else len(np.unique(r.socket))
    unknowns = r.kind.unknowns(r.always, sockets)
    equations = r.kind.equations or max(1, len(r.measured_joints))
    least = max(2, unknowns // equations + 1)
    fitted = len(r) if r.held_out is None else int((~r.held_out).sum())
    if fitted < least:
        held = "" if fitted == len(r) else f" ({len(r) - fitted} are held out)"
        raise fault(
            origin.file,
            f"{counted(fitted, 'row')} to fit{held}",
            f"at least {least}: {equations} equations a row against {unknowns} unknowns",
            "record more poses" if not held else "hold fewer rows out",
        )
    postures = _distinct(r.q if r.held_out is None else r.q[~r.held_out])
    if postures < least and _distinct(r.q) > 1:  # a single one has words of its own
        found = f"{postures} distinct postures in {fitted} rows to fit"
        mend = "record other postures: a repeated one tells of the noise alone"
        raise fault(origin.file, found, f"at least {least}", mend)
    if fitted < BETTER_ROWS * least:
        yield f"{origin.file}: {fitted} rows are few, {BETTER_ROWS * least} or more are better"
    elif postures < BETTER_ROWS * least:
        said = f"{postures} distinct postures are few, {BETTER_ROWS * least} or more are better"
        yield f"{origin.file}: {said}"


def _distinct(q: Array) -> int:
    """How many different postures there are among joint readings (N, n)."""
    return len(np.unique(np.round(q / SAME_POSTURE), axis=0))


def moves(r: Recording, origin: Origin) -> Iterator[str]:
    """More than one posture; joints that never move are noted."""
    still = np.ptp(r.q, axis=0) < SAME_POSTURE
    if still.all():
        mend = "record other postures: a single one tells nothing of the robot"
        raise fault(origin.at("q1"), "one posture in every row", "several", mend)
    if still.any():
        names = list(dict.fromkeys(origin.column(f"q{j + 1}") for j in np.flatnonzero(still)))
        never = f"{', '.join(names)} never move{'s' if len(names) == 1 else ''}"
        yield f"{origin.file}: {never}: what errs with such a joint's own angle is one constant"


def tips_leave_a_plane(r: Recording, origin: Origin) -> None:
    """Refuse tips of which one coordinate never changes, where no plane holds the model's."""
    if not r.kind.device:
        return
    still = np.flatnonzero(np.ptp(r.measured[:, :3], axis=0) == 0.0)
    tips = r.chain.tips(r.q, r.tool_offset)
    off = np.linalg.svd(tips - tips.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(r))
    if 0 < len(still) < 3 and off > COARSE * r.reach:
        column = "xyz"[still[0]]
        found = f"{shown(float(r.measured[0, still[0]]))} in every row"
        expected = f"a coordinate that changes: the tips leave every plane by {off:.2g} m"
        raise fault(origin.at(column), found, expected, "look at what wrote this column")


def rows_differ(r: Recording, origin: Origin) -> Iterator[str]:
    """Rows that occur twice are noted: copied, or a measurement that stood still."""
    parts = [r.q, r.measured]
    if r.socket is not None:
        parts.append(r.socket[:, None].astype(float))
    rows = np.ascontiguousarray(np.column_stack(parts))
    doubled = len(rows) - len({row.tobytes() for row in rows})
    if doubled and not r.kind.sockets:
        yield f"{origin.file}: {doubled} rows repeat an earlier row to the last digit"


def time_runs_forwards(r: Recording, origin: Origin) -> Iterator[str]:
    """Time never decreases within a group."""
    if r.time is None:
        return
    group = np.zeros(len(r), dtype=np.int64) if r.group is None else r.group
    order = np.argsort(group, kind="stable")
    step, same = np.diff(r.time[order]), np.diff(group[order]) == 0
    back = np.flatnonzero((step < 0) & same)
    if len(back):
        first = back[np.argmin(order[1:][back])]
        now, before = r.time[order[first + 1]], r.time[order[first]]
        raise fault(
            origin.at("time", order[first + 1]),
            f"{float(now):.9g} s after {float(before):.9g} s",
            "time that never decreases within a group",
            "sort the rows by time, or number the sessions in a column 'group'",
        )
    if len(r) > 1 and not np.ptp(r.time) > 0.0:
        yield f"{origin.file}: the clock stands still: nothing that runs with time can be told"
    if np.any(np.diff(r.time) < 0):
        yield f"{origin.file}: time starts anew with a group: slow drift is told within groups"


def direction_is_a_side(r: Recording, origin: Origin) -> Iterator[str]:
    """Directions are -1, 0 or 1."""
    if r.direction is None:
        return
    broken = np.argwhere(~np.isin(r.direction, (-1.0, 0.0, 1.0)))
    if len(broken):
        row, joint = broken[0]
        found = shown(float(r.direction[row, joint]))
        where = origin.at(f"direction{joint + 1}", row)
        raise fault(where, found, "-1, 0 or 1", "write 1 where it grew last, -1 where it fell")
    if not r.direction.any():
        yield f"{origin.file}: every direction is 0: no approach side is known"


def sockets_are_shared(r: Recording, origin: Origin) -> Iterator[str]:
    """Every socket holds the tip at least twice; only ``fixed_point`` has sockets."""
    if r.socket is None:
        if r.kind.sockets:
            mend = "add it: which socket the tip rests in"
            raise fault(origin.at("socket"), "nothing", "a whole number a row", mend)
        return
    labels, first, counts = np.unique(r.socket, return_index=True, return_counts=True)
    single = np.flatnonzero(counts == 1)
    if len(single):
        where = origin.at("socket", first[single[0]])
        found = f"socket {labels[single[0]]} in a single row"
        raise fault(where, found, "two rows or more", "visit it again or delete the row")
    yield from _pairs_exist(r, {int(label) for label in labels}, origin)


def _pairs_exist(r: Recording, labels: set[int], origin: Origin) -> Iterator[str]:
    known = ", ".join(map(str, sorted(labels)[:12]))
    for a, b in r.socket_pairs:
        if a == b or not {a, b} <= labels:
            where, found = origin.key("[sockets] pairs"), f"[{a}, {b}]"
            raise fault(where, found, f"two different sockets of {known}", "mend the pair")
    if r.socket_distance is None and r.socket_pairs:
        yield "[sockets] pairs: no use without a distance"
    if r.socket_distance is not None and len(labels) < 2:
        yield "[sockets] distance: not used, there is one socket only"


def paired(labels: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """Sockets taken two by two in ascending order: what a distance means without pairs."""
    return tuple(pairwise(sorted(labels)))[::2]


def always_is_told_once(r: Recording, origin: Origin) -> Iterator[str]:
    """Words of [fit] always stand there once; :func:`check_always` knows which there are."""
    doubled = [word for word in r.always if r.always.count(word) > 1]
    if doubled:
        yield f"[fit] always: {shown(doubled[0])} is named twice"


def held_out_is_told_apart(r: Recording, origin: Origin) -> Iterator[str]:
    """Held-out rows come from groups of their own."""
    if r.held_out is None:
        return
    if not r.held_out.any():
        yield f"{origin.file}: held_out marks no row, as if it were not there"
    elif r.group is not None:
        both = np.intersect1d(r.group[r.held_out], r.group[~r.held_out])
        if len(both):
            yield f"{origin.file}: group {both[0]} is partly held out: rows of one group are alike"


def check_always(always: tuple[str, ...], effects: tuple[str, ...], where: str) -> None:
    """Refuse words of [fit] always that are neither ``frame`` nor ``tool`` nor an effect."""
    known = (*ALWAYS, *effects)
    unknown = next((word for word in always if word not in known), None)
    if unknown is not None:
        near = best_matches(unknown, known)
        raise fault(where, shown(unknown), "frame, tool or an effect", f"best matches: {near}")


CHECKS = (
    sockets_are_shared, has_enough_rows, moves, tips_leave_a_plane, rows_differ, time_runs_forwards,
    direction_is_a_side, always_is_told_once, held_out_is_told_apart,
)  # fmt: skip
