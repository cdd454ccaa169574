"""Does one verdict on several recordings say more than a verdict on each?

``python -m plumbline.experiments.benches.several [--sessions N] [--rows N]``

*Drawn sessions.* One simulated arm with one cause, recorded three times: its tip in a surgical box
by one tracker, its pose there by another, its joints by second encoders, each with a device, tool
and postures of its own. A verdict is right if its causes are the truth alone, effect and element;
sure and wrong if it gives another one more than 0.95.

*A real arm.* Three series of a UR10, each asked alone and all together: what is left of the rows
that were left out.
"""

from dataclasses import replace
from time import process_time
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.benches.asking import SURE, fetched, label, loaded, thinned
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality import Plan, draw_case, simulate
from plumbline.experiments.reality.draws import draw
from plumbline.experiments.reality.gap import scaled
from plumbline.experiments.reality.recorder import Case
from plumbline.optim.diagnosis.of_any_kind import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.recording import Recording

ARM = "ur5"
KINDS = {"tips": "tip_position", "poses": "pose", "encoders": "joint_position"}
CAUSES = ("joint_scale", "joint_offset", "transmission_ripple", "joint_compliance", "sensor_scale")
GAP = 2.0  # unabsorbed gap of the cause in the tips, over their noise
ALL = "all together"
SERIES = ("ur10-grid", "ur10-joints", "ur10-iso")


def drawn_session(seed: int, rows: int = 100) -> tuple[list[Recording], str]:
    """Recordings of one arm with one cause, and the cause as a label."""
    rng = np.random.default_rng([seed, 11])
    sized = None
    while sized is None:
        name, first = str(rng.choice(CAUSES)), int(rng.integers(2**31))
        cases = [_case(k, told, first, rows) for k, told in enumerate(KINDS)]
        scene, target = cases[0].scene, GAP * cases[0].noise_std
        sized = scaled(scene, draw(name, scene, rng), target, KINDS["tips"])
    found = []
    for case in cases:
        seen = case.name != "encoders" or name != "sensor_scale"
        at_work = replace(case, effects=(sized,), gap_to_noise=(GAP,)) if seen else case
        found.append(loaded(simulate(at_work)[0]))
    return found, label((name, sized.element))


def _case(k: int, told: str, first: int, rows: int) -> Case:
    """A recording of the arm in a surgical box, nothing wrong yet."""
    box = Plan(
        "none", rows=(rows, rows), observation=KINDS[told], arms=(ARM,), surgical=1.0, moving=0.0
    )
    return draw_case(box, told, first + k)


def scored(sessions: int, seed: int) -> pd.DataFrame:
    """Each recording alone, and all of them; seconds are of one core, in the mean."""
    said = []
    for k in range(sessions):
        parts, truth = drawn_session(seed + k)
        asked = [[part] for part in parts] + [parts]
        for name, which in zip((*KINDS, ALL), asked, strict=True):
            begun = process_time()
            causes = diagnose(which, DiagnosisOptions(force=True)).causes
            seconds = process_time() - begun
            named = {label((c.effect, c.element)): c.probability for c in causes}
            wrong = any(p > SURE for cause, p in named.items() if cause != truth)
            said.append((name, set(named) == {truth}, wrong, seconds))
    table = pd.DataFrame(said, columns=["asked", "right", "sure and wrong", "seconds"])
    return table.groupby("asked", sort=False, as_index=False).agg(
        sessions=("right", "size"), right=("right", "sum"),
        sure_and_wrong=("sure and wrong", "sum"), seconds=("seconds", "mean"),
    )  # fmt: skip


def series(rows: int) -> pd.DataFrame:
    """RMS left of rows left out [mm]: each series of the UR10 alone, and all of them."""
    parts = [thinned(r, rows) for r in fetched(SERIES)]
    alone = [diagnose(part).gap.after for part in parts]
    together = diagnose(parts).verdict.recordings
    return pd.DataFrame([
        {"series": r.name, "rows": r.rows, "before": 1e3 * r.before, "alone": 1e3 * one,
         "together": 1e3 * r.after, "causes of the others alone": 1e3 * r.without_it}
        for r, one in zip(together, alone, strict=True)
    ])  # fmt: skip


@as_command
def bench(
    sessions: Annotated[int, typer.Option(min=0, help="Drawn sessions.")] = 20,
    rows: Annotated[int, typer.Option(min=0, help="Rows of each UR10 series; 0: none.")] = 150,
    seed: Annotated[int, typer.Option(min=0, help="Of the first drawn session.")] = 0,
) -> Found:
    """Ask recordings one by one and all at once."""
    found = {"drawn sessions": scored(sessions, seed)} if sessions else {}
    return found | ({"RMS of rows left out [mm]": series(rows)} if rows else {})


if __name__ == "__main__":
    typer.run(bench)
