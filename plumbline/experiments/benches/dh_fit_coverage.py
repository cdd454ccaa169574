"""Coverage of the link fit.

``python -m plumbline.experiments.benches.dh_fit_coverage [--draws N]``

Arms whose links, joints and tools are wrong, before a device that sees depth four times worse than
its other axes, joints that give way under the arm's weight, and a few gross rows: none of it is in
the fit's model. Each reported sum's interval of 95 % is held against the truth of that sum.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from plumbline.experiments.benches import tell
from plumbline.experiments.console.outputs import Json
from plumbline.experiments.reality.arm import Arm
from plumbline.experiments.reality.arms import bh7, ur5
from plumbline.experiments.reality.crooked import Crooked, Reality, draw_crooked
from plumbline.optim.core.shares import Share
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


@dataclass(frozen=True)
class Covered:
    """One reported sum: what leads it, and how often its interval held the truth."""

    led_by: str
    alone: bool
    held: Share


@dataclass(frozen=True)
class Case:
    """One arm in one reality, its noise stated or not."""

    arm: str  # the arm
    reality: str  # what is unlike the model
    stated: bool  # whether the noise was stated
    loss: str  # what a misfit costs
    held: Share  # all sums together
    sums: tuple[Covered, ...]  # each sum
    named: Share  # gross rows that were named
    false: Share  # recordings in which a row was named that is not gross
    doubted: Share  # recordings of which it was said that links are not the whole cause


@dataclass(frozen=True)
class Coverage:
    """All that was measured; names of the fields are the keys of the JSON."""

    draws: int
    rows: int
    cases: tuple[Case, ...]


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
) -> Case:
    """One case."""
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
    sums = tuple(
        Covered(lead, alone, Share.count_of(sum(inside), len(inside)))
        for (lead, alone), inside in held.items()
    )
    every = [inside for several in held.values() for inside in several]
    return Case(
        arm.name,
        name,
        stated,
        loss,
        Share.count_of(sum(every), len(every)),
        sums,
        Share.count_of(named, gross),
        Share.count_of(false, draws),
        Share.count_of(doubted, draws),
    )


def tables(found: Coverage) -> list[Table]:
    """Coverage of all cases, then of each sum."""
    first = Table(
        "arm", "reality", "noise", "loss", "held", "least", "most", "named", "false", "said"
    )
    first.title = (
        f"Intervals of 95 % that hold the truth, %; {found.draws} draws of {found.rows} rows"
    )
    first.caption = (
        "least, most: over the sums; named: gross rows; false: recordings with a row named that is "
        "not gross; said: recordings of which it is said that links are not the whole cause"
    )
    each: list[Table] = []
    for c in found.cases:
        shares = [s.held.value or 0.0 for s in c.sums if s.held.of >= found.draws // 10]
        about = (c.arm, c.reality, "stated" if c.stated else "not stated", c.loss)
        counts = (c.held.value, min(shares), max(shares), c.named.value, c.false.value)
        cells = ["" if v is None else f"{100 * v:.1f}" for v in (*counts, c.doubted.value)]
        first.add_row(*about, *cells)
        table = Table("sum led by", "reported", "held, %")
        table.title = ", ".join(about)
        for s in c.sums:
            label = s.led_by if s.alone else f"{s.led_by} + ..."
            table.add_row(label, f"{s.held.of}", f"{100 * (s.held.value or 0.0):.1f}")
        each.append(table)
    return [first, *each]


def coverage(
    draws: Annotated[int, typer.Option(min=1, help="Recordings a case.")] = 300,
    rows: Annotated[int, typer.Option(min=15, help="Rows a recording.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    json: Json = None,
) -> None:
    """Measure how often intervals hold the truth, in realities unlike the model."""

    def measure() -> Coverage:
        norms = [(arm, n, s, "norms") for arm in (ur5(), bh7()) for n in REALITIES for s in (0, 1)]
        # Squares take gross rows at their word: they are judged without.
        plain = [(ur5(), "as the model has it", s, "squares") for s in (0, 1)]
        cases = [
            measured(arm, name, bool(s), loss, draws, rows, seed)
            for arm, name, s, loss in (*norms, *plain)
        ]
        return Coverage(draws, rows, tuple(cases))

    tell(measure, tables, json)


if __name__ == "__main__":
    typer.run(coverage)
