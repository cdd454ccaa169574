r"""The command that brings the real tool where it should be.

.. math:: q_c = \arg\min_q\ |p(q) - p_w|^2 + \ell^2 |\log R(q)^T R_w|^2 + \lambda^2 |q - q_w|^2
          \quad\text{s.t.}\quad l \le q \le u

where few steps near to it do not do (:mod:`.near`; a limit, a singular posture) by
Gauss-Newton steps with the nominal arm's slope, over all postures at once, a
joint that runs into its limit held there; then a few steps on the place alone, so that where place
and orientation cannot both be had the place is kept (Nakamura and Hanafusa 1986, J. Dyn. Sys. Meas.
Control 108(3), sec. 3: damped least squares).
"""

from dataclasses import dataclass, fields

import numpy as np
import scipy
from numpy.typing import ArrayLike

from plumbline.errors import fault
from plumbline.optim.core.problem import Array, Flags, Indices
from plumbline.optim.core.quantities import quantity
from plumbline.optim.model import constants
from plumbline.optim.model.arm import Arm
from plumbline.optim.model.near import Context, near, pathed
from plumbline.optim.model.rows import of_rows, postures


@dataclass(frozen=True, eq=False)
class Command:
    """What to command."""

    q: Array  # the commands (N, n) [rad or m]
    missed: Array  # how far the tip then stays from where it should be (N,) [m]
    turned: Array  # how far the tool then stays from its orientation (N,) [rad]
    limited: Flags  # which joints rest on a limit (N, n)

    @property
    def reached(self) -> Flags:
        """Whether the tip arrives (N,), within a micrometre."""
        return self.missed <= constants.REACHED

    def __repr__(self) -> str:
        worst = quantity(float(self.missed.max(initial=0.0)), "m")
        return (
            f"<Command of {len(self.q)} postures: {int(self.reached.sum())} arrive, worst {worst}>"
        )


def nearest(
    arm: Arm, goal: Array, starts: list[Array], context: Context, *, posed: bool
) -> Command:
    """The first start that arrives; the best of all where none does."""
    best: Command | None = None
    open_rows = np.arange(len(goal))
    for start in starts:
        some = of_rows(context, open_rows, len(goal))
        there = _approach(arm, start[open_rows], goal[open_rows], posed=posed)
        found = solved(arm, there, goal[open_rows], some, placed=posed)
        best = found if best is None else _better(best, found, open_rows)
        short = ~best.reached | ((best.turned > constants.REACHED / constants.NEAR_LEVER) & posed)
        open_rows = np.flatnonzero(short)
        if not len(open_rows):
            break
    assert best is not None
    return _placed(arm, goal, starts, context, best) if posed else best


def _placed(arm: Arm, goal: Array, starts: list[Array], context: Context, best: Command) -> Command:
    """The same with the place kept where place and orientation cannot both be had."""
    for start in (best.q, *starts):
        rows = np.flatnonzero(~best.reached)
        if not len(rows):
            break
        some = of_rows(context, rows, len(goal))
        there = _approach(arm, start[rows], goal[rows], posed=False)
        there = _approach(arm, there, goal[rows], posed=True, dear=constants.PLACE_FIRST)
        best = _better(best, solved(arm, there, goal[rows], some, placed=True, far=True), rows)
    return best


def _better(best: Command, found: Command, rows: Indices) -> Command:
    """The best so far with those rows exchanged that came nearer."""
    badness, found_bad = (c.missed + constants.NEAR_LEVER * c.turned for c in (best, found))
    nearer = found_bad < badness[rows]
    nearer = np.where(found.reached == best.reached[rows], nearer, found.reached)
    merged = {f.name: getattr(best, f.name).copy() for f in fields(best)}
    for name, values in merged.items():
        values[rows[nearer]] = getattr(found, name)[nearer]
    return Command(**merged)


def starts(arm: Arm, goal: Array, *, posed: bool) -> list[Array]:
    """Postures of the recording, those whose tools are nearest to each goal first."""
    known = arm.samples["q"]
    T = arm.nominal.placement(known)
    away = np.linalg.norm(T[None, :, :3, 3] - goal[:, None, :3, 3], axis=2)
    if posed:
        together = np.einsum("kij,nij->nk", T[:, :3, :3], goal[:, :3, :3])
        away = away + constants.NEAR_LEVER * np.arccos(np.clip((together - 1.0) / 2.0, -1.0, 1.0))
    order = np.argsort(away, axis=1)[:, : constants.STARTS]
    return [_within(arm, known[order[:, k]]) for k in range(order.shape[1])]


