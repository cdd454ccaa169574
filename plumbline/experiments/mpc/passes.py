r"""Two shafts that pass in parallel: where one scalar a pair is not enough.

Free capsules of one length meet side by side, up to a yaw of nothing or almost nothing, at random
heights, and must pass each other. Their nearest points jump from end to end as the yaw changes
sign; so does the gradient of the patent's scalar, and a plan made with it runs into the other shaft
before it finds out. The statement with planes has a row at each end of the overlap. The plan's
first step is carried out as it is, without the safety net, so that formulations are compared and
nothing else.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.experiments.reality.touch import Touch
from plumbline.optim.capsule_mpc import EndsInstrument, Planner, Settings, Statement
from plumbline.optim.capsule_mpc.constants import MM
from plumbline.optim.capsule_mpc.planning import shifted
from plumbline.optim.core.problem import Array

LENGTH, RADIUS, SAFE = 250.0, 2.5, 2.0  # [mm]
YAWS = (0.0, 1e-6, 1e-3, 1e-2)  # [rad]
STEPS, SUBSTEPS = 120, 4  # of a pass at most, and places between two steps at which is looked


@dataclass(frozen=True)
class Passes:
    """What came of some passes."""

    at_steps: float  # least clearance at the steps, where it is demanded [mm]
    between: float  # least clearance at all substeps [mm]
    short: float  # share of the steps whose plan was not solved or fell short of a distance
    arrived: float  # share of the passes that ended within 1 mm of the goal


def passes(form: str, planner: Planner, count: int, seed: int) -> Passes:
    """Run some passes, drawn from a seed, with a form of the distance."""
    settings = Settings(p=10, safe=SAFE / MM, form=form, effort=0.0, smooth=0.0)
    statement = Statement((EndsInstrument(LENGTH / MM, RADIUS / MM),) * 2, 0, settings)
    rng = np.random.default_rng(seed)
    found = np.array([_one(statement, planner, *_draw(rng)) for _ in range(count)])
    return Passes(
        float(found[:, 0].min()),
        float(found[:, 1].min()),
        float(found[:, 2].mean()),
        float((found[:, 3] < 1.0).mean()),
    )


def _draw(rng: np.random.Generator) -> tuple[Array, Array]:
    """Start and goal (12,) [mm]: the first shaft goes to +y, the second to -y."""
    yaw = float(rng.choice(YAWS))
    along = LENGTH * np.array([[0.0, 0.0, 1.0], [np.sin(yaw), 0.0, np.cos(yaw)]])
    tips = np.array([[0.0, -20.0, 0.0], [rng.uniform(0.3, 4.0), 20.0, rng.uniform(-3.0, 3.0)]])
    moved = tips + np.array([[0.0, 40.0, 0.0], [0.0, -40.0, 0.0]])
    start, goal = (np.hstack([t, t + along]).ravel() for t in (tips, moved))
    return start, goal


def _one(statement: Statement, planner: Planner, start: Array, goal: Array) -> list[float]:
    ready = planner.ready(statement)
    touch = Touch(np.array([[0, 1]]), np.full(2, RADIUS))
    stages = statement.stages(goal, [])
    x, path = start, np.tile(start, (statement.settings.p, 1))
    at_steps = between = np.inf
    short = 0
    for _ in range(STEPS):
        plan = ready.plan(x, stages, path)
        short += not plan.solved or plan.slack > 1e-3
        ahead, path = plan.x[0], shifted(plan.x)
        for k in range(1, SUBSTEPS + 1):
            gap = float(touch.clearances(_rigid(x + (ahead - x) * k / SUBSTEPS))[0])
            between = min(between, gap)
        at_steps = min(at_steps, gap)
        x = _rigid(ahead).ravel()
    return [at_steps, between, short / STEPS, float(np.abs(x - goal).max())]


def _rigid(x: Array) -> Array:
    """Ends (2, 2, 3) of shafts of the full length: a shaft cannot stretch, whatever the plan."""
    ends = x.reshape(2, 2, 3)
    middle, way = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    half = LENGTH / 2 * way / np.linalg.norm(way, axis=1, keepdims=True)
    return np.stack([middle - half, middle + half], axis=1)
