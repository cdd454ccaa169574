"""Recordings of one robot that no one fit can hold, under one verdict: a section for each.

Places (tips, poses, sockets, second encoders) go into one fit, efforts into another, motions into a
third; every recording of ranges or fiducials is one of its own. They share the robot, and next to
no parameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.kinematics.robot import joints_named
from plumbline.optim.core.answer import register, restored
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Outcome, Verdict
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.several.motions import (
    diagnose_motions,
    diagnose_session,
    joined_motions,
)
from plumbline.optim.diagnosis.with_verdict import WithVerdict
from plumbline.optim.model import Applied, Drives, Model
from plumbline.optim.recording.constants import ONE_ROBOT
from plumbline.optim.recording.kinds import EFFORTS, PLACES
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import build_session

Section = Diagnosis | MotionDiagnosis
SECTION_ORDER = (PLACES, (EFFORTS,), ("motion",), ("tracking",), ("plane_range",), ("fiducials",))
# The least settled verdict of the sections is that of all.
CONCLUSIVE = (Outcome.OUTSIDE, Outcome.PARTLY, Outcome.EXPLAINED, Outcome.NO_GAP)


@dataclass(frozen=True, eq=False, repr=False)
class Sections(WithVerdict):
    """A verdict on recordings of several kinds."""

    # that of all: the least settled of the sections' verdicts, the causes of each after those of
    # the one before, the gap of the first, which says where the tip is if any does
    verdict: Verdict
    sections: tuple[Section, ...]  # the diagnosis of each kind

    @property
    def options(self) -> DiagnosisOptions:
        """How it was asked for."""
        return self.sections[0].options

    def of(self, recording: str) -> Section:
        """The section that a recording is in, by its name.

        Raises:
            PlumblineError: There is none of that name.
        """
        names = {name: one for one in self.sections for name in names_of(one)}
        if recording not in names:
            near = best_matches(recording, names)
            raise fault("recording", shown(recording), "one of them", f"best matches: {near}")
        return names[recording]

    def model(self, recording: str = "") -> Model | Drives:
        """The model of the first section, or of the one that a recording is in.

        Raises:
            PlumblineError: There is no recording of that name, or no model of its kind.
        """
        if not recording:
            return self.sections[0].model()
        one = self.of(recording)
        return one.model() if isinstance(one, MotionDiagnosis) else one.model(recording)

    def transfer(self, other: Recording | MotionRecording, *, force: bool = False) -> Applied:
        """The causes of the section of its kind held on another recording.

        Raises:
            PlumblineError: There is no section of its kind, or it is of another robot.
        """
        for one in self.sections:
            if _family(one.recording) == _family(other):
                return tried(one, other, force=force)
        kinds = ", ".join(one.recording.observation for one in self.sections)
        raise fault(other.name, other.observation, kinds, "give a recording of one of these kinds")

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units, with those of every section."""
        return self.verdict.to_dict() | {"sections": [one.to_dict() for one in self.sections]}


def tried(one: Section, other: Recording | MotionRecording, *, force: bool = False) -> Applied:
    """How what a diagnosis found does on another recording.

    Raises:
        PlumblineError: It is of another robot, or of another kind.
    """
    if isinstance(one, MotionDiagnosis) and isinstance(other, MotionRecording):
        return one.model().tried(other)
    if isinstance(one, Diagnosis) and isinstance(other, Recording):
        return one.transfer(other, force=force)
    raise fault(other.name, other.observation, one.recording.observation, "give one of its kind")


def names_of(one: Section) -> tuple[str, ...]:
    """Names of the recordings in a section."""
    return tuple(r.name for r in one.verdict.recordings) or (one.recording.name,)


def diagnose_all(
    recordings: Sequence[Recording | MotionRecording],
    options: DiagnosisOptions | None = None,
    *,
    name: str = "",
    shared: Sequence[str] = (),
    progress: Progress | None = None,
) -> Section | Sections:
    """One verdict on recordings of a robot, of one kind or of several.

    Args:
        recordings: At least one.
        options: How.
        name: What they are called together; their names joined if not given.
        shared: Of places: what is one for all of them, see
            :func:`plumbline.optim.recording.session.build_session`.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: One cannot be used, or they are not of one robot.
    """
    tell = progress or silent
    groups = _groups(recordings)
    found: list[Section] = []
    for k, group in enumerate(groups):

        def told(words: str, share: float, k: int = k) -> None:
            tell(words, (k + share) / len(groups))

        found.append(_section(group, options, name, shared, told))
    return found[0] if len(found) == 1 else Sections(_merged(found, name), tuple(found))


def _section(
    group: Sequence[Recording | MotionRecording],
    options: DiagnosisOptions | None,
    name: str,
    shared: Sequence[str],
    progress: Progress,
) -> Section:
    motions = [r for r in group if isinstance(r, MotionRecording)]
    if motions:
        return diagnose_motions(motions, options, progress=progress)
    rows = [r for r in group if isinstance(r, Recording)]
    if rows and rows[0].element is not None:
        return diagnose(rows[0], options, progress=progress)
    session = build_session(rows, name, _shared(rows, shared))
    return diagnose_session(session, options, progress=progress)


