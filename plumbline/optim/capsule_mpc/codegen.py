r"""A controller's step in C: for a loop without Python, and without an allocation.

What a step of :class:`.planning.RealTime` computes is one function of what it is given,

.. math:: (u, x_0, \bar x) \mapsto (H, g, G, h), \qquad stages = T_0 + T u, \quad
          u = (goals,\ obstacles,\ last\ step)

and the quadratic program that it states. CasADi writes the function; the parameters of the stages
are affine in u, and T is read off :meth:`.statement.Statement.stages`, so that there is no second
version of it. ``banded_qp.c`` solves the program as it does here. A page of C keeps path and last
step between two calls. All memory is in one structure whose size is known when it is compiled.

What :mod:`.controller` does before and below the plan is not part of it, and the header says so: a
step that is not solved returns an error, and whoever calls it has to stop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc.banded_qp import BandedQp
from plumbline.optim.capsule_mpc.constants import FAR, OBSTACLE, TOUCHING
from plumbline.optim.capsule_mpc.linearised import box_function, stage_function
from plumbline.optim.capsule_mpc.planning import RealTime
from plumbline.optim.capsule_mpc.scene import Obstacle
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.core.problem import Array

FILES = ("program.c", "banded_qp.c", "capsule_step.h", "capsule_step.c", "main.c")
HEADER = """\
/* One step of a controller for capsules that must not touch: lengths in mm, times in s.
 *
 * Zero the state before the first step. A step takes the present state x, goals, and obstacles,
 * {slots} capsules and then {balls} spheres: both ends, radius, velocity; one that is not there is
 * a point at {far:g}. It returns 0, and the rate of every state; or another number if there is no
 * plan: then the rate is zero, and the caller has to see to a stop. Nothing is allocated, and
 * nothing is global.
 *
 * The plan alone is here. Not here, and the caller's to see to:
 * - the net that tries a rate and the stop after it, and limits of acceleration and jerk;
 * - obstacles that move otherwise than stated, turn back, or come faster than a tip;
 * - delay, lag, gain and dead band of what carries rates out, told or not;
 * - measurements, goals and obstacles that are no numbers.
 */
#ifndef CAPSULE_STEP_H
#define CAPSULE_STEP_H

#define STATES {n}
#define STAGES {p}
#define ROWS {rows}
#define GOALS {goals}
#define OBSTACLES {obstacles}
#define NUMBERS {numbers}
#define INPUTS (GOALS + NUMBERS * OBSTACLES + STATES)
#define STEP {dt!r} /* [s] */

typedef struct {{
    int begun; /* whether path and move are known */
    double path[STAGES * STATES], move[STATES];
    double inputs[INPUTS], H[STAGES * STATES * STATES], g[STAGES * STATES];
    double G[STAGES * ROWS * STATES], h[STAGES * ROWS], steps[STAGES * STATES];
    double turn[STAGES * STATES * STATES];
    double slack[STAGES * ROWS], multiplier[STAGES * ROWS];
    double work[{work}], w[{sz_w}];
    long long int iw[{sz_iw}];
    const double *arg[{sz_arg}];
    double *res[{sz_res}];
    int kept[STAGES + 1 + STAGES * ROWS];
}} capsule_state;

int capsule_step(capsule_state *s, const double *x, const double *goals, const double *obstacles,
                 double *rate);

#endif
"""
STEP = """\
#include "capsule_step.h"
#include <math.h>

int program(const double **arg, double **res, long long int *iw, double *w, int mem);
int banded_qp_turned(int p, int n, int rows, const double *H, const double *g, const double *x0,
                     const double *move, const double *step, const double *G, const double *h,
                     double rho, double effort, double smooth, double tolerance, int most,
                     double *z, double *slack, double *multiplier, double *work, int *list,
                     const double *turn, const int *group);

static const int group[2 * STATES] = {{{group}}}; /* begin, then end of every state's group */

static void gather(capsule_state *s, const double *x, const double *goals, const double *obstacles)
{{
    double *to = s->inputs;
    for (int i = 0; i < GOALS; i++) *to++ = goals[i];
    for (int i = 0; i < NUMBERS * OBSTACLES; i++) *to++ = obstacles[i];
    for (int i = 0; i < STATES; i++) {{
        if (!s->begun) s->move[i] = 0.0;
        *to++ = s->move[i];
    }}
    for (int i = 0; i < STAGES * STATES; i++)
        if (!s->begun) s->path[i] = x[i % STATES];
}}

