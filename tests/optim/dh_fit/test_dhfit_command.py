"""``plumbline dhfit``: words, JSON and files; one line when it cannot."""

import json
import shutil
import tomllib

import numpy as np
import pytest

from plumbline.experiments.commands.app import run
from plumbline.kinematics.robot import Robot
from tests.dh_sessions import session
from tests.made_up_diagnosis import BENCH
from tests.refusals import refused


@pytest.fixture
def folder(tmp_path):
    """A recording of the BH-7."""
    simulated = session(0)
    place = tmp_path / "bh7"
    place.mkdir()
    (place / "dataset.toml").write_text(
        'name = "operating-room"\nobservation = "tip_position"\n'
        '[robot]\nbundled = "bh7"\n[fit]\nalways = ["frame"]\n'
    )
    table = np.hstack([simulated.q, simulated.tips])
    lines = [",".join(f"{value:.9g}" for value in row) for row in table]
    (place / "samples.csv").write_text("\n".join(["q1,q2,q3,q4,q5,x,y,z", *lines]) + "\n")
    return place


def test_it_fits_prints_and_writes_what_can_be_read_again(folder, tmp_path, capsys):
    urdf, toml, out = (tmp_path / name for name in ("fit.urdf", "fit.toml", "fit.json"))
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    arguments = ["dhfit", folder, "--urdf", urdf, "--toml", toml, "--json", out]
    assert run([str(a) for a in arguments]) == 0
    said = capsys.readouterr().out
    assert "move together" in said
    assert "read again" in said
    found = json.loads(out.read_text())
    assert found["after"]["mean"] < 0.1 * found["before"]["mean"]
    assert found["held_out"]["after"]["rms"] < 0.2 * found["held_out"]["before"]["rms"]
    assert all(f["largest_error"] < 1e-9 for f in found["files"].values())
    assert found["remarks"] == []
    assert found["gross_rows"] == []
    for quantity in found["quantities"]:
        assert quantity["ci95"][0] < quantity["value"] < quantity["ci95"][1]
    assert 0.9 < found["explained_together"] <= 1.0
    statuses = {p["status"] for p in found["parameters"]}
    assert statuses >= {"identified", "not identifiable"}
    rows = tomllib.loads(toml.read_text())
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 5))
    one = Robot.from_urdf(urdf).chain(found["files"]["urdf"]["tip_frame"]).placement(q)
    two = Robot.from_dh(rows["dh"], tip_frame=rows["tip_frame"]).chain().placement(q)
    assert np.allclose(one, two, rtol=0, atol=1e-9)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_gross_rows_are_named_as_an_editor_counts_them(folder, capsys, tmp_path):
    table = folder / "samples.csv"
    lines = table.read_text().splitlines()
    cells = lines[16].split(",")
    lines[16] = ",".join([*cells[:-1], str(float(cells[-1]) + 0.05)])
    table.write_text("\n".join(lines) + "\n")
    out = tmp_path / "fit.json"
    assert run(["dhfit", str(folder), "--json", str(out)]) == 0
    assert "17 (5" in capsys.readouterr().out
    (row,) = json.loads(out.read_text())["gross_rows"]
    assert (row["row"], row["index"]) == (17, 15)
    assert 0.03 < row["misfit"] < 0.06


def test_more_than_the_stated_noise_is_said(folder, capsys):
    settings = folder / "dataset.toml"
    settings.write_text(settings.read_text().replace("[robot]", "noise_std = 1e-5\n[robot]"))
    assert run(["dhfit", str(folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "links are not the (whole) cause; run plumbline diagnose" in said
    assert "stated: 0.010 mm" in said


def test_a_mirrored_device_is_refused(folder, capsys):
    table = folder / "samples.csv"
    head, *lines = table.read_text().splitlines()
    rows = [line.rsplit(",", 1) for line in lines]
    table.write_text("\n".join([head, *(f"{a},{-float(z):.9g}" for a, z in rows)]) + "\n")
    assert "left-handed" in refused(capsys, "dhfit", folder)


def test_json_alone_goes_to_standard_output(folder, capsys):
    options = ["--objective", "squares", "--frame", "registration", "--parameters", "all"]
    assert run(["dhfit", str(folder), "--json", "-", "--no-tilts", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["objective"]["name"] == "squares"
    assert found["frame"] == "registration"
    points = found["registration_points"]
    assert 0.0 < points["after"]["mean"] < points["before"]["mean"] != found["before"]["mean"]


def test_a_recording_of_another_robot_is_fitted_by_the_same_command(capsys):
    assert run(["dhfit", str(BENCH), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_files_of_the_user_are_safe(folder, tmp_path, capsys):
    there = tmp_path / "mine.urdf"
    there.write_text("mine")
    assert "is there already" in refused(capsys, "dhfit", folder, "--urdf", there)
    assert there.read_text() == "mine"
    inside = folder / "fit.toml"
    assert "never written to" in refused(capsys, "dhfit", folder, "--toml", inside)
    same = tmp_path / "one"
    assert "both name" in refused(capsys, "dhfit", folder, "--toml", same, "--urdf", same)
    assert "name a file" in refused(capsys, "dhfit", folder, "--urdf", "-")
    assert run(["dhfit", str(folder), "--urdf", str(there), "--force", "--quiet"]) == 0
    assert there.read_text().startswith("<robot")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--delta-length", "0"), "delta_length"),
        (("--delta-angle", "nan"), "delta_angle"),
        (("--smoothing", "-1"), "smoothing"),
        (("--solver", "magic"), "magic"),
        (("--held-out", "groups"), "no column 'group'"),
    ],
)
def test_options_that_make_no_sense_are_refused(folder, capsys, options, words):
    assert words in refused(capsys, "dhfit", folder, *options)


def test_too_few_readings_are_refused(folder, tmp_path, capsys):
    few = shutil.copytree(folder, tmp_path / "few")
    lines = (few / "samples.csv").read_text().splitlines(keepends=True)
    (few / "samples.csv").write_text("".join(lines[:5]))
    refused(capsys, "dhfit", few)


def test_a_list_of_what_hardly_differs_is_cut_and_its_strongest_said_first(tmp_path, capsys):
    place = tmp_path / "few"
    shutil.copytree(BENCH, place)
    samples = place / "samples.csv"
    samples.write_text("\n".join(samples.read_text().splitlines()[:11]) + "\n")
    assert run(["dhfit", str(place)]) == 0
    said = capsys.readouterr().out
    sizes = [abs(float(line.split()[-1])) for line in said.splitlines() if "are correlated" in line]
    assert len(sizes) == 6
    assert sizes == sorted(sizes, reverse=True)
    assert "more pairs above 0.9: vary the poses more" in said
