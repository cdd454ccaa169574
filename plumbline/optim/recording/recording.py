"""A recording: what a robot's joints said, and what was measured beside them, row by row.

:func:`plumbline.build_recording` makes one from arrays, :func:`plumbline.load` from a folder; both
pass the same checks.
"""

from __future__ import annotations

import hashlib
import html
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.constants import SOCKETS
from plumbline.optim.recording.kinds import ROWS, Kind
from plumbline.optim.recording.table import Array, Flags, Integers


@dataclass(frozen=True, eq=False)
class Recording:
    """N samples of one chain with n joints. SI units; arrays cannot be written to."""

    name: str  #: what it is called
    observation: str  #: kind of observation, a key of :data:`plumbline.optim.recording.kinds.KINDS`
    robot: Robot  #: the robot, with the recording's gravity
    chain: Chain  #: its chain to the tip frame
    tip_frame: str  #: name of the tip frame
    q: Array  #: joint readings (N, n) [rad or m]
    #: measured values (N, m). ``tip_position``: x, y, z [m] in the device's frame. ``pose``: x, y,
    #: z [m], unit quaternion qw, qx, qy, qz. ``fixed_point``: none (m = 0). ``joint_position``:
    #: link side (m = n) [rad or m], NaN for joints not measured. ``joint_torque``: efforts of the
    #: drives (m = n) [N m or N]. ``plane_range``: the range (m = 1) [m]. ``fiducials``: x, y, z [m]
    #: by the robot, of a marker whose place in CT is ``q``
    measured: Array
    tool_offset: Array  #: nominal tip (3,) in the tip frame [m]
    time: Array | None = None  #: time (N,) [s]
    temperature: Array | None = None  #: temperature (N,) [degC]
    #: way of the last approach (N, n): 1 if the reading grew, -1 if it fell, else 0
    direction: Array | None = None
    velocity: Array | None = None  #: joint velocities (N, n) [rad/s or m/s]
    acceleration: Array | None = None  #: joint accelerations (N, n) [rad/s^2 or m/s^2]
    turning: Array | None = None  #: which way each joint surely turns (N, n), from -1 to 1
    #: joint efforts (N, n) [N m or N], where they are not what was measured
    effort: Array | None = None
    force: Array | None = None  #: force on the tool's tip (N, 3), in the tip frame [N]
    payload: Array | None = None  #: mass carried (N,) [kg]
    socket: Integers | None = None  #: which socket the tip rests in (N,)
    element: Integers | None = None  #: which plane or marker a row is of (N,), from 1
    #: which motion a row is of (N,): left out together where ranges are measured
    motion: Integers | None = None
    group: Integers | None = None  #: session or trajectory (N,): what is left out together
    held_out: Flags | None = None  #: rows (N,) kept from every fit
    #: noise of one measured axis, 1 sigma [m, or rad for joints]; None if unknown
    noise_std: float | None = None
    #: noise of each joint's effort (n,), 1 sigma [N m or N], as stated or as estimated from the
    #: rows
    noise_by_joint: Array | None = None
    #: noise of each component of each row (N, k), over their root mean square
    noise_shape: Array | None = None
    #: what the instrument's scale is known to, 1 sigma, as its maker states it
    scale_std: float | None = None
    #: noise of one axis of a pose's rotation, 1 sigma [rad]
    noise_std_rotation: float | None = None
    #: ratio of the noises of a pose's position and rotation [m], where a fit has told it
    lever: float | None = None
    #: square root (6, 6) of the covariance of a pose's noise, in the axes of what is read and over
    #: one noise, where a fit has told it
    pose_spread: Array | None = None
    #: correlation of the noise of a row with that of the row before it, where a fit has told it
    wander: float = 0.0
    #: 1 sigma of the rows' times over that of the noise [s, or rows without a clock, a m or rad],
    #: where a fit has told it
    jitter: float = 0.0
    #: 1 sigma (n,) of where each joint stands about what it reads, over that of the noise [rad/m],
    #: where a fit has told it
    scatter: Array | None = None
    #: correlation of the noises of readings of one posture, where a fit or a statement has told it
    alike: float = 0.0
    always: tuple[str, ...] = ("frame", "tool")  #: what every model fits
    socket_distance: float | None = None  #: known distance between the sockets of a pair [m]
    socket_pairs: tuple[tuple[int, int], ...] = ()  #: pairs of sockets that far apart
    elements: tuple[str, ...] = ()  #: what these planes or markers are called
    #: pitch of CT (3,) [m], as stated or as its coordinates show; 0 where neither
    pitch: Array | None = None
    #: where a finder's beam (6,) and the planes (K, 6) start, as points and directions
    anchor: tuple[Array, Array] | None = None
    #: whether the robot stands in for poses or points that were given as such
    stand_in: bool = False
    #: joints with a second encoder, as columns of ``q`` counted from 0
    measured_joints: tuple[int, ...] = ()
    #: what these rows were selected from, if they were: what a path leaves behind it cannot be told
    #: from part of its rows
    whole: Recording | None = field(default=None, repr=False)
    place: Integers | None = None  #: which of its rows these are (N,)
    #: the recordings that these rows are of, where they are several; None of one
    session: Session | None = field(default=None, repr=False)
    part: Integers | None = None  #: which of them each row is of (N,), from 0
    #: what the file calls columns that the chain counts otherwise: ``{"q4": "q3"}``
    in_file: Mapping[str, str] = field(default_factory=dict, repr=False)
    sha256: str = ""  #: hash of the files' bytes, or of the arrays
    notes: tuple[str, ...] = ()  #: what is odd but no fault, one line each
    unjudged: str = ""  #: what it holds that takes no part in a diagnosis, such as ``"3 targets"``

    def __post_init__(self) -> None:
        """Make the arrays read-only: change is a copy."""
        for name, array in self._arrays().items():
            locked = array.view()
            locked.setflags(write=False)
            object.__setattr__(self, name, locked)

    @property
    def kind(self) -> Kind:
        """What its kind of observation says."""
        return ROWS[self.observation]

    @property
    def several(self) -> bool:
        """Whether its rows are of several recordings, which :func:`.session.apart` tells apart."""
        return self.session is not None

    @property
    def uneven(self) -> bool:
        """Whether a row's noise is wider along some ways than along others."""
        return bool(self.jitter) or self.scatter is not None

    def __len__(self) -> int:
        return len(self.q)

    def select(self, rows: ArrayLike) -> Recording:
        """The recording of some rows only: a mask (N,) of booleans, or row indices.

        Nothing is checked again: a part of a good recording may be as small as it likes. The hash
        stays that of the whole. A part whose rows are all kept back, or none of them, keeps
        nothing back from its own fit.

        Raises:
            PlumblineError: The mask has another length, or an index is out of range.
        """
        chosen = np.asarray(rows)
        if chosen.dtype == bool and chosen.shape != (len(self),):
            raise PlumblineError(
                f"select: a mask of shape {chosen.shape}, expected ({len(self)},): one flag a row"
            )
        if chosen.ndim != 1:
            raise PlumblineError(f"select: an index of shape {chosen.shape}, expected (k,)")
        if not chosen.size:
            chosen = chosen.astype(np.int64)
        try:
            parts: dict[str, Any] = {
                name: a[chosen] for name, a in self._arrays().items() if name in ROWWISE
            }
        except IndexError as error:
            raise PlumblineError(f"select: {error}; rows are 0 to {len(self) - 1}") from None
        kept_back = parts.get("held_out")
        if kept_back is not None and (kept_back.all() or not kept_back.any()):
            parts["held_out"] = None
        order = np.arange(len(self))[chosen]
        if (np.diff(order) > 0).all():
            whole, place = self.path
            parts |= {"whole": whole, "place": place[order]}
        return replace(self, **parts)

    @property
    def reach(self) -> float:
        """Reach of the arm with its tool [m], with slides as far out as they were."""
        limits = np.maximum(np.abs(self.chain.lower), np.abs(self.chain.upper))
        known = np.where(np.isfinite(limits), limits, 0.0)
        further = np.maximum(np.abs(self.q).max(axis=0) - known, 0.0)
        slid = float(further[~self.chain.turning].sum())
        return self.chain.reach + slid + float(np.linalg.norm(self.tool_offset))

    @property
    def training(self) -> Recording:
        """The rows that may be fitted: all but those held out."""
        return self if self.held_out is None else self.select(~self.held_out)

    @property
    def path(self) -> tuple[Recording, Integers]:
        """The recording that the joints' whole path is in, and these rows' place in it (N,).

        Of rows that were selected in order that is what they were selected from; of rows whose
        angles were changed since, only themselves.
        """
        whole, place = self.whole, self.place
        if whole is None or place is None or len(place) != len(self):
            return self, np.arange(len(self))
        same = np.array_equal(whole.q[place], self.q)
        return (whole, place) if same else (self, np.arange(len(self)))

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """Room for what effects derive from the path, so that it is worked out once."""
        return {}

    def __repr__(self) -> str:
        robot = f"{self.robot.name[:40]} to {self.tip_frame[:40]!r}"
        return f"<Recording {self.name[:60]!r}: {self.observation}, {len(self)} rows, {robot}>"

    def describe(self) -> str:
        """What is in it, a few lines of plain text."""
        width = max(len(key) for key, _ in self._facts())
        lines = [f"{key:<{width}}  {value}" for key, value in self._facts()]
        return "\n".join([f"Recording {self.name!r}", *lines, *(f"note: {n}" for n in self.notes)])

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.describe())}</pre>"

    def _arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}

    def _facts(self) -> list[tuple[str, str]]:
        """Name and value of everything worth showing."""
        present = [name for name in CONTEXT if getattr(self, name) is not None]
        noise = "unknown, to be estimated" if self.noise_std is None else f"{self.noise_std:.3g}"
        tool = ", ".join(f"{value:.4g}" for value in self.tool_offset)
        facts = [
            ("observation", self.observation),
            ("rows", f"{len(self)}" + self._split()),
            ("robot", f"{self.robot.name}, {self.chain.n} joints to {self.tip_frame!r}"),
            ("tool offset [m]", tool),
            ("noise, 1 sigma", noise),
            ("always fitted", ", ".join(self.always) or "nothing"),
            ("context", ", ".join(present) or "none"),
            ("sha256", self.sha256[:12]),
        ]
        if self.socket is not None:
            facts.insert(2, ("sockets", f"{len(np.unique(self.socket))}"))
        if self.element is not None:
            what = "planes" if self.kind.ranges else "markers"
            facts.insert(2, (what, f"{len(self.elements)}: {', '.join(self.elements)}"))
            dropped = {"tool offset [m]", "always fitted", *(["robot"] if self.stand_in else [])}
            facts = [fact for fact in facts if fact[0] not in dropped]
        elif self.kind.efforts:
            facts = [fact for fact in facts if fact[0] != "tool offset [m]"]
            facts[facts.index(("noise, 1 sigma", noise))] = self._noise_of_efforts()
        elif self.measured_joints:
            named = ", ".join(self.chain.joint_names[j] for j in self.measured_joints)
            facts.insert(2, ("second encoders", named))
        return facts

    def _noise_of_efforts(self) -> tuple[str, str]:
        """What was made of a stated noise, in whatever unit; that of derived motions is in it."""
        assert self.noise_by_joint is not None
        source = "estimated" if self.noise_std is None else "stated"
        return f"noise, 1 sigma, {source} [N m]", ", ".join(f"{x:.3g}" for x in self.noise_by_joint)

    def _split(self) -> str:
        held = "" if self.held_out is None else f", {int(self.held_out.sum())} held out"
        groups = "" if self.group is None else f", {len(np.unique(self.group))} groups"
        return held + groups


