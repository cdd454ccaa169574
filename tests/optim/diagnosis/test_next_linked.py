"""Laws of rows to record next where joints follow others: proposed as they move, written as read.

The robot has two arms of three joints, in each of which the second follows the first by a linkage.
"""

import csv
import io

import numpy as np
import pytest

from plumbline.experiments.commands.next import table_to_fill
from plumbline.optim.diagnosis.design.future_rows import (
    LIMITS,
    RECORDED,
    _brought_to,
    changed_in_one,
    draw_rows,
)
from plumbline.optim.diagnosis.design.next_experiment import NextExperiment, Suggestion
from plumbline.optim.recording.loading import load_recording
from tests.optim.recording.test_couplings import LINKED, linked

OFFSET = [0.1, 0.0, 0.1]
ALL = ",".join(f"q{k}" for k in range(1, 7))


def recorded(tmp_path, header="q1,q2,direction1,direction2", arm="left", extra=""):
    """A recording of one arm with these columns of joints, the drives of both arms or all."""
    drives = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    rows = linked(drives)
    given = {f"q{k}": drives[:, k - 1] for k in (1, 2)}
    if "q3" in header:
        given = {f"q{k}": column for k, column in enumerate(np.hstack([rows, rows]).T, start=1)}
    given |= {"direction1": np.ones(20), "direction2": np.where(np.arange(20) % 2, 1.0, -1.0)}
    (tmp_path / "robot.urdf").write_text(LINKED.urdf, encoding="utf-8")
    (tmp_path / "dataset.toml").write_text(
        f'observation = "tip_position"\n[robot]\nurdf = "robot.urdf"\ntip_frame = "{arm}3"\n'
        f"{extra}\n[tool]\noffset = {OFFSET}\n",
        encoding="utf-8",
    )
    tips = LINKED.chain(f"{arm}3").tips(rows, OFFSET)
    table = np.column_stack([*(given[name] for name in header.split(",")), tips])
    whole = f"{header},x,y,z"
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header=whole, comments="")
    return load_recording(tmp_path)


@pytest.mark.parametrize("within", [RECORDED, LIMITS])
@pytest.mark.parametrize("header", ["q1,q2,direction1,direction2", ALL])
def test_no_row_to_come_moves_a_follower_alone(tmp_path, header, within):
    recording = recorded(tmp_path, header)
    rows = draw_rows(recording, 50, 0, within=within)
    tried = changed_in_one(recording, rows.select([3]), [0, 1], within=within)
    assert len(rows) == 50
    assert np.ptp(tried.q[:, 2]) > 0.5
    for found in (rows, tried):
        np.testing.assert_allclose(found.q[:, 1], -0.8 * found.q[:, 0], atol=1e-12)
        if found.direction is not None:
            np.testing.assert_array_equal(found.direction[:, 1], -found.direction[:, 0])


@pytest.mark.parametrize("aside", [0.0, 0.05])  # the second is beyond what two drives reach
def test_a_posture_is_brought_towards_a_place_by_what_moves_on_its_own(tmp_path, aside):
    recording = recorded(tmp_path)
    goal = recording.chain.tips(linked(np.array([[0.4, -0.3]])), recording.tool_offset)
    q = _brought_to(recording, linked(np.array([[0.1, 0.2]])), goal + np.array([0.0, 0.0, aside]))
    np.testing.assert_allclose(q[:, 1], -0.8 * q[:, 0], atol=1e-12)
    miss = np.linalg.norm(recording.chain.tips(q, recording.tool_offset) - goal)
    assert miss < (0.05 if aside else 1e-6)


def written_and_read(tmp_path, recording, q):
    """The postures (N, 3) that a table to be filled in is read as, once it is filled in."""
    rows = tuple(
        Suggestion(
            pose=tuple(row),
            direction=(1, -1, -1) if recording.direction is not None else None,
            velocity=None, wait=None, payload=None, socket=None, separates=("a", "b"), group=None,
        )
        for row in q
    )  # fmt: skip
    found = NextExperiment(rows, ("a", "b"), (0.5, 0.5), None, ())
    text = table_to_fill(tmp_path, recording, found)
    samples = tmp_path / "samples.csv"
    header, *old = [line.split(",") for line in samples.read_text().splitlines()]
    planned = list(csv.reader(io.StringIO(text)))
    assert planned[0] == header
    pairs = zip(planned[1:], old[: len(q)], strict=True)
    filled = [[a or b for a, b in zip(p, o, strict=True)] for p, o in pairs]
    of_arm = [k for k, name in enumerate(header) if name in used(recording, header)]
    assert all(row[k] for row in planned[1:] for k in of_arm)
    samples.write_text("\n".join(",".join(row) for row in [header, *old, *filled]) + "\n")
    return load_recording(tmp_path)


def used(recording, header):
    """The file's columns of the chain's own joints."""
    return {recording.in_file.get(f"q{k}", f"q{k}") for k in (1, 2, 3)} & set(header)


@pytest.mark.parametrize("header", ["q1,q2,direction1,direction2", ALL])
@pytest.mark.parametrize("arm", ["left", "right"])
def test_rows_are_written_in_the_columns_that_the_file_has_and_read_as_proposed(
    tmp_path, header, arm
):
    recording = recorded(tmp_path, header, arm)
    q = linked(np.array([[0.4, -0.3], [-0.2, 0.6]]))
    longer = written_and_read(tmp_path, recording, q)
    np.testing.assert_allclose(longer.q[-2:], q, atol=1e-8)
    if recording.direction is not None:
        assert longer.direction[-2:].tolist() == [[1.0, -1.0, -1.0]] * 2


def test_a_reading_that_another_joint_moves_is_written_as_the_file_has_it(tmp_path):
    recording = recorded(tmp_path, extra="couplings = [[3, 1, -0.4]]")
    q = linked(np.array([[0.4, -0.3], [-0.2, 0.6]]))
    longer = written_and_read(tmp_path, recording, q)
    np.testing.assert_allclose(longer.q[-2:], q, atol=1e-8)
