r"""The control loop's step, and the net below it: it always answers, and within the limits.

Whatever happens, the rate stays within :math:`|u| \le \alpha(0)\, v_{max}`, what happened is
reported, and nothing is raised. From best to worst:

1. the plan's first step;
2. no plan (not solved, late, or an exception): one step on control barrier functions;
3. not that either: half of the last rate, again and again, which is a stop;
4. no usable measurement for more than ``patience`` steps: a stop.

Before it goes out, a rate is tried on the statement. With :math:`g_k` a pair's distance less its D
after a step, and :math:`s_k = \max(-g_k, 0)` what it is short of, a rate passes if it makes neither
:math:`\max_k s_k` nor :math:`\sum_k s_k` larger than standing still would; else it is halved until
it does. Standing still does not help against an obstacle that comes by itself: a step out of its
way is kept, even one that costs another pair some of its margin, as long as less than it saves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.capsule_mpc.compiled import Compiled
from optim.capsule_mpc.events import Command, Event, Mode, Trouble
from optim.capsule_mpc.holding import held_exactly, how_far_off
from optim.capsule_mpc.one_step import OneStep
from optim.capsule_mpc.planning import Plan, Planner, Ready, RealTime, shifted
from optim.capsule_mpc.scene import Obstacle
from optim.capsule_mpc.settings import ControlError
from optim.capsule_mpc.statement import Statement

Array = NDArray[np.float64]
SLACK = 1e-3  # [mm] of slack, or inside of a margin, that is worth a report
WORSE = 5e-3  # [mm] by which a rate may take a pair deeper into its margin than standing still:
# what linearising a step leaves over is no reason to stop
OFF = 1e-2  # [mm], or as it is stated, by which what is held may be off without a report
HALVINGS = 4


@dataclass(frozen=True)
class Safety:
    """Options of the net.

    Attributes:
        budget: Time that a plan may take [s]; a later one is not used.
        patience: Steps without a usable measurement, after which motion stops.
        delay: Steps that a command is known to take until it acts.
    """

    budget: float = 0.02
    patience: int = 5
    delay: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot be.

        Raises:
            ControlError: A number below zero, or none.
        """
        for name in ("budget", "patience", "delay"):
            if not getattr(self, name) >= 0:
                raise ControlError(
                    f"{name}: found {getattr(self, name)}, expected at least 0; use the default"
                )


