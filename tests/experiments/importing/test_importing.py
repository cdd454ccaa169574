"""A laboratory's files become a recording: read as written, shown first, not guessed."""

from __future__ import annotations

import json
import re
import shutil
import sys

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from plumbline import load
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.importing import files, joining, mapping, text, units
from plumbline.experiments.importing.understood import Request, understand
from plumbline.kinematics.robot import Robot, makers_joints
from tests.experiments.commands.test_command_line import contents
from tests.made_up_diagnosis import BENCH
from tests.random_trees import Tree
from tests.refusals import refused

TOOL = "-0.0324863,-0.0268989,0.2335573"
DEGREES, JOINTS = 180.0 / np.pi, [f"q{k}" for k in range(1, 7)]


@pytest.fixture
def bench():
    """The bundled recording's rows."""
    return pd.read_csv(BENCH / "samples.csv")


def lab_rows(bench):
    """The same rows as a laboratory writes them: degrees and millimetres under its own names."""
    rows = pd.DataFrame({f"J{k}": bench[f"q{k}"] * DEGREES for k in range(1, 7)})
    return rows.assign(**{f"tip {a}": bench[a] * 1e3 for a in "xyz"})


TIPS = [word for a in "xyz" for word in ("--map", f"{a}=tip {a}:mm")]
MAP = ["--map", "q#=J#:deg", *TIPS, "--robot", "ur5", "--tool", TOOL, "--yes"]


def imported(tmp_path, *words, quiet=True):
    """The recording that an import of words makes."""
    target = tmp_path / "made"
    assert run(["import", *map(str, words), "--to", str(target), *(["-q"] if quiet else [])]) == 0
    return load(target)


def same(made, bench, within=1e-9):
    """Whether a recording has the bundled one's joints and tips."""
    np.testing.assert_allclose(made.q, bench[JOINTS], atol=within)
    np.testing.assert_allclose(made.measured, bench[["x", "y", "z"]], atol=within)


@pytest.mark.parametrize(
    ("mark", "decimal"), [(",", "."), (";", ","), ("\t", "."), (";", "."), (" ", ".")]
)
def test_any_separator_and_decimal_mark_gives_the_same_recording(tmp_path, bench, mark, decimal):
    log = tmp_path / "log.csv"
    lab_rows(bench).to_csv(log, index=False, sep=mark, decimal=decimal)
    same(imported(tmp_path, log, *MAP), bench)
    assert contents(tmp_path / "made").keys() == {"dataset.toml", "samples.csv", "."}


@pytest.mark.parametrize("named", [[], ["--map", "q#=q#"]])
def test_joints_that_count_from_0_are_the_joints_from_1_on(tmp_path, bench, named):
    rows = bench.rename(columns={f"q{k}": f"q{k - 1}" for k in range(1, 7)})
    rows.to_csv(tmp_path / "log.csv", index=False)
    made = imported(tmp_path, tmp_path / "log.csv", *named, "--robot", "ur5", "--yes")
    same(made, bench)


def test_efforts_in_amperes_are_never_taken_for_newton_metres(tmp_path, capsys):
    t = np.arange(200) / 100.0
    arm = tmp_path / "arm.urdf"
    arm.write_text(Tree(3, ("revolute",) * 2).urdf())
    q = np.stack([np.sin(3.0 * t), np.cos(5.0 * t)], axis=1)
    v = np.stack([3.0 * np.cos(3.0 * t), -5.0 * np.sin(5.0 * t)], axis=1)
    a = -q * [9.0, 25.0]
    tau = Robot.from_urdf(arm).dynamics().torques(q, v, a)
    columns = {"time": t, "q1": q[:, 0], "q2": q[:, 1], "velocity1": v[:, 0], "velocity2": v[:, 1]}
    log = pd.DataFrame(columns).assign(i1=1e3 * tau[:, 0] / 0.2, i2=1e3 * tau[:, 1] / 0.1)
    log.to_csv(tmp_path / "log.csv", index=False)
    words = [str(tmp_path / "log.csv"), "--to", str(tmp_path / "made"), "--robot", str(arm), "-qy"]
    said = refused(capsys, "import", *words, "--map", "effort#=i#:mA")
    assert 'effort_unit: found "A" without torque_constant' in said
    said = refused(capsys, "import", *words, "--map", "effort1=i1:mA", "--map", "effort2=i2")
    assert "effort2: not in A, as others are" in said
    lab = tmp_path / "lab.toml"
    lab.write_text("[motion]\ntorque_constant = [0.2, 0.1]\n")
    assert run(["import", *words, "--map", "effort#=i#:mA", "--map", str(lab)]) == 0
    np.testing.assert_allclose(load(tmp_path / "made").measured, tau, atol=1e-9)


