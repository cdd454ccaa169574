r"""Many random tasks of instruments that keep clear of each other, done one by one.

A task is drawn from its number alone, so any can be made again; ``plumbline sweep`` does thousands
(``reality = "instruments"``). Noise, lag, gain error and dead band of the plant are those that the
controller is told of, drawn anew for every task. A task may be done by every controller: the
horizon, and one step on control barrier functions, the same guide before both.

The plant moves a millisecond at a time, and every millisecond is judged, over the whole shafts.
Where arithmetic finds a pair nearest, in contact, or at a moment chosen beforehand, coal is asked;
see :mod:`plumbline.experiments.reality.touch`.
"""

from functools import lru_cache

from plumbline.experiments.mpc.closed_loop import Run, known_delay, noise_for, run, statement_of
from plumbline.experiments.reality.mpc_scenarios import FAMILIES, draw
from plumbline.experiments.reality.task import Scenario
from plumbline.optim.capsule_mpc import Controller, OneStep, Planner, RealTime, Safety, Settings
from plumbline.optim.capsule_mpc.waypoints import Guide

HORIZON, V_MAX, BUDGET = 10, 60.0, 0.5  # steps; [mm/s]; [s], since a shared machine may pause
CONTROLLERS: dict[str, Planner] = {"horizon": RealTime(), "one step": OneStep()}

drawn = lru_cache(maxsize=4)(draw)  # controllers do the same task one after the other


def task(
    number: int, seed: int, planner: Planner | None = None, guided: bool = True, most: int = 600
) -> Run:
    """Run the task of a number, for so many steps at most; families take turns."""
    family = list(FAMILIES)[number % len(FAMILIES)]
    scenario = drawn(family, 100_000 * seed + number // len(FAMILIES))
    return done(scenario, planner or RealTime(compiled=False), guided, most)


def done(scenario: Scenario, planner: Planner, guided: bool, most: int = 600) -> Run:
    """Do a task with a planner, behind the guide or without it."""
    settings = Settings(p=HORIZON, noise=noise_for(scenario.mismatch, V_MAX))
    statement = statement_of(scenario, settings, V_MAX)
    safety = Safety(budget=BUDGET, delay=known_delay(scenario.mismatch))
    controller = Controller(statement, planner, safety)
    return run(scenario, controller, Guide(statement) if guided else None, most)
