"""Ranges on planes and fiducials are diagnosed as tips are: named, left out, reported, refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.link_geometry import LinkGeometry
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.of_any_kind import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.predict import held_out
from plumbline.optim.diagnosis.predict.folds import fold_of_rows, kind_of_folds
from plumbline.optim.diagnosis.predict.held_out import Evaluation
from plumbline.optim.diagnosis.verdict.confounding import _of_another_world
from plumbline.optim.loading import load_to_diagnose
from plumbline.optim.measurement.constants import LEAST_HALF
from plumbline.optim.measurement.nuisance import half_widths
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.stand_in import points_robot, pose_readings, poses_robot
from plumbline.optim.registration.fiducials import Fiducials
from plumbline.optim.registration.to_diagnose import fiducials_to_diagnose
from tests.answer_contract import contradicts_nothing
from tests.benches import bench
from tests.dh_sessions import simulated_recording
from tests.fuzz.recordings import sound
from tests.part_cases import JOINTS, diagnosed, fiducials, first, ranges

NEW = {
    "range_scale", "incidence_bias", "plane_unflatness", "marker_shift", "slice_quantisation",
    "ct_scale",
}  # fmt: skip


def edited(folder, to, change):
    """A copy of a recording with its rows changed."""
    to.mkdir(exist_ok=True)
    (to / "dataset.toml").write_text((folder / "dataset.toml").read_text())
    (to / "samples.csv").write_text(change((folder / "samples.csv").read_text()))
    return to


@pytest.mark.parametrize("name", ["range_scale", "incidence_bias", "plane_unflatness"])
def test_what_is_wrong_with_a_finder_or_its_planes_is_named_first(name):
    folder, truth = ranges(name)
    verdict = diagnosed(folder).verdict
    assert first(verdict) == (truth.name, truth.element)
    assert verdict.gap.after < 0.7 * verdict.gap.before
    assert verdict.gap.held_out_by == "motions"


def test_a_joint_of_the_arm_that_carries_the_finder_is_named():
    folder, truth = ranges("transmission_ripple", plan=JOINTS)
    assert first(diagnosed(folder).verdict) == (truth.name, truth.element)


@pytest.mark.parametrize("name", ["marker_shift", "slice_quantisation", "ct_scale", "respiration"])
def test_what_is_wrong_with_markers_or_their_ct_is_named_first(name):
    folder, truth = fiducials(name)
    verdict = diagnosed(folder).verdict
    assert first(verdict) == (truth.name, truth.element)
    assert verdict.gap.after < 0.8 * verdict.gap.before


@pytest.mark.parametrize("made", [ranges, fiducials])
def test_nothing_is_blamed_where_nothing_is_wrong(made):
    verdict = diagnosed(made(None)[0]).verdict
    assert verdict.verdict == "no-gap"
    assert not verdict.causes


def read_once(folder, seed, repeats=4, moved=(0.0, 0.0, 0.0)):
    """Markers read once in a CT that is coarse along z, each touched so often by a finer robot."""
    rng = np.random.default_rng(seed)
    ct = rng.uniform(-0.08, 0.08, (8, 3))
    robot = ct + np.array([0.3, 0.1, 0.2])
    robot[0] += moved
    seen = ct + rng.normal(0.0, [2e-4, 2e-4, 6e-4], ct.shape)
    touched = robot + rng.normal(0.0, 2e-4, (repeats, *robot.shape))
    rows = [
        f"M{k},marker,{','.join(map(repr, [*seen[k].tolist(), *touched[i, k].tolist()]))}"
        for i in range(repeats)
        for k in range(8)
    ]
    folder.mkdir()
    head = 'name = "read once"\nobservation = "fiducials"\n[noise]\n'
    (folder / "dataset.toml").write_text(head + "robot_std = 2e-4\nct_std = [2e-4, 2e-4, 6e-4]\n")
    columns = "label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z"
    (folder / "samples.csv").write_text("\n".join([columns, *rows, ""]))
    return folder


def test_touches_of_one_marker_share_the_error_of_its_reading_in_ct(tmp_path):
    often = fiducials_to_diagnose(read_once(tmp_path / "often", 1))
    assert often.alike == pytest.approx(0.44 / 0.56)
    assert fiducials_to_diagnose(read_once(tmp_path / "once", 1, 1)).alike == 0.0
    verdict = diagnose(read_once(tmp_path / "clean", 2)).verdict
    assert verdict.verdict == "no-gap"
    assert verdict.outside_probability < 0.2
    verdict = diagnose(read_once(tmp_path / "moved", 3, moved=(2e-3, 2e-3, 1e-3))).verdict
    assert first(verdict) == ("marker_shift", 1)
    assert verdict.outside_probability < 0.2


@pytest.mark.parametrize(("made", "name"), [(ranges, "stripes"), (fiducials, "sheared_gantry")])
def test_what_the_library_lacks_is_outside_of_it(made, name):
    verdict = diagnosed(made(name)[0]).verdict
    assert verdict.outside_probability > 0.9
    assert not verdict.causes
    contradicts_nothing(verdict)


def test_a_marker_touched_once_that_moved_is_a_cause_and_no_gross_row():
    folder, truth = fiducials("marker_shift", 3.0, 5, 9, 1)
    verdict = diagnosed(folder).verdict
    assert first(verdict) == ("marker_shift", truth.element)
    assert not verdict.distrusted_rows
    assert verdict.verdict == "explained"
    assert verdict.gap.after < 1.15 * verdict.gap.noise_floor


def test_causes_whose_choice_foretells_worse_than_none_are_not_named(monkeypatch):
    """Chosen anew without each fold; rows that a recording keeps back only test."""
    folder, truth = fiducials("marker_shift")
    whole = held_out.shrink.held_out_residuals

    def misled(pool, folds, models, best):
        after, fits = whole(pool, folds, models, best)
        return (30.0 if any(model.effects for model in models) else 1.0) * after, fits

    monkeypatch.setattr(held_out.shrink, "held_out_residuals", misled)
    found = diagnose(folder)
    assert not found.verdict.causes
    assert found.verdict.gap.after == found.verdict.gap.before
    assert any("not named" in n and truth.name in n for n in found.verdict.notes)
    contradicts_nothing(found.verdict)
    monkeypatch.undo()
    told = Evaluation(
        *np.ones((2, 3, 1)), *np.ones((2, 3), bool), "rows", (0, 0), (0, 0), "m", False
    )
    assert not told.misleads
    assert replace(told, after=2 * told.after).misleads
    assert not replace(told, after=2 * told.after, by=held_out.BY_COLUMN).misleads


def test_the_beam_and_the_transform_are_told_with_their_errors():
    verdict = diagnosed(ranges("range_scale")[0]).verdict
    direction = [verdict.nuisances[f"beam v{c}"] for c in "xyz"]
    assert sum(e.value**2 for e in direction) == pytest.approx(1.0, abs=1e-9)
    normal = [verdict.nuisances[f"plane 2 n{c}"].value for c in "xyz"]
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
    frame = diagnosed(fiducials("ct_scale")[0]).verdict.nuisances
    assert {frame[f"frame {c}"].unit for c in ("x", "rx")} == {"m", "rad"}
    every = (*verdict.nuisances.values(), *frame.values())
    assert all(0.0 < e.std < 0.01 and e.doc for e in every)


def test_three_markers_are_refused_by_name_in_one_line():
    folder, _ = fiducials(None, 1.0, 4, 3, 4)
    with pytest.raises(PlumblineError, match="3 markers, at least 4 expected") as error:
        load_to_diagnose(folder)
    assert "\n" not in str(error.value)


def test_one_plane_leaves_unknowns_open_and_they_are_named(tmp_path):
    folder, _ = ranges(None)

    def one_plane(text):
        head, *rows = text.strip().split("\n")
        place = head.split(",").index("plane")
        return "\n".join([head, *(r for r in rows if r.split(",")[place] == "1")]) + "\n"

    one = edited(folder, tmp_path / "one", one_plane)
    verdict = diagnose(one).verdict
    assert not any(c.effect == "range_scale" for c in verdict.causes)
    assert any(b.effect == "incidence_bias" for b in (*verdict.unobservable, *verdict.candidates))

    def one_attitude(text):
        head, *rows = one_plane(text).strip().split("\n")
        names, cells = head.split(","), [row.split(",") for row in rows]
        for k, row in enumerate(cells):
            same = {c: cells[0][names.index(c)] for c in ("qw", "qx", "qy", "qz")}
            moved = {"px": 0.01 * (k % 5), "py": 0.02 * (k % 3), "pz": 0.001 * (k % 7)}
            for name, value in {**same, **moved, "range": 0.3 + 0.001 * (k % 7)}.items():
                row[names.index(name)] = str(value)
        return "\n".join([head, *(",".join(row) for row in cells)]) + "\n"

    still = edited(folder, tmp_path / "still", one_attitude)
    notes = " ".join(diagnose(still).verdict.notes)
    assert "are left open by these rows, beam" in notes


def test_whole_motions_are_left_out_and_no_plane_with_them():
    recording = load_to_diagnose(ranges(None)[0])
    folds = fold_of_rows(recording)
    assert kind_of_folds(recording, "auto") == "motions"
    for motion in np.unique(recording.motion):
        assert len(np.unique(folds[recording.motion == motion])) == 1
    for fold in np.unique(folds):
        assert set(recording.element[folds != fold]) == {1, 2, 3}


def test_touches_of_one_marker_are_left_out_apart():
    recording = load_to_diagnose(fiducials(None)[0])
    folds = fold_of_rows(recording)
    assert kind_of_folds(recording, "auto") == "touches"
    for k in range(1, 9):
        mine = folds[recording.element == k]
        assert len(np.unique(mine)) == len(mine) == 4


def test_a_grid_of_slices_is_seen_and_a_stated_pitch_believed(tmp_path):
    folder, _ = fiducials("slice_quantisation")
    pitch = load_to_diagnose(folder).pitch
    assert pitch[2] > 2e-4
    assert not pitch[:2].any()
    ct = np.unique(load_to_diagnose(folder).q[:, 2])
    steps = np.diff(ct) / pitch[2]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    stated = edited(fiducials(None)[0], tmp_path / "stated", lambda text: text)
    settings = (stated / "dataset.toml").read_text().replace("noise_std = 0.0003\n", "")
    more = "[noise]\nct_resolution = [0.0, 0.0, 0.003]\nrobot_std = [0.0003, 0.0003, 0.0006]\n"
    (stated / "dataset.toml").write_text(settings + more)
    recording = load_to_diagnose(stated)
    assert recording.pitch.tolist() == [0.0, 0.0, 0.003]
    assert recording.noise_std == pytest.approx(np.sqrt((2 * 0.3**2 + 0.6**2) / 3) * 1e-3)
    ratio = recording.noise_shape[0] / recording.noise_shape[0, 0]
    np.testing.assert_allclose(ratio, [1.0, 1.0, 2.0], rtol=1e-9)


def test_objects_that_other_methods_read_are_diagnosed_too():
    folder, truth = fiducials("marker_shift", 3.0, 5, 9, 1)
    assert first(diagnose(plumbline.load(folder)).verdict) == ("marker_shift", truth.element)
    folder, _ = ranges("range_scale")
    assert first(diagnose(plumbline.load(folder)).verdict) == ("range_scale", None)


def test_markers_that_are_loaded_are_diagnosed_as_their_folder_is():
    """Touches of each again and again were refused by ``load``, and read by ``diagnose``."""
    again, once = (fiducials("ct_scale", touches=k)[0] for k in (4, 1))
    loaded = plumbline.load(again)
    assert loaded.sha256 == load_to_diagnose(again).sha256
    assert plumbline.diagnose(loaded).verdict.to_dict() == diagnosed(again).verdict.to_dict()
    assert isinstance(plumbline.load(once), Fiducials)
    with pytest.raises(PlumblineError, match=r"found '.*' again.*plumbline diagnose reads"):
        plumbline.register(again)


def test_an_answer_is_stored_and_restored(tmp_path):
    for folder in (ranges("range_scale")[0], fiducials("marker_shift")[0]):
        answer = diagnosed(folder)
        answer.save(tmp_path / f"{folder.name}.json")
        again = plumbline.load(tmp_path / f"{folder.name}.json")
        assert again.verdict.to_dict() == answer.verdict.to_dict()
        np.testing.assert_allclose(again.solution.x, answer.solution.x)
    with pytest.raises(PlumblineError, match="record them beside the poses"):
        diagnosed(ranges("range_scale")[0]).model()


def test_fiducials_give_a_model_that_takes_places_of_ct_to_the_robot(tmp_path):
    """A scale of CT moves every place; a marker that has moved says nothing of other places."""
    answer = diagnosed(fiducials("ct_scale")[0])
    model, rows = answer.model(), answer.recording
    model.save(tmp_path / "ct.toml")
    left = [np.linalg.norm(m.in_device(rows.q) - rows.measured, axis=1).mean()
            for m in (plumbline.load(tmp_path / "ct.toml"), model.without("ct_scale"))]  # fmt: skip
    assert left[0] < 0.7 * left[1]
    assert left[0] == pytest.approx(answer.gap.after, rel=0.3)
    moved = diagnosed(fiducials("marker_shift")[0]).model()
    assert moved.labels
    q = moved.samples["q"]
    np.testing.assert_array_equal(moved.in_device(q), moved.nominal.in_device(q))
    assert (np.sqrt(np.diagonal(moved.uncertainty(q, device=True), 0, 1, 2)) > 0.0).all()


def test_ranges_of_an_arm_give_its_model_with_the_beam_for_a_tool(tmp_path):
    answer = diagnosed(ranges("transmission_ripple", plan=JOINTS)[0])
    model = answer.model()
    start = [answer.nuisances[f"beam {c}"] for c in "xyz"]
    np.testing.assert_allclose(model.tool, [one.value for one in start])
    points = [answer.nuisances[f"beam v{c}"].value for c in "xyz"]
    np.testing.assert_allclose(model.R_tip_tool[:, 2], points, atol=1e-12)
    tool = [model.nuisances[f"tool {c}"].std for c in "xyz"]
    np.testing.assert_allclose(tool, [one.std for one in start], rtol=1e-6)
    assert set(model.labels) == {c.label.replace(" of joint", "") for c in answer.causes}
    model.save(tmp_path / "arm.toml")
    again = plumbline.load(tmp_path / "arm.toml")
    q = model.samples["q"]
    np.testing.assert_allclose(again.tip(q), model.tip(q), atol=1e-9)
    tried = answer.transfer(answer.recording)
    assert tried.refitted == ("beam", "planes")
    assert tried.holds
    assert tried.after == pytest.approx(answer.gap.after, rel=0.2)


REFUSED = (["next"], ["diagnose", "--calibrate", "20"], ["diagnose", "--model", "m.toml"])


@pytest.mark.parametrize(
    ("made", "name", "picture"),
    [
        (ranges, "plane_unflatness", "Where on each plane"),
        (fiducials, "marker_shift", "The worst marker is missed"),
    ],
)
def test_the_command_writes_verdict_and_report(made, name, picture, tmp_path, capsys):
    folder, out, page = made(name)[0], tmp_path / "out.json", tmp_path / "out.html"
    assert run(["diagnose", str(folder), "--json", str(out), "--report", str(page)]) == 0
    told = json.loads(out.read_text())
    assert {"verdict", "gap", "where", "causes", "tree", "unobservable"} <= set(told)
    assert told["gap"]["unit"] == "m"
    assert picture in page.read_text()
    assert run(["check", str(folder)]) == 0
    assert "plumbline diagnose FOLDER" in capsys.readouterr().out


@pytest.mark.parametrize("made", [ranges, fiducials])
@pytest.mark.parametrize("asked", REFUSED, ids=lambda asked: asked[-1])
def test_what_is_not_offered_for_them_is_refused_in_one_line(made, asked, capsys):
    if made is fiducials and "--model" in asked:
        asked = ["diagnose", "--also", str(made(None)[0])]
    assert run([asked[0], str(made(None)[0]), *asked[1:]]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("made", "column", "row", "value", "said"),
    [
        (fiducials, "ct_x", 3, "0.5", "another place in CT of marker"),
        (fiducials, "time", 3, "-7", "time that never decreases"),
        (fiducials, "robot_y", 2, "", "an empty cell"),
        (ranges, "range", 5, "-0.1", "a range above 0 m"),
        (ranges, "plane", 5, "9", "plane 9: 1 readings to fit, at least 3"),
        (ranges, "time", 5, "-7", "time that never decreases"),
    ],
)
def test_a_row_that_cannot_be_is_refused_in_one_line(made, column, row, value, said, tmp_path):
    def spoilt(text):
        head, *rows = text.strip().split("\n")
        cells = rows[row].split(",")
        cells[head.split(",").index(column)] = value
        rows[row] = ",".join(cells)
        return "\n".join([head, *rows]) + "\n"

    folder = edited(made(None)[0], tmp_path / "spoilt", spoilt)
    with pytest.raises(PlumblineError, match=said) as error:
        load_to_diagnose(folder)
    assert "\n" not in str(error.value)


def test_another_kind_of_recording_hears_nothing_of_planes_and_markers():
    scope = scope_of(bench("ur5", "tip_position"))
    assert all(_of_another_world(REGISTRY[name], scope) for name in NEW)
    assert not any(REGISTRY[name].candidates(scope) for name in NEW)
    of_points = scope_of(bench("points", "fiducials"))
    assert not any(
        _of_another_world(REGISTRY[name], of_points) for name in ("ct_scale", "base_bump")
    )
    assert all(_of_another_world(REGISTRY[name], of_points) for name in ("backlash", "payload"))


def test_a_stand_in_carries_points_and_poses_to_where_they_are():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (9, 3))
    np.testing.assert_allclose(points_robot().chain().tips(points, np.zeros(3)), points)
    chain = poses_robot().chain()
    T = chain.placement(rng.uniform(-3.0, 3.0, (9, 6)))
    np.testing.assert_allclose(chain.placement(pose_readings(T)), T, atol=1e-12)
    assert chain.reach == pytest.approx(1.0)
    assert points_robot().chain().reach == pytest.approx(1.0)


def test_a_plane_that_is_met_at_one_spot_has_a_width_all_the_same():
    recording = load_to_diagnose(ranges(None)[0])
    assert (half_widths(recording) > 0.1).all()
    mine = np.flatnonzero(recording.element == 1)[:1]
    one = recording.select(np.repeat(mine, 3))
    spread = half_widths(one)
    assert spread[0] > 0.0
    assert spread[1] == LEAST_HALF == 1e-3


def test_targets_take_no_part_and_that_is_said(tmp_path):
    folder = edited(
        fiducials(None)[0],
        tmp_path / "targets",
        lambda text: text + "T,target,0.01,0.02,0.03,,,,400\n",
    )
    recording = fiducials_to_diagnose(folder)
    assert len(recording) == 32
    assert recording.unjudged == "1 target, which may move (respiration)"
    assert any("1 is 'M" in note for note in recording.notes)


@pytest.mark.parametrize(("held", "words"), [(1, "every row held out"), (2, "found 2, expected 0")])
def test_held_out_markers_are_told_by_0_and_1(tmp_path, held, words):
    files = dict(sound("fiducials"))
    head, *rows = files["samples.csv"].splitlines()
    files["samples.csv"] = "\n".join([f"{head},held_out", *(f"{r},{held}" for r in rows)]) + "\n"
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(PlumblineError, match=words):
        load_to_diagnose(tmp_path)


def test_an_arm_whose_links_are_all_wrong_lacks_nothing_of_the_library():
    """Sixty readings, each link off by some 5 mm: four causes more, no unlisted function."""
    robot = Robot.bundled("ur5")
    rows = simulated_recording(robot, 60, np.random.default_rng(1), shift=5e-3, noise=1e-3)
    links_and_zeros = DiagnosisOptions(library=(LinkGeometry, JointOffset))
    verdict = diagnose(rows, links_and_zeros).verdict
    links = {c.element for c in verdict.causes if c.effect == "link_geometry"}
    assert links.issuperset({1, 2, 3, 5})
    assert verdict.outside_probability < 0.2
    assert verdict.gap.after < 2.3e-3
