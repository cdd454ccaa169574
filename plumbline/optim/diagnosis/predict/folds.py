"""What is left out together: sessions, stretches of time, blocks of the workspace, or rows.

Rows of one trajectory resemble each other, so leaving out some of them proves nothing; whole
sessions or blocks do. Separate postures without a session may be left out one by one.
"""

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.evaluate import Array, Indices
from plumbline.optim.diagnosis.prior import FEWEST_ROWS, LEAST_LEFT, MOST_FOLDS
from plumbline.optim.measurement.correlated import postures
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.session import apart

KINDS = ("auto", "groups", "time", "workspace", "rows")


def fold_of_rows(recording: Recording, kind: str = "auto", seed: int = 0) -> Indices:
    """Fold (N,) of every row, counted from 0.

    Args:
        recording: N rows.
        kind: One of :data:`KINDS`. ``auto`` takes groups where there are two or more and none holds
            nearly all rows, stretches of time where the rows are samples of one motion, else rows
            drawn by ``seed``.
        seed: Of the draw of single rows.

    Raises:
        PlumblineError: An unknown kind, or groups asked for where there are none.
    """
    if kind not in KINDS:
        raise PlumblineError(f"held out by {kind!r} not recognised; choose from {', '.join(KINDS)}")
    if recording.several:
        return _of_each(recording, kind, seed)
    groups = recording.group
    if kind == "groups" and not _grouped(recording):
        raise PlumblineError(
            "held out by groups: no column 'group' with two or more values; use rows"
        )
    kind = kind_of_folds(recording, kind)
    if kind == "motions":
        return folds_of_motions(recording)
    if kind == "touches":
        return folds_of_touches(recording)
    if kind == "groups" and groups is not None:
        labels = np.unique(groups, return_inverse=True)[1]
        return np.asarray(labels % MOST_FOLDS, dtype=np.intp)
    if kind == "workspace":
        return _workspace_blocks(_places(recording), _count(len(recording)))
    reading = _readings(recording)
    order = np.arange(int(reading.max(initial=-1)) + 1)
    if kind == "rows":
        order = np.random.default_rng(seed).permutation(len(order))
    folds = np.empty(len(order), dtype=np.intp)
    count = min(_count(len(recording)), len(order))
    folds[order] = np.arange(len(order)) * count // len(order)
    return folds[reading]


