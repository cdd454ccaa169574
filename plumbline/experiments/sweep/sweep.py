r"""One recording diagnosed under many options: does the verdict hang on them?

The cases are the product of what ``[vary]`` lists, each diagnosed on its own,

.. math:: \text{seed} \times \text{held out} \times \text{without} \times \text{rows}

where ``rows`` are random subsets of that size, drawn by the case's seed; held-out rows stay. Each
case may be kept as it is done, and a sweep that was ended goes on where it was.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.experiments.console.workers import done_by
from plumbline.experiments.sweep.cases import Kept, keeping
from plumbline.experiments.withheld.running import code_hash
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.files import is_folder, read_file, reason
from plumbline.optim.core.progress import Progress
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.predict.folds import KINDS, fold_of_rows
from plumbline.optim.recording.checks import has_enough_rows
from plumbline.optim.recording.constants import LARGEST_SETTINGS
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.origin import Origin
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import refuse_wrong_set_up
from plumbline.optim.recording.settings import Section, read_settings

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.findings import Verdict

VARIED = ("seed", "held_out", "without", "rows")
MOST_CASES = 10_000
REFUSED = "refused"


@dataclass(frozen=True)
class Case:
    """The options of one diagnosis."""

    seed: int = 0  # of folds, bootstrap, random features and the rows drawn
    held_out: str = "auto"  # what is left out together
    without: tuple[str, ...] = ()  # effects taken out of the library
    rows: int | None = None  # how many rows are drawn from those that may be fitted; None for all

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "without": list(self.without)}


@dataclass(frozen=True)
class Spec:
    """What a file asks for."""

    recording: Path  # the folder
    cases: tuple[Case, ...]  # the product of what is varied, in the file's order


@dataclass(frozen=True)
class Named:
    """A cause that a verdict names."""

    cause: str  # its label
    probability: float

    def __str__(self) -> str:
        """``backlash of joint 2 (0.98)``."""
        return f"{self.cause} ({self.probability:.2g})"


@dataclass(frozen=True)
class Outcome:
    """What one case came to."""

    case: Case  # its options
    verdict: str  # the verdict; ``refused`` where the options do not fit the rows
    cause: str = ""  # label of the first cause, empty if there is none
    probability: float | None = None  # its probability
    before: float | None = None  # held-out gap of the nominal model [unit]
    after: float | None = None  # held-out gap of the verdict's model [unit]
    unit: str = "m"  # ``"m"`` or ``"rad"``
    outside_probability: float | None = None  # that something outside the library is at work
    reason: str = ""  # why it was refused
    causes: tuple[Named, ...] = ()  # all that the verdict names, most important first

    def to_dict(self) -> dict[str, Any]:
        """For JSON and tables: the options, then what was found."""
        found = {k: v for k, v in asdict(self).items() if k != "case"}
        return {**self.case.to_dict(), **found}


@dataclass(frozen=True)
class Sweep:
    """All outcomes of a sweep, in the order of its cases."""

    recording: str  # name of the recording
    sha256: str  # hash of its files
    outcomes: tuple[Outcome, ...]  # one a case
    varied: tuple[str, ...] = field(default=())  # options of which there is more than one value

    def __repr__(self) -> str:
        """The recording, and how many cases agree."""
        return f"<Sweep over {self.recording[:60]}: {self.agreement}>"

    @property
    def agreement(self) -> str:
        """How many cases say the same, in words."""
        of = len(self.outcomes)
        kind, often = Counter(o.verdict for o in self.outcomes).most_common(1)[0]
        cause, led = Counter(o.cause for o in self.outcomes).most_common(1)[0]
        return f"{kind} in {often} of {of}; first {cause or 'no cause'} in {led} of {of}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "recording": self.recording,
            "sha256": self.sha256,
            "cases": [outcome.to_dict() for outcome in self.outcomes],
        }


def read_spec(path: Path) -> Spec:
    """Read what is to be swept.

    Raises:
        PlumblineError: It cannot be read, or asks for what there is not.
    """
    try:
        data = read_file(path, LARGEST_SETTINGS)
    except (OSError, ValueError) as error:
        found = f"a file that cannot be read ({reason(error)})"
        raise fault(str(path), found, "a TOML file", "check the path") from None
    settings = read_settings(path.name, data)
    _refuse_unknown(settings, ("recording", "vary"))
    named, vary = settings.word("recording"), settings.section("vary")
    if named is None or not is_folder(path.parent / named):
        mend = "name it from where this file lies"
        raise settings.fault("recording", "the folder of a recording", mend)
    _refuse_unknown(vary, VARIED)
    lists = (_seeds(vary), _folds(vary), _libraries(vary), _rows(vary))
    if np.prod([float(len(values)) for values in lists]) > MOST_CASES:
        found = " x ".join(str(len(values)) for values in lists)
        raise fault(f"{path.name}, [vary]", f"{found} cases", f"at most {MOST_CASES}", "list fewer")
    return Spec(path.parent / named, tuple(Case(*values) for values in product(*lists)))


def _refuse_unknown(section: Section, known: Sequence[str]) -> None:
    odd = next((key for key in section.values if key not in known), None)
    if odd is not None:
        near = best_matches(odd, known)
        raise fault(section.where(odd), shown(odd), ", ".join(known), f"best matches: {near}")


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
    """The rows of a case: so many of those that may be fitted, and all that are held out.

    Raises:
        PlumblineError: There are fewer, or too few to fit anything.
    """
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
        return Outcome(case, REFUSED, reason=str(error))
    options = DiagnosisOptions(case.held_out, case.seed, case.without, force=True)
    found = diagnosis_module.diagnose(part, options)
    return _outcome(case, found.verdict)


def _outcome(case: Case, verdict: Verdict) -> Outcome:
    first = verdict.causes[0] if verdict.causes else None
    gap = verdict.to_dict()["gap"]  # what is not finite is null there
    return Outcome(
        case,
        str(verdict.verdict),
        "" if first is None else first.label,
        None if first is None else first.probability,
        gap["before"],
        gap["after"],
        verdict.gap.unit,
        verdict.outside_probability,
        causes=tuple(Named(cause.label, cause.probability) for cause in verdict.causes),
    )


def sweep(
    spec: Spec,
    *,
    jobs: int = -1,
    dask: str | None = None,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Diagnose every case, those aside that an earlier sweep has kept.

    Args:
        spec: The recording and the cases.
        jobs: Processes at a time; -1 for one a core. None outlives this one.
        dask: Address of a Dask scheduler, whose workers take the cases instead.
        keep: A file that takes a line for each case as it is done, and is read first.
        progress: Called with words and the share done.

    Raises:
        PlumblineError: The recording cannot be used, no case fits it, or the file to keep cases in
            is of another recording or other code.
    """
    recording = load_recording(spec.recording)
    for case in spec.cases:
        part_of(recording, case)
    with ExitStack() as stack:
        kept = None if keep is None else stack.enter_context(keeping(keep, key_of(recording)))
        found = _known(kept)
        waiting = [case for case in dict.fromkeys(spec.cases) if case not in found]
        left = len(waiting)
        for outcome in _done(spec.recording, waiting, jobs, dask):
            if kept is not None:
                kept.add(outcome.to_dict())
            found[outcome.case] = outcome
            left -= 1
            if progress:
                share = 1.0 - left / len(spec.cases)
                progress(f"{len(spec.cases) - left} of {len(spec.cases)}", share)
    varied = tuple(k for k in VARIED if len({getattr(case, k) for case in spec.cases}) > 1)
    outcomes = tuple(found[case] for case in spec.cases)
    return Sweep(recording.name, recording.sha256, outcomes, varied)


