r"""The next experiment: rows that best tell the leading explanations of a recording apart.

Rows are chosen one after another from thousands within reach, each in the light of those chosen
before it; what a row is worth is a :class:`~optim.diagnosis.separation.Criterion`. The forecast
draws readings of these rows from every explanation and weighs the explanations anew by Bayes' rule;
rows at random are forecast in the same way until they are as good.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from optim.diagnosis.design import Design, Options
from optim.diagnosis.explanations import contest, explanations
from optim.diagnosis.future_rows import FutureRows
from optim.diagnosis.search import Found
from optim.diagnosis.separation import Beliefs, Rivals, expected_probabilities
from optim.diagnosis.verdict import Verdict
from optim.diagnosis.words import percent
from optim.problem import Array

SURE = 0.99  # probability of the leading explanation at which nothing is left to separate
TOLD_APART = 3.0  # divergence below which rows are no evidence (Jeffreys 1961, app. B)
DRAWS = 200
NEEDS = "needs the column "
COLUMNS = {
    "direction": "Record the side of the last approach (direction1, ...)",
    "velocity": "Record the joint velocities (velocity1, ...)",
    "time": "Record the time of every row",
    "temperature": "Record the temperature",
    "payload": "Record the mass carried (payload)",
}
RANDOM_COUNTS = (12, 18, 24, 30, 36, 48, 60, 80, 100)
ORDERS = 6


@dataclass(frozen=True)
class Suggestion:
    """One row to record.

    Attributes:
        pose: Joint readings (n,) [rad or m].
        direction: Side of the approach (n,): 1 from below, -1 from above; None if not recorded.
        velocity: Joint velocities (n,) [rad/s or m/s]; None if not recorded or standing.
        wait: Rest before the row [s]; None if the recording has no clock.
        payload: Mass to be carried [kg]; None if not recorded.
        socket: Socket that the tip rests in; None if there are none.
        separates: The two explanations that the row does most to tell apart.
    """

    pose: tuple[float, ...]
    direction: tuple[int, ...] | None
    velocity: tuple[float, ...] | None
    wait: float | None
    payload: float | None
    socket: int | None
    separates: tuple[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, without what the recording does not know of."""
        known = {k: v for k, v in asdict(self).items() if v is not None and k != "separates"}
        plain = {k: list(v) if isinstance(v, tuple) else v for k, v in known.items()}
        return plain | {"separates": " from ".join(self.separates)}


@dataclass(frozen=True)
class Forecast:
    """What the rows are expected to do, if the leading explanation is right.

    Attributes:
        leading: The leading explanation.
        before: Its probability now, among those compared.
        after: Its expected probability after the rows.
        random: The same after as many rows at random; None if not asked for.
        random_rows: How many rows at random do as well; None if more than were tried.
        overall: Expected probability of whichever explanation is right, after the rows.
    """

    leading: str
    before: float
    after: float
    random: float | None = None
    random_rows: int | None = None
    overall: float = float("nan")

    @property
    def words(self) -> str:
        """The forecast in a sentence or two."""
        said = (
            f"If {self.leading} is right, these rows are expected to raise its probability from "
            f"{percent(self.before)} to {percent(self.after)}."
        )
        if self.random is None:
            return said
        many = f"more than {RANDOM_COUNTS[-1]}" if self.random_rows is None else self.random_rows
        return (
            f"{said} As many rows at random would reach {percent(self.random)}; to do as well, "
            f"about {many} of them would be needed."
        )


