"""Laws of a gear's spectrum: many small orders are one cause, other functions of an angle none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.robot import Robot
from plumbline.optim.diagnosis.discrepancy.alternatives import alternatives
from plumbline.optim.diagnosis.discrepancy.spectra import Spectrum, _process, spectra
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.joint_problem import stated
from plumbline.optim.diagnosis.posterior.one_by_one import best_near
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import UNLISTED
from plumbline.optim.diagnosis.verdict.terms import _fitted, begins_of
from tests.benches import bench, measured, readings
from tests.explained import searched, told

NOISE = 5e-5  # [m]
WAY = 2.0  # of the joint that errs [rad]
BESIDE = ("joint_offset", "joint_scale", "transmission_ripple", "gear_ripple", "joint_coupling")
GEARS = DiagnosisOptions(library=tuple(REGISTRY[name] for name in BESIDE))


def twelve_orders(x):
    """Some orders between 3 and 40, alike in size and each with a phase of its own."""
    rng = np.random.default_rng(11)
    orders, phases = rng.choice(np.arange(3, 41), 12, replace=False), rng.uniform(0, 6.28, 12)
    return np.sin(orders[:, None] * x + phases[:, None]).sum(axis=0)


def recording(error, size, rows=240, every=1):
    """Of a UR5 whose joint 2 errs by a function of its angle, so many noises at the tip."""
    chain = Robot.bundled("ur5").chain()
    q = readings(chain, rows, seed=5)
    q[:, 1] = np.random.default_rng(6).uniform(-WAY / 2, WAY / 2, rows)
    true, own = q.copy(), error(q[:, 1])
    right = measured(chain, q, "tip_position")
    true[:, 1] += 1e-6 * (own - own.mean())
    moved = measured(chain, true, "tip_position") - right
    y = right + moved * size * NOISE / np.sqrt(np.mean(moved**2))
    y += np.random.default_rng(7).normal(0.0, NOISE, y.shape)
    found = bench("ur5", "tip_position", q=q, columns=(), measured=y, noise_std=NOISE)
    return found.select(np.arange(rows)[::every])


def gear(found):
    """The probability of the joint's gear."""
    return found.probabilities.get(("gear_ripple", 2), 0.0)


@pytest.mark.parametrize("every", [1, 2])
def test_many_small_orders_are_one_cause_however_many_rows_find_them(every):
    found = told(recording(twelve_orders, 1.0, every=every), GEARS.library)
    assert gear(found) > 0.95
    assert ("gear_ripple", 2) in found.named


OTHERWISE = {
    "a bend": lambda x: x**2,
    "a kink": lambda x: np.abs(x - 0.4),
    "a step": lambda x: np.sign(x - 0.2),
    "a bump": lambda x: np.exp(-0.5 * ((x - 0.1) / 0.06) ** 2),
}


@pytest.mark.parametrize("error", OTHERWISE.values(), ids=OTHERWISE)
def test_what_errs_otherwise_over_a_short_way_is_no_gear(error):
    found = told(recording(error, 3.0, rows=120), GEARS.library)
    assert gear(found) < 0.05
    assert found.unlisted > 0.9


def test_a_spectrum_is_weaker_in_its_higher_orders_and_loses_nothing_that_shows():
    angle, orders = np.linspace(-3.0, 3.0, 90), np.array([3.0, 12.0, 40.0])
    functions = _process(angle, orders)
    apart = angle[:, None] - angle
    covariance = sum(np.cos(order * apart) / order for order in orders)
    assert functions.T @ functions == pytest.approx(covariance, abs=1e-9)


@pytest.mark.parametrize(("order", "there"), [(2, False), (4, True), (39, True), (42, False)])
def test_a_spectrum_has_the_orders_from_three_to_forty(order, there):
    q = np.tile(np.linspace(-3.1, 3.1, 400)[:, None], (1, 6))
    own = bench("ur5", "tip_position", q=q, columns=())
    listed = [Candidate(GearRipple(2, 3.0), np.arange(2), 0.0)]
    ports = SimpleNamespace(joint=np.ones((6, 400, 1)))
    [number], [columns] = spectra(SimpleNamespace(candidates=listed), own, ports)
    wave = np.sin(order * q[:, 1])
    A = columns[:, :, 0].T
    left = wave - A @ np.linalg.lstsq(A, wave, rcond=1e-9)[0]
    assert number == 0
    assert (np.linalg.norm(left) < 0.1 * np.linalg.norm(wave)) == there


def test_over_a_short_way_neighbouring_orders_are_few_functions():
    orders = np.arange(3.0, 41.0)
    assert len(_process(np.linspace(-0.2, 0.2, 200), orders)) < 12


@pytest.fixture(scope="module")
def found():
    """Where a search ended on twelve orders of joint 2, and the alternatives there."""
    selected, _ = searched(recording(twelve_orders, 3.0), GEARS.library)
    return selected, alternatives(selected.pool, selected.chosen, UNLISTED)


def of_gear(alt, state):
    """Numbers of single orders of joint 2's gear in a state, and of its spectra."""
    terms = [alt.term(t.index) for t in state]
    single = [t for t in terms if isinstance(t, Candidate) and t.key == ("gear_ripple", 2)]
    return len(single), sum(isinstance(t, Spectrum) for t in terms)


def test_a_posterior_is_looked_for_from_whole_spectra_too(found):
    """One term exchanged at a time, single orders would stay."""
    selected, alt = found
    single, whole, *_ = begins_of(selected, alt)
    assert of_gear(alt, single)[0] > 2
    assert of_gear(alt, whole) == (0, 1)
    ends = [stated(alt.problem, best_near(alt.problem, begin)) for begin in (single, whole)]
    assert ends[1] > ends[0]
    other = [t for t in single if alt.term(t.index).effect.name != "gear_ripple"]
    assert set(other) <= set(whole)


def test_a_spectrum_is_fitted_with_what_its_search_had_beside_the_orders(found):
    selected, alt = found
    names = [c.key for c in selected.selection.candidates]
    beside = SelectedTerm(names.index(("transmission_ripple", 2)), 1.0)
    ours = replace(selected, chosen=(*selected.chosen, beside))
    [whole] = [
        t for t in alt.with_spectra(selected.chosen) if isinstance(alt.term(t.index), Spectrum)
    ]
    assert beside in _fitted(ours, alt, [whole])
    assert beside not in _fitted(ours, alt, [])
