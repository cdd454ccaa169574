"""Cases of a moving arm: what is wrong in the drives, the gap it makes, the recording and truth.

The strength of an effect is drawn as drives show it; the noise then follows from the gap that it
makes and the ratio asked for, sigma = gap / ratio. Payload and tissue act on drives that all yield
alike; the controller allows for the arm's own weight.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import joint_effects as joints
from plumbline.experiments.reality.arm import Arm, Array, forward, load_torque, point_torque
from plumbline.experiments.reality.arms import ARMS
from plumbline.experiments.reality.cases import Plan, looking_at
from plumbline.experiments.reality.confounding import Basis, confounded
from plumbline.experiments.reality.gap import frame_and_tool, unabsorbed
from plumbline.experiments.reality.motion import STIFFEST, Course, Drive, Motion, Trouble, move
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.recorder import Case, Recording, numbered, settings, truth, write
from plumbline.experiments.reality.scene import Mechanism, Scene, Session

RANGES = Ranges("moving")
ARM_NAMES = ("ur3", "ur5", "ur10", "vs060", "lbr")
OBSERVATIONS = ("tip_position", "joint_position")
LEAST_NOISE, MOST_NOISE = 1e-6, 1e-3  # m or rad: what instruments have
INSIDE = {
    "tip_position": ("joint_compliance", "backlash", "latency", "payload", "friction"),
    "joint_position": ("joint_compliance", "backlash", "latency", "friction"),
}
SLOW = (0.03, 0.1, 0.3)  # rad/s: speeds below which a rival's friction may rise
BEYOND: dict[str, tuple[str, ...]] = {"tip_position": ("tip_force",), "joint_position": ()}


class Friction(joints.JointMechanism):
    """A dry bearing winds its drive up: e = -size (1 + dip exp(-(v/slow)^2)) sign v [rad]."""

    dip: float = 1.0
    slow: float = 0.1

    def _error(self, scene: Scene) -> Array:
        v = scene.session.velocity[:, self.joint - 1]
        size = self.size * (1.0 + self.dip * np.exp(-((v / self.slow) ** 2)))
        return np.asarray(-size * np.tanh(v / 5e-3))


class ViscousFriction(joints.JointMechanism):
    """Grease winds a drive up in proportion to the speed: e = -size v [rad]."""

    def _error(self, scene: Scene) -> Array:
        return -self.size * scene.session.velocity[:, self.joint - 1]


class EffortCompliance(joints.JointMechanism):
    """A drive that twists under the torque that its motor reports: e = -size effort [rad]."""

    effort: tuple[float, ...] = ()

    def _error(self, scene: Scene) -> Array:
        return -self.size * np.array(self.effort)


class TipForce(Mechanism):
    """Tissue pushes the tip along the base's x: -size (x - x0) [N], through yielding drives."""

    origin: float = 0.0

    def body(self, scene: Scene) -> Scene:
        frames, tip = scene.tip()
        unit = point_torque(scene.arm, frames, tip, np.array([1.0, 0.0, 0.0]))
        push = -self.size * (tip[:, :1] - self.origin)
        return replace(scene, q=scene.q + push * unit / STIFFEST)


Wrong = tuple[Trouble, Mechanism]


def _compliance(arm: Arm, rng: np.random.Generator) -> Wrong:
    load = _loads(arm, rng)
    joint = int(rng.choice(np.flatnonzero(load >= 0.2 * load.max())))
    size = RANGES.one("compliance", rng)
    return Trouble({joint: Drive(1.0 / size)}), joints.JointCompliance(
        size, joint + 1, stiffening=0.0
    )


def _backlash(arm: Arm, rng: np.random.Generator) -> Wrong:
    """Play shows with the side of approach where a bearing's drag outweighs the load."""
    joint = _unloaded(arm, rng)
    width = RANGES.one("play", rng)
    drag = (25.0, 25.0, 1.0)
    return Trouble({joint: Drive(play=width)}, friction={joint: drag}), joints.Backlash(
        width, joint + 1
    )


