"""Each limit and plausibility of a recording holds between 3/4 and 3/2 of its own figure."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.errors import PlumblineError
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording import checks, disagreement, units
from plumbline.optim.recording import disagreement as quaternions
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.constants import LARGEST_SETTINGS, LONGEST_REASON, MOST_PARTS
from plumbline.optim.recording.settings import read_settings
from plumbline.optim.recording.table import Origin
from tests.recording_folders import TOOL, poses, postures

UR5 = Robot.bundled("ur5")
NOTE, FAULT, NOTHING = "a note", "a fault", ""


def given(rows=40, **changes):
    """A good recording of tips, or of poses, from arrays."""
    q = postures()[:rows]
    kind = changes.get("observation", "tip_position")
    tips, turns = poses(UR5, q)
    measured = tips if kind == "tip_position" else np.hstack([tips, turns])
    arrays = {"observation": kind, "robot": UR5, "q": q, "measured": measured, "tool_offset": TOOL}
    return build_recording(**(arrays | changes))


@lru_cache(maxsize=2)
def good(kind="tip_position"):
    return given(observation=kind)


def found(check, r):
    """What a check makes of a recording: a fault, a note or nothing."""
    try:
        return NOTE if list(check(r, Origin()) or ()) else NOTHING
    except PlumblineError:
        return FAULT


@pytest.mark.parametrize(("size", "wrong"), [(0.75e12, False), (1.5e12, True)])
def test_no_reading_is_beyond_a_million_millions(size, wrong):
    section = read_settings("dataset.toml", f"noise_std = {size:.1f}\n".encode())
    if wrong:
        with pytest.raises(PlumblineError, match="noise_std"):
            section.number("noise_std")
    else:
        assert section.number("noise_std") == size


def test_settings_are_of_a_million_bytes_and_a_hundred_parts():
    assert (LARGEST_SETTINGS, MOST_PARTS, LONGEST_REASON) == (1_000_000, 100, 200)


@pytest.mark.parametrize(
    ("name", "most"), [("velocity", 1e3), ("acceleration", 1e6), ("effort", 1e6)]
)
def test_no_drive_is_faster_or_stronger_than_any(name, most):
    rows = np.zeros((40, 6))
    rows[7, 2] = 0.75 * most
    given(**{name: rows})
    rows[7, 2] *= -2.0
    with pytest.raises(PlumblineError, match=f"row 7 .*column '{name}3'"):
        given(**{name: rows})


@pytest.mark.parametrize(("apart", "count"), [(0.4e-6, 1), (0.8e-6, 2)])
def test_postures_a_microradian_apart_are_two(apart, count):
    assert checks._distinct(np.array([[0.0], [apart]])) == count


@pytest.mark.parametrize(("rows", "words"), [(11, NOTE), (12, NOTHING)])
def test_three_times_the_least_rows_are_enough(rows, words):
    assert found(checks.has_enough_rows, given(rows)) == words


# Joints


@pytest.mark.parametrize(("angle", "words"), [(9.0, NOTE), (19.0, FAULT)])
def test_a_joint_is_read_within_two_turns(angle, words):
    q = good().q.copy()
    q[3, 1] = angle
    assert found(units.joints_are_in_si, replace(good(), q=q)) == words


@pytest.mark.parametrize(("over", "words"), [(0.75e-6, NOTHING), (1.5e-6, NOTE)])
def test_a_joint_beyond_its_limit_by_more_than_rounding_is_noted(over, words):
    r = good()
    q = r.q.copy()
    q[3, 1] = r.chain.upper[1] + over
    assert found(units.joints_are_in_si, replace(r, q=q)) == words


@pytest.mark.parametrize(("twist", "wrong"), [(5.2, False), (10.0, True)])
def test_a_twist_beyond_a_turn_is_in_degrees(tmp_path, twist, wrong):
    from plumbline.optim.recording.loading import read_robot

    text = f"[[robot.dh]]\nd = 0.1\na = 0.2\nalpha = {twist}\ntheta = 0.0\n"
    settings = read_settings("dataset.toml", text.encode())
    if wrong:
        with pytest.raises(PlumblineError, match="degrees"):
            read_robot(settings, tmp_path)
    else:
        read_robot(settings, tmp_path)


@pytest.mark.parametrize(
    ("share", "looks"), [(0.075, False), (0.15, True)]
)  # of the cells beyond two turns
def test_a_tenth_of_the_joints_beyond_two_turns_looks_like_degrees(share, looks):
    r = good()
    q = r.q.copy()
    q.ravel()[: round(share * q.size)] = 15.0
    with pytest.raises(PlumblineError) as caught:
        list(units.joints_are_in_si(replace(r, q=q), Origin()))
    assert ("looks like degrees" in str(caught.value)) is looks


# Robot


def robot_of(size):
    """A slide and a turn, as long as given [m]."""
    rows = [{"d": size, "a": 0.0, "alpha": 0.0, "theta": 0.0}] * 2
    return Robot.from_dh(rows, name="long")


@pytest.mark.parametrize(("size", "words"), [(75.0, NOTHING), (150.0, FAULT)])
def test_an_arm_reaches_a_hundred_metres(size, words):
    r = replace(good(), chain=robot_of(size / 2.0).chain())
    assert found(units.robot_is_in_metres, r) == words


@pytest.mark.parametrize(("size", "words"), [(0.75, NOTHING), (1.5, FAULT)])
def test_a_tool_is_a_metre_long(size, words):
    r = replace(good(), chain=robot_of(0.1).chain(), tool_offset=np.array([size, 0.0, 0.0]))
    assert found(units.robot_is_in_metres, r) == words


@pytest.mark.parametrize(
    ("size", "words"),
    [(37.0, NOTE), (75.0, FAULT), (9.76, NOTHING), (9.84, NOTHING), (9.6, NOTE), (10.0, NOTE)],
)
def test_gravity_is_the_earth_s_or_said(size, words):
    r = replace(good(), robot=UR5.with_gravity((0.0, 0.0, -size)))
    assert found(units.gravity_is_the_earths, r) == words


# Tips


@pytest.mark.parametrize(("still", "words"), [(0.75e-9, FAULT), (1.5e-9, NOTHING)])
def test_tips_that_move_less_than_a_nanometre_stood_still(still, words):
    r = good()
    tips = r.measured - np.median(r.measured, axis=0)
    tips *= still / units.spread(tips)
    assert found(units.tips_are_in_metres, replace(r, measured=tips)) == words


@pytest.mark.parametrize(("size", "words"), [(0.75e-3, NOTHING), (1.5e-3, FAULT)])
def test_a_spread_below_a_millimetre_tells_no_scale(size, words):
    r = good()
    q = r.q.copy()
    middle = q.mean(axis=0)
    q = middle + (q - middle) * size / units.spread(r.chain.tips(r.q, r.tool_offset))
    for _ in range(20):
        q = middle + (q - middle) * size / units.spread(r.chain.tips(q, r.tool_offset))
    tips = 1e2 * r.chain.tips(q, r.tool_offset)
    assert found(units.tips_are_in_metres, replace(r, q=q, measured=tips)) == words


@pytest.mark.parametrize(("ratio", "words"), [(400.0, FAULT), (2250.0, FAULT), (4500.0, FAULT)])
def test_a_ratio_within_three_of_a_thousand_is_millimetres(ratio, words):
    r = good()
    with pytest.raises(PlumblineError) as caught:
        units.tips_are_in_metres(replace(r, measured=ratio * r.measured), Origin())
    assert ("millimetres" in str(caught.value)) is (1000 / 3 < ratio < 3000)


@pytest.mark.parametrize(("times", "words"), [(1.8, NOTHING), (3.6, FAULT)])
def test_a_tip_is_within_reach_and_a_fifth(times, words):
    r = good()
    tips = r.measured - np.median(r.measured, axis=0)
    far = times * (r.chain.reach + np.linalg.norm(TOOL))
    tips[5] = [0.0, 0.0, far]
    tips -= np.median(tips, axis=0)
    assert found(units.tips_are_in_metres, replace(r, measured=tips)) == words


@pytest.mark.parametrize(("share", "off"), [(0.19, False), (0.37, True)])
def test_readings_a_quarter_of_their_spread_off_are_not_in_the_base(share, off):
    r = good()
    tips = r.chain.tips(r.q, r.tool_offset)
    shifted = tips + np.array([share * units.spread(tips), 0.0, 0.0])
    assert bool(disagreement.far_from_base(replace(r, measured=shifted))) is off


@pytest.mark.parametrize(
    ("share", "rows", "words"), [(0.0375, 40, NOTHING), (0.075, 40, NOTE), (0.3, 4, NOTHING),
                                 (0.3, 5, NOTE)]
)  # fmt: skip
def test_rows_off_by_a_twentieth_of_their_spread_are_noted(monkeypatch, share, rows, words):
    monkeypatch.setattr(disagreement, "wrong_set_up", lambda r: None)
    r = good().select(np.arange(rows))
    wide = units.spread(r.measured)
    monkeypatch.setattr(disagreement, "misfit_of", lambda r: share * wide)
    assert found(disagreement.rows_meet_the_model, r) == words


# Noise


@pytest.mark.parametrize(
    ("std", "words"), [(0.75e-8, NOTE), (1.5e-8, NOTHING), (0.007, NOTHING), (0.015, NOTE)]
)
def test_a_noise_is_no_less_than_devices_read_and_no_coarser_than_a_hundredth(std, words):
    r = good()
    scaled = std * r.reach if std > 1e-6 else std
    assert found(units.noise_is_plausible, replace(r, noise_std=scaled)) == words


# Quaternions


@pytest.mark.parametrize(("off", "words"), [(0.75e-3, NOTHING), (1.5e-3, FAULT)])
def test_a_quaternion_is_of_norm_one_within_a_thousandth(off, words):
    r = good("pose")
    measured = r.measured.copy()
    measured[3, 3:] *= 1.0 + off
    assert found(quaternions.quaternions_are_unit, replace(r, measured=measured)) == words


@pytest.mark.parametrize(
    ("given", "other", "words"),
    [(0.075, 1e-9, NOTHING), (0.15, 1e-9, FAULT), (1.0, 0.15, FAULT), (1.0, 0.3, NOTHING)],
)
def test_an_order_is_wrong_where_another_leaves_a_fifth(monkeypatch, given, other, words):
    left = iter([given, *[other] * 20])
    monkeypatch.setattr(quaternions, "_misfit", lambda *_: next(left))
    assert found(quaternions.quaternions_are_in_order, good("pose")) == words


@pytest.mark.parametrize(("second", "named"), [(0.015, True), (0.03, False)])
def test_conventions_within_a_fiftieth_of_a_radian_are_told_together(monkeypatch, second, named):
    left = iter([1.0, 1e-9, second, *[0.5] * 20])
    monkeypatch.setattr(quaternions, "_misfit", lambda *_: next(left))
    with pytest.raises(PlumblineError) as caught:
        list(quaternions.quaternions_are_in_order(good("pose"), Origin()))
    assert ("or like" in str(caught.value)) is named


@pytest.mark.parametrize(("second", "fixed"), [(0.015, False), (0.03, True)])
def test_tips_on_a_line_fix_no_frame(second, fixed):
    x = np.random.default_rng(0).normal(size=(30, 3))
    x -= x.mean(axis=0)
    cloud = np.linalg.svd(x, full_matrices=False)[0] * [1.0, second, 0.01]
    R = Rotation.random(random_state=1).as_matrix()
    assert (quaternions._frame(cloud, cloud @ R.T) is not None) is fixed


# Surroundings


@pytest.mark.parametrize(
    ("degrees", "words"),
    [(45.0, NOTHING), (90.0, NOTE), (119.0, NOTE), (150.0, FAULT), (-45.0, NOTHING),
     (-90.0, FAULT), (293.0, FAULT)],
)  # fmt: skip
def test_a_temperature_is_a_room_s(degrees, words):
    r = replace(good(), temperature=np.full(40, degrees))
    assert found(units.temperature_is_celsius, r) == words


@pytest.mark.parametrize(("degrees", "kelvin"), [(150.0, False), (300.0, True)])
def test_a_median_of_two_hundred_is_in_kelvin(degrees, kelvin):
    with pytest.raises(PlumblineError) as caught:
        list(units.temperature_is_celsius(replace(good(), temperature=np.full(40, degrees)),
                                          Origin()))  # fmt: skip
    assert ("kelvin" in str(caught.value)) is kelvin


@pytest.mark.parametrize(("mass", "words"), [(3750.0, NOTHING), (7500.0, FAULT)])
def test_a_payload_is_one_of_a_robot(mass, words):
    r = replace(good(), payload=np.full(40, mass))
    assert found(units.payload_is_in_kilograms, r) == words
