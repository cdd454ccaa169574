"""What every export is: text, what it cannot hold, and how much of the gap stays for that.

An exported file alone, by those who read it: Pinocchio a URDF, MuJoCo an MJCF.

An exported MJCF alone, moved by commands in MuJoCo: the proof that it does what it says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError, fault, listed
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.core.quantities import quantity
from plumbline.optim.model.arm import MOTION, Arm
from plumbline.optim.model.constants import AGREES, NAMED, ONE_WITH, REST
from plumbline.optim.model.statement import acts_on_places
from plumbline.optim.recording.kinds import EFFORTS


@dataclass(frozen=True)
class Lack:
    """An effect that a format cannot hold."""

    label: str  # the effect and its element
    words: str  # what it is, in a sentence
    # RMS of what it does to the tip [m], best frame and tool aside, or to the efforts of a model of
    # them [N m]; NaN of what acts on efforts where places were measured
    size: float
    unit: str = "m"  # of the size: ``"m"``, ``"rad"`` of joints, ``"N m"`` of efforts

    def __str__(self) -> str:
        """``backlash 2 (0.121 mm)``."""
        if not np.isfinite(self.size):
            return self.label
        return f"{self.label} ({quantity(self.size, self.unit)})"


@dataclass(frozen=True)
class Exported:
    """A model as text."""

    text: str  # the file's content
    tip_frame: str  # name of the tool's frame in it; empty where there is none
    # largest difference of a placement, read again [m, or of a rotation's entry]; NaN where nothing
    # could read it
    error: float
    lacks: tuple[Lack, ...]  # what the format cannot hold, the largest first
    # RMS of what all effects do to tip or efforts, as of a :class:`Lack` [unit]; NaN under torques
    whole: float
    stays: float  # RMS of that which the file does not hold [unit]
    unit: str = "m"  # of these: ``"m"``, ``"rad"`` of joints, ``"N m"`` of efforts

    @property
    def words(self) -> str:
        """What it lacks, in a sentence, the most of it by name."""
        if not self.lacks:
            return "holds all that lasts of this model"
        named = listed(self.lacks, NAMED)
        if not self.whole > 0.0:
            return f"cannot hold {named}"
        of = f"{quantity(self.stays, self.unit)} of {quantity(self.whole, self.unit)}"
        return f"cannot hold {named}; {of} stays for that"

    def to_dict(self) -> dict[str, object]:
        """The figures as plain data in SI units."""
        lacks = [
            {"effect": one.label, "size": one.size if np.isfinite(one.size) else None}
            for one in self.lacks
        ]
        return {
            "tip_frame": self.tip_frame,
            "largest_error": self.error if np.isfinite(self.error) else None,
            "lacks": lacks,
            "unit": self.unit,
            "whole": self.whole if np.isfinite(self.whole) else None,
            "stays": self.stays if np.isfinite(self.stays) else None,
        }


def lacking(arm: Arm, held: Arm) -> tuple[tuple[Lack, ...], float, float, str]:
    """What an arm with some of the effects lacks, the RMS of all effects and of those, their unit.

    Over the rows that the model keeps of its recording; of efforts in newton metres.
    """
    arm, held = arm.lasting(), held.lasting()
    unit = "N m" if arm.observation == EFFORTS else "m"
    whole, stays = apart(arm, arm.nominal), apart(arm, held)
    words = {e.label: e.sentence for e in arm.effects}
    missing = [label for label in arm.labels if label not in held.labels]
    seen = {e.label for e in arm.effects if unit == "N m" or acts_on_places(e)}
    alone = {b: arm.of([k for k, e in enumerate(arm.effects) if e.label == b]) for b in missing}
    sizes = {b: apart(alone[b], arm.nominal) if b in seen else np.nan for b in missing}
    lacks = [Lack(label, words[label], float(size), unit) for label, size in sizes.items()]
    return tuple(sorted(lacks, key=lambda lack: -np.nan_to_num(lack.size))), whole, stays, unit


def apart(one: Arm, other: Arm) -> float:
    """RMS between two arms: of their efforts [N m], or their tips once frame and tool fit [m]."""
    q, context = samples_of(one)
    if one.observation == EFFORTS:
        v, a = (context.pop(name, np.zeros_like(q)) for name in MOTION[1:])
        two = [arm.tau(q, v, a, **context) for arm in (one, other)]
        return float(np.sqrt(np.mean((two[0] - two[1]) ** 2)))
    T, tips = one.placement(q, **context), other.tip(q, **context)
    gap = T[:, :3, 3] - tips
    columns = np.zeros((len(q), 3, 9))
    columns[:, :, :3] = np.eye(3)
    centred = tips - tips.mean(axis=0)
    for k, axis in enumerate(np.eye(3)):
        columns[:, :, 3 + k] = np.cross(axis, centred)
    columns[:, :, 6:] = T[:, :3, :3]
    flat = columns.reshape(-1, 9)
    left = gap.ravel() - flat @ np.linalg.lstsq(flat, gap.ravel(), rcond=ONE_WITH)[0]
    return float(np.sqrt(np.sum(left**2) / len(q)))


def must_agree(recording: str, said: str, error: float, of: str = "") -> None:
    """Refuse a file that, read again, says something else by an error [m, or a rotation's entry].

    The words say what is compared and that it misses, and what the error is a share ``of``.
    """
    if not error <= AGREES:
        raise PlumblineError(
            f"{recording}: the exported {said} by {error:.1e}{of}, at most {AGREES:.0e} allowed; "
            "nothing was written"
        )


def must_be_one_arm(arm: Arm, said: str) -> None:
    """Refuse a robot with limbs (PlumblineError) where a file holds one joint behind the other."""
    n = arm.chain.n
    if list(arm.chain.hangs) != list(range(-1, n - 1)):
        raise fault(f"{arm.recording}, {said}", f"limbs of {n} joints", "one arm", "export MJCF")


def samples_of(arm: Arm) -> tuple[Array, dict[str, Array]]:
    """Joints (S, n) of the rows that a model keeps of its recording, and their context."""
    return arm.samples["q"], {name: v for name, v in arm.samples.items() if name != "q"}


def head(arm: Arm, lacks: Sequence[Lack]) -> str:
    """Lines that stand on top of a file: what it is of, and what it lacks."""
    lines = [f"{arm.robot.name} as found on {arm.recording}."]
    lines += [f"Not in this file: {lack}: {lack.words}" for lack in lacks]
    return "\n".join(lines)


def has_mujoco() -> bool:
    """Whether MuJoCo is installed."""
    return find_spec("mujoco") is not None


def frames_by_pinocchio(text: str, tip: str, q: Array) -> Array:
    """``T_base_tip`` (N, 4, 4) [m] of a URDF at joints (N, n)."""
    chain = Robot.from_urdf(text).chain(tip)
    data, frame = chain.model.createData(), chain.model.getFrameId(tip, pin.FrameType.BODY)
    found = np.empty((len(q), 4, 4))
    for T, posture in zip(found, q, strict=True):
        pin.framesForwardKinematics(chain.model, data, chain.configuration(posture))
        T[:] = data.oMf[frame].homogeneous
    return found


def torques_by_pinocchio(chain: Chain, q: Array, v: Array, a: Array) -> Array:
    """Efforts (N, n) [N m or N] of a chain read from a URDF, its damping and friction with them."""
    model, data = chain.model, chain.model.createData()
    rows = zip(map(chain.configuration, q), v, a, strict=True)
    bodies = np.array([pin.rnea(model, data, *row) for row in rows])
    return np.asarray(bodies + model.damping * v + model.friction * np.sign(v))


def frames_by_mujoco(text: str, site: str, q: Array) -> Array:
    """``T_base_site`` (N, 4, 4) [m] of an MJCF at joints (N, n)."""
    mujoco: Any = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    found = np.tile(np.eye(4), (len(q), 1, 1))
    for T, posture in zip(found, q, strict=True):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        T[:3, :3], T[:3, 3] = data.site(site).xmat.reshape(3, 3), data.site(site).xpos
    return found


def torques_by_mujoco(text: str, q: Array, v: ArrayLike, a: ArrayLike) -> Array:
    """Efforts (N, n) [N m or N] of an MJCF by its inverse dynamics."""
    mujoco: Any = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    found = np.empty_like(q)
    for efforts, row in zip(found, zip(q, np.asarray(v), np.asarray(a), strict=True), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        efforts[:] = data.qfrc_inverse
    return found


def replay(mjcf: str, time: ArrayLike, command: ArrayLike, start: ArrayLike = ()) -> Array:
    """What the joints of an MJCF with actuators do (N, nu) [rad or m] in MuJoCo.

    Args:
        mjcf: The file's text.
        time: Time (N,) [s], ascending.
        command: Commands (N, nu), straight between the samples.
        start: Where the joints are at first (nu,) [rad or m]; by default where the first command,
            held for a while, puts them.

    Raises:
        PlumblineError: MuJoCo is not installed, cannot read it, or has other actuators.
    """
    if not has_mujoco():
        raise fault(
            "replay", "no MuJoCo", "it installed", "pip install 'plumbline-robotics[mujoco]'"
        )
    mujoco: Any = import_module("mujoco")
    rollout: Any = import_module("mujoco.rollout")
    try:
        model = mujoco.MjModel.from_xml_string(mjcf)
    except ValueError as error:
        raise PlumblineError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    t, u = np.asarray(time, dtype=float), np.asarray(command, dtype=float)
    if u.shape != (len(t), model.nu):
        raise fault("command", f"an array {u.shape}", f"({len(t)}, {model.nu})", "one an actuator")
    even = np.arange(t[0] - REST, t[-1], model.opt.timestep)
    asked = np.column_stack([np.interp(even, t, one) for one in u.T])
    data = mujoco.MjData(model)
    joints = model.actuator_trnid[:, 0]
    places = model.jnt_qposadr[joints]
    data.qpos[places] = np.asarray(start, dtype=float) if np.size(start) else u[0]
    if model.na:
        filtered = model.actuator_actnum > 0
        data.act[model.actuator_actadr[filtered]] = u[0][filtered]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, state, full)
    states, _ = rollout.rollout(model, data, state, asked)
    after = even + model.opt.timestep
    q = states[0][:, 1 + places]  # the clock stands first
    return np.column_stack([np.interp(t, after, one) for one in q.T])