def told(arm: Arm, near: ArrayLike, count: int) -> Array:
    """Postures (count, n) to stay near to, of one or of as many, or refused."""
    given = postures(arm.chain, near)
    if len(given) not in (1, count):
        raise fault("near", f"{len(given)} postures", f"one, or {count}", "give one for each pose")
    refuse_outside(arm, given, "near")
    return _within(arm, np.broadcast_to(given, (count, arm.chain.n)))


def goals(pose: ArrayLike) -> tuple[Array, bool]:
    """Poses (N, 4, 4) [m], and whether their orientations count: points have none."""
    try:
        given = np.asarray(pose, dtype=float)
    except (TypeError, ValueError):
        given = np.empty(0)
    posed = given.shape[-2:] == (4, 4)
    shaped = given.ndim in ((2, 3) if posed else (1, 2)) and (posed or given.shape[-1:] == (3,))
    if not shaped or not np.isfinite(given).all():
        mend = "give poses (N, 4, 4), or points (N, 3) in m"
        raise fault("pose", f"shape {given.shape}", "finite poses or points", mend)
    if not posed:
        points = given.reshape(-1, 3)
        T = np.tile(np.eye(4), (len(points), 1, 1))
        T[:, :3, 3] = points
        return T, False
    T = given.reshape(-1, 4, 4)
    R = T[:, :3, :3]
    off = float(np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0))
    if (np.linalg.det(R) < 0.0).any():
        mend = "turn one of its axes round"
        raise fault("pose", "axes that are mirrored", "right-handed ones", mend)
    if off > constants.ORTHONORMAL:
        mend = "give a rotation in its first three columns"
        raise fault(
            "pose", f"a rotation off by {off:.1e}", f"at most {constants.ORTHONORMAL:.0e}", mend
        )
    return T, True


def refuse_outside(arm: Arm, q: Array, name: str) -> None:
    """Refuse postures (N, n) outside of the joints' limits, by the name they were given under."""
    over = np.maximum(arm.chain.lower - q, q - arm.chain.upper)
    for row, joint in np.argwhere(over > constants.SLACK)[:1]:
        low, high = arm.chain.lower[joint], arm.chain.upper[joint]
        raise fault(
            f"{name}, row {row + 1}, joint {joint + 1}",
            f"{q[row, joint]:.6g}",
            f"{low:.6g} to {high:.6g}",
            "choose a posture within the joint's limits",
        )


def _approach(arm: Arm, q: Array, goal: Array, *, posed: bool, dear: float = 1.0) -> Array:
    """Walk from other postures (N, n) towards the goals on the nominal arm, places so dear."""
    weight = np.array([dear, dear, dear, 1.0, 1.0, 1.0])
    lever = constants.NEAR_LEVER if posed else 0.0
    steps, damping = constants.FAR_STEPS, 30 * constants.NEAR_DAMPING
    return _walk(arm.nominal, q, goal, {}, None, lever, weight=weight, steps=steps, damping=damping)


def solved(
    arm: Arm, wanted: Array, goal: Array, context: Context, *, placed: bool, far: bool = False
) -> Command:
    """Commands about postures; where the orientation is ``far`` out of reach the place counts."""
    remembers = _remembers(arm)
    if far:
        q, miss, rest = wanted.copy(), np.empty((len(wanted), 6)), np.arange(len(wanted))
    else:
        q, miss, rest = (pathed if remembers else near)(arm, wanted, goal, context, placed=placed)
    if len(rest):
        rest = np.arange(len(q)) if remembers else rest
        at, to, told = wanted[rest], goal[rest], of_rows(context, rest, len(q))
        if placed and not far:
            at = _walk(arm, at, to, told, at, constants.NEAR_LEVER, steps=constants.FIRST_STEPS)
        at = _walk(arm, at, to, told, None, 0.0)
        left, _ = _misfit(arm, at, to, told, 1.0)
        if far or not remembers or _worst(left) < _worst(miss):  # of a path: all of it or nothing
            q[rest], miss[rest] = at, left
    turned = np.linalg.norm(miss[:, 3:], axis=1) if placed else np.zeros(len(q))
    resting = (q <= arm.chain.lower + constants.SLACK) | (q >= arm.chain.upper - constants.SLACK)
    return Command(q, np.linalg.norm(miss[:, :3], axis=1), turned, resting)


