"""The harness beside the peers: every cell is filled, or says why not; the page says it plainly."""

import json
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from typer import Typer
from typer.testing import CliRunner

from plumbline.errors import PlumblineError
from plumbline.experiments.compare.__main__ import _cells, compare
from plumbline.experiments.compare.contests import CONTESTS, OURS, Contest, Way, phantoms, poses
from plumbline.experiments.compare.running import (
    PEERS,
    STAMP,
    Cell,
    EmptyCellError,
    cell,
    environment,
    page,
    verdict,
    written,
)

OWN = Way(OURS, "ours")


def few(build):
    """Five of the phantoms."""
    return {name: values[:5] if np.ndim(values) else values
            for name, values in phantoms(build).items()}  # fmt: skip


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    return written(few(Path()), tmp_path_factory.mktemp("given") / "registration.npz")


def contest(*ways, **more):
    return Contest("registration", "phantoms", "error [mm]", few, ways, **more)


def test_every_way_has_its_file_and_ours_comes_first():
    for one in CONTESTS:
        assert one.ways[0].peer == OURS
        assert not one.ways[0].needs
        for way in one.ways:
            assert way.peer == OURS or way.needs or one.is_time
            if way.peer != "acados":  # which is on no index, so that there is nothing to run
                code = (PEERS / f"{way.module}.py").read_text(encoding="utf-8")
                assert f"def {one.subject}(" in code
    modules = {way.module for one in CONTESTS for way in one.ways} - {"with_acados"}
    files = {path.stem for path in PEERS.glob("*.py")} - {"__init__", "run"}
    assert modules == files


def test_no_peer_sees_plumbline():
    for path in PEERS.glob("*.py"):
        if path.stem.startswith(("ours", "__init__")):
            continue
        code = path.read_text(encoding="utf-8").split('"""', 2)[2]
        assert "plumbline" not in code, path.name


def test_a_way_runs_in_a_process_of_its_own_and_its_cell_is_filled(given, tmp_path):
    found = cell(contest(OWN), OWN, given, tmp_path)
    assert not found.why
    assert 0.0 < found.error < 1.0
    assert found.seconds > 0.0
    assert 50e6 < found.memory < 1e9
    assert found.words.startswith("registration   plumbline")
    timed = cell(contest(OWN, is_time=True), OWN, given, tmp_path)
    assert (timed.error, timed.seconds, timed.memory) == (found.error, None, None)


@pytest.mark.parametrize(
    ("way", "subject", "why"),
    [("nobody", "registration", "No module named 'nobody'"), ("ours", "dh", "KeyError")],
)
def test_a_way_that_fails_says_why_in_its_cell(way, subject, why, given, tmp_path):
    asked = replace(contest(OWN), name=subject)
    found = cell(asked, replace(OWN, module=way), given, tmp_path)
    assert why in found.why
    assert found.error is None
    assert "\n" not in found.why


def test_an_environment_that_cannot_be_made_says_why(tmp_path, monkeypatch):
    def linked(folder, **_):
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "python").symlink_to(sys.executable)

    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_BREAK_SYSTEM_PACKAGES", "1")  # of which Debian says no sooner
    monkeypatch.setattr("venv.create", linked)
    way = Way("Nobody", "nobody", ("no-such-package-of-anybody",))
    with pytest.raises(EmptyCellError, match="No matching distribution found"):
        environment(tmp_path, way)


def test_an_environment_is_made_once(tmp_path, monkeypatch):
    folder = tmp_path / "mujoco-sysid"
    folder.mkdir()
    (folder / STAMP).write_text("mujoco\nscipy")
    way = Way("mujoco.sysid", "with_mujoco", ("mujoco", "scipy"))
    monkeypatch.setattr("venv.create", None)
    assert environment(tmp_path, way) == folder / "bin" / "python"
    assert environment(tmp_path, OWN) == Path(sys.executable)


def test_the_page_tells_losses_as_plainly_as_wins():
    mine = Cell("a", OURS, "1", 1.0, 2.0, 0.5, 200_000_000)
    other = Cell("a", "Other", "2", 3.0, 1.0, 0.1, 100_000_000)
    none = Cell("a", "Absent", why="ERROR: none")
    said = verdict([mine, other, none])
    assert "Other: we win figure by 3 times; we lose first call by 2 times, time by 5" in said
    assert "memory by 2 times" in said
    assert "Absent: not compared." in said
    one = Contest("a", "what", "figure", phantoms, ())
    text = page([one], [mine, other, none], day=date(2026, 1, 2), machine="here", floor=7.0)
    assert "2026-01-02" in text
    assert "| Absent | - | - | - | - | - | not run: ERROR: none |" in text


def test_the_command_writes_what_is_asked_for(given, tmp_path, monkeypatch):
    here = "plumbline.experiments.compare.__main__.CONTESTS"
    monkeypatch.setattr(here, (contest(OWN),))
    app = Typer()
    app.command()(compare)
    out = ["--json", str(tmp_path / "c.json"), "--out", str(tmp_path / "c.md")]
    done = CliRunner().invoke(app, [*out, "--build", str(tmp_path / "b"), "--quiet"])
    assert done.exit_code == 0
    assert json.loads((tmp_path / "c.json").read_text())[0]["peer"] == OURS
    refused = CliRunner().invoke(app, ["--only", "nothing"])
    assert refused.exit_code == 2
    assert "--only 'nothing' not recognised; known: registration" in refused.output


def test_data_that_are_not_to_be_had_leave_the_cells_empty_with_the_reason(tmp_path):
    def none(build):
        raise PlumblineError("no such data here")

    asked = replace(CONTESTS[0], given=none)
    found = _cells(asked, tmp_path, quiet=True)
    assert [one.why for one in found] == ["no such data here"] * len(asked.ways)


def test_data_are_the_same_every_time():
    for make in (phantoms, poses):
        one, two = make(Path()), make(Path())
        assert all(np.array_equal(one[key], two[key]) for key in one)
