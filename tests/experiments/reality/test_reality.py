"""Laws of the simulator that withheld cases come from: gaps, seeds, recordings, confounding."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plumbline.experiments.reality import bench, confounding
from plumbline.experiments.reality.body_effects import (
    BaseCompliance,
    LinkGeometry,
)
from plumbline.experiments.reality.cases import Plan, draw_case
from plumbline.experiments.reality.confounding import confounded
from plumbline.experiments.reality.draws import LIBRARY, OUTSIDE, draw, offered, outside_offered
from plumbline.experiments.reality.gap import frame_and_tool, gap, scaled, unabsorbed
from plumbline.experiments.reality.joint_effects import (
    JointOffset,
    TransmissionRipple,
)
from plumbline.experiments.reality.recorder import moved_to, simulate
from plumbline.experiments.reality.scene import Mechanism, measured
from tests.house.test_import_direction import imports, module_name, within
from tests.simulated_cases import drawn_scene

REALITY = Path(__file__).resolve().parents[3] / "plumbline" / "experiments" / "reality"
EVERY = sorted(LIBRARY) + sorted(OUTSIDE)


# Independence


def test_reality_shares_no_code_with_the_library_but_how_a_refusal_is_said() -> None:
    for path in sorted(REALITY.rglob("*.py")):
        names = imports(path.read_text(encoding="utf-8"), module_name(path))
        ours = {name for name in names if within(name, "plumbline")}
        allowed = ("plumbline.experiments.reality", "plumbline.errors")
        shared = {name for name in ours if not any(within(name, room) for room in allowed)}
        assert not shared, f"{path.name}: {sorted(shared)}"


# The gap


def test_frame_and_tool_columns_are_derivatives_of_the_reading() -> None:
    scene = drawn_scene(rows=12)
    columns = frame_and_tool(scene).reshape(-1, 3, 9)
    step = 1e-6
    for k in range(3):
        nudge = step * np.eye(3)[k]
        aside = replace(scene, tool=scene.tool + nudge).pose_in_device()[0]
        slope = (aside - scene.pose_in_device()[0]) / step
        np.testing.assert_allclose(columns[:, :, 6 + k], slope, atol=1e-8)
    turned = replace(scene, base=np.tile([0, 0, 0, 0, 0, step], (12, 1)))
    slope = (turned.pose_in_device()[0] - scene.pose_in_device()[0]) / step
    assert unabsorbed(slope, columns.reshape(-1, 9)) < 1e-5


def test_what_the_frame_or_the_tool_can_swallow_leaves_no_gap() -> None:
    scene = drawn_scene()
    assert gap(scene, (JointOffset(1e-5, 1),), "tip_position") < 1e-9
    assert gap(scene, (JointOffset(1e-5, 6),), "tip_position") < 1e-9
    assert gap(scene, (JointOffset(1e-5, 3),), "tip_position") > 1e-6


@pytest.mark.parametrize("name", EVERY)
def test_a_scaled_mechanism_has_the_gap_asked_for(name: str) -> None:
    scene, rng = drawn_scene("lbr", rows=50), np.random.default_rng(8)
    for _ in range(40):
        found = scaled(scene, draw(name, scene, rng), 1e-4, "tip_position")
        if found is not None:
            break
    assert found is not None
    assert gap(scene, (found,), "tip_position") == pytest.approx(1e-4, rel=1e-2)
    assert 0.0 < found.size <= found.limit


def test_a_gap_out_of_reach_is_refused() -> None:
    assert scaled(drawn_scene(), JointOffset(0.0, 3), 1.0, "tip_position") is None
    assert scaled(drawn_scene(), JointOffset(0.0, 1), 1e-3, "tip_position") is None


# The recordings


@pytest.mark.parametrize("observation", ["tip_position", "pose", "joint_position"])
def test_noise_has_the_size_stated(observation: str) -> None:
    plan = Plan("none", rows=(1500, 1500), observation=observation, arms=("ur5",), surgical=0.0)
    case = draw_case(plan, "case", 3)
    columns = simulate(case)[0].columns
    if observation == "joint_position":
        seen = np.stack([columns[f"m{i}"] for i in range(1, 7)], axis=1) - case.scene.q
    else:
        seen = np.stack([columns[k] for k in "xyz"], axis=1) - measured(case.scene, ())
    assert np.sqrt(np.mean(seen**2)) == pytest.approx(case.noise_std, rel=0.06)
    assert np.ptp(np.linalg.eigvalsh(np.cov(seen.T))) > 0.2 * case.noise_std**2


def test_a_tip_in_its_socket_stays_there() -> None:
    plan = Plan("single", observation="fixed_point", effects=("joint_compliance",), arms=("ur10",))
    case = draw_case(plan, "case", 11)
    columns = simulate(case)[0].columns
    q = np.stack([columns[f"q{i}"] for i in range(1, 7)], axis=1)
    scene = moved_to(case.scene, q)
    for mechanism in case.effects:
        scene = mechanism.body(scene)
    tip = scene.pose_in_world()[0]
    inner = [tip[columns["socket"] == k] for k in np.unique(columns["socket"])]
    spread = np.concatenate([p - p.mean(axis=0) for p in inner])
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(case.noise_std, rel=0.25)


@pytest.mark.parametrize("observation", ["tip_position", "pose", "fixed_point", "joint_position"])
@pytest.mark.parametrize("kind", ["single", "pair", "none", "outside"])
def test_the_gap_written_is_the_gap_asked_for(kind: str, observation: str) -> None:
    plan = Plan(kind, gap=(2.0, 3.0), rows=(30, 40), observation=observation)
    pool = outside_offered(observation) if kind == "outside" else offered(observation)
    for seed in range(3):
        facts = simulate(draw_case(plan, "case", seed))[1]
        assert len(facts["effects"]) == {"none": 0, "pair": 2}.get(kind, 1)
        for cause in facts["effects"]:
            assert cause["effect"] in pool
            assert 2.0 <= cause["gap_to_noise"] <= 3.0
        if kind in {"single", "outside"}:
            assert facts["gap_to_noise"] == pytest.approx(facts["effects"][0]["gap_to_noise"], 1e-2)


def test_a_seed_gives_the_same_recording_again_and_another_another() -> None:
    plan = Plan("pair", rows=(30, 40), gross=0.02)
    one, again, other = (simulate(draw_case(plan, "case", seed)) for seed in (1, 1, 2))
    assert one[1] == again[1] != other[1]
    assert one[0].settings == again[0].settings
    for name, column in one[0].columns.items():
        assert (column == again[0].columns[name]).all()


def test_columns_give_nothing_away() -> None:
    """Pushed or not, header and settings' keys are the same for all effects."""
    seen = set()
    for name in sorted(set(LIBRARY) - {"latency"}):
        plan = Plan("single", rows=(40, 40), effects=(name,), arms=("lbr",), moving=0.0, forced=1.0)
        recording, _ = simulate(draw_case(plan, "case", 2))
        keys = [line.split("=")[0] for line in recording.settings.splitlines()]
        seen.add((tuple(keys), tuple(recording.columns)))
        assert name not in recording.settings
    assert len(seen) == 1


