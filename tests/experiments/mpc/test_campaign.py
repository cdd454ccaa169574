"""The campaign sees what it must: every millisecond, whole shafts, all depths, fast obstacles."""

import numpy as np
import pytest

from plumbline.experiments.mpc.campaign import V_MAX, task
from plumbline.experiments.mpc.closed_loop import SUBSTEPS, judged, known_delay, noise_for
from plumbline.experiments.mpc.foresight import (
    FORESIGHT,
    WINS,
    Tried,
    cells,
    compared,
    figures,
    gain,
)
from plumbline.experiments.reality.instruments import Instruments, Mismatch, Plant
from plumbline.experiments.reality.mpc_scenarios import BLOCKED, CLEAR, FAMILIES, draw
from plumbline.experiments.reality.task import DEPTHS, Scenario, Swing
from plumbline.experiments.reality.touch import AGREE, Touch, all_pairs, segment_distances
from plumbline.optim.capsule_mpc import RealTime

DT = 0.02  # [s] of a control step
PLAIN = RealTime(compiled=False)


def resting(obstacles=(), tips=((0.0, 0.0, -100.0),), trocars=((0.0, 0.0, 0.0),)):
    """A scene of instruments that rest, and their motion over ten control steps (201, I, 3)."""
    tips, trocars = np.array(tips), np.array(trocars)
    count = len(tips)
    kit = Instruments(trocars, np.full(count, 250.0), np.full(count, 2.5))
    scene = Scenario("made up", 0, kit, tips, tips, tuple(obstacles), Mismatch())
    return scene, np.repeat(tips[None], 201, axis=0)


def test_what_happens_between_two_samples_is_judged():
    # 1 m/s through a standing shaft, 10 mm off it at both of the samples around.
    flier = Swing(
        np.array([[-10.0, 0.0, -60.0]] * 2) - [60.0, 0, 0], 2.0, np.zeros(3), drift=(1e3, 0, 0)
    )
    scene, motion = resting([flier])
    assert judged(scene, motion, DT) == pytest.approx(-4.5, abs=1e-9)
    samples = scene.motion(motion[::SUBSTEPS], DT * np.arange(11))
    assert scene.touch().least(samples).clearance == pytest.approx(5.5, abs=1e-9)


def test_a_contact_of_four_milliseconds_is_seen():
    # Missed by a judge who looks every 5 ms: 2.6 mm of chord at 1 m/s.
    flier = Swing(np.array([[-62.5, 4.3, -60.0]] * 2), 2.0, np.zeros(3), drift=(1000.0, 0.0, 0.0))
    scene, motion = resting([flier])
    clearance = judged(scene, motion, DT)
    ends = scene.motion(motion, 0.001 * np.arange(201))
    assert scene.touch().least(ends[::5]).clearance > 0.0
    assert clearance < 0.0


def test_outer_ends_are_judged_as_well():
    # Tips 40 mm apart, shafts that cross 100 mm above the trocars.
    tips = [[-20.0, 0.0, -20.0], [20.0, 0.0, -20.0]]
    trocars = [[-100.0 / 6, 0.0, 0.0], [100.0 / 6, 0.0, 0.0]]
    assert judged(*resting((), tips, trocars), DT) == pytest.approx(-5.0, abs=1e-6)


def test_arithmetic_and_coal_agree_on_crossing_parallel_and_short_capsules():
    rng = np.random.default_rng(0)
    ends = rng.normal(scale=50.0, size=(300, 4, 2, 3))
    ends[::3, 1] = ends[::3, 0] + rng.normal(size=(100, 1, 3))
    ends[::4, 2, 1] = ends[::4, 2, 0]
    touch = Touch(all_pairs(2, 2), np.full(4, 2.5))
    one, two = ends[:, touch.pairs[:, 0]], ends[:, touch.pairs[:, 1]]
    coal = np.array([touch.clearances(moment) for moment in ends])
    assert np.abs(segment_distances(one, two) - 5.0 - coal).max() < 1e-4
    found = touch.least(ends)
    assert found.clearance == coal.min()
    assert found.moment == coal.min(axis=1).argmin()
    assert len(touch.pairs) <= found.asked < found.looked == coal.size


def test_a_judge_whose_arithmetic_is_wrong_says_so(monkeypatch):
    touch = Touch(all_pairs(2, 0), np.full(2, 2.5))
    ends = np.random.default_rng(0).normal(scale=50.0, size=(10, 2, 2, 3))
    wrong = "plumbline.experiments.reality.touch.segment_distances"
    monkeypatch.setattr(wrong, lambda one, two: segment_distances(one, two) + 2 * AGREE)
    with pytest.raises(RuntimeError, match=r"coal and arithmetic differ by 0\.002 mm"):
        touch.least(ends)