@dataclass(frozen=True)
class NextExperiment:
    """What to record next.

    Attributes:
        rows: The rows, in the order in which to record them; empty if nothing is to be separated.
        explanations: The explanations that compete, the leading one first.
        probabilities: Their probabilities now.
        forecast: What the rows are expected to do; None without rows.
        notes: What no such row can tell, and what would, in words.
        joints: Names of the joints.
        kinds: ``"revolute"`` or ``"prismatic"``, joint by joint.
    """

    rows: tuple[Suggestion, ...]
    explanations: tuple[str, ...]
    probabilities: tuple[float, ...]
    forecast: Forecast | None
    notes: tuple[str, ...]
    joints: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and dictionaries."""
        pairs = zip(self.explanations, self.probabilities, strict=True)
        forecast = None if self.forecast is None else asdict(self.forecast)
        return {
            "rows": [row.to_dict() for row in self.rows],
            "explanations": [{"label": name, "probability": p} for name, p in pairs],
            "forecast": forecast,
            "words": "" if self.forecast is None else self.forecast.words,
            "notes": list(self.notes),
        }


def next_experiment(
    found: Found, verdict: Verdict, options: Options | None = None
) -> NextExperiment:
    """Choose rows that tell the leading explanations of a recording apart.

    Args:
        found: Where the search ended.
        verdict: What was made of it.
        options: How to choose.
    """
    options = options or Options()
    rivals = explanations(found, verdict, options.rivals)
    total = sum(e.weight for e in rivals)
    names = tuple(e.label for e in rivals)
    shares = tuple(e.weight / total for e in rivals)
    chain = found.model.recording.chain
    missing = _missing_columns(verdict)
    if len(rivals) < 2 or max(shares) > SURE:
        said = f"Nothing to separate: {names[0]} has a probability of {percent(shares[0])}."
        return NextExperiment((), names, shares, None, (said, *missing))
    design = Design.of(contest(found, rivals), options)
    if not len(design.pool):
        said = "No posture within reach was found; try the joint limits instead of what was used."
        return NextExperiment((), names, shares, None, (said, *missing))
    chosen = design.choose()
    told = tuple(
        _suggestion(chosen.rows.select([k]), (names[i], names[j]))
        for k, (i, j) in enumerate(chosen.pairs)
    )
    notes = (*_untold(design.contest.rivals, chosen.beliefs), *missing)
    forecast = _forecast(design, chosen.gram)
    return NextExperiment(told, names, shares, forecast, notes, chain.joint_names, chain.kinds)


def _suggestion(row: FutureRows, separates: tuple[str, str]) -> Suggestion:
    side, speed = row.direction, row.velocity
    return Suggestion(
        pose=tuple(row.q[0].tolist()),
        direction=None if side is None else tuple(int(s) for s in side[0]),
        velocity=None if speed is None or not speed.any() else tuple(speed[0].tolist()),
        wait=None if row.wait is None else float(row.wait[0]),
        payload=None if row.payload is None else float(row.payload[0]),
        socket=None if row.socket is None else int(row.socket[0]),
        separates=separates,
    )


def _forecast(design: Design, gram: Array) -> Forecast:
    """By Bayes' rule on readings drawn from the models."""
    rivals, options = design.contest.rivals, design.options
    lead, p = rivals.leading, rivals.probabilities
    expected = np.diag(expected_probabilities(rivals, gram, seed=options.seed))
    found = Forecast(
        rivals.labels[lead], float(p[lead]), float(expected[lead]), overall=float(p @ expected)
    )
    if not options.compare:
        return found
    counts = tuple(n for n in RANDOM_COUNTS if n > options.count)
    grams = design.random_grams((options.count, *counts), ORDERS)
    after = np.array([[_of_lead(rivals, g, options.seed) for g in order] for order in grams])
    mean = after.mean(axis=0)
    as_good = [n for n, a in zip((options.count, *counts), mean, strict=True) if a >= found.after]
    return replace(found, random=float(mean[0]), random_rows=as_good[0] if as_good else None)


def _of_lead(rivals: Rivals, gram: Array, seed: int) -> float:
    lead = rivals.leading
    return float(expected_probabilities(rivals, gram, DRAWS, seed, only=lead)[lead, lead])


def _untold(rivals: Rivals, beliefs: Beliefs) -> tuple[str, ...]:
    """Pairs that the rows leave untold, one line each."""
    told = np.minimum(beliefs.information, beliefs.information.T)
    lead = rivals.leading
    return tuple(
        f"No row within reach tells {rivals.labels[lead]} from {rivals.labels[j]} well"
        for j in range(len(told))
        if j != lead and told[lead, j] < TOLD_APART
    )


def _missing_columns(verdict: Verdict) -> tuple[str, ...]:
    """Columns whose absence hides effects of the library, one line each."""
    hidden: dict[str, list[str]] = {}
    for blame in verdict.unobservable:
        if blame.why.startswith(NEEDS):
            hidden.setdefault(blame.why.removeprefix(NEEDS), []).append(blame.effect)
    return tuple(
        f"{COLUMNS.get(column, f'Record the column {column}')}: without it "
        f"{' and '.join(dict.fromkeys(effects))} cannot be told"
        for column, effects in hidden.items()
    )
