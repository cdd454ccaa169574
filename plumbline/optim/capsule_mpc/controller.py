r"""The control loop's step, and the net below it: it always answers, and within the limits.

At every step there is a stop at hand: rates that end in rest and keep speed, acceleration and jerk
(:mod:`.stopping`). A command is the first rate of a motion, and what follows it is its stop. From
best to worst:

1. the plan's first step;
2. no plan (not solved, late, or an exception): the first step of the fallback's, if there is one;
3. not that either, or no usable measurement for more than ``patience`` steps: the stop at hand.

By default the planner is one step on control barrier functions, and nothing stands between it and
the stop: behind the guide it does as many tasks as the horizon does
(``experiments/mpc/foresight.py``), and what this program cannot solve it would not solve when asked
again. Under a planner with a horizon, one step is the fallback.

A rate u is first brought within the limits, as far from the stop's rate b towards u as they allow:
they are convex and b keeps them. Then the whole motion, u and the stop after it, is tried on the
statement at all times (:mod:`.net`). With :math:`s_k = \max(-g_k, 0)` what a pair falls short of
its distance on the way, it passes if it makes neither :math:`\max_k s_k` nor :math:`\sum_k s_k`
larger than the stop at hand does, and leaves no limit of the states; else u is moved halfway to b,
again and again, and is b in the end. So while the model is exact, a command that keeps all
distances is followed by one that does: the stop at hand is one (the argument of recursive
feasibility with a backup trajectory). It does not help against an obstacle that comes by itself: a
motion out of its way is kept, even one that costs another pair some of its margin, as long as less
than it saves.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from time import perf_counter

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from plumbline.declared import expect
from plumbline.errors import PlumblineError
from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.bodies import Obstacle
from plumbline.optim.capsule_mpc.compiled import Compiled, first_line
from plumbline.optim.capsule_mpc.evasion import Evasion
from plumbline.optim.capsule_mpc.events import (
    AtGoal,
    Command,
    Event,
    Mode,
    Seated,
    Seating,
    Trouble,
    entered,
    held_back,
    impossible,
    inside,
    left_out,
    margins_function,
    moves_otherwise,
    not_evaded,
    off_hold,
    shortfalls,
)
from plumbline.optim.capsule_mpc.linearised import norms
from plumbline.optim.capsule_mpc.net import Clearances, Net
from plumbline.optim.capsule_mpc.planning import OneStep, Plan, Planner, Ready, shifted
from plumbline.optim.capsule_mpc.settings import NEAR, Safety, near
from plumbline.optim.capsule_mpc.statement import Statement, StatementShape
from plumbline.optim.capsule_mpc.stopping import Stop, held_exactly, how_far_off, limited_function
from plumbline.optim.capsule_mpc.sweeps import Looks, Sweeps, tip_speed
from plumbline.optim.capsule_mpc.underway import Underway
from plumbline.optim.core.problem import Array


class Controller:
    """Steps of a control loop; it remembers its last path and its last rates."""

    def __init__(
        self,
        statement: Statement,
        planner: Planner | None = None,
        safety: Safety | None = None,
        fallback: Planner | None = None,
    ) -> None:
        """Build planner and fallback; the first time, this may take a compiler some seconds.

        Args:
            statement: The problem.
            planner: By default :class:`.planning.OneStep`; :class:`.planning.RealTime` has the
                patent's cost over the horizon, and smoother commands.
            safety: Options of the net.
            fallback: Asked where the planner has no plan: by default one step, or, under one step,
                nothing but the stop at hand.
        """
        self.statement = statement
        self.safety = safety or Safety()
        expect("safety", self.safety, Safety)
        planner = planner or OneStep()
        if fallback is None and not isinstance(planner, OneStep):
            fallback = OneStep(compiled=False)
        expect("planner", planner, Planner)
        expect("fallback", fallback, Planner | None)
        self._planner: Ready = planner.ready(statement)
        self._fallback: Ready | None = fallback.ready(statement) if fallback else None
        self._gaps = Compiled(statement.clearances, False)
        self._limits = Compiled(_limited(statement.shape), False)
        self._stop = Stop(statement)
        compiled = bool(getattr(planner, "compiled", False))
        self._net = Net(statement, 1 + self._stop.steps, compiled)
        self._evasion = Evasion(statement)
        self._sweeps = Sweeps(statement.settings.dt, tip_speed(statement))
        self._looks = Looks(statement.settings.dt)
        self._seating = Seating(statement, 1 + self._stop.steps)
        self._holds = statement.held.numel() > 0
        self._margins = Compiled(margins_function(statement.shape), False)
        self._dropped = statement.settings.apart[1]  # in D of what has no slot
        self._impossible, self._at_goal = impossible(statement), AtGoal(statement)
        plant, told = self.safety.plant, self.safety.delay * statement.settings.dt
        late = replace(plant, delay=np.asarray(plant.delay) + told)
        self._underway = Underway(late, statement)
        self._stray = 0.0
        self.reset()

    @property
    def backend(self) -> str:
        """What its plans run on: ``"compiled"``, or ``"casadi"``, some ten times slower."""
        return str(getattr(self._planner, "backend", "casadi"))

    def reset(self) -> None:
        """Forget everything, as before the first step."""
        self._path: Array | None = None
        self._present: Array | None = None
        self._goal: Array | None = None
        self._places: list[Obstacle] = []  # as seen
        self._known: list[Obstacle] = []  # as they will be when a rate acts
        self._swept: list[Obstacle] = []
        self._believed: list[Obstacle] = []
        self._underway.reset()
        self._rates = np.zeros((2, self.statement.n))  # the last, and the one before
        self._tail = np.zeros((1 + self._stop.steps, self.statement.n))  # the stop at hand
        self._stage: Array | None = None
        self._blind = 0
        self._evasion.reset()
        self._sweeps.reset()
        self._looks.reset()

    def step(
        self, measured: ArrayLike, goal: ArrayLike, obstacles: Sequence[Obstacle] = ()
    ) -> Command:
        """One step of the loop.

        Args:
            measured: State (n,) [m, or rad].
            goal: What is to be reached (g,), or a path of it (m, g), m >= p, step by step [m]; a
                plant that is known to be late is led by later points.
            obstacles: As seen now [m].
        """
        begun = perf_counter()
        events: list[Event] = []
        try:
            seen = [obstacle.scaled(constants.MM) for obstacle in obstacles]
            command = self._step(begun, events, measured, goal, seen)
        except Exception as error:
            # Nothing may leave the loop: what is not foreseen is reported, and motion stops.
            events.append(Event(Trouble.FAULT, f"{first_line(error)}; stopped"))
            command = self._stopped(begun, events)
        return command

    def _step(
        self,
        begun: float,
        events: list[Event],
        measured: ArrayLike,
        goal: ArrayLike,
        obstacles: Sequence[Obstacle],
    ) -> Command:
        present = self._measured(measured, events)
        if present is None:
            return self._stopped(begun, events)
        dt = self.statement.settings.dt
        x0 = present + self._underway.way()
        self._stray = self._underway.stray(present)
        events += self._underway.said()
        believed, otherwise = self._looks.believed(obstacles)
        events += [moves_otherwise(k, believed[k], obstacles[k]) for k in otherwise]
        seated = self._seen(believed, x0, events)
        wanted = self._wanted(goal, events)
        if obstacles:
            straight, rate = self._sweeps.straight, self._rates[0]
            wanted = self._evasion.goal(x0, rate, wanted, self._swept, straight)
            over = self._evasion.overlap
            events += [not_evaded(k, over[k]) for k in np.flatnonzero(over).tolist()]
        stages = self.statement.stages(wanted, seated.kept, dt * self._rates[0], self._stray)
        self._stage = stages[0]
        path = self._path
        if path is None:
            path = np.tile(x0, (len(stages), 1))
        here = self.statement.present(stages)
        as_seen = self._as_seen(here, seated.kept)
        if self._goal is not None:
            events += self._at_goal.said(self._goal.reshape(-1, self.statement.goals)[-1], as_seen)
        gaps = np.append(self._gaps(x0, as_seen)[0], seated.gap)
        if gaps.min() < 0.0:
            events += inside(gaps, np.append(self._margins(x0, as_seen)[0], self._dropped))
        if (off := how_far_off(self.statement, x0, stages[0])) > constants.OFF:
            events.append(off_hold(off))
        plan, mode = None, Mode.STOP
        if not seated.danger:
            plan, mode = self._planned(begun, events, x0, stages, path)
        rate = self._chosen(plan, x0, stages[0], here, events)
        # A plan that is refused as a whole is none to start the next one from.
        refused = any(event.trouble is Trouble.HELD_BACK for event in events)
        sent = self._remember(plan if mode is Mode.PLAN and not refused else None, x0, rate)
        events += self._impossible
        if mode is Mode.PLAN and plan:
            events += shortfalls(plan)
        gap, slack = float(gaps.min()) / constants.MM, plan.slack / constants.MM if plan else 0.0
        ahead = plan.x * self.statement.unit if plan else None
        seconds = perf_counter() - begun
        return Command(sent, mode, tuple(events), gap, slack, seconds, ahead)

    def _measured(self, measured: ArrayLike, events: list[Event]) -> Array | None:
        values = np.array(measured, dtype=float).ravel()
        own = self.statement
        lengths = own.unit == 1 / constants.MM
        if values.shape == (own.n,) and np.isfinite(values).all() and near(values[lengths]):
            self._blind, values = 0, values / self.statement.unit
            self._underway.seen(values)
            if unseen := self._underway.unseen():
                events += unseen
                return None
            self._present = values
            return values
        self._blind += 1
        most = self.safety.patience
        words = f"state not usable ({NEAR}) {self._blind} times in a row, at most {most}"
        if self._present is None or self._blind > self.safety.patience:
            events.append(Event(Trouble.BAD_MEASUREMENT, f"{words}; stopped", float(self._blind)))
            return None
        words = f"{words}; the predicted state is used"
        events.append(Event(Trouble.BAD_MEASUREMENT, words, float(self._blind)))
        return self._present

    def _wanted(self, goal: ArrayLike, events: list[Event]) -> Array:
        values = np.array(goal, dtype=float)
        g, p = self.statement.goals, self.statement.settings.p
        path = values.ndim == 2 and values.shape[1] == g and len(values) >= p
        if (path or values.shape == (g,)) and near(values):
            self._goal = constants.MM * values
        elif self._goal is None:
            raise PlumblineError(f"no goal yet that is usable: ({g},) numbers expected, {NEAR}")
        else:
            events.append(
                Event(Trouble.BAD_GOAL, f"goal not usable ({NEAR}); the last one is kept")
            )
        return self._underway.then(self._goal, self.statement.settings.p)

    def _seen(self, obstacles: Sequence[Obstacle], x0: Array, events: list[Event]) -> Seated:
        """Usable obstacles that have a slot; one that is not usable stands where it was last."""
        found = []
        for k, obstacle in enumerate(obstacles):
            if obstacle.usable:
                found.append(obstacle)
            elif k < len(self._places):
                events.append(Event(Trouble.BAD_OBSTACLE, f"obstacle {k + 1}: last place kept"))
                found.append(replace(self._places[k], velocity=(0.0, 0.0, 0.0)))
            else:
                raise PlumblineError(f"obstacle {k + 1} not usable ({NEAR}), and never seen before")
        swept, moved = self._sweeps.swept(found), self._underway.moved(found)
        # What swings is where it is seen: where it will be is on its way there and back.
        swings, self._places = [s is not o for o, s in zip(found, swept, strict=True)], found
        self._known = [o if s else m for o, m, s in zip(found, moved, swings, strict=True)]
        self._swept = [o if s else m for o, m, s in zip(swept, moved, swings, strict=True)]
        self._believed = self._believe(self._known)
        seated = self._seating.seat(x0, self._believed)
        events += left_out(len(found), self.statement, seated)
        return seated

    def _believe(self, found: list[Obstacle]) -> list[Obstacle]:
        """Fast ones by all that they sweep, as long as there are slots for capsules."""
        believed = list(self._swept)
        free = self.statement.slots - sum(o.a != o.b for o in found)
        for k, (old, new) in enumerate(zip(found, believed, strict=True)):
            if old.a == old.b and new.a != new.b:
                free -= 1
                believed[k] = new if free >= 0 else old
        return believed

    def _as_seen(self, here: Array, kept: Sequence[Obstacle]) -> Array:
        """Parameters of the present with the obstacles themselves, not with what they sweep."""
        own = {id(b): o for o, b in zip(self._known, self._believed, strict=True) if b is not o}
        if not own:
            return here
        seen = [own.get(id(obstacle), obstacle) for obstacle in kept]
        stages = self.statement.stages(here[: self.statement.goals], seen, stray=self._stray)
        return self.statement.present(stages)

    def _planned(
        self, begun: float, events: list[Event], x0: Array, stages: Array, path: Array
    ) -> tuple[Plan | None, Mode]:
        plan = self._tried(self._planner, x0, stages, path, events)
        late = perf_counter() - begun
        if late > self.safety.budget:
            words = f"plan after {1e3 * late:.1f} ms, at most {1e3 * self.safety.budget:.1f} ms"
            events.append(Event(Trouble.OVER_BUDGET, words, late))
        elif plan is not None:
            return plan, Mode.PLAN
        if self._fallback is not None:
            plan = self._tried(self._fallback, x0, stages, path, events)
            return plan, Mode.BRAKE if plan is None else Mode.ONE_STEP
        return None, Mode.BRAKE

    def _tried(
        self, ready: Ready, x0: Array, stages: Array, path: Array, events: list[Event]
    ) -> Plan | None:
        try:
            plan = ready.plan(x0, stages, path)
        except Exception as error:
            events.append(Event(Trouble.SOLVER_FAILED, first_line(error)))
            return None
        if not plan.solved or not np.isfinite(plan.x).all():
            events.append(Event(Trouble.SOLVER_FAILED, plan.status, float(plan.iterations)))
            return None
        return plan

    def _chosen(
        self, plan: Plan | None, x0: Array, stage: Array, here: Array, events: list[Event]
    ) -> Array:
        """The rate that goes out; keeps the stop after it."""
        stop, aim = self._tail, self._tail[0]
        if plan is not None:
            aim = self._limited((plan.x[0] - x0) / self.statement.settings.dt, x0, stage)
        rest: Clearances | None = None
        for _ in range(1 + constants.HALVINGS if plan is not None else 0):
            rate = self._held(aim, x0, stage)
            after = self._stop.after(rate, self._rates[0], 1.0 + constants.ROUNDING)
            if after is not None:
                ahead = self._net.judge(x0, np.concatenate([rate[None], after]), here)
                if not ahead.clear:
                    rest = rest or self._net.judge(x0, stop, here)
                if rest is None or ahead.no_worse(rest):
                    events += entered(ahead.first, events, constants.WORSE)
                    self._tail = np.concatenate([after, 0.0 * after[-1:]])
                    return rate
            aim = (aim + stop[0]) / 2
        rest = rest or self._net.judge(x0, stop, here)
        if plan is not None:
            events.append(held_back(float(rest.gaps.min(initial=np.inf))))
        events += entered(rest.first, events, constants.WORSE)
        rate = self._held(stop[0], x0, stage) if stop[0].any() else stop[0]
        self._tail = np.concatenate([stop[1:], 0.0 * stop[-1:]])
        return rate

    def _limited(self, rate: Array, x0: Array, stage: Array) -> Array:
        """As far from the stop's rate towards a rate as speed, acceleration and jerk allow."""
        return self._limits(x0, stage, self._tail[0], rate, *self._rates)[0].copy()

    def _held(self, rate: Array, x0: Array, stage: Array) -> Array:
        """The rate after which all that is held is zero, or as near to it as the limits allow."""
        own, dt = self.statement, self.statement.settings.dt
        if not self._holds:
            return rate
        most = own.step[0] / dt
        for _ in range(constants.PASSES):
            right = (held_exactly(own, x0 + dt * rate, stage) - x0) / dt
            excess = float(np.max(norms(right, own.groups) / most))
            change = norms(right - self._limited(right, x0, stage), own.groups)
            if excess <= 1.0 and (change <= constants.HOLDING * dt * own.acceleration).all():
                return right
            rate = self._limited(constants.SHORTER * right / max(excess, 1.0), x0, stage)
        return rate

    def _remember(self, plan: Plan | None, x0: Array, rate: Array) -> Array:
        """Keeps what the next step begins with; what is to be sent (n,) [m/s, or rad/s]."""
        dt = self.statement.settings.dt
        ahead = x0 + dt * rate
        self._path = shifted(plan.x) if plan else np.tile(ahead, (self.statement.settings.p, 1))
        sent = self._underway.sent(rate)
        self._present = ahead - self._underway.way()
        self._rates = np.stack([rate, self._rates[0]])
        return sent

    def _stopped(self, begun: float, events: list[Event]) -> Command:
        """The stop at hand; where nothing is known of the state, nothing else is known to be."""
        events.append(Event(Trouble.STOPPED, "motion stops; it resumes with usable inputs"))
        rate = self._tail[0]
        sent = rate * self.statement.unit
        if self._present is not None:
            x0 = self._present + self._underway.way()
            if self._stage is not None and rate.any():
                rate = self._held(rate, x0, self._stage)
            sent = self._remember(None, x0, rate)
        self._tail = np.concatenate([self._tail[1:], 0.0 * self._tail[-1:]])
        self._path = None
        seconds = perf_counter() - begun
        return Command(sent, Mode.STOP, tuple(events), np.nan, 0.0, seconds, None)


@lru_cache(maxsize=16)
def _limited(shape: StatementShape) -> cs.Function:
    return limited_function(shape.statement)
