"""Random cases: an arm, a scene, something wrong with it, and nothing that gives it away.

The logger writes the same columns whatever is wrong.
"""

from dataclasses import dataclass, replace

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array, forward, placed, rotations
from plumbline.experiments.reality.arms import ARMS
from plumbline.experiments.reality.draws import ORDER, SIGNED, draw, offered, outside_offered
from plumbline.experiments.reality.gap import scaled
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.recorder import Case
from plumbline.experiments.reality.scene import Mechanism, Scene
from plumbline.experiments.reality.session import draw_session, socketed
from plumbline.experiments.reality.unseen import unseen_offered

RANGES = Ranges("case")
KINDS = ("single", "pair", "none", "outside", "unseen")
OBSERVATIONS = ("tip_position", "pose", "fixed_point", "joint_position")
TRIES = 400  # scenes that are drawn until one gives the gap that is asked for


@dataclass(frozen=True)
class Plan:
    """What kind of cases to draw."""

    kind: str = "single"  # single, pair, none, outside or unseen
    gap: tuple[float, float] = (1.0, 4.0)  # range of the unabsorbed gap over the noise
    rows: tuple[int, int] = (60, 140)  # range of the number of readings
    observation: str = "tip_position"  # tip_position, pose, fixed_point or joint_position
    known_noise: bool = True  # whether recordings state their noise
    gross: float = 0.0  # largest share of grossly wrong readings
    surgical: float = 0.25  # chance of a box of 0.2 to 0.4 m instead of the whole joint range
    moving: float = 0.2  # chance that the arm moves during the readings, whatever the effect
    forced: float = 0.3  # chance that the force on the tip is recorded, whatever the effect
    effects: tuple[str, ...] = ()  # names to draw from; all that make sense when empty
    arms: tuple[str, ...] = ()  # names of the arms to draw from; all when empty

    def __post_init__(self) -> None:
        for value, known in ((self.kind, KINDS), (self.observation, OBSERVATIONS)):
            if value not in known:
                raise PlumblineError(f"{value!r} not recognised; known: {', '.join(known)}")


def draw_case(plan: Plan, name: str, seed: int) -> Case:
    """Draw one case (PlumblineError: no strength of its effects gives the gap in many scenes)."""
    rng = np.random.default_rng([seed, 3])
    names = _names(plan, rng)
    gaps = tuple(float(np.exp(rng.uniform(*np.log(plan.gap)))) for _ in names)
    for _ in range(TRIES):
        bare = _set_up(plan, names, rng)
        found = _effects(plan, bare, names, gaps, rng)
        if found is None:
            continue
        gross = float(rng.uniform(0.0, plan.gross))
        lag = RANGES.one("lag", rng) if RANGES.happens("glued", rng) else None
        return replace(
            bare, name=name, seed=seed, gap_to_noise=gaps, effects=found, gross_share=gross,
            thermometer=lag,
        )  # fmt: skip
    wanted = " and ".join(names)
    raise PlumblineError(f"{wanted}: no scene of {TRIES} gives a gap of {plan.gap}: widen it")


def _names(plan: Plan, rng: np.random.Generator) -> tuple[str, ...]:
    if plan.kind == "none":
        return ()
    pools = {"outside": outside_offered, "unseen": unseen_offered}
    names = plan.effects or pools.get(plan.kind, offered)(plan.observation)
    count = 2 if plan.kind == "pair" else 1
    chosen = [str(n) for n in rng.choice(names, size=count, replace=False)]
    return tuple(sorted(chosen, key=ORDER.index))


def _set_up(plan: Plan, names: tuple[str, ...], rng: np.random.Generator) -> Case:
    """An arm at work, nothing wrong yet."""
    arm = _arm(plan, rng)
    real = arm.with_mass(arm.mass * RANGES.many("mass", rng, arm.joints))
    reach = float(np.abs(arm.a).sum() + np.abs(arm.d).sum())
    nominal = _tool(min(reach, 1.5), rng)
    tool = nominal + RANGES.near("tool", rng, 3)
    may_move = plan.observation != "fixed_point"
    moving = "latency" in names or (may_move and rng.random() < plan.moving)
    rows = int(rng.integers(plan.rows[0], plan.rows[1] + 1))
    surgical = bool(rng.random() < plan.surgical)
    session = draw_session(real, rows, rng, tool=tool, surgical=surgical, moving=moving)
    sockets = None
    if plan.observation == "fixed_point":
        q, sockets = socketed(real, rows, tool, rng)
        session = replace(session, q=q)
    if "needle_bending" in names or (plan.forced and rng.random() < plan.forced):
        session = replace(session, force=rng.normal(0.0, RANGES.one("force", rng), (rows, 3)))
    scene = Scene.ideal(real, session, tool, looking_at(real, session.q, rng))
    noise = RANGES.one("noise", rng) * max(reach / 1.5, 0.5)
    if plan.observation == "joint_position":
        noise = RANGES.one("encoder_noise", rng)
    return Case(
        "", plan.kind, plan.observation, arm, scene, (), nominal, float(f"{noise:.3g}"), (), 0,
        plan.known_noise, moving=moving, sockets=sockets,
    )  # fmt: skip


def _arm(plan: Plan, rng: np.random.Generator) -> Arm:
    names = plan.arms or tuple(ARMS)
    if plan.observation == "joint_position":
        names = tuple(n for n in names if not ARMS[n]().prismatic.any())
    return ARMS[str(rng.choice(names))]()


def _tool(reach: float, rng: np.random.Generator) -> Array:
    """A nominal tool offset (3,) [m], at times on the last axis."""
    aside = 0.0 if RANGES.happens("centred", rng) else RANGES.one("tool_aside", rng) * reach
    turn = rng.uniform(0.0, 2.0 * np.pi)
    along = RANGES.one("tool_along", rng) * reach
    return np.round([aside * np.cos(turn), aside * np.sin(turn), along], 3)


def looking_at(arm: Arm, q: Array, rng: np.random.Generator) -> Array:
    """T_device_world (4, 4): a device 1.5 to 2.5 times the cloud's size away, z towards it."""
    points = forward(arm, q)[:, -1, :3, 3]
    centre = points.mean(axis=0)
    size = max(float(np.linalg.norm(points - centre, axis=1).max()), 0.4)
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    side = np.cross(towards, rng.normal(size=3))
    side /= np.linalg.norm(side)
    aim = rotations(RANGES.near("aim", rng, 3))
    R = aim @ np.stack([side, np.cross(towards, side), towards])
    return placed(R, -R @ (centre - towards * size * RANGES.one("away", rng)))


def _effects(
    plan: Plan,
    bare: Case,
    names: tuple[str, ...],
    gaps: tuple[float, ...],
    rng: np.random.Generator,
) -> tuple[Mechanism, ...] | None:
    found: list[Mechanism] = []
    for name, ratio in zip(names, gaps, strict=True):
        mechanism = draw(name, bare.scene, rng)
        target = ratio * bare.noise_std
        sized = scaled(bare.scene, mechanism, target, plan.observation, bare.sockets)
        if sized is None:
            return None
        flip = name in SIGNED and RANGES.happens("flipped", rng)
        found.append(sized.sized(-sized.size) if flip else sized)
    return tuple(found)
