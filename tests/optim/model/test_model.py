"""A model that is taken home predicts, commands, is stored and exported as it was found."""

import csv
import html
import io
import json
import re
from dataclasses import replace

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.experiments.reality.arm import forward
from plumbline.experiments.reality.joint_effects import Backlash, JointCompliance, JointOffset
from plumbline.experiments.reality.scene import built
from plumbline.experiments.reality.session import draw_session
from plumbline.experiments.report.writing import report_html
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.model import Applied, Model, apply
from plumbline.optim.model.apply import Change
from plumbline.optim.model.export.exported import Lack
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.session import same_joints
from tests.few_effects import FEW_EFFECTS
from tests.simulated_cases import faultless, recorded, with_fault

FAULTS = (JointCompliance(0.0, 2), Backlash(0.0, 3), JointOffset(0.0, 4))


@pytest.fixture(scope="module")
def case():
    return with_fault(faultless(rows=120, seed=41), *FAULTS, gap=6.0)


@pytest.fixture(scope="module")
def diagnosis(case, tmp_path_factory):
    return diagnose(recorded(case, tmp_path_factory.mktemp("model"))[0], FEW_EFFECTS)


@pytest.fixture(scope="module")
def model(diagnosis):
    return diagnosis.model()


@pytest.fixture
def stored(model, tmp_path):
    model.save(tmp_path / "arm.toml")
    return tmp_path / "arm.toml"


def context_of(recording):
    names = ("time", "temperature", "payload", "direction", "velocity", "effort")
    return {n: getattr(recording, n) for n in names if getattr(recording, n) is not None}


def unseen(case, rows, seed):
    """Postures of the arm and their sides of approach, drawn anew."""
    session = draw_session(case.arm, rows, np.random.default_rng(seed), tool=case.nominal_tool)
    return session.q, session.direction


def really(case, q, direction):
    """Where the simulator's arm has its tip (N, 3) in its base frame."""
    session = replace(
        case.scene.session,
        q=q,
        direction=direction,
        **{n: np.zeros(len(q)) for n in ("time", "warmth", "ambient", "group")},
        velocity=np.zeros_like(q),
    )
    scene = type(case.scene).ideal(case.scene.arm, session, case.scene.tool[0], np.eye(4))
    pinned = [fault.pinned(case.scene) for fault in case.effects]
    return built(scene, pinned).tip()[1]


def test_a_model_predicts_its_own_recording_to_the_noise(model, diagnosis):
    recording = diagnosis.recording
    tips = model.in_device(recording.q, **context_of(recording))
    left = np.sqrt(((tips - recording.measured) ** 2).sum(axis=1).mean())
    assert left < 1.1 * np.sqrt(3.0) * recording.noise_std


def test_a_compensated_command_takes_away_what_can_be_taken(model, case):
    """One thousand unseen postures of a simulated arm that shares no code with the model."""
    q, direction = unseen(case, 1000, seed=9)
    wanted = forward(case.arm, q)[:, -1]
    goal = wanted[:, :3, 3] + wanted[:, :3, :3] @ model.tool
    missed = [
        np.sqrt(((really(case, command, direction) - goal) ** 2).sum(axis=1).mean())
        for command in (q, model.joint_command(q, direction=direction).q)
    ]
    assert missed[0] > 5e-4
    assert missed[1] < 0.05 * missed[0]


def test_the_uncertainty_covers_what_is_missed(model, case):
    q, direction = unseen(case, 300, seed=10)
    off = model.tip(q, direction=direction) - really(case, q, direction)
    covariance = model.uncertainty(q, direction=direction)
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert 0.1 < square.mean() / 3.0 < 4.0


def test_the_jacobian_is_the_slope_of_the_placement(model):
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 6))
    J = model.jacobian(q)
    for j in range(6):
        step = np.zeros(6)
        step[j] = 1e-6
        ahead, back = model.placement(q + step), model.placement(q - step)
        speed = (ahead[:, :3, 3] - back[:, :3, 3]) / 2e-6
        spin = (ahead - back)[:, :3, :3] / 2e-6 @ model.placement(q)[:, :3, :3].transpose(0, 2, 1)
        np.testing.assert_allclose(J[:, :3, j], speed, atol=1e-8)
        turned = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        np.testing.assert_allclose(J[:, 3:, j], turned, atol=1e-8)


