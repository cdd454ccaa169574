"""Laws of a sliding joint's screw: named with its lead, beside other causes, and not without."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.screw_ripple import ScrewRipple
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.measurement.observation import scope_of
from tests.benches import T_DEVICE_BASE, bench
from tests.explained import told

NOISE = 5e-5
BESIDE = ("joint_offset", "joint_scale", "backlash", "screw_ripple", "gear_ripple", "sensor_scale")
SCREWS = DiagnosisOptions(library=tuple(REGISTRY[name] for name in BESIDE))


def recorded(error, seed, kind="tip_position", rows=90):
    """A teaching arm whose insertion errs by a function of its way [m]; 0.05 mm of noise."""
    rng = np.random.default_rng(seed)
    plain = bench("laparoscopic", kind, columns=[])
    q = rng.uniform(plain.chain.lower, plain.chain.upper, (rows, 7)).clip(-2.0, 2.0)
    true = q.copy()
    true[:, 6] += error(q[:, 6])
    tips = plain.chain.tips(true, plain.tool_offset) + T_DEVICE_BASE
    measured = tips if kind == "tip_position" else true
    measured = measured + NOISE * rng.normal(size=measured.shape)
    return replace(plain, q=q, measured=measured, noise_std=NOISE, whole=None, place=None)


@pytest.mark.parametrize(
    ("lead", "size", "kind"),
    [
        (2.54e-3, 1e-3, "tip_position"),
        (6e-2, 3e-4, "tip_position"),
        (4e-3, 3e-4, "joint_position"),
    ],
)
def test_a_screw_is_named_with_its_lead(lead, size, kind):
    error = recorded(lambda q: size * np.sin(2 * np.pi * q / lead + 1.0), 1, kind)
    found = diagnose(error, SCREWS).verdict
    [cause] = found.causes
    assert (cause.effect, cause.element) == ("screw_ripple", 7)
    assert cause.probability > 0.9
    assert found.outside_probability < 0.1
    assert float(cause.variant.split()[1]) == pytest.approx(1e3 * lead, rel=0.02)
    amplitude = np.hypot(*(p.value for p in cause.parameters.values()))
    assert amplitude == pytest.approx(size, abs=5e-5)
    assert {p.unit for p in cause.parameters.values()} == {"m"}


def test_a_screw_and_a_scale_of_one_joint_are_two_causes():
    error = recorded(lambda q: 3e-4 * np.sin(2 * np.pi * q / 4e-3 + 1.0) + 4e-3 * q, 2)
    assert told(error, SCREWS.library).named == {("screw_ripple", 7), ("joint_scale", 7)}


def test_leads_are_from_a_millimetre_to_where_a_wave_and_a_half_is_seen():
    recording = recorded(np.zeros_like, 0)
    leads = [2 * np.pi / e.order for e in ScrewRipple.candidates(scope_of(recording))]
    assert min(leads) == pytest.approx(1e-3, rel=0.01)
    assert max(leads) == pytest.approx(np.ptp(recording.q[:, 6]) / 1.5)
    phases = np.ptp(recording.q[:, 6]) * np.diff([2 * np.pi / lead for lead in leads])
    np.testing.assert_allclose(phases, np.pi)


@pytest.mark.parametrize(("arm", "joints"), [("ur5", 6), ("laparoscopic", 7)])
def test_an_arm_without_slides_is_not_told_of_screws(arm, joints):
    plain = bench(arm, "joint_position", columns=[])
    still = np.tile(np.full(joints, 0.1), (40, 1)) + np.eye(40, joints)
    still[:, -1] = 0.1
    measured = still + NOISE * np.random.default_rng(0).normal(size=still.shape)
    recording = replace(plain, q=still, measured=measured, noise_std=NOISE, whole=None, place=None)
    unseen = {b.effect for b in diagnose(recording, SCREWS).verdict.unobservable}
    assert ("screw_ripple" in unseen) == (arm == "laparoscopic")


@pytest.mark.parametrize("seed", range(2))
def test_noise_is_no_screw(seed):
    found = told(recorded(np.zeros_like, seed), SCREWS.library)
    assert not found.named
    assert found.unlisted < 0.1
