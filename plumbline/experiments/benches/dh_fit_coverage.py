"""Coverage of the link fit.

``python -m plumbline.experiments.benches.dh_fit_coverage [--draws N]``

Arms whose links, joints and tools are wrong, before a device that sees depth four times worse than
its other axes, joints that give way under the arm's weight, and a few gross rows: none of it is in
the fit's model. Each reported sum's interval of 95 % is held against the truth of that sum.
"""

from collections import defaultdict
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality.arm import Arm
from plumbline.experiments.reality.arms import bh7, ur5
from plumbline.experiments.reality.tip_readings import Crooked, Reality, draw_crooked
from plumbline.optim.dh_fit import DHFit, DHOptions, Norms, Squares, fit_dh
from plumbline.optim.dh_fit.losses import Loss
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording

TOOL = np.array([0.03, -0.02, 0.15])  # [m]
PLAIN = Reality()
UNLIKE = Reality(depth=4.0, compliance=1e-6, gross=3)
SOFT = replace(UNLIKE, compliance=1e-5)
REALITIES = {"as the model has it": PLAIN, "unlike": UNLIKE, "unlike, ten times as soft": SOFT}
LOSSES: dict[str, Loss] = {"norms": Norms(), "squares": Squares()}


def recording_of(arm: Arm, drawn: Crooked, noise: float | None) -> Recording:
    """A draw as a recording of the bundled arm, its noise stated or not."""
    return build_recording(
        observation="tip_position",
        robot=arm.bundled or arm.name,
        q=drawn.q,
        measured=drawn.measured,
        tip_frame=arm.tip_frame,
        tool_offset=drawn.nominal_tool,
        noise_std=noise,
    )


def holds(fit: DHFit, truth: dict[str, float]) -> dict[tuple[str, bool], bool]:
    """Whether each interval holds its sum's truth, by what leads it and whether it is alone."""
    found = {}
    for q in fit.quantities:
        true = q.nominal + sum(c * truth[name] for name, c in q.parts)
        found[q.parts[0][0], q.alone] = q.ci95[0] <= true <= q.ci95[1]
    return found


def measured(
    arm: Arm, name: str, stated: bool, loss: str, draws: int, rows: int, seed: int
) -> tuple[dict[str, Any], pd.DataFrame]:
    """One case: shares in per cent, and those of every sum of the fit.

    Named are gross rows; false are recordings with a row named that is not gross; said are those
    of which it is said that links are not the whole cause.
    """
    reality, held = REALITIES[name], defaultdict(list)
    named = gross = false = doubted = 0
    for k in range(draws):
        rng = np.random.default_rng([seed, k])
        drawn = draw_crooked(arm, reality, rows, rng, tool=TOOL)
        recording = recording_of(arm, drawn, reality.noise if stated else None)
        fit = fit_dh(recording, DHOptions(loss=LOSSES[loss]))
        for key, inside in holds(fit, drawn.truth).items():
            held[key].append(inside)
        named, gross = named + int(fit.gross[drawn.gross].sum()), gross + int(drawn.gross.sum())
        false += bool(fit.gross[~drawn.gross].any())
        doubted += any("not the (whole) cause" in remark for remark in fit.remarks)
    about = {"arm": arm.name, "reality": name, "noise": "stated" if stated else "not", "loss": loss}
    sums = pd.DataFrame([
        about | {"led by": lead if alone else f"{lead} + ...", "reported": len(inside),
                 "held": 100 * np.mean(inside)}
        for (lead, alone), inside in held.items()
    ])  # fmt: skip
    often = sums[sums["reported"] >= draws // 10]["held"]
    every = [inside for several in held.values() for inside in several]
    return about | {
        "held": 100 * np.mean(every), "least": often.min(), "most": often.max(),
        "named": 100 * named / gross if gross else np.nan, "false": 100 * false / draws,
        "said": 100 * doubted / draws,
    }, sums  # fmt: skip


@as_command
def coverage(
    draws: Annotated[int, typer.Option(min=1, help="Recordings a case.")] = 300,
    rows: Annotated[int, typer.Option(min=15, help="Rows a recording.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> Found:
    """Measure how often intervals hold the truth, in realities unlike the model."""
    norms = [(arm, n, s, "norms") for arm in (ur5(), bh7()) for n in REALITIES for s in (0, 1)]
    # Squares take gross rows at their word: they are judged without.
    plain = [(ur5(), "as the model has it", s, "squares") for s in (0, 1)]
    found = [
        measured(arm, name, bool(s), loss, draws, rows, seed)
        for arm, name, s, loss in (*norms, *plain)
    ]
    return {
        "intervals of 95 % that hold the truth, %": pd.DataFrame([case for case, _ in found]),
        "sum by sum": pd.concat([sums for _, sums in found]),
    }


if __name__ == "__main__":
    typer.run(coverage)
