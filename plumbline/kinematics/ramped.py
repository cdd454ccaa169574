"""The way to a command that speeds up and brakes by at most so much, over a sample."""

import casadi as cs

from plumbline.kinematics.constants import PLANNED


def ramped(
    path: cs.SX, pace: cs.SX, told: tuple[cs.SX, cs.SX], most: cs.SX, dt: cs.SX
) -> tuple[cs.SX, cs.SX]:
    """Place [rad] and speed [rad/s] after a sample of a way that could stop at its command.

    In parts of the sample, and in half of what speeding up goes in one of them from rest: in that
    unit the error alone tells the speed from which it could stop there.

    Args:
        path: The place before [rad].
        pace: The speed before [rad/s].
        told: The commands at the sample's ends, between which it runs straight [rad].
        most: The largest acceleration [rad/s^2].
        dt: The sample [s].
    """
    h = dt / PLANNED
    unit = most * h**2 / 2
    (goal, end), path, half = (x / unit for x in told), path / unit, pace * h / 2 / unit
    rise = (end - goal) / PLANNED
    for _ in range(PLANNED):
        goal, on = goal + rise, path + half
        error = goal - on
        wanted = error / (cs.sqrt(cs.fabs(error) + 1 / 4) + 1 / 2)
        half = half + cs.fmin(cs.fmax(wanted - half, -1), 1)
        path = on + half
    return path * unit, half * 2 * unit / h
