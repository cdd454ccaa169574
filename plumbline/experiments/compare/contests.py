"""What is set beside whom, and on which data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from plumbline.errors import PlumblineError
from plumbline.experiments.console.tables import table
from plumbline.experiments.sources import fetch
from plumbline.kinematics.dh import rows_table
from plumbline.kinematics.frames import homogeneous
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit import DHOptions, Squares, fit_dh
from plumbline.optim.diagnosis.motion.recording import load_motion
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.recording.loading import load_recording

Given = Mapping[str, Array | str]


@dataclass(frozen=True)
class Way:
    """One way of doing it."""

    peer: str  # whose
    module: str  # file of ``peers``, without its end
    needs: tuple[str, ...] = ()  # what its environment is made of; empty for our own
    note: str = ""  # what differs from the others, in a few words


@dataclass(frozen=True)
class Contest:
    """One set of data and all who are asked."""

    name: str  # what it is called
    what: str  # what is fitted to what, in a sentence
    figure: str  # what is compared, with its unit
    given: Callable[[Path], Given]  # the data
    ways: tuple[Way, ...]  # ours first
    is_time: bool = False  # whether the figure is a time itself, and the process's own tell nothing

    @property
    def subject(self) -> str:
        """The function of a way's module that is asked."""
        return self.name.replace("-", "_")


def phantoms(_: Path) -> Given:
    """200 phantoms of six markers, one of which was knocked by 5 mm."""
    rng = np.random.default_rng(0)
    M, n, std = 200, 6, 3e-4
    ct = rng.uniform(-0.06, 0.06, (M, n, 3))
    target = rng.uniform(-0.04, 0.04, (M, 3))
    R = np.array([pin.exp3(w) for w in rng.normal(0.0, 1.0, (M, 3))])
    t = rng.uniform(-0.5, 0.5, (M, 1, 3))
    place = np.einsum("mij,mnj->mni", R, ct) + t
    push = rng.normal(0.0, 1.0, (M, 3))
    place[np.arange(M), rng.integers(0, n, M)] += (
        5e-3 * push / np.linalg.norm(push, axis=1, keepdims=True)
    )
    true_target = np.einsum("mij,mj->mi", R, target) + t[:, 0]
    return {
        "ct": ct + rng.normal(0.0, std, ct.shape),
        "robot": place + rng.normal(0.0, std, ct.shape),
        "target_ct": target,
        "target_robot": true_target,
        "noise_std": np.array(std),
    }


def poses(_: Path) -> Given:
    """20 set-ups of a UR5 and a tracker: 30 poses, 0.1 mm and 0.3 mrad of noise."""
    rng = np.random.default_rng(1)
    M, N = 20, 30
    chain = Robot.bundled("ur5").chain()
    q = rng.uniform(-1.5, 1.5, (M, N, chain.n))
    flange = np.array([chain.placement(one) for one in q])
    tool = np.array([_placed(rng.normal(0, [0.1, 0.1, 0.1, 0.2, 0.2, 0.2])) for _ in range(M)])
    frame = np.array([_placed(rng.normal(0.0, 1.0, 6)) for _ in range(M)])
    noise = rng.normal(0.0, [1e-4] * 3 + [3e-4] * 3, (M, N, 6))
    slips = np.array([[_placed(x) for x in row] for row in noise])
    seen = frame[:, None] @ flange @ tool[:, None] @ slips
    return {"q": q, "flange": flange, "seen": seen, "tool": tool}


def _placed(x: Array) -> Array:
    return homogeneous(pin.exp3(x[3:]), x[:3])


def fetched(build: Path, name: str) -> Path:
    """A public recording, fetched once."""
    folder = build / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name if (folder / name).exists() else fetch(name, folder, progress=False)


def links(build: Path) -> Given:
    """200 rows of a UR5 and a laser tracker to fit, 200 others to judge."""
    recording = load_recording(fetched(build, "ur5-grid"))
    order = np.random.default_rng(0).permutation(len(recording))
    train, unseen = np.sort(order[:200]), np.sort(order[200:400])
    some = fit_dh(recording.select(train), DHOptions(loss=Squares()))
    return {
        "dh": rows_table(recording.robot.dh or ()),
        "tool": recording.tool_offset,
        "frame": some.nominal_statement.frame_at(some.nominal_x),
        "q": recording.q[train],
        "tips": recording.measured[train, :3],
        "q_new": recording.q[unseen],
        "tips_new": recording.measured[unseen, :3],
    }


def efforts(build: Path) -> Given:
    """A UR10 along an exciting trajectory; the last 40 % of the time judges."""
    r = load_recording(fetched(build, "ur10-exciting"))
    held = np.zeros(len(r), bool) if r.held_out is None else r.held_out.astype(bool)
    model, urdf = pin.Model(r.chain.model), r.robot.urdf or ""
    bodies = _without_shapes(urdf)
    given: dict[str, Array | str] = {"urdf": bodies, "gravity": r.robot.gravity}
    if r.velocity is None or r.acceleration is None:
        raise PlumblineError(f"{r.name}: efforts alone, velocities and accelerations expected")
    data = model.createData()
    rows = zip(r.q, r.velocity, r.acceleration, strict=True)
    rigid = np.array([pin.rnea(model, data, q, v, a) for q, v, a in rows])
    columns = {"q": r.q, "v": r.velocity, "a": r.acceleration, "tau": r.measured, "rigid": rigid}
    for end, rows_ in (("", ~held), ("_new", held)):
        given |= {f"{name}{end}": values[rows_] for name, values in columns.items()}
    return given


def _without_shapes(urdf: str) -> str:
    """A URDF without meshes, which not every environment finds."""
    root = ElementTree.fromstring(urdf)
    for link in root.iter("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                link.remove(shape)
    return ElementTree.tostring(root, encoding="unicode")


def commands(build: Path) -> Given:
    """An SO-101 told sums of sines; windows of the last 40 % of the time judge."""
    recording = load_motion(fetched(build, "so101-multisine"))
    s = signals_of(recording)
    cut = s.starts[len(s.starts) * 3 // 5]
    fit = s.starts[s.starts + s.length < cut]
    whole = {"length": s.length, "settle": s.settle, "dt": s.dt}
    return {
        "u": s.command[:, :5],
        "q": s.q[:, :5],
        "fit": fit,
        "judge": s.starts[s.starts >= cut],
        "start": np.array([0.0, 0.04, 0.03]),
        **{key: np.array(value) for key, value in whole.items()},
    }


def nothing(_: Path) -> Given:
    """No data of its own: a course is driven where it is solved."""
    return {"none": np.zeros(1)}


OURS = "plumbline"
TOLD = table("plumbline.experiments.compare", "contests.toml")


def ways(**notes: str) -> tuple[Way, ...]:
    """Ours and each peer's: a peer's module ends with the first word of its name."""
    peers = {name.partition(".")[0].lower(): name for name in (*TOLD["needs"], "HPIPM")}
    return tuple(
        Way(OURS, "ours", note=note)
        if key == "ours"
        else Way(peers[key], f"with_{key}", tuple(TOLD["needs"].get(peers[key], ())), note)
        for key, note in notes.items()
    )


GIVEN = {make.__name__: make for make in (phantoms, poses, links, efforts, commands, nothing)}
CONTESTS = tuple(
    Contest(**told | {"given": GIVEN[told["given"]], "ways": ways(**told["ways"])})
    for told in TOLD["contest"]
)