@pytest.mark.parametrize("indent", ["", "   "])
def test_files_of_bare_numbers_go_together_row_by_row(tmp_path, bench, indent, capsys):
    """As np.savetxt and MATLAB's -ascii write them: no header, no clock, spaces between."""
    for name, columns in (("arm", JOINTS), ("tips", ["x", "y", "z"])):
        np.savetxt(tmp_path / f"{name}.txt", bench[columns], fmt=f"{indent}%.9e")
    files = [tmp_path / "tips.txt", tmp_path / "arm.txt"]
    named = [f"{target}=arm@{k}:rad" for k, target in enumerate(JOINTS, start=1)]
    named += [f"{a}=tips@{k}:m" for k, a in enumerate("xyz", start=1)]
    words = [word for name in named for word in ("--map", name)]
    words += ["--robot", "ur5", "--tool", TOOL, "--yes"]
    same(imported(tmp_path, *files, *words), bench)
    np.savetxt(tmp_path / "arm.txt", bench[JOINTS][:-1])
    said = refused(capsys, "import", *files, *words, "--to", tmp_path / "other", "-q")
    assert "expected how far apart in time" in said


def test_numbered_columns_stand_for_joints_but_for_those_that_are_named(tmp_path, bench):
    np.savetxt(tmp_path / "log.txt", bench[[*JOINTS, "x", "y", "z"]], fmt="%.9e")
    tips = [word for k, a in enumerate("xyz", start=7) for word in ("--map", f"{a}={k}:m")]
    words = ["--map", "q#=#:rad", *tips, "--robot", "ur5", "--tool", TOOL, "--yes"]
    same(imported(tmp_path, tmp_path / "log.txt", *words), bench)


@pytest.mark.parametrize(("sign", "mark"), [("# ", " "), ("% ", ","), ("%", ","), ("//", ";")])
def test_names_behind_a_sign_of_remarks_are_names(tmp_path, bench, sign, mark):
    """As np.savetxt writes its ``header``, and ``rostopic echo -p`` (``%time,...``)."""
    columns = [*JOINTS, "x", "y", "z"]
    head = f"# a remark\n{sign}{mark.join(columns)}\n"
    rows = bench[columns].to_csv(index=False, header=False, sep=mark)
    (tmp_path / "log.txt").write_text(head + rows)
    words = ["--robot", "ur5", "--tool", TOOL, "--yes"]
    same(imported(tmp_path, tmp_path / "log.txt", *words), bench)
    (tmp_path / "log.txt").write_text(f"{sign}{mark.join(columns[1:])}\n" + rows)
    assert list(text.read(tmp_path / "log.txt")[0].columns) == [f"{k}" for k in range(1, 10)]


def test_remarks_units_in_a_row_and_units_in_names_are_read(tmp_path, bench):
    log = tmp_path / "log.txt"
    rows = bench[[*JOINTS, "x", "y", "z"]].copy()
    rows[JOINTS] *= DEGREES
    rows[["x", "y", "z"]] /= 0.0254
    head = "# taken on Tuesday\nsep=;\n" + ";".join(rows.columns) + "\n"
    said = ";".join(["deg"] * 6 + ["in"] * 3) + "\n"
    log.write_text(head + said + rows.to_csv(index=False, header=False, sep=";"))
    same(imported(tmp_path, log, "--robot", "ur5", "--tool", TOOL, "--yes"), bench)
    # A last row without its end is named and doubted; with half a number it is refused.
    whole, last = log.read_text(), len(bench) + 4
    log.write_text(whole[:-1])
    assert f"row {last}: no line end; was it cut short within" in text.read(log)[0].notes[0]
    log.write_text(whole[: whole.rindex(".") + 3])
    with pytest.raises(PlumblineError, match=f"row {last}: found '.*' and no line end, where"):
        text.read(log)
    shutil.rmtree(tmp_path / "made")
    named = rows.rename(columns={c: f"{c} [{'deg' if c in JOINTS else 'in'}]" for c in rows})
    named.to_csv(log, index=False)
    same(imported(tmp_path, log, "--robot", "ur5", "--tool", TOOL, "--yes"), bench)


