"""Each threshold of a registration stands where it was set, and holds on both sides of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.distance import pdist, squareform
from scipy.stats import chi2
from scipy.stats import f as fisher

from plumbline.optim.registration import (
    Kabsch,
    MarkerNoise,
    Robust,
    ThreePoint,
    build_fiducials,
)
from plumbline.optim.registration.checks import (
    _triples,
    check,
    condition_of,
    doubtful,
    misfit,
    relabellings,
    well_spread,
)
from plumbline.optim.registration.fiducials import load_fiducials
from plumbline.optim.registration.markers import Markers
from plumbline.optim.registration.robust import _holds, levels_of
from plumbline.optim.registration.triples import usable_triples
from plumbline.optim.registration.words import trust
from tests.phantoms import ALIKE, CT, LESION, mapped, registered, save_fiducials
from tests.refusals import is_refused as refused

OFF = np.random.default_rng(1).normal(size=CT.shape)
FINE_NOISE = MarkerNoise.from_std(1e-5, 1e-5, freedoms=np.inf)


def exact(ct, noise=FINE_NOISE):
    """Markers (n, 3) that the robot finds where they are."""
    ct = np.asarray(ct, dtype=float)
    return Markers.of(ct, mapped(ct), noise)


def bent(degrees):
    """Three markers whose smallest inner angle is so large, one of them in the middle."""
    height = 0.1 * np.tan(np.radians(degrees))
    return np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, height, 0.0]])


def notes_of(ct, noise=FINE_NOISE, method=None):
    """What a registration of exact markers says."""
    return " ".join(registered(method or Kabsch(), ct, mapped(np.asarray(ct)), noise).notes)


@pytest.mark.parametrize(("times", "seen"), [(0.75, False), (1.5, True)])
class TestBothSides:
    """Three quarters of each threshold, and one and a half times it."""

    def test_markers_five_metres_apart_are_millimetres(self, times, seen):
        ct = np.array([[0, 0, 0], [5.0 * times, 0, 0], [0, 1, 0]])
        assert refused(exact, ct, match="divide by 1000") is seen

    def test_a_thousandth_is_a_unit(self, times, seen):
        small = CT / 400.0
        for factor in (300.0 * times, 3000.0 / times):
            markers = Markers.of(small, mapped(small) * factor, ALIKE)
            wrong = not refused(check, markers, match="divide by 1000")
            assert wrong is not seen

    def test_a_slice_of_five_centimetres_is_in_millimetres(self, tmp_path, times, seen):
        folder = save_fiducials(build_fiducials(CT, mapped(CT)), tmp_path / "bench")
        settings = folder / "dataset.toml"
        settings.write_text(settings.read_text() + f"ct_resolution = {0.05 * times}\n")
        assert refused(load_fiducials, folder, match="looks like mm") is seen

    def test_two_markers_a_micrometre_apart_are_two(self, times, seen):
        ct = np.vstack([CT, CT[0] + [1e-6 * times, 0, 0]])
        assert refused(check, exact(ct), match="two different places") is not seen

    def test_a_line_is_bent_by_less_than_a_degree(self, times, seen):
        assert refused(check, exact(bent(times)), match="at least 1 deg") is not seen
        four = np.vstack([bent(times), [[0.0, 0.02, 0.1]]])
        assert refused(ThreePoint().fit, exact(four), match="another triple") is not seen

    def test_a_line_bent_by_fifteen_degrees_is_nearly_one(self, times, seen):
        assert ("nearly on one line" in notes_of(bent(15.0 * times))) is not seen

    def test_a_plane_is_flat_below_a_twentieth(self, times, seen):
        rng = np.random.default_rng(0)
        basis = np.linalg.qr(np.c_[np.ones(6), rng.normal(size=(6, 3))])[0][:, 1:]
        ct = basis * [0.2, 0.1, 0.1 * 0.05 * times]
        assert ("lie in one plane" in notes_of(ct)) is not seen

    def test_a_turn_known_to_five_degrees_is_rough(self, times, seen):
        unit = registered(Kabsch(), CT, mapped(CT), MarkerNoise.from_std(1e-3, freedoms=np.inf))
        std = 1e-3 * np.radians(5.0) * times / unit.rotation_std
        assert ("rough" in notes_of(CT, MarkerNoise.from_std(std, freedoms=np.inf))) is seen

    def test_a_triple_of_two_degrees_adds_to_the_mean(self, times, seen):
        middle = np.vstack([bent(2.0 * times), [[0.0, 0.1, 0.1]]])
        narrow = {0, 1, 2}
        assert any(set(t) == narrow for t in usable_triples(exact(middle)).tolist()) is seen

    def test_a_covariance_even_to_a_billionth_is_one(self, times, seen):
        uneven = np.eye(3) * 1e-6
        uneven[0, 1] = 1e-15 * times
        noise = MarkerNoise(uneven, np.eye(3) * 1e-6)
        assert refused(exact, CT, noise, match="asymmetric") is seen
        least = MarkerNoise(np.diag([1.0, 1.0, -1e-9 * times]), np.eye(3))
        assert refused(exact, CT, least, match="negative variance") is seen

    def test_a_trillionth_of_the_largest_variance_is_a_noise(self, times, seen):
        noise = MarkerNoise(np.diag([1.0, 1.0, 1e-12 * times]), np.zeros((3, 3)))
        assert refused(exact, CT, noise, match="no error at all") is not seen

    def test_a_chance_of_one_in_a_thousand_is_doubted(self, times, seen):
        answer = registered(Kabsch(), CT, shaken(1e-3 * times), ALIKE)
        assert answer.surprise == pytest.approx(1e-3 * times, rel=1e-6)
        assert doubtful(Markers.of(CT, shaken(1e-3 * times), ALIKE)) is not seen
        assert np.isclose(answer.dof, 9.0) is not seen

    def test_a_misfit_of_a_hundredth_is_doubted_where_no_noise_is_stated(self, times, seen):
        assert doubtful(Markers.of(CT, shaken_by(0.01 * times))) is seen

    def test_a_misfit_of_a_tenth_is_no_pair(self, times, seen):
        answer = registered(Kabsch(), CT, shaken_by(0.1 * times), FINE_NOISE)
        assert ("labels went astray" in answer.unknown) is seen

    def test_a_target_found_to_two_millimetres_is_good_and_to_five_is_fair(self, times, seen):
        for limit, (near, far) in {2e-3: ("good", "fair"), 5e-3: ("fair", "poor")}.items():
            answer = registered(Kabsch(), CT, mapped(CT), FINE_NOISE)
            error = answer.tre(LESION)
            size = limit * times / error.reach
            said = trust(answer, replace(error, covariance=error.covariance * size**2), "M")
            assert said.startswith(f"M: {far if seen else near}")

    @pytest.mark.parametrize(("noise", "much"), [(FINE_NOISE, 3.0), (None, 10.0)])
    def test_what_fits_so_much_better_is_another_body(self, noise, much, times, seen):
        def given(size):
            """Markers of which a mirror image is found, with errors of a size [m]."""
            return Markers.of(CT, mapped(CT * [1, 1, -1]) + size * OFF, noise)

        def better(size):
            """How much better the mirror image fits."""
            markers = given(size)
            return misfit(markers) / misfit(replace(markers, ct=-markers.ct))

        size = brentq(lambda s: better(s) - much * times, 1e-5, 0.1)
        assert refused(check, given(size), match="a mirror image") is seen

    def test_a_good_marker_is_left_out_in_one_of_a_thousand(self, times, seen):
        wanted = chi2.isf(1e-3 / times / 5, 3)  # of five choices of one marker

        def drop(size):
            """What leaving the third marker out takes from the squares."""
            levels = levels_of(Markers.of(CT, pushed(size), ALIKE).rows, 1)
            return levels[0].squares[0] - levels[1].squares[0]

        size = brentq(lambda s: drop(s) - wanted, 1e-4, 0.1)
        stated = replace(ALIKE, freedoms=np.inf)
        assert (registered(Robust(), CT, pushed(size), stated).shifted == ("M3",)) is seen

    def test_a_good_marker_is_left_out_in_one_of_two_hundred_unstated(self, times, seen):
        wanted = fisher.isf(0.005 / times / 5, 3, 6)

        def ratio(size):
            """Fisher's F of the third marker's shift over what the rest misfits by."""
            levels = levels_of(Markers.of(CT, noisy(size)).rows, 1)
            left = levels[1].squares[0]
            return (levels[0].squares[0] - left) / 3 / (left / levels[1].dof)

        def noisy(size):
            return pushed(size) + 1e-4 * OFF

        size = brentq(lambda s: ratio(s) - wanted, 1e-4, 0.1)
        assert (registered(Robust(), CT, noisy(size)).shifted == ("M3",)) is seen

    def test_three_markers_within_five_degrees_hold_no_rotation(self, times, seen):
        assert _holds(bent(5.0 * times)) is seen


def pushed(size):
    """The robot's markers, the third one moved by so much [m]."""
    robot = mapped(CT)
    robot[2] += size * np.array([0.6, 0.0, 0.8])
    return robot


