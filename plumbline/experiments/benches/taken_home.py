"""What was found, taken home: does the arm hit, does the file do it alone, is a drift named?

``python -m plumbline.experiments.benches.taken_home [--arms N] [--real]``

*Simulated arms*, each with three causes of its own, by a simulator that shares no code with the
models. The error of 1,000 unseen postures in the device's frame, commanded by the nominal robot
with its own best frame and tool, and by the model. Then the arm is recorded twice more: as it is,
and with one of its causes half as strong again. *A chain of answers*: every link's share of an
error, by what readings tell, against that of what they were drawn from. *Real robots*: the UR10's
model on its other series, by the exported file alone too; the SO-101's file alone, in MuJoCo.
"""

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from plumbline.experiments.benches.asking import counted, fetched, label, loaded
from plumbline.experiments.console.measured import Found, as_command, timed
from plumbline.experiments.reality import Plan, draw_case, simulate
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.draws import draw
from plumbline.experiments.reality.gap import scaled
from plumbline.experiments.reality.recorder import Case
from plumbline.experiments.reality.scene import Mechanism, Scene, built
from plumbline.experiments.reality.session import draw_session
from plumbline.experiments.sources import fetch
from plumbline.kinematics.robot import Robot
from plumbline.optim.budget import Source, add_up
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion
from plumbline.optim.diagnosis.motion.recording import load_motion
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.measurement.observation import build_model
from plumbline.optim.measurement.refit import figure, refit
from plumbline.optim.model import Model, apply
from plumbline.optim.model.export.exported import replay
from plumbline.optim.model.making import FitEnd, model_of
from plumbline.optim.model.rows import columns_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.registration import MarkerNoise, build_fiducials, register
from plumbline.optim.registration.least_squares import Anisotropic

# What an arm has for good, and a command can be given against.
CAUSES = (
    "joint_offset", "joint_compliance", "joint_tilt", "backlash", "transmission_ripple",
    "joint_coupling", "link_geometry", "link_flex", "base_compliance",
)  # fmt: skip
GAP = 5.0  # of each cause in the tips, unabsorbed, over their noise
POSTURES = 1000  # that an arm is sent to by its model
POINTS, CHAINS = 60, 10  # postures of a chain, and chains of an arm
REPEATS = (40, 100)  # how often an error is read to know its size
MANY, LOOP = 1000, 300  # registrations that a truth is of, rows of a closed loop
TOUCH = 0.15e-3  # [m] standard deviation of a touch
SERIES = ("ur10-grid", "ur10-joints", "ur10-iso")
MOTIONS = ("so101-multisine", "so101-friction-gravity", "so101-step-response")
Told = tuple[Source, Array, Array]  # what is told of a link, its true mean (N, 3) and covariance
GROWN = 1.5  # times its strength: what has happened to a cause since


def drawn_arm(seed: int, rows: int) -> Case:
    """An arm that uses its whole range, with three causes."""
    plan = Plan("none", rows=(rows, rows), arms=("ur5", "ur10"), surgical=0.0, moving=0.0)
    case, rng = draw_case(plan, "first", seed), np.random.default_rng([seed, 23])
    found: list[Mechanism] = []
    for name in rng.permutation(CAUSES):
        sized = scaled(
            case.scene, draw(str(name), case.scene, rng), GAP * case.noise_std, "tip_position"
        )
        if sized is not None:
            found.append(sized.pinned(case.scene))
        if len(found) == 3:
            break
    return replace(case, effects=tuple(found), gap_to_noise=(GAP,) * len(found))


def again(case: Case, seed: int, effects: tuple[Mechanism, ...]) -> Case:
    """The same arm on another day: other postures, another place of the device, another tool."""
    plan = Plan(
        "none", rows=(case.rows, case.rows), arms=(case.arm.name,), surgical=0.0, moving=0.0
    )
    other = draw_case(plan, "again", seed)
    s = other.scene
    scene = Scene.ideal(case.scene.arm, s.session, s.tool[0], s.device)
    return replace(other, scene=scene, effects=effects, noise_std=case.noise_std,
                   gap_to_noise=case.gap_to_noise)  # fmt: skip


def nominal(recording: Recording, model: Model) -> Model:
    """The robot as it was delivered, frame and tool fitted to the same rows."""
    end, bare = refit(recording, (), np.empty(0)), build_model(recording, ())
    P = np.eye(len(end.x))
    return model_of(recording, FitEnd(bare.nuisance, (), end.x, bare.problem.scale, P), model.held)


def missed(case: Case, model: Model, q: Array, goal: Array, side: Array) -> Array:
    """How far the arm's tip stays from goals (N, 3) of the device [m], sent there by a model."""
    R, t = model.T_device_base[:3, :3], model.T_device_base[:3, 3]
    sent = model.joint_command_for((goal - t) @ R, near=q, direction=side).q
    return np.linalg.norm(tips(case, sent, side) - goal, axis=1)