def test_a_file_of_the_map_says_what_options_say(tmp_path, bench):
    lab_rows(bench).to_parquet(tmp_path / "log.parquet")
    (tmp_path / "map.toml").write_text(
        'units = ["mm", "deg"]\nname = "lab"\nnoise_std = 1e-4\n'
        '[columns]\n"q#" = "J#"\nx = "tip x"\ny = "tip y"\nz = "tip z"\n'
        f'[robot]\nbundled = "ur5"\n[tool]\noffset = [{TOOL}]\n'
    )
    made = imported(tmp_path, tmp_path / "log.parquet", "--map", tmp_path / "map.toml", "--yes")
    same(made, bench)
    assert (made.name, made.noise_std) == ("lab", 1e-4)


def test_a_robot_that_the_map_names_in_vain_is_told_by_its_place(tmp_path, bench, capsys):
    """Beside the map, whose table named it; of an option that was not used no word is said."""
    log, table = tmp_path / "log.csv", tmp_path / "map.toml"
    lab_rows(bench).to_csv(log, index=False)
    table.write_text('[robot]\nurdf = "arms/mine.urdf"\n')
    said = refused(capsys, "import", log, "--to", tmp_path / "made", "--map", table, "-q")
    assert f"map.toml: [robot]: {tmp_path / 'arms/mine.urdf'}: found no such file" in said
    assert "--robot" not in said


def test_a_matlab_file_lies_along_time_whichever_way_it_was_stored(tmp_path, bench):
    q, tips = bench[JOINTS].to_numpy(), bench[["x", "y", "z"]].to_numpy()
    savemat(tmp_path / "log.mat", {"rec": {"pos": q.T, "tip": tips, "gain": 3.0}, "n": "words"})
    words = ["--map", "q#=rec.pos.#", *(f"--map={a}=rec.tip.{k}" for k, a in enumerate("xyz", 1))]
    same(imported(tmp_path, tmp_path / "log.mat", *words, "--robot", "ur5", "--yes"), bench)


def test_a_lerobot_data_set_has_its_names_episodes_and_clock(tmp_path):
    folder = tmp_path / "so100"
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    info = {"features": {"observation.state": {"names": ["pan.pos", "lift.pos"]}}}
    (folder / "meta/info.json").write_text(json.dumps(info))
    rows = {"observation.state": [[1.0, 2.0], [3.0, 4.0]], "action": [[5.0, 6.0], [7.0, 8.0]],
            "timestamp": [0.0, 0.1], "episode_index": [4, 4]}  # fmt: skip
    for number in range(2):
        path = folder / f"data/chunk-000/file-00{number}.parquet"
        pd.DataFrame(rows | {"episode_index": [number, number]}).to_parquet(path)
    asked = Request(units=(units.unit("deg"),))
    found = understand(files.read(folder), asked)
    assert found.observation == "motion"
    assert found.sources["q2"].place.endswith("@observation.state.lift.pos")
    np.testing.assert_allclose(found.samples["u2"] * DEGREES, [6, 8, 6, 8])
    assert list(found.samples["group"]) == [0, 0, 1, 1]


def test_a_matlab_file_of_version_7_3_is_read_where_h5py_is(tmp_path, bench, monkeypatch, capsys):
    h5py = pytest.importorskip("h5py")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    source = tmp_path / "log.mat"
    with h5py.File(source, "w", userblock_size=512) as file:  # which stores columns first
        file["rec/pos"] = bench[JOINTS].to_numpy().T
        file["rec/tip"] = bench[["x", "y", "z"]].to_numpy().T
        file["who"] = np.array([[65], [66]], np.uint16)
        file["who"].attrs["MATLAB_class"] = b"char"
        file["#refs#/a"] = np.zeros((5, 90))
        file["else"] = h5py.ExternalLink("/etc/hostname", "/")
    with source.open("r+b") as raw:
        raw.write(head)
    words = ["--map", "q#=rec.pos.#", *(f"--map={a}=rec.tip.{k}" for k, a in enumerate("xyz", 1))]
    same(imported(tmp_path, source, *words, "--robot", "ur5", "--yes"), bench)
    (table,) = files.read(source)
    assert {name.partition(".")[0] for name in table.columns} == {"rec"}
    cut = tmp_path / "cut.mat"
    cut.write_bytes(source.read_bytes()[:3000])
    said = refused(capsys, "import", cut, "--to", tmp_path / "other", "-q")
    assert "save it again in MATLAB" in said
    monkeypatch.setitem(sys.modules, "h5py", None)
    said = refused(capsys, "import", source, "--to", tmp_path / "other", "-q")
    assert "pip install h5py" in said


