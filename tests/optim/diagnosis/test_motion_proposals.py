"""Motions that are proposed stay where the robot was, and no faster."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.experiments.commands.app import run
from plumbline.kinematics.effects.actuation_lag import ActuationLag
from plumbline.kinematics.effects.actuation_play import ActuationPlay
from plumbline.kinematics.effects.servo_bandwidth import ServoBandwidth
from plumbline.kinematics.law import Law
from plumbline.optim.diagnosis.findings import Blame, Cause
from plumbline.optim.diagnosis.motion.constants import CHIRP, SECONDS
from plumbline.optim.diagnosis.motion.proposals import (
    commanded,
    motion_of,
    proposals,
    proposals_of_efforts,
)
from tests.motions import multisine

TIME = np.arange(0.0, 20.0, 0.01)
COMMAND = np.column_stack([0.5 * np.sin(2.0 * TIME), 0.2 + 0.0 * TIME])

TORQUES = SimpleNamespace(law=Law.TORQUE)


@pytest.mark.parametrize("kind", ["chirp", "ramp", "hold", "steps"])
def test_a_proposed_motion_stays_within_what_was_recorded(kind):
    u = motion_of(kind, COMMAND[:, 0], 0.01, 1.0)
    assert np.abs(u).max() <= 0.5
    assert len(u) * 0.01 >= SECONDS - 0.02
    assert np.ptp(u) > 0.01
    if kind != "steps":
        assert np.abs(np.diff(u)).max() / 0.01 <= 1.05


def test_a_chirp_reaches_where_delay_and_lag_part():
    u = motion_of("chirp", COMMAND[:, 0], 0.01, 10.0)
    late = u[-200:] - np.median(COMMAND[:, 0])
    crossings = np.count_nonzero(np.diff(np.sign(late)))
    assert crossings / 2 / 2.0 == pytest.approx(CHIRP[1], rel=0.2)


def test_joints_move_one_after_the_other():
    t, u = commanded([(1, "ramp"), (1, "chirp")], TIME, COMMAND)
    assert u.shape == (len(t), 2)
    np.testing.assert_allclose(u[:, 1], 0.2)
    assert np.diff(t) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("effects", "kind"),
    [
        ((ActuationPlay(),), "hold"),
        ((ActuationLag(), ActuationPlay()), "steps"),
        ((ServoBandwidth(), ActuationPlay()), "steps"),
        ((ActuationLag(), ActuationPlay(inside=True)), "hold"),
    ],
)
def test_play_and_a_dead_band_part_in_steps_and_where_they_are_one_under_a_hand(effects, kind):
    instead = {"actuation_play": {"actuation_deadband": 0.5}}
    windows, fit = SimpleNamespace(law=Law.POSITION), SimpleNamespace(effects=effects)
    joint = SimpleNamespace(number=2, instead=instead, fit=fit, windows=windows)
    (row,) = proposals([joint])
    assert (row["joint"], row["motion"].split(",")[0]) == (2, kind)
    assert ("by hand" in row["motion"]) == (kind == "hold")


def test_what_is_unlisted_has_words_in_a_proposal():
    fit = SimpleNamespace(effects=(ActuationLag(),))
    instead = {"coulomb_friction": {"?load": 0.5}}
    (row,) = proposals([SimpleNamespace(number=2, instead=instead, fit=fit, windows=TORQUES)])
    assert row["tells"] == "coulomb_friction from something unlisted that goes by load"


@pytest.mark.parametrize(
    ("effect", "element", "rival", "kind", "joint"),
    [
        ("payload", None, "link_inertia", "hold", 4),
        ("viscous_friction", 2, "coulomb_friction", "ramp", 2),
        ("link_inertia", 3, "rotor_inertia", "chirp", 3),
    ],
)
def test_what_efforts_leave_open_has_a_motion(effect, element, rival, kind, joint):
    other = Blame(rival, "actuation", element or 4)
    cause = Cause(effect, "actuation", element, probability=0.6, confounded_with=(other,))
    (row,) = proposals_of_efforts([cause], 5)
    assert (row["joint"], row["motion"].split(",")[0]) == (joint, kind)
    assert row["tells"] == f"{cause.label} from {other.label}"
    t, u = commanded([(joint, kind)], TIME, np.tile(COMMAND[:, :1], 5))
    assert np.ptp(u[:, joint - 1]) > 0.01
    assert len(t) == len(u)


def test_what_rates_leave_open_has_a_motion_in_rates_within_what_the_joints_did(tmp_path):
    t, places = multisine(25.0, fastest=0.12)
    rate = np.gradient(places, t, axis=0)
    late = np.column_stack([np.interp(t - 0.04, t, x) for x in rate.T])
    q = np.concatenate([np.zeros((1, 2)), np.cumsum(0.02 * late[:-1], axis=0)])
    q += np.random.default_rng(0).normal(0.0, 1e-3, q.shape)
    place, table, told = tmp_path / "rates", tmp_path / "next.csv", tmp_path / "next.json"
    place.mkdir()
    np.savetxt(place / "samples.csv", np.column_stack([t, rate, q]), "%.9g", ",",
               header="time,u1,u2,q1,q2", comments="")  # fmt: skip
    toml = 'observation = "motion"\nnoise_std = 1e-3\n[motion]\ncommand = "rate"\n'
    links = "".join(f"[[robot.dh]]\na = {a}\n" for a in (0.3, 0.2))
    (place / "dataset.toml").write_text(toml + links)
    assert run(["next", str(place), "--csv", str(table), "--json", str(told)]) == 0
    rows = json.loads(told.read_text())["motions"]
    assert {(r["joint"], r["motion"].split(",")[0]) for r in rows} >= {(1, "chirp"), (2, "chirp")}
    new = np.genfromtxt(table, delimiter=",", names=True)
    assert new.dtype.names == ("time", "u1", "u2")
    for u, way in ((new["u1"], q[:, 0]), (new["u2"], q[:, 1])):
        moved = np.cumsum(0.02 * u)
        assert 0.05 * np.ptp(way) < np.ptp(moved) < np.ptp(way)


@pytest.mark.parametrize(
    ("pair", "kind"),
    [
        (("actuation_gain", "rotor_inertia"), "chirp"),
        (("coulomb_friction", "viscous_friction"), "ramp"),
        (("actuation_delay", "actuation_lag"), "chirp"),
    ],
)
def test_what_torques_leave_open_has_a_motion(pair, kind):
    joint = SimpleNamespace(
        number=1,
        instead={pair[0]: {pair[1]: 0.4}},
        fit=SimpleNamespace(effects=()),
        windows=TORQUES,
    )
    (row,) = proposals([joint])
    assert row["motion"].split(",")[0] == kind
