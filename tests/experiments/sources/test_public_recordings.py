"""Public recordings are read with the right units, signs, frames and joints.

The real files are read, where the environment variable `PLUMBLINE_DATA` names a folder that holds
them. Each loader is held to figures that a wrong unit, sign, frame or joint would spoil: the 3-D
RMS left by the nominal chain after the best rigid frame and tool, or about the best sockets.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest

from plumbline.experiments.sources import fetch, list_sources

SOURCES = {source.name: source for source in list_sources()}
DATA = os.environ.get("PLUMBLINE_DATA")
pytestmark = pytest.mark.skipif(
    not DATA, reason="PLUMBLINE_DATA does not name a folder with the public recordings"
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All public recordings, written once."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in SOURCES:
        fetch(name, folder)
    return folder


def _read(folder: Path) -> tuple[dict[str, Any], pd.DataFrame]:
    dataset = tomllib.loads((folder / "dataset.toml").read_text(encoding="utf-8"))
    return dataset, pd.read_csv(folder / "samples.csv")


def _joints(samples: pd.DataFrame) -> np.ndarray:
    return samples.filter(regex=r"^q\d+$").to_numpy()


@pytest.mark.parametrize("name", SOURCES)
def test_no_row_is_lost_and_no_cell_is_empty_but_the_stated_ones(
    recordings: Path, name: str
) -> None:
    dataset, samples = _read(recordings / name)
    assert dataset["name"] == name
    assert len(samples) == SOURCES[name].rows
    empty = set(samples.columns[samples.isna().any()])
    assert empty == ({"m4", "m5", "m6"} if name.startswith("kr300") else set())


def test_a_fetch_does_not_change_the_cache(recordings: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in Path(str(DATA)).rglob("*")}
    fetch("ur5-random", tmp_path)
    assert {path: path.stat().st_mtime_ns for path in Path(str(DATA)).rglob("*")} == before


def test_a_fetch_gives_the_same_bytes_again(recordings: Path, tmp_path: Path) -> None:
    again = fetch("panda-1", tmp_path)
    for path in (recordings / "panda-1").iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes()


Rows = tuple[tuple[float, float, float], ...]

# Standard Denavit-Hartenberg rows (d [m], a [m], alpha [deg]), from Universal Robots' own tables.
UR10: Rows = (
    (0.1273, 0.0, 90.0),
    (0.0, -0.612, 0.0),
    (0.0, -0.5723, 0.0),
    (0.163941, 0.0, 90.0),
    (0.1157, 0.0, -90.0),
    (0.0922, 0.0, 0.0),
)
UR5: Rows = (
    (0.089159, 0.0, 90.0),
    (0.0, -0.425, 0.0),
    (0.0, -0.39225, 0.0),
    (0.10915, 0.0, 90.0),
    (0.09465, 0.0, -90.0),
    (0.0823, 0.0, 0.0),
)


def _flange(rows: Rows, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (N, 3, 3) and place (N, 3) [m] of the flange in the base."""
    pose = np.tile(np.eye(4), (len(joints), 1, 1))
    for (d, a, alpha), angle in zip(rows, joints.T, strict=True):
        cos, sin = np.cos(angle), np.sin(angle)
        c, s = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        zero, one = np.zeros_like(angle), np.ones_like(angle)
        step = [
            [cos, -sin * c, sin * s, a * cos],
            [sin, cos * c, -cos * s, a * sin],
            [zero, s * one, c * one, d * one],
            [zero, zero, zero, one],
        ]
        pose = pose @ np.moveaxis(np.array(step), 2, 0)
    return pose[:, :3, :3], pose[:, :3, 3]