def lerobot(folder, robot_type, parts, n=60):
    """A data set as LeRobot v3 writes it: lists of fixed length, pictures, tasks apart."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    k = np.arange(n)
    table = {
        name: pa.FixedSizeListArray.from_arrays(
            pa.array(np.add.outer(k * 1e-3, np.arange(len(names))).astype("f4").ravel()), len(names)
        )
        for name, names in parts.items()
    }
    table |= {"timestamp": pa.array((k / 30).astype("f4")), "episode_index": pa.array(k * 0),
              "observation.images.top": pa.array([{"bytes": b"", "path": ""}] * n)}  # fmt: skip
    pq.write_table(pa.table(table), folder / "data/chunk-000/file-000.parquet")
    features = {name: {"dtype": "float32", "names": {"axes": names}}
                for name, names in parts.items()}  # fmt: skip
    info = {"codebase_version": "v3.0", "robot_type": robot_type, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder


def test_a_lerobot_data_set_says_its_robot_and_its_joints_are_what_both_have(tmp_path):
    joints = [f"{name}.pos" for name in sorted(makers_joints("ur5"))]
    parts = {"action": [*joints, "gripper.pos"], "observation.state": [*joints, "gripper.pos"]}
    source = lerobot(tmp_path / "arm", "UR5_follower", parts)
    made = imported(tmp_path, source, "--yes")
    assert (made.robot.name, made.q.shape) == ("ur5", (60, 6))
    by_alphabet = [sorted(makers_joints("ur5")).index(name) for name in makers_joints("ur5")]
    np.testing.assert_allclose(made.q[0], by_alphabet, atol=1e-6)
    (raw,) = files.read(source)
    assert not any("images" in column for column in raw.columns)
    assert "--unit deg" in raw.notes[0]
    shutil.rmtree(tmp_path / "made")
    named = {"action": ["joint_0", "gripper"], "observation.state": ["joint_0", "gripper"]}
    ee = {"action": ["x", "y"], "observation.state": ["x", "y"]}
    both = {f"{name}.joint_position": ["joint_0"] for name in named} | named | ee
    (raw,) = files.read(lerobot(tmp_path / "droid", "Franka", both))
    assert {c for c, role in raw.roles.items() if role in ("q1", "u1")} == {
        "action.joint_position.joint_0", "observation.state.joint_position.joint_0"}  # fmt: skip
    assert not {"u2", "q2"} & set(raw.roles.values())


def test_a_lerobot_data_set_of_an_unknown_robot_or_of_poses_is_refused_in_a_line(tmp_path, capsys):
    joints = {"action": ["j1", "j2"], "observation.state": ["j1", "j2"]}
    to = ("--to", tmp_path / "made", "--yes", "-q")
    said = refused(capsys, "import", lerobot(tmp_path / "a", "ur5e", joints), *to)
    assert "its robot 'ur5e' is none known here" in said
    assert "say which: --robot NAME, or a file" in said
    said = refused(capsys, "import", lerobot(tmp_path / "b", None, joints), *to)
    assert "or say --robot ur5, or --robot arm.urdf" in said
    ee = {"action": ["x", "ry"], "observation.state": ["x", "ry"]}
    said = refused(capsys, "import", lerobot(tmp_path / "c", None, ee), *to, "--robot", "ur5")
    assert "or, of commands, u1..; map one" in said


def write_bag(path, bench, joints):
    """A ROS 2 bag of joints at 100 Hz and tips at 10 Hz, the joints in the alphabet's order."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    header, stamp = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    order = np.argsort(joints)
    names = [joints[k] for k in order]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states, tips = (
            writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ("/joint_states", "sensor_msgs/msg/JointState"),
                ("/tracker", "geometry_msgs/msg/PointStamped"),
            )
        )
        for k, row in enumerate(bench.itertuples()):
            q = np.array([row.q1, row.q2, row.q3, row.q4, row.q5, row.q6])[order]
            for late in (0, 30_000_000):
                moment = stamp(sec=1_700_000_000 + k, nanosec=late)
                message = kinds["sensor_msgs/msg/JointState"](
                    header=header(stamp=moment, frame_id=""), name=names,
                    position=q + (late > 0), velocity=np.array([]), effort=np.array([]),
                )  # fmt: skip
                writer.write(
                    states, k * 10**9 + late, store.serialize_cdr(message, message.__msgtype__)
                )
            point = kinds["geometry_msgs/msg/Point"](x=row.x, y=row.y, z=row.z)
            moment = stamp(sec=1_700_000_000 + k, nanosec=2_000_000)
            message = kinds["geometry_msgs/msg/PointStamped"](
                header=header(stamp=moment, frame_id="tracker"), point=point
            )
            writer.write(tips, k * 10**9, store.serialize_cdr(message, message.__msgtype__))