@dataclass(frozen=True, eq=False)
class Session:
    """Recordings of one robot that are asked together."""

    name: str  #: what they are called together
    parts: tuple[Recording, ...]  #: the recordings, in their order; no two of one name
    #: what always is fitted and is one for all of them, of :data:`SHARED`
    shared: tuple[str, ...] = ()
    #: causes that may be at work in one of them only, confined to it
    suspects: tuple[Effect, ...] = ()

    def __len__(self) -> int:
        return len(self.parts)

    def __repr__(self) -> str:
        listed = ", ".join(f"{p.name[:40]}: {len(p)} rows of {p.observation}" for p in self.parts)
        return f"<Session {self.name[:60]!r}: {listed}>"

    @property
    def training(self) -> Session:
        """The same with the rows that may be fitted."""
        return replace(self, parts=tuple(p.training for p in self.parts))

    @property
    def encoders(self) -> tuple[int, ...]:
        """Joints, from 0, that any recording has a second encoder of."""
        own = (p.measured_joints for p in self.parts if p.kind.encoders)
        return tuple(sorted({j for joints in own for j in joints}))

    @property
    def residuals(self) -> int:
        """Number m of residuals of one row, of the kind that has most."""
        return max(self._size(p) for p in self.parts)

    def _size(self, part: Recording) -> int:
        joints = len(self.encoders) if part.kind.encoders else part.chain.n
        return part.kind.equations or joints

    def live(self, k: int) -> Flags:
        """Which of the residuals (m,) a row of recording k has."""
        part = self.parts[k]
        if part.kind.encoders:
            own = [j in part.measured_joints for j in self.encoders]
            return np.array(own + [False] * (self.residuals - len(own)))
        return np.arange(self.residuals) < self._size(part)

    @property
    def has_positions(self) -> bool:
        """Whether any of the recordings says where the tip is."""
        return any(p.kind.places for p in self.parts)

    @property
    def has_device(self) -> bool:
        """Whether any of them was measured by a device."""
        return any(p.kind.device for p in self.parts)

    @property
    def has_poses(self) -> bool:
        """Whether any of them has the tip's orientation."""
        return any(p.kind.oriented for p in self.parts)

    def first_socket(self, k: int) -> int:
        """What is added to the sockets of recording k, so that they are told from others'."""
        return 0 if "sockets" in self.shared else k * SOCKETS


CONTEXT = (
    "time", "temperature", "direction", "velocity", "acceleration", "effort", "force", "payload",
    "group", "held_out",
)  # fmt: skip
ROWWISE = (
    "q", "measured", "socket", "turning", "noise_shape", "part", "element", "motion", *CONTEXT,
)  # fmt: skip


def socket_labels(recording: Recording) -> tuple[int, ...]:
    """Labels of the sockets that rows rest in, ascending."""
    assert recording.socket is not None
    return tuple(int(k) for k in np.unique(recording.socket))


def one_hot_sockets(recording: Recording) -> Array:
    """One column a socket, 1 where the row rests in it (N, s)."""
    assert recording.socket is not None
    return (recording.socket[:, None] == np.array(socket_labels(recording))).astype(float)


def hash_of(*parts: bytes) -> str:
    """SHA-256 of parts, told apart by their lengths."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big"))
        digest.update(part)
    return digest.hexdigest()
