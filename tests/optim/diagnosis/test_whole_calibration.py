"""An arm all of whose links err a little is that: nothing unlisted, and no single link's doing."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.judged import standard_errors
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.verdict import settled as module
from plumbline.optim.diagnosis.verdict.causes import _without
from plumbline.optim.recording.building import build_recording
from tests.few_effects import FEW_EFFECTS

# An industrial arm of 0.44 m and 0.435 m, by standard DH
ALPHA = np.radians([-90, 0, -90, 90, -90, 0])
A = np.array([0.03, 0.44, 0.035, 0, 0, 0])
D = np.array([0.38, 0, 0, 0.435, 0, 0.083])
THETA = np.radians([0, -90, 0, 0, 0, 180])
WIDTHS = np.array([1.5e-3, 3e-3, 0.9e-3, 0.9e-3])  # of alpha, theta [rad], a, d [m]: as assembled
PLACE, TURN = 4e-5, 2e-4  # m, rad: a laser tracker's


def tips(q, error):
    """Poses (N, 4, 4) of the flange, by NumPy alone."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for i in range(6):
        alpha, t = ALPHA[i] + error[i, 0], q[:, i] + THETA[i] + error[i, 1]
        a, d = A[i] + error[i, 2], D[i] + error[i, 3]
        c, s, ca, sa, z = np.cos(t), np.sin(t), np.cos(alpha), np.sin(alpha), 0 * t
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s]]
        rows += [[z, z + sa, z + ca, z + d], [z, z, z, z + 1]]
        T = T @ np.array(rows).transpose(2, 0, 1)
    return T


def tracked(seed, rows=30):
    """A recording of an arm none of whose links is as drawn."""
    rng = np.random.default_rng(seed)
    spread, middle = (
        np.array([0.8, 0.5, 0.5, 1, 0.6, 0.7]),
        np.array([0, 0.3, 0.4, -0.5, -1.1, -2.5]),
    )
    q = rng.uniform(-1, 1, (rows, 6)) * spread + middle
    error = rng.normal(0, 1, (6, 4)) * WIDTHS
    error[0, [1, 3]] = 0.0  # the frame's
    T = tips(q, error)
    turn = Rotation.from_matrix(T[:, :3, :3]) * Rotation.from_rotvec(rng.normal(0, TURN, (rows, 3)))
    place = T[:, :3, :3] @ [0, 0, 0.1] + T[:, :3, 3] + rng.normal(0, PLACE, (rows, 3))
    links = [
        {"a": a, "alpha": alpha, "d": d, "theta": theta, "kind": "revolute"}
        for a, alpha, d, theta in np.column_stack([A, ALPHA, D, THETA]).tolist()
    ]
    measured = np.hstack([place, turn.as_quat(scalar_first=True)])
    return build_recording(observation="pose", robot=Robot.from_dh(links), q=q, measured=measured)


@pytest.mark.parametrize("seed", [9])
def test_an_arm_all_of_whose_links_err_is_no_unlisted_one(seed):
    """One function of one link had stood for two zeros and that link: 0.32 mm were left."""
    found = diagnose(tracked(seed), FEW_EFFECTS)
    assert found.outside_probability < 0.05
    assert {c.effect for c in found.causes} == {"joint_offset", "link_geometry"}
    assert found.gap.after < 1.5 * np.sqrt(3) * PLACE


def fitted_by(errs, better, monkeypatch):
    """Which terms are fitted, if the linear problem errs so much about the chains' [nats]."""
    monkeypatch.setattr(module, "worth_while", lambda _, terms, named: terms)
    monkeypatch.setattr(module, "with_terms", lambda _, terms, *rest, tried: terms)
    monkeypatch.setattr(module.search, "foretold_wrongly", lambda terms: errs[terms])
    told = SimpleNamespace(theirs="theirs", better=better, terms="search's", named=(), compared=0)
    return module._fitted(None, told, None, None)


def test_what_chains_came_to_is_fitted_if_it_is_better_by_more_than_the_problem_errs(monkeypatch):
    errs = {"theirs": 2.0, "search's": 5.0}
    assert fitted_by(errs, 2.1, monkeypatch) == ("theirs", 2.0)
    assert fitted_by(errs, 1.9, monkeypatch) == ("search's", 5.0)
    assert fitted_by({**errs, "theirs": 0.0}, 0.0, monkeypatch) == ("search's", 5.0)


def test_a_cause_has_the_values_that_it_has_without_what_is_fitted_in_its_place():
    """By the normal equations; what rests on a bound stays there."""
    rng = np.random.default_rng(0)
    J, left = rng.normal(size=(20, 4)), rng.normal(size=20)
    G = J.T @ J
    x = np.linalg.solve(G, J.T @ left)
    mine, other = JointOffset(2), JointOffset(3)
    best = SimpleNamespace(
        x=x, gram=SimpleNamespace(matrix=G), std=lambda sigma: standard_errors(G, sigma),
        at_bound=lambda: (), problem=SimpleNamespace(
            names=tuple("abcd"), lower=np.full(4, -np.inf), upper=np.full(4, np.inf)),
    )  # fmt: skip
    terms = [SimpleNamespace(effect=e, columns=slice(k, k + 1)) for k, e in ((2, mine), (3, other))]
    selected = SimpleNamespace(best=best, model=SimpleNamespace(terms=terms))
    values, std = _without(selected, {("joint_offset", 3)}, 1.0)
    np.testing.assert_allclose(values, [*np.linalg.lstsq(J[:, :3], left)[0], 0.0], atol=1e-12)
    np.testing.assert_allclose(std[:3], standard_errors(G[:3, :3], 1.0))
    np.testing.assert_array_equal(_without(selected, (), 1.0)[0], x)
    best.at_bound = lambda: ("a",)
    held = _without(selected, {("joint_offset", 3)}, 1.0)[0]
    assert held[0] == x[0]
    rest = np.linalg.lstsq(J[:, 1:3], left - J[:, 0] * x[0])[0]
    np.testing.assert_allclose(held[1:3], rest, atol=1e-12)