def test_a_bag_is_joined_by_the_clock_and_by_names_of_joints(tmp_path, bench, capsys):
    pytest.importorskip("rosbags")
    makers = makers_joints("ur5")
    assert makers[0] == "shoulder_pan_joint"
    write_bag(tmp_path / "run", bench, makers)
    asked = Request(joints=makers, gap=0.005)
    found = understand(files.read(tmp_path / "run"), asked)
    assert found.observation == "tip_position"
    np.testing.assert_allclose(found.samples[JOINTS], bench[JOINTS])
    np.testing.assert_allclose(found.samples["time"], np.arange(len(bench)), atol=1e-6)
    with pytest.raises(PlumblineError, match=r"say --gap 0\.01"):
        understand(files.read(tmp_path / "run"), Request(joints=asked.joints))
    words = ["import", str(tmp_path / "run"), "--to", str(tmp_path / "made"), "--gap", "0.005",
             "--robot", "ur5", "--yes"]  # fmt: skip
    assert run(words) == 0
    same(load(tmp_path / "made"), bench)
    assert "not used" not in capsys.readouterr().out  # of a message, its fields alone


def test_two_files_meet_at_the_nearest_moment_and_others_are_counted(tmp_path, bench, capsys):
    tips = lab_rows(bench)[["tip x", "tip y", "tip z"]].assign(t=np.arange(90.0) * 1e3)
    tips = tips.rename(columns=lambda name: name.replace("tip ", "p"))  # p is a marker's, too
    joints = lab_rows(bench)[[f"J{k}" for k in range(1, 7)]].assign(stamp=np.arange(90.0) + 5.001)
    tips.to_csv(tmp_path / "tips.csv", index=False)
    joints.iloc[3:].to_csv(tmp_path / "arm.csv", index=False)
    own = [word.replace("=tip ", "=p") for word in MAP]
    words = [tmp_path / "tips.csv", tmp_path / "arm.csv", *own, "--map", "time=tips@t:ms"]
    made = imported(tmp_path, *words, "--gap", "0.01", "--shift", "arm=-5", quiet=False)
    said = capsys.readouterr().out
    assert "3 of 90 rows have no partner in arm.csv within the gap" in said
    assert "3 rows left out" in said
    same(made, bench.iloc[3:])
    assert "not used" not in said  # what a map has taken is no second column
    away = refused(capsys, "import", *words, "--to", tmp_path / "other", "--gap", "0.01", "-q",
                   "--shift", "arm=500")  # fmt: skip
    assert "no row within 0.01 s" in away
    assert "clock runs 0 to 89 s and this one 508.001 to 594.001 s" in away


def test_a_row_that_lacks_a_reading_is_told_by_its_line_in_the_file(tmp_path, bench, capsys):
    log = tmp_path / "log.csv"
    lab_rows(bench).to_csv(log, index=False)
    head, *lines = log.read_text().splitlines()
    lines[5] = "," + lines[5].split(",", 1)[1]
    log.write_text("\n".join(["# a remark", head, *lines]) + "\n")
    imported(tmp_path, log, *MAP, quiet=False)
    assert "1 of 90 rows lack a reading, row 8 the first" in capsys.readouterr().out


def test_directions_and_velocities_come_from_the_path(tmp_path, bench):
    rows = lab_rows(bench).assign(time=np.arange(90) * 2.0)
    rows.to_csv(tmp_path / "log.csv", index=False)
    made = imported(tmp_path, tmp_path / "log.csv", *MAP, "--derive", "velocity,direction")
    steps = np.sign(np.diff(made.q[:, 0]))
    moved = np.abs(np.diff(made.q[:, 0])) > joining.STILL
    assert (made.direction[1:, 0][moved] == steps[moved]).all()
    np.testing.assert_allclose(made.velocity[5], (made.q[6] - made.q[4]) / 4.0)


def test_rotation_vectors_and_euler_angles_become_quaternions(tmp_path):
    angles = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 3))
    for rotation, turned in (
        ("rotvec", Rotation.from_rotvec(angles)),
        ("ZYX", Rotation.from_euler("ZYX", angles)),
    ):
        rows = pd.DataFrame(angles * DEGREES, columns=["rx", "ry", "rz"])
        rows.assign(q1=0.0, x=0.0, y=0.0, z=0.0).to_csv(tmp_path / "a.csv", index=False)
        asked = Request(rotation=rotation, units=(units.unit("deg"),))
        found = understand(files.read(tmp_path / "a.csv"), asked)
        assert found.observation == "pose"
        made = Rotation.from_quat(found.samples[["qx", "qy", "qz", "qw"]].to_numpy())
        assert (made.inv() * turned).magnitude().max() < 1e-9


