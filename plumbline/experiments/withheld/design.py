"""What kind of cases a set holds, and how each one is drawn from its own number.

A level is a range of the unabsorbed gap over the noise and of the number of rows:

    faint 0.35 to 0.7 sigma, 30 to 60 rows;  slight 0.7 to 1, 20 to 200;  clear 1 to 4, 60 to 140.

The draw of case k depends on the seed and on k alone, so a set can be continued.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import Plan
from plumbline.experiments.reality.arms import ARMS
from plumbline.experiments.reality.cases import KINDS, OBSERVATIONS
from plumbline.experiments.reality.draws import LIBRARY, offered
from plumbline.experiments.reality.unseen import UNSEEN

LEVELS: dict[str, tuple[tuple[float, float], tuple[int, int]]] = {
    "faint": ((0.35, 0.7), (30, 60)),
    "slight": ((0.7, 1.0), (20, 200)),
    "clear": ((1.0, 4.0), (60, 140)),
}
MIXED, MIXTURE, UNLISTED, EACH, ONE = "mixed", "mixture", "unseen", "each", "one"
SHARES = {"single": 0.5, "pair": 0.2, "none": 0.1, "outside": 0.2}
SEEN_BY = {"tip_position": 0.55, "pose": 0.15, "fixed_point": 0.15, "joint_position": 0.15}
LEFT_OUT = 0.5  # share of leave-one-out cases that do have the effect
# A mixture: one cause each, eight in ten of them the library's. Of the others half are unseen and
# half lost their effect; as many of the eight lost one that they do not have.
IN_LIBRARY = 0.8
SIMULATORS = ("numpy", "mujoco", "torque", "motion")


@dataclass(frozen=True)
class Design:
    """Everything about a set."""

    seed: int  # the set follows from it, byte for byte
    kind: str = MIXED  # single, pair, none, outside, unseen, mixture or mixed
    level: str = "clear"  # faint, slight, clear or mixed
    observation: str = "tip_position"  # one of the simulators' observations, or mixed
    gap: tuple[float, float] | None = None  # range of gap to noise, instead of the level's
    rows: tuple[int, int] | None = None  # range of rows, instead of the level's
    gross: float = 0.0  # largest share of grossly wrong readings
    surgical: float = 0.25  # chance of a box of 0.2 to 0.4 m instead of the whole joint range
    moving: float = 0.2  # chance that the arm moves during the readings
    effects: tuple[str, ...] = ()  # names to draw from; all that make sense when empty
    arms: tuple[str, ...] = ()  # arms to draw from; all when empty
    known_noise: bool = True  # whether recordings state their noise
    # effects taken out of the library in turn; ``each`` is every one that the static simulator
    # draws (friction, of moving arms alone, and the tool's offset, always fitted, are not among
    # them), ``one`` the effect of one cause of the case itself, which must have two
    leave_out: tuple[str, ...] = ()
    # numpy (static recordings), mujoco (moving ones), torque (efforts of moving ones) or motion
    # (commands and what the joints did)
    simulator: str = "numpy"

    def __post_init__(self) -> None:
        effects, arms = _effects_of(self.simulator, self.kind), _arms_of(self.simulator)
        for option, value, known in (
            ("--kind", self.kind, (*KINDS, MIXTURE, MIXED)),
            ("--level", self.level, (*LEVELS, MIXED)),
            ("--observation", self.observation, (*OBSERVATIONS, MIXED)),
            ("--simulator", self.simulator, SIMULATORS),
            *(("--leave-out", name, (*LIBRARY, EACH, ONE)) for name in self.leave_out),
            *(("--effect", name, effects) for name in self.effects),
            *(("--arm", name, arms) for name in self.arms),
        ):
            if value not in known:
                raise PlumblineError(
                    f"{option} {value!r} not recognised; known: {', '.join(known)}"
                )
        if ONE in self.leave_out and (self.kind != "pair" or len(self.leave_out) > 1):
            raise PlumblineError(f"--leave-out {ONE}: of two causes, alone; expected --kind pair")
        self._check_together()
        for option, span, least in (("--gap", self.gap, 1e-3), ("--rows", self.rows, 20)):
            if span is not None and not least <= span[0] <= span[1]:
                raise PlumblineError(
                    f"{option} {span[0]} {span[1]}: expected {least} <= LOW <= HIGH"
                )

    def _check_together(self) -> None:
        if self.kind == "pair" and len(set(self.effects)) == 1:
            raise PlumblineError(f"--kind pair: of {self.effects[0]} alone; name another --effect")
        if self.kind in {UNLISTED, MIXTURE} and self.leave_out:
            raise PlumblineError(f"--kind {self.kind}: says itself what is left out; name nothing")
        if self.kind == MIXTURE and self.effects:
            raise PlumblineError(f"--kind {MIXTURE}: draws its own effects; name none")
        if self.simulator == "motion":
            if self.kind in {UNLISTED, MIXTURE} or self.leave_out or self.arms:
                raise PlumblineError(
                    "--simulator motion: draws single, pair, none, outside or mixed of an arm of "
                    "its own"
                )
            return
        if self.simulator != "mujoco":
            return  # the torque simulator sees efforts, whatever observation is asked for
        from plumbline.experiments.reality.moving import OBSERVATIONS as MOVING

        still = {"pair", UNLISTED, MIXTURE}
        if self.kind in still or self.observation not in {*MOVING, MIXED}:
            known = ", ".join(MOVING)
            raise PlumblineError(f"--simulator mujoco: draws one cause, and sees {known} alone")

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the effects that are left out in turn."""
        if ONE in self.leave_out:
            return ()
        return tuple(LIBRARY) if EACH in self.leave_out else self.leave_out