def _rigid(moved: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation that bring points onto measured ones best (Kabsch, 1976)."""
    centre, target = moved.mean(0), measured.mean(0)
    u, _, vt = np.linalg.svd((moved - centre).T @ (measured - target))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = vt.T @ flip @ u.T
    return rotation, target - rotation @ centre


def _frame_and_tool(
    flange: tuple[np.ndarray, np.ndarray], tip: np.ndarray, tool: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Best rigid frame and tool, in turns: rotation, translation, tool."""
    turn, place = flange
    for _ in range(40):
        frame, shift = _rigid(place + turn @ tool, tip)
        # With the frame's rotation held, tool and shift are linear.
        matrix = np.concatenate([turn, np.tile(frame.T, (len(tip), 1, 1))], axis=2).reshape(-1, 6)
        unknown = np.linalg.lstsq(matrix, (tip @ frame - place).ravel(), rcond=None)[0]
        tool = unknown[:3]
    frame, shift = _rigid(place + turn @ tool, tip)
    return frame, shift, tool


def _rms_mm(residual: np.ndarray) -> float:
    return 1e3 * float(np.sqrt((residual**2).sum(axis=1).mean()))


def _fit_tip(folder: Path, rows: Rows) -> tuple[float, np.ndarray]:
    """RMS [mm] after the best frame and tool, and the tool [m]."""
    dataset, samples = _read(folder)
    turn, place = _flange(rows, _joints(samples))
    tip = samples[["x", "y", "z"]].to_numpy()
    start = np.array(dataset["tool"]["offset"])
    frame, shift, tool = _frame_and_tool((turn, place), tip, start)
    return _rms_mm(tip - (place + turn @ tool) @ frame.T - shift), tool


@pytest.mark.parametrize(("name", "rms"), [("ur10-grid", 0.838), ("ur10-joints", 1.085)])
def test_the_nominal_ur10_leaves_what_it_left_before(
    recordings: Path, name: str, rms: float
) -> None:
    left, tool = _fit_tip(recordings / name, UR10)
    assert left == pytest.approx(rms, abs=1e-3)
    # The probe sits 16 mm nearer than the nominal 109 mm, in both series alike.
    np.testing.assert_allclose(tool, [0.0, 0.0, 0.0931], atol=6e-4)


def test_the_nominal_ur5_leaves_what_it_left_before(recordings: Path) -> None:
    left, tool = _fit_tip(recordings / "ur5-grid", UR5)
    assert left == pytest.approx(0.702, abs=1e-3)
    np.testing.assert_allclose(tool, [0.0, 0.0, 0.0281], atol=1e-3)


def test_the_nominal_ur5_left_the_same_on_held_out_rows(recordings: Path) -> None:
    dataset, samples = _read(recordings / "ur5-grid")
    turn, place = _flange(UR5, _joints(samples))
    tip = samples[["x", "y", "z"]].to_numpy()
    held = np.random.default_rng(0).permutation(len(tip)) < 200
    fitted = (turn[~held], place[~held])
    frame, shift, tool = _frame_and_tool(fitted, tip[~held], np.array(dataset["tool"]["offset"]))
    left = tip[held] - (place[held] + turn[held] @ tool) @ frame.T - shift
    assert _rms_mm(left) == pytest.approx(0.697, abs=0.05)


@pytest.mark.parametrize(("name", "raw"), [("ur5-grid", 2.66), ("ur5-random", 2.58)])
def test_the_ur5_errors_are_those_of_the_nominal_tool(
    recordings: Path, name: str, raw: float
) -> None:
    dataset, samples = _read(recordings / name)
    turn, place = _flange(UR5, _joints(samples))
    error = samples[["x", "y", "z"]].to_numpy() - place - turn @ np.array(dataset["tool"]["offset"])
    assert _rms_mm(error) == pytest.approx(raw, abs=0.01)


def test_series_a_is_in_order_of_time_and_its_sides_are_of_known_steps(recordings: Path) -> None:
    _, samples = _read(recordings / "ur10-grid")
    step = np.diff(samples["time"])
    assert samples["time"].iloc[0] == 0.0
    assert samples["time"].iloc[-1] / 3600 == pytest.approx(100.8, abs=0.05)
    assert step.min() >= 4.0
    sides = samples.filter(regex=r"^direction\d$").to_numpy()
    assert set(np.unique(sides)) == {-1, 0, 1}
    assert not sides[1:][step > 30.0].any()
    moved = np.diff(_joints(samples), axis=0)
    assert (moved * sides[1:] >= 0.0).all()


def test_series_b_claims_neither_time_nor_side(recordings: Path) -> None:
    _, samples = _read(recordings / "ur10-joints")
    assert list(samples.columns) == [*(f"q{j}" for j in range(1, 7)), *"xyz", "temperature"]


#: Placements of the block and joints of the chain.
BLOCKS = [
    ("panda-1", 3, 7),
    ("panda-1-sensor", 2, 7),
    ("panda-3", 6, 7),
    ("kuka-iiwa14", 3, 7),
    ("dinova-1", 4, 6),
]


def _tip_poses(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (N, 3, 3) and place (N, 3) [m] of the tip frame, by pinocchio, other joints at 0."""
    dataset, samples = _read(folder)
    model = pin.buildModelFromUrdf(str(folder / dataset["robot"]["urdf"]))
    data, tip = model.createData(), model.getFrameId(dataset["robot"]["tip_frame"])
    poses = []
    for joints in _joints(samples):
        pin.framesForwardKinematics(model, data, np.pad(joints, (0, model.nq - len(joints))))
        poses.append(data.oMf[tip].copy())
    return np.array([pose.rotation for pose in poses]), np.array([p.translation for p in poses])


@pytest.mark.parametrize(
    ("name", "rms"),
    [
        ("panda-1", 8.566),
        ("panda-1-sensor", 9.911),
        ("panda-3", 2.835),
        ("kuka-iiwa14", 0.747),
        ("dinova-1", 6.117),
    ],
)
def test_the_nominal_arm_scatters_about_its_sockets_as_before(
    recordings: Path, name: str, rms: float
) -> None:
    turn, place = _tip_poses(recordings / name)
    _, samples = _read(recordings / name)
    socket = samples["socket"].to_numpy()
    member = np.eye(socket.max() + 1)[socket]
    matrix = np.concatenate([turn.reshape(-1, 3), -np.kron(member, np.eye(3))], axis=1)
    unknown = np.linalg.lstsq(matrix, -place.ravel(), rcond=None)[0]
    left = (matrix @ unknown + place.ravel()).reshape(-1, 3)
    assert _rms_mm(left) == pytest.approx(rms, abs=1e-3)
    # The nominal arms see the 50 mm within 3 mm; sockets of different places are far apart.
    points = unknown[3:].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(points[::2] - points[1::2], axis=1), 0.05, atol=3e-3)


@pytest.mark.parametrize(("name", "placements", "joints"), BLOCKS)
def test_sockets_come_in_pairs_and_joints_are_those_of_the_chain(
    recordings: Path, name: str, placements: int, joints: int
) -> None:
    dataset, samples = _read(recordings / name)
    pairs = dataset["sockets"]["pairs"]
    assert pairs == [[2 * k, 2 * k + 1] for k in range(placements)]
    assert dataset["sockets"]["distance"] == 0.05
    assert set(samples["socket"]) == set(range(2 * placements))
    assert (samples["group"] == samples["socket"] // 2).all()
    model = pin.buildModelFromUrdf(str(recordings / name / "robot.urdf"))
    tip = model.frames[model.getFrameId(dataset["robot"]["tip_frame"])]
    assert len(model.supports[tip.parentJoint]) - 1 == joints == _joints(samples).shape[1]
    ball = model.frames[model.getFrameId("ball_link")].placement
    np.testing.assert_allclose(
        (tip.placement.inverse() * ball).translation, dataset["tool"]["offset"], atol=1e-12
    )


def test_the_kr300_link_follows_its_motor(recordings: Path) -> None:
    _, samples = _read(recordings / "kr300")
    gap = samples[["m1", "m2", "m3"]].to_numpy() - samples[["q1", "q2", "q3"]].to_numpy()
    np.testing.assert_allclose(np.degrees(np.ptp(gap, axis=0)), [0.1525, 0.1616, 0.1524], atol=1e-4)
    np.testing.assert_allclose(np.degrees(gap.std(axis=0)), [0.0401, 0.0417, 0.0389], atol=1e-4)


def test_the_kr300_s_second_run_is_another_motion_of_the_same_arm(recordings: Path) -> None:
    (_, a), (_, b) = (_read(recordings / name) for name in ("kr300", "kr300-b"))
    assert np.abs(_joints(a)[0] - _joints(b)[0]).max() < 1e-3  # from the same posture
    assert np.abs(_joints(a)[1250] - _joints(b)[1250]).max() > 0.5
    gap = b[["m1", "m2", "m3"]].to_numpy() - b[["q1", "q2", "q3"]].to_numpy()
    np.testing.assert_allclose(np.degrees(gap.std(axis=0)), [0.0300, 0.0319, 0.0344], atol=1e-4)
    for joint in (1, 2, 3):
        slope = np.polyfit(b[f"velocity{joint}"], gap[:, joint - 1], 1)[0]
        assert slope == pytest.approx(-3.03e-3, abs=1e-4)


def test_the_kr300_velocity_is_the_derivative_of_its_joints(recordings: Path) -> None:
    _, samples = _read(recordings / "kr300")
    slope = np.gradient(_joints(samples), samples["time"], axis=0)
    velocity = samples.filter(regex=r"^velocity\d$").to_numpy()
    # The motor's velocity is filtered: about 1 % of it is not in the differences of 4 ms.
    assert ((slope - velocity).std(axis=0) < 0.02 * velocity.std(axis=0)).all()


def test_the_kr300_link_lags_its_motor_by_three_milliseconds(recordings: Path) -> None:
    _, samples = _read(recordings / "kr300")
    for joint, left in ((1, 67.4), (2, 107.0), (3, 110.2)):
        gap = (samples[f"m{joint}"] - samples[f"q{joint}"]).to_numpy()
        matrix = np.column_stack([samples[f"velocity{joint}"], np.ones(len(samples))])
        (delay, zero) = np.linalg.lstsq(matrix, gap, rcond=None)[0]
        assert delay == pytest.approx(-3.03e-3, abs=6e-5)
        assert 1e6 * (gap - matrix @ [delay, zero]).std() == pytest.approx(left, abs=0.2)


def test_the_kr300_effort_is_on_the_link_side_and_holds_the_wrist_up(recordings: Path) -> None:
    # The source's file gives the weight on joint 5 in the start pose as tau_g_init = -503.09 Nm.
    _, samples = _read(recordings / "kr300")
    assert samples["effort5"].iloc[0] == pytest.approx(-503.09, rel=0.05)


def test_the_kr300_blocks_are_of_one_second(recordings: Path) -> None:
    _, samples = _read(recordings / "kr300")
    assert samples["group"].value_counts().sort_index().tolist() == [250] * 9 + [251]
    assert samples["group"].is_monotonic_increasing


def test_a_recording_needs_nothing_but_its_own_files(recordings: Path, tmp_path: Path) -> None:
    shutil.copytree(recordings / "panda-1", tmp_path / "moved")
    np.testing.assert_array_equal(
        _tip_poses(tmp_path / "moved")[1], _tip_poses(recordings / "panda-1")[1]
    )
