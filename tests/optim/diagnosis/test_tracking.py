"""Tips under commanded rates: what carries the rates out is found, and a controller is told."""

import json
from dataclasses import replace

import numpy as np
import pytest

from plumbline import build_tracking, diagnose, load
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run as command_line
from plumbline.experiments.mpc.tracked import followed
from plumbline.experiments.reality.instruments import Slides, SlidingTips
from plumbline.kinematics.effects.actuation_deadband import ActuationDeadband
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.law import Law
from plumbline.optim.capsule_mpc import OneStep, Plant, Statement, TipInstrument
from plumbline.optim.capsule_mpc.underway import Underway
from plumbline.optim.diagnosis.findings import Outcome
from plumbline.optim.diagnosis.motion import rollout
from plumbline.optim.diagnosis.motion.rollout import roll_out
from plumbline.optim.diagnosis.motion.signals import signals_of
from tests.motions import recorded

DT, NOISE = 0.02, 0.05  # [s], [mm]
ONE = Statement((TipInstrument((0.0, 0.0, 0.0)),), 0)
WRONG = Slides(delay=0.05, lag=0.04, gain=np.array([0.05, -0.04, 0]), band=np.array([3.0, 0, 0]))


def shaken(wrong, axes=2, seconds=12.0, noise=NOISE):
    """Times, rates [m/s] and seen states [m] of some axes of a tip under several sines."""
    rng = np.random.default_rng(3)
    tips = SlidingTips(np.array([[0.0, 0.0, -100.0]]), wrong, DT, 20, rng)
    t = np.arange(0.0, seconds, DT)
    f, phase = rng.uniform(0.1, 2.0, (4, 3)), rng.uniform(0.0, 6.3, (4, 3))
    rate = 15.0 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)
    seen = []
    for row in rate:
        seen.append(tips.tips.ravel() + rng.normal(0.0, noise, 3))
        tips.move(row[None])
    return t, 1e-3 * rate[:, :axes], 1e-3 * np.array(seen)[:, :axes]


