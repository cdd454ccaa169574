r"""Two seven-joint arms behind the instruments, watched by Pinocchio and coal.

Two laparoscopic teaching arms face each other across a table; each holds a shaft in a trocar.
The drives are given twice as many points as there are commands, the ones between on the trocar
too, and move on straight lines between them. At every substep Pinocchio says where links and tip
are, from its own model: how far the trocar lies off the shaft's axis,

.. math:: |(I - z z^T)(c - t)|

and coal, in mm, how near any capsule of one arm comes to any of the other, to the obstacles, and to
those of its own arm that it does not meet in a joint.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from plumbline.experiments.reality.touch import Touch, all_pairs
from plumbline.kinematics.capsules import LinkCapsule, bones
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot
from plumbline.optim import capsule_mpc as mpc
from plumbline.optim.capsule_mpc.arms import ArmInstrument, held_tip
from plumbline.optim.capsule_mpc.stopping import held_exactly
from plumbline.optim.capsule_mpc.waypoints import Guide
from plumbline.optim.core.problem import Array

APART, BESIDE = 0.6, 0.07  # [m] of each base and of each trocar from the middle
TABLE = 0.46  # [m], height of the trocars
SHAFT = (-0.05, 0.2)  # [m] along z of the sliding joint
POSTURE = np.array([0.0, 0.2, 1.1, 0.0, 1.1, 0.0, 0.1])  # [rad, m]
SUBSTEPS = 5  # between two points that the drives are given, at each of which is looked
BEND = 1.5e-4  # [m] of clearance that the curvature of arms may take between and at steps
MM = 1e3  # [mm/m]: what is looked at is in mm


@dataclass(frozen=True)
class ArmRun:
    """What came of a motion."""

    clearance: float  # least clearance of the arms and of the obstacles by coal [mm]
    rcm: float  # the most by which a shaft missed its trocar, by Pinocchio [mm]
    within_limits: bool  # whether every joint stayed within its limits
    reached: bool  # whether both tips came within 1 mm of their goals
    steps: int  # steps made
    seconds: Array  # time of every step [s]


def make_arm(side: float) -> ArmInstrument:
    """The arm at the left (-1) or at the right (+1)."""
    chain = Robot.bundled("laparoscopic").chain()
    turn = pin.utils.rotate("z", 0.0 if side < 0 else np.pi)
    shaft = LinkCapsule(6, np.array([[0, 0, SHAFT[1]], [0, 0, SHAFT[0]]]), 0.0025, "shaft")
    wrist = bones(chain, 0.02, skip=(-1, 0, 1, 2, 3, 6))
    links = (*bones(chain, 0.035, skip=(2, 5, 6)), *wrist, shaft)
    place = homogeneous(turn, [side * APART, 0.0, 0.0])
    return ArmInstrument(chain, (side * BESIDE, 0.0, TABLE), links, place)


class Watch:
    """Pinocchio and coal on the same arms, sharing nothing with the symbols but the numbers."""

    def __init__(self, arms: tuple[ArmInstrument, ...], obstacles: list[mpc.Obstacle]) -> None:
        """For arms and obstacles that stand still."""
        self.arms = arms
        self.data = [arm.chain.model.createData() for arm in arms]
        self.standing = MM * np.array([[o.a, o.b] for o in obstacles], dtype=float).reshape(
            -1, 2, 3
        )
        owners = [k for k, arm in enumerate(arms) for _ in arm.links]
        count = len(owners)
        pairs = all_pairs(count, len(obstacles))
        free = [j >= count or owners[i] != owners[j] or j > i + 1 for i, j in pairs]
        radii = [MM * link.radius for arm in arms for link in arm.links]
        self.touch = Touch(pairs[free], np.array([*radii, *(MM * o.radius for o in obstacles)]))

    def tips(self, joints: list[Array]) -> Array:
        """The tips (A, 3) [mm] at joint coordinates."""
        found = []
        for arm, data, q in zip(self.arms, self.data, joints, strict=True):
            pin.forwardKinematics(arm.chain.model, data, arm.chain.configuration(q))
            last = data.oMi[arm.chain.model.njoints - 1]
            tip = pin.SE3(arm.T_world_base) * last * pin.SE3(arm.chain.T_last_tip)
            found.append(MM * tip.translation)
        return np.stack(found)

    def look(self, joints: list[Array]) -> tuple[float, float]:
        """Least clearance and largest miss of a trocar [mm] at joint coordinates."""
        ends, misses = [], []
        for arm, data, q in zip(self.arms, self.data, joints, strict=True):
            model, base = arm.chain.model, pin.SE3(arm.T_world_base)
            pin.forwardKinematics(model, data, arm.chain.configuration(q))
            for link in arm.links:
                T = base * data.oMi[link.joint + 1] if link.joint >= 0 else base
                ends.append(MM * np.stack([T.act(end) for end in link.ends]))
            tip = base * data.oMi[model.njoints - 1] * pin.SE3(arm.chain.T_last_tip)
            off = MM * (np.array(arm.trocar) - tip.translation)
            z = tip.rotation[:, 2]
            misses.append(float(np.linalg.norm(off - z * (z @ off))))
        capsules = np.concatenate([np.stack(ends), self.standing])
        return float(self.touch.clearances(capsules).min()), max(misses)


def arm_task(seed: int) -> tuple[tuple[ArmInstrument, ...], Array, Array, list[mpc.Obstacle]]:
    """Arms, joint coordinates (14,) at the start, goals (6,) [m], and two spheres between."""
    rng = np.random.default_rng(seed)
    arms = (make_arm(-1.0), make_arm(1.0))
    while True:
        starts = np.array([[-12.0, 0, 385], [12.0, 0, 385]]) + rng.uniform(-8, 8, (2, 3))
        goals = starts[::-1] * [1, 1, 1] + rng.uniform(-6, 6, (2, 3))
        goals[:, 1] += np.array([1.0, -1.0]) * rng.uniform(4, 10)
        balls = [
            mpc.Obstacle.sphere((0.0, rng.uniform(-25, 25), rng.uniform(350, 375)), 4.0).scaled(
                1 / MM
            )
            for _ in range(2)
        ]
        q0 = [held_tip(arm, tip / MM, POSTURE) for arm, tip in zip(arms, starts, strict=True)]
        q1 = [held_tip(arm, tip / MM, q) for arm, tip, q in zip(arms, goals, q0, strict=True)]
        watch = Watch(arms, balls)
        if min(watch.look(q0)[0], watch.look(q1)[0]) > 4.0:
            return arms, np.concatenate(q0), goals.ravel() / MM, balls


def run_arms(seed: int, planner: mpc.Planner | None = None, p: int = 10, most: int = 300) -> ArmRun:
    """Run a task of two arms on the exact model."""
    arms, q, goal, balls = arm_task(seed)
    # Weights are per unit of a state: those meant for mm would make joints slow.
    settings = mpc.Settings(p=p, effort=0.5, smooth=0.0, noise=mpc.Noise(bias=BEND))
    statement = mpc.Statement(arms, 0, settings, len(balls))
    controller = mpc.Controller(statement, planner or mpc.RealTime(), mpc.Safety(budget=1.0))
    watch, unit = Watch(arms, balls), statement.unit
    low, high = (np.concatenate([getattr(a.chain, s) for a in arms]) for s in ("lower", "upper"))
    least, miss, inside, seconds = np.inf, 0.0, True, []
    stage = statement.stages(MM * goal, [ball.scaled(MM) for ball in balls])[0]
    # For whole ways, an arm's shaft is an instrument by its tip.
    guide = Guide(
        mpc.Statement(tuple(mpc.TipInstrument(arm.trocar) for arm in arms), 0, mpc.Settings())
    )
    reached, wanted = False, goal.reshape(-1, 3)
    for _ in range(most):
        tips = watch.tips(np.split(q, len(arms))) / MM
        reference = guide.reference(tips, wanted, balls)
        command = controller.step(q, reference.ravel(), balls)
        seconds.append(command.seconds)
        ahead = q + statement.settings.dt * command.rate
        between = held_exactly(statement, (q + ahead) / (2 * unit), stage)
        knots = [q, unit * between, ahead]
        for a, b in pairwise(knots):
            for k in range(1, SUBSTEPS + 1):
                gap, off = watch.look(np.split(a + (b - a) * k / SUBSTEPS, len(arms)))
                least, miss = min(least, gap), max(miss, off)
        q = knots[-1]
        inside = inside and bool(((q >= low) & (q <= high)).all())
        if np.linalg.norm(watch.tips(np.split(q, len(arms))) - MM * wanted, axis=1).max() < 1.0:
            reached = True
            break
    return ArmRun(least, miss, inside, reached, len(seconds), np.array(seconds))