def _effects_of(simulator: str, kind: str) -> tuple[str, ...]:
    if simulator == "torque":
        from plumbline.experiments.reality.torques import INSIDE as TORQUES

        return TORQUES
    if kind == UNLISTED:
        return tuple(UNSEEN)
    if simulator == "motion":
        from plumbline.experiments.reality.drives import INSIDE as DRIVES

        return tuple(DRIVES)
    if simulator != "mujoco":
        return tuple(LIBRARY)
    from plumbline.experiments.reality.moving import INSIDE

    return tuple(dict.fromkeys(name for names in INSIDE.values() for name in names))


def _arms_of(simulator: str) -> tuple[str, ...]:
    if simulator != "mujoco":
        return tuple(ARMS)
    from plumbline.experiments.reality.moving import ARM_NAMES

    return ARM_NAMES


@dataclass(frozen=True)
class Draw:
    """What was decided about one case before its scene is drawn."""

    plan: Plan  # for the simulator
    without: tuple[str, ...] = ()  # effects that the run must do without


def draw_plan(design: Design, number: int, attempt: int = 0) -> Draw:
    """Decide on kind, level and observation of one case."""
    rng = np.random.default_rng([design.seed, number, attempt, 11])
    level = str(rng.choice(list(LEVELS))) if design.level == MIXED else design.level
    gap, rows = LEVELS[level]
    observation = _weighted(SEEN_BY, rng) if design.observation == MIXED else design.observation
    kind = _weighted(SHARES, rng) if design.kind == MIXED else design.kind
    effects = design.effects
    without: tuple[str, ...] = ()
    if kind == MIXTURE:
        kind, effects, without = _mixture(observation, rng)
    elif design.left_out:
        without = (design.left_out[number % len(design.left_out)],)
        kind, observation, effects = _leave_one_out(without[0], kind, observation, rng)
    plan = Plan(
        kind=kind,
        gap=design.gap or gap,
        rows=design.rows or rows,
        observation=observation,
        known_noise=design.known_noise,
        gross=design.gross,
        surgical=design.surgical,
        moving=design.moving,
        effects=() if kind in {"none", "outside"} else effects,
        arms=design.arms,
    )
    return Draw(plan, without)


def _leave_one_out(
    effect: str, kind: str, observation: str, rng: np.random.Generator
) -> tuple[str, str, tuple[str, ...]]:
    """Half of the cases have the effect alone; the others do not have it at all."""
    if effect not in offered(observation):
        observation = "tip_position"
    if rng.random() < LEFT_OUT:
        return "single", observation, (effect,)
    others = tuple(name for name in offered(observation) if name != effect)
    return kind, observation, others


def _mixture(
    observation: str, rng: np.random.Generator
) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Kind, effects to draw from, and what the run must do without."""
    chance, half = rng.random(), 0.5 * (1.0 - IN_LIBRARY)
    if chance < half:
        return UNLISTED, (), ()
    one, other = (str(name) for name in rng.choice(offered(observation), 2, replace=False))
    if chance < 2.0 * half:
        return "single", (one,), (one,)
    return "single", (one,), (other,) if chance < 3.0 * half else ()


def _weighted(shares: dict[str, float], rng: np.random.Generator) -> str:
    return str(rng.choice(list(shares), p=list(shares.values())))
