r"""One recording diagnosed under many options: does the verdict hang on them?

.. math:: \text{seed} \times \text{held out} \times \text{without} \times \text{rows}

where ``rows`` are random subsets of that size, drawn by the case's seed; held-out rows stay.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.experiments.sweep.outcome import Outcome
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.predict.folds import KINDS, fold_of_rows
from plumbline.optim.recording.checks import has_enough_rows
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import refuse_wrong_set_up
from plumbline.optim.recording.settings import Section
from plumbline.optim.recording.table import Origin

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.findings import Verdict

VARIED = ("seed", "held_out", "without", "rows")


@dataclass(frozen=True)
class Case:
    """The options of one diagnosis."""

    seed: int = 0  # of folds, bootstrap, chains and the rows drawn
    held_out: str = "auto"  # what is left out together
    without: tuple[str, ...] = ()  # effects taken out of the library
    rows: int | None = None  # how many rows are drawn from those that may be fitted; None for all

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "without": list(self.without)}


def combinations(vary: Section) -> tuple[Case, ...]:
    """The product of what is varied, in the file's order."""
    lists = (_seeds(vary), _folds(vary), _libraries(vary), _rows(vary))
    return tuple(Case(*values) for values in product(*lists))


def _seeds(vary: Section) -> tuple[int, ...]:
    seeds = vary.integers("seed")
    if seeds is not None and not (seeds and all(0 <= seed < 2**32 for seed in seeds)):
        raise vary.fault("seed", "whole numbers from 0 to 2^32 - 1", "write seed = [0, 1, 2]")
    return (0,) if seeds is None else seeds


def _folds(vary: Section) -> tuple[str, ...]:
    kinds = vary.words("held_out")
    if kinds is not None and not (kinds and set(kinds) <= set(KINDS)):
        raise vary.fault("held_out", f"words of {', '.join(KINDS)}", 'write held_out = ["rows"]')
    return ("auto",) if kinds is None else kinds


def _libraries(vary: Section) -> tuple[tuple[str, ...], ...]:
    lists = vary.values.get("without", [[]])
    if not (isinstance(lists, list) and lists and all(isinstance(one, list) for one in lists)):
        mend = 'write without = [[], ["backlash"]]'
        raise vary.fault("without", "a list of lists of effects", mend)
    odd = next((name for one in lists for name in one if name not in REGISTRY), None)
    if odd is not None:
        near = best_matches(str(odd), REGISTRY)
        raise fault(vary.where("without"), shown(odd), "an effect", f"best matches: {near}")
    return tuple(tuple(one) for one in lists)


def _rows(vary: Section) -> tuple[int | None, ...]:
    rows = vary.integers("rows")
    if rows is not None and not (rows and min(rows) > 0):
        raise vary.fault("rows", "numbers of rows", "write rows = [30, 60]")
    return (None,) if rows is None else rows


def part_of(recording: Recording, case: Case) -> Recording:
    """The rows of a case, refused if too few: so many that may be fitted, and all held out."""
    if case.rows is None:
        return recording
    kept_back = np.zeros(len(recording), dtype=bool)
    if recording.held_out is not None:
        kept_back = recording.held_out
    free = np.flatnonzero(~kept_back)
    if case.rows > len(free):
        found, mend = f"{case.rows} rows asked for", "ask for fewer"
        raise fault("[vary] rows", found, f"at most {len(free)}, those to fit", mend)
    drawn = np.random.default_rng([case.seed, case.rows]).choice(free, case.rows, replace=False)
    part = recording.select(np.sort(np.concatenate([drawn, np.flatnonzero(kept_back)])))
    list(has_enough_rows(part, Origin("[vary] rows")))
    return part


def outcome_of(folder: Path, case: Case) -> Outcome:
    """Diagnose one case; it is refused where the options do not fit the rows."""
    from plumbline.optim.diagnosis import diagnose as diagnosis_module

    try:
        part = part_of(load_recording(folder), case)
        training = part.training
        fold_of_rows(training, case.held_out, case.seed)
        refuse_wrong_set_up(part)
    except ValueError as error:
        return Outcome.refusal(case, str(error))
    options = DiagnosisOptions(case.held_out, case.seed, case.without, force=True)
    return Outcome(case, figures_of(diagnosis_module.diagnose(part, options).verdict))


def figures_of(verdict: Verdict) -> dict[str, Any]:
    """What a table says of a verdict; all of its causes, most important first."""
    first = verdict.causes[0] if verdict.causes else None
    gap = verdict.to_dict()["gap"]  # what is not finite is null there
    return {
        "verdict": str(verdict.verdict),
        "cause": "" if first is None else first.label,
        "probability": None if first is None else float(first.probability),
        "before": gap["before"],
        "after": gap["after"],
        "unit": verdict.gap.unit,
        "outside_probability": float(verdict.outside_probability),
        "causes": [
            {"cause": cause.label, "probability": float(cause.probability)}
            for cause in verdict.causes
        ],
    }
