r"""Does the horizon earn its keep? ``python -m plumbline.experiments.mpc.foresight --count 40``.

The same tasks for two controllers, behind the guide and without it: the horizon, and one step on
control barrier functions. A task counts as done where every goal was reached and nothing was
touched, judged at every millisecond. Families are those in which looking ahead should win:

* a narrow pass, dead ends and several arms, where what is near misleads;
* obstacles that drift across the way, whose motion is foreseen;
* a delay of the plant of several steps, which its controller knows;
* drives that can change their speed only slowly, so that one has to brake in time.

One step is the controller's default as long as the horizon does not do at least :data:`WINS` more
of these tasks: behind the guide both do as many.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.mpc.campaign import done
from plumbline.experiments.reality.instruments import Mismatch
from plumbline.experiments.reality.mpc_scenarios import STATED, draw
from plumbline.optim.capsule_mpc import OneStep, Planner, RealTime

WINS = 0.10  # of the tasks, by which a horizon must do more than one step to be worth its place
STEPS = 300  # of a task at most, 6 s
DELAYED = replace(STATED, delay=0.105)
WEAK = replace(STATED, acceleration=400.0)
FORESIGHT: dict[str, tuple[str, Mismatch]] = {  # name: family that it is drawn from, plant
    "narrow pass": ("narrow gap", STATED),
    "dead end": ("dead end", STATED),
    "drifting obstacle": ("drifting obstacle", STATED),
    "several arms": ("four instruments", STATED),
    "delay": ("crossing", DELAYED),
    "delay, drifting obstacle": ("drifting obstacle", DELAYED),
    "weak drives": ("crossing", WEAK),
    "weak drives, drifting obstacle": ("drifting obstacle", WEAK),
}


@dataclass(frozen=True)
class Tried:
    """What a controller came to in a family."""

    family: str  # the family
    controller: str  # ``"horizon"`` or ``"one step"``
    guided: bool  # whether the guide stood before it
    tasks: int  # how many tasks
    done: int  # how many of them reached their goals without contact
    contacts: int  # how many touched something
    clearance: float  # least clearance [mm]
    p99: float  # 99th percentile of the processor time of a step [ms]


def tried(
    family: str, controller: str, planner: Planner, guided: bool, count: int, seed: int
) -> Tried:
    """Do the tasks of a family."""
    drawn_from, plant = FORESIGHT[family]
    scenarios = (draw(drawn_from, 100_000 * (seed + 1) + k, plant) for k in range(count))
    runs = [done(scenario, planner, guided, STEPS) for scenario in scenarios]
    gaps = np.array([run.clearance for run in runs])
    reached = np.array([run.reached for run in runs])
    times = np.concatenate([run.seconds for run in runs])
    did, hit = int((reached & (gaps > 0.0)).sum()), int((gaps <= 0.0).sum())
    p99 = float(1e3 * np.percentile(times, 99.0))
    return Tried(family, controller, guided, count, did, hit, float(gaps.min()), p99)


def compared(
    count: int, seed: int, compiled: bool = True, families: Sequence[str] = tuple(FORESIGHT)
) -> list[Tried]:
    """All families, both controllers, with and without the guide."""
    planners: dict[str, Planner] = {"horizon": RealTime(), "one step": OneStep()}
    if not compiled:
        planners = {"horizon": RealTime(compiled=False), "one step": OneStep(compiled=False)}
    return [
        tried(family, name, planner, guided, count, seed)
        for family in families
        for guided in (True, False)
        for name, planner in planners.items()
    ]


def share(found: Sequence[Tried], controller: str, guided: bool) -> float:
    """Share of the tasks that a controller did."""
    own = [t for t in found if t.controller == controller and t.guided == guided]
    return sum(t.done for t in own) / sum(t.tasks for t in own)


def gain(found: Sequence[Tried], guided: bool) -> float:
    """By what share of the tasks the horizon does more."""
    return share(found, "horizon", guided) - share(found, "one step", guided)


def figures(found: Sequence[Tried]) -> dict[str, Any]:
    """For JSON."""
    return {
        name: {
            "horizon": share(found, "horizon", guided),
            "one_step": share(found, "one step", guided),
            "horizon_wins": gain(found, guided) >= WINS,
        }
        for name, guided in (("guided", True), ("unguided", False))
    }


def cells(found: Sequence[Tried]) -> list[tuple[str, ...]]:
    """Rows in words: a family each, then all."""
    rows = []
    families = list(dict.fromkeys(t.family for t in found))
    for family in [*families, "all"]:
        own = [t for t in found if family in ("all", t.family)]
        row = [family]
        for guided in (True, False):
            for name in ("horizon", "one step"):
                one = [t for t in own if t.controller == name and t.guided == guided]
                tasks, hits = sum(t.tasks for t in one), sum(t.contacts for t in one)
                row.append(f"{sum(t.done for t in one)} of {tasks}, {hits}")
        rows.append(tuple(row))
    return rows


HEADS = ("family", "horizon, guide", "one step, guide", "horizon alone", "one step alone")


@as_command
def foresight(
    count: Annotated[int, typer.Option(min=1, help="Tasks of a family.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> Found:
    """Compare the horizon with one step, family by family."""
    found = compared(count, seed)
    return {"done, and contacts": pd.DataFrame(cells(found), columns=HEADS), **figures(found)}


if __name__ == "__main__":
    typer.run(foresight)
