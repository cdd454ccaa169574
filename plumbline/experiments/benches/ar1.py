r"""Is anything told where only the noise is not white?

``python -m plumbline.experiments.benches.ar1 [--count N] [--seed S]``

Arms with nothing wrong, read by a device whose noise has the size that is stated and is

- ``understated``: half as large again;
- ``drift``: a slow wander along the clock, :math:`n_k = \rho n_{k-1} + \sqrt{1 - \rho^2}\, \sigma
  u_k`, :math:`\rho = 0.9`;
- ``readings``: five readings of each posture that share nine tenths of their variance;
- ``copies``: one reading of each posture, written down five times.

Where nothing is wrong nothing may be told. Copies are also made of arms with one cause: five copies
of a reading know what the reading knows, and the answer must be the same.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from plumbline.experiments.benches import asking
from plumbline.experiments.console.measured import Found
from plumbline.experiments.reality import Case, Plan, draw_case
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.recorder import simulate
from plumbline.experiments.reality.scene import Scene, measured
from plumbline.optim.core.quantities import Share
from plumbline.optim.recording.recording import Recording

CORRELATION = 0.9  # of neighbours along the clock, and of the readings of one posture
REPEATS = 5  # readings, or copies, of each posture
APART = 0.1  # of two probabilities of the same cause that are said to be the same


def wander(rows: int, rng: np.random.Generator) -> Array:
    """AR(1) noise (rows, 3) of unit variance, stationary from its first row."""
    fresh = rng.normal(size=(rows, 3))
    noise = fresh.copy()
    for k in range(1, rows):
        noise[k] = CORRELATION * noise[k - 1] + np.sqrt(1.0 - CORRELATION**2) * fresh[k]
    return noise


def shared(rows: int, rng: np.random.Generator) -> Array:
    """Noise (rows, 3) of unit variance of which each posture's readings share nine tenths."""
    common = np.repeat(rng.normal(size=(-(-rows // REPEATS), 3)), REPEATS, axis=0)[:rows]
    own = rng.normal(size=(rows, 3))
    return np.asarray(np.sqrt(CORRELATION) * common + np.sqrt(1.0 - CORRELATION) * own)


def white(rows: int, rng: np.random.Generator) -> Array:
    """Independent noise (rows, 3) of unit variance."""
    return rng.normal(size=(rows, 3))


def repeated(scene: Scene, times: int) -> Scene:
    """As many rows, each posture visited so many times in a row, the clock running on."""
    session = scene.session
    again = np.repeat(np.arange(session.rows), times)[: session.rows]
    still = replace(session, q=session.q[again], direction=session.direction[again])
    return Scene.ideal(scene.arm, still, scene.tool[0], scene.device)


def recorded(case: Case, noise: Array, copies: int = 1) -> Recording:
    """A case's readings with a noise (N, 3) of unit variance, each row written so often."""
    tables = simulate(case)[0]
    points = measured(case.scene, case.effects) + case.noise_std * noise
    columns = tables.columns | dict(zip("xyz", points.T, strict=True))
    columns = {name: np.repeat(values, copies) for name, values in columns.items()}
    return asking.loaded(replace(tables, columns=columns))


def clean(number: int, seed: int, kind: str = "none", rows: tuple[int, int] = (60, 140)) -> Case:
    """An arm at work with nothing wrong, or with one cause."""
    plan = Plan(kind, rows=rows, moving=0.0, gap=(1.0, 2.0))
    return draw_case(plan, f"{kind}-{number}", seed * 1_000_003 + number)


NOISES: dict[str, Callable[[Case, np.random.Generator], Recording]] = {
    "white": lambda case, rng: recorded(case, white(case.rows, rng)),
    "understated": lambda case, rng: recorded(case, 1.5 * white(case.rows, rng)),
    "drift": lambda case, rng: recorded(case, wander(case.rows, rng)),
    "readings": lambda case, rng: recorded(
        replace(case, scene=repeated(case.scene, REPEATS)), shared(case.rows, rng)
    ),
    "copies": lambda case, rng: recorded(case, white(case.rows, rng), REPEATS),
}
ROWS = {"copies": (20, 40)}  # postures of what is written five times


def told(name: str, ask: asking.Asked, count: int, seed: int) -> dict[str, Any]:
    """Ask about arms with nothing wrong: of how many something was told, and how surely."""
    wrong = sure = 0
    for number in asking.counted(range(count), name):
        rng = np.random.default_rng([seed, number, 29])
        case = clean(number, seed, rows=ROWS.get(name, (60, 140)))
        verdict = ask(NOISES[name](case, rng))
        wrong += verdict["verdict"] != "no-gap"
        sure += asking.surest(verdict) > asking.SURE
    wrongly, surely = (Share.count_of(hits, count) for hits in (wrong, sure))
    return {"noise": name, "told of a gap": wrongly, "more than 95 % sure": surely}


def otherwise(ask: asking.Asked, count: int, seed: int) -> Share:
    """Of arms with one cause: five copies of each reading against one."""
    different = 0
    for number in asking.counted(range(count), "copies of one cause"):
        rng = np.random.default_rng([seed, number, 31])
        case = clean(number, seed, "single")
        noise = white(case.rows, rng)
        different += unlike(*(ask(recorded(case, noise, copies)) for copies in (1, REPEATS)))
    return Share.count_of(different, count)


def unlike(one: asking.Verdict, other: asking.Verdict) -> bool:
    """Whether two verdicts say different things, or the same with another probability."""
    said = [
        {(str(c["effect"]), c["element"]): float(c["probability"]) for c in verdict["causes"]}
        for verdict in (one, other)
    ]
    if one["verdict"] != other["verdict"] or set(said[0]) != set(said[1]):
        return True
    return any(abs(said[0][key] - said[1][key]) > APART for key in said[0])


def found(ask: asking.Asked, count: int, seed: int) -> Found:
    """Measure all of it."""
    return {
        "nothing wrong": pd.DataFrame([told(name, ask, count, seed) for name in NOISES]),
        "copies told otherwise than one reading, of arms with one cause": otherwise(
            ask, count, seed
        ),
    }


if __name__ == "__main__":
    WORDS = "Count what is told of arms with nothing wrong, by the kind of noise."
    asking.run_bench(found, WORDS, 50)