def test_rows_are_shown_as_understood_and_nothing_is_written_unasked(tmp_path, bench, capsys):
    log, target = tmp_path / "log.csv", tmp_path / "made"
    lab_rows(bench).to_csv(log, index=False)
    words = ["import", str(log), "--to", str(target), *MAP[:-1]]
    assert run(words) == 2
    out, err = capsys.readouterr()
    assert "deg -> rad" in out
    assert f"{bench['q1'][0]:.7g}" in out
    assert err.strip().endswith("nothing was written; say --yes to write what was shown")
    assert not target.exists()
    assert run([*words, "--yes"]) == 0
    assert f"next: plumbline diagnose {target}" in capsys.readouterr().out
    assert "exists and is not empty" in refused(capsys, *words, "--yes")


def test_json_says_where_each_column_is_from(tmp_path, bench, capsys):
    log = tmp_path / "log.csv"
    lab_rows(bench).to_csv(log, index=False)
    words = ["import", str(log), "--to", str(tmp_path / "made"), *MAP, "--json", "-"]
    assert run(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["columns"]["q1"] == {"from": "log.csv@J1", "unit": "deg"}
    assert found["rows"] == 90


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--map", "q#=K#:deg"], "no column like 'K#'; name them one by one; best matches: J"),
        (["--map", "q#=J#:grad"], "unit 'grad' not recognised. Best matches are "),
        (["--map", "x=tip x:furlong"], "unit 'furlong' not recognised"),
        (["--map", "q#=J:deg"], "expected # in 'J', for the number of a column; best matches: J"),
        (["--map", "qq=J1"], "column 'qq' not recognised. Best matches are q"),
        (["--map", "x=tip q:mm"], "no such column among 9; nearest: tip "),
        (["--map", "x=tip x:kg"], "x: unit kg is of mass, expected one of m, mm"),
        (["--unit", "parsec"], "unit 'parsec' not recognised"),
        (["--tool", "1,2"], "--tool '1,2': expected three numbers and a unit"),
        (["--derive", "force"], "--derive force: expected one of velocity, direction"),
        (["--derive", "velocity"], "no clock; say --map time=COLUMN:s"),
        (["--robot", "ur55"], "--robot: "),
        (["--kind", "tips"], "as understood, it is no recording: dataset.toml, row 2"),
        (["--map", "x=tip x:m"], "as understood, it is no recording: "),
        (["--shift", "log"], "--shift log: expected NAME=SECONDS"),
    ],
)
def test_what_cannot_be_understood_is_refused_in_one_line(tmp_path, bench, capsys, words, said):
    log = tmp_path / "log.csv"
    lab_rows(bench).to_csv(log, index=False)
    last = [*MAP, *words] if words[0] != "--map" else [*words, *MAP]
    if words == ["--map", "x=tip x:m"]:
        last = [*words, *(w.replace(":mm", "") for w in MAP)]
    if words[1].startswith("x="):
        last = [w for k, w in enumerate(last) if "x=tip x:mm" not in last[k : k + 2]]
    assert said in refused(capsys, "import", log, "--to", tmp_path / "made", *last, "-q")
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b"", "no rows below the header"),
        ("a.csv", b"x,y\n1,2\n", "no table of two rows or more"),
        ("a.csv", b"x,y\n\x00,2\n", "a zero byte"),
        ("a.csv", b"q1,x,y,z\n1,2,3,4\n1,abc,3,4\n", "a.csv, row 3, column 'x': found 'abc'"),
        ("a.csv", b"q1,x,y,z\n1,2,3,4\n1,1.2.3,3,4\n", "row 3, column 'x': found '1.2.3'"),
        (
            "a.csv",
            b"q1,x\n1,2\n1,2,3,4\n",
            "a.csv, row 3: found 4 cells, expected 2 as in the first row",
        ),
        ("a.csv", b"a,b\n1,2\n3,4\n", "none of 2 columns is called as a recording's"),
        ("a.csv", b"q1,b\n1,2\n3,4\n", "nothing measured among them"),
        ("a.csv", b"q1,x,y,z\n1,,3,4\n1,,3,4\n", "column x: no reading in any row"),
        ("a.mat", b"not one", "no MATLAB file"),
        ("a.parquet", b"not one", "no Parquet"),
        ("a.db3", b"not one", "no bag that can be read"),
        ("a.mcap", b"not one", "no bag that can be read"),
        ("a.xlsx", b"PK", "ending '.xlsx', expected one of .csv"),
    ],
)
def test_a_file_that_is_none_is_refused_in_one_line(tmp_path, capsys, name, content, said):
    (tmp_path / name).write_bytes(content)
    message = refused(capsys, "import", tmp_path / name, "--to", tmp_path / "made", "--yes", "-q")
    assert said in message


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "odd.csv"
    path.write_bytes(data)
    said = ""
    try:
        (raw,) = text.read(path)
        for column in raw.columns:
            assert len(raw.numbers(column)) == len(raw)
    except PlumblineError as error:
        said = str(error)
    assert "\n" not in said


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30),
    st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ","), ("|", ".")]),
)
def test_numbers_survive_every_way_of_writing_them(tmp_path_factory, values, marks):
    path = tmp_path_factory.getbasetemp() / "written.csv"
    frame = pd.DataFrame({"a": values, "b": values[::-1]})
    frame.to_csv(path, index=False, sep=marks[0], decimal=marks[1])
    (raw,) = text.read(path)
    np.testing.assert_array_equal(raw.numbers("a"), values)
    np.testing.assert_array_equal(raw.numbers("b"), values[::-1])