def _done(folder: Path, cases: list[Case], jobs: int, dask: str | None) -> Iterator[Outcome]:
    """What comes of each case, here or on a cluster."""
    if dask is None or not cases:
        return done_by(partial(outcome_of, folder), cases, jobs)
    from plumbline.experiments.sweep.cluster import done_on

    return done_on(dask, outcome_of, folder, cases)


def key_of(recording: Recording) -> dict[str, str]:
    """What kept cases must be of, to be taken for this recording's."""
    return {"recording": recording.sha256, "code": code_hash()}


def _known(kept: Kept | None) -> dict[Case, Outcome]:
    """Outcomes that an earlier sweep has kept.

    Raises:
        PlumblineError: They are none.
    """
    found: dict[Case, Outcome] = {}
    for number, line in enumerate(kept.lines if kept else (), start=2):
        try:
            options = {field.name: line.pop(field.name) for field in fields(Case)}
            case = Case(**{**options, "without": tuple(options["without"])})
            named = tuple(Named(**cause) for cause in line.pop("causes"))
            found.setdefault(case, Outcome(case, **line, causes=named))
        except (KeyError, TypeError):
            where = f"{kept.path if kept else ''}, row {number}"
            mend = "delete the file, or name another output"
            raise fault(where, "no case of a sweep", "one", mend) from None
    return found