def test_a_command_stays_within_the_joints_limits(model):
    upper = model.chain.upper
    command = model.joint_command(upper - 1e-5)
    assert (command.q <= upper).all()
    with pytest.raises(PlumblineError, match=r"row 1, joint 1: found 7, expected -6\.28"):
        model.joint_command([7.0, 0, 0, 0, 0, 0])


def test_a_pose_and_a_point_are_reached(model):
    q = np.random.default_rng(3).uniform(-1.2, 1.2, (20, 6))
    goal = model.nominal.placement(q)
    for aim in (goal, goal[:, :3, 3]):
        command = model.joint_command_for(aim, direction=np.ones(6))
        assert command.reached.mean() >= 0.95
        tips = model.tip(command.q, direction=np.ones(6))
        np.testing.assert_allclose(tips[command.reached], goal[command.reached, :3, 3], atol=1e-6)


def test_many_ripples_of_a_joint_take_two_sines(model):
    """Whole orders, one of them doubled, are summed at once; a fraction stands by itself."""
    one, gear = REGISTRY["transmission_ripple"], REGISTRY["gear_ripple"]
    ripples = [one(joint=2, order=2, doubled=True)]
    ripples += [gear(joint=2, order=n) for n in (4.0, 31.5, *map(float, range(5, 31)))]
    sizes = np.array([len(e.parameters) for e in ripples])
    values = np.random.default_rng(8).normal(0.0, 1e-4, sizes.sum())
    bare = model.nominal
    covariance = np.pad(bare.covariance, (0, len(values)))
    arm = replace(bare, effects=tuple(ripples), values=values, covariance=covariance)
    q = np.random.default_rng(9).uniform(-3.0, 3.0, (50, 6))
    angles = [k * e.order * q[:, 1] for e in ripples for k in range(1, len(e.parameters) // 2 + 1)]
    pairs = zip(angles, values.reshape(-1, 2), strict=True)
    wanted = sum(a * np.sin(x) + b * np.cos(x) for x, (a, b) in pairs)
    np.testing.assert_allclose(arm.joint_corrections(q)[:, 1], wanted, atol=1e-14)
    links = arm.statement.links
    sines = [links.instruction_id(k) for k in range(links.n_instructions())].count(cs.OP_SIN)
    assert sines == 2


def test_what_is_always_fitted_has_value_error_unit_and_meaning(diagnosis, case):
    found = diagnosis.verdict.nuisances
    assert {"frame x", "frame rz", "tool x"} <= set(found)
    assert diagnosis.verdict.to_dict()["nuisances"]["tool x"]["unit"] == "m"
    assert all(e.std > 0.0 and e.doc for e in found.values())
    for axis, true in zip("xyz", case.scene.device[:3, 3], strict=True):
        one = diagnosis.frame[f"frame {axis}"]
        assert abs(one.value - true) < 5 * one.std
    for axis, true in zip("xyz", case.scene.tool[0], strict=True):
        one = diagnosis.tool[f"tool {axis}"]
        assert abs(one.value - true) < 5 * one.std


def test_a_stored_model_says_the_same(model, stored):
    again = plumbline.load(stored)
    q = np.random.default_rng(5).uniform(-1.0, 1.0, (50, 6))
    context = {"direction": np.ones(6), "payload": 1.5}
    np.testing.assert_array_equal(again.tip(q, **context), model.tip(q, **context))
    np.testing.assert_allclose(again.uncertainty(q), model.uncertainty(q), rtol=1e-6, atol=1e-18)
    assert again.nuisances.keys() == model.nuisances.keys()
    assert repr(again) == repr(model)


def test_nothing_is_overwritten_without_asking(model, stored):
    before = stored.read_bytes()
    with pytest.raises(PlumblineError, match="found a file, expected a new one"):
        model.nominal.save(stored)
    assert stored.read_bytes() == before
    model.nominal.save(stored, overwrite=True)
    assert stored.read_bytes() != before


DAMAGES = [
    (lambda t: t[: len(t) // 2], "row|found"),
    (lambda t: t.replace('"plumbline model"', '"other"'), "expected 'plumbline model'"),
    (lambda t: t.replace("version = 3", "version = 2"), "found 2, expected 3; .*save it again"),
    (lambda t: t.replace('"backlash"', '"backlsh"'), "best matches: backlash"),
    (lambda t: t.replace("joint = 3", "joint = 99"), "element 99, expected 1 to 6"),
    (lambda t: t.replace("joint = 3", "joint = [3]"), "expected int"),
    (lambda t: t.replace("joint = 3", "joint = true"), "expected int"),
    (lambda t: re.sub(r"(\nvalues = .*values = \[)", r"\1nan, ", t), "damaged fields"),
    (lambda t: re.sub(r"(\nvalues = .*values = \[)[^,]*", r"\1nan", t), "found nan, expected"),
    (lambda t: t.replace("\nvalues = ", "\nvaleus = "), "damaged fields"),
    (lambda t: re.sub(r"(R_tip_tool = .*values = \[)", r"\g<1>9", t), "no rotation"),
    (lambda t: re.sub(r"(covariance = .*values = \[)", r"\1-", t), "negative variance"),
    (lambda t: re.sub(r"covariance = .*", "covariance = { shape = [1, 1], values = [1.0] }", t),
     "numbers of shape"),
    (lambda t: t.replace('tip_frame = "flange"', 'tip_frame = "nowhere"', 1), "not recognised"),
    (lambda t: t.replace("d = 0.089159", "d = 1e300"), "DH row"),
    (lambda t: t.replace('observation = "tip', 'observation = "tap'), "expected tip_position"),
    (lambda t: t.replace('recording = "', 'recording = "\\n'), "a short one, on a line"),
    (lambda t: t.replace("[samples]", "[amples]"), "damaged fields"),
    (lambda t: "", "an empty file"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), DAMAGES)
def test_a_damaged_model_is_refused_in_one_line(stored, damage, words):
    damaged = damage(stored.read_text())
    assert damaged != stored.read_text()
    stored.write_text(damaged)
    with pytest.raises(PlumblineError, match=words) as error:
        Model.load(stored)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("kind", ["urdf", "dh", "mjcf"])
def test_an_export_stands_where_the_model_has_it(model, kind):
    made = getattr(model, f"as_{kind}")()
    assert made.error < 1e-9
    missing = {lack.label for lack in made.lacks}
    assert missing == {"joint_compliance 2", "backlash 3"}
    assert 0.0 < made.stays < made.whole
    assert "joint_compliance 2 (" in made.words


def test_a_urdf_is_read_by_pinocchio_to_a_nanometre(model):
    robot = pin.buildModelFromXML(model.as_urdf().text)
    fixed = model.without("joint_compliance", "backlash")
    data, tool = robot.createData(), robot.getFrameId("calibrated_tool")
    for q in np.random.default_rng(6).uniform(-3.0, 3.0, (20, 6)):
        pin.framesForwardKinematics(robot, data, q)
        there = data.oMf[tool].homogeneous
        np.testing.assert_allclose(there, fixed.placement(q)[0], atol=1e-9)


def test_the_urdf_with_the_joints_corrections_is_the_whole_model(model, case):
    q, direction = unseen(case, 30, seed=12)
    corrected = q + model.corrections_beyond_links(q, direction=direction)
    chain = Robot.from_urdf(model.as_urdf().text).chain("calibrated_tool")
    tips = chain.placement(corrected)[:, :3, 3]
    np.testing.assert_allclose(tips, model.tip(q, direction=direction), atol=1e-9)


def test_what_happened_at_one_moment_is_no_geometry(model):
    """A bump of the base late in the session looks constant to whoever asks before it."""
    bump = REGISTRY["base_bump"](moment=float(model.ranges["time"][1, 0]) - 1.0)
    more = len(bump.parameters)
    arm = replace(
        model,
        effects=(*model.effects, bump),
        values=np.append(model.values, np.full(more, 1e-3)),
        covariance=np.pad(model.covariance, ((0, more), (0, more))),
    )
    made = arm.as_mjcf()
    assert made.error < 1e-9
    assert made.text == model.as_mjcf().text.replace("3 effects", "4 effects")
    assert arm.lasting().labels == model.labels
    # Of a bump alone a file holds nothing that was found, and does not say so.
    assert arm.of([len(arm.effects) - 1]).as_urdf().words == "holds all that lasts of this model"


def test_friction_and_rotors_of_drives_go_into_mujoco_s_joints(model):
    """What moves no tip is held beside the places; friction of another power is said to be left."""
    mujoco = pytest.importorskip("mujoco")
    drives = {
        REGISTRY["coulomb_friction"](joint=2): 0.8,
        REGISTRY["viscous_friction"](joint=2): 0.5,
        REGISTRY["rotor_inertia"](joint=3): 0.02,
        REGISTRY["viscous_friction"](joint=4, power=0.5): 0.3,
    }
    more = len(drives)
    arm = replace(
        model,
        effects=(*model.effects, *drives),
        values=np.append(model.values, list(drives.values())),
        covariance=np.pad(model.covariance, ((0, more), (0, more))),
    )
    made = arm.as_mjcf()
    joints = mujoco.MjModel.from_xml_string(made.text)
    np.testing.assert_allclose(joints.dof_frictionloss, [0, 0.8, 0, 0, 0, 0])
    np.testing.assert_allclose(joints.dof_damping, [0, 0.5, 0, 0, 0, 0])
    np.testing.assert_allclose(joints.dof_armature, [0, 0, 0.02, 0, 0, 0])
    assert {lack.label for lack in made.lacks} >= {"viscous_friction 4", "backlash 3"}
    q = np.zeros((1, 6))
    np.testing.assert_array_equal(arm.tip(q), model.tip(q))


def test_a_table_of_corrections_holds_every_number(model):
    rows = list(csv.DictReader(io.StringIO(model.as_table().text)))
    told = {row["name"].split()[0]: row for row in rows if row["kind"] == "parameter"}
    assert {"compliance", "play", "offset", "frame"} <= set(told)
    curve = [float(row["value"]) for row in rows if row["kind"] == "curve" and row["joint"] == "4"]
    np.testing.assert_allclose(curve, float(told["offset"]["value"]), rtol=1e-6)


def test_the_c_code_is_the_model(model, tmp_path):
    import ctypes
    import subprocess

    text = model.c_code()
    (tmp_path / "model.c").write_text(text)
    command = ["cc", "-shared", "-fPIC", "-O1", "model.c", "-o", "model.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    function = ctypes.CDLL(str(tmp_path / "model.so")).plumbline_model
    made = model.function()
    q = np.array([0.3, -1.0, 0.7, 0.2, -0.4, 0.9])
    inputs = [q if n == "q" else np.zeros(made.size1_in(k)) for k, n in enumerate(made.name_in())]
    pointer = ctypes.POINTER(ctypes.c_double)
    arguments = (pointer * made.sz_arg())(*[v.ctypes.data_as(pointer) for v in inputs])
    outputs = [np.zeros(16), np.zeros(36)]
    results = (pointer * made.sz_res())(*[v.ctypes.data_as(pointer) for v in outputs])
    work, whole = (ctypes.c_double * made.sz_w())(), (ctypes.c_longlong * max(made.sz_iw(), 1))()
    assert function(arguments, results, whole, work, 0) == 0
    np.testing.assert_allclose(outputs[0].reshape(4, 4).T, model.placement(q)[0], atol=1e-12)


def test_a_model_holds_on_the_arm_that_it_was_found_on(model, case, tmp_path):
    other = replace(faultless(rows=60, seed=52), effects=case.effects, gap_to_noise=(6.0,) * 3)
    found = apply(model, recorded(other, tmp_path)[0])
    assert found.before > 2 * found.after
    assert found.holds
    assert found.refitted == ("frame", "tool")


def test_a_cause_that_has_changed_since_is_named(model, case, tmp_path):
    changed = list(case.effects)
    changed[1] = changed[1].sized(2.5 * changed[1].size)
    other = replace(faultless(rows=80, seed=53), effects=tuple(changed), gap_to_noise=(6.0,) * 3)
    found = apply(model, recorded(other, tmp_path)[0])
    assert not found.holds
    assert found.changes[0].label == "backlash 3"
    stays = found.after * (1.0 - found.changes[0].saves)
    then, was = quantity(stays, "m"), quantity(found.promised, "m")
    assert "backlash 3" in found.words
    assert f"; with it fitted again {then} stays, where it left {was} before." in found.words


def test_rows_outside_of_the_fitted_range_are_counted(model, diagnosis):
    recording = diagnosis.recording
    assert apply(model, recording).outside_share == 0.0
    q = np.array(recording.q)
    q[:30, 0] = 3.1
    found = apply(model, replace(recording, q=q), force=True)  # tips stay where they were
    assert found.outside_share == pytest.approx(30 / len(recording))
    assert found.outside_columns == {"q1": pytest.approx(30 / len(recording))}
    assert "rows lie outside of what was fitted, by q1." in found.words


def test_encoder_zeros_are_fitted_again_where_they_always_are(tmp_path):
    """What is always fitted belongs to its session: a second encoder is mounted anew."""
    case = with_fault(
        faultless(rows=60, seed=61, observation="joint_position"), JointCompliance(0.0, 2)
    )
    recording = replace(recorded(case, tmp_path)[0], always=("joint_offset",))
    found = diagnose(recording)
    assert len(found.zeros) == 6
    shifted = replace(recording, measured=recording.measured + np.linspace(1e-3, 6e-3, 6))
    applied = found.transfer(shifted)
    assert applied.refitted == ("joint_offset",)
    assert applied.after == pytest.approx(found.transfer(recording).after, rel=1e-3)


def test_a_recording_of_another_robot_is_refused(model):
    bench = load_recording("plumbline/experiments/recordings/bench-ur5")
    robot = Robot.bundled("ur10")
    with pytest.raises(PlumblineError, match="joints placed or turning otherwise, expected ur5"):
        apply(model, replace(bench, robot=robot, chain=robot.chain()))


def test_a_robot_whose_joint_turns_the_other_way_is_another_robot(model):
    """At the same reading it errs the other way: what was found is wrong of it."""
    bench = load_recording("plumbline/experiments/recordings/bench-ur5")
    joints = list(bench.chain.joints)
    joints[1] = replace(joints[1], axis=-joints[1].axis)
    turned = replace(bench, chain=replace(bench.chain, joints=tuple(joints)), sha256="")
    with pytest.raises(PlumblineError, match="placed or turning otherwise, expected ur5"):
        apply(model, turned)
    with pytest.raises(PlumblineError, match="placed or turning otherwise, expected ur5"):
        plumbline.build_session([bench, replace(turned, name="turned")])
    slides = replace(joints[0], kind="prismatic")
    assert not same_joints(joints[:1], [slides])
    assert same_joints([], [])


def test_a_recording_set_up_otherwise_is_refused_before_causes_are_blamed_unless_forced(model):
    bench = load_recording("plumbline/experiments/recordings/bench-ur5")
    turned = replace(bench, q=bench.q * [1, 1, -1, 1, 1, 1])
    with pytest.raises(PlumblineError, match="with the sign of q3 turned; mend it, or take it"):
        apply(model, turned)
    assert not apply(model, turned, force=True).holds


def test_the_commands_take_a_model_home_and_try_it(diagnosis, model, stored, tmp_path, capsys):
    files = {o: tmp_path / f"out.{o}" for o in ("urdf", "mjcf", "dh", "csv", "c")}
    options = [word for o, path in files.items() for word in (f"--{o}", str(path))]
    assert run(["export", str(stored), *options]) == 0
    said = capsys.readouterr().out
    assert "cannot hold" in said
    assert all(path.stat().st_size > 500 for path in files.values())
    assert run(["export", str(stored), "--urdf", str(files["urdf"])]) == 2
    assert "is there already" in capsys.readouterr().err
    assert run(["export", str(stored)]) == 2
    assert "no format is named" in capsys.readouterr().err
    bench = "plumbline/experiments/recordings/bench-ur5"
    assert run(["apply", str(stored), bench, "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {"before", "after", "unit", "outside_range", "holds", "refitted"} <= set(told)


@pytest.mark.parametrize("turn", [1.9e-6, 1e-5])
def test_a_tool_that_hardly_turns_is_no_reason_to_refuse_a_file(model, turn):
    """MuJoCo reads a site that turns by less than 2e-6 as one that does not."""
    made = replace(model, R_tip_tool=Rotation.from_rotvec([turn, 0.0, 0.0]).as_matrix()).as_mjcf()
    assert made.error < 1e-9


def test_tips_know_no_drives(model):
    with pytest.raises(PlumblineError, match="a model of tip_position, expected one of a motion"):
        model.rollout(np.arange(5.0), np.zeros((5, 6)))


def test_of_many_lacks_and_changes_the_first_three_are_said_and_all_are_told(model):
    made = model.as_dh()
    lacks = tuple(Lack(f"backlash {k}", "", 1e-4) for k in range(1, 6))
    made = replace(made, lacks=lacks, whole=3e-4, stays=2e-4)
    assert "backlash 3 (0.100 mm) ... and 2 more; 0.200 mm of 0.300 mm stays" in made.words
    assert len(made.to_dict()["lacks"]) == 5
    changes = tuple(Change(f"backlash {k}", 9.0, 0.3) for k in range(1, 6))
    held = Applied("b", 9, "m", 1.0, 1.0, 0.2, (), (), (), {}, changes)
    assert "backlash 3 (30 % of what is left) ... and 2 more; with the first" in held.words
    held = replace(held, outside=(2,), outside_columns={"q3": 0.1})
    page = html.unescape(report_html(held))
    for said in (held.words.replace("->", "→"), "The model does not hold", "backlash 5", "q3"):
        assert said in page


def test_an_effect_that_was_found_to_be_nought_is_not_taken_for_a_matter_of_links(model):
    """Beside it another of its kind may be at work, which no file of links holds."""
    sags = tuple(REGISTRY["joint_compliance"](joint=j) for j in (2, 3, 1))  # 1 bears no load
    size = sum(len(e.parameters) for e in sags)
    P = len(model.nuisance_names) + size
    values = np.zeros(size)
    values[0] = 2e-5
    arm = replace(model, effects=sags, values=values, covariance=np.eye(P))
    made = arm.as_urdf()
    assert made.error < 1e-9
    assert [lack.label for lack in made.lacks] == [e.label for e in sags]
    assert "joint_compliance 2" in arm.as_table().words


def test_gross_rows_of_another_recording_are_left_out_and_told(model, diagnosis):
    measured = diagnosis.recording.measured.copy()
    measured[[4, 70], 0] += 0.02
    tried = apply(model, replace(diagnosis.recording, measured=measured))
    assert tried.gross == (6, 72)
    assert tried.holds
    assert "Left out as gross errors: 2 rows." in tried.words


def test_what_the_model_has_nothing_of_is_named_where_it_has_come_since(model, diagnosis):
    own = diagnosis.recording
    assert "joint_offset 3" not in model.labels
    turned = own.q + 2e-3 * np.eye(6)[2]
    T, was = own.chain.placement(turned), own.chain.placement(own.q)
    moved = own.measured + (T[:, :3, 3] - was[:, :3, 3]) @ model.T_device_base[:3, :3].T
    tried = apply(model, replace(own, measured=moved))
    assert [(c.label, c.new) for c in tried.changes[:1]] == [("joint_offset 3", True)]
    assert "joint_offset 3 (new, " in tried.words


def test_a_session_is_tried_by_one_of_its_recordings(stored, tmp_path, capsys):
    (tmp_path / "days").mkdir()
    (tmp_path / "days" / "session.toml").write_text('recordings = ["monday"]\n')
    assert run(["apply", str(stored), str(tmp_path / "days")]) == 2
    assert "it is a session of several: name the folder of one of them" in capsys.readouterr().err
