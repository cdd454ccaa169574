"""The diagnosis of a motion: what each joint's drive does to its commands, and what is left."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.law import Law
from plumbline.optim.core.constants import STILL as AT_REST
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.core.side_by_side import side_by_side
from plumbline.optim.core.threads import one_thread
from plumbline.optim.diagnosis.motion import carrying
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.carried import NOTHING, Off
from plumbline.optim.diagnosis.motion.constants import (
    CONTENDS,
    MOVES,
    SEARCH_SAMPLES,
    SEARCHED,
    STILL,
)
from plumbline.optim.diagnosis.motion.fit import correlation_time
from plumbline.optim.diagnosis.motion.lead import as_told, others
from plumbline.optim.diagnosis.motion.left_out import left_out
from plumbline.optim.diagnosis.motion.models import Key, Models, nested
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.rotor_or_link import or_links
from plumbline.optim.diagnosis.motion.search import Begun, prior_at, search
from plumbline.optim.diagnosis.motion.signals import Signals, signals_of, spread
from plumbline.optim.diagnosis.motion.tracking import load_drives
from plumbline.optim.diagnosis.motion.verdict import MotionFindings, verdict_of
from plumbline.optim.diagnosis.motion.windows import Array, Drives
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.prior import NO_EVIDENCE


@one_thread()
def diagnose_motion(
    recording: MotionRecording | str | Path,
    options: DiagnosisOptions | None = None,
    *,
    progress: Progress | None = None,
) -> MotionDiagnosis:
    """Say what each joint's drive does to its commands.

    Args:
        recording: What was recorded, or the folder of it.
        options: Seed of the interval's draws, effects to leave out, prior of what is unlisted.
        progress: Called with what is being done and the share done.

    Raises:
        PlumblineError: The folder cannot be used, or no run is as long as a window.
    """
    options, tell = options or DiagnosisOptions(), progress or silent
    r = recording if isinstance(recording, MotionRecording) else load_drives(recording)
    r = replace(r, carried=NOTHING)  # which an answer's recording has
    found = _searched(r, options, tell)
    signals, begun = found.signals, found.begun
    if (law := _between_rows(r)) is not None:
        other = signals_of(replace(r, law=law))
        if _more_evident(other, signals, begun):
            signals, begun = _begun(options, tell, other, begun)
    r, prior = signals.recording, prior_at(options.unlisted, len(begun))
    # What was looked at most takes longest: last, all others would have to wait for it.
    longest = sorted(begun, key=lambda one: -len(one.quick.found))
    joints = side_by_side(
        lambda one: search(one, prior, signals.sigma), longest,
        lambda k: tell(f"{r.noun} {longest[k].number}", (1 + k / len(begun)) / 2),
    )  # fmt: skip
    joints.sort(key=lambda joint: joint.number)
    asked = carrying.candidates(r, options.without)
    mass = carrying.mass_findings(signals, joints, found.more, found.plain, asked, found.rivals)
    joints = [*or_links(signals, joints, asked)]
    unseen = left_out(signals, joints)
    still = [j + 1 for j in range(r.n) if j not in _moved(r)]
    told = MotionFindings(
        r, tuple(joints), unseen, still, signals.held_out_by, options.seed, options.unlisted,
        signals.averaged, mass,
    )  # fmt: skip
    return MotionDiagnosis(r, verdict_of(told), signals, tuple(joints), unseen, options, mass)


def _between_rows(r: MotionRecording) -> Law | None:
    """What commands may do between rows but run straight."""
    if r.law == Law.SERVO:
        return Law.HELD_SERVO
    if r.law != Law.POSITION:
        return None
    steps = np.any(np.diff(r.command, axis=0) != 0, axis=1)
    alone = steps[1:-1] & ~steps[:-2] & ~steps[2:]  # what stood, changes, and stands again
    return Law.HELD if 2 * alone.sum() > steps[1:-1].sum() else Law.SMOOTH


def _moved(r: MotionRecording) -> list[int]:
    """Joints, from 0, that did anything."""
    return [j for j in range(r.n) if np.ptp(r.command[:, j]) + np.ptp(r.q[:, j]) > STILL]


Stand = tuple[Signals, tuple[Begun, ...]]  # an even clock, and where each joint's search stands
Begin = Callable[..., Stand]  # from an even clock on, and from what a search found before


@dataclass(frozen=True, eq=False)
class _Searched:
    """An even clock, and where the search of each joint that moved stands on a few windows."""

    signals: Signals
    begun: tuple[Begun, ...]
    more: float = 0.0  # log odds of a mass that is carried against none
    plain: tuple[Begun, ...] = ()  # where it stood without one
    # by a body's label its log odds against what a drive may do in its place, and that
    rivals: carrying.Rivals = field(default_factory=dict)


def _searched(r: MotionRecording, options: DiagnosisOptions, tell: Progress) -> _Searched:
    """Where a search stands by drives alone, or by bodies that weigh other than the file says.

    Masses are asked of ideal drives, as others are found in their place, then of those found.
    """
    begin = partial(_begun, options, tell)
    plain, asked = begin(signals_of(r)), carrying.candidates(r, options.without)
    if not asked:
        return _finished(_Searched(*_by_neighbours(begin, *plain)))
    found = _carrying(begin, plain, (), asked)
    if found is None or found.more < CONTENDS:
        plain = _by_neighbours(begin, *plain)
        found = _carrying(begin, plain, carrying.drives_of_all(plain[1], r.n), asked) or found
    if found is None:
        return _finished(_Searched(*plain))
    found = _without_stand_ins(begin, _still(begin, found))
    more = _more_probable(found.signals, found.begun, plain[1])
    return _finished(replace(found, more=more, plain=plain[1]) if more > 0 else _Searched(*plain))


def _still(begin: Begin, found: _Searched) -> _Searched:
    """The same by what neighbours give, until the mass that is carried stands still."""
    signals, begun = _by_neighbours(begin, found.signals, found.begun)
    before = None
    for _ in range(MOVES):
        fit = carrying.told_by(signals, begun)
        if fit.off < AT_REST or not fit.real:
            break
        moved, before = carrying.further(signals, fit, before)
        if moved is None:
            break
        signals, begun = begin(moved, begun)
    return replace(found, signals=signals, begun=begun)


def _without_stand_ins(begin: Begin, found: _Searched) -> _Searched:
    """The same with less of each body that one joint alone feels, whose drive is more probable."""
    for body in found.signals.recording.carried.bodies:
        for other in carrying.lesser(found.signals, found.begun, body):
            signals, begun = found.signals, found.begun
            if (less := carrying.felt_by_one(signals, begun, other)) is None:
                continue
            _, anew = begin(less)
            sure = _more_probable(signals, begun, anew) - carrying.against(less, anew)
            if sure < 0:
                drives = carrying.drives_of_all(anew, less.recording.n)
                if (fewer := carrying.states_by(less.recording, drives)) is None:
                    continue
                signals, begun = begin(fewer)
                found = _still(begin, replace(found, signals=signals, begun=begun))
                break
            effects = [(e.name, one.number) for one in anew for e in one.near.effects]
            found.rivals.setdefault(body.label, (sure, effects))
    return found


def _carrying(begin: Begin, plain: Stand, drives: Drives, asked: Sequence[Off]) -> _Searched | None:
    """Where a search stands with one of these masses, if that may be the more probable."""
    given = carrying.carrying_more(*plain, drives, asked)
    if given is None:
        return None
    signals, begun = begin(given)
    return _Searched(signals, begun, _more_probable(signals, begun, plain[1]), plain[1])


def _more_probable(signals: Signals, begun: Sequence[Begun], plain: Sequence[Begun]) -> float:
    """Log odds of a search with a mass against one without."""
    return float(_log_odds(begun, plain).sum()) + carrying.against(signals, begun)


def _finished(found: _Searched) -> _Searched:
    done = [replace(one, key=one.quick.from_pairs(one.key, one.sigma)) for one in found.begun]
    return replace(found, begun=tuple(done))


def _by_neighbours(begin: Begin, signals: Signals, begun: tuple[Begun, ...]) -> Stand:
    """The search anew, under torques, while what all joints did becomes more probable.

    What is found at one joint is part of what its neighbours feel.
    """
    for _ in range(MOVES if signals.recording.law.pushes else 0):
        if not any(one.near.effects for one in begun):
            break
        before, was = begun, signals
        for given in others(signals, begun):
            other, anew = begin(given)
            if _log_odds(anew, begun).sum() > 0:
                signals, begun = other, anew
                break
        else:
            # Whose drive is better now may be what another's is worse by.
            better = zip(_log_odds(anew, begun) > 0, anew, begun, strict=True)
            best = [new if is_better else old for is_better, new, old in better]
            other, anew = begin(as_told(signals, best))
            if _log_odds(anew, begun).sum() > 0:
                signals, begun = other, anew
        if signals is was or [one.key for one in begun] == [one.key for one in before]:
            break
    return signals, begun


def _log_odds(some: Sequence[Begun], others: Sequence[Begun]) -> Array:
    """Of one search's drives (n,) against another's, by what each joint did.

    Of one drive alone no odds tell whose neighbours are the right ones: their sum does.
    """
    more = []
    for pair in zip(some, others, strict=True):
        time = correlation_time(min((one.near for one in pair), key=lambda f: f.square).residual)
        its, own = (one.quick.score(one.key, time) for one in pair)
        more.append(its - own)
    return np.array(more)


def _begun(
    options: DiagnosisOptions, tell: Progress, signals: Signals, before: Sequence[Begun] = ()
) -> Stand:
    """An even clock, and where the search of each joint that moved begins.

    From what a search found before, with other commands between rows, if any did.

    Raises:
        PlumblineError: No run is as long as a window.
    """
    r = signals.recording
    kinds = [e for e in MOTION_EFFECTS if e.name not in options.without]
    effects = tuple(e for c in kinds for e in c.candidates(r.law, masses=signals.has_masses))
    training = signals.training
    if not len(training):
        raise PlumblineError(
            f"{r.name}: no run is as long as a window of {signals.length * signals.dt:.3g} s; "
            "hold fewer rows out, or record for longer"
        )
    coarse = signals_of(r, SEARCH_SAMPLES) if r.law.ideal else signals
    looked_at = spread(coarse.training, SEARCHED * coarse.most)
    moved = _moved(r)

    def looked(k: int) -> tuple[Models, Key]:
        quick = Models(coarse.windows(moved[k], looked_at), effects, signals.seen(moved[k]))
        key = quick.begun_by(before[k].quick, before[k].key) if before else quick.climb()
        return quick, quick.settle(key)

    found = side_by_side(
        looked, range(len(moved)), lambda k: tell(f"{r.noun} {moved[k] + 1}", k / len(moved) / 2)
    )
    return signals, tuple(
        Begun(j + 1, signals.windows(j, training), *one, coarse.sigma)
        for j, one in zip(moved, found, strict=True)
    )


def _more_evident(other: Signals, signals: Signals, begun: Sequence[Begun]) -> bool:
    """Whether other commands between rows make what all joints did more probable, strongly so.

    Of each joint's effects those that are left over are dropped first: half a row of delay most of
    all where commands are held, a servo of second order where they are smooth. Either is as
    probable beforehand.
    """
    more = 0.0
    for one in begun:
        its_windows = other.windows(one.number - 1, other.training)
        both = [nested(w, one.near, one.quick.seen) for w in (its_windows, one.windows)]
        time = min(both, key=lambda found: found[0].found[found[1]].square)[0].time
        its, its_own = (models.score(key, time) for models, key in both)
        more += its - its_own
    return more > NO_EVIDENCE
