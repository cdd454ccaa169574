"""Laws of the mechanisms that the library lacks: closed forms, places, draws, and their scoring."""

import ast
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import unseen
from plumbline.experiments.reality.arm import Array, load_torque, loads
from plumbline.experiments.reality.cases import Plan, draw_case
from plumbline.experiments.reality.draws import LIBRARY, OUTSIDE, draw, offered
from plumbline.experiments.reality.gap import gap
from plumbline.experiments.reality.joint_effects import JointMechanism
from plumbline.experiments.reality.recorder import moved_to, simulate
from plumbline.experiments.reality.scene import Mechanism, Scene, measured
from plumbline.experiments.reality.unseen import UNSEEN, unseen_offered
from plumbline.experiments.reality.unseen.bodies import (
    BearingRunout,
    Draught,
    FloorSag,
    LooseBolt,
    ThermalBow,
    ToolRocking,
    weight_above,
)
from plumbline.experiments.reality.unseen.joints import (
    CableCreep,
    EncoderInterpolation,
    EndCushion,
    FlexsplineLoad,
    GearPit,
    HubSlip,
    LoadWindup,
    MaxwellSlip,
    MotorHeat,
    WornBelt,
)
from plumbline.experiments.reality.unseen.places import (
    FieldBody,
    HoseDrag,
    StitchedVolume,
    TrackerRefraction,
)
from plumbline.experiments.withheld.answer import ScoredCase, StatedVerdict, read_answer
from plumbline.experiments.withheld.design import MIXTURE, Design, draw_plan
from plumbline.experiments.withheld.making import make_set
from plumbline.experiments.withheld.scoring import score
from plumbline.experiments.withheld.truth import Sort, Truth, read_truth
from plumbline.kinematics.effects import REGISTRY

FOLDER = Path(unseen.__file__).parent


def a_scene() -> Scene:
    """A UR5 at work with nothing wrong."""
    return draw_case(Plan("none", rows=(40, 40), arms=("ur5",), moving=0.0), "scene", 5).scene


SCENE = a_scene()


def at(angles: list[float], joint: int = 1) -> Scene:
    """The scene with one joint's first readings set, the last of them held to the end."""
    q = SCENE.session.q.copy()
    q[:, joint - 1] = angles[-1]
    q[: len(angles), joint - 1] = angles
    return moved_to(SCENE, q)


def error(scene: Scene, mechanism: JointMechanism) -> Array:
    """What a mechanism adds to its own joint; no other joint moves."""
    added = mechanism.body(scene).q - scene.q
    assert not np.delete(added, mechanism.joint - 1, axis=1).any()
    return added[:, mechanism.joint - 1]


def torque(joint: int) -> Array:
    """Gravity's load on one joint."""
    return load_torque(SCENE.arm, SCENE.frames())[:, joint - 1]


# All of them


