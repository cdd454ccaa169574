"""Several recordings of one robot, one verdict: what is shared, what is each one's own."""

import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import plumbline
from plumbline.experiments.commands.app import run
from plumbline.experiments.report.writing import report_html
from plumbline.kinematics.effects import EFFECTS, REGISTRY
from plumbline.optim.diagnosis.of_recordings import Carries
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.several import transfer
from plumbline.optim.diagnosis.several.transfer import Each, transfers
from tests.several import recorded, written

LIBRARY = ("joint_offset", "joint_scale", "transmission_ripple", "tool_slip", "sensor_scale")
FEW = DiagnosisOptions(library=tuple(REGISTRY[name] for name in LIBRARY))
WITHOUT = [w for e in EFFECTS if e.name not in LIBRARY for w in ("--without", e.name)]
RIPPLE, GAIN, SLIP = 2e-3, 1.5e-3, (1e-3, 0.0, 0.0)


def rippled(q):
    """Joint 2 errs with its angle."""
    error = np.zeros_like(q)
    error[:, 1] = RIPPLE * np.sin(q[:, 1])
    return error


def stretched(q):
    """Joint 2 moves more than it says."""
    error = np.zeros_like(q)
    error[:, 1] = GAIN * q[:, 1]
    return error


@pytest.fixture(scope="module")
def tips():
    """Tips of a rippled joint; the second recording's tool slipped; the third is twice as
    noisy and has a larger ripple."""
    return [
        recorded("tip_position", 1, rippled, name="calm", rows=40),
        recorded("tip_position", 2, rippled, name="slipped", rows=40, slip=SLIP),
        recorded("tip_position", 3, lambda q: 1.3 * rippled(q), name="other", rows=40, noise=2e-4),
    ]


@pytest.fixture(scope="module")
def answer(tips):
    return plumbline.diagnose(tips, FEW)


def test_a_cause_that_all_share_is_fitted_to_all_rows(answer):
    cause = next(c for c in answer.causes if c.effect == "transmission_ripple")
    sine, alone = cause.parameters["order 1 sine"], one(answer, "transmission_ripple", "calm")
    assert (cause.element, cause.variant) == (2, "order 1; in other, order 1")
    assert sine.std < 0.9 * alone.parameters["sine"].std
    assert sine.value == pytest.approx(RIPPLE, abs=4 * sine.std)
    more = cause.parameters["sine, in other, order 1"]
    assert more.value == pytest.approx(0.3 * RIPPLE, abs=4 * more.std)


def one(answer, effect, recording):
    """The line of the table on an effect and a recording."""
    (found,) = (
        t for t in answer.verdict.transfer if (t.effect, t.recording) == (effect, recording)
    )
    return found


def test_a_tool_that_slipped_in_one_recording_is_blamed_there(answer):
    slip = next(c for c in answer.causes if c.effect == "tool_slip")
    assert slip.variant.startswith("in slipped, at 195 s")
    shift = [e.value for e in slip.parameters.values()]
    assert np.allclose(shift, SLIP, atol=2e-4)
    assert one(answer, "tool_slip", "slipped").carries == Carries.ONLY
    assert {t.recording for t in answer.verdict.transfer if t.effect == "tool_slip"} == {"slipped"}


def test_a_cause_that_is_another_in_one_recording_differs_there(answer):
    same, other = (one(answer, "transmission_ripple", name) for name in ("calm", "other"))
    assert other.carries == Carries.NO
    assert other.z > 4.0
    assert other.parameters["sine"].value == pytest.approx(1.3 * RIPPLE, abs=2e-4)
    assert other.parameters["sine"].others == pytest.approx(RIPPLE, abs=2e-4)
    assert same.z < other.z


def test_z_counts_rows_for_what_their_blocks_agree_on(answer, monkeypatch):
    session, part = answer.recording.session, answer.recording.part
    told = _table(answer.verdict.transfer)
    shares = Each(answer.selected, session, part).shares
    assert all(0.0 < share <= 1.0 for both in shares for share in both)
    whole, quarter = (_table(_transfers(answer, share, monkeypatch)) for share in (1.0, 0.25))
    for key, z in told.items():
        assert z <= whole[key] * (1.0 + 1e-6)
        assert quarter[key] == pytest.approx(whole[key] / 2.0, rel=1e-3)


def _table(lines):
    """z by cause and recording, where there is one."""
    return {(t.label, t.recording): t.z for t in lines if t.z > 0.0}


def _transfers(answer, share, monkeypatch):
    monkeypatch.setattr(transfer, "share_of", lambda *parts: share)
    return transfers(Each(answer.selected, answer.recording.session, answer.recording.part))


def test_each_recording_has_figures_of_its_own(answer, tips):
    listed = answer.verdict.recordings
    assert [(r.name, r.rows, r.unit) for r in listed] == [(t.name, 40, "m") for t in tips]
    assert [r.noise for r in listed] == [1e-4, 1e-4, 2e-4]
    for r in listed:
        assert r.after < 0.7 * r.before
        assert r.after < 1.6 * math.sqrt(3.0) * r.noise
    slipped = listed[1]  # nobody else knows that its tool slipped
    assert slipped.without_it > 1.5 * slipped.after
    squares = [r.rows * r.after**2 for r in listed]
    assert answer.gap.after == pytest.approx(math.sqrt(sum(squares) / 120), rel=1e-6)