def _count(rows: int) -> int:
    """Folds of so many rows."""
    return int(np.clip(rows // FEWEST_ROWS, 2, MOST_FOLDS))


def _readings(recording: Recording) -> Indices:
    """Of every row (N,) which reading it is of, in order: rows that know of each other are one.

    Of a single posture, of which nothing would be left, each row is.
    """
    _, first, posture = np.unique(postures(recording), return_index=True, return_inverse=True)
    if not recording.alike or len(first) < 2:
        return np.arange(len(recording))
    return np.asarray(np.argsort(np.argsort(first))[posture], dtype=np.intp)


def _of_each(recording: Recording, kind: str, seed: int) -> Indices:
    """Every fold leaves out rows of all recordings, of each as it would be on its own."""
    session, own = apart(recording)
    folds = np.empty(len(recording), dtype=np.intp)
    for k, part in enumerate(session.training.parts):
        try:
            folds[own == k] = fold_of_rows(part, kind, seed)
        except ValueError as error:
            raise PlumblineError(f"{part.name}: {error}") from None
    return folds


def blocks_of(recording: Recording) -> Indices:
    """Blocks (N,) of rows that may err alike for want of something in the model, from 0.

    Recordings of several; else stretches of a motion, or of what has a clock, or of the workspace.
    """
    count = _count(len(recording))
    if recording.several:
        return np.asarray(apart(recording)[1], dtype=np.intp)
    if recording.time is not None or scope_of(recording).moving:
        return np.arange(len(recording), dtype=np.intp) * count // len(recording)
    return _workspace_blocks(_places(recording), count)


def blocks_of_each(recording: Recording) -> Indices:
    """Blocks (N,) of rows as :func:`blocks_of` has them, of several recordings each one's own."""
    if not recording.several:
        return blocks_of(recording)
    session, own = apart(recording)
    label, count = np.zeros(len(recording), dtype=np.intp), 0
    for k, part in enumerate(session.training.parts):
        mine = own == k
        label[mine] = count + blocks_of(part)
        count = int(label.max(initial=0)) + 1
    return label


def kind_of_folds(recording: Recording, kind: str) -> str:
    """What ``auto`` comes to for a recording; of several, all their kinds."""
    if kind != "auto":
        return kind
    if recording.several:
        kinds = (kind_of_folds(part, kind) for part in apart(recording)[0].training.parts)
        return " and ".join(dict.fromkeys(kinds))
    if recording.element is not None and not _well_grouped(recording):
        return "motions" if _has_motions(recording) else "touches"
    moving = scope_of(recording).moving
    in_order = moving or recording.wander > 0.0
    return "groups" if _well_grouped(recording) else "time" if in_order else "rows"


def _has_motions(recording: Recording) -> bool:
    return recording.motion is not None and len(np.unique(recording.motion)) > 1


def folds_of_motions(recording: Recording) -> Indices:
    """Whole motions (N,), on each plane so that other motions say where it stands, if it has any.

    The plane of a single motion is left out with it, and placed by its own rows.
    """
    assert recording.motion is not None
    assert recording.element is not None
    folds = np.unique(recording.motion, return_inverse=True)[1] % MOST_FOLDS
    for k in np.unique(recording.element):
        mine = recording.element == k
        most = np.bincount(folds[mine]).max() / mine.sum()
        if 1.0 - most > LEAST_LEFT:
            continue
        numbers = np.unique(recording.motion[mine], return_inverse=True)[1]
        folds[mine] = numbers % MOST_FOLDS
    return np.asarray(np.unique(folds, return_inverse=True)[1], dtype=np.intp)


def folds_of_touches(recording: Recording) -> Indices:
    """Single rows (N,), no two of one marker or plane in a fold as far as there are folds enough.

    Of markers that are touched once few are left out at a time: what holds the frame is scarce.
    """
    assert recording.element is not None
    part, count = recording.element, len(np.unique(recording.element))
    turn = np.zeros(len(part), dtype=np.intp)
    for k in np.unique(part):
        turn[part == k] = np.arange((part == k).sum())
    most = MOST_FOLDS if turn.any() else min(count, 2 * MOST_FOLDS)
    return np.asarray(np.unique((turn + part) % most, return_inverse=True)[1], dtype=np.intp)


def _grouped(recording: Recording) -> bool:
    return recording.group is not None and len(np.unique(recording.group)) > 1


def _well_grouped(recording: Recording) -> bool:
    if recording.group is None:
        return False
    _, rows = np.unique(recording.group, return_counts=True)
    return len(rows) > 1 and bool(rows.max() <= (1.0 - LEAST_LEFT) * rows.sum())


def _places(recording: Recording) -> Array:
    return np.asarray(recording.chain.placement(recording.q)[:, :3, 3])


def _workspace_blocks(points: Array, count: int) -> Indices:
    """Equal blocks: each part is cut across its longest side, in the ratio of its blocks."""
    folds = np.empty(len(points), dtype=np.intp)
    parts = [(np.arange(len(points)), 0, count)]
    while parts:
        part, first, share = parts.pop()
        if share == 1:
            folds[part] = first
            continue
        side = int(np.argmax(np.ptp(points[part], axis=0)))
        order = part[np.argsort(points[part, side], kind="stable")]
        left = share // 2
        cut = len(order) * left // share
        parts += [(order[:cut], first, left), (order[cut:], first + left, share - left)]
    return folds
