"""One law of physics for every effect on a range finder, its planes, markers and their CT."""

import numpy as np
import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.measurement.observation import scope_of
from tests.benches import TOOL, bench, residuals
from tests.kinematics.test_effect_physics import EXACT, tip_poses, to_device

WIDE = 2.0  # [m]: the box's faces stand this far from the base


@pytest.fixture(scope="module")
def box():
    return bench("ur5", "plane_range")


@pytest.fixture(scope="module")
def head():
    return bench("points", "fiducials")


def read(recording, effect, *values):
    """What the device reads with the effect in the model (N, m)."""
    return residuals(recording, [effect], values) + recording.measured


def beams(recording):
    """Pinocchio's flange turns (N, 3, 3); starts, ways and normals met in the base (N, 3)."""
    T = tip_poses(recording.chain, recording.q)
    normals = np.concatenate([np.eye(3), -np.eye(3)])[recording.element - 1]
    start, way = T[:, :3, :3] @ TOOL + T[:, :3, 3], T[:, :3, :3] @ recording.anchor[0][3:]
    return T[:, :3, :3], start, way, normals


def crossed(recording):
    """Where the beams cross the box's faces (N, 3), after which way (N,) [m], at which angles."""
    _, start, way, normals = beams(recording)
    cosine = np.sum(way * normals, axis=1)
    far = (WIDE - np.sum(start * normals, axis=1)) / cosine
    return start + far[:, None] * way, far, np.arccos(cosine)


# Ranges


def test_a_range_scale_makes_every_metre_as_much_too_long(box):
    _, far, _ = crossed(box)
    np.testing.assert_allclose(read(box, REGISTRY["range_scale"](), 0.0)[:, 0], far, atol=EXACT)
    seen = read(box, REGISTRY["range_scale"](), 2e-3)[:, 0]
    np.testing.assert_allclose(seen, 1.002 * far, atol=EXACT)


@pytest.mark.parametrize("widening", [False, True])
def test_a_slanted_beam_is_long_by_the_tangent_of_its_incidence_or_its_square(box, widening):
    """A spot of width w spreads over w tan(theta) of range; one that widens, over that times d."""
    _, far, angle = crossed(box)
    assert np.ptp(np.rad2deg(angle)) > 30
    width = 3e-4 * (far if widening else 1.0)
    for squared, atol in ((True, EXACT), (False, 1e-9)):  # the tip of |u| is rounded by 1e-6
        effect = REGISTRY["incidence_bias"](squared=squared, widening=widening)
        longer = width * np.tan(angle) ** (2 if squared else 1)
        np.testing.assert_allclose(read(box, effect, 3e-4)[:, 0], far + longer, atol=atol)


def test_a_finder_not_alike_to_all_sides_reads_by_the_slopes_along_its_two_axes(box):
    _, far, angle = crossed(box)
    R, _, _, normals = beams(box)
    v = box.anchor[0][3:]
    x = np.cross(v, [1.0, 0.0, 0.0]) / np.linalg.norm(v[1:])  # square to the flange's x
    axes = np.array([x, np.cross(v, x)])
    slopes = np.einsum("ai,nji,nj->na", axes, R, normals) / np.cos(angle)[:, None]
    K = 1e-4 * np.array([[3.0, -1.0], [-1.0, 5.0]])
    longer = np.einsum("na,ab,nb->n", slopes, K, slopes)
    effect = REGISTRY["incidence_bias"](alike=False)
    seen = read(box, effect, K[0, 0], K[1, 1], K[0, 1])[:, 0]
    np.testing.assert_allclose(seen, far + longer, atol=EXACT)


def test_a_bowl_is_met_where_the_beam_crosses_a_sphere(box):
    """A rim that stands out by c at the half width a: a sphere of radius a^2 / (2 c)."""
    _, start, way, normals = beams(box)
    _, flat, _ = crossed(box)
    rim = 1e-4
    for effect in REGISTRY["plane_unflatness"].candidates(scope_of(box)):
        if effect.degree != 2:
            continue
        radius = effect.half**2 / (2 * rim)
        away = start - (WIDE - radius) * normals
        ahead = np.sum(away * way, axis=1)
        met = -ahead + np.sqrt(ahead**2 - np.sum(away**2, axis=1) + radius**2)
        here = box.element == effect.plane
        expected = np.where(here, met, flat)
        seen = read(box, effect, rim, 0.0, rim)[:, 0]
        # The sphere's slope at the spot is of second order: a thousandth of what is seen.
        np.testing.assert_allclose(seen, expected, atol=1e-3 * rim)
        assert np.abs(seen - flat)[here].max() > 0.5 * rim, "no plane is left untried"


def test_a_read_point_stands_out_of_the_plane_by_its_polynomial(box):
    spots, flat, angle = crossed(box)
    effect = REGISTRY["plane_unflatness"](plane=1, degree=4, half=0.7)
    c = 1e-4 * np.arange(1.0, 13.0)
    x, y = spots[:, 2] / 0.7, -spots[:, 1] / 0.7  # of the face x = 2 m, from its middle
    height = c[0] * x**2 + c[1] * x * y + c[2] * y**2
    height += c[3] * x**3 + c[4] * x**2 * y + c[5] * x * y**2 + c[6] * y**3
    height += c[7] * x**4 + c[8] * x**3 * y + c[9] * x**2 * y**2 + c[10] * x * y**3 + c[11] * y**4
    out = (flat - read(box, effect, *c)[:, 0]) * np.cos(angle)
    np.testing.assert_allclose(out, np.where(box.element == 1, height, 0.0), atol=1e-12)


# Markers


def test_a_marker_that_moved_is_touched_as_far_away_and_no_other_is(head):
    wrong = np.array([1e-3, -2e-3, 3e-3])
    for marker in (1, 6):
        moved = head.q + np.outer(head.element == marker, wrong)
        seen = read(head, REGISTRY["marker_shift"](marker=marker), *wrong)
        np.testing.assert_allclose(seen, to_device(moved), atol=EXACT)


@pytest.mark.parametrize("axis", range(4))
def test_a_ct_scale_stretches_all_its_lengths_or_those_along_one_axis(head, axis):
    gain = np.where([axis in (0, k) for k in (1, 2, 3)], 1.004, 1.0)
    seen = read(head, REGISTRY["ct_scale"](axis=axis), 4e-3)
    np.testing.assert_allclose(seen, to_device(gain * head.q), atol=EXACT)


def test_what_rounding_to_slices_took_away_is_given_back_to_every_touch(head):
    """What is lost is a sawtooth of the place; over all places it has the variance h^2 / 12."""
    [effect] = REGISTRY["slice_quantisation"].candidates(scope_of(head))
    h, places = 5e-3, np.random.default_rng(2).uniform(-0.1, 0.1, 8)
    lost = places - h * np.round(places / h)
    whole = head.q + np.outer(lost[head.element - 1], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(read(head, effect, *lost), to_device(whole), atol=EXACT)
    fine = np.linspace(0.0, 20 * h, 200_001)
    spread = np.std(fine - h * np.round(fine / h))
    assert [p.scale for p in effect.parameters] == pytest.approx([spread] * 8, rel=1e-3)