def tips(case: Case, q: Array, side: Array) -> Array:
    """Where the simulator's arm has its tip (N, 3) in the device's frame [m], at readings."""
    still = np.zeros(len(q))
    session = replace(
        case.scene.session, q=q, direction=side, velocity=np.zeros_like(q),
        time=still, warmth=still, ambient=still, group=still,
    )  # fmt: skip
    ideal = Scene.ideal(case.scene.arm, session, case.scene.tool[0], case.scene.device)
    return built(ideal, case.effects).pose_in_device()[0]


Chains = list[dict[str, float]]


def taken_home(seed: int, rows: int) -> tuple[dict[str, object], Chains]:
    """One arm: what its model gains, what a file loses, what is said of it later; and chains."""
    case, rng = drawn_arm(seed, rows), np.random.default_rng([seed, 29])
    session = draw_session(case.arm, POSTURES, rng, tool=case.nominal_tool)
    ideal = Scene.ideal(case.arm, session, case.scene.tool[0], case.scene.device)
    goal, which = ideal.pose_in_device()[0], int(rng.integers(len(case.effects)))
    grown = list(case.effects)
    grown[which] = grown[which].sized(GROWN * grown[which].size)
    recording = loaded(simulate(case)[0])
    model = diagnose(recording, DiagnosisOptions(force=True)).model()
    same = apply(model, loaded(simulate(again(case, seed + 5000, case.effects))[0]))
    other = apply(model, loaded(simulate(again(case, seed + 6000, tuple(grown)))[0]))
    robots = (nominal(recording, model), model)
    sizes = [np.sqrt(np.mean(missed(case, m, session.q, goal, session.direction) ** 2))
             for m in robots]  # fmt: skip
    urdf = Robot.from_urdf(model.as_urdf().text).chain("calibrated_tool")
    q = session.q[:100]
    placed = urdf.placement(q + model.corrections_beyond_links(q))[:, :3, 3]
    truth = [label((e.effect, e.element)) for e in case.effects]
    chains = [shares(case, model, rng) for _ in range(CHAINS)]
    return {
        "causes": ", ".join(truth),
        "before": 1e3 * sizes[0],
        "after": 1e3 * sizes[1],
        "gone": 1.0 - sizes[1] / sizes[0],
        "urdf": 1e9 * float(np.abs(placed - model.tip(q)).max()),
        "silent": same.holds,
        "noticed": not other.holds,
        "named": truth[which] in [c.label for c in other.changes],
        "first": truth[which] in [c.label for c in other.changes[:1]],
        "changed": truth[which],
        "said": ", ".join(c.label for c in other.changes),
    }, chains


def shares(case: Case, model: Model, rng: np.random.Generator) -> dict[str, float]:
    """One chain: how far the told shares are from the true ones, and how many are in their 95 %."""
    q = draw_session(case.arm, POINTS, rng, tool=case.nominal_tool).q
    links = (_markers(rng), _arm(case, model, q), _needle(rng), _controller(rng))
    b = np.array([np.broadcast_to(mean, (POINTS, 3)) for _, mean, _ in links])
    traces = np.array([np.trace(C) for _, _, C in links])
    true = np.einsum("kni,ni->k", b, b.sum(axis=0)) / POINTS + traces
    true /= true.sum()
    parts = add_up([source for source, _, _ in links]).parts
    off = max(abs(p.share - t) for p, t in zip(parts, true, strict=True))
    inside = np.mean(
        [p.interval[0] <= t <= p.interval[1] for p, t in zip(parts, true, strict=True)]
    )
    return {"off": off, "inside": float(inside)}


def _markers(rng: np.random.Generator) -> Told:
    """Six markers and a lesion, read in CT; the truth is that of many such registrations.

    Their noise is stated from readings that were repeated, and each draw has its opposite: the
    truth's own chance is in their spread alone.
    """
    ct, std = rng.uniform(-0.07, 0.07, (7, 3)), rng.uniform(0.1e-3, 0.5e-3, 3)
    freedoms = int(rng.integers(*REPEATS)) - 1
    size, touch = np.sqrt(rng.chisquare(freedoms, 3) / freedoms), rng.chisquare(3 * freedoms)
    touch = TOUCH * np.sqrt(touch / (3 * freedoms))
    noise = MarkerNoise.from_std(size * std, touch, freedoms=3.0 * freedoms)
    e, g = rng.normal(0.0, 1.0, (MANY, 7, 3)) * std, rng.normal(0.0, TOUCH, (MANY, 6, 3))
    read, touched = ct + np.concatenate([e, -e]), ct[:-1] + np.concatenate([g, -g])
    T = Anisotropic().batch(read[:, :-1], touched, noise)
    off = np.einsum("kij,kj->ki", T[:, :3, :3], read[:, -1]) + T[:, :3, 3] - ct[-1]
    found = register(build_fiducials(read[0, :-1], touched[0], noise=noise))
    source = Source.of_target("markers", found.tre(read[0, -1], None))
    return source, off.mean(axis=0), np.cov(off, rowvar=False)