def test_frame_and_tool_are_each_recording_s_own(answer, tips):
    names = [f"frame x of {t.name}" for t in tips]
    assert [name for name in answer.frame if name.startswith("frame x")] == names
    for t in tips:
        model = answer.model(t.name)
        reached = (model.T_device_base @ np.append(model.tip(t.q[:1])[0], 1.0))[:3]
        assert np.linalg.norm(reached - t.measured[0]) < 2e-3
    with pytest.raises(plumbline.PlumblineError, match="found 'calmer', expected one of the"):
        answer.model("calmer")


def test_the_verdict_tells_recordings_and_transfer_in_json_page_and_store(answer, tmp_path):
    told = answer.verdict.to_dict()
    assert [r["name"] for r in told["recordings"]] == ["calm", "slipped", "other"]
    assert {t["carries"] for t in told["transfer"]} >= {"differs", "here only"}
    page = report_html(answer, proof=False)
    assert "Recording by recording" in page
    assert "here only" in page
    answer.save(tmp_path / "all.json")
    back = plumbline.load(tmp_path / "all.json")
    assert back.to_dict() == answer.to_dict()
    assert np.array_equal(back.solution.gram.matrix, answer.solution.gram.matrix)


def test_a_single_recording_is_a_session_of_one():
    encoders = recorded("joint_position", 4, rippled, rows=30)
    alone = plumbline.diagnose(encoders, FEW)
    assert plumbline.diagnose([encoders], FEW).to_dict() == alone.to_dict()
    assert not {"recordings", "transfer"} & set(alone.to_dict())


def test_what_each_alone_doubts_all_together_tell():
    """Over a small range a joint's scale passes for the device's, and the other way about."""
    tips = recorded("tip_position", 45, stretched, scale=1e-3, reach=0.3, rows=50)
    encoders = recorded("joint_position", 48, stretched, reach=0.3, rows=24)
    truth = {"joint_scale": GAIN, "sensor_scale": 1e-3}
    alone = {c.effect: c.probability for c in plumbline.diagnose(tips, FEW).causes}
    assert alone.get("joint_scale", 0.0) < 0.5, "the case is told by tips alone: take another"
    found = plumbline.diagnose([tips, encoders], FEW)
    assert {c.effect for c in found.causes} == set(truth)
    assert {c.effect: c.probability for c in found.causes}["joint_scale"] > 0.9
    for cause in found.causes:
        (first, *_) = cause.parameters.values()
        assert first.value == pytest.approx(truth[cause.effect], abs=4 * first.std)
    units = [r.unit for r in found.verdict.recordings]
    assert units == ["m", "rad"]
    assert found.gap.unit == "m"


def test_a_recording_that_states_too_little_noise_misleads_no_other():
    """Its rows weigh what its own fit leaves, and what it states is held against that."""
    calm = recorded("tip_position", 120, rippled, rows=30)
    loud = replace(recorded("tip_position", 121, rippled, rows=30), noise_std=1e-5)
    found = plumbline.diagnose([calm, loud], FEW)
    assert {(c.effect, c.element) for c in found.causes} == {("transmission_ripple", 2)}
    assert found.verdict.verdict == "partly-explained"
    said = (found.verdict.outside_depends_on, *found.verdict.notes)
    assert any(words.startswith("tip_position 121 is missed by 9") for words in said)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A session's folder: two recordings, the robot once."""
    place = tmp_path_factory.mktemp("sessions") / "arm-7"
    written(recorded("tip_position", 1, rippled, rows=20), place / "one", robot=None)
    written(recorded("joint_position", 2, rippled, rows=20), place / "two", robot=None)
    (place / "session.toml").write_text(
        'name = "arm 7"\nrecordings = ["one", "two"]\n[robot]\nbundled = "ur5"\n'
    )
    return place


def test_a_session_s_folder_is_asked_as_one(folder, tmp_path, capsys):
    session = plumbline.load(folder)
    assert [p.name for p in session.parts] == ["one", "two"]
    out = tmp_path / "all.json"
    other = written(recorded("tip_position", 5, rippled, rows=20), tmp_path / "other")
    more = ["--also", str(other), "--model", str(tmp_path / "arm.toml")]
    assert run(["diagnose", str(folder), "--json", str(out), *more, *WITHOUT]) == 0
    told = json.loads(out.read_text())
    assert told["recording"] == "arm 7"
    assert [c["effect"] for c in told["causes"]][:1] == ["transmission_ripple"]
    assert told["also"]["after"] < 0.3 * told["also"]["before"]
    assert (tmp_path / "arm.toml").exists()
    assert "What carries over" in capsys.readouterr().out


