"""A board that was moved, a finder's zero that creeps, a CT that is sheared: no base, no scale."""

import numpy as np
import pytest

from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.discrepancy.part_dependences import part_dependences
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.loading import load_to_diagnose
from plumbline.optim.measurement.observation import build_model
from tests.part_cases import RangePlan, fiducials, ranges

MOTIONS = RangePlan(rows=120, motions=12, poses=True)


def board_moved(folder, to, by):
    """The same readings, had board 2 been moved towards the finder by that much half-way [m]."""
    lines = (folder / "samples.csv").read_text().split()
    head, rows = lines[0].split(","), [line.split(",") for line in lines[1:]]
    read, plane = head.index("range"), head.index("plane")
    for row in rows[len(rows) // 2 :]:
        row[read] = repr(float(row[read]) + by * (row[plane] == "2"))
    (to / "dataset.toml").write_text((folder / "dataset.toml").read_text())
    (to / "samples.csv").write_text("\n".join([lines[0], *map(",".join, rows), ""]))
    return load_to_diagnose(to)


@pytest.mark.parametrize("seed", [4, 5])
def test_one_board_that_was_moved_is_no_base_that_was_bumped(tmp_path, seed):
    verdict = diagnose(board_moved(ranges(None, 2.5, seed, MOTIONS)[0], tmp_path, 6e-4)).verdict
    assert not verdict.causes
    assert verdict.outside_probability > 0.9
    assert "plane 2" in verdict.outside_depends_on


def plain(folder):
    """Recording, ports and what is offered with one number."""
    recording = load_to_diagnose(folder)
    model = build_model(recording)
    ports = Ports.about(model, model.start, np.arange(len(recording)))
    offered = part_dependences(recording, ports)
    return recording, ports, [f for f in offered if len(f.columns) == 1]


def nearest(offered, wanted):
    """The least share of a course (N, m) that one of the offered, about its mean, leaves."""
    flat = [f.columns[0] - f.columns[0].mean(axis=0) for f in offered]
    wanted = wanted - wanted.mean(axis=0)
    left = [wanted - f * np.sum(f * wanted) / np.sum(f * f) for f in flat]
    return min(map(np.linalg.norm, left)) / np.linalg.norm(wanted)


def test_a_finders_zero_may_creep_as_simply_as_a_base_drifts():
    recording, ports, offered = plain(ranges(None, 2.5, 4, MOTIONS)[0])
    own = [f for f in offered if (f.stage, f.element, f.on) == ("sensor", None, "time")]
    share = (recording.time - recording.time[0]) / np.ptp(recording.time)
    assert nearest(own, share[:, None] * ports.shift[0]) < 1e-6
    assert nearest(own, -np.expm1(-share / 0.5)[:, None] * ports.shift[0]) < 1e-6


def test_ct_may_be_sheared_as_simply_as_it_is_scaled():
    recording, ports, offered = plain(fiducials(None)[0])
    own = [f for f in offered if f.on == "place"]
    for lean, axis in ((0, 1), (0, 2), (1, 2)):
        assert nearest(own, recording.q[:, lean, None] * ports.joint[axis]) < 1e-6
