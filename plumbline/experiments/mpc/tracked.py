r"""Does it help a controller to know its plant? Recorded, diagnosed, and closed again.

Two tips on MuJoCo's slides, late, lagging, scaled and rubbing, none of which is told. First they
are shaken with rates of several sines and recorded (``observation = "tracking"``); the diagnosis
gives the :class:`~plumbline.optim.capsule_mpc.settings.Plant`. Then the controller follows paths
that pass close by, on a plant without fault, on this one untold, and on this one told. Of the error
that the faults add, the share that is gone:

.. math:: 1 - \frac{e_{told} - e_{ideal}}{e_{untold} - e_{ideal}}

``python -m plumbline.experiments.mpc.tracked --seed 0``
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.mpc.closed_loop import M, judged, obstacles_at, statement_of
from plumbline.experiments.reality.instruments import Instruments, Mismatch, Slides, SlidingTips
from plumbline.experiments.reality.task import Scenario, Swing
from plumbline.optim import capsule_mpc as mpc
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.tracking import build_tracking

DT, SUBSTEPS = 0.02, 20  # [s] of a step, and its parts of a millisecond
SHAKEN = 30.0  # [s] of the recording
FOLLOWED, SETTLED = 12.0, 1.0  # [s] of a path, and until its errors count
FAST = 60.0  # [mm/s] of a tip
MIDDLE = np.array([[-12.0, -4.0, -112.0], [12.0, 4.0, -105.0]])  # of the paths [mm]
AHEAD = 10  # steps of a path that are told beyond the horizon: a late plant is led by them
NEAR = (6.0, 9.0)  # [mm] between the capsules where a path brings them closest
ROOM = np.array([12.0, 14.0, 10.0])  # of a path about its middle [mm]
KIT = Instruments(
    np.array([[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]]), np.full(2, 250.0), np.full(2, 2.5)
)
SPHERE = Swing(np.tile([0.0, 34.0, -80.0], (2, 1)), 5.0, np.zeros(3))


@dataclass(frozen=True)
class Followed:
    """What came of a path."""

    error: float  # root mean square distance of a tip from where it should be [mm]
    clearance: float  # least of all capsules at every millisecond, by coal [mm]


@dataclass(frozen=True)
class Tracked:
    """One plant: what was found of it, and three closed loops by what the controller knew."""

    answer: MotionDiagnosis
    ideal: Followed
    untold: Followed
    told: Followed

    @property
    def gone(self) -> float:
        """Share of the error that the plant's faults add which is gone once they are known."""
        return 1 - (self.told.error - self.ideal.error) / (self.untold.error - self.ideal.error)


def drawn(rng: np.random.Generator, across: float = 0.0) -> Slides:
    """Faults of six axes: what is late is so for all, gains and friction are an axis' own."""
    return Slides(
        delay=float(rng.uniform(0.04, 0.1)),
        lag=rng.uniform(0.03, 0.08) * rng.uniform(0.9, 1.1, 6),
        gain=rng.uniform(-0.06, 0.06, 6),
        band=rng.uniform(0.05, 0.2, 6) * FAST,
        measured=0.05,
        across=across,
    )


def shaken(wrong: Slides, rng: np.random.Generator, seconds: float = SHAKEN) -> MotionRecording:
    """A recording of both tips under rates of several sines."""
    tips = SlidingTips(MIDDLE, wrong, DT, SUBSTEPS, rng)
    t = np.arange(0.0, seconds, DT)
    f, phase = rng.uniform(0.1, 2.0, (4, 6)), rng.uniform(0.0, 2 * np.pi, (4, 6))
    rate = FAST / 4 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    seen = []
    for row in rate:
        seen.append(tips.measure().ravel())
        tips.move(row.reshape(-1, 3))
    return build_tracking(time=t, rate=M * rate, x=M * np.array(seen), name="shaken")


