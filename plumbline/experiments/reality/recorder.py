"""From a case to a recording: numbers with noise, a samples table, and the truth about them.

A session may go on, with postures that somebody asked for. What was wrong stays wrong, the clock
runs on, and the arm that rests cools towards the air:

    T <- ambient + (T - ambient) exp(-wait / settle),    then, at work,
    T <- T_end + (T - T_end) exp(-step / settle)

with T_end the arm's temperature when the session broke off. The readings taken before stay as they
were, digit by digit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Arm, Array
from plumbline.experiments.reality.gap import gap
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.scene import Mechanism, Scene, Session, built, measured
from plumbline.experiments.reality.session import correction, lagged, tips

RANGES = Ranges("reading")
LEVER = 0.2  # m: turns a position noise into a rotation noise
ANEW = 1_000_003  # between the seeds of readings, so that no other case has them
SETTLE = 0.3  # time constant of warming and cooling, as a share of the session


@dataclass(frozen=True)
class Case:
    """Everything that decides a recording."""

    name: str  # name of the folder
    kind: str  # single, pair, none, outside or unseen
    observation: str  # tip_position, pose, fixed_point or joint_position
    arm: Arm  # the arm as its maker draws it
    scene: Scene  # the arm with real masses and nothing yet wrong
    effects: tuple[Mechanism, ...]  # what is wrong, in the order of the chain
    nominal_tool: Array  # (3,) the tool offset that the recording states [m]
    noise_std: float  # 1 sigma per axis [m, or rad for a second encoder]
    gap_to_noise: tuple[float, ...]  # unabsorbed gap of each effect over the noise
    seed: int  # source of the noise
    known_noise: bool = True  # whether the recording states its noise
    gross_share: float = 0.0  # share of readings that are grossly wrong
    moving: bool = False  # whether the arm moved during the readings
    # lag of the logged temperature [s]; None when it hangs in the air
    thermometer: float | None = 120.0
    sockets: NDArray[np.int64] | None = None  # (N,) socket of each row from 0, for fixed_point
    # effects that this recording cannot tell from the truth
    confounded: tuple[dict[str, object], ...] = ()

    @property
    def rows(self) -> int:
        """Number of readings."""
        return self.scene.session.rows


@dataclass(frozen=True)
class Recording:
    """Tables of a recording: settings as TOML text, and named columns (N,)."""

    settings: str
    columns: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Readings:
    """What was read, and what nobody but the simulator knows of it."""

    q: Array  # encoder readings (N, n) [rad or m]
    columns: dict[str, Array]  # measured columns (N,)
    noise: Array  # what noise added (N, m) [m or rad]
    gross: list[int]  # spoilt rows, from 0


def simulate(case: Case) -> tuple[Recording, dict[str, object]]:
    """Take the readings: the recording's tables, and the truth about it."""
    rng = np.random.default_rng([case.seed, 7])
    found = READ[case.observation](case, rng)
    columns = numbered("q", found.q) | found.columns | _context(case)
    return Recording(settings(case), columns), truth(case, found.noise, found.gross)


def _tip(case: Case, rng: np.random.Generator) -> Readings:
    noise = _noise(case, rng)
    points, gross = _gross(case, measured(case.scene, case.effects) + noise, rng)
    columns = dict(zip("xyz", points.T, strict=True))
    return Readings(case.scene.session.q, columns, noise, gross)


def _pose(case: Case, rng: np.random.Generator) -> Readings:
    """Places and turns of a tracker that is mounted on the tool in any way."""
    found = _tip(case, rng)
    mount = Rotation.random(None, np.random.default_rng([case.seed, 8]))
    _, turn = built(case.scene, case.effects).pose_in_device()
    spin = rng.normal(0.0, 0.5 * case.noise_std / LEVER, (case.rows, 3))
    small = Rotation.from_quat(np.insert(0.5 * spin, 0, 1.0, axis=1), scalar_first=True)
    quaternion = quaternions(turn @ (mount * small).as_matrix())
    turned = dict(zip(("qw", "qx", "qy", "qz"), quaternion.T, strict=True))
    return replace(found, columns=found.columns | turned)


def _fixed_point(case: Case, rng: np.random.Generator) -> Readings:
    """Move the joints until the true tip rests in its socket, give or take the touch."""
    if case.sockets is None:
        raise PlumblineError("a fixed_point case without sockets: give one number for each row")
    noise = _noise(case, rng)
    goal, gross = _gross(case, case.scene.pose_in_world()[0] + noise, rng)
    scene, effects = case.scene, case.effects
    tool = scene.tool[0]
    for _ in range(12):
        point, _ = built(scene, effects).pose_in_world()
        _, jacobian = tips(scene.arm, scene.session.q, tool)
        q = scene.session.q + correction(jacobian, goal - point)
        scene = moved_to(scene, q)
    sockets = np.asarray(case.sockets + 1, dtype=np.float64)
    return Readings(scene.session.q, {"socket": sockets}, noise, gross)