def _latency(_: Arm, rng: np.random.Generator) -> Wrong:
    size = RANGES.one("latency", rng)
    return Trouble(latency=size), joints.Latency(size)


def _payload(arm: Arm, rng: np.random.Generator) -> Wrong:
    size = float(RANGES.one("payload", rng) * arm.mass.sum())
    drives = {i: Drive() for i in range(arm.joints)}
    return Trouble(drives, payload=size), joints.Payload(size, (STIFFEST,) * arm.joints)


def _friction(arm: Arm, rng: np.random.Generator) -> Wrong:
    joint = _unloaded(arm, rng)
    coulomb, dip, slow = (RANGES.one(name, rng) for name in ("coulomb", "dip", "slow"))
    found = Trouble({joint: Drive(2e4)}, friction={joint: (coulomb, coulomb * (1 + dip), slow)})
    return found, Friction(coulomb / 2e4, joint + 1, dip=dip, slow=slow)


def _tip_force(arm: Arm, rng: np.random.Generator) -> Wrong:
    size = RANGES.one("tissue", rng)
    return Trouble({i: Drive() for i in range(arm.joints)}, tissue=size), TipForce(size)


def _unloaded(arm: Arm, rng: np.random.Generator) -> int:
    """A joint, from 0, that gravity hardly loads."""
    load = _loads(arm, rng)
    return int(rng.choice(np.flatnonzero(load <= max(12.0, 1.01 * load.min()))))


def _loads(arm: Arm, rng: np.random.Generator) -> Array:
    """Largest load torque (n,) of each joint over random poses [N m]."""
    q = rng.uniform(arm.lower, arm.upper, (60, arm.joints))
    return np.asarray(np.abs(load_torque(arm, forward(arm, q))).max(axis=0))


DRAWS: dict[str, Callable[[Arm, np.random.Generator], Wrong]] = {
    "joint_compliance": _compliance,
    "backlash": _backlash,
    "latency": _latency,
    "payload": _payload,
    "friction": _friction,
    "tip_force": _tip_force,
}


@dataclass(frozen=True)
class Scored:
    """A motion with what the recording says of it."""

    motion: Motion  # what happened
    scene: Scene  # the arm at the reported joints, as drawn
    shift: Array  # what is wrong in the noise-free readings: (N, 3) [m], or (N, n) [rad]
    gap: float  # unabsorbed root mean square of it


def simulate_moving(folder: Path, plan: Plan, name: str, seed: int) -> dict[str, object]:
    """Move an arm and write its readings; the truth (PlumblineError: no kind of moving case)."""
    if plan.kind == "pair" or plan.observation not in OBSERVATIONS:
        raise PlumblineError("moving cases: one cause, tip_position or joint_position")
    rng = np.random.default_rng([seed, 5])
    allowed = (BEYOND if plan.kind == "outside" else INSIDE)[plan.observation]
    names = [n for n in allowed if not plan.effects or n in plan.effects]
    if not names:
        known = ", ".join(allowed) or "nothing"
        raise PlumblineError(f"moving cases know {known} of this kind for {plan.observation}")
    arm = ARMS[str(rng.choice([a for a in ARM_NAMES if not plan.arms or a in plan.arms]))]()
    still = Ranges("case")
    real = arm.with_mass(arm.mass * still.many("mass", rng, arm.joints))
    rows = int(rng.integers(plan.rows[0], plan.rows[1] + 1))
    nominal = np.round([RANGES.one("tool_aside", rng), 0.0, RANGES.one("tool_along", rng)], 3)
    tool = nominal + still.near("tool", rng, 3)
    course = Course.draw(real, rows, rng)
    trouble = Trouble()
    mechanisms: tuple[Mechanism, ...] = ()
    ratio = float(np.exp(rng.uniform(*np.log(plan.gap))))
    if plan.kind != "none":
        trouble, mechanism = DRAWS[str(rng.choice(names))](real, rng)
        mechanisms = (mechanism,)
    found = _scored(real, tool, course, trouble, plan.observation, rng)
    sigma = found.gap / ratio if mechanisms else float(np.exp(RANGES.one("log_noise", rng)))
    if not LEAST_NOISE <= sigma <= MOST_NOISE:
        raise PlumblineError(f"{name}: a gap of {found.gap:.2g} asks for a noise of {sigma:.2g}")
    met = float(found.motion.push[0])  # where tissue lies
    placed = tuple(replace(m, origin=met) if isinstance(m, TipForce) else m for m in mechanisms)
    case = Case(
        name, plan.kind, plan.observation, arm, found.scene, placed,
        nominal, float(f"{sigma:.3g}"), (ratio,) if mechanisms else (), seed, plan.known_noise,
        moving=True,
    )  # fmt: skip
    noise = rng.normal(0.0, case.noise_std, found.shift.shape)
    write(folder, _recording(case, found, noise))
    rivals = list(moving_rivals(found.motion.effort))
    alike = confounded(case, rivals, found.shift, modelled=plan.kind != "outside")
    facts = truth(replace(case, confounded=alike), noise, [])
    return facts | {"gap_to_noise": found.gap / case.noise_std, "simulator": "mujoco"}


