"""Regions hold in realities unlike the model, and what is called good is near."""

import json

import numpy as np
import pytest

from plumbline.experiments.benches import registration_coverage as bench
from plumbline.experiments.benches.registration_coverage import (
    REALITIES,
    SLICES,
    STATED,
    Reality,
    draw,
    measured,
)

DRAWS = 25
AXIS = "half axis [mm]"
LEAST = 0.81  # of 25 draws: three errors of a share of 95 %


@pytest.mark.parametrize("name", [r for r in REALITIES if r != "one moved"])
def test_targets_lie_in_their_regions(name):
    for n, stated in ((3, "rightly"), (6, "not")):
        cell = measured(name, n, stated, DRAWS, seed=1)
        assert cell["held"].value >= LEAST, cell
        assert cell["known"] >= 0.95 * DRAWS
        assert cell["good and near"] >= cell["good"] - 2


def test_noise_stated_too_small_is_mostly_mended_by_the_misfits():
    cells = [measured("as the model", n, "1.5 x too small", DRAWS, seed=1) for n in (4, 6)]
    assert all(cell["held"].value >= 0.75 for cell in cells)
    right = measured("as the model", 6, "rightly", DRAWS, seed=1)
    assert cells[1][AXIS] < right[AXIS] < 1.5 * cells[1][AXIS]


@pytest.mark.parametrize("stated", STATED)
def test_three_markers_of_which_one_moved_are_not_known_or_never_good(stated):
    cell = measured("one moved", 3, stated, 30, seed=1)
    assert cell["good"] == 0
    assert cell["known"] < 15


def test_a_draw_is_what_its_reality_says():
    rng = np.random.default_rng(0)
    still = Reality(pitch=(1e-9, 1e-9, 1e-9), together=0.3e-3)
    drawn = draw(still, 6, rng)
    assert drawn.ct.shape == (7, 3)
    plain = [draw(Reality(), 40, np.random.default_rng(k)) for k in range(30)]
    tails = [draw(Reality(tails=3.0), 40, np.random.default_rng(k)) for k in range(30)]
    gaps = [_misfits(draws) for draws in (plain, tails)]
    assert np.mean(gaps[0] ** 2) == pytest.approx(np.mean(gaps[1] ** 2), rel=0.25)
    assert np.mean(np.abs(gaps[1]) ** 4) > 2.0 * np.mean(np.abs(gaps[0]) ** 4)
    rounded = draw(Reality(SLICES, rounded=True), 40, rng).ct
    for axis, pitch in enumerate(SLICES):
        steps = (rounded[:, axis] - rounded[0, axis]) / pitch
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def _misfits(draws):
    """Coordinates of the misfits of plain fits."""
    from plumbline.optim.rigid import rigid_match

    found = []
    for d in draws:
        T = rigid_match(d.ct[:-1], d.robot)
        found.append(d.ct[:-1] @ T[:3, :3].T + T[:3, 3] - d.robot)
    return np.concatenate(found)


def test_the_command_prints_and_writes_each_cell(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(bench, "MARKERS", (3, 4))
    out = tmp_path / "out.json"
    bench.coverage(draws=2, seed=0, json=str(out))
    generator, cells = json.loads(out.read_text()).values()
    assert generator == "plumbline"
    assert len(cells) == len(STATED) * len(REALITIES) * 2
    unknown = [cell for cell in cells if cell["markers"] == 3 and cell["noise"] == "not"]
    assert all(cell["held"]["of"] == 0 and cell[AXIS] is None for cell in unknown)
    assert "as the model" in capsys.readouterr().out
