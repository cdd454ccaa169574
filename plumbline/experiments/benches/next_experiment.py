r"""Designed rows against rows at random.

``python -m plumbline.experiments.benches.next_experiment``

A withheld case is recorded and diagnosed. Where that leaves doubt, the same reality is read twelve
more times, at the rows that the diagnosis asks for and at ever more rows at random; each longer
recording is diagnosed afresh. What counts is the probability that the verdict gives to the true
cause, on average over the cases: how many random rows do what twelve designed ones do? One reading
of a dozen rows is mostly luck, so each is read several times, the random rows drawn anew each time.
Intervals are those of a bootstrap over the cases.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.benches.asking import counted, label, loaded
from plumbline.experiments.console.measured import Found, as_command
from plumbline.experiments.reality import Case, Plan, draw_case, simulate
from plumbline.experiments.reality.recorder import extended, read_on
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.design.explanations import contest, explanations
from plumbline.optim.diagnosis.design.future_rows import FutureRows
from plumbline.optim.diagnosis.design.next_experiment import next_experiment
from plumbline.optim.diagnosis.design.rows import Design, DesignOptions
from plumbline.optim.diagnosis.design.separation import at_random
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.recording.recording import Recording

ROWS = 12  # that are designed: what the command proposes
RANDOM = (12, 30, 60)  # rows at random that they are held against
RESAMPLES = 2000  # of the cases: ends of an interval are known to a fiftieth of its width
DESIGNED = "designed"


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


def outcome(seed: int, plan: Plan, readings: int = 1) -> dict[str, Any] | None:
    """Probability of the truth of one case, by how rows were chosen, mean of so many readings.

    None where the first recording leaves nothing to separate. Listed says whether the truth was
    among the explanations that the rows were to separate.
    """
    case = draw_case(plan, f"case-{seed:04d}", seed)
    recording = loaded(simulate(case)[0])
    first = diagnose(recording)
    if not next_experiment(first.selected, first.verdict, DesignOptions(compare=False)).rows:
        return None
    designed = {DESIGNED: chosen(first, DesignOptions(count=ROWS))}
    after: dict[str, list[float]] = {}
    for reading in range(1, readings + 1):
        for name, rows in (designed | _at_random(first, seed + reading)).items():
            diagnosis = diagnose(with_rows(case, recording, rows, reading))
            after.setdefault(name, []).append(probability(diagnosis, case))
    truth = (case.effects[0].effect, case.effects[0].element)
    rivals = explanations(first.selected, DesignOptions().rivals)
    listed = any(truth in e.keys for e in rivals)
    means = {name: float(np.mean(values)) for name, values in after.items()}
    told = {"seed": seed, "truth": label(truth), "rows": case.rows, "listed": listed}
    return told | {"before": probability(first, case)} | means


def _at_random(first: Diagnosis, seed: int) -> dict[str, FutureRows]:
    """Ever more rows at random, each number the first of one order."""
    criterion = partial(at_random, seed)
    options = DesignOptions(count=max(RANDOM), criterion=criterion, patience=0.0, exchanges=0)
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


def summary(outcomes: pd.DataFrame, seed: int = 0) -> Found:
    """Means, and intervals of a bootstrap over the cases."""
    random = ["before", *(f"random {n}" for n in RANDOM)]
    names = [*random, DESIGNED]
    table = outcomes[names].to_numpy(dtype=float)
    rng = np.random.default_rng(seed)
    chosen_cases = rng.integers(0, len(table), (RESAMPLES, len(table)))
    draws = pd.DataFrame(table[chosen_cases].mean(axis=1), columns=names)
    draws["gain"] = draws[DESIGNED] - draws[f"random {ROWS}"]
    draws["random rows as good"] = [
        as_good_as(row[random].tolist(), float(row[DESIGNED])) for _, row in draws.iterrows()
    ]
    means = pd.Series(table.mean(axis=0), names)
    means["gain"] = means[DESIGNED] - means[f"random {ROWS}"]
    means["random rows as good"] = as_good_as(means[random].tolist(), float(means[DESIGNED]))
    ends = draws.quantile([0.025, 0.975], interpolation="lower").T
    told = pd.DataFrame({"mean": means, "low": ends[0.025], "high": ends[0.975]})
    return {
        "cases": len(outcomes),
        "truth listed, share": float(outcomes["listed"].mean()),
        "probability of the truth": told.rename_axis("rows").reset_index(),
        "share of resamples in which 30 random rows or more do as well": float(
            (draws["random rows as good"] >= 30.0).mean()
        ),
    }


@as_command
def bench(
    cases: Annotated[int, typer.Option(min=1, help="How many cases to try.")] = 60,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first case.")] = 1000,
    gap: Annotated[tuple[float, float], typer.Option(help="Gap over noise.")] = (0.4, 1.0),
    rows: Annotated[tuple[int, int], typer.Option(help="Rows of a recording.")] = (30, 60),
    readings: Annotated[int, typer.Option(min=1, help="Readings of each choice of rows.")] = 3,
    csv: Annotated[Path | None, typer.Option(help="Kept up to date; resumed from.")] = None,
) -> Found:
    """Measure what designed rows are worth."""
    plan = Plan(gap=gap, rows=rows)
    there = csv is not None and csv.exists()
    done: list[dict[Any, Any]] = pd.read_csv(str(csv)).to_dict("records") if there else []
    known = {line["seed"] for line in done}
    for seed in counted([s for s in range(first, first + cases) if s not in known], "case"):
        done.append(outcome(seed, plan, readings) or {"seed": seed})
        if csv is not None:
            pd.DataFrame(done).to_csv(csv, index=False)
    outcomes = pd.DataFrame(done)
    if "before" not in outcomes:
        raise PlumblineError(f"--cases {cases}: none left anything to separate; take more")
    return summary(outcomes.dropna(subset="before").astype({"listed": bool}))


if __name__ == "__main__":
    typer.run(bench)