def _worst(miss: Array) -> float:
    return float(np.linalg.norm(miss[:, :3], axis=1).max())


def _remembers(arm: Arm) -> bool:
    return any(effect.remembers for effect in arm.effects)


def _walk(
    arm: Arm,
    start: Array,
    goal: Array,
    context: Context,
    wanted: Array | None,
    lever: float,
    *,
    weight: Array | float = 1.0,
    steps: int = constants.STEPS,
    damping: float = 0.0,
) -> Array:
    """Step joints (N, n) towards their goals, near to where they are wanted, until all are there.

    A step that leads away is taken back and tried shorter (Levenberg and Marquardt). Rows that are
    there are left alone, but of what remembers the way: the posture before a row is a part of it.
    """
    remembers = _remembers(arm)
    rows, q, at = np.arange(len(start)), start.copy(), start.copy()
    least, more = np.full(len(q), np.inf), np.full(len(q), damping)
    miss, J = np.zeros((len(q), 6)), np.zeros((len(q), 6, q.shape[1]))
    for _ in range(steps):
        found, slope = _misfit(arm, q[rows], goal[rows], of_rows(context, rows, len(q)), lever)
        found = found * weight
        back = np.zeros_like(q) if wanted is None else wanted - q
        cost = (found**2).sum(axis=1) + constants.NEAR_DAMPING**2 * (back[rows] ** 2).sum(axis=1)
        well = (cost <= least[rows]) | remembers
        new = rows[well]
        at[new], least[new], miss[new] = q[new], cost[well], found[well]
        J[new] = slope[well] * np.reshape(weight, (-1, 1))
        dearer = constants.EASED * np.maximum(more[rows], constants.NEAR_DAMPING)
        more[rows] = np.where(well, more[rows] / constants.EASED, dearer)
        back = np.zeros_like(at) if wanted is None else wanted - at
        step = _step(arm, at[rows], miss[rows], J[rows], back[rows], more[rows])
        size = np.abs(step).max(axis=1, keepdims=True, initial=0.0)
        step /= np.maximum(1.0, size / constants.LONGEST)
        q[rows] = _within(arm, at[rows] + step)
        moved = np.abs(q - at)[rows].max(axis=1, initial=0.0) > constants.SETTLED
        if not moved.any():
            break
        rows = rows if remembers else rows[moved]
    return at


def _misfit(arm: Arm, q: Array, goal: Array, context: Context, lever: float) -> tuple[Array, Array]:
    """What is missing to the goals (N, 6) [m], and its Jacobian (N, 6, n), the nominal arm's."""
    T, J = arm.placement(q, **context), arm.nominal.jacobian(q)
    turn = scipy.spatial.transform.Rotation.from_matrix(
        goal[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1)
    ).as_rotvec()
    miss = np.hstack([goal[:, :3, 3] - T[:, :3, 3], lever * turn])
    return miss, J * np.array([1.0, 1.0, 1.0, lever, lever, lever])[:, None]


def _step(arm: Arm, q: Array, miss: Array, J: Array, back: Array, more: Array) -> Array:
    """The damped step (N, n), redone without joints that it would take over a limit.

    J (N, 6, n) is that of what is missing (N, 6); the way back (N, n) is weighed by the damping,
    than which a joint's motion is so much dearer (N,) [m/rad].
    """
    step = _least(J, miss, back, more)
    over = (q + step < arm.chain.lower) | (q + step > arm.chain.upper)
    if not over.any():
        return step
    held = np.where(over, _within(arm, q + step) - q, 0.0)
    rest = miss - np.einsum("nij,nj->ni", J, held)
    return held + _least(J * ~over[:, None, :], rest, back * ~over, more)


def _least(J: Array, miss: Array, back: Array, more: Array) -> Array:
    right = np.einsum("nij,ni->nj", J, miss) + constants.NEAR_DAMPING**2 * back
    dear = constants.NEAR_DAMPING**2 + more**2
    matrix = J.transpose(0, 2, 1) @ J + dear[:, None, None] * np.eye(J.shape[2])
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _within(arm: Arm, q: Array) -> Array:
    return np.clip(q, arm.chain.lower, arm.chain.upper)
