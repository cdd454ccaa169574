"""Several recordings of one robot as one: their rows stacked, each row with the one it is of.

What is each one's own (frame, tool, sockets, noise, what a column was measured with) is asked of
the parts; what they have in common (the robot, its joint readings) stands in the whole. A part
without a column that others have is filled up: whatever reads that column is confined to those.

A session on disk: a folder of recordings' folders with ``session.toml``.

.. code-block:: toml

    name = "arm 7"
    recordings = ["tracker", "encoders"]   # folders beside this file
    shared = ["tool"]                      # of frame, tool, sockets; each one's own unless named

    [robot]                                # for recordings that name none themselves
    bundled = "ur5"
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError, best_matches, fault, one_line, shown
from plumbline.kinematics.chain import Chain, Joint
from plumbline.kinematics.files import is_file, is_folder
from plumbline.optim.core.quantities import counted
from plumbline.optim.recording import constants, loading
from plumbline.optim.recording.kinds import EFFORTS, MIXED, PLACES
from plumbline.optim.recording.recording import CONTEXT, Recording, Session, hash_of
from plumbline.optim.recording.settings import Section, read_settings
from plumbline.optim.recording.table import Array, Integers

Rows = frozenset[bytes]  # each once, in no order

SHARED = ("frame", "tool", "sockets")
MEAN = ("time", "temperature")  # columns that are filled up with their mean; others with nothing


def build_session(
    recordings: Sequence[Recording], name: str = "", shared: Sequence[str] = ()
) -> Session:
    """Check that the recordings are of one robot, and call each by a name of its own.

    Args:
        recordings: At least one.
        name: What they are called together; their names joined if not given.
        shared: What is one for all of them, of :data:`SHARED`.

    Raises:
        PlumblineError: One is of another robot, a copy of one, or cannot be fitted with them.
    """
    for what in shared:
        if what not in SHARED:
            raise fault("shared", repr(what), f"of {', '.join(SHARED)}", "leave it out")
    if not recordings:
        raise PlumblineError("no recording given, at least one expected; name their folders")
    before: list[tuple[str, Rows]] = []
    for other in recordings:
        _refuse_other(recordings[0], other)
        rows = rows_of(other.q, other.measured)
        refuse_copies(before, other.name, rows)
        before.append((other.name, rows))
    parts = tuple(
        replace(r, name=own)
        for r, own in zip(recordings, named_apart([r.name for r in recordings]), strict=True)
    )
    return Session(name or " + ".join(p.name for p in parts), parts, tuple(shared))


def joined(session: Session, sigmas: Sequence[float] | None = None) -> Recording:
    """All rows as one recording, residuals in units of one noise.

    ``sigmas`` are of each recording's residuals [m, or rad of encoders; of efforts times what is
    stated]; as they state it, or alike, if not given.
    """
    parts, first = session.parts, session.parts[0]
    stated = [p.noise_std for p in parts]
    known = all(stated)
    noises = np.array(sigmas if sigmas is not None else [s or 1.0 for s in stated], dtype=float)
    label = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    efforts = first.kind.efforts
    by_joint: Array | None = None
    if efforts:
        by_joint, shape = _noise_by_joint(session, sigmas or [1.0] * len(parts))
        whole = float(np.sqrt(np.mean(by_joint**2)))
    else:
        whole, shape = _noise_shape(session, noises)
        if known:  # what is stated, and not what the rows weigh, is held against what is left
            whole = _noise_shape(session, np.array(stated, dtype=float))[0]
    kinds = {p.observation for p in parts}
    return Recording(
        name=session.name,
        observation=first.observation if len(kinds) == 1 else MIXED,
        robot=first.robot,
        chain=first.chain,
        tip_frame=first.tip_frame,
        q=np.vstack([p.q for p in parts]),
        measured=_measured(session),
        tool_offset=first.tool_offset,
        socket=_sockets(session),
        turning=np.concatenate([p.turning for p in parts if p.turning is not None])
        if efforts  # whose sense of turning is made with the recording
        else None,
        noise_std=whole if known else None,
        noise_by_joint=by_joint,
        noise_shape=shape,
        scale_std=first.scale_std if len({p.scale_std for p in parts}) == 1 else None,
        always=_always(session),
        measured_joints=first.measured_joints if efforts else session.encoders,
        session=session,
        part=label,
        sha256=hash_of(*(p.sha256.encode() for p in parts)),
        notes=tuple(one_line(f"{p.name}: {note}") for p in parts for note in p.notes),
        **_context(session),
    )


def _noise_shape(session: Session, noises: Array) -> tuple[float, Array | None]:
    """One noise, and that of every row's residuals (N, m) over it; None if all are alike."""
    shapes, counted = [], []
    for k, part in enumerate(session.parts):
        live = session.live(k)
        shape = np.ones((len(part), session.residuals))
        if part.noise_shape is not None:
            own = part.noise_shape
            if part.kind.encoders:
                own = own[:, [j for j in session.encoders if j in part.measured_joints]]
            shape[:, live] = own[:, : int(live.sum())]
        shapes.append(noises[k] * shape)
        gap = part.kind.places or not session.has_positions
        counted.append(shapes[k][:, live].ravel() if gap else np.empty(0))
    whole = float(np.sqrt(np.mean(np.concatenate(counted) ** 2)))
    found = np.vstack(shapes) / whole
    alike = np.allclose(found, 1.0, rtol=1e-12)
    return whole, None if alike else found