def _shared(rows: Sequence[Recording], shared: Sequence[str]) -> Sequence[str]:
    """What is shared of a frame and a tool, which places alone have."""
    return () if rows[0].kind.efforts else shared


def _groups(
    recordings: Sequence[Recording | MotionRecording],
) -> list[list[Recording | MotionRecording]]:
    """Recordings that go into one fit, those that say where the tip is first."""
    if not recordings:
        build_session(())  # which refuses it
    found: dict[tuple[int, int], list[Recording | MotionRecording]] = {}
    for k, one in enumerate(recordings):
        family = _family(one)
        alone = k if getattr(one, "element", None) is not None else 0
        found.setdefault((family, alone), []).append(one)
    _refuse_other_arms(recordings)
    return [found[key] for key in sorted(found)]


def refuse_unlike(
    recordings: Sequence[Recording | MotionRecording], shared: Sequence[str] = ()
) -> None:
    """Refuse what cannot be asked together, before anything is fitted.

    Raises:
        PlumblineError: They are not of one robot, or one is given twice.
    """
    for group in _groups(recordings):
        motions = [r for r in group if isinstance(r, MotionRecording)]
        rows = [r for r in group if isinstance(r, Recording)]
        if motions:
            joined_motions(motions)
        elif rows[0].element is None:
            build_session(rows, "", _shared(rows, shared))


def _family(one: Recording | MotionRecording) -> int:
    session = one.session if isinstance(one, Recording) else None
    kind = one.observation if session is None else session.parts[0].observation
    return next(k for k, family in enumerate(SECTION_ORDER) if kind in family)


def _refuse_other_arms(recordings: Sequence[Recording | MotionRecording]) -> None:
    """Refuse kinds of different robots under one verdict; each may speak of some joints alone."""
    arms = [(r.name, _placed(r)) for r in recordings]
    arms = [(name, placed) for name, placed in arms if len(placed)]
    for name, placed in arms[1:]:
        first, like = arms[0]
        if not _holds(*sorted((placed, like), key=len)):
            mend = "give recordings of one robot"
            found = "joints placed or turning otherwise"
            raise fault(f"{name}, robot", found, f"those of {first}", mend)


def _holds(some: Array, more: Array) -> bool:
    """Whether these joints (n, 4, 5) are among those (m, 4, 5), in their order."""
    rest = iter(more)
    return all(any(np.allclose(a, b, rtol=0.0, atol=ONE_ROBOT) for b in rest) for a in some)


def _placed(one: Recording | MotionRecording) -> Array:
    """The joints (n, 4, 5) as they are placed, the first one aside; none of what is no arm's."""
    if isinstance(one, Recording):
        joints = () if one.stand_in else one.chain.joints[1:]
    else:
        joints = joints_named(one.robot, one.joints)[1:]
    return np.array([joint.placed for joint in joints])


def _merged(found: Sequence[Section], name: str) -> Verdict:
    verdicts = [one.verdict for one in found]
    first = verdicts[0]
    kind = min((v.verdict for v in verdicts), key=CONCLUSIVE.index)
    worst = max(verdicts, key=lambda v: v.outside_probability)
    return replace(
        first,
        verdict=kind,
        causes=tuple(c for v in verdicts for c in v.causes),
        candidates=tuple(c for v in verdicts for c in v.candidates),
        outside_probability=worst.outside_probability,
        outside_depends_on=worst.outside_depends_on,
        tree=tuple(place for v in verdicts for place in v.tree),
        unobservable=tuple(dict.fromkeys(b for v in verdicts for b in v.unobservable)),
        next=tuple(row for v in verdicts for row in v.next),
        notes=tuple(dict.fromkeys(note for v in verdicts for note in v.notes)),
        judged=Judgement.of(f for v in verdicts for f in v.judged.fits),
        recording=name or " + ".join(v.recording for v in verdicts),
        rows=sum(v.rows for v in verdicts),
        recordings=tuple(r for v in verdicts for r in v.recordings),
        transfer=tuple(t for v in verdicts for t in v.transfer),
        unjudged=", ".join(filter(None, (v.unjudged for v in verdicts))),
    )


def _taken(found: Sections) -> dict[str, Any]:
    named = [{"kind": type(one).__name__, "fields": one} for one in found.sections]
    return {"verdict": found.verdict, "sections": named}


def _made(data: Any) -> Sections:
    kinds = {kind.__name__: kind for kind in (Diagnosis, MotionDiagnosis)}
    parts: list[Any] = [restored(one["fields"], kinds[one["kind"]]) for one in data["sections"]]
    return Sections(restored(data["verdict"], Verdict), tuple(parts))


register(Sections, _taken, _made)
