r"""The next experiment: rows that best tell the leading explanations of a recording apart.

Rows are chosen one after another from thousands within reach, each in the light of those chosen
before it; what a row is worth is a :data:`~plumbline.optim.diagnosis.design.separation.Criterion`.
The forecast draws readings of these rows from every explanation and weighs the explanations anew by
Bayes' rule; rows at random are forecast in the same way until they are as good.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import chance, counted, enumerated
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import ORDERS, RANDOM_COUNTS
from plumbline.optim.diagnosis.design.explanations import contest, explanations
from plumbline.optim.diagnosis.design.future_rows import RECORDED, FutureRows
from plumbline.optim.diagnosis.design.rows import Design, DesignOptions
from plumbline.optim.diagnosis.design.separation import Beliefs, Rivals, expected_probabilities
from plumbline.optim.diagnosis.findings import Verdict
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.verdict.words import what_to_vary
from plumbline.optim.model.making import number_of
from plumbline.optim.recording.constants import SAME_POSTURE
from plumbline.optim.recording.kinds import PLACES
from plumbline.optim.recording.recording import Recording

# Kinds for which rows are proposed: postures, not motions.
NEEDS = "needs the column "
COLUMNS = {
    "direction": "record which way each joint came last (direction1, ...)",
    "velocity": "record the joint velocities (velocity1, ...)",
    "time": "record the time of every row",
    "temperature": "record the temperature",
    "payload": "record the mass carried (payload)",
    "force": "record the force on the tool's tip (force_x, force_y, force_z)",
}
CHEAP = DesignOptions(pool=400, rivals=4, glance=100, exchanges=2, compare=False)


@dataclass(frozen=True)
class Suggestion:
    """One row to record."""

    pose: tuple[float, ...]  # joint readings (n,) [rad or m]
    # side of the approach (n,): 1 from below, -1 from above; None if not recorded
    direction: tuple[int, ...] | None
    velocity: tuple[float, ...] | None  # joint velocities (n,) [rad/s or m/s]; None if not recorded
    wait: float | None  # rest before the row [s]; None if the recording has no clock
    payload: float | None  # mass to be carried [kg]; None if not recorded
    socket: int | None  # socket that the tip rests in; None if there are none
    separates: tuple[str, str]  # the two explanations that the row does most to tell apart
    # group to put the row into, so that no part left out holds them all; None if there are none
    group: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, without what the recording does not know of."""
        known = {k: v for k, v in asdict(self).items() if v is not None and k != "separates"}
        plain = {k: list(v) if isinstance(v, tuple) else v for k, v in known.items()}
        return plain | {"separates": " from ".join(self.separates)}


@dataclass(frozen=True)
class Forecast:
    """What the rows are expected to do, if the leading explanation is right."""

    leading: str  # the leading explanation
    before: float  # its probability now, among those compared
    after: float  # its expected probability after the rows
    random: float | None = None  # the same after as many rows at random; None if not asked for
    # how many rows at random do as well; None if more than were tried
    random_rows: int | None = None
    # expected probability of whichever explanation is right, after the rows
    overall: float = float("nan")

    @property
    def words(self) -> str:
        """The forecast in a sentence or two."""
        said = (
            f"If {self.leading} is right, these rows are expected to raise its probability from "
            f"{chance(self.before)} to {chance(self.after)}."
        )
        if self.random is None:
            return said
        many = f"more than {RANDOM_COUNTS[-1]}" if self.random_rows is None else self.random_rows
        return (
            f"{said} As many rows at random would reach {chance(self.random)}; to do as well, "
            f"about {many} of them would be needed."
        )