def _noise_of(part: Recording) -> Array:
    assert part.noise_by_joint is not None  # of efforts: made with the recording
    return part.noise_by_joint


def _shape_of(part: Recording) -> Array:
    return np.ones((len(part), 1)) if part.noise_shape is None else part.noise_shape


def _noise_by_joint(session: Session, times: Sequence[float]) -> tuple[Array, Array | None]:
    """Noise of all rows' efforts by joint (n,) [N m or N], and that of every row over it (N, n)."""
    both = zip(session.parts, times, strict=True)
    rows = np.concatenate([s * _noise_of(p) * _shape_of(p) for p, s in both])
    whole = np.sqrt(np.mean(rows**2, axis=0))
    return whole, None if np.allclose(rows, whole, rtol=1e-12) else rows / whole


def _measured(session: Session) -> Array:
    """Positions, quaternions and second encoders side by side, where there are any, or efforts."""
    if session.parts[0].kind.efforts:
        return np.concatenate([p.measured for p in session.parts])
    return np.vstack([np.hstack(_columns(session, p)) for p in session.parts])


def _columns(session: Session, part: Recording) -> list[Array]:
    rows, device = len(part), part.kind.device
    found = [np.empty((rows, 0))]
    if session.has_device:
        found.append(part.measured[:, :3] if device else np.zeros((rows, 3)))
    if session.has_poses:
        still = np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1))
        found.append(part.measured[:, 3:] if part.kind.oriented else still)
    if session.encoders:
        encoders = part.kind.encoders
        read = part.measured if encoders else part.q
        found.append(np.where(np.isnan(read), part.q, read))
    return found


def _sockets(session: Session) -> Integers | None:
    if not any(p.kind.sockets for p in session.parts):
        return None
    return np.concatenate(
        [
            np.full(len(p), constants.NO_SOCKET)
            if p.socket is None or not p.kind.sockets
            else p.socket + session.first_socket(k)
            for k, p in enumerate(session.parts)
        ]
    )


def _context(session: Session) -> dict[str, Any]:
    """Columns that any of the recordings has, those of the others filled up."""
    found: dict[str, Any] = {}
    for name in CONTEXT:
        own = [getattr(p, name) for p in session.parts]
        there = [v for v in own if v is not None]
        if not there or (name == "acceleration" and not session.parts[0].kind.efforts):
            continue
        fill = np.mean(np.concatenate(there)) if name in MEAN else np.zeros(there[0].shape[1:])
        blank = [np.full((len(p), *there[0].shape[1:]), fill) for p in session.parts]
        stacked = [b if v is None else v for v, b in zip(own, blank, strict=True)]
        found[name] = np.concatenate(stacked).astype(there[0].dtype)
    return found


def _always(session: Session) -> tuple[str, ...]:
    """What every recording fits of frame and tool, those that have none aside."""
    asked = [p.always for p in session.parts if p.kind.places]
    return tuple(w for w in ("frame", "tool") if asked and all(w in own for own in asked))


def named_apart(names: Sequence[str]) -> list[str]:
    """Names of recordings, those that are not told apart with their number."""
    return [n if names.count(n) == 1 else f"{n} ({k})" for k, n in enumerate(names, start=1)]


def refuse_copies(before: Sequence[tuple[str, Rows]], name: str, rows: Rows) -> None:
    """Refuse rows most of which another has, too: a copy, in whatever order, knows no more.

    Raises:
        PlumblineError: Most rows of the one or of the other stand in both.
    """
    for one, theirs in before:
        common = len(rows & theirs)
        if common > constants.MOST_IN_COMMON * min(len(rows), len(theirs)):
            alike = f"as {one}, {common} rows alike"
            raise PlumblineError(
                one_line(f"{name}: given twice ({alike}), once expected; leave one out")
            )


def rows_of(*columns: Array) -> Rows:
    """Every row of these columns, to the last bit."""
    return frozenset(map(bytes, np.column_stack(columns)))