def test_there_are_twenty_and_the_library_has_none_of_them() -> None:
    assert len(UNSEEN) == 20
    plain = {name.replace("_", "") for name in (*REGISTRY, *LIBRARY, *OUTSIDE)}
    assert not {name.replace("_", "") for name in UNSEEN} & plain


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda p: p.stem)
def test_they_share_no_code_with_the_library(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    ours = {f"{name}." for name in names if str(name).startswith("plumbline")}
    assert all(name.startswith("plumbline.experiments.reality.") for name in ours)


@pytest.mark.parametrize("name", UNSEEN)
def test_each_is_null_at_zero_named_placed_and_sized_by_its_gap(name: str) -> None:
    case = draw_case(Plan("unseen", gap=(2.0, 3.0), rows=(60, 80), effects=(name,)), "case", 4)
    (mechanism,) = case.effects
    scene = case.scene
    none = measured(scene, (mechanism.sized(0.0),)) - measured(scene, ())
    assert np.abs(none).max() < 1e-14
    assert mechanism.effect == name
    told = mechanism.parameters()
    assert told["stage"] in {"base", "link", "joint", "tool", "sensor"}
    assert told["depends_on"]
    assert (told["stage"] in {"joint", "link"}) == (mechanism.element is not None)
    ratio = gap(scene, (mechanism,), "tip_position") / case.noise_std
    assert ratio == pytest.approx(case.gap_to_noise[0], rel=0.01)
    assert 0.0 < mechanism.size <= mechanism.limit
    source = (type(mechanism).__doc__ or "").split()
    assert [word for word in source if word.strip("().,:").isdigit() and len(word) > 4], name


@pytest.mark.parametrize("observation", ["pose", "fixed_point", "joint_position"])
def test_what_is_offered_can_be_recorded(observation: str) -> None:
    for seed, name in enumerate(unseen_offered(observation)[::4]):
        plan = Plan("unseen", rows=(30, 40), observation=observation, effects=(name,))
        columns = simulate(draw_case(plan, "case", seed))[0].columns
        assert all(np.isfinite(values).all() for values in columns.values())


# One by one


def test_springs_slip_one_by_one_and_come_back_by_the_same_travel() -> None:
    slip = MaxwellSlip(1.0, 1, widths=(0.2, 1.8))
    found = error(at([0.0, 0.1, 1.0, 5.0, 4.9, 4.0]), slip)[:6]
    np.testing.assert_allclose(found, [0.0, -0.1, -0.6, -1.0, -0.9, -0.3], atol=1e-12)


def test_a_cable_creeps_to_its_load_with_its_time_constant() -> None:
    scene = at([0.0])
    scene = moved_to(scene, np.tile(scene.session.q[:1], (40, 1)))
    creep = error(scene, CableCreep(1e-3, 2, 2.0, 60.0))
    steady = load_torque(scene.arm, scene.frames())[0, 1]
    since = scene.session.time - scene.session.time[0]
    np.testing.assert_allclose(creep, 5e-4 * steady * -np.expm1(-since / 60.0), rtol=1e-9)


def test_a_pit_is_deep_where_it_is_and_the_same_a_turn_on() -> None:
    found = error(at([0.5, 0.6, 0.5 + 2 * np.pi, 3.0]), GearPit(1e-3, 1, 0.5, 0.1))[:4]
    np.testing.assert_allclose(found, -1e-3 * np.array([1, np.exp(-0.5), 1, 0]), atol=1e-9)


def test_a_strain_wave_s_error_grows_with_its_load() -> None:
    found = error(SCENE, FlexsplineLoad(1e-3, 2, 4.0, 0.3))
    angle = SCENE.session.q[:, 1]
    np.testing.assert_allclose(found, 1e-3 * torque(2) / 4.0 * np.sin(2 * angle + 0.3), rtol=1e-9)


def test_interpolation_repeats_with_every_line_and_vanishes_with_its_errors() -> None:
    line = 2 * np.pi / 16
    wrong = EncoderInterpolation(1e-3, 1, 4, 0.2, 0.4)
    found = error(at([0.03, 0.03 + line, 0.03 + 5 * line]), wrong)[:3]
    np.testing.assert_allclose(found, found[0], atol=1e-15)
    assert abs(found[0]) > 1e-5
    assert np.abs(error(SCENE, EncoderInterpolation(1e-3, 1, 4, 0.0, 0.0))).max() < 1e-15
    orders = [{gear.parameters()["order"] for gear in basis} for basis in wrong.alike()]
    assert orders == [{16.0}, {32.0}, {16.0, 32.0}]


def test_a_bow_comes_with_the_heat_and_goes_when_it_has_soaked_through() -> None:
    side = (0.0, 0.0, 1.0)
    bow = ThermalBow(1e-3, 2, rise=10.0, delay=30.0, side=side)
    warmth = np.where(np.arange(40) < 1, 20.0, 30.0)
    scene = replace(SCENE, session=replace(SCENE.session, warmth=warmth))
    flex = bow.body(scene).shape.flex[:, 1]
    assert not flex[0].any()
    turn = np.linalg.norm(flex[:, 3:], axis=1)
    since = scene.session.time[1:] - scene.session.time[0]
    np.testing.assert_allclose(turn[1:], 1e-3 * np.exp(-since / 30.0), rtol=1e-9)
    length = abs(SCENE.arm.a[1])
    np.testing.assert_allclose(flex[:, :3], -0.5 * length * np.outer(turn, side), atol=1e-12)


def test_a_loose_bolt_opens_beyond_its_preload_alone() -> None:
    moment = loads(SCENE.arm, SCENE.frames())[1][:, 0, 1]
    closed, largest = float(np.median(moment)), float(moment.max())
    tilt = LooseBolt(1e-3, np.pi / 2, closed, largest).body(SCENE).base[:, 4]
    assert (tilt[moment <= closed] == 0.0).all()
    assert tilt.max() == pytest.approx(1e-3)
    assert ((tilt > 0.0) == (moment > closed)).all()


def test_a_ray_bends_with_the_square_of_its_way() -> None:
    ray = TrackerRefraction(1e-3, 2.0, 0.5, (0.0, 0.0, 2.0), turn=0.0)
    p = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 4.0], [0.5, 0.0, 2.0]])
    moved = (ray.sense(p, SCENE.session) - p)[:, 0]
    np.testing.assert_allclose(moved, 1e-3 * np.array([1.0, 4.0, np.exp(-1.0)]))