class Controller:
    """Steps of a control loop; it remembers its last path and its last rates."""

    def __init__(
        self,
        statement: Statement,
        planner: Planner | None = None,
        safety: Safety = Safety(),
        fallback: Planner | None = None,
    ) -> None:
        """Build planner and fallback; the first time, this may take a compiler some seconds."""
        self.statement = statement
        self.safety = safety
        self._planner: Ready = (planner or RealTime()).ready(statement)
        self._fallback: Ready = (fallback or OneStep(compiled=False)).ready(statement)
        self._gaps = Compiled(statement.clearances, False)
        self._limit = statement.step[0] / statement.settings.dt
        self._holds = statement.held.numel() > 0
        margins = statement.settings.safe + statement.settings.noise.tightening(1)[0]
        self._tight = np.array([margins[int(pair.fixed)] for pair in statement.pairs])
        self.reset()

    @property
    def backend(self) -> str:
        """What its plans run on: ``"compiled"``, or ``"numpy"``, which is some ten times slower."""
        return str(getattr(self._planner, "backend", "numpy"))

    def reset(self) -> None:
        """Forget everything, as before the first step."""
        n = self.statement.n
        self._path: Array | None = None
        self._present: Array | None = None
        self._goal: Array | None = None
        self._known: list[Obstacle] = []
        self._pending = [np.zeros(n)] * self.safety.delay
        self._rate = np.zeros(n)
        self._blind = 0

    def step(
        self, measured: ArrayLike, goal: ArrayLike, obstacles: Sequence[Obstacle] = ()
    ) -> Command:
        """One step of the loop.

        Args:
            measured: State (n,) [mm, or rad].
            goal: What is to be reached (g,), or a path of it (p, g) [mm].
            obstacles: As seen now.
        """
        begun = perf_counter()
        events: list[Event] = []
        try:
            command = self._step(begun, events, measured, goal, obstacles)
        except Exception as error:
            # Nothing may leave the loop: what is not foreseen is reported, and motion stops.
            events.append(Event(Trouble.FAULT, f"{_first_line(error)}; stopped"))
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
        x0 = present + self.statement.settings.dt * np.sum(self._pending, axis=0)
        seen = self._seen(obstacles, events)
        move = self.statement.settings.dt * self._rate
        stages = self.statement.stages(self._wanted(goal, events), seen, move)
        path = self._path
        if path is None:
            path = np.tile(x0, (len(stages), 1))
        gaps = self._gap(x0, self.statement.present(stages, seen))
        gap = float(gaps.min(initial=1e6))
        if gap < -SLACK:
            events.append(self._inside(gaps))
        self._report_off(x0, stages[0], events)
        plan, mode = self._planned(begun, events, x0, stages, path)
        rate = self._held(self._limited(plan, x0), x0, stages[0])
        rate = self._held_back(rate, x0, stages, events)
        self._remember(plan if mode is Mode.PLAN else None, x0, rate)
        slack = plan.slack if plan else 0.0
        if mode is Mode.PLAN and slack > SLACK:
            words = f"plan falls short of its distances by {slack:.3f} mm, expected 0"
            events.append(Event(Trouble.SLACK, words, slack))
        seconds = perf_counter() - begun
        return Command(rate, mode, tuple(events), gap, slack, seconds, plan)

    def _measured(self, measured: ArrayLike, events: list[Event]) -> Array | None:
        values = np.array(measured, dtype=float).ravel()
        if values.shape == (self.statement.n,) and np.isfinite(values).all():
            self._blind = 0
            self._present = values
            return values
        self._blind += 1
        words = f"state not usable {self._blind} times in a row, at most {self.safety.patience}"
        if self._present is None or self._blind > self.safety.patience:
            events.append(Event(Trouble.BAD_MEASUREMENT, f"{words}; stopped", float(self._blind)))
            return None
        words = f"{words}; the predicted state is used"
        events.append(Event(Trouble.BAD_MEASUREMENT, words, float(self._blind)))
        return self._present

    def _wanted(self, goal: ArrayLike, events: list[Event]) -> Array:
        values = np.array(goal, dtype=float)
        shapes = ((self.statement.goals,), (self.statement.settings.p, self.statement.goals))
        if values.shape in shapes and np.isfinite(values).all():
            self._goal = values
        elif self._goal is None:
            raise ValueError(f"goal not usable: {values.shape}, expected {shapes[0]}, all finite")
        else:
            events.append(Event(Trouble.BAD_GOAL, "goal not usable; the last one is kept"))
        return self._goal

    def _seen(self, obstacles: Sequence[Obstacle], events: list[Event]) -> list[Obstacle]:
        """Usable obstacles; one that is not stands where it was last seen."""
        found = []
        for k, obstacle in enumerate(obstacles):
            if obstacle.usable:
                found.append(obstacle)
            elif k < len(self._known):
                events.append(Event(Trouble.BAD_OBSTACLE, f"obstacle {k + 1}: last place kept"))
                found.append(replace(self._known[k], velocity=(0.0, 0.0, 0.0)))
            else:
                raise ValueError(f"obstacle {k + 1} not usable, and never seen before")
        self._known = found
        room = self.statement.slots + self.statement.balls
        balls = sum(o.a == o.b for o in found)
        while len(found) > room or len(found) - min(balls, self.statement.balls) > (
            self.statement.slots
        ):
            found = sorted(found, key=self._distance)[:-1]
            balls = sum(o.a == o.b for o in found)
            words = f"{len(self._known)} obstacles, at most {room}; the farthest left out"
            events.append(Event(Trouble.TOO_MANY_OBSTACLES, words, float(len(self._known))))
        return found

    def _distance(self, obstacle: Obstacle) -> float:
        middle = (np.array(obstacle.a) + np.array(obstacle.b)) / 2
        here = np.zeros((1, 3)) if self._goal is None else self._goal.reshape(-1, 3)
        return float(np.linalg.norm(here - middle, axis=1).min()) - obstacle.radius

    def _gap(self, x: Array, stage: Array) -> Array:
        """Distance less its D (P,) [mm] of every pair."""
        return self._gaps(x, stage)[0].copy()

    def _report_off(self, x: Array, stage: Array, events: list[Event]) -> None:
        off = how_far_off(self.statement, x, stage)
        if off > OFF:
            words = (
                f"what is held is off by {off:.3f}, expected at most {OFF:g}; put right on the way"
            )
            events.append(Event(Trouble.OFF_HOLD, words, off))

    def _inside(self, gaps: Array) -> Event:
        gap, overlap = float(gaps.min()), float((-gaps - self._tight).max())
        if overlap > 0.0:
            return Event(Trouble.CONTACT, f"{overlap:.3f} mm of overlap, expected none", gap)
        return Event(Trouble.INSIDE_MARGIN, f"{-gap:.3f} mm inside of the margin, expected 0", gap)

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
        plan = self._tried(self._fallback, x0, stages, path, events)
        return plan, Mode.BRAKE if plan is None else Mode.ONE_STEP

    def _tried(
        self, ready: Ready, x0: Array, stages: Array, path: Array, events: list[Event]
    ) -> Plan | None:
        try:
            plan = ready.plan(x0, stages, path)
        except Exception as error:
            events.append(Event(Trouble.SOLVER_FAILED, _first_line(error)))
            return None
        if not plan.solved or not np.isfinite(plan.x).all():
            events.append(Event(Trouble.SOLVER_FAILED, plan.status, float(plan.iterations)))
            return None
        return plan

    def _limited(self, plan: Plan | None, x0: Array) -> Array:
        if plan is None:
            return self._rate / 2
        rate = (plan.x[0] - x0) / self.statement.settings.dt
        return np.clip(rate, -self._limit, self._limit)

    def _held(self, rate: Array, x0: Array, stage: Array) -> Array:
        """The rate after which all that is held is zero, within the limits."""
        dt = self.statement.settings.dt
        if not self._holds:
            return rate
        for _ in range(8):
            rate = (held_exactly(self.statement, x0 + dt * rate, stage) - x0) / dt
            excess = float(np.max(np.abs(rate) / self._limit))
            if excess <= 1.0:
                return rate
            rate = 0.98 * rate / excess
        return np.clip(rate, -self._limit, self._limit)

    def _held_back(self, rate: Array, x0: Array, stages: Array, events: list[Event]) -> Array:
        """The rate, halved until it leaves no more short of its distance than standing still."""
        dt, tried = self.statement.settings.dt, rate
        still = self._gap(x0, stages[0])
        for _ in range(1 + HALVINGS):
            ahead = self._gap(x0 + dt * tried, stages[0])
            if _no_worse(ahead, still):
                return tried
            tried = self._held(tried / 2, x0, stages[0])
        worst, rest = -ahead.min(), -still.min()
        words = f"rate would go {worst:.3f} mm into a margin, {rest:.3f} mm at rest; stopped"
        events.append(Event(Trouble.HELD_BACK, words, -float(worst)))
        return np.zeros_like(rate)

    def _remember(self, plan: Plan | None, x0: Array, rate: Array) -> None:
        dt = self.statement.settings.dt
        ahead = x0 + dt * rate
        self._path = shifted(plan.x) if plan else np.tile(ahead, (self.statement.settings.p, 1))
        self._pending = [*self._pending, rate][1:] if self.safety.delay else []
        self._present = ahead - dt * np.sum(self._pending, axis=0)
        self._rate = rate

    def _stopped(self, begun: float, events: list[Event]) -> Command:
        events.append(Event(Trouble.STOPPED, "motion stopped; it resumes with usable inputs"))
        self._path = None
        self._rate = np.zeros(self.statement.n)
        if self.safety.delay:
            acting, *rest = self._pending
            if self._present is not None:
                self._present = self._present + self.statement.settings.dt * acting
            self._pending = [*rest, self._rate]
        seconds = perf_counter() - begun
        return Command(self._rate, Mode.STOP, tuple(events), np.nan, 0.0, seconds, None)


def _first_line(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]


def _no_worse(ahead: Array, still: Array) -> bool:
    """Whether gaps (P,) are short of zero by no more than others, at worst and in all."""
    short, rest = np.maximum(-ahead - WORSE, 0.0), np.maximum(-still, 0.0)
    worst = short.max(initial=0.0) <= rest.max(initial=0.0)
    return bool(worst and short.sum() <= rest.sum())
