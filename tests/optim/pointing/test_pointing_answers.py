"""Sweeps and maps keep the contract of every answer; what is stored comes back without a solve."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.optim.pointing import AngleMap, Sweep, plan_sweep, safe_angle_map
from plumbline.optim.pointing.judge import checked
from tests.answer_contract import keeps_the_contract
from tests.optim.pointing.test_pointing import deg
from tests.optim.pointing.test_pointing_scene import AORTA, LIVER, TABLE, aimed

SPHERES = replace(LIVER, name="<liver>")


@pytest.fixture(scope="module")
def aim():
    return aimed(AORTA, SPHERES, room=(TABLE,))


def test_a_sweep_keeps_the_contract(aim, tmp_path):
    sweep = plan_sweep(aim, deg(35.0), deg(np.linspace(240.0, 300.0, 12)))
    keeps_the_contract(sweep, tmp_path)
    again = Sweep.load(tmp_path / "answer.json")
    np.testing.assert_array_equal(again.joints, sweep.joints)
    assert again.status == sweep.status
    assert again.pairs == sweep.pairs


def test_a_sweep_that_is_not_reached_keeps_it(tmp_path):
    keeps_the_contract(plan_sweep(aimed(x=1.5), deg(20.0), deg([0.0, 90.0])), tmp_path)


def test_a_map_keeps_the_contract(aim, tmp_path):
    found = safe_angle_map(aim, deg([15.0, 40.0]), deg([0.0, 120.0, 240.0]))
    keeps_the_contract(found, tmp_path)
    again = AngleMap.load(tmp_path / "answer.json")
    np.testing.assert_array_equal(again.safe, found.safe)
    assert again.counts() == found.counts()
    assert again.worst.tolist() == found.worst.tolist()


def test_a_stored_arm_moves_as_it_did(aim, tmp_path):
    theta, beta = np.full(2, deg(35.0)), deg([250.0, 260.0])
    sweep = plan_sweep(aim, theta, beta)
    sweep.save(tmp_path / "sweep.json")
    other = Sweep.load(tmp_path / "sweep.json").aim
    for name in ("rcm_error", "direction_error", "singular_value"):
        one, two = (getattr(checked(a, sweep.joints, theta, beta), name) for a in (aim, other))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)
