"""A diagnosis as one HTML file: pictures inside, nothing fetched, no script, the same every time.

``write_report(diagnosis, "report.html")`` writes it, :func:`html_report` gives its text.
"""

from __future__ import annotations

import html
from dataclasses import dataclass
from importlib import metadata
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from plumbline.experiments.report.diagnosis.motion import motion_pictures
from plumbline.experiments.report.diagnosis.phrases import (
    Elsewhere,
    confounded_lines,
    distrusted_words,
    suggestion_words,
)
from plumbline.experiments.report.diagnosis.pictures import Picture, pictures
from plumbline.experiments.report.diagnosis.subject import Diagnosed, Subject
from plumbline.experiments.report.style import svg
from plumbline.kinematics.files import write_whole
from plumbline.optim.core.quantities import chance, measured, percent, quantity
from plumbline.optim.diagnosis.findings import Cause, Verdict
from plumbline.optim.diagnosis.motion.diagnose import MotionDiagnosis
from plumbline.optim.diagnosis.verdict import words

PACKAGES = ("plumbline-robotics", "casadi", "pin", "numpy")


def write_report(
    diagnosis: Diagnosed | MotionDiagnosis,
    path: str | Path,
    *,
    seed: int | None = None,
    elsewhere: Elsewhere | None = None,
) -> Path:
    """Write the report of a diagnosis.

    Args:
        diagnosis: The diagnosis.
        path: File to write; one that is there is replaced.
        seed: What it was drawn with; the diagnosis's own unless given.
        elsewhere: How the model does on another recording.

    Raises:
        OSError: The file cannot be written.
    """
    target = Path(path)
    write_whole(target, html_report(diagnosis, seed=seed, elsewhere=elsewhere))
    return target


def html_report(
    diagnosis: Diagnosed | MotionDiagnosis,
    *,
    seed: int | None = None,
    elsewhere: Elsewhere | None = None,
) -> str:
    """The report's text; the same diagnosis gives the same bytes."""
    verdict = diagnosis.verdict
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["percent"] = percent
    environment.filters["chance"] = chance
    environment.globals["quantity"] = quantity
    environment.globals["without_words"] = words.without_words
    template = (files("plumbline.experiments.report.diagnosis") / "report.html.j2").read_text(
        encoding="utf-8"
    )
    return environment.from_string(template).render(
        verdict=verdict,
        recording=diagnosis.recording,
        meaning=verdict.meaning,
        gap_words=words.gap_words(verdict),
        shrink_words=words.shrink_words(verdict),
        left_over=words.left_over(verdict.outside_depends_on),
        noise_words=words.noise_words(verdict.noise, verdict.gap.unit),
        floor_words=words.floor_words(verdict),
        interval=_interval(verdict),
        causes=[_Card.of(cause) for cause in verdict.causes],
        blocks=[_Block.of(picture) for picture in _pictures(diagnosis)],
        unobservable=words.merged(verdict.unobservable),
        confounded=confounded_lines(verdict.causes),
        suggestions=[suggestion_words(entry) for entry in verdict.next],
        distrusted=distrusted_words(verdict.distrusted_rows),
        elsewhere=elsewhere,
        versions=versions(),
        joints=_joints(diagnosis),
        seed=_seed(diagnosis) if seed is None else seed,
    )


def _pictures(diagnosis: Diagnosed | MotionDiagnosis) -> tuple[Picture, ...]:
    if isinstance(diagnosis, MotionDiagnosis):
        return motion_pictures(diagnosis)
    return pictures(Subject.of(diagnosis))


def _joints(diagnosis: Diagnosed | MotionDiagnosis) -> int:
    """How many joints were recorded."""
    if isinstance(diagnosis, MotionDiagnosis):
        return diagnosis.recording.n
    return diagnosis.recording.chain.n


def _seed(diagnosis: Diagnosed | MotionDiagnosis) -> int:
    """What its draws began with."""
    if isinstance(diagnosis, MotionDiagnosis):
        return diagnosis.seed
    return diagnosis.options.seed


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


@dataclass(frozen=True)
class _Block:
    """One picture as the page shows it."""

    picture: Picture
    drawings: tuple[Markup, ...]

    @classmethod
    def of(cls, picture: Picture) -> _Block:
        label = html.escape(f"{picture.title}. {picture.words}", quote=True)
        drawn = [
            svg(figure, f"{picture.key}{k}", label) for k, figure in enumerate(picture.figures)
        ]
        # The drawings are ours, their label is escaped; names inside were escaped by matplotlib.
        return cls(picture, tuple(Markup(text) for text in drawn))


def _interval(verdict: Verdict) -> str:
    low, high = verdict.gap.shrink_ci95
    return f"{percent(low)} to {percent(high)}"


def versions() -> tuple[tuple[str, str], ...]:
    """Packages that the figures depend on, with their versions."""
    return tuple((name, _version(name)) for name in PACKAGES)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