static int linearise(capsule_state *s, const double *x)
{{
    s->arg[0] = s->inputs; s->arg[1] = x; s->arg[2] = s->path;
    s->res[0] = s->H; s->res[1] = s->g; s->res[2] = s->G; s->res[3] = s->h; s->res[4] = s->steps;
    s->res[5] = s->turn;
    return program(s->arg, s->res, s->iw, s->w, 0);
}}

int capsule_step(capsule_state *s, const double *x, const double *goals, const double *obstacles,
                 double *rate)
{{
    int usable = 1;
    gather(s, x, goals, obstacles);
    const int failed = linearise(s, x);
    const int count = failed ? -1 : banded_qp_turned(
        STAGES, STATES, ROWS, s->H, s->g, x, s->move, s->steps, s->G, s->h, {penalty!r}, {effort!r},
        {smooth!r}, {tolerance!r}, {most}, s->path, s->slack, s->multiplier, s->work, s->kept,
        {turn}, group);
    for (int i = 0; i < STAGES * STATES; i++) usable = usable && isfinite(s->path[i]);
    s->begun = count >= 0 && usable;
    for (int i = 0; i < STATES; i++) {{
        const int begin = group[i], end = group[STATES + i];
        double length = 0.0;
        for (int j = begin; j < end; j++) length += (s->path[j] - x[j]) * (s->path[j] - x[j]);
        length = fmax(sqrt(length), {touching!r}); /* the box about the ball has corners */
        rate[i] = s->begun ? (s->path[i] - x[i]) * fmin(1.0, s->steps[begin] / length) / STEP : 0.0;
        s->move[i] = STEP * rate[i];
    }}
    for (int i = 0; i < (STAGES - 1) * STATES; i++) s->path[i] = s->path[i + STATES];
    return s->begun ? 0 : 1;
}}
"""
MAIN = """\
/* Drives the exact model; prints the rates of every step, and the path where the next begins. */
#include "capsule_step.h"
#include <stdio.h>

static const double start[] = {{{start}}};
static const double goals[] = {{{goal}}};
static double obstacles[] = {{{seen}}};
static capsule_state state;