def path(seed: int, count: int) -> Array:
    """Where both tips should be at so many steps (T, 2, 3) [mm]; shafts pass close by."""
    t = DT * np.arange(count)[:, None, None, None]
    for attempt in range(1000):
        rng = np.random.default_rng([seed, 1, attempt])
        f, phase = rng.uniform(0.08, 0.35, (2, 2, 3)), rng.uniform(0.0, 2 * np.pi, (2, 2, 3))
        waves = np.sin(2 * np.pi * f * t + phase).sum(axis=1)
        wanted = np.asarray(MIDDLE + ROOM / 2 * waves)
        ends = KIT.shafts(wanted)
        ball = np.broadcast_to(SPHERE.ends, (len(wanted), 1, 2, 3))
        touch = _scenario(wanted, seed).touch()
        if NEAR[0] <= touch.least(np.concatenate([ends, ball], axis=1)).clearance <= NEAR[1]:
            return wanted
    raise PlumblineError(f"seed {seed}: no path keeps {NEAR[0]:g} to {NEAR[1]:g} mm; take another")


def _scenario(wanted: Array, seed: int) -> Scenario:
    return Scenario("tracked", seed, KIT, wanted[0], wanted[-1], (SPHERE,), Mismatch())


def followed(
    planner: mpc.Planner, wrong: Slides, plant: mpc.Plant, seed: int, seconds: float = FOLLOWED
) -> Followed:
    """Follow a path on a plant, of which the controller knows what it is told."""
    steps, p = round(seconds / DT), 10
    wanted = path(seed, steps + p + AHEAD + 1)
    scenario = _scenario(wanted, seed)
    noise = mpc.Noise(measured=M * wrong.measured, bias=plant.bias(M * FAST, 10 * M * FAST))
    statement = statement_of(scenario, mpc.Settings(p=p, dt=DT, noise=noise), FAST)
    controller = mpc.Controller(statement, planner, mpc.Safety(budget=1.0, plant=plant))
    tips = SlidingTips(wanted[0], wrong, DT, SUBSTEPS, np.random.default_rng([seed, 2]))
    way, off = [wanted[:1]], []
    for k in range(steps):
        off.append(tips.tips - wanted[k])
        goals = M * wanted[k + 1 : k + 1 + p + AHEAD].reshape(p + AHEAD, -1)
        seen = M * tips.measure().ravel()
        command = controller.step(seen, goals, obstacles_at(scenario, k * DT))
        way.append(tips.move(command.rate.reshape(-1, 3) / M))
    late = np.array(off)[round(SETTLED / DT) :]
    error = float(np.sqrt(np.mean(np.sum(late**2, axis=-1))))
    return Followed(error, judged(scenario, np.concatenate(way), DT))


@lru_cache
def recorded(seed: int, across: float = 0.0) -> tuple[Slides, MotionDiagnosis]:
    """A plant, and what is found of its recording."""
    rng = np.random.default_rng(seed)
    wrong = drawn(rng, across)
    return wrong, diagnose_motion(shaken(wrong, rng))


def track(
    seed: int, planner: mpc.Planner, seconds: float = FOLLOWED, across: float = 0.0
) -> Tracked:
    """Record and diagnose a plant, and follow a path without and with what was found."""
    wrong, answer = recorded(seed, across)
    ideal = Slides(measured=wrong.measured)
    three = [(ideal, mpc.Plant()), (wrong, mpc.Plant()), (wrong, mpc.Plant.of(answer))]
    runs = [followed(planner, slides, plant, seed, seconds) for slides, plant in three]
    return Tracked(answer, *runs)


@as_command
def bench(
    seed: Annotated[int, typer.Option(min=0, help="Of the first plant.")] = 0,
    count: Annotated[int, typer.Option(min=1, help="Plants.")] = 5,
    across: Annotated[
        float, typer.Option(help="Share of a rate that the next axis does too.")
    ] = 0.0,
) -> Found:
    """Compare closed loops whose controller knows its plant with some that do not."""

    def line(name: str, planner: mpc.Planner, number: int) -> dict[str, object]:
        t = track(number, planner, across=across)
        errors = {knows: getattr(t, knows).error for knows in ("ideal", "untold", "told")}
        least = min(t.untold.clearance, t.told.clearance)
        return {"planner": name, "plant": number, **errors, "gone": t.gone, "clearance": least}

    planners: dict[str, mpc.Planner] = {"one step": mpc.OneStep(), "horizon": mpc.RealTime()}
    lines = [
        line(name, planner, number)
        for name, planner in planners.items()
        for number in range(seed, seed + count)
    ]
    return {"errors and least clearance [mm]": pd.DataFrame(lines)}


if __name__ == "__main__":
    typer.run(bench)