def test_a_session_s_folder_is_checked_part_by_part(folder, capsys):
    assert run(["check", str(folder), "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [part["name"] for part in told["recordings"]] == ["one", "two"]
    assert [part["rows"] for part in told["recordings"]] == [20, 20]
    assert run(["check", str(folder)]) == 0
    assert "Session 'arm 7': 2 recordings" in capsys.readouterr().out


def test_recordings_of_one_name_are_told_apart_by_their_folders(folder, tmp_path, capsys):
    same = shutil.copytree(folder, tmp_path / "same")
    for settings in same.glob("*/dataset.toml"):
        settings.write_text(re.sub('name = ".*"', 'name = "run"', settings.read_text()))
    assert run(["check", str(same), "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [part["name"] for part in told["recordings"]] == ["run (one)", "run (two)"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('recording = ["one"]', "row 1, recording: found the key 'recording', expected name"),
        ('name = "x"', "session.toml, recordings: found nothing, expected folders"),
        ('recordings = ["one", "twi"]', "found 'twi', no folder in arm-7, expected folders"),
        ('recordings = ["one", "one"]', "found 'one' 2 times, expected each once"),
        ('recordings = ["../one"]', "found '../one', no folder in arm-7"),
        ('recordings = ["one"]\nshared = ["tol"]', "shared: found ['tol'], expected of frame"),
        ('recordings = ["one", "./one"]\n[robot]\nbundled = "ur5"', "given twice (as one"),
        ('recordings = ["one"]', "found no [robot], expected one of urdf"),
    ],
)
def test_a_wrong_session_is_told_in_one_line(folder, tmp_path, text, words, capsys):
    other = tmp_path / "arm-7"
    other.mkdir()
    for name in ("one", "two"):
        (other / name).symlink_to(folder / name)
    (other / "session.toml").write_text(text + "\n")
    assert run(["diagnose", str(other)]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize("rows", ["in another order", "half of them"])
def test_a_copy_tells_nothing_and_is_refused_whatever_its_order(tmp_path, rows, capsys):
    """It knows what the other knows: together they had told ripples of a joint that has none."""
    one = written(recorded("tip_position", 1, rippled, rows=20), tmp_path / "one")
    shutil.copytree(one, tmp_path / "copy")
    header, *lines = (one / "samples.csv").read_text().splitlines()
    lines = lines[::-1] if rows == "in another order" else lines[: len(lines) // 2]
    (tmp_path / "copy" / "samples.csv").write_text("\n".join([header, *lines]) + "\n")
    assert run(["diagnose", str(one), str(tmp_path / "copy")]) == 2
    assert ": given twice (as " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("samples.csv", "", "two/samples.csv: found an empty file"),
        (
            "dataset.toml",
            'observation = "motion"\n[robot]\nbundled = "ur5"\n',
            "two/samples.csv, row 1, column 'time': found no such column",
        ),
        ("dataset.toml", "a = ", "two/dataset.toml, row 1: found broken TOML"),
    ],
)
def test_a_fault_in_one_of_several_names_its_folder(folder, tmp_path, file, text, words, capsys):
    for name in ("one", "two"):
        shutil.copytree(folder / name, tmp_path / name)
    (tmp_path / "two" / file).write_text(text)
    robot = (folder / "session.toml").read_text().partition("[robot]")[2]
    whole = tmp_path / "session.toml"
    whole.write_text(f'recordings = ["one", "two"]\n[robot]{robot}')
    folders = [[tmp_path / "two", tmp_path / "one"]] if file == "dataset.toml" else []
    for asked in ([tmp_path], *folders):
        assert run(["diagnose", *map(str, asked)]) == 2
        told = capsys.readouterr().err
        assert words in told
        assert len(told.splitlines()) == 1


def test_a_session_is_told_what_to_record_next_with_one_of_its_devices(tmp_path, capsys):
    """Rows of the encoders' folder, by what tips and encoders together leave open."""
    for k, kind in enumerate(("tip_position", "joint_position")):
        part = recorded(kind, 60 + k, lambda q: 0.12 * rippled(q), rows=25)
        written(part, tmp_path / "arm" / kind, robot=None)
    (tmp_path / "arm" / "session.toml").write_text(
        'recordings = ["tip_position", "joint_position"]\n[robot]\nbundled = "ur5"\n'
    )
    out, table = tmp_path / "next.json", tmp_path / "next.csv"
    asked = ["next", str(tmp_path / "arm"), "--of", "joint_position", "--count", "2"]
    assert run([*asked, "--json", str(out), "--csv", str(table), "--quiet"]) == 0
    found = json.loads(out.read_text())
    assert found["recording"] == "joint_position"
    assert len(found["explanations"]) > 1
    assert [set(row) for row in found["rows"]] == [{"pose", "separates"}] * 2
    header, *rows = table.read_text().splitlines()
    assert "m1" in header
    assert len(rows) == 2
    assert run(["next", str(tmp_path / "arm"), "--of", "nobody"]) == 2
    assert "best matches" in capsys.readouterr().err


def test_what_only_one_recording_can_answer_is_refused_of_several(folder, capsys):
    assert run(["diagnose", str(folder), "--calibrate", "2"]) == 2
    assert "not for several recordings" in capsys.readouterr().err