@dataclass(frozen=True)
class NextExperiment:
    """What to record next."""

    # the rows, in the order in which to record them; empty if nothing is to be separated
    rows: tuple[Suggestion, ...]
    explanations: tuple[str, ...]  # the explanations that compete, the leading one first
    probabilities: tuple[float, ...]  # their probabilities now
    forecast: Forecast | None  # what the rows are expected to do; None without rows
    notes: tuple[str, ...]  # what no such row can tell, and what would, in words
    joints: tuple[str, ...] = ()  # names of the joints
    kinds: tuple[str, ...] = ()  # ``"revolute"`` or ``"prismatic"``, joint by joint

    def __repr__(self) -> str:
        many = (
            f"{counted(len(self.rows), 'row')} for {counted(len(self.explanations), 'explanation')}"
        )
        said = "" if self.forecast is None else f"; {self.forecast.leading[:80]}: "
        if self.forecast is not None:
            said += f"{chance(self.forecast.before)} -> {chance(self.forecast.after)}"
        return f"<NextExperiment: {many}{said}>"

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
    selected: SelectedModel, verdict: Verdict, options: DesignOptions | None = None
) -> NextExperiment:
    """Choose rows that tell the leading explanations of a recording apart.

    Args:
        selected: Where the search ended.
        verdict: What was made of it.
        options: How to choose.
    """
    options = options or DesignOptions()
    rivals = explanations(selected, options.rivals)
    total = sum(e.probability for e in rivals)
    names = tuple(e.label for e in rivals)
    shares = tuple(e.probability / total for e in rivals)
    chain = selected.model.recording.chain
    missing = (*_beyond(verdict), *_missing_columns(selected.model.recording, verdict))
    if len(selected.selection.keys(selected.chosen)) > prior.MANY_CAUSES:
        many = f"more than {prior.MANY_CAUSES} causes"
        said = f"{many}: no others are weighed against all of them together"
        return NextExperiment((), names, shares, None, (said, *missing))
    if len(rivals) < 2 or max(shares) > prior.SETTLED:
        said = (
            f"nothing to separate: of the library's explanations {names[0]} is the most probable, "
            f"with {chance(shares[0])}"
        )
        return NextExperiment((), names, shares, None, (said, *missing))
    own = _written(selected.model.recording, options.recording)
    design = Design.of(contest(selected, rivals), options)
    if not len(design.pool):
        said = "no posture within reach was found; try the joint limits instead of what was used"
        return NextExperiment((), names, shares, None, (said, *missing))
    chosen = design.choose()
    untold, hopeless = _untold(design, chosen.beliefs)
    untold += _still(own) if options.within == RECORDED else ()
    if len(hopeless) == len(rivals) - 1:
        return NextExperiment((), names, shares, None, (*untold, *missing))
    groups = chosen.rows.groups(own)
    told = tuple(
        _suggestion(
            chosen.rows.select([k]),
            (names[i], names[j]),
            None if groups is None else groups[k],
            own,
        )
        for k, (i, j) in enumerate(chosen.pairs)
    )
    forecast = _forecast(design, chosen.gram)
    notes = (*untold, *missing)
    return NextExperiment(told, names, shares, forecast, notes, chain.joint_names, chain.kinds)


def _written(recording: Recording, name: str) -> Recording:
    """The recording that rows are proposed for, with the columns that it itself writes."""
    session = recording.session
    return recording if session is None else session.parts[number_of(session, name)]


def _suggestion(
    row: FutureRows, separates: tuple[str, str], group: int | None, own: Recording
) -> Suggestion:
    side = None if own.direction is None else row.direction
    speed = None if own.velocity is None else row.velocity
    return Suggestion(
        pose=tuple(row.q[0].tolist()),
        direction=None if side is None else tuple(int(s) for s in side[0]),
        velocity=None if speed is None else tuple(speed[0].tolist()),
        wait=None if row.wait is None or own.time is None else float(row.wait[0]),
        payload=None if row.payload is None or own.payload is None else float(row.payload[0]),
        socket=None if row.socket is None else int(row.socket[0]),
        separates=separates,
        group=None if group is None else int(group),
    )


def _forecast(design: Design, gram: Array) -> Forecast:
    """By Bayes' rule on readings drawn from the models."""
    rivals, options = design.contest.rivals, design.options
    lead, p = rivals.leading, rivals.probabilities
    # Data never make what is right less probable on average; draws may, by a little.
    expected = np.maximum(np.diag(expected_probabilities(rivals, gram, seed=options.seed)), p)
    found = Forecast(
        rivals.labels[lead], float(p[lead]), float(expected[lead]), overall=float(p @ expected)
    )
    if not options.compare:
        return found
    counts = (options.count, *(n for n in RANDOM_COUNTS if n > options.count))
    grams = design.random_grams(counts, ORDERS)
    after = np.array([[_if_lead(rivals, g, options.seed)[lead] for g in order] for order in grams])
    mean = np.maximum(after.mean(axis=0), p[lead])
    as_good = [n for n, a in zip(counts, mean, strict=True) if a >= found.after]
    return replace(found, random=float(mean[0]), random_rows=as_good[0] if as_good else None)


