r"""The score of a run: hashes first, then the truth, then every figure with its interval.

.. math:: \text{shrink reached} = \frac{1 - a/b}{1 - f/b}

with b and a the held-out residual before and after, and f what noise alone would leave.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plumbline.errors import PlumblineError
from plumbline.experiments.withheld.answer import StatedVerdict, read_answer
from plumbline.experiments.withheld.calibration import Calibration, Said, calibration
from plumbline.experiments.withheld.matching import ScoredCase
from plumbline.experiments.withheld.measures import MEASURES, floor_of, in_library
from plumbline.experiments.withheld.running import read_note
from plumbline.experiments.withheld.sealing import LEDGER, Ledger, check_seal, read_ledger
from plumbline.experiments.withheld.truth import Sort, Truth, read_truth
from plumbline.optim.core.shares import Median, Share

WORTH_STATING = 0.05
REMOVABLE = 1.05  # least gap over the floor for which "how much of it" means anything


@dataclass(frozen=True)
class Group:
    """The figures of some cases."""

    by: str  # what they were grouped by; ``all`` for all of them
    name: str  # what they have in common
    cases: int  # how many they are
    figures: dict[str, Share]  # by their keys, in the order of the measures
    shrink: Median  # median share of the removable gap that was removed, library causes only

    def share(self, key: str) -> Share:
        """A figure by its key."""
        return self.figures[key]


@dataclass(frozen=True)
class Mistake:
    """How often a truth met an answer."""

    truth: str
    answer: str
    count: int


@dataclass(frozen=True)
class Score:
    """All that a run is worth."""

    cases: int  # number of cases scored
    missing: int  # sealed cases without a verdict
    sealed: bool  # whether a ledger vouches for the set
    ledger: str  # its hash; empty if there is none
    groups: tuple[Group, ...]  # figures, of all cases first
    confusion: tuple[Mistake, ...]  # first answer by truth, over cases of at most one cause
    named: Calibration  # calibration of the causes named, confounded ones counted as right
    named_strictly: Calibration  # the same, confounded ones counted as wrong
    candidates: Calibration  # calibration of all candidates stated at 0.05 or more, strictly
    outside: Calibration  # calibration of the probability of something unknown

    @property
    def overall(self) -> Group:
        """The figures of all cases."""
        return self.groups[0]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def score_run(verdicts: Path, truth: Path, *, partial: bool = False, seed: int = 0) -> Score:
    """Open the truth and count.

    Raises:
        PlumblineError: A hash differs from the ledger's, or verdicts are missing.
    """
    ledger = _ledger(verdicts, truth)
    judged, missing = judged_cases(verdicts, truth)
    if missing and not partial:
        raise PlumblineError(
            f"{verdicts}: {len(missing)} cases have no verdict, {missing[0]} first; run again to "
            "finish, or give --partial"
        )
    if not judged:
        raise PlumblineError(f"{verdicts}: no verdict on any case of {truth}")
    return score(judged, missing=len(missing), ledger=ledger.sha256 if ledger else "", seed=seed)


def judged_cases(verdicts: Path, truth: Path) -> tuple[list[ScoredCase], list[str]]:
    """Every case with its verdict, once the hashes agree; and cases without a verdict."""
    ledger = _ledger(verdicts, truth)
    return _sealed(verdicts, truth, ledger) if ledger else _unsealed(verdicts, truth)


def _ledger(verdicts: Path, truth: Path) -> Ledger | None:
    """The ledger that the run copied, which must be the one beside the truth."""
    noted = _note(verdicts).get("ledger", "")
    mine, theirs = read_ledger(verdicts), read_ledger(truth)
    if noted and (mine is None or mine.sha256 != noted):
        raise PlumblineError(f"{verdicts / LEDGER}: not the ledger that the run was sealed with")
    if mine and theirs and mine.sha256 != theirs.sha256:
        raise PlumblineError(f"{truth / LEDGER}: differs from that of the run; not the same set")
    return mine or theirs


def _note(verdicts: Path) -> dict[str, str]:
    if not verdicts.is_dir():
        raise PlumblineError(f"{verdicts}: no such folder; run the cases first")
    return read_note(verdicts)


def _sealed(verdicts: Path, truth: Path, ledger: Ledger) -> tuple[list[ScoredCase], list[str]]:
    """Every sealed case with its verdict, all hashes compared before any truth is opened."""
    cases = Path(_note(verdicts).get("cases", ""))
    cases_there = cases.is_absolute() and cases.is_dir()
    for entry in ledger.entries:
        recording = cases / entry.case if cases_there else None
        check_seal(entry, recording, truth / f"{entry.case}.json")
    answers = {e.case: _verdict(verdicts / f"{e.case}.json") for e in ledger.entries}
    judged = []
    for entry in ledger.entries:
        answer = answers[entry.case]
        if answer is None:
            continue
        if answer.recording and answer.recording != entry.recording:
            raise PlumblineError(f"{entry.case}: its verdict is on another recording; run it again")
        if answer.recording and answer.without != entry.without:
            raise PlumblineError(f"{entry.case}: its verdict had another library; run it again")
        judged.append(ScoredCase(read_truth(truth / f"{entry.case}.json", entry.without), answer))
    return judged, [case for case, answer in answers.items() if answer is None]


def _unsealed(verdicts: Path, truth: Path) -> tuple[list[ScoredCase], list[str]]:
    if not truth.is_dir():
        raise PlumblineError(f"{truth}: no such folder; expected a JSON file a case")
    judged, missing = [], []
    for path in sorted(truth.glob("*.json")):
        if b'"effects"' not in path.read_bytes() or path.stem == "plan":
            continue
        answer = _verdict(verdicts / path.name)
        if answer is None:
            missing.append(path.stem)
        else:
            judged.append(ScoredCase(read_truth(path, answer.without), answer))
    return judged, missing


def _verdict(path: Path) -> StatedVerdict | None:
    return read_answer(path) if path.is_file() else None


def score(
    judged: Sequence[ScoredCase], *, missing: int = 0, ledger: str = "", seed: int = 0
) -> Score:
    """Count over cases that were judged."""
    return Score(
        cases=len(judged),
        missing=missing,
        sealed=bool(ledger),
        ledger=ledger,
        groups=tuple(_groups(judged)),
        confusion=_confusion(judged),
        named=calibration([_named(case, confounded=True) for case in judged], seed),
        named_strictly=calibration([_named(case, confounded=False) for case in judged], seed),
        candidates=calibration([_stated(case) for case in judged], seed),
        outside=calibration([_beyond(case) for case in judged], seed),
    )


def _groups(judged: Sequence[ScoredCase]) -> list[Group]:
    groups = [_group("all", "all", judged)]
    kinds: tuple[tuple[str, Callable[[Truth], str]], ...] = (
        ("level", lambda t: t.level),
        ("rows", lambda t: t.size),
        ("sort", lambda t: str(t.sort)),
        ("observation", lambda t: t.observation or "unstated"),
        ("effect", lambda t: t.causes[0][0] if len(t.causes) == 1 else ""),
    )
    for by, label in kinds:
        names = sorted({label(case.truth) for case in judged} - {""})
        groups += [_group(by, n, [c for c in judged if label(c.truth) == n]) for n in names]
    return groups


def _group(by: str, name: str, judged: Sequence[ScoredCase]) -> Group:
    figures = {}
    for measure in MEASURES:
        counted = [measure.count(case) for case in judged]
        share = Share.count_of(sum(c for c, _ in counted), sum(n for _, n in counted))
        figures[measure.key] = share
    reached = [value for case in judged if (value := shrink_reached(case)) is not None]
    return Group(by, name, len(judged), figures, Median.of_values(reached))


def shrink_reached(case: ScoredCase) -> float | None:
    """Share of the removable gap that was removed; none where there was nothing to remove."""
    floor, before, after = floor_of(case), case.answer.before, case.answer.after
    if not in_library(case) or floor is None or before is None or after is None:
        return None
    return (before - after) / (before - floor) if before > REMOVABLE * floor else None


def _confusion(judged: Sequence[ScoredCase]) -> tuple[Mistake, ...]:
    single = [c for c in judged if c.truth.sort not in {Sort.SEVERAL, Sort.PARTLY}]
    counts = Counter((true_label(case), answer_label(case.answer)) for case in single)
    return tuple(Mistake(t, a, n) for (t, a), n in sorted(counts.items()))


def true_label(case: ScoredCase) -> str:
    """What a perfect answer would be called."""
    if case.truth.sort is Sort.SINGLE:
        return case.truth.causes[0][0]
    return "no gap" if case.truth.sort is Sort.NONE else "outside"


def answer_label(answer: StatedVerdict) -> str:
    """What the answer is called: its first cause, or that there is none."""
    if answer.first is not None:
        return answer.first[0]
    return {"no-gap": "no gap", "outside-library": "outside"}.get(answer.verdict, answer.verdict)


def _named(case: ScoredCase, *, confounded: bool) -> Said:
    return [(s.probability, case.fits(s.key, confounded=confounded)) for s in case.answer.causes]


def _stated(case: ScoredCase) -> Said:
    listed = case.answer.candidates or case.answer.causes
    worth = [s for s in listed if s.probability >= WORTH_STATING]
    return [(s.probability, case.fits(s.key, confounded=False)) for s in worth]


def _beyond(case: ScoredCase) -> Said:
    return [(min(case.answer.outside, 1.0), bool(case.truth.unknown))]