def moved_to(scene: Scene, q: Array) -> Scene:
    """The scene with other encoder readings (N, n)."""
    return replace(scene, session=replace(scene.session, q=q), q=q.copy())


def _joint_position(case: Case, rng: np.random.Generator) -> Readings:
    true = built(case.scene, case.effects).q
    spread = case.noise_std * np.sqrt(_shares(rng, true.shape[1]))
    noise = rng.normal(0.0, 1.0, true.shape) * spread
    seen, gross = _gross(case, true + noise, rng)
    return Readings(case.scene.session.q, numbered("m", seen), noise, gross)


READ = {
    "tip_position": _tip, "pose": _pose, "fixed_point": _fixed_point,
    "joint_position": _joint_position,
}  # fmt: skip


def _shares(rng: np.random.Generator, axes: int) -> Array:
    """Variances of the axes, unequal, with mean 1."""
    share = RANGES.many("axis", rng, axes) ** 2
    return np.asarray(share / share.mean())


def _noise(case: Case, rng: np.random.Generator) -> Array:
    """Noise (N, 3) [m], unequal along axes that point anywhere, rms per axis as the case says."""
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    spread = np.sqrt(_shares(rng, 3))
    noise = (rng.normal(size=(case.rows, 3)) * spread) @ axes.T
    return np.asarray(case.noise_std * noise)


def _gross(case: Case, values: Array, rng: np.random.Generator) -> tuple[Array, list[int]]:
    """Spoil a share of the rows by 10 to 60 sigma, and tell which, from 0."""
    count = round(case.gross_share * case.rows)
    rows = np.sort(rng.choice(case.rows, size=count, replace=False))
    spoilt = values.copy()
    for row in rows:
        push = rng.normal(size=values.shape[1])
        spoilt[row] += case.noise_std * RANGES.one("gross", rng) * push / np.linalg.norm(push)
    return spoilt, rows.tolist()


def numbered(prefix: str, values: Array) -> dict[str, Array]:
    """Columns ``q1..qn`` of values (N, n)."""
    return {f"{prefix}{i + 1}": column for i, column in enumerate(values.T)}


def _context(case: Case) -> dict[str, Array]:
    """Columns that a logger writes whether they matter or not."""
    session = case.scene.session
    shown = session.ambient
    if case.thermometer is not None:
        shown = lagged(session.time, session.warmth, case.thermometer)
    columns = {"time": session.time, "temperature": np.round(shown, 2)}
    columns |= numbered("direction", session.direction)
    columns |= numbered("velocity", session.velocity) if case.moving else {}
    if session.force is not None:  # a sensor of 0.01 N
        pushed = zip("xyz", np.round(session.force, 2).T, strict=True)
        columns |= {f"force_{c}": values for c, values in pushed}
    return columns | {"group": session.group}


def settings(case: Case) -> str:
    """The recording's dataset.toml."""
    arm = case.arm
    lines = [f'name = "{case.name}"', f'observation = "{case.observation}"']
    if case.known_noise:
        lines.append(f"noise_std = {case.noise_std:.6g}")
    lines += robot_lines(arm, ["", "[tool]", f"offset = {_list(case.nominal_tool)}"])
    return "\n".join(lines) + "\n"


def robot_lines(arm: Arm, between: Sequence[str] = ()) -> list[str]:
    """Lines of a dataset.toml that say which robot it was, with others before any DH rows."""
    lines = ["", "[robot]"]
    if arm.bundled:
        lines.append(f'bundled = "{arm.bundled}"')
    lines += [f'tip_frame = "{arm.tip_frame}"', f"gravity = {_list(arm.gravity)}", *between]
    if not arm.bundled:
        for i in range(arm.joints):
            lines += ["", "[[robot.dh]]", *_row(arm, i)]
    return lines


def _row(arm: Arm, i: int) -> list[str]:
    numbers = {"d": arm.d, "a": arm.a, "alpha": arm.alpha, "theta": arm.theta}
    lines = [f"{key} = {float(table[i])!r}" for key, table in numbers.items()]
    kind = "prismatic" if arm.prismatic[i] else "revolute"
    mass, com = float(arm.mass[i]), _list(arm.com[i])
    return [*lines, f'kind = "{kind}"', f"mass = {mass!r}", f"com = {com}"]


