"""The law of what chance adds to rows left out: simulated folds of a right model."""

from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.predict import held_out as module
from plumbline.optim.diagnosis.predict.held_out import by_chance, counted_rows, evaluate
from plumbline.optim.measurement.refit import as_measured
from plumbline.optim.recording.session import build_session, joined
from tests.explained import searched
from tests.several import recorded

FOLDS, DRAWS = 5, 4000


def folds_of(J):
    """Each fold's linear problem, and that of all others."""
    parts = np.array_split(J, FOLDS)
    each = [Linear(A.T @ A, np.zeros(A.shape[1]), 0.0, float(len(A))) for A in parts]
    G, n = sum(p.G for p in each), sum(p.n for p in each)
    rest = [Linear(G - p.G, p.b, 0.0, n - p.n) for p in each]
    return parts, each, rest


def simulated(parts):
    """Held-out RMS over the noise of a right model, drawn many times."""
    rng = np.random.default_rng(0)
    noise = [rng.normal(size=(DRAWS, len(A))) for A in parts]
    square = 0.0
    for f, A in enumerate(parts):
        others = [k for k in range(FOLDS) if k != f]
        J, e = np.concatenate([parts[k] for k in others]), np.hstack([noise[k] for k in others])
        x = np.linalg.lstsq(J, e.T, rcond=None)[0]
        square = square + np.sum((noise[f] - (A @ x).T) ** 2, axis=1)
    return np.sqrt(square / sum(len(A) for A in parts))


@pytest.mark.parametrize(("readings", "unknowns"), [(60, 8), (200, 15), (2000, 10)])
def test_rows_left_out_of_a_right_model_exceed_it_once_in_a_hundred(
    monkeypatch, readings, unknowns
):
    J = np.random.default_rng(1).normal(size=(readings, unknowns))
    parts, each, rest = folds_of(J)
    none = [np.empty(0, np.intp)] * FOLDS
    listed = Candidate(SimpleNamespace(), np.arange(unknowns - 2, unknowns), 0.0)
    pool = SimpleNamespace(
        candidates=(listed,), always=unknowns - 2, others=rest, own_nuisances=none
    )
    wide = SimpleNamespace(variance=lambda chosen: 1e-9)
    selected = SimpleNamespace(pool=pool, chosen=(SelectedTerm(0, 1.0),), selection=wide)
    monkeypatch.setattr(module, "counted_rows", lambda *_: each)
    limit = by_chance(SimpleNamespace(held_out=None), selected, SimpleNamespace())
    beyond = np.mean(simulated(parts) > limit)
    assert 0.003 < beyond < 0.025
    assert limit == pytest.approx(1.0, abs=0.06) or readings < 1000


def left_at_the_fit(recording, pool, evaluation):
    """Square that the gap's rows leave where all rows are fitted, by their linear problems."""
    z = pool.x / pool.model.problem.scale
    rows = counted_rows(recording, pool, evaluation)
    return sum(part.square_at(np.arange(len(z)), z) for part in rows)


def test_rows_of_several_devices_leave_in_metres_what_they_leave_in_noises():
    parts = [recorded("tip_position", k, noise=s, name=f"{k}") for k, s in ((1, 1e-4), (2, 4e-4))]
    pool = searched(joined(build_session(parts)), [JointOffset])[0].pool
    residuals = Mapped(pool.model.problem).residuals(pool.x)
    missed = as_measured(pool.model.recording, residuals)
    found = left_at_the_fit(pool.model.recording, pool, SimpleNamespace(per_row=True))
    assert found == pytest.approx(np.sum(missed**2), rel=1e-9)


def test_rows_kept_back_in_a_socket_of_their_own_leave_what_its_place_does_not_take():
    recording = recorded("fixed_point", 3, held_out=np.arange(60) % 3 == 2)
    selected = searched(recording, [JointOffset])[0]
    pool = selected.pool
    told = evaluate(recording, selected, pool.fold_of_row, np.ones(40, dtype=bool), "rows", 0)
    found = left_at_the_fit(recording, pool, told)
    assert found == pytest.approx(np.sum(told.after[told.rows] ** 2), rel=1e-9)
