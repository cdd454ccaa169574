"""Loops whose states, goals and obstacles are in mm, as scenes of tests are told."""

from dataclasses import replace

import numpy as np

from plumbline.optim import capsule_mpc
from plumbline.optim.capsule_mpc import waypoints as guide

MM = 1e3


class Controller(capsule_mpc.Controller):
    """A controller that is asked, and answers, in mm."""

    def step(self, measured, goal, obstacles=()):
        unit, x = self.statement.unit, np.asarray(measured, dtype=float)
        x = x * unit if x.shape == unit.shape else x
        seen = [obstacle.scaled(1 / MM) for obstacle in obstacles]
        command = super().step(x, np.asarray(goal, dtype=float) / MM, seen)
        return replace(
            command,
            rate=command.rate / unit,
            gap=MM * command.gap,
            slack=MM * command.slack,
            path=command.path if command.path is None else command.path / unit,
        )


class Guide(guide.Guide):
    """A guide that is asked, and answers, in mm."""

    def reference(self, tips, goals, obstacles):
        seen = [obstacle.scaled(1 / MM) for obstacle in obstacles]
        return MM * super().reference(tips / MM, goals / MM, seen)