def _list(values: Array) -> str:
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def truth(case: Case, noise: Array, gross: list[int]) -> dict[str, object]:
    """What is really wrong, as plain data.

    With what noise added to each reading (N, m) [m or rad], and the spoilt rows from 0.
    """
    trusted = np.delete(noise, np.asarray(gross, dtype=np.intp), axis=0)
    effects = [
        {"effect": m.effect, "element": m.element, "parameters": m.parameters(), "gap_to_noise": g}
        for m, g in zip(case.effects, case.gap_to_noise, strict=True)
    ]
    joint = gap(case.scene, case.effects, case.observation, case.sockets) if case.effects else 0.0
    return {
        "name": case.name,
        "kind": case.kind,
        "effects": effects,
        "gap_to_noise": joint / case.noise_std,
        "noise_std": case.noise_std,
        "noise_rms": float(np.sqrt(np.mean(trusted**2))),
        "rows": case.rows,
        "arm": case.arm.name,
        "observation": case.observation,
        "moving": case.moving,
        "gross_rows": [r + 2 for r in gross],  # as an editor counts: the header is row 1
        "thermometer": "in the room" if case.thermometer is None else "lagging",
        "confounded": list(case.confounded),
        "seed": case.seed,
    }


def write(folder: Path, recording: Recording) -> None:
    """Write dataset.toml and samples.csv into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dataset.toml").write_text(recording.settings, encoding="utf-8")
    write_table(folder / "samples.csv", recording.columns)


def write_table(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write named columns (N,) as CSV, nine digits a number."""
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.9g")


def quaternions(turn: Array) -> Array:
    """Unit quaternions (N, 4), w first and not negative, of rotation matrices (N, 3, 3)."""
    return Rotation.from_matrix(turn).as_quat(canonical=True, scalar_first=True)


def extended(
    case: Case,
    q: Array,
    *,
    direction: Array | None = None,
    velocity: Array | None = None,
    wait: Array | None = None,
    group: NDArray[np.int64] | None = None,
    sockets: NDArray[np.int64] | None = None,
) -> Case:
    """The case with more rows at its end: encoder readings q (M, n) [rad or m].

    Of fixed points these are postures near the ``sockets`` (M,) from 0, which must be given. Sides
    of the approach (M, n), velocities (M, n) [rad/s or m/s] and rests before each row (M,) [s] are
    zero unless given; ``group`` (M,) numbers the part of the session, a new one unless given.
    """
    if case.sockets is not None and sockets is None:
        raise PlumblineError("fixed points without sockets: give one number for each row")
    scene, old, still, rows = case.scene, case.scene.session, np.zeros_like(q), len(q)
    time, warmth = _clock(old, np.zeros(rows) if wait is None else wait)
    more = {
        "q": q, "time": time, "warmth": warmth, "ambient": np.full(rows, old.ambient[-1]),
        "direction": still if direction is None else direction,
        "velocity": still if velocity is None else velocity,
        "group": np.full(rows, old.group[-1] + 1.0) if group is None else group,
    }  # fmt: skip
    more |= {} if old.force is None else {"force": np.zeros((rows, 3))}
    longer = {name: np.concatenate([getattr(old, name), end]) for name, end in more.items()}
    length = float(np.ptp(old.time)) if old.length is None else old.length
    session = replace(old, length=length, **longer)
    if sockets is not None:
        before = np.empty(0, int) if case.sockets is None else case.sockets
        sockets = np.concatenate([before, sockets])
    return replace(
        case,
        scene=Scene.ideal(scene.arm, session, scene.tool[0], scene.device),
        effects=tuple(effect.pinned(scene) for effect in case.effects),
        sockets=sockets,
    )


def read_on(case: Case, longer: Case, reading: int = 0) -> Recording:
    """The tables of a longer case, its first rows as they were read before."""
    again = longer if reading == 0 else replace(longer, seed=longer.seed + ANEW * reading)
    before, after = simulate(case)[0], simulate(again)[0]
    columns = {
        name: np.concatenate([values, after.columns[name][case.rows :]])
        for name, values in before.columns.items()
    }
    return Recording(before.settings, columns)


def _clock(session: Session, rest: Array) -> tuple[Array, Array]:
    """Times [s] and the arm's temperatures [degC] (M,) of rows that follow a session."""
    step = float(np.median(np.diff(session.time)))
    settle = max(SETTLE * float(np.ptp(session.time)), 1e-9)
    ambient, end = float(session.ambient[-1]), float(session.warmth[-1])
    now, warmth = end, np.empty(len(rest))
    for k, wait in enumerate(rest):
        now = ambient + (now - ambient) * np.exp(-wait / settle)
        now = end + (now - end) * np.exp(-step / settle)
        warmth[k] = now
    return session.time[-1] + np.cumsum(step + rest), warmth
