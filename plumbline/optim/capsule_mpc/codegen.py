r"""A controller's step in C: for a loop without Python, and without an allocation.

What a step of :class:`.planning.RealTime` computes is one function of what it is given,

.. math:: (u, x_0, \bar x) \mapsto (H, g, G, h), \qquad stages = T_0 + T u, \quad
          u = (goals,\ obstacles,\ last\ step)

and the quadratic program that it states. CasADi writes the function; the parameters of the stages
are affine in u, and T is read off :meth:`.statement.Statement.stages`, so that there is no second
version of it. ``banded_qp.c`` solves the program as it does here. A page of C (``in_c``) keeps path
and last step between two calls. All memory is in one structure whose size is known when it is
compiled.

What is believed of obstacles that move otherwise than stated is :class:`.sweeps.Looks` in C. What
else :mod:`.controller` does before and below the plan is not part of it, and the header names it: a
step that is not solved returns an error, and whoever calls it has to stop.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import Obstacle
from plumbline.optim.capsule_mpc.linearised import box_function, stage_function
from plumbline.optim.capsule_mpc.planning import BandedQp, RealTime
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.capsule_mpc.sweeps import point
from plumbline.optim.core.problem import Array

FILES = ("program.c", "banded_qp.c", "capsule_step.h", "capsule_step.c", "main.c")


@dataclass(frozen=True)
class Example:
    """What the small program that comes with the code does."""

    start: ArrayLike  # state (n,) [m, or rad]
    goal: ArrayLike  # what is to be reached (g,) [m]
    obstacles: Sequence[Obstacle] = ()  # as seen at the start; they move on with their velocities
    steps: int = 100  # how many steps it drives


def numbers_of(statement: Statement, obstacles: Sequence[Obstacle]) -> Array:
    """Obstacles (K, 10) [m] as a step in C takes them: a row for every slot, then every ball."""
    out = np.zeros((statement.slots + statement.balls, constants.OBSTACLE))
    out[:, :6] = constants.FAR / constants.MM
    capsules, spheres = statement.seated(obstacles)
    for begin, own in ((0, capsules), (statement.slots, spheres)):
        for k, o in enumerate(own):
            out[begin + k] = (*o.a, *o.b, o.radius, *o.velocity)
    return out


def _seen(statement: Statement, numbers: Array) -> list[Obstacle]:
    """Obstacles from their numbers (K, 10)."""
    return [Obstacle(point(o[:3]), point(o[3:6]), float(o[6]), point(o[7:])) for o in numbers]


def affine(statement: Statement) -> tuple[Array, Array]:
    """T0 (p t,) and T (p t, inputs): the stages' parameters from goals, obstacles, last step."""
    goals, count = statement.goals, statement.slots + statement.balls
    base = np.zeros((count, constants.OBSTACLE))
    base[: statement.slots, 3] = constants.ROD  # apart from the other end in all that is tried
    size = goals + constants.OBSTACLE * count + statement.n

    def stages(u: Array) -> Array:
        own = base + u[goals : goals + constants.OBSTACLE * count].reshape(
            count, constants.OBSTACLE
        )
        seen = _seen(statement, own)
        return statement.stages(u[:goals], seen, u[goals + constants.OBSTACLE * count :]).ravel()

    first = stages(np.zeros(size))
    units = np.eye(size)
    for k in range(statement.slots, count):
        # A sphere is a point: where one end goes the other does, and so counts for both.
        at = goals + constants.OBSTACLE * k
        units[at : at + 3] += units[at + 3 : at + 6]
        units[at + 3 : at + 6] = 0.0
    T = np.stack([stages(unit) - first for unit in units], axis=1)
    zero = np.concatenate([np.zeros(goals), base.ravel(), np.zeros(statement.n)])
    return first - T @ zero, T