def test_a_dipole_s_field_is_twice_as_strong_on_its_axis_and_falls_with_the_cube() -> None:
    body = FieldBody(1.0, (0.0, 0.0, 0.0), 0.01, (0.0, 0.0, 1.0))
    p = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    on, beside, far = (body.sense(p, SCENE.session) - p)[:, 2]
    assert on / beside == pytest.approx(-2.0, rel=1e-3)
    assert on / far == pytest.approx(8.0, rel=1e-3)


def test_a_tool_rocks_between_two_places() -> None:
    rock = ToolRocking(1e-3, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.0, 1e-6)
    moved = (rock.body(SCENE).tool - SCENE.tool)[:, 1]
    down = -SCENE.frames()[:, -1, 2, 0]
    np.testing.assert_allclose(moved, 1e-3 * np.sign(down), atol=1e-9)


def test_a_draught_is_felt_at_once_and_fades() -> None:
    time = SCENE.session.time
    base = Draught(1e-3, (1.0, 0, 0, 0, 0, 2.0), time[10], 50.0).body(SCENE).base
    assert not base[:10].any()
    np.testing.assert_allclose(base[10:, 0], 1e-3 * np.exp(-(time[10:] - time[10]) / 50.0))
    np.testing.assert_allclose(base[:, 5], 2.0 * base[:, 0])


def test_worn_teeth_let_the_load_pick_a_flank_and_whole_ones_do_not() -> None:
    angle = SCENE.session.q[:, 1]
    low, high = np.quantile(angle, [0.2, 0.8])
    peak = float(np.abs(torque(2)).max())
    found = error(SCENE, WornBelt(1e-3, 2, peak, float(low), float(high)))
    within = (angle > low + 0.2) & (angle < high - 0.2) & (np.abs(torque(2)) > 0.6 * peak)
    beyond = (angle < low - 0.2) | (angle > high + 0.2)
    np.testing.assert_allclose(found[within], 1e-3 * np.sign(torque(2)[within]), rtol=0.01)
    assert np.abs(found[beyond]).max() < 1e-6


@pytest.mark.parametrize("joint", [1, 3])
def test_a_bearing_runs_out_across_its_axis_and_not_along_it(joint: int) -> None:
    built = BearingRunout(1e-3, joint, 1.2, 0.4).body(SCENE).frames()
    if joint == 1:
        twist = BearingRunout(1e-3, joint, 1.2, 0.4).body(SCENE).base[:, 3:]
    else:
        before, after = SCENE.frames()[:, joint - 1, :3, :3], built[:, joint - 1, :3, :3]
        R = np.swapaxes(before, 1, 2) @ after
        twist = np.stack([R[:, 2, 1], R[:, 0, 2], R[:, 1, 0]], axis=1)
    angle = 1.2 * SCENE.session.q[:, joint - 1] + 0.4
    across = 1e-3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(twist, across, atol=1e-6)


