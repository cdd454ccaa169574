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
from plumbline.experiments.withheld.answer import ScoredCase, StatedVerdict, read_answer
from plumbline.experiments.withheld.calibration import Calibration, Said, calibration
from plumbline.experiments.withheld.measures import MEASURES, floor_of, in_library
from plumbline.experiments.withheld.running import read_note
from plumbline.experiments.withheld.sealing import LEDGER, Ledger, check_seal, read_ledger
from plumbline.experiments.withheld.truth import Sort, Truth, read_truth
from plumbline.optim.core.quantities import Median, Share

WORTH_STATING = 0.05  # probability from which a candidate is a statement that is counted
REMOVABLE = 1.05  # least gap over the floor for which "how much of it" means anything
LEVELS = ("faint", "slight", "clear", "no gap", "unstated")


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
    """Open the truth and count (PlumblineError: hashes differ, or verdicts are missing)."""
    ledger = _ledger(verdicts, truth)
    judged, missing = _sealed(verdicts, truth, ledger) if ledger else _unsealed(verdicts, truth)
    if missing and not partial:
        raise PlumblineError(
            f"{verdicts}: {len(missing)} cases have no verdict, {missing[0]} first; run again to "
            "finish, or give --partial"
        )
    if not judged:
        raise PlumblineError(f"{verdicts}: no verdict on any case of {truth}")
    return score(judged, missing=len(missing), ledger=ledger.sha256 if ledger else "", seed=seed)


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
        outside=calibration(
            [[(min(c.answer.outside, 1.0), bool(c.truth.unknown))] for c in judged], seed
        ),
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


def percent(share: Share) -> str:
    """A share with its interval, in percent, such as ``93.2 (88-96)``."""
    if share.value is None or share.low is None or share.high is None:
        return ""
    return _spanned(share.value, share.low, share.high)


def median(found: Median) -> str:
    """A median in percent, with its interval where there are values enough for one."""
    if found.value is None:
        return ""
    if found.low is None or found.high is None:
        return _shown(found.value)
    return _spanned(found.value, found.low, found.high)


def _spanned(value: float, low: float, high: float) -> str:
    return f"{_shown(value)} ({100 * low:.0f}-{100 * high:.0f})"


def _shown(value: float) -> str:
    return f"{100 * value:.1f}".removesuffix(".0")


def by_level(score: Score) -> list[Group]:
    """All cases, then the levels from faint to clear."""
    found = [group for group in score.groups if group.by == "level"]
    return [score.overall, *sorted(found, key=lambda group: LEVELS.index(group.name))]


def rows_of(groups: Sequence[Group]) -> list[tuple[str, ...]]:
    """Every figure that any of the groups has, as text, headed by its words."""
    rows: list[tuple[str, ...]] = []
    for measure in MEASURES:
        shares = [group.share(measure.key) for group in groups]
        if any(share.of for share in shares):
            rows.append((measure.words, *(percent(share) for share in shares)))
    if any(group.shrink.of for group in groups):
        rows.append(("removable gap removed, median", *(median(g.shrink) for g in groups)))
    return rows


def error_words(name: str, found: Calibration) -> str:
    """A calibration error in one line."""
    if found.ece is None or found.low is None or found.high is None:
        return f"{name}: nothing stated"
    return (
        f"{name}: ECE {found.ece:.3f} ({found.low:.3f}-{found.high:.3f}), "
        f"{found.statements} statements ({found.chance:.3f} by chance)"
    )


def calibration_lines(score: Score) -> list[str]:
    """The four calibration errors."""
    return [
        error_words("causes named, confounded right", score.named),
        error_words("causes named, strictly", score.named_strictly),
        error_words("candidates at 0.05 and more, strictly", score.candidates),
        error_words("something outside the library", score.outside),
    ]


def mistakes(score: Score) -> list[Mistake]:
    """What was most often taken for what."""
    wrong = [m for m in score.confusion if m.truth != m.answer]
    return sorted(wrong, key=lambda m: -m.count)


def seal_words(score: Score) -> str:
    """Whether anything vouches for the set."""
    if score.sealed:
        return f"sealed, ledger {score.ledger[:16]}"
    return "not sealed: no ledger vouches for recordings and truth"