def folder_of(place, wrong, **more):
    """A recording folder."""
    t, u, x = shaken(wrong, **more)
    table = np.column_stack([t, u, x])
    header = "time," + ",".join(f"{p}{k}" for p in "ux" for k in range(1, u.shape[1] + 1))
    np.savetxt(place / "samples.csv", table, delimiter=",", header=header, comments="")
    (place / "dataset.toml").write_text('observation = "tracking"\nnoise_std = 5e-5\n')
    return place


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The diagnosis of a tip that MuJoCo moves."""
    return diagnose(folder_of(tmp_path_factory.mktemp("tip"), WRONG))


def test_what_is_wrong_with_an_axis_is_named_in_its_units(found):
    causes = {(c.effect, c.element): c for c in found.causes}
    for axis in (1, 2):
        assert causes["actuation_delay", axis].probability > 0.95
        lag = causes["actuation_lag", axis]
        assert lag.probability > 0.95
        # As a band of commands dry friction took a quarter of it.
        assert lag.parameters["lag"].value == pytest.approx(WRONG.lag, rel=0.08)
    (band,) = causes["actuation_deadband", 1].parameters.values()
    assert (band.unit, causes["actuation_deadband", 1].variant) == (
        "m/s",
        "larger commands lose as much, against the motion",
    )
    assert band.value == pytest.approx(3e-3, rel=0.1)
    assert {axis for name, axis in causes if name == "actuation_gain"} == {1, 2}
    assert {axis for name, axis in causes if name == "actuation_deadband"} == {1}
    assert found.gap.unit == "m"
    assert "axis 1" in causes["actuation_delay", 1].words


def test_a_plant_is_read_off_the_diagnosis(found):
    plant = Plant.of(found)
    assert plant.delay == pytest.approx(np.full(2, 0.05), abs=4e-3)
    assert plant.delay + plant.lag == pytest.approx(np.full(2, 0.09), abs=3e-3)
    assert plant.dry == pytest.approx(1e-3 * WRONG.band[:2], abs=3e-4)
    assert not plant.band.any()
    assert plant.gain == pytest.approx(WRONG.gain[:2], abs=5e-3)
    joints = diagnose(recorded([{}, {}], seconds=8.0))
    with pytest.raises(PlumblineError, match="a diagnosis of joints, of a tip expected"):
        Plant.of(joints)


def test_noise_at_a_window_s_start_is_no_gap(tmp_path):
    folder = folder_of(tmp_path, Slides(), axes=1)
    answer = diagnose(folder)
    assert answer.verdict.verdict is Outcome.NO_GAP
    assert answer.gap.after == pytest.approx(1e-3 * NOISE, rel=0.08)


def test_the_command_diagnoses_a_folder_and_writes_its_report(tmp_path, capsys):
    (tmp_path / "tip").mkdir()
    folder = folder_of(tmp_path / "tip", Slides(delay=0.06), axes=1, seconds=6.0)
    outputs = ["--json", str(tmp_path / "a.json"), "--report", str(tmp_path / "a.html")]
    assert command_line(["diagnose", str(folder), *outputs]) == 0
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["causes"][0]["effect"] == "actuation_delay"
    assert "Axis" in (tmp_path / "a.html").read_text()
    assert "mm" in capsys.readouterr().out
    assert load(folder).joints == ("x1",)


def test_drives_of_axes_are_told_in_metres_and_are_no_robot_s(found, tmp_path, capsys):
    made, at = tmp_path / "tip.toml", tmp_path / "again"
    at.mkdir()
    folder_of(at, WRONG)
    found.model().save(made)
    assert "mm" in repr(found.model())
    assert command_line(["apply", str(made), str(at), "--json", str(tmp_path / "a.json")]) == 0
    told, said = json.loads((tmp_path / "a.json").read_text()), capsys.readouterr().out
    assert told["unit"] == "m"
    assert " mm -> " in said
    assert "mrad" not in said
    assert command_line(["export", str(made), "--mjcf", str(tmp_path / "tip.xml")]) == 2
    said = capsys.readouterr().err
    assert "a robot's expected" in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"noise_std": 0.0}, "noise_std: found 0, expected a noise above 0"),
        ({"frozen": 1}, "'x2': found 0.1 in every row while u2 moves, expected measured"),
        ({"clock": 1e3}, "rows 20 s apart, expected at most 0.1 s; divide by 1000 if in ms"),
    ],
)
def test_what_was_never_measured_is_refused_in_one_line(change, words):
    t, u, x = shaken(WRONG, seconds=3.0)
    if "frozen" in change:
        x[:, change["frozen"]] = 0.1
    with pytest.raises(PlumblineError) as told:
        diagnose(build_tracking(
            time=t * change.get("clock", 1.0), rate=u, x=x, noise_std=change.get("noise_std")
        ))  # fmt: skip
    assert words in str(told.value)


def test_a_rate_stands_until_the_next():
    t = DT * np.arange(200)
    rate = np.random.default_rng(0).normal(0.0, 0.02, (200, 1))
    x = np.concatenate([[[0.0]], DT * np.cumsum(rate, axis=0)[:-1]])
    signals = signals_of(build_tracking(time=t, rate=rate, x=x))
    windows = signals.windows(0, signals.starts)
    assert np.abs(roll_out(windows, (), np.empty(0))[0] - windows.measured).max() < 1e-12
    assert signals.recording.law is Law.RATE


@pytest.mark.parametrize(("start", "jitter"), [(0.0, 0.0), (1.7e9, 0.0), (0.0, 1e-7)])
def test_a_rate_is_its_own_row_s_however_its_stamp_is_rounded(start, jitter):
    """Of stamps since 1970 half the rows had the rate before them: 20 ms of a delay were lost."""
    t, u, x = shaken(Slides(), axes=1)
    off = np.random.default_rng(0).uniform(-jitter, jitter, len(t))
    s = signals_of(build_tracking(time=start + t + off, rate=u, x=x))
    assert np.abs(s.command[:-1] - u[: len(s.command) - 1]).max() < 1e-3 * np.abs(u).max()


def test_a_lag_under_held_rates_is_its_closed_form():
    """After a step of v, a lag T is v T behind; what a window's start misses is no drive's."""
    t = DT * np.arange(200)
    rate = np.where(t < 1.99, 0.0, 0.03)[:, None]
    lag = 0.05
    since = np.maximum(t - 2.0, 0.0)
    x = (0.03 * (since - lag * (1 - np.exp(-since / lag))))[:, None]
    signals = signals_of(build_tracking(time=t, rate=rate, x=x))
    windows = signals.windows(0, signals.starts)
    predicted = roll_out(windows, (ActuationLag(),), np.array([lag]))[0]
    assert np.abs(windows.level(predicted - windows.measured)).max() < 1e-9


def rubbed(speed, law, lag, dry, fine=2000):
    """Places (N,) [rad] of what lags and rubs, told rates (N,) 20 ms apart, by small steps."""
    h, place, now, out = DT / fine, 0.0, 0.0, [0.0]
    for k in range(1, len(speed)):
        held = law == Law.RATE
        told = np.linspace(speed[k - 1], speed[k - 1] if held else speed[k], fine, endpoint=False)
        for c in told + (0 if held else (speed[k] - speed[k - 1]) / fine / 2):
            free = now + h / lag * (c - now)
            after = free - np.clip(free, -h / lag * dry, h / lag * dry)
            place, now = place + h * (now + after) / 2, after
        out.append(place)
    return np.array(out)


@pytest.mark.parametrize("law", [Law.RATE, Law.VELOCITY])
def test_friction_acts_against_what_lags_and_not_against_its_command(law):
    t = DT * np.arange(150)
    u = np.where(t < 0.4, 0.0, np.sin(9.0 * (t - 0.4)))
    windows = signals_of(recorded([{}, {}])).windows(0, np.array([0]))
    rest = np.zeros(150)
    windows = replace(
        windows, law=law, dt=DT, command=u, first=rest.astype(int), q=rest, posture=rest,
        speed=rest, load=rest, inertia=rest + 1, start=np.array([5]), length=140, settle=0,
    )  # fmt: skip
    at = np.array([0.3, 0.1])
    for rubs in (True, False):
        effects = ActuationDeadband(less=True, rubs=rubs), ActuationLag()
        got = rollout._passed(windows, effects, at, ())[0, :140, 0]
        wanted = rubbed(u, law, 0.1, 0.3)[6:146]
        assert (np.abs(got - wanted).max() < 1e-3) == rubs
    alone = [
        rollout._passed(windows, (ActuationDeadband(less=True, rubs=r),), at[:1], ())
        for r in (True, False)
    ]
    np.testing.assert_array_equal(*alone)


def test_what_is_sent_is_carried_out_as_it_was_meant():
    across = np.array([[0.0, 0.05, 0.0], [-0.02, 0.0, 0.03], [0.0, 0.01, 0.0]])
    for taken in (0.0, across):
        plant = Plant(gain=0.1, offset=0.002, dry=0.003, across=taken)
        for meant in np.random.default_rng(0).uniform(-0.06, 0.06, (40, 3)):
            asked = (1.1 * np.eye(3) + taken) @ plant.rate(meant) + 0.002
            done = np.sign(asked) * np.maximum(np.abs(asked) - 0.003, 0.0)
            moves = np.abs(meant) > 0.0003  # slower ones get a share, against chatter
            assert np.abs(done - meant)[moves].max() < 1e-12


def test_within_a_dead_band_what_is_meant_is_done_on_average_and_not_at_rest():
    own, way, meant = Underway(Plant(band=0.006), ONE), np.zeros(3), np.zeros(3)
    for k in range(300):
        rate = np.array([1.0, -4.0, 9.0 * np.sin(k / 20)])
        sent = 1e3 * own.sent(rate)
        assert ((sent == 0.0) | (np.abs(sent) > 6.0)).all()
        way, meant = way + DT * sent, meant + DT * rate
        # A step of half of the edge.
        assert np.abs(way - meant).max() <= DT * 1.05 * 6.0 / 2 + 1e-9
        np.testing.assert_allclose(own._owed, meant - way, atol=1e-9)
    assert not own.sent(np.zeros(3)).any()


def test_the_way_that_is_left_is_what_the_plant_still_goes():
    """With rates that no longer come, a late and lagging plant goes on by just so much."""
    wrong = Slides(delay=0.05, lag=0.04)
    tips = SlidingTips(np.zeros((1, 3)), wrong, DT, 100, np.random.default_rng(0))
    own = Underway(Plant(delay=0.05, lag=0.04), ONE)
    for rate in np.random.default_rng(1).uniform(-60.0, 60.0, (40, 3)):
        tips.move(rate[None])
        own.sent(rate)
    before, left = tips.tips, own.way()
    for _ in range(40):
        tips.move(np.zeros((1, 3)))
    assert np.abs(left).max() > 1.0
    assert np.abs(tips.tips - before - left).max() < 0.02


def test_a_controller_follows_as_if_nothing_were_wrong_told_or_not():
    wrong = Slides(delay=0.06, lag=0.04, gain=-0.05, band=3.0, measured=0.02)
    told = Plant(delay=0.06, lag=0.04, gain=-0.05, dry=0.003)
    planner = OneStep(compiled=False)
    ideal, untold, knowing = (
        followed(planner, slides, plant, 0, 3.0)
        for slides, plant in ((Slides(measured=0.02), Plant()), (wrong, Plant()), (wrong, told))
    )
    # Behind by 100 ms of 15 mm/s it would be 1.5 mm off: what nobody told is learnt.
    assert untold.error < 0.3
    assert abs(knowing.error - ideal.error) < 0.05
    assert min(untold.clearance, knowing.clearance) > 2.0


def test_later_points_of_a_path_are_led_and_a_single_goal_stays():
    own = Underway(Plant(delay=[0.04, 0.0, 0.0]), ONE)
    path = np.arange(12.0)[:, None] * [1.0, 10.0, 0.0]
    then = np.column_stack([np.arange(2, 10), 10 * np.arange(8), np.zeros(8)])
    assert np.array_equal(own.then(path, 8), then)
    assert np.array_equal(own.then(path[0], 8), path[0])


@pytest.mark.parametrize(
    ("field", "wrong", "words"),
    [
        ("delay", -1.0, "0 to 1; give it in s"), ("lag", -1.0, "0 to 1; give it in s"),
        ("band", -1.0, "0 to 2; give it in m/s"), ("gain", -1.0, "-0.99 to 1; give it as a share"),
        ("delay", 40.0, "in s"), ("lag", [0.04, 30.0], "in s"), ("band", 3.0, "in m/s"),
        ("play", 0.3, "in m"), ("dry", 3.0, "in m/s"), ("offset", -4.0, "in m/s"),
        ("gain", 5.0, "not in percent"), ("across", 3.0, "not in percent"),
    ],
)  # fmt: skip
def test_a_plant_that_cannot_be_or_in_ms_or_mm_is_refused_in_a_line(field, wrong, words):
    with pytest.raises(PlumblineError, match=words) as told:
        Plant(**{field: wrong})
    assert f"{field}: found {np.ravel(wrong)[-1]:g}, expected" in str(told.value)
    assert len(str(told.value).splitlines()) == 1


def test_a_short_or_ragged_recording_is_refused():
    t, still = DT * np.arange(60), np.zeros((60, 2))
    with pytest.raises(PlumblineError, match="at least 50"):
        build_tracking(time=t[:9], rate=still[:9], x=still[:9])
    with pytest.raises(PlumblineError, match=r"time, rate, x: found shapes"):
        build_tracking(time=t, rate=still[:, :1], x=still)