def _refuse_other(first: Recording, other: Recording) -> None:
    """Refuse a recording that cannot be fitted together with the first."""
    kinds = (EFFORTS,) if first.kind.efforts else PLACES
    if other.observation not in kinds:
        mend = "diagnose each kind on its own, or all with plumbline.diagnose([...])"
        raise fault(other.name, other.observation, f"one of {', '.join(kinds)}", mend)
    mend = "give recordings of one robot"
    if other.chain.n != first.chain.n:
        like = f"{first.chain.n} as in {first.name}"
        raise fault(f"{other.name}, joints", str(other.chain.n), like, mend)
    if not placed_alike(first.chain, other.chain):
        found = f"{other.robot.name} with joints placed or turning otherwise"
        raise fault(f"{other.name}, robot", found, f"{first.robot.name} as in {first.name}", mend)
    if not np.allclose(first.chain.gravity, other.chain.gravity, atol=constants.SAME_GRAVITY):
        found, like = (str(np.round(r.chain.gravity, 2)) for r in (other, first))
        raise fault(f"{other.name}, gravity", found, like, "mounted otherwise: diagnose it alone")


def placed_alike(one: Chain, other: Chain) -> bool:
    """Whether two chains have the same joints, turning the same way; where the first is, aside."""
    return same_joints(one.joints, other.joints)


def same_joints(some: Sequence[Joint], others: Sequence[Joint]) -> bool:
    """Whether as many joints stand in the same places, the first one's aside, and move alike.

    A joint that turns the other way errs the other way at the same reading.
    """
    if len(some) != len(others):
        return False
    one, other = (
        np.array([joint.placed for joint in joints]).reshape(-1, 4, 5) for joints in (some, others)
    )
    near = np.isclose(one, other, rtol=0.0, atol=constants.ONE_ROBOT)
    near[:1, :, :4] = True
    return bool(near.all())


def apart(recording: Recording) -> tuple[Session, Integers]:
    """The recordings that its rows are of, and which of them each is of (N,); refused of one."""
    if recording.session is None or recording.part is None:
        raise PlumblineError(f"{recording.name}: one recording, several expected")
    return recording.session, recording.part


def named_row(recording: Recording, row: int) -> str:
    """A row of a table, whose header is row 1; of several recordings' rows whose it is as well."""
    if not recording.several:
        return str(row)
    for part in apart(recording)[0].parts:
        if row < len(part) + constants.FIRST_ROW:
            return f"{part.name} {row}"
        row -= len(part)
    raise IndexError(row)


FILE = "session.toml"
KEYS = ("name", "recordings", "shared", "robot")
ROBOT = (*loading.SOURCES_OF_ROBOT, "tip_frame", "gravity", "name")


def is_session(folder: str | Path) -> bool:
    """Whether a folder holds a session of several recordings."""
    place = Path(folder)
    return is_folder(place) and is_file(place / FILE)


@dataclass(frozen=True, eq=False)
class SessionFile:
    """What a ``session.toml`` says."""

    name: str  # what the recordings are called together
    place: Path  # the folder
    recordings: tuple[str, ...]  # names of folders in it
    shared: tuple[str, ...]  # of :data:`SHARED`
    robot: loading.RobotFiles | None  # for recordings that name none themselves, if any


def open_session(folder: str | Path) -> SessionFile:
    """Read and check a ``session.toml``, refused if it cannot be used; nothing is written."""
    place = Path(folder)
    settings = read_settings(FILE, loading.read_bytes(place, FILE))
    settings.refuse_unknown(KEYS)
    settings.section("robot").refuse_unknown(ROBOT)
    names = settings.words("recordings") or ()
    if not names:
        raise fault(
            settings.where("recordings"), "nothing", "folders", 'write recordings = ["a", "b"]'
        )
    name, times = Counter(names).most_common(1)[0]
    if times > 1:  # told before any is read
        where, found = settings.where("recordings"), f"{shown(name)} {counted(times, 'time')}"
        raise fault(where, found, "each once", "leave the others out")
    shared = settings.words("shared") or ()
    for word in shared:
        if word not in SHARED:
            raise settings.fault("shared", f"of {', '.join(SHARED)}", "leave the others out")
    robot = loading.read_robot(settings, place) if "robot" in settings.values else None
    for name in names:
        _refuse_absent(settings, place, name)
    called = settings.word("name") or place.resolve().name
    return SessionFile(called, place, names, shared, robot)


def robot_of_part(folder: Path, robot: loading.RobotFiles | None) -> loading.RobotFiles | None:
    """The session's robot as a recording has it; None where that names one itself."""
    own = loading.open_folder(folder).settings.section("robot")
    if robot is None or any(key in own.values for key in loading.SOURCES_OF_ROBOT):
        return None
    made = replace(robot, tip_frame=own.word("tip_frame") or robot.tip_frame)
    gravity = own.vector("gravity")
    if gravity is None:
        return made
    return replace(made, robot=made.robot.with_gravity(gravity))


def _refuse_absent(settings: Section, place: Path, name: str) -> None:
    """Refuse a recording that is no folder beside the session's file."""
    path = Path(name)
    inside = not path.is_absolute() and ".." not in path.parts and name.isprintable()
    if inside and is_folder(place / path):
        return
    there = sorted(p.parent.name for p in place.glob("*/dataset.toml"))
    found, near = f"{shown(name)}, no folder in {place.name}", best_matches(name, there)
    where = settings.where("recordings")
    raise fault(where, found, "folders beside it", f"best matches: {near or 'none'}")