def test_noise_that_is_not_known_is_not_stated() -> None:
    for known in (True, False):
        plan = Plan("outside", rows=(30, 40), known_noise=known)
        settings = simulate(draw_case(plan, "case", 1))[0].settings
        assert ("noise_std" in settings) == known


def test_a_moving_recording_has_velocities_whatever_is_wrong() -> None:
    for name in ("latency", "joint_offset"):
        plan = Plan("single", rows=(40, 40), effects=(name,), arms=("ur5",), moving=1.0)
        assert "velocity6" in simulate(draw_case(plan, "case", 2))[0].columns


def test_gross_errors_are_few_large_and_listed() -> None:
    plan = Plan("none", rows=(200, 200), gross=0.02, arms=("ur5",))
    for seed in range(20):
        case = draw_case(plan, "case", seed)
        recording, facts = simulate(case)
        seen = np.stack([recording.columns[k] for k in "xyz"], axis=1)
        far = np.linalg.norm(seen - measured(case.scene, ()), axis=1) > 7 * case.noise_std
        assert list(np.flatnonzero(far) + 2) == facts["gross_rows"]
        assert far.sum() <= 4


def test_the_truth_states_what_noise_added_to_these_very_readings() -> None:
    plan = Plan("none", rows=(60, 60), gross=0.05, forced=0.0, arms=("ur5",))
    case = draw_case(plan, "case", 4)
    recording, facts = simulate(case)
    added = np.stack([recording.columns[k] for k in "xyz"], axis=1) - measured(case.scene, ())
    kept = np.delete(added, np.asarray(facts["gross_rows"]) - 2, axis=0)
    assert facts["noise_rms"] == pytest.approx(np.sqrt(np.mean(kept**2)), rel=1e-9)
    assert facts["noise_rms"] != pytest.approx(case.noise_std, rel=1e-3)


def test_masses_are_off_by_a_tenth_at_most_and_never_written() -> None:
    case = draw_case(Plan("none", arms=("lbr",)), "case", 1)
    ratio = case.scene.arm.mass / case.arm.mass
    assert (np.abs(ratio - 1) <= 0.1).all()
    assert np.ptp(ratio) > 0.01
    settings = simulate(case)[0].settings
    assert f"mass = {case.arm.mass[0]}" in settings


