"""What is said of a diagnosis: to a terminal, a notebook and a report the same, picture aside.

A verdict alone makes a page in words and tables, :func:`of_verdict`; the page of a report,
:func:`page`, has the pictures and the rows besides.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from plumbline.errors import listed
from plumbline.experiments.report.diagnosis import phrases
from plumbline.experiments.report.diagnosis.rows import nuisances, worst_rows
from plumbline.experiments.report.diagnosis.rows import picture as ranks_picture
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.page.page import Grid, Page, Part, Parts, Picture, Tile, View
from plumbline.optim.core.quantities import (
    chance,
    counted,
    measured,
    percent,
    quantity,
    significant,
)
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.findings import Cause, Verdict
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.of_recordings import AgainstOthers, Carries, Transfer
from plumbline.optim.diagnosis.proof import proofs
from plumbline.optim.diagnosis.several.sections import Sections
from plumbline.optim.diagnosis.verdict import words

MOST_CAUSES = 6  # that are shown at once with their values: what a screen holds
MOST_RIVALS = 5  # candidates that are told with the causes
MOST_LINES, MOST_ROWS = 12, 3  # that a terminal shows of what cannot be told, of rows to come
Answered: TypeAlias = Diagnosis | MotionDiagnosis | Sections
LISTED = 40  # rows that are named one by one
JOINTS = "Root mean squares of what was left out of the fit."
RECORDINGS = (
    "Root mean squares of rows that were left out of the fit; then the same with causes that the "
    "other recordings alone have told."
)
TRANSFER = (
    "Each cause as one recording alone says it, and as all others say it together; z is their "
    "difference in standard errors of both."
)


def page(
    answer: Answered,
    *,
    seed: int | None = None,
    elsewhere: phrases.Elsewhere | None = None,
    ranks: Sequence[int] = (),
    proof: bool = True,
) -> Page:
    """The page of a report, with the seed as the page shall tell it, else that of the diagnosis.

    ``ranks`` are true values of simulated cases by tenths of what was stated of them; ``proof`` is
    whether the causes are made into files that are read again, which takes a fit and some seconds.
    """
    seed = answer.options.seed if seed is None else seed
    if isinstance(answer, Sections):
        parts = [page(one, seed=seed, proof=proof) for one in answer.sections]
        apart = [_apart(one, f"s{k}-" if k else "") for k, one in enumerate(parts)]
        return replace(_of_sections(answer, apart), seed=seed)
    drawn = [*_drawn(answer), *([ranks_picture(ranks)] if any(ranks) else [])]
    drawn += _proofs(answer) if proof else ()
    return replace(of_verdict(answer.verdict, elsewhere, drawn, _about(answer)), seed=seed)


def in_words(answer: Any, elsewhere: phrases.Elsewhere | None = None) -> Page:
    """The same without what is drawn, which a terminal cannot show."""
    if isinstance(answer, Sections):
        return _of_sections(answer, [of_verdict(one.verdict) for one in answer.sections])
    return of_verdict(answer.verdict, elsewhere)


def of_verdict(
    verdict: Verdict, elsewhere: phrases.Elsewhere | None = None, drawn: Parts = (), about: str = ""
) -> Page:
    """The page of a verdict on what ``about`` says, with pictures and tables of single rows."""
    said = (words.shrink_words(verdict), *([elsewhere.words] if elsewhere else []))
    tables = (
        ("Joint by joint", JOINTS, joints(verdict)),
        ("Recording by recording", RECORDINGS, recordings(verdict)),
        ("What carries over", TRANSFER, transfer(verdict)),
    )
    return Page(
        name=verdict.recording,
        verdict=verdict.verdict.value.replace("-", " ").capitalize(),
        tone=verdict.verdict.value,
        lead=(f"{verdict.meaning} {words.gap_words(verdict)}",),
        tiles=_tiles(verdict),
        parts=(
            Part("", said),
            *_causes(verdict.causes),
            *(Part(title, (note,), grid) for title, note, grid in tables if grid.rows),
            _at_work(verdict),
            *_where(verdict),
            *_rivals(verdict),
            *drawn,
            *_nuisances(verdict),
            *_unknown(verdict),
            *_next(verdict),
            _recorded(verdict, about),
        ),
        warnings=verdict.warnings,
        sha256=verdict.sha256,
    )


def _of_sections(answer: Sections, sections: Sequence[Page]) -> Page:
    whole = of_verdict(answer.verdict)
    said = (
        f"{len(sections)} kinds of recordings that no one fit can hold, each with a verdict of its "
        "own below; the least settled is that of all."
    )
    kinds = (one.recording.observation.replace("_", " ") for one in answer.sections)
    named = [replace(p, name=f"{p.name}: {k}") for p, k in zip(sections, kinds, strict=True)]
    return replace(whole, lead=(said,), tiles=(), parts=(), sections=named)


def _apart(one: Page, begin: str) -> Page:
    """The same with keys of pictures that no other section has."""
    parts = [replace(p, key=begin + p.key) if isinstance(p, Picture) else p for p in one.parts]
    return replace(one, parts=parts)


def _tiles(verdict: Verdict) -> list[Tile]:
    gap, (low, high) = verdict.gap, verdict.gap.shrink_ci95
    before, after, floor = (quantity(v, gap.unit) for v in (gap.before, gap.after, gap.noise_floor))
    return [
        Tile("gap before", before),
        Tile("gap after", after),
        Tile(words.floor_words(verdict), floor),
        Tile("shrinks by", percent(gap.shrink), f"{percent(low)} to {percent(high)}"),
        Tile("outside the library", chance(verdict.outside_probability), "probability"),
    ]


def _causes(causes: Sequence[Cause]) -> Iterator[Part]:
    """The first with their values, the others at a click."""
    shown = [_cause(k, cause) for k, cause in enumerate(causes, start=1)]
    more = shown[MOST_CAUSES:]
    if more:
        folded = Part(counted(len(more), "further cause"), parts=more, folded=True)
        shown = [*shown[:MOST_CAUSES], folded]
    if shown:
        yield Part("The causes", parts=shown)


def _cause(number: int, cause: Cause) -> Part:
    """A cause with its sentence, what it does to the gap, and its values."""
    sentence, without = words.cause_words(cause), words.without_words(cause)
    alike = words.merged(cause.confounded_with, why=False)
    sensitivity = words.sensitivity_words(cause)
    said = [
        f"{without.capitalize()}, all else kept." if without else "",
        f"Its probability is {sensitivity}." if sensitivity else "",
        f"This recording cannot tell it from {', '.join(alike)}." if alike else "",
    ]
    sentences = [f"{sentence[:1].upper()}{sentence[1:]}." if sentence else "", " ".join(said)]
    plain = words.plain_parameters(cause).items()
    rows = [(name, words.estimate_words(e), e.doc) for name, e in plain]
    columns = ("parameter", "value ± standard error", "meaning")
    found = words.ripples(cause)
    orders = [f"order {r.order:g}: {measured(r.amplitude, r.std, r.unit)}" for r in found]
    return Part(
        f"{number}. {cause.label}",
        [line for line in sentences if line.strip()],
        Grid(columns, rows, (1,), sorts=False) if rows else None,
        note=f"probability {chance(cause.probability)}",
        parts=[Part(words.ripple_words(found), points=orders, folded=True)] if found else (),
    )


def _at_work(verdict: Verdict) -> Part:
    """Place by place, then what the library lacks."""
    title = "What may be at work, place by place" if verdict.tree else "Beyond the library"
    depends_on = verdict.outside_depends_on
    points = [
        *words.tree_lines(verdict),
        f"something outside of the library: {chance(verdict.outside_probability)}",
        words.shared_words(verdict),
        words.left_over(depends_on) if depends_on else "",
    ]
    said = (
        "Each probability says that it is at work at all: rivals for one error share it, what "
        "works together does not. The prior probability that a mechanism is none of the library's "
        f"is {chance(verdict.unlisted_prior)}."
    )
    return Part(title, (said,), points=[*filter(None, points)])


def _where(verdict: Verdict) -> Iterator[Part]:
    places = [f"{words.place_words(p.stage, p.element)} {percent(p.share)}" for p in verdict.where]
    weighed = ", each joint in units of its noise" if verdict.gap.unit == "N m" else ""
    if places:
        yield Part("Where", (f"Of what the causes explain{weighed}: {', '.join(places)}.",))


def _rivals(verdict: Verdict) -> Iterator[Part]:
    """Candidates that are not in the verdict and yet may be at work."""
    guilty = {(c.effect, c.element) for c in verdict.causes}
    others = [c for c in verdict.candidates if (c.effect, c.element) not in guilty]
    others = sorted(others, key=lambda c: -c.probability)
    likely = [c for c in others if c.probability >= phrases.LIKELY][:MOST_RIVALS]
    if likely:
        lines = [f"{c.label}: probability {chance(c.probability)}" for c in likely]
        yield Part("Considered, and not in the verdict", points=lines)


def _drawn(answer: Diagnosis | MotionDiagnosis) -> Iterator[Any]:
    """Pictures, scene and worst rows; a motion has samples in place of rows, and no scene."""
    if isinstance(answer, MotionDiagnosis):
        from plumbline.experiments.report.diagnosis.motion import motion_pictures

        yield from motion_pictures(answer)
        return
    from plumbline.experiments.report.diagnosis.pictures import pictures
    from plumbline.experiments.report.diagnosis.turned import scene

    subject = Subject.of(answer)
    if turned := scene(subject):
        yield View(turned)
    yield from pictures(subject)
    if (worst := worst_rows(subject)).rows:
        said = "Rows count from 1 below the header; what is left of them after the causes, largest "
        yield Part("The rows that are missed most", (f"{said}first.",), worst, on_paper=True)


def _proofs(answer: Any) -> Iterator[Part]:
    """What exported files alone say of rows that no fit has seen."""
    columns = ("file", "read by", "rows", "nominal robot", "by the file alone", "the format")
    rows = [
        (p.file, p.reader, str(p.rows),
         quantity(p.before, p.unit), quantity(p.after, p.unit), p.lacks)
        for p in proofs(answer)
    ]  # fmt: skip
    said = (
        "The causes fitted again without one fold of the rows, written as a file, and that fold "
        "said by the file in the program that reads it; only the device's frame is matched besides."
    )
    grid = Grid(columns, rows, (2, 3, 4), sorts=False)
    if rows:
        yield Part("What exported files alone say", (said,), grid, on_paper=True)


def _nuisances(verdict: Verdict) -> Iterator[Part]:
    if (grid := nuisances(verdict)).rows:
        yield Part("What is fitted together with the causes", (), grid, on_paper=True)


def _unknown(verdict: Verdict) -> Iterator[Part]:
    """What cannot be told apart, then what cannot be seen."""
    unseen = words.merged(verdict.unobservable)
    alike = [(c.label, words.merged(c.confounded_with, why=False)) for c in verdict.causes]
    lines = [f"cannot tell {label} from {', '.join(others)}" for label, others in alike if others]
    lines += [f"cannot see {line}" for line in unseen]
    none = "Nothing of note: every effect of the library could have been seen and told apart."
    words_alone = () if lines else (none,)
    yield Part("What this recording cannot tell", words_alone, points=lines, most=MOST_LINES)


def _next(verdict: Verdict) -> Iterator[Part]:
    if verdict.next:
        lines = [phrases.suggestion_words(one) for one in verdict.next]
        yield Part("What to record next", points=lines, most=MOST_ROWS)


def _about(answer: Diagnosis | MotionDiagnosis) -> str:
    recording = answer.recording
    if isinstance(recording, MotionRecording):
        return f" of {recording.observation} on {recording.robot.name}, {recording.n} joints"
    if recording.stand_in:
        return f" of {recording.observation}"
    return f" of {recording.observation} on {recording.robot.name}, {recording.chain.n} joints"


def _recorded(verdict: Verdict, about: str) -> Part:
    noise = words.noise_words(verdict.noise, verdict.gap.unit)
    said = [f"{counted(verdict.rows, 'row')}{about}. Noise: {noise}."]
    # Of several recordings gross rows are told one by one.
    gross = "" if verdict.recordings else phrases.distrusted_words(verdict.distrusted_rows)
    said += [f"{gross} They are left out of every figure and picture."] if gross else []
    return Part("About the recording", said, points=verdict.notes)


def recordings(verdict: Verdict) -> Grid:
    """What each recording leaves, on rows that were left out."""
    columns = (
        "recording", "kind", "rows", "before", "after", "causes of the others alone", "noise",
        "gross rows",
    )  # fmt: skip
    rows = [
        (
            r.name, r.observation.replace("_", " "), str(r.rows),
            *(quantity(v, r.unit) for v in (r.before, r.after, r.without_it)),
            f"{quantity(r.noise, r.unit)} ({r.noise_source})", _rows(r.gross),
        )
        for r in verdict.recordings
    ]  # fmt: skip
    return Grid(columns, rows, range(2, 7), sorts=False)


def joints(verdict: Verdict) -> Grid:
    """What each joint is missed by, on rows that were left out."""
    rows = [
        (joint.label, quantity(joint.before, joint.unit), quantity(joint.after, joint.unit))
        for joint in verdict.joints
    ]
    return Grid(("joint", "before", "after"), rows, (1, 2), sorts=False)


def _rows(gross: Sequence[int]) -> str:
    if not gross:
        return "none"
    return f"{'row' if len(gross) == 1 else 'rows'} {listed(gross, LISTED)}"


def transfer(verdict: Verdict) -> Grid:
    """What one recording alone says of each cause, and what all others say."""
    columns = ("cause", "recording", "carries over?", "z", "parameter", "here alone", "the others")
    rows = [line for t in verdict.transfer for line in _of_transfer(t)]
    return Grid(columns, rows, (3, 5, 6), sorts=False)


def _of_transfer(t: Transfer) -> list[tuple[str, ...]]:
    z = significant(t.z, 2) if math.isfinite(t.z) else ""
    said = (t.label.replace("_", " "), t.recording, t.carries.value, z)
    blank = ("",) * len(said)
    return [
        (*(blank if n else said), name, *_both(t, one))
        for n, (name, one) in enumerate(t.parameters.items())
    ]


def _both(t: Transfer, one: AgainstOthers) -> tuple[str, str]:
    others = "" if t.carries == Carries.ONLY else _told(one.others, one.others_std, one.unit)
    return _told(one.value, one.std, one.unit), others


def _told(value: float, std: float, unit: str) -> str:
    return measured(value, std, unit) if math.isfinite(std) else "not told"