def test_the_hold_of_markers_near_a_line_is_told_a_tenth_of_a_metre_off_it():
    assert "a point 100 mm off it" in notes_of(bent(10.0))


def test_a_region_without_stated_noise_is_drawn_to_a_third_of_a_per_cent():
    region = registered(Kabsch(), CT, mapped(CT) + 1e-4 * OFF).tre(LESION)
    assert np.sqrt(0.95 * 0.05 / len(region.distances)) == pytest.approx(0.0035, rel=0.05)


def shaken_by(share):
    """The robot's markers, misfitting by a share of their spread."""
    spread = np.sqrt(np.mean(np.sum((CT - CT.mean(axis=0)) ** 2, axis=1)))
    return _scaled(lambda m: np.sqrt(np.mean(m**2)) / spread, share)


def shaken(chance):
    """The robot's markers, misfitting as ALIKE's noise does in such a share of all draws."""
    variance = ALIKE.ct[0, 0] + ALIKE.robot[0, 0]
    wanted = np.sqrt(chi2.isf(chance, 9) * variance)
    return _scaled(lambda m: np.sqrt(np.sum(m**2)), wanted)


def _scaled(measure, wanted):
    """Markers whose misfit has a wanted measure: a few steps on the size of the shifts."""
    size = 1e-9
    for _ in range(60):
        answer = registered(Kabsch(), CT, mapped(CT) + size * OFF, MarkerNoise.from_std(1.0))
        size *= wanted / measure(answer.misfits)
    return mapped(CT) + size * OFF