def moving_rivals(effort: Array) -> Iterator[Basis]:
    """What reported efforts (N, n) and velocities make possible: yielding under effort, friction.

    Friction has three terms, dry, creeping and viscous; play has one, and is friction's dry term.
    """
    for joint, torque in enumerate(effort.T.tolist(), start=1):
        yield (EffortCompliance(1e-6, joint, tuple(torque)),)
        for slow in SLOW:
            dry, creeping = (Friction(1e-4, joint, dip=dip, slow=slow) for dip in (0.0, 1.0))
            yield (dry, creeping, ViscousFriction(1e-3, joint))


def _scored(
    arm: Arm,
    tool: Array,
    course: Course,
    trouble: Trouble,
    observation: str,
    rng: np.random.Generator,
) -> Scored:
    motion = move(arm, tool, course, trouble)
    q = motion.q
    if len(trouble.drives) == arm.joints:
        q = q + load_torque(arm, forward(arm, q)) / STIFFEST
    still = np.full(len(q), 21.0)
    side = np.sign(motion.velocity)
    group = np.floor(np.arange(len(q)) * 5 / len(q)) + 1.0
    session = Session(q, course.times, still, still, side, motion.velocity, group)
    scene = Scene.ideal(arm, session, tool, looking_at(arm, q, rng))
    if observation == "joint_position":
        shift = motion.link - q
        busy = np.abs(shift).max(axis=0) > 1e-9
        gap = unabsorbed(shift[:, busy], None) if busy.any() else 0.0
        return Scored(motion, scene, shift, gap)
    R = scene.device[:3, :3]
    shift = (motion.tip - scene.pose_in_world()[0]) @ R.T
    return Scored(motion, scene, shift, unabsorbed(shift, frame_and_tool(scene)))


def _recording(case: Case, found: Scored, noise: Array) -> Recording:
    session, n = case.scene.session, case.arm.joints
    columns = numbered("q", session.q)
    if case.observation == "joint_position":
        columns |= numbered("m", session.q + found.shift + noise)
    else:
        seen = case.scene.pose_in_device()[0] + found.shift + noise
        columns |= dict(zip("xyz", seen.T, strict=True))
    columns["time"] = session.time
    for i in range(n):
        columns[f"direction{i + 1}"] = session.direction[:, i]
        columns[f"velocity{i + 1}"] = session.velocity[:, i]
        columns[f"effort{i + 1}"] = found.motion.effort[:, i]
    return Recording(settings(case), columns | {"group": session.group})