def test_a_cushion_is_felt_at_one_end_only() -> None:
    found = error(at([0.0, 0.9, 1.0, 1.5, 2.0]), EndCushion(1e-3, 1, 1.0, 1.0, 1.0))[:5]
    np.testing.assert_allclose(found, -1e-3 * np.array([0, 0, 0, 0.5**1.5, 1]), atol=1e-15)
    other = error(at([0.0, -1.0, -2.0]), EndCushion(1e-3, 1, -1.0, 1.0, -1.0))[:3]
    np.testing.assert_allclose(other, [0.0, 0.0, 1e-3], atol=1e-15)


def test_a_floor_sinks_most_under_the_weight() -> None:
    foot = weight_above(SCENE)
    sunk = FloorSag(1e-3, tuple(foot[3]), 0.1).body(SCENE).base
    assert sunk[3, 2] == pytest.approx(-1e-3)
    away = np.linalg.norm(foot - foot[3], axis=1)
    np.testing.assert_allclose(sunk[:, 2], -1e-3 * np.exp(-0.5 * (away / 0.1) ** 2))


def test_a_hose_pulls_towards_its_anchor_once_it_is_taut() -> None:
    _, tips = SCENE.tip()
    anchor = tips.mean(axis=0)
    away = np.linalg.norm(tips - anchor, axis=1)
    length = float(np.median(away))
    sag = HoseDrag(1e-3, tuple(anchor), length).body(SCENE).sag
    assert not sag[away <= length].any()
    towards = np.sum(sag * (anchor - tips), axis=1) / away
    np.testing.assert_allclose(towards, 1e-3 * np.maximum(away - length, 0.0) / length, atol=1e-12)


def test_a_motor_heats_by_its_own_way_and_cools() -> None:
    scene = at([0.0, 1.0, 1.0])
    heat = error(scene, MotorHeat(1e-3, 1, cooling=30.0, largest=1.0))
    since = scene.session.time[1:] - scene.session.time[1]
    assert heat[0] == 0.0
    np.testing.assert_allclose(heat[1:], 1e-3 * np.exp(-since / 30.0), atol=1e-15)


def test_a_loaded_gear_winds_up_to_the_side_it_came_from() -> None:
    found = error(SCENE, LoadWindup(1e-3, 2, 5.0))
    side = SCENE.session.direction[:, 1]
    np.testing.assert_allclose(found, -2e-4 * side * np.abs(torque(2)), atol=1e-15)