def test_a_surgical_space_is_a_box_of_two_to_four_tenths() -> None:
    for seed in range(4):
        case = draw_case(Plan("none", surgical=1.0), "case", seed)
        sides = np.ptp(case.scene.pose_in_world()[0], axis=0)
        assert (sides < 0.401).all()
        assert (sides > 0.1).any()


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'double' not recognised; known: single"):
        Plan("double")
    with pytest.raises(ValueError, match="Mechanism 'rust' not recognised; known: joint_offset"):
        draw("rust", drawn_scene(), np.random.default_rng(0))


def test_the_bench_recording_is_what_its_command_writes(tmp_path: Path) -> None:
    bench.main([str(tmp_path)])
    for name in ("dataset.toml", "samples.csv"):
        assert (tmp_path / name).read_bytes() == (bench.FOLDER / name).read_bytes()
    words = (bench.FOLDER / "dataset.toml").read_text()
    assert "ripple" not in words
    case = bench.bench_case()
    assert gap(case.scene, case.effects, "tip_position") == pytest.approx(3.0 * 8e-5, rel=1e-3)


# What nobody could tell


def wrong(
    effect: Mechanism, sigma: float = 1e-4, arm: str = "ur5"
) -> tuple[dict[str, object], ...]:
    """What is confounded with one effect at a gap of three sigma in a quiet scene."""
    plan = Plan("none", rows=(60, 60), arms=(arm,), moving=0.0, surgical=0.0)
    case = draw_case(plan, "case", 7)
    found = scaled(case.scene, effect, 3.0 * sigma, "tip_position")
    assert found is not None
    return confounded(replace(case, effects=(found,), noise_std=sigma, gap_to_noise=(3.0,)))


def test_a_rival_is_confounded_as_long_as_no_judge_can_tell_it_at_three_sigma(monkeypatch) -> None:
    case = draw_case(Plan("none", rows=(80, 80), arms=("ur5",), surgical=0.0), "any", 4)
    effect = JointOffset(1e-3, 2)
    wrong = replace(case, effects=(effect,), noise_std=1e-4, gap_to_noise=(1.0,))
    with monkeypatch.context() as patched:
        patched.setattr(confounding, "ENOUGH", np.inf)
        every = confounded(wrong)
    # Of as many terms as the truth: what parts them goes with the square of the gap over the noise.
    rival = next(r for r in every if r["effect"] == "joint_scale" and r["separation"] > 0.1)
    for separation, listed in ((8.9, True), (9.1, False)):
        sigma = 1e-4 * np.sqrt(rival["separation"] / separation)
        near = confounded(replace(wrong, noise_std=float(sigma)))
        keys = {(r["effect"], r["element"]) for r in near}
        assert ((rival["effect"], rival["element"]) in keys) is listed


def test_lengths_along_parallel_axes_are_confounded() -> None:
    """Joints 2, 3 and 4 of a UR5 are parallel: d of one is d of another."""
    listed = wrong(LinkGeometry(0.0, 2, (0.0, 0.0, 1.0)))
    assert not [t for t in listed if t["effect"] != "link_geometry"]
    plan = Plan("none", rows=(60, 60), arms=("ur5",), moving=0.0, surgical=0.0)
    scene = draw_case(plan, "case", 7).scene
    one, two = (measured(scene, (LinkGeometry(1e-4, i, (1.0, 0.0, 0.0)),)) for i in (2, 3))
    np.testing.assert_allclose(one, two, atol=1e-9)
    elements = {t["element"] for t in wrong(LinkGeometry(0.0, 2, (1.0, 0.0, 0.0)))}
    assert {3, 4} <= elements


def test_a_strong_ripple_is_confounded_with_nothing_over_the_whole_range() -> None:
    assert not wrong(TransmissionRipple(0.0, 2, once=(1.0, 0.6), twice=(0.9, 2.0)))


def test_a_signal_below_the_noise_is_confounded_with_more_than_one_above() -> None:
    plan = Plan("none", rows=(40, 40), arms=("ur5",), moving=0.0, surgical=0.0)
    case = draw_case(plan, "case", 7)
    counts = []
    for sigma in (1e-5, 1e-3):
        effect = scaled(case.scene, BaseCompliance(0.0), 1e-4, "tip_position")
        assert effect is not None
        listed = confounded(replace(case, effects=(effect,), noise_std=sigma, gap_to_noise=(1.0,)))
        assert all(0.0 <= float(str(t["separation"])) < 9.0 for t in listed)
        counts.append(len(listed))
    assert counts[0] < counts[1]