def test_weak_drives_change_a_speed_no_faster_than_they_can():
    start = np.array([[0.0, 0.0, -100.0]])
    plant = Plant(start, Mismatch(acceleration=400.0), DT, 20, np.random.default_rng(0))
    speeds = np.diff(np.concatenate([start[None], plant.move(np.full((1, 3), 60.0))]), axis=0)
    gained = np.linalg.norm(np.diff(speeds / 0.001, axis=0), axis=-1)
    assert gained.max() == pytest.approx(0.4, rel=1e-9)
    assert np.linalg.norm(plant.speed) == pytest.approx(8.0, rel=1e-9)


def test_whole_steps_of_delay_are_known_and_the_rest_is_margin():
    late = Mismatch(delay=0.105)
    assert known_delay(late) == 5
    assert noise_for(late, V_MAX).bias == pytest.approx(
        noise_for(Mismatch(delay=0.005), V_MAX).bias
    )
    assert known_delay(Mismatch(delay=0.06)) == 3


def test_depths_speeds_and_instruments_are_drawn_over_all_that_is_allowed():
    drawn = [draw(family, 1000 + k) for family in FAMILIES for k in range(6)]
    below = [np.linalg.norm(s.starts - s.instruments.trocars, axis=1) for s in drawn]
    depths, speeds = np.concatenate(below), [o.speed for s in drawn for o in s.obstacles]
    assert DEPTHS[0] <= depths.min() < 20.0
    assert 215.0 < depths.max() <= DEPTHS[1]
    assert DEPTHS[0] > 15.0
    assert DEPTHS[1] < 230.0
    assert 700.0 < max(speeds) <= 1000.0 + 1e-9
    assert {len(s.starts) for s in drawn} == {2, 3, 4}
    assert all((s.starts - s.instruments.trocars)[:, 2].max() < 0.0 for s in drawn)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_straight_way_fails_and_who_waits_is_safe(family):
    for seed in (3, 4):
        scene = draw(family, seed)
        assert scene.straight() < BLOCKED
        if max((o.speed for o in scene.obstacles), default=0.0) > 20.0:
            assert scene.clearance(scene.starts, np.arange(0.0, 6.0, 0.005)) >= CLEAR


def test_an_obstacle_faster_than_any_tip_passes_clear_of_the_straight_way():
    rng, fastest = np.random.default_rng(0), 0.0
    for seed in range(6):
        scene = draw("fast obstacle", seed)
        speed = max(o.speed for o in scene.obstacles)
        fastest, touch = max(fastest, speed), scene.touch()
        others = [k for k, (_, j) in enumerate(touch.pairs) if j >= len(scene.starts)]
        for share, time in rng.uniform(0.0, [1.0, 3.0], (40 if speed > 60.0 else 0, 2)):
            tips = scene.starts + share * (scene.goals - scene.starts)
            assert touch.clearances(scene.capsules(tips, time))[others].min() > 0.9 * CLEAR
    assert fastest > 300.0


def test_shallow_shafts_do_not_pass_through_each_other_between_samples():
    shallow = list(FAMILIES).index("shallow")
    found = [task(shallow + k * len(FAMILIES), 0, PLAIN, most=150) for k in (1, 3)]
    assert min(run.clearance for run in found) > 0.0


def test_a_run_is_recorded_at_every_millisecond():
    found = task(0, 0, PLAIN, most=20)
    assert found.tips.shape[0] == 20 * found.steps + 1
    assert found.clearance == judged(draw(found.family, found.seed), found.tips, DT)


def test_foresight_is_compared_on_the_same_tasks():
    found = compared(1, 0, compiled=False, families=("narrow pass",))
    assert [(t.controller, t.guided) for t in found] == [
        ("horizon", True),
        ("one step", True),
        ("horizon", False),
        ("one step", False),
    ]
    assert all(t.tasks == 1 and t.done + t.contacts <= 1 for t in found)
    assert [len(row) for row in cells(found)] == [5, 5]


def test_a_horizon_wins_by_ten_points_or_not_at_all():
    def tried(name, guided, count):
        return Tried("delay", name, guided, 100, count, 0, 1.0, 1.0)

    both = [tried("one step", g, 80) for g in (True, False)]
    near = [*both, tried("horizon", True, 89), tried("horizon", False, 91)]
    assert WINS == 0.10
    assert gain(near, True) == pytest.approx(0.09)
    assert not figures(near)["guided"]["horizon_wins"]
    assert figures(near)["unguided"]["horizon_wins"]
    assert set(FORESIGHT) >= {"narrow pass", "dead end", "several arms", "delay", "weak drives"}