int main(void)
{{
    double x[STATES], rate[STATES];
    for (int i = 0; i < STATES; i++) x[i] = start[i];
    for (int k = 0; k < {steps}; k++) {{
        if (capsule_step(&state, x, goals, obstacles, rate)) return 1;
        for (int i = 0; i < STATES; i++) {{
            printf("%.17g ", rate[i]);
            x[i] += STEP * rate[i];
        }}
        for (int i = 0; i < STAGES * STATES; i++)
            printf("%.17g%c", state.path[i], i + 1 < STAGES * STATES ? ' ' : '\\n');
        for (int i = 0; i < NUMBERS * OBSTACLES; i++) /* ends move by the velocity */
            if (i % NUMBERS < 6)
                obstacles[i] += STEP * obstacles[i - i % NUMBERS + 7 + i % NUMBERS % 3];
    }}
    return 0;
}}
"""


@dataclass(frozen=True)
class Example:
    """What the small program that comes with the code does."""

    start: ArrayLike  # state (n,) [mm]
    goal: ArrayLike  # what is to be reached (g,) [mm]
    obstacles: Sequence[Obstacle] = ()  # as seen at the start; they move on with their velocities
    steps: int = 100  # how many steps it drives


def numbers_of(statement: Statement, obstacles: Sequence[Obstacle]) -> Array:
    """Obstacles (K, 10) as a step in C takes them: a row for every slot, then for every ball."""
    out = np.zeros((statement.slots + statement.balls, OBSTACLE))
    out[:, :6] = FAR
    spheres = [o for o in obstacles if o.a == o.b]
    capsules = [o for o in obstacles if o.a != o.b] + spheres[statement.balls :]
    if len(capsules) > statement.slots:
        raise PlumblineError(
            f"obstacles: found {len(obstacles)}, expected at most {statement.slots} capsules and "
            f"{statement.balls} spheres; state the problem with more slots"
        )
    for begin, own in ((0, capsules), (statement.slots, spheres[: statement.balls])):
        for k, o in enumerate(own):
            out[begin + k] = (*o.a, *o.b, o.radius, *o.velocity)
    return out


def _seen(statement: Statement, numbers: Array) -> list[Obstacle]:
    """Obstacles from their numbers (K, 10)."""
    rows = [[float(v) for v in row] for row in numbers]
    return [
        Obstacle((a, b, c), (d, e, f), radius, (u, v, w))
        for a, b, c, d, e, f, radius, u, v, w in rows
    ]


def affine(statement: Statement) -> tuple[Array, Array]:
    """T0 (p t,) and T (p t, inputs): the stages' parameters from goals, obstacles, last step."""
    goals, count = statement.goals, statement.slots + statement.balls
    base = np.zeros((count, OBSTACLE))
    base[: statement.slots, 3] = 8.0  # apart from the other end, and so in all that is tried here
    size = goals + OBSTACLE * count + statement.n

    def stages(u: Array) -> Array:
        own = base + u[goals : goals + OBSTACLE * count].reshape(count, OBSTACLE)
        seen = _seen(statement, own)
        return statement.stages(u[:goals], seen, u[goals + OBSTACLE * count :]).ravel()

    first = stages(np.zeros(size))
    units = np.eye(size)
    for k in range(statement.slots, count):
        # A sphere is a point: where one end goes the other does, and so counts for both.
        at = goals + OBSTACLE * k
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
    last = cs.vertcat(*(_norm(part) for part in cs.vertsplit(moved, _ends(own.groups))))
    last = cs.vertcat(*(last[k] for k, size in enumerate(own.groups) for _ in range(size)))
    grown = cs.repmat(last, 1, p) + cs.DM(np.broadcast_to(own.ramp, (p, n)).T)
    share = cs.DM(np.broadcast_to(own.alpha, (p, n)).T)
    most = cs.fmin(pace * share, grown) * sides
    one = stage_function(own).map("stages", "serial", p, [1], [])
    outputs = [*one(path, x0, stages), most, turn]
    return cs.Function("program", [u, x0, path], [cs.densify(value) for value in outputs])


def _ends(groups: tuple[int, ...]) -> list[int]:
    """Where groups begin, and where the last one ends."""
    return [int(end) for end in np.cumsum([0, *groups])]


def _norm(value: cs.MX) -> cs.MX:
    return cs.sqrt(cs.sumsqr(value))


def write(
    statement: Statement, folder: Path, example: Example, planner: RealTime | None = None
) -> None:
    """Write the code of a step, and a small program that drives the model with it.

    ``cc -O3 -o main main.c capsule_step.c program.c banded_qp.c -lm`` builds it.

    Args:
        statement: What is to be planned; its constants are built in.
        folder: Where to; made if need be.
        example: What the small program does.
        planner: Options; :class:`.banded_qp.BandedQp` must be its solver, and one pass.

    Raises:
        PlumblineError: A planner that there is no code for, or more obstacles than slots.
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
    solver = (resources.files("plumbline.optim.capsule_mpc") / "banded_qp.c").read_text(
        encoding="utf-8"
    )
    sources = (
        generator.dump(),
        solver,
        HEADER.format(**_sizes(statement, function)),
        STEP.format(**_weights(statement, own.solver)),
        MAIN.format(**_example(statement, example)),
    )
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
        "numbers": OBSTACLE,
        "dt": statement.settings.dt,
        "far": FAR,
        "work": (N + 2 * n) * (2 * n + 1) + 2 * N + 2 * n + 5 * M + 6 * K,
        "sz_w": max(function.sz_w(), 1),
        "sz_iw": max(function.sz_iw(), 1),
        "sz_arg": max(function.sz_arg(), 1),
        "sz_res": max(function.sz_res(), 1),
    }


def _weights(statement: Statement, solver: BandedQp) -> dict[str, object]:
    s = statement.settings
    effort, smooth = s.weights
    ends = _ends(statement.groups)
    begins = [ends[k] for k, size in enumerate(statement.groups) for _ in range(size)]
    closes = [ends[k + 1] for k, size in enumerate(statement.groups) for _ in range(size)]
    return {
        "group": ", ".join(str(number) for number in [*begins, *closes]),
        "turn": "s->turn" if max(statement.groups) > 1 else "0",
        "touching": TOUCHING,
        "penalty": float(s.penalty),
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