def _arm(case: Case, model: Model, q: Array) -> Told:
    """The arm, commanded by its nominal model with the frame and tool that were found."""
    points, off = tips(case, q, np.zeros_like(q)), model.nominal.in_device(q)
    R = model.T_device_base[:3, :3]
    return Source.of_arm("arm", model, q), (points - off) @ R, np.zeros((3, 3))


def _needle(rng: np.random.Generator) -> Told:
    """Insertions into a phantom, that many errors in space."""
    count, mean = int(rng.integers(*REPEATS)), rng.normal(0.0, 0.3e-3, 3)
    size = np.diag(rng.uniform(0.1e-3, 0.6e-3, 3))
    e = mean + rng.normal(0.0, 1.0, (count, 3)) @ size
    C = np.cov(e, rowvar=False)
    source = Source.of("needle", mean=e.mean(axis=0), covariance=C, mean_covariance=C / count,
                       dof=3.0 * (count - 1))  # fmt: skip
    return source, mean, size @ size


def _controller(rng: np.random.Generator) -> Told:
    """A closed loop whose errors follow each other."""
    mean, std, keep = rng.normal(0.0, 0.1e-3, 3), rng.uniform(0.05e-3, 0.4e-3), 0.8
    e = [rng.normal(0.0, std, 3)]
    for _ in range(LOOP - 1):
        e.append(keep * e[-1] + rng.normal(0.0, std * np.sqrt(1.0 - keep**2), 3))
    source = Source.of_tracking("controller", np.zeros((LOOP, 3)), mean + np.array(e))
    return source, mean, std**2 * np.eye(3)


def ur10() -> pd.DataFrame:
    """The UR10's model on its other series: whole, and as the exported file says it [mm]."""
    grid, *others = fetched(SERIES)
    model = diagnose(grid).model()
    urdf = Robot.from_urdf(model.as_urdf().text)
    table = []
    for other in others:
        found = apply(model, other)
        chain = urdf.chain("calibrated_tool")
        context = {n: v for n, v in columns_of(other).items() if n != "q"}
        right = other.q + model.lasting().corrections_beyond_links(other.q, **context)
        same = replace(other, robot=urdf, chain=chain, tip_frame="calibrated_tool",
                       tool_offset=np.zeros(3))  # fmt: skip
        alone = [replace(same, q=q) for q in (other.q, right)]
        ends = [refit(r, (), np.empty(0)) for r in alone]
        file, corrected = (1e3 * figure(e.mapped.residuals(e.x), per_row=True) for e in ends)
        table.append({
            "series": other.name, "before": 1e3 * found.before, "model": 1e3 * found.after,
            "URDF": file, "URDF, corrected": corrected,
        })  # fmt: skip
    q = np.resize(grid.q, (10_000, 6))
    for told, task in (("tips", model.tip), ("commands", model.joint_command)):
        name = f"10,000 {told} by {len(model.names)} unknowns [s]"
        table.append({"series": name, "model": min(timed(partial(task, q), 3, process_time)[1])})
    return pd.DataFrame(table)


def so101(folder: Path) -> pd.DataFrame:
    """The SO-101's file alone, in MuJoCo, on motions that were not fitted [mrad]."""
    first, *others = (load_motion(fetch(name, folder)) for name in MOTIONS)
    drives = diagnose_motion(first).model()
    file, table = drives.as_mjcf().text, []
    for m in (first, *others):
        inside = m.time > m.time[0] + 1.0  # where the joints begin within their play nobody knows
        by = (m.command, replay(file, m.time, m.command), drives.rollout(m.time, m.command))
        ideal, alone, best = (1e3 * np.sqrt(np.mean((x - m.q)[inside] ** 2)) for x in by)
        table.append({"motion": m.name, "before": ideal, "file": alone, "drives": best,
                      "gone": 1.0 - alone / ideal})  # fmt: skip
    return pd.DataFrame(table)


@as_command
def bench(
    arms: Annotated[int, typer.Option(min=0, help="Simulated arms; ten chains of each.")] = 20,
    rows: Annotated[int, typer.Option(min=60, help="Rows of each of their recordings.")] = 200,
    real: Annotated[bool, typer.Option(help="The UR10 and the SO-101 too.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the first arm.")] = 0,
) -> Found:
    """Take home what was found, and try it."""
    found: dict[str, pd.DataFrame] = {}
    if arms:
        drawn = [taken_home(s, rows) for s in counted(range(seed, seed + arms), "arm")]
        found["simulated arms"] = pd.DataFrame([arm for arm, _ in drawn])
        found["shares of a chain"] = pd.DataFrame([c for _, chains in drawn for c in chains])
    with tempfile.TemporaryDirectory() as folder:
        if real:
            found["SO-101, RMS of six joints [mrad]"] = so101(Path(folder))
            found["UR10, RMS of the tip [mm]"] = ur10()
    return found


if __name__ == "__main__":
    typer.run(bench)
