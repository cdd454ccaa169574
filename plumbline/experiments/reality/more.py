"""More readings of a case: the session goes on, with postures that somebody asked for.

What was wrong stays wrong, the clock runs on, and the arm that rests cools towards the air:

    T <- ambient + (T - ambient) exp(-wait / settle),    then, at work,
    T <- T_end + (T - T_end) exp(-step / settle)

with T_end the arm's temperature when the session broke off. The readings taken before stay as they
were, digit by digit.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.recorder import Case, Recording, simulate
from plumbline.experiments.reality.scene import Scene, Session

ANEW = 1_000_003  # between the seeds of readings, so that no other case has them
SETTLE = 0.3  # time constant of warming and cooling, as a share of the session


def extended(
    case: Case,
    q: Array,
    *,
    direction: Array | None = None,
    velocity: Array | None = None,
    wait: Array | None = None,
    group: NDArray[np.int64] | None = None,
    sockets: NDArray[np.int64] | None = None,
) -> Case:
    """The case with more rows at its end.

    Args:
        case: The case.
        q: Encoder readings (M, n) [rad or m]; of fixed points, postures near the sockets.
        direction: Sides of the approach (M, n), -1, 0 or 1; 0 unless given.
        velocity: Joint velocities (M, n) [rad/s or m/s]; none unless given.
        wait: Rest before each row (M,) [s]; none unless given.
        group: Number of the part of the session (M,); a new one unless given.
        sockets: Socket of each row from 0 (M,), for fixed points.

    Raises:
        PlumblineError: Fixed points come without sockets.
    """
    if case.sockets is not None and sockets is None:
        raise PlumblineError("fixed points without sockets: give one number for each row")
    old, still = case.scene.session, np.zeros_like(q)
    rest = np.zeros(len(q)) if wait is None else wait
    time, warmth = _clock(old, rest)
    session = Session(
        q=np.concatenate([old.q, q]),
        time=np.concatenate([old.time, time]),
        warmth=np.concatenate([old.warmth, warmth]),
        ambient=np.concatenate([old.ambient, np.full(len(q), old.ambient[-1])]),
        direction=np.concatenate([old.direction, still if direction is None else direction]),
        velocity=np.concatenate([old.velocity, still if velocity is None else velocity]),
        group=np.concatenate([old.group, _group(old, len(q)) if group is None else group]),
        force=None if old.force is None else np.concatenate([old.force, np.zeros((len(q), 3))]),
        length=float(np.ptp(old.time)) if old.length is None else old.length,
    )
    scene = case.scene
    return replace(
        case,
        scene=Scene.ideal(scene.arm, session, scene.tool[0], scene.device),
        effects=tuple(effect.pinned(scene) for effect in case.effects),
        sockets=None if sockets is None else np.concatenate([_old_sockets(case), sockets]),
    )


def read_on(case: Case, longer: Case, reading: int = 0) -> Recording:
    """The tables of a longer case, its first rows as they were read before."""
    again = longer if reading == 0 else replace(longer, seed=longer.seed + ANEW * reading)
    before, after = simulate(case)[0], simulate(again)[0]
    columns = {
        name: np.concatenate([values, after.columns[name][case.rows :]])
        for name, values in before.columns.items()
    }
    return Recording(before.settings, columns)


def _old_sockets(case: Case) -> NDArray[np.int64]:
    return np.empty(0, dtype=np.int64) if case.sockets is None else case.sockets


def _group(session: Session, rows: int) -> Array:
    return np.full(rows, session.group[-1] + 1.0)


def _clock(session: Session, rest: Array) -> tuple[Array, Array]:
    """Times [s] and the arm's temperatures [degC] (M,) of rows that follow a session."""
    step = float(np.median(np.diff(session.time)))
    settle = max(SETTLE * float(np.ptp(session.time)), 1e-9)
    ambient, end = float(session.ambient[-1]), float(session.warmth[-1])
    now, warmth = end, np.empty(len(rest))
    for k, wait in enumerate(rest):
        now = ambient + (now - ambient) * np.exp(-wait / settle)
        now = end + (now - end) * np.exp(-step / settle)
        warmth[k] = now
    return session.time[-1] + np.cumsum(step + rest), warmth