def _if_lead(rivals: Rivals, gram: Array, seed: int) -> Array:
    """Expected probabilities (M,) after some rows if the leading explanation is right."""
    lead = rivals.leading
    return expected_probabilities(rivals, gram, prior.DRAWS, seed, only=lead)[lead]


def _still(recording: Recording) -> tuple[str, ...]:
    """What to do about joints that stood still in every row."""
    still = np.flatnonzero(np.ptp(recording.q, axis=0) < SAME_POSTURE)
    if not len(still):
        return ()
    joints = f"joint{'s' if len(still) > 1 else ''} {enumerated([str(j + 1) for j in still])}"
    return (f"move {joints}, too (--within limits): what errs with an angle shows along it alone",)


def _untold(design: Design, beliefs: Beliefs) -> tuple[tuple[str, ...], list[int]]:
    """What the rows leave untold in words, and which rivals no number of such rows would tell."""
    rivals = design.contest.rivals
    told, lead = np.minimum(beliefs.information, beliefs.information.T), rivals.leading
    faint = [j for j in range(len(told)) if j != lead and told[lead, j] < prior.NO_EVIDENCE]
    if not faint:
        return (), []
    many = design.random_grams((RANDOM_COUNTS[-1],), 1)[0, 0]
    left = _if_lead(rivals, many, design.options.seed)
    hopeless = [j for j in faint if left[j] > prior.HOPELESS * rivals.probabilities[j]]
    mine, notes = rivals.labels[lead], []
    if set(faint) - set(hopeless):
        names = _listed(rivals, [j for j in faint if j not in hopeless])
        notes.append(f"these rows alone will hardly tell {mine} from {names}: record more of them")
    if hopeless:
        notes.append(
            f"not even {RANDOM_COUNTS[-1]} rows of this kind would tell {mine} from "
            f"{_listed(rivals, hopeless)}: vary something else, such as the mass carried (column "
            "payload), the speed, the time or the range of the joints"
        )
    return tuple(notes), hopeless


def _listed(rivals: Rivals, which: Sequence[int]) -> str:
    return ", ".join(rivals.labels[j] for j in which)


def suggestions(selected: SelectedModel, verdict: Verdict, seed: int) -> tuple[dict[str, Any], ...]:
    """The rows for a verdict's own list, at little cost; none where little is left open.

    Args:
        selected: Where the search ended.
        verdict: What was made of it.
        seed: Of the pool.
    """
    recording = selected.model.recording
    own = _written(recording, "")
    if own.observation not in PLACES or (own.socket is not None and own is not recording):
        return ()
    rows = next_experiment(selected, verdict, replace(CHEAP, seed=seed)).rows
    of = {} if own is recording else {"recording": own.name}
    return tuple(of | row.to_dict() for row in rows)


def _beyond(verdict: Verdict) -> tuple[str, ...]:
    """What to do about something that no explanation of the library accounts for."""
    if verdict.outside_probability < 0.5:
        return ()
    depends = what_to_vary(verdict.outside_depends_on)
    vary = f"rows that vary {depends} alone" if depends else "rows that vary one thing at a time"
    return (
        "something outside of the library is at work, which none of these explanations accounts "
        f"for: record {vary}, and some postures again",
    )


def _missing_columns(recording: Recording, verdict: Verdict) -> tuple[str, ...]:
    """Columns whose absence hides effects of the library, one line each."""
    hidden: dict[str, list[str]] = {}
    if recording.direction is None and recording.velocity is None:
        hidden["direction"] = ["backlash"]
    for blame in verdict.unobservable:
        if blame.why.startswith(NEEDS):
            first, _, _ = blame.why.removeprefix(NEEDS).partition(",")  # of those that would do
            hidden.setdefault(first, []).append(blame.effect)
    return tuple(
        f"{COLUMNS.get(column, f'record the column {column}')}: without it "
        f"{enumerated(tuple(dict.fromkeys(effects)))} cannot be seen"
        for column, effects in hidden.items()
    )
