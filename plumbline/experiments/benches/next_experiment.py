r"""Designed rows against rows at random.

``python -m plumbline.experiments.benches.next_experiment``

A withheld case is recorded and diagnosed. Where that leaves doubt, the same reality is read twelve
more times: at the rows that the diagnosis asks for, at D-optimal rows, and at ever more rows at
random; each longer recording is diagnosed afresh. What counts is the probability that the verdict
gives to the true cause, on average over the cases: how many random rows do what twelve designed
ones do? One reading of a dozen rows is mostly luck, so each is read several times, the random rows
drawn anew each time. Intervals are those of a bootstrap over the cases.
"""

from __future__ import annotations

import json as json_module
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import typer

from plumbline.experiments.reality import Case, Plan, draw_case, simulate, write
from plumbline.experiments.reality import Recording as Tables
from plumbline.experiments.reality.more import extended, read_on
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.design.explanations import contest, explanations
from plumbline.optim.diagnosis.design.future_rows import FutureRows
from plumbline.optim.diagnosis.design.next_experiment import next_experiment
from plumbline.optim.diagnosis.design.rows import Design, DesignOptions
from plumbline.optim.diagnosis.design.separation import AtRandom, Criterion, DOptimal, Resolution
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

ROWS = 12
RANDOM = (12, 30, 60)
RESAMPLES = 2000
DESIGNED: tuple[Criterion, ...] = (Resolution(), DOptimal())


@dataclass(frozen=True)
class Outcome:
    """One case."""

    seed: int  # of the case
    truth: tuple[str, int | None]  # the true cause: effect and element
    rows: int  # rows of the first recording
    listed: bool  # whether the truth was among the explanations that the rows were to separate
    before: float  # probability of the truth after these
    # probability of the truth after more rows, by how they were chosen; mean of readings
    after: dict[str, float]


def loaded(tables: Tables) -> Recording:
    """A recording, by way of its files."""
    with tempfile.TemporaryDirectory(prefix="plumbline-next-") as scratch:
        folder = Path(scratch) / "case"
        write(folder, tables)
        return load_recording(folder)


def with_rows(case: Case, before: Recording, rows: FutureRows, reading: int = 0) -> Recording:
    """The recording that goes on with these rows, spread over its groups."""
    sockets = None if rows.socket is None else rows.socket - 1
    more = extended(
        case,
        rows.q,
        direction=rows.direction,
        velocity=rows.velocity if case.moving else None,
        wait=rows.wait,
        group=rows.groups(before),
        sockets=sockets,
    )
    return loaded(read_on(case, more, reading))


def probability(diagnosis: Diagnosis, case: Case) -> float:
    """What the verdict gives to the true cause."""
    truth = case.effects[0]
    named = [c for c in diagnosis.verdict.candidates if c.effect == truth.effect]
    return max((c.probability for c in named if c.element == truth.element), default=0.0)


def outcome(seed: int, plan: Plan, readings: int = 1) -> Outcome | None:
    """One case; None where the first recording leaves nothing to separate."""
    case = draw_case(plan, f"case-{seed:04d}", seed)
    recording = loaded(simulate(case)[0])
    first = diagnose(recording)
    if not next_experiment(first.selected, first.verdict, DesignOptions(compare=False)).rows:
        return None
    designed = {c.name: chosen(first, DesignOptions(count=ROWS, criterion=c)) for c in DESIGNED}
    after: dict[str, list[float]] = {}
    for reading in range(1, readings + 1):
        for name, rows in (designed | _at_random(first, seed + reading)).items():
            diagnosis = diagnose(with_rows(case, recording, rows, reading))
            after.setdefault(name, []).append(probability(diagnosis, case))
    truth = (case.effects[0].effect, case.effects[0].element)
    rivals = explanations(first.selected, DesignOptions().rivals)
    listed = any(truth in e.keys for e in rivals)
    means = {name: float(np.mean(values)) for name, values in after.items()}
    return Outcome(seed, truth, case.rows, listed, probability(first, case), means)


def _at_random(first: Diagnosis, seed: int) -> dict[str, FutureRows]:
    """Ever more rows at random, each number the first of one order."""
    options = DesignOptions(count=max(RANDOM), criterion=AtRandom(seed), patience=0.0, exchanges=0)
    many = chosen(first, options)
    return {f"random {count}": many.select(slice(0, count)) for count in RANDOM}


def chosen(first: Diagnosis, options: DesignOptions) -> FutureRows:
    """Rows chosen on the strength of a diagnosis."""
    rivals = explanations(first.selected, options.rivals)
    return Design.of(contest(first.selected, rivals), options).choose().rows


