"""The plant, the tasks, and the loop around them."""

import json

import numpy as np
import pytest
from PIL import Image

from plumbline.experiments.commands.app import run as command_line
from plumbline.experiments.mpc.campaign import task
from plumbline.experiments.mpc.closed_loop import noise_for
from plumbline.experiments.reality.instruments import Instruments, Mismatch, Plant
from plumbline.experiments.reality.mpc_scenarios import CLEAR, FAMILIES, STATED, draw
from plumbline.experiments.report.mpc.motion import clearances, film
from plumbline.optim.capsule_mpc import OneStep, RealTime

PLAIN = RealTime(compiled=False)


def plant(seed=0, **mismatch):
    """A plant of two tips at rest."""
    tips = np.array([[0.0, 0.0, -100.0], [50.0, 0.0, -100.0]])
    return Plant(tips, Mismatch(**mismatch), 0.02, 4, np.random.default_rng(seed))


RATE = np.array([[30.0, -20.0, 10.0], [0.0, 5.0, -40.0]])


def test_a_plant_without_mismatch_is_the_model():
    own = plant()
    start = own.tips
    for _ in range(5):
        own.move(RATE)
    assert np.abs(own.tips - start - 5 * 0.02 * RATE).max() < 1e-12
    assert np.array_equal(own.measure(), own.tips)


def test_a_lag_loses_its_time_constant():
    own = plant(lag=0.03)
    start = own.tips
    for _ in range(50):
        own.move(RATE)
    # The h / 2 is that of the substeps' own rule.
    lost = (own.tips - start - 50 * 0.02 * RATE) / -RATE.clip(1.0)
    assert (own.tips - start)[0, 0] == pytest.approx(30.0 * (1.0 - 0.03 + 0.0025), rel=1e-2)
    assert np.isfinite(lost).all()


def test_a_delay_shifts_and_a_dead_band_swallows():
    own = plant(delay=0.01)
    way = own.move(RATE)
    assert np.abs(way[:2] - plant().tips).max() == 0.0
    assert np.abs(way[3] - plant().tips - 0.01 * RATE).max() < 1e-12
    quiet = plant(deadband=12.0)
    moved = quiet.move(RATE)[-1] - plant().tips
    assert np.array_equal(moved != 0.0, np.abs(RATE) >= 12.0)


def test_gain_errors_stay_within_what_was_stated():
    gains = np.array([plant(seed, gain=0.05).gain for seed in range(200)])
    assert np.abs(gains - 1.0).max() <= 0.05
    assert np.abs(gains - 1.0).max() > 0.045


def test_noise_has_the_stated_size():
    own = plant(measured=0.1, shake=0.03)
    seen = np.array([own.measure() - own.tips for _ in range(4000)])
    assert seen.std() == pytest.approx(0.1, rel=0.03)
    ends = np.array([own.move(np.zeros((2, 3)))[-1] for _ in range(4000)])
    assert np.diff(ends, axis=0).std() == pytest.approx(0.03, rel=0.03)


def test_shafts_pass_through_their_trocars():
    kit = Instruments(np.array([[5.0, 0, 0], [0, 9.0, 0]]), np.array([250.0, 200.0]), np.ones(2))
    tips = np.random.default_rng(0).uniform(-50, 50, (7, 2, 3)) - [0, 0, 100]
    shafts = kit.shafts(tips)
    way = shafts[..., 0, :] - shafts[..., 1, :]
    assert np.allclose(np.linalg.norm(way, axis=-1), kit.lengths)
    assert np.abs(np.cross(kit.trocars - tips, way)).max() < 1e-8


@pytest.mark.parametrize("family", FAMILIES)
def test_a_task_is_drawn_from_its_seed_and_is_clear(family):
    one, again, other = draw(family, 5), draw(family, 5), draw(family, 6)
    assert np.array_equal(one.starts, again.starts)
    assert not np.array_equal(one.starts, other.starts)
    assert one.clearance(one.starts, np.zeros(1)) >= CLEAR
    assert one.clearance(one.goals, np.linspace(0.0, 20.0, 41)) >= CLEAR


@pytest.mark.parametrize("number", range(len(FAMILIES)))
def test_a_task_of_every_family_is_done_without_contact(number):
    found = task(number, 0, OneStep(compiled=False))
    assert found.reached
    assert found.clearance > 2.0


def test_without_a_way_around_a_dead_end_stays_one():
    dead_end = list(FAMILIES).index("dead end")
    found = task(dead_end, 0, OneStep(compiled=False), guided=False, most=150)
    assert not found.reached
    assert found.clearance > 1.0


def test_the_recorded_clearance_is_that_of_the_recorded_motion():
    found = task(1, 3, PLAIN)
    scenario = draw(found.family, found.seed)
    assert clearances(scenario, found)[1:].min() == pytest.approx(found.clearance, abs=1e-9)


def test_the_stated_bias_covers_what_a_rate_carries_on():
    m = Mismatch(lag=0.006, delay=0.005)
    own = Plant(np.zeros((1, 3)) - 100.0, m, 0.02, 4, np.random.default_rng(0))
    for _ in range(20):
        own.move(np.full((1, 3), 60.0))
    before = own.tips
    for _ in range(10):
        own.move(np.zeros((1, 3)))
    assert (own.tips - before).max() <= 1e3 * noise_for(m, 60.0).bias + 1e-9
    assert STATED.lag > 0.0


def test_a_film_shows_every_frame_on_paper(tmp_path):
    found = task(0, 1, PLAIN)
    path = tmp_path / "motion.gif"
    frames = film(draw(found.family, found.seed), found, path, 2.0, every=750)
    with Image.open(path) as picture:
        assert 1 < picture.n_frames <= frames
        pixels = []
        for k in (0, picture.n_frames - 1):
            picture.seek(k)
            pixels.append(np.asarray(picture.convert("RGB")).copy())
    assert (pixels[0] != pixels[1]).any()
    assert (pixels[0][0, 0] == 255).all()


def test_the_command_reproduces_the_controller(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("plumbline.experiments.reproduce.mpc.EACH", 1)
    monkeypatch.setattr("plumbline.experiments.reproduce.mpc.PASSES", 2)
    monkeypatch.setattr("plumbline.experiments.reproduce.mpc.FORESEEN", 1)
    monkeypatch.setattr("plumbline.experiments.reproduce.mpc.COMPARED", ("narrow pass",))
    out = tmp_path / "mpc.json"
    assert command_line(["reproduce", "mpc", "--seed", "3", "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    assert found["scenarios"] == len(FAMILIES)
    assert found["collisions"] == 0
    assert found["min_clearance"]["value"] > 2.0
    assert set(found["step_ms"]) >= {"p50", "p99", "max"}
    assert found["goals_reached"]["value"] >= 0.9
    assert found["foresight"]["guided"]["horizon"] == 1.0
    assert found["parallel_clearance"]["value"] > found["parallel_clearance"]["scalar"]
    assert "parallel passes" in capsys.readouterr().out
