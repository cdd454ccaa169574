"""A mass that the tip carries: MuJoCo's arm has it, the robot's file does not."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import plumbline
from plumbline import build_motion, diagnose
from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import MOTION_EFFECTS
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.progress import silent
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.motion.carried import (
    NOTHING,
    Carried,
    Off,
    from_tip,
    tip_of,
    weighed,
)
from plumbline.optim.diagnosis.motion.carrying import (
    candidates,
    carrying_more,
    more_probable,
    states_by,
)
from plumbline.optim.diagnosis.motion.diagnose import _begun
from plumbline.optim.diagnosis.motion.fit import evaluated
from plumbline.optim.diagnosis.motion.masses import Telling, fitted_mass
from plumbline.optim.diagnosis.motion.settled import carrying
from plumbline.optim.diagnosis.motion.signals import signals_of
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.several.motions import joined_motions
from plumbline.optim.diagnosis.several.transfer import masses_carry
from tests.pushed_arms import held_near, pushed_arm

STEP, EVERY, SECONDS, NOISE = 1e-3, 5, 3.0, 1e-4
AXES, LENGTHS, MASSES = ("0 0 1", "0 1 0", "0 1 0"), (0.1, 0.3, 0.2), (3.0, 2.0, 0.8)
INERTIAS = tuple(m * length**2 / 8 for m, length in zip(MASSES, LENGTHS, strict=True))
MASS, CENTRE = 0.5, np.array([0.2, 0.0, 0.03])  # [kg], [m] in the last link's frame
IDEAL = (((), np.empty(0)),) * 3
LINKS = {f"link_inertia {k}" for k in (1, 2, 3)}


def arms(mass=0.0, damping=0.0, integrator="RK4", link=0.0, first=0.0, rotor=0.0):
    """A robot, and MuJoCo's model: a point more at its last link, its second so much heavier."""
    urdf, _ = pushed_arm(AXES, LENGTHS, MASSES, INERTIAS, STEP, "0 0.01")
    model = mujoco.MjModel.from_xml_string(
        mujoco_text(mass, integrator, [1 + first, 1 + link, 1.0])
    )
    model.dof_damping[1], model.dof_armature[0] = damping, rotor
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return Robot.from_urdf(urdf), model