def as_good_as(curve: Sequence[float], target: float) -> float:
    """How many random rows reach a mean probability, between the counts that were tried.

    Infinity where even the most do not reach it.
    """
    counts = (0, *RANDOM)
    for k in range(1, len(counts)):
        if curve[k] >= target:
            rise = curve[k] - curve[k - 1]
            share = 1.0 if rise <= 0.0 else max(target - curve[k - 1], 0.0) / rise
            return counts[k - 1] + share * (counts[k] - counts[k - 1])
    return float("inf")


@dataclass(frozen=True)
class Summary:
    """The figure asked for, and what it rests on; intervals are of 95 %."""

    cases: int  # how many cases
    listed: float  # share of them in which the truth was among the explanations to be separated
    before: float  # mean probability of the truth before any more rows
    after: dict[str, float]  # mean probability of the truth, by how the rows were chosen
    intervals: dict[str, tuple[float, float]]  # its intervals
    # by how much designed rows beat as many random ones, with its interval
    gain: tuple[float, float, float]
    # how many random rows do what the designed ones do; None beyond those tried
    random_rows: float | None
    random_rows_low: float | None  # lower end of its interval; None beyond those tried
    share_of_30: float  # share of the resamples in which it is 30 or more


def summary(outcomes: Sequence[Outcome], seed: int = 0) -> Summary:
    """Means and bootstrap intervals over the cases."""
    names = [*(c.name for c in DESIGNED), *(f"random {n}" for n in RANDOM)]
    table = np.array([[o.before, *(o.after[name] for name in names)] for o in outcomes])
    rng = np.random.default_rng(seed)
    draws = table[rng.integers(0, len(table), (RESAMPLES, len(table)))].mean(axis=1)
    random = [0, *(1 + names.index(f"random {n}") for n in RANDOM)]
    designed = 1 + names.index(DESIGNED[0].name)
    needed = np.array([as_good_as(d[random].tolist(), float(d[designed])) for d in draws])
    mean = table.mean(axis=0)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    ends = zip(low[1:].tolist(), high[1:].tolist(), strict=True)
    worth = float(mean[designed] - mean[random[1]])
    least, most = np.quantile(draws[:, designed] - draws[:, random[1]], [0.025, 0.975]).tolist()
    return Summary(
        cases=len(outcomes),
        listed=float(np.mean([o.listed for o in outcomes])),
        before=float(mean[0]),
        after=dict(zip(names, mean[1:].tolist(), strict=True)),
        intervals=dict(zip(names, ends, strict=True)),
        gain=(worth, least, most),
        random_rows=_finite(as_good_as(mean[random].tolist(), float(mean[designed]))),
        random_rows_low=_finite(float(np.quantile(needed, 0.025, method="lower"))),
        share_of_30=float(np.mean(needed >= 30.0)),
    )


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def bench(
    cases: Annotated[int, typer.Option(min=1, help="How many cases to try.")] = 60,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first case.")] = 1000,
    gap: Annotated[tuple[float, float], typer.Option(help="Gap over noise.")] = (0.4, 1.0),
    rows: Annotated[tuple[int, int], typer.Option(help="Rows of a recording.")] = (30, 60),
    readings: Annotated[int, typer.Option(min=1, help="Readings of each choice of rows.")] = 3,
    minutes: Annotated[float, typer.Option(help="Begin no case after so long.")] = 1e9,
    json: Annotated[Path | None, typer.Option(help="Kept up to date; resumed from.")] = None,
) -> None:
    """Measure what designed rows are worth."""
    plan, begun = Plan(gap=gap, rows=rows), perf_counter()
    done: dict[str, dict[str, Any] | None] = {}
    if json is not None and json.exists():
        done = json_module.loads(json.read_text(encoding="utf-8"))
    for seed in range(first, first + cases):
        if str(seed) in done or perf_counter() - begun > 60.0 * minutes:
            continue
        found = outcome(seed, plan, readings)
        done[str(seed)] = None if found is None else asdict(found)
        if json is not None:
            json.write_text(json_module.dumps(done, indent=1), encoding="utf-8")
        sys.stderr.write(f"{seed}: {found}\n")
    outcomes = [restored(entry) for entry in done.values() if entry is not None]
    if not outcomes:
        typer.echo("no case left anything to separate")
        raise typer.Exit(1)
    typer.echo(json_module.dumps(asdict(summary(outcomes)), indent=1))


def restored(entry: dict[str, Any]) -> Outcome:
    """An outcome as it was written to a file."""
    effect, element = entry["truth"]
    return Outcome(**entry | {"truth": (effect, element)})


if __name__ == "__main__":
    typer.run(bench)