@settings(max_examples=60, deadline=None)
@given(
    arrays(float, st.integers(1, 40), elements=st.floats(0, 100)),
    arrays(float, st.integers(1, 40), elements=st.floats(0, 100) | st.just(np.nan)),
    st.floats(0, 10),
)
def test_a_partner_is_the_nearest_there_is_and_within_the_gap(moments, others, gap):
    found = joining.partners(moments, others, gap)
    apart = np.abs(moments[:, None] - others[None, :])
    nearest = np.where(np.isnan(apart), np.inf, apart).min(axis=1)
    has = found != joining.NOBODY
    assert (nearest[~has] > gap).all()
    np.testing.assert_array_equal(apart[has, found[has]], nearest[has])


@settings(max_examples=40, deadline=None)
@given(arrays(float, st.integers(2, 60), elements=st.floats(-0.4, 0.4)), st.booleans())
def test_noise_below_the_stated_motion_turns_no_side(noise, rising):
    still = 1e-3
    path = np.arange(len(noise)) * (1.0 if rising else -1.0) * 0.1
    side = joining.directions((path + noise * still)[:, None], np.zeros(len(path), np.int64), still)
    assert (side[1:] == (1 if rising else -1)).all()
    rest = joining.directions((0.5 * noise * still)[:, None], np.zeros(len(path), np.int64), still)
    assert (rest == 0).all()


def test_derivatives_are_exact_on_parabolas_and_never_cross_a_group():
    time = np.array([0.0, 0.1, 0.3, 0.35, 5.0, 5.2, 5.3])
    group = np.array([0, 0, 0, 0, 1, 1, 1])
    q = (time**2)[:, None] + 100.0 * group[:, None]
    np.testing.assert_allclose(joining.velocities(q, time, group)[:, 0], 2.0 * time, atol=1e-9)
    with pytest.raises(PlumblineError, match=r"time 0\.3 s in row 4 is not after"):
        joining.velocities(q, np.array([0.0, 0.1, 0.3, 0.3, 5.0, 5.2, 5.3]), group)


def test_each_unit_is_what_its_definition_says():
    si = {"mm": 1e-3, "in": 0.0254, "deg": np.pi / 180, "lb": 0.45359237, "rpm": 2 * np.pi / 60}
    assert {name: units.unit(name).factor for name in si} == pytest.approx(si, rel=1e-12)
    assert units.unit("lbf").factor == pytest.approx(4.4482216152605, rel=1e-12)
    for name, value in (("K", 293.15), ("degF", 68.0), ("degC", 20.0)):
        unit = units.unit(name)
        assert value * unit.factor + unit.offset == pytest.approx(20.0)
    assert all(unit.dimension in units.SI for unit in units.UNITS.values())
    assert all(units.known(word) is not None for word in units.SPELT)


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [("x [mm]", "x", "mm"), ("J1 (deg)", "J1", "deg"), ("x_mm", "x", "mm"), ("ct_x", "ct_x", None),
     ("a [left]", "a [left]", None), ("T [°C]", "T", "degC"), ("q[1]", "q[1]", None),
     ("qw [1]", "qw", "1")],
)  # fmt: skip
def test_a_header_says_its_unit_or_none(header, name, unit):
    found, said = units.of_header(header)
    assert (found, said and said.name) == (name, unit)


def test_a_sign_and_a_unit_are_part_of_a_map_and_colons_part_of_a_name():
    want = mapping.parse("q2=-J2:deg")
    assert (want.target, want.source, want.sign) == ("q2", "J2", -1.0)
    assert want.unit is units.unit("deg")
    assert mapping.parse("x=a:b").source == "a:b"


