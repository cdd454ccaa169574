r"""A controller on a plant that is not its model, recorded by an instrument that is neither.

The controller sees noisy tips and obstacles with their present velocity; the plant carries its
commands out in its own way, a millisecond at a time, and every millisecond is judged: the whole
shafts against each other and against all obstacles, and the tips against the plane of their
trocars. What is recorded of a run is enough to judge it: least clearance, goals, times of every
step, and the whole motion.
"""

from dataclasses import dataclass
from time import thread_time

import numpy as np

from plumbline.experiments.reality.instruments import Mismatch, Plant
from plumbline.experiments.reality.task import Scenario
from plumbline.optim import capsule_mpc as mpc
from plumbline.optim.capsule_mpc.waypoints import Guide
from plumbline.optim.core.problem import Array

SUBSTEPS = 20  # of a control step of 20 ms: what happens between two samples is seen as well
CLOSE = 1.0  # [mm] from a goal that counts as reached
M = 1e-3  # [m/mm]: scenarios count in mm, controllers in SI units


@dataclass(frozen=True)
class Run:
    """What came of a scenario."""

    family: str  # its family
    seed: int  # its seed
    clearance: float  # least clearance by coal [mm], of all pairs at every millisecond
    reached: bool  # whether every tip came within 1 mm of its goal
    steps: int  # how many steps were made
    seconds: Array  # processor time of every step (K,) [s]
    events: dict[str, int]  # how often each kind of event was reported
    tips: Array  # True tips (K S + 1, I, 3) [mm]


def point(values: Array) -> tuple[float, float, float]:
    """Three plain numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def obstacles_at(scenario: Scenario, time: float) -> list[mpc.Obstacle]:
    """What a perfect sensor would say of the obstacles [m]."""
    found = []
    for swing in scenario.obstacles:
        ends, velocity = swing.at(time)
        seen = mpc.Obstacle(point(ends[0]), point(ends[1]), swing.radius, point(velocity))
        found.append(seen.scaled(M))
    return found


def known_delay(mismatch: Mismatch) -> int:
    """Whole steps of a plant's delay, which its controller foresees."""
    return int(mismatch.delay / 0.02 + 1e-9)


def noise_for(mismatch: Mismatch, v_max: float, epsilon: float = 1e-3) -> mpc.Noise:
    """What to state of a plant: its noise, and how far a rate's lag and delay may carry it on [m].

    Whole steps of delay are left to the controller's own prediction.
    """
    rest = mismatch.delay - 0.02 * known_delay(mismatch)
    bias = v_max * (mismatch.lag + rest) + 0.5 * mismatch.deadband * 0.02
    return mpc.Noise(M * mismatch.measured, M * mismatch.shake, epsilon, bias=M * bias)


def statement_of(scenario: Scenario, settings: mpc.Settings, v_max: float = 60.0) -> mpc.Statement:
    """The control problem of a scenario; tips are no faster than ``v_max`` [mm/s]."""
    kit = scenario.instruments
    bodies = tuple(
        mpc.TipInstrument(point(M * trocar), float(M * length), float(M * radius), M * v_max)
        for trocar, length, radius in zip(kit.trocars, kit.lengths, kit.radii, strict=True)
    )
    balls = sum(o.speed == 0.0 and np.array_equal(*o.ends) for o in scenario.obstacles)
    return mpc.Statement(bodies, len(scenario.obstacles) - balls, settings, balls)


def run(
    scenario: Scenario,
    controller: mpc.Controller,
    guide: Guide | None = None,
    most: int = 600,
) -> Run:
    """Run a scenario until all tips are at their goals, or for so many steps.

    Tips go where ``guide`` says first, without it straight to the goals.
    """
    dt = controller.statement.settings.dt
    rng = np.random.default_rng([scenario.seed, 77])
    plant = Plant(scenario.starts, scenario.mismatch, dt, SUBSTEPS, rng)
    wanted = M * scenario.goals
    way, seconds = [scenario.starts[None]], []
    events: dict[str, int] = {}
    reached = False
    for k in range(most):
        seen, obstacles = M * plant.measure(), obstacles_at(scenario, k * dt)
        reference = wanted if guide is None else guide.reference(seen, wanted, obstacles)
        begun = thread_time()
        command = controller.step(seen.ravel(), np.ravel(reference), obstacles)
        seconds.append(thread_time() - begun)
        way.append(plant.move((command.rate / M).reshape(-1, 3)))
        for event in command.events:
            events[event.trouble.value] = events.get(event.trouble.value, 0) + 1
        if np.linalg.norm(plant.tips - scenario.goals, axis=1).max() < CLOSE:
            reached = True
            break
    tips = np.concatenate(way)
    return Run(
        scenario.family,
        scenario.seed,
        judged(scenario, tips, dt),
        reached,
        len(seconds),
        np.array(seconds),
        events,
        tips,
    )


def judged(scenario: Scenario, tips: Array, dt: float) -> float:
    """Least clearance [mm] of a motion (K S + 1, I, 3).

    Obstacles move as they will, so the first moment counts too.
    """
    times: Array = dt / SUBSTEPS * np.arange(len(tips), dtype=float)
    return scenario.touch().least(scenario.motion(tips, times)).clearance