def program(statement: Statement) -> cs.Function:
    """``(u, x0, path (n, p)) -> H, g, G, h, steps, turn``: :meth:`.linearised.Linearised.about`."""
    own, p, n = statement, statement.settings.p, statement.n
    constant, T = affine(own)
    u, x0, path = cs.MX.sym("u", T.shape[1]), cs.MX.sym("x0", n), cs.MX.sym("path", n, p)
    slope = cs.sparsify(cs.DM(T))
    stages = cs.reshape(cs.DM(constant) + cs.mtimes(slope, u), own.width, p)
    before = cs.horzcat(x0, path[:, :-1])
    moved = stages[own.moved, 0]
    steps = path - before if p > 1 else moved
    stages = cs.vertcat(stages[: own.stepped.start, :], steps, stages[own.stepped.stop :, :])
    pace, sides, turn = box_function(own.shape)(before, steps, stages)
    norms = [cs.repmat(cs.norm_2(moved[part]), part.stop - part.start) for part in own.blocks]
    grown = cs.repmat(cs.vertcat(*norms), 1, p) + cs.DM(np.broadcast_to(own.ramp, (p, n)).T)
    share = cs.DM(np.broadcast_to(own.alpha, (p, n)).T)
    most = cs.fmin(pace * share, grown) * sides
    one = stage_function(own).map("stages", "serial", p, [1], [])
    outputs = [*one(path, x0, stages), most, turn]
    return cs.Function("program", [u, x0, path], [cs.densify(value) for value in outputs])


def write(
    statement: Statement, folder: Path, example: Example, planner: RealTime | None = None
) -> None:
    """Write the code of a step, and a program that drives the model with it, or refuse a planner.

    ``cc -O3 -o main main.c capsule_step.c program.c banded_qp.c -lm`` builds it; the statement's
    constants are built in. The planner's solver must be :class:`.planning.BandedQp`, with one pass.
    """
    own = planner or RealTime()
    if not isinstance(own.solver, BandedQp) or own.passes != 1:
        raise PlumblineError(
            f"planner: found {own.solver!r}, {own.passes} passes, expected BandedQp() and 1 pass; "
            "code is written for these alone"
        )
    function = program(statement)
    generator = cs.CodeGenerator("program.c", {"casadi_int": "long long int"})
    generator.add(function)
    here = resources.files("plumbline.optim.capsule_mpc")
    numbers = {
        **_sizes(statement, function),
        **_weights(statement, own.solver),
        **_example(statement, example),
    }
    sources = [generator.dump(), (here / "banded_qp.c").read_text(encoding="utf-8")]
    for name in FILES[len(sources) :]:
        template = (here / "in_c" / name).read_text(encoding="utf-8")
        sources.append(Template(template).substitute(numbers))
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in zip(FILES, sources, strict=True):
        (folder / name).write_text(text, encoding="utf-8")


def _sizes(statement: Statement, function: cs.Function) -> dict[str, object]:
    p, n = statement.settings.p, statement.n
    rows = int(function.numel_out(3)) // p
    N, count = p * n, p * rows
    M, K = 2 * N + count, 2 * N + 2 * count
    return {
        "n": n,
        "p": p,
        "rows": rows,
        "goals": statement.goals,
        "slots": statement.slots,
        "balls": statement.balls,
        "obstacles": statement.slots + statement.balls,
        "numbers": constants.OBSTACLE,
        "looks": constants.FEWEST_LOOKS,
        "dt": statement.settings.dt,
        "far": constants.FAR / constants.MM,
        "work": (N + 2 * n) * (2 * n + 1) + 2 * N + 2 * n + 5 * M + 6 * K,
        "sz_w": max(function.sz_w(), 1),
        "sz_iw": max(function.sz_iw(), 1),
        "sz_arg": max(function.sz_arg(), 1),
        "sz_res": max(function.sz_res(), 1),
    }


def _weights(statement: Statement, solver: BandedQp) -> dict[str, object]:
    s = statement.settings
    effort, smooth = s.weights
    owner = [group for group in statement.blocks for _ in range(group.start, group.stop)]
    begins, closes = [group.start for group in owner], [group.stop for group in owner]
    return {
        "group": ", ".join(str(number) for number in [*begins, *closes]),
        "turn": "s->turn" if max(statement.groups) > 1 else "0",
        "touching": constants.TOUCHING,
        "mm": constants.MM,
        "fastest": (constants.FASTEST * s.dt) ** 2,
        "straight": constants.STRAIGHT,
        "changed": constants.CHANGED,
        "unit": ", ".join(repr(float(unit)) for unit in statement.unit),
        "penalty": constants.MM * float(s.penalty),
        "effort": float(effort),
        "smooth": float(smooth),
        "tolerance": solver.tolerance,
        "most": solver.max_iterations,
    }


def _example(statement: Statement, example: Example) -> dict[str, object]:
    seen = numbers_of(statement, example.obstacles)

    def listed(values: ArrayLike) -> str:
        return ", ".join(f"{float(v)!r}" for v in np.ravel(values))

    return {
        "start": listed(example.start),
        "goal": listed(example.goal),
        "seen": listed(seen) or "0.0",
        "steps": example.steps,
    }