def mujoco_text(mass, integrator, heavier):
    """The arm of the file with a point more."""
    begins, text = (0.0, *LENGTHS), ""
    for k, axis in enumerate(AXES):
        inertia = f"{heavier[k] * INERTIAS[k]} " * 3
        text += (
            f'<body pos="{begins[k]} 0 0"><joint name="j{k}" axis="{axis}"/><inertial '
            f'pos="{LENGTHS[k] / 2} 0 0.01" mass="{heavier[k] * MASSES[k]}" '
            f'diaginertia="{inertia}"/>'
        )
    if mass:
        place = " ".join(map(str, CENTRE))
        inertial = f'<inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/>'
        text += f'<body pos="{place}">{inertial}</body>'
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(AXES)))
    return (
        f'<mujoco><option timestep="{STEP}" integrator="{integrator}"/><worldbody>{text}'
        f"{'</body>' * len(AXES)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def recorded(mass=0.0, gain=1.0, seed=0, **given):
    """Torques that hold the arm near a way; what the second motor gives is scaled."""
    robot, model = arms(mass, **given)
    data, nominal = mujoco.MjData(model), arms()[1]
    plan, rng = mujoco.MjData(nominal), np.random.default_rng(7 + seed)
    size, turn = rng.uniform(0.2, 0.5, (3, 2)), rng.uniform(1.5, 4.0, (3, 2)) * [1.0, 2.2]
    phase, told, seen = rng.uniform(0.0, 6.0, (3, 2)), [], []
    data.qpos[:] = (size * np.sin(phase)).sum(axis=1)
    for k in range(round(SECONDS / STEP)):
        if k % EVERY == 0:
            angle = turn * k * STEP + phase
            way = 0.0, size, turn, angle
            told.append(held_near(plan, data, nominal, way, (625, 35)))
            seen.append(data.qpos.copy())
        data.ctrl[:] = told[-1] * [1.0, gain, 1.0]
        mujoco.mj_step(model, data)
    q = np.array(seen) + np.random.default_rng(seed).normal(0.0, NOISE, (len(seen), 3))
    return build_motion(
        robot=robot, time=STEP * EVERY * np.arange(len(q)), command=np.array(told), q=q,
        kind="torque", noise_std=NOISE,
    )  # fmt: skip


@pytest.fixture(scope="module")
def laden():
    return recorded(MASS, damping=0.1)


@pytest.fixture(scope="module")
def answer(laden):
    return diagnose(laden)


def test_a_mass_that_the_file_lacks_is_told_alone_beside_a_drive_that_rubs(answer):
    """Each drive alone had a gain, an offset or a rotor in its place."""
    verdict = answer.verdict
    assert verdict.verdict is Outcome.EXPLAINED
    found = {(c.effect, c.element): c for c in verdict.causes}
    assert set(found) == {("payload", None), ("viscous_friction", 2)}
    told = found["payload", None]
    values = {name: e.value for name, e in told.parameters.items()}
    assert values["mass"] == pytest.approx(MASS, abs=4 * told.parameters["mass"].std)
    assert told.parameters["mass"].std < 0.01 * MASS
    moment = [values.get(axis, 0.0) for axis in "xz"]
    np.testing.assert_allclose(moment, MASS * CENTRE[[0, 2]], atol=5e-3)
    assert found["viscous_friction", 2].parameters["viscous"].value == pytest.approx(0.1, abs=2e-3)


def test_a_mass_s_figures_are_of_what_was_left_out_and_of_all_joints(answer):
    verdict = answer.verdict
    told = verdict.causes[0]
    assert told.effect == "payload"
    assert told.before > 20 * told.after
    assert verdict.where[0].stage == "tool"
    assert verdict.where[0].element is None
    assert verdict.where[0].share > 0.5
    assert [step.label for step in verdict.staircase][:2] == ["before", "payload"]
    place = next(place for place in verdict.tree if place["stage"] == "tool")
    assert place["probability"] > 0.9
    [leaf] = place["dependences"]
    assert leaf["on"] == "load"
    assert all(joint.before > 5 * joint.after for joint in verdict.joints)


def test_an_answer_brought_back_has_its_mass(answer, tmp_path):
    answer.save(tmp_path / "answer.json")
    again = plumbline.load(tmp_path / "answer.json")
    assert again.mass.carried == answer.mass.carried
    np.testing.assert_array_equal(again.signals.q, answer.signals.q)


def test_what_is_taken_home_carries_the_mass(answer, tmp_path):
    answer.model().save(tmp_path / "drives.toml")
    drives = plumbline.load(tmp_path / "drives.toml")
    assert drives.parameters["payload mass"].value == answer.mass.carried.bodies[0].values[0]
    before, after = drives.gaps(recorded(MASS, damping=0.1, seed=1))
    assert (after < 1.2 * NOISE).all()
    assert (before > 10 * NOISE).all()
    model = arms(MASS, damping=0.1)[1]
    data, seen, t = mujoco.MjData(model), [], STEP * EVERY * np.arange(100)
    told = np.column_stack([0.3 * np.sin(5 * t), 2 * np.cos(7 * t), 0.4 * np.sin(9 * t)])
    for push in np.repeat(told, EVERY, axis=0):
        if len(seen) * EVERY * STEP <= data.time + STEP / 2:
            seen.append(data.qpos.copy())
        data.ctrl[:] = push
        mujoco.mj_step(model, data)
    apart = drives.rollout(t, told) - np.array(seen)
    assert np.ptp(seen, axis=0).min() > 0.1
    assert np.abs(apart).max() < 0.02 * np.ptp(seen, axis=0).max()


@pytest.mark.parametrize(
    "body",
    [Off((-0.1,)), Off((0.5, 0.0)), Off((0.5, 0.0, 0.0, float("nan"))), Off((0.1,), 4),
     Off((-0.95,), 1)],
)  # fmt: skip
def test_drives_whose_mass_is_none_are_refused(body, answer, tmp_path):
    carried = Carried((body,))
    damaged = replace(answer.model(), carried=carried, carried_std=np.zeros(len(body.values)))
    damaged.save(tmp_path / "drives.toml")
    with pytest.raises(PlumblineError, match="carried"):
        plumbline.load(tmp_path / "drives.toml")


def test_a_file_for_mujoco_has_the_mass(answer):
    written = mujoco.MjModel.from_xml_string(answer.model().as_mjcf().text)
    assert written.body_mass[-1] == pytest.approx(MASSES[-1] + MASS, rel=0.01)
    there = written.body_mass[-1] * written.body_ipos[-1]
    expected = MASSES[-1] * np.array([LENGTHS[-1] / 2, 0.0, 0.01]) + MASS * CENTRE
    np.testing.assert_allclose(there, expected, atol=5e-3)


@pytest.mark.parametrize(
    "given", [{"gain": 0.9}, {"damping": 0.3}, {"rotor": 0.05}, {"integrator": "implicitfast"}, {}]
)
def test_what_one_drive_does_or_a_clock_is_no_mass(given):
    signals, begun = _begun(DiagnosisOptions(), silent, signals_of(recorded(**given)))
    assert carrying_more(signals, begun, (), candidates(signals.recording)) is None


def test_a_mass_that_two_joints_tell_is_not_lost_for_what_a_third_one_s_drive_does(laden):
    """Light joints that rub leave a hundred times as much, which a body of any form takes."""
    signals, begun = _begun(DiagnosisOptions(), silent, signals_of(laden))
    telling = Telling(signals, IDEAL, begun[0].quick.windows.start)
    fit = fitted_mass(telling, Carried((Off((MASS, *(MASS * CENTRE))),)), clock=True)
    *others, third = fit.residuals
    assert more_probable(replace(fit, residuals=(*others, 1e20 * third)), begun) > 0
    none = tuple(1e20 * residual for residual in fit.residuals)
    assert more_probable(replace(fit, residuals=none), begun) < 0


def test_no_mass_is_asked_where_it_is_left_out_of_the_library_or_nothing_pushes(laden):
    assert {body.label for body in candidates(laden)} == {"payload", *LINKS}
    assert {body.label for body in candidates(laden, ("payload",))} == LINKS
    assert not candidates(laden, ("payload", "link_inertia"))
    follows = build_motion(robot=laden.robot, time=laden.time, command=laden.q, q=laden.q)
    assert not candidates(follows)


def test_a_simulator_s_clock_is_told_apart_from_the_mass_that_it_carries():
    signals = signals_of(recorded(0.9, integrator="implicitfast"))
    others = {e.name for e in MOTION_EFFECTS} - {"actuation_gain"}
    _, begun = _begun(DiagnosisOptions(without=(*others,)), silent, signals)
    found = carrying_more(signals, begun, (), candidates(signals.recording)).recording
    assert found.lead == pytest.approx(STEP / 2, abs=STEP / 20)
    assert found.carried.values[0] == pytest.approx(0.9, rel=0.01)


def test_columns_are_what_a_mass_changes_of_each_joint_where_states_are_right(laden):
    right = Carried((Off((MASS, *(MASS * CENTRE))), Off((0.0, 0.0, 0.0, 0.0), 2)))
    signals = signals_of(replace(laden, carried=right))
    telling = Telling(signals, IDEAL, signals.training)
    slopes = telling.slopes(right)
    for k, step in enumerate((1e-4, 1e-5, 1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5)):
        values = np.array(right.values)
        values[k] += step
        other = carrying(signals, right.valued(values))
        for j, one in enumerate(telling.joints):
            windows = (s.windows(j, s.training) for s in (other, signals))
            moved, was = (evaluated(w, (), np.empty(0)).residual for w in windows)
            foretold = one.mass @ (slopes[:, k] * step)
            apart = np.linalg.norm((moved - was).ravel() - foretold)
            assert apart <= 0.15 * max(np.linalg.norm(foretold), 1e-5)


@pytest.mark.parametrize("robot", [arms()[0], Robot.bundled("ur5")])
def test_numbers_at_the_tip_are_those_of_the_same_body_at_its_joint(robot):
    rng = np.random.default_rng(0)
    _, place, R = tip_of(robot)
    square = rng.normal(size=(3, 3))
    body = pin.Inertia(1.3, rng.normal(size=3), square @ square.T)
    moved = pin.SE3(R, place).act(body).toDynamicParameters()
    np.testing.assert_allclose(from_tip(robot) @ body.toDynamicParameters(), moved, atol=1e-12)


def test_a_robot_that_carries_a_point_has_its_mass_and_inertia():
    robot = arms()[0]
    point = Carried((Off((MASS, *(MASS * CENTRE))),))
    bare, found = (weighed(robot, (0, 1, 2), c).inertias[3] for c in (NOTHING, point))
    expected = bare + pin.Inertia(MASS, CENTRE, np.zeros((3, 3)))
    np.testing.assert_allclose(found.toDynamicParameters(), expected.toDynamicParameters())
    assert bare.mass == MASSES[-1]


def test_a_mass_that_grows_less_stays_above_nothing():
    """From far too much of it whole steps lead below, where a point's inertia has no end."""
    signals = signals_of(recorded())
    telling = Telling(signals, IDEAL, signals.training)
    for form in (1, 4, 10):
        begun = Carried((Off((1.0,) + (0.0,) * (form - 1)),))
        found = fitted_mass(telling, begun, clock=False)
        assert 0.0 < found.carried.values[0] < 1e-3


def test_a_link_that_weighs_more_is_told_alone_and_taken_home():
    """A seventh more of the second link had been offsets, gains and rotors of three drives."""
    answer = diagnose(recorded(link=0.15))
    assert answer.verdict.verdict is Outcome.EXPLAINED
    [told] = answer.verdict.causes
    assert (told.effect, told.element) == ("link_inertia", 2)
    share = told.parameters["mass"]
    assert share.value == pytest.approx(0.15, abs=4 * share.std)
    assert share.std < 1e-3
    assert answer.verdict.where[0].share == pytest.approx(1.0)
    written = mujoco.MjModel.from_xml_string(answer.model().as_mjcf().text)
    assert written.body_mass[2] == pytest.approx(1.15 * MASSES[1], rel=1e-3)


def test_a_link_whose_centre_is_elsewhere_is_told_by_where_it_is(monkeypatch):
    plain, as_stated = arms, arms()

    def shifted(*given, **more):
        if not (given or more):
            return as_stated
        robot, model = plain(*given, **more)
        model.body_ipos[2, 0] += 0.02
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return robot, model

    monkeypatch.setitem(globals(), "arms", shifted)
    signals, begun = _begun(DiagnosisOptions(), silent, signals_of(recorded()))
    found = carrying_more(signals, begun, (), candidates(signals.recording))
    [body] = found.recording.carried.bodies
    assert body.label == "link_inertia 2"
    assert body.values[1] == pytest.approx(0.02, abs=1e-3)


def test_a_link_that_only_weighs_more_is_told_by_one_number():
    signals, begun = _begun(DiagnosisOptions(), silent, signals_of(recorded(link=0.2)))
    found = carrying_more(signals, begun, (), candidates(signals.recording))
    [body] = found.recording.carried.bodies
    assert body.label == "link_inertia 2"
    assert body.values == (pytest.approx(0.2, abs=1e-3),)


def test_a_rotor_beside_a_mass_is_no_link_that_weighs_three_times_as_much():
    """What turns about one upright axis feels both alike: widths of priors tell them apart."""
    others = {e.name for e in MOTION_EFFECTS} - {"rotor_inertia", "viscous_friction"}
    answer = diagnose(recorded(MASS, rotor=0.05), DiagnosisOptions(without=(*others,)))
    found = {(c.effect, c.element): c for c in answer.causes}
    assert set(found) == {("payload", None), ("rotor_inertia", 1)}
    rotor = found["rotor_inertia", 1].parameters["inertia"]
    assert rotor.value == pytest.approx(0.05, abs=0.005)


def test_a_link_that_turns_about_an_upright_axis_may_be_a_rotor():
    others = {e.name for e in MOTION_EFFECTS} - {"rotor_inertia", "viscous_friction"}
    options = DiagnosisOptions(without=(*others, "payload"))
    answer = diagnose(recorded(first=0.2), options)
    [told] = [c for c in answer.causes if c.effect in ("rotor_inertia", "link_inertia")]
    other = {"rotor_inertia": "link_inertia", "link_inertia": "rotor_inertia"}[told.effect]
    assert [(b.effect, b.element) for b in told.confounded_with] == [(other, 1)]
    [drive] = [place for place in answer.verdict.tree if place["element"] == 1]
    shares = {
        m["effect"]: m["probability"] for on in drive["dependences"] for m in on["mechanisms"]
    }
    assert all(0.05 < shares[name] < 0.95 for name in (told.effect, other))
    assert sum(shares.values()) == pytest.approx(drive["probability"])


def test_a_link_s_numbers_are_of_its_mass_its_centre_and_its_own_shape():
    robot = arms()[0]
    own = robot.model.inertias[2]
    heavier = Carried((Off((0.25,), 2),))
    found = weighed(robot, (0, 1, 2), heavier).inertias[2]
    np.testing.assert_allclose(found.toDynamicParameters(), 1.25 * own.toDynamicParameters())
    shift = np.array([0.01, -0.02, 0.03])
    moved = weighed(robot, (0, 1, 2), Carried((Off((0.25, *shift), 2),))).inertias[2]
    np.testing.assert_allclose(moved.lever, own.lever + shift / 1.25)
    np.testing.assert_allclose(moved.inertia, 1.25 * own.inertia, atol=1e-12)


LESS = (0.5, 0.05, 0.0, 0.0, 0.0, -0.04, 0.01, 0.0, 0.0, 0.0)  # than no inertia


@pytest.mark.parametrize(
    ("body", "real"),
    [
        (Off((0.5, 0.05, 0.0, 0.0, 0.0, 0.01, 0.01, 0.0, 0.0, 0.0)), True),
        (Off(LESS), False),
        (Off((-0.5, 0.05, 0.0, 0.0), 2), True),
        (Off((-1.5,), 2), False),
    ],
)
def test_bodies_whose_mass_is_below_nothing_anywhere_are_none(body, real):
    assert Carried((body,)).is_real(arms()[0], (0, 1, 2)) is real


@pytest.mark.parametrize(("share", "real"), [(5e-4, True), (2e-3, False)])
def test_a_point_s_inertia_may_be_less_than_nothing_by_noise_alone(share, real):
    """Links of files that have no inertia are points, just so."""
    rows = [
        {"d": 0.3, "alpha": np.pi / 2, "mass": 3.0},
        {"a": 0.4, "mass": 2.0, "com": [-0.2, 0, 0]},
    ]
    robot = Robot.from_dh([{"a": 0.0, "alpha": 0.0, **row} for row in rows])
    assert Carried((Off((0.3,), 2),)).is_real(robot, (0, 1))
    assert Carried((Off((0.5, 0.01, 0.0, 0.0)),)).is_real(robot, (0, 1))
    whole = robot.model.inertias[2].toDynamicParameters()[[4, 6, 9]].sum()
    less = -share * whole
    body = Off((1e-6, 0.0, 0.0, 0.0, 2 * less, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert Carried((body,)).is_real(robot, (0, 1)) is real


def test_states_that_run_off_are_none(laden):
    """Of an inertia of less than none some had run off, which had ended in a fault."""
    far = replace(laden, q=laden.q * np.linspace(1.0, 1e160, len(laden))[:, None])
    assert states_by(far, ()) is None
    assert states_by(laden, ()) is not None


@pytest.mark.parametrize(
    ("masses", "carries"), [((0.5, 0.5), "transfers"), ((0.5, 0.3), "differs")]
)
def test_a_mass_that_one_motion_has_is_held_against_all_others(masses, carries):
    motions = [recorded(mass, seed=k) for k, mass in enumerate(masses)]
    both = joined_motions([replace(m, name=f"motion {k}") for k, m in enumerate(motions)])
    middle = np.mean(masses)
    carried = Carried((Off((middle, *(middle * CENTRE))),))
    signals = signals_of(replace(both, carried=carried))
    first = signals.group[signals.starts] == 0
    [line] = masses_carry(signals, (), first, "motion 0")
    assert (line.effect, line.element, line.carries) == ("payload", None, carries)
    assert line.parameters["mass"].value == pytest.approx(masses[0], abs=0.02)
    assert line.parameters["mass"].others == pytest.approx(masses[1], abs=0.02)