def test_a_joint_has_turned_back_once_it_came_back_by_a_milliradian():
    for back, side in ((0.9e-3, 1), (1.1e-3, -1)):
        path = np.array([[0.0], [0.1], [0.1 - back]])
        assert joining.directions(path, np.zeros(3, np.int64))[-1, 0] == side


def matrices(rows: int = 5):
    """Rotations, places [m] and the 4 x 4 matrices that they make."""
    rng = np.random.default_rng(1)
    T = np.tile(np.eye(4), (rows, 1, 1))
    turns = Rotation.from_rotvec(rng.uniform(-2.0, 2.0, (rows, 3)))
    T[:, :3, :3], T[:, :3, 3] = turns.as_matrix(), rng.uniform(-1.0, 1.0, (rows, 3))
    return turns, T


def written_out(T, folder, decimals: int = 12):
    """Matrices (N, r, c) as a log has them, one a line, and the map of its columns."""
    numbers = T.reshape(len(T), -1)
    names = [f"O_T_EE[{k}]" for k in range(numbers.shape[1])]
    rows = pd.DataFrame(numbers.round(decimals), columns=names).assign(q1=0.0)
    rows.to_csv(folder / "m.csv", index=False)
    return files.read(folder / "m.csv")


@pytest.mark.parametrize("unit", ["m", "mm"])
@pytest.mark.parametrize("last", [slice(3), slice(4)], ids=["12", "16"])
@pytest.mark.parametrize("columns_first", [False, True])
def test_matrices_of_either_order_and_unit_become_places_and_quaternions(
    tmp_path, unit, last, columns_first
):
    turns, T = matrices()
    lab = T.copy()
    lab[:, :3, 3] *= 1e3 if unit == "mm" else 1.0
    lab = lab[:, last].transpose(0, 2, 1) if columns_first else lab[:, last]
    line = mapping.parse(f"pose#=O_T_EE[#]:{unit}")
    found = understand(written_out(lab, tmp_path), Request((line,)))
    assert found.observation == "pose"
    np.testing.assert_allclose(found.samples[["x", "y", "z"]], T[:, :3, 3], atol=1e-9)
    made = Rotation.from_quat(found.samples[["qx", "qy", "qz", "qw"]].to_numpy())
    assert (made.inv() * turns).magnitude().max() < 1e-9


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda T: T * 1.002, "away from a rigid 4 x 4 matrix"),
        (lambda T: T * [-1.0, 1.0, 1.0, 1.0], "away from a rigid 4 x 4 matrix"),
        (lambda T: T * [1.0, 1.0, 1.0, 0.0] + np.diag([0, 0, 0, 1]), "of one order"),
        (lambda T: T[:, :2], "expected pose1.. to 12 or to 16"),
    ],
    ids=["scaled", "mirrored", "told in no order", "half"],
)
def test_matrices_that_are_no_poses_are_refused(tmp_path, wrong, words):
    raws = written_out(wrong(matrices()[1]), tmp_path)
    with pytest.raises(PlumblineError, match=re.escape(words)):
        understand(raws, Request((mapping.parse("pose#=O_T_EE[#]"),)))


def test_matrices_of_four_decimals_are_rigid_enough(tmp_path):
    turns, T = matrices(200)
    raws = written_out(T, tmp_path, decimals=4)
    found = understand(raws, Request((mapping.parse("pose#=O_T_EE[#]"),)))
    made = Rotation.from_quat(found.samples[["qx", "qy", "qz", "qw"]].to_numpy())
    assert (made.inv() * turns).magnitude().max() < 2e-4


@pytest.mark.parametrize("name", ["q[{}]", "q_{}", "q({})", "Q_{}"])
@pytest.mark.parametrize("first", [0, 1])
def test_an_index_in_brackets_or_behind_a_line_is_a_joints_number_and_no_unit(
    tmp_path, bench, name, first
):
    rows = bench.rename(columns={f"q{k}": name.format(k - 1 + first) for k in range(1, 7)})
    rows.to_csv(tmp_path / "log.csv", index=False)
    same(imported(tmp_path, tmp_path / "log.csv", "--robot", "ur5", "--tool", TOOL, "--yes"), bench)
    by_map = ["--map", f"q#={name.format('#')}", "--robot", "ur5", "--tool", TOOL, "--yes"]
    shutil.rmtree(tmp_path / "made")
    same(imported(tmp_path, tmp_path / "log.csv", *by_map), bench)