def test_a_seam_shifts_what_is_behind_it() -> None:
    seam = StitchedVolume(1e-3, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    p = np.array([[0.0, 0.0, 0.9], [0.0, 0.0, 1.1]])
    np.testing.assert_allclose(seam.sense(p, SCENE.session) - p, [[0, 0, 0], [1e-3, 0, 0]])


def test_a_hub_slips_once() -> None:
    found = error(SCENE, HubSlip(1e-3, 2, float(SCENE.session.time[17])))
    np.testing.assert_allclose(found, np.where(np.arange(40) > 17, 1e-3, 0.0), atol=1e-15)
    drawn = draw("hub_slip", SCENE, np.random.default_rng(0))
    assert isinstance(drawn, HubSlip)
    assert SCENE.session.time[7] < drawn.moment < SCENE.session.time[33]


# Sealed, and scored


def test_a_mixture_is_four_fifths_the_library_s_and_gives_nothing_away() -> None:
    design = Design(seed=1, kind=MIXTURE)
    draws = [draw_plan(design, number) for number in range(4000)]
    unlisted = [d for d in draws if d.plan.kind == "unseen"]
    gone = [d for d in draws if d.without and d.plan.effects == d.without]
    decoys = [d for d in draws if d.without and d.plan.effects != d.without]
    for some in (unlisted, gone, decoys):
        assert len(some) / len(draws) == pytest.approx(0.1, abs=0.015)
    assert not [d for d in draws if d.plan.kind not in {"single", "unseen"}]
    taken = Counter(d.without[0] for d in gone)
    assert set(taken) == set(offered("tip_position"))


@pytest.mark.parametrize(
    ("design", "words"),
    [
        ({"kind": "mixture", "effects": ("backlash",)}, "draws its own effects"),
        ({"kind": "unseen", "leave_out": ("backlash",)}, "says itself what is left out"),
        ({"kind": "unseen", "effects": ("backlash",)}, "known: cable_creep"),
        ({"kind": "unseen", "simulator": "mujoco"}, "draws one cause"),
    ],
)
def test_a_design_that_draws_nothing_is_refused(design: dict, words: str) -> None:
    with pytest.raises(PlumblineError, match=words):
        Design(seed=1, **design)


def test_a_sealed_truth_tells_the_joint_whose_own_it_is(tmp_path: Path) -> None:
    for name, joints in (("gear_pit", 1), ("floor_sag", 0)):
        design = Design(seed=3, kind="unseen", effects=(name,), rows=(30, 34), arms=("ur5",))
        make_set(tmp_path / name / "cases", tmp_path / name / "truth", design, 1)
        truth = read_truth(tmp_path / name / "truth" / "case-0001.json")
        assert truth.sort is Sort.OUTSIDE
        assert len(truth.joints) == joints
        assert truth.joints == tuple(element for _, element in truth.causes if element)
    left_out = tmp_path / "left.json"
    left_out.write_text(json.dumps({"effects": [{"effect": "backlash", "element": 2}]}))
    assert read_truth(left_out, ("backlash",)).joints == (2,)
    assert read_truth(left_out).joints == ()


def an_answer(tmp_path: Path, **content: object) -> StatedVerdict:
    """A verdict file, written and read."""
    path = tmp_path / "case.json"
    path.write_text(json.dumps({"verdict": "explained", "causes": [], **content}))
    return read_answer(path)


def a_tree(nameless: float) -> list[dict[str, object]]:
    """Two places, joint 3 the likelier, with a mechanism that has no name."""
    mechanisms = [
        {"effect": None, "probability": nameless},
        {"effect": "gear_ripple", "probability": 0.9 - nameless},
    ]
    joint = {"on": "q3", "probability": 0.9, "mechanisms": mechanisms}
    base = {"stage": "base", "element": None, "probability": 0.1, "dependences": []}
    return [base, {"stage": "joint", "element": 3, "probability": 0.9, "dependences": [joint]}]


def test_the_first_place_is_the_most_probable_of_the_tree_or_of_the_shares(tmp_path: Path) -> None:
    where = [
        {"stage": "sensor", "element": None, "share": 0.3},
        {"stage": "joint", "element": 2, "share": 0.7},
    ]
    assert an_answer(tmp_path, where=where).places[0] == ("joint", 2)
    assert an_answer(tmp_path, where=where, tree=a_tree(0.5)).places[0] == ("joint", 3)
    assert an_answer(tmp_path).places == ()


@pytest.mark.parametrize(("nameless", "flagged"), [(0.49, False), (0.51, True)])
def test_an_unlisted_mechanism_is_flagged_where_it_is_likelier_than_not(
    tmp_path: Path, nameless: float, flagged: bool
) -> None:
    assert an_answer(tmp_path, tree=a_tree(nameless)).flags_outside == flagged
    assert an_answer(tmp_path, outside_probability=nameless).flags_outside == flagged


@pytest.mark.parametrize(("more", "read"), [(1e-12, True), (1e-6, False)])
def test_a_sum_of_probabilities_may_exceed_one_by_rounding_alone(
    tmp_path: Path, more: float, read: bool
) -> None:
    cause = {"effect": "backlash", "element": 2, "probability": 1.0 + more}
    if read:
        assert an_answer(tmp_path, causes=[cause]).causes[0].probability == 1.0
        return
    with pytest.raises(PlumblineError, match="no verdict"):
        an_answer(tmp_path, causes=[cause])


def test_the_joint_is_right_where_it_comes_first(tmp_path: Path) -> None:
    key = ("gear_pit", 3)
    truth = Truth("case", (key,), (key,), joints=(3,))
    other, elsewhere = replace(truth, joints=(2,)), replace(truth, joints=())
    answer = an_answer(tmp_path, tree=a_tree(0.5))
    found = score([ScoredCase(t, answer) for t in (truth, other, elsewhere)]).overall
    assert (found.share("outside_joint").count, found.share("outside_joint").of) == (1, 2)


def test_a_mechanism_without_a_stage_says_nothing_of_one() -> None:
    assert "stage" not in Mechanism(1.0).parameters()
