"""A scan that may move on its surface unseen is refused, and the motion is named."""

from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.ranging.phantoms import radius
from plumbline.optim.hand_eye import surface
from plumbline.optim.hand_eye.constants import LOST_EDGE, SHOWN
from plumbline.optim.hand_eye.scan import _laid, _refuse_open
from plumbline.optim.hand_eye.surface import open_motions, register_surface

SIZE = 0.08  # [m]


def ways(rng, count, least=-1.0):
    """Unit vectors (count, 3) whose x is at least so much."""
    found = rng.normal(size=(20 * count, 3))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found[found[:, 0] > least][:count]


def ball(rng, count, least=-1.0):
    return SIZE * ways(rng, count, least)


def head(rng, count, least=-1.0):
    found = ways(rng, count, least)
    return found * radius(found)[:, None]


def egg(rng, count, least=-1.0):
    return ways(rng, count, least) * [SIZE, SIZE, 1.25 * SIZE]


def pipe(rng, count, least=-1.0):
    angle = rng.uniform(-1.0, 1.0, count) * (np.pi if least < 0.0 else 1.2)
    return np.column_stack(
        [SIZE * np.cos(angle), SIZE * np.sin(angle), rng.uniform(-0.1, 0.1, count)]
    )


def scanned(shape, seed, count=300, points=6000):
    """A noisy surface and a noisy scan of its one side, in the same frame."""
    rng = np.random.default_rng(seed)
    surface, scan = shape(rng, points), shape(rng, count, 0.3)
    return scan + rng.normal(0, 1e-4, scan.shape), surface + rng.normal(0, 2e-4, surface.shape)


def found(shape, seed, **more):
    scan, surface = scanned(shape, seed, **more)
    return open_motions(scan, register_surface(scan, surface), surface)


@pytest.mark.parametrize(("seed", "count"), [(0, 120), (1, 120), (2, 300)])
def test_only_what_a_shape_leaves_open_is_open(seed, count):
    assert found(head, seed, count=count) == ()
    turns, slides = ("a turn about", "a slide along")
    for shape, wanted in ((ball, [turns] * 3), (egg, [turns]), (pipe, [slides, turns])):
        motions = found(shape, seed, count=count)
        assert sorted(m[: m.index(" (")] for m in motions) == wanted
    (turn,) = found(egg, seed, count=count)
    axis = np.array(eval(turn[turn.index("(") :]))
    assert abs(axis[2]) > 0.98


@pytest.mark.parametrize("shape", [ball, egg, pipe])
def test_a_scan_of_a_symmetric_shape_is_refused_by_name(shape):
    scan, surface = scanned(shape, 0)
    recording = SimpleNamespace(surface=surface, landmarks=None)
    with pytest.raises(PlumblineError, match="leaves the scan open: its normals show nothing of a"):
        _laid(recording, scan, np.eye(6))


def test_a_scan_that_lies_badly_is_refused_with_its_error():
    with pytest.raises(PlumblineError, match=r"standard error 10\.1 mm at its edge, at most 10 mm"):
        _refuse_open((), 1.01 * LOST_EDGE)
    with pytest.raises(PlumblineError, match="standard error nan"):
        _refuse_open((), float("nan"))
    _refuse_open((), LOST_EDGE)


def test_the_limit_lies_between_a_ball_and_a_head(monkeypatch):
    assert SHOWN == 4.0
    monkeypatch.setattr(surface.constants, "SHOWN", 200.0)
    assert found(head, 0)
    monkeypatch.setattr(surface.constants, "SHOWN", -2.0)
    assert not found(ball, 0)