@pytest.mark.parametrize(("n", "count"), [(24, 24), (25, 24), (40, 24)])
def test_so_many_markers_stand_for_all(n, count):
    points = np.random.default_rng(0).normal(size=(n, 3))
    assert len(well_spread(points)) == count
    assert condition_of(points).angle > 50.0


@pytest.mark.parametrize(("n", "every"), [(7, True), (8, False)])
def test_of_seven_markers_every_order_is_tried(n, every):
    """Two pairs of near markers, both exchanged: no turn does that, nor an exchange of two."""
    ct = np.random.default_rng(0).uniform(-0.1, 0.1, (n, 3))
    ct[[1, 3]] = ct[[0, 2]] + 1e-3
    tried = [other.order for other in relabellings(ct, mapped(ct))]
    assert ((1, 0, 3, 2, *range(4, n)) in tried) is every


@pytest.mark.parametrize("n", [24, 40])
def test_two_hundred_triples_are_tried_for_one(n):
    ct = np.random.default_rng(0).uniform(-0.1, 0.1, (n, 3))
    apart = squareform(pdist(ct))
    assert len(_triples(apart[:3, :3], apart)) == 200


@pytest.mark.parametrize(("n", "most", "every"), [(14, 2, True), (15, 2, False)])
def test_a_hundred_choices_are_all_tried(n, most, every):
    rng = np.random.default_rng(0)
    ct = rng.uniform(-0.1, 0.1, (n, 3))
    robot = mapped(ct) + rng.normal(0, 1e-4, ct.shape)
    levels = levels_of(Markers.of(ct, robot, ALIKE).rows, most)
    assert (len(levels[2].squares) == levels[2].choices) is every
