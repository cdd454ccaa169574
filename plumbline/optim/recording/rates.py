r"""Velocities and accelerations beside the columns that they rate: is each what it says?

By the clock a rate goes from row to row as its column does, :math:`\tfrac12 (v_k + v_{k+1})
\Delta t_k` as :math:`q_{k+1} - q_k`. In another unit these are in one ratio, of another joint they
run with that one's, turned they run against it. What runs with the column itself, and not with how
it changes, is no rate of it: both hold places, or both velocities.
"""

import numpy as np

from plumbline.errors import fault
from plumbline.optim.recording import constants
from plumbline.optim.recording.mixed_up import latest_cosine, refuse_mixed_up
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.table import Array, Origin


def refuse_other_rates(r: Recording, origin: Origin) -> None:
    """Refuse rates that are in another unit, another joint's, turned, or no rates at all."""
    step = np.diff(r.time if r.time is not None else [])[:, None]
    for name, rate, place in (
        ("velocity", r.velocity, r.q), ("acceleration", r.acceleration, r.velocity),
    ):  # fmt: skip
        if rate is None or place is None or not (step > 0).any():
            continue
        usual = (step > 0) & (step < constants.GAP_IN_TIME * np.median(step[step > 0]))
        moved = np.where(usual, np.diff(place, axis=0), 0.0)
        told = np.where(usual, step * (rate[1:] + rate[:-1]) / 2, 0.0)
        names = name, "q" if place is r.q else "velocity"
        latest = round(constants.LATEST / float(np.median(step[step > 0])))
        columns = zip(told.T, moved.T, (rate - rate.mean(axis=0)).T, place.T, strict=True)
        for joint, (way, move, its, own) in enumerate(columns, start=1):
            called = f"{names[0]}{joint}", f"{names[1]}{joint}"
            _refuse_other_unit((way, move), called, origin)
            run = latest_cosine(move, way, latest), latest_cosine(own - own.mean(), its, 0)
            _refuse_no_rate(run, called, origin)
        refuse_mixed_up(moved, told, (names[1], name), origin, latest)


def _refuse_no_rate(run: tuple[float, float], names: tuple[str, str], origin: Origin) -> None:
    """Refuse a rate that runs (cosine) not with how its column changes but with that itself."""
    far, near = 1.0 - run[0], 1.0 - run[1]
    if near < 1.0 - constants.ONE_COURSE and far >= constants.MIXED_UP * near:
        found = f"{names[0]} that runs with {names[1]} itself, not with how it changes"
        mend = "write what each name says into its column"
        raise fault(origin.at(names[0]), found, "a rate", mend)


def _refuse_other_unit(ways: tuple[Array, Array], names: tuple[str, ...], origin: Origin) -> None:
    """Refuse a rate whose ways (N,) from row to row are those of its column in another unit."""
    sizes = [float(np.linalg.norm(way)) for way in ways]
    if not ways[0] @ ways[1] > constants.ONE_COURSE * sizes[0] * sizes[1] > 0.0:
        return
    factor = sizes[0] / sizes[1]
    if not 1 / constants.NEAR_SCALE < factor < constants.NEAR_SCALE:
        large, other = names if factor > 1 else names[::-1]
        found = f"{max(factor, 1 / factor):.3g} times what {other} has it by the clock"
        mend = "divide by 57.3 if in degrees; in ms, divide time by 1000"
        raise fault(origin.at(large), found, "rates of one unit", mend)
