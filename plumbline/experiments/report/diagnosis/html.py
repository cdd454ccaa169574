"""A diagnosis as one HTML file: pictures inside, nothing fetched, one script of the house's own.

:func:`plumbline.write_report` writes it, :func:`html_report` gives its text.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup

from plumbline.experiments.report.diagnosis import several
from plumbline.experiments.report.diagnosis.motion import motion_pictures
from plumbline.experiments.report.diagnosis.phrases import (
    MOST_CAUSES,
    Elsewhere,
    confounded_lines,
    distrusted_words,
    further,
    suggestion_words,
)
from plumbline.experiments.report.diagnosis.pictures import pictures
from plumbline.experiments.report.diagnosis.ranks import picture as ranks_picture
from plumbline.experiments.report.diagnosis.rows import nuisances, worst_rows
from plumbline.experiments.report.diagnosis.scene import scene
from plumbline.experiments.report.diagnosis.subject import Diagnosed, Subject
from plumbline.experiments.report.page.page import Block, Grid, Made, Picture, environment
from plumbline.optim.core.quantities import chance, measured, percent, quantity
from plumbline.optim.diagnosis.findings import Cause, Verdict
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.proof import proofs
from plumbline.optim.diagnosis.several.sections import Sections
from plumbline.optim.diagnosis.verdict import words


def html_report(
    diagnosis: Diagnosed | MotionDiagnosis | Sections,
    *,
    seed: int | None = None,
    elsewhere: Elsewhere | None = None,
    made: Made | None = None,
    ranks: Sequence[int] = (),
    proof: bool = False,
) -> str:
    """The report's text; the same diagnosis gives the same bytes.

    Args:
        diagnosis: What to report.
        seed: As the page shall tell it; that of the diagnosis if not given.
        elsewhere: How the model does on another recording.
        made: When and by which command.
        ranks: True values of simulated cases by tenths of what was stated of them.
        proof: Whether the causes are made into files that are read again: a fit and some seconds.
    """
    verdict, whole = diagnosis.verdict, isinstance(diagnosis, Sections)
    kinds = diagnosis.sections if isinstance(diagnosis, Sections) else (diagnosis,)
    # Ours, whose words of the data were escaped by the section's own template.
    sections = [Markup(_section(one, k, elsewhere, ranks, proof)) for k, one in enumerate(kinds)]
    return (
        environment()
        .get_template("diagnosis/report.html.j2")
        .render(
            title=f"{verdict.recording}: {verdict.verdict.value}",
            whole=verdict if whole else None,
            sections=sections,
            sha256=verdict.sha256,
            made=made or Made(),
            seed=diagnosis.options.seed if seed is None else seed,
        )
    )


def _section(
    diagnosis: Diagnosed | MotionDiagnosis,
    number: int,
    elsewhere: Elsewhere | None,
    ranks: Sequence[int],
    proof: bool,
) -> str:
    """One diagnosis as a piece of the page; drawings of the first (0) keep their plain keys."""
    verdict = diagnosis.verdict
    templates = environment()
    templates.filters |= {"percent": percent, "chance": chance}
    templates.globals |= {"quantity": quantity, "without_words": words.without_words}
    templates.globals["sensitivity_words"] = words.sensitivity_words
    templates.globals["shared_words"] = words.shared_words
    return templates.get_template("diagnosis/section.html.j2").render(
        verdict=verdict,
        recording=diagnosis.recording,
        meaning=verdict.meaning,
        gap_words=words.gap_words(verdict),
        shrink_words=words.shrink_words(verdict),
        left_over=words.left_over(verdict.outside_depends_on),
        noise_words=words.noise_words(verdict.noise, verdict.gap.unit),
        floor_words=words.floor_words(verdict),
        interval=_interval(verdict),
        tree=words.tree_lines(verdict),
        causes=[_Card.of(cause) for cause in verdict.causes],
        most_causes=MOST_CAUSES,
        further=further(verdict.causes[MOST_CAUSES:]),
        by_joint=several.joints(verdict),
        nuisances=nuisances(verdict),
        recordings=several.recordings(verdict),
        transfer=several.transfer(verdict),
        **_drawn(diagnosis, f"s{number}-" if number else ""),
        unobservable=words.merged(verdict.unobservable),
        confounded=confounded_lines(verdict.causes),
        suggestions=[suggestion_words(entry) for entry in verdict.next],
        distrusted="" if verdict.recordings else distrusted_words(verdict.distrusted_rows),
        proofs=_proofs(diagnosis) if proof else Grid((), ()),
        elsewhere=elsewhere,
        ranks=_block(ranks_picture(ranks), "") if any(ranks) else None,
        joints=_joints(diagnosis),
    )


def _drawn(diagnosis: Diagnosed | MotionDiagnosis, begin: str) -> dict[str, Any]:
    """Pictures, scene and worst rows; a motion has samples in place of rows, and no scene."""
    if isinstance(diagnosis, MotionDiagnosis):
        blocks = [_block(picture, begin) for picture in motion_pictures(diagnosis)]
        return {"blocks": blocks, "scene": "", "worst": Grid((), ())}
    subject = Subject.of(diagnosis)
    blocks = [_block(picture, begin) for picture in pictures(subject)]
    return {"blocks": blocks, "scene": scene(subject), "worst": worst_rows(subject)}


def _proofs(diagnosis: Any) -> Grid:
    """What exported files alone say of rows that no fit has seen."""
    columns = ("file", "read by", "rows", "nominal robot", "by the file alone", "the format")
    rows = [
        (
            p.file,
            p.reader,
            f"{p.rows}",
            quantity(p.before, p.unit),
            quantity(p.after, p.unit),
            p.lacks,
        )
        for p in proofs(diagnosis)
    ]
    return Grid(columns, rows, (2, 3, 4), sorts=False)


def _block(picture: Picture, begin: str) -> Block:
    return Block.of(replace(picture, key=begin + picture.key))


def _joints(diagnosis: Diagnosed | MotionDiagnosis) -> int:
    """How many joints were recorded."""
    if isinstance(diagnosis, MotionDiagnosis):
        return diagnosis.recording.n
    return diagnosis.recording.chain.n


@dataclass(frozen=True)
class _Line:
    """One parameter as a table shows it."""

    name: str
    value: str
    doc: str


@dataclass(frozen=True)
class _Card:
    """One cause as the page shows it."""

    cause: Cause
    lines: tuple[_Line, ...]
    ripples: tuple[_Line, ...]
    ripple_words: str
    sentence: str
    confounded: tuple[str, ...]

    @classmethod
    def of(cls, cause: Cause) -> _Card:
        found = words.ripples(cause)
        plain = words.plain_parameters(cause).items()
        return cls(
            cause=cause,
            lines=tuple(_Line(name, words.estimate_words(e), e.doc) for name, e in plain),
            ripples=tuple(
                _Line(f"{r.order:g}", measured(r.amplitude, r.std, r.unit), "") for r in found
            ),
            ripple_words=words.ripple_words(found) if found else "",
            sentence=words.cause_words(cause),
            confounded=words.merged(cause.confounded_with, why=False),
        )


def _interval(verdict: Verdict) -> str:
    low, high = verdict.gap.shrink_ci95
    return f"{percent(low)} to {percent(high)}"
