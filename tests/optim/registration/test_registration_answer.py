"""A registration is asked in one way, and its answer judged, shown, drawn, stored, brought back."""

from dataclasses import replace

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.optim.registration import METHODS, BestTriple, Fiducials, RegistrationOptions
from tests.answer_contract import keeps_the_contract, same
from tests.phantoms import ALIKE, CT, FIVE, LABELS, LESION, NOISE, mapped, readings, save_fiducials


def recording(noise=NOISE, which=FIVE, seed=0, **given) -> Fiducials:
    """Markers of the phantom and its lesion."""
    ct, robot = readings(which, ALIKE, seed)
    names = [LABELS[k] for k in which]
    return plumbline.build_fiducials(
        ct, robot, noise=noise, labels=names, **{"targets": {"M": LESION}, **given}
    )


@pytest.mark.parametrize("method", METHODS)
def test_the_answer_of_every_method_keeps_the_contract(method, tmp_path):
    keeps_the_contract(plumbline.register(recording(), RegistrationOptions(method)), tmp_path)


@pytest.mark.parametrize("which", [FIVE, FIVE[:3]], ids=len)
def test_an_answer_without_stated_noise_keeps_the_contract(which, tmp_path):
    keeps_the_contract(plumbline.register(recording(None, which)), tmp_path)


def test_an_answer_is_brought_back_with_all_that_it_can_say(tmp_path):
    for k, noise in enumerate((ALIKE, None)):
        answer = plumbline.register(recording(noise))
        answer.save(tmp_path / f"{k}.json")
        again = plumbline.load(tmp_path / f"{k}.json")
        assert type(again) is type(answer)
        places = np.random.default_rng(0).uniform(-0.1, 0.2, (3, 3))
        assert np.array_equal(again.tre_rms(places), answer.tre_rms(places))
        for place in places:
            assert again.tre(place, None).reach == answer.tre(place, None).reach


def test_a_folder_is_asked_as_its_recording_is(tmp_path):
    whole = recording()
    folder = save_fiducials(whole, tmp_path / "bench")
    one, two = plumbline.register(folder).to_dict(), plumbline.register(plumbline.load(folder))
    same(one, two.to_dict())
    assert np.allclose(two.T_RC, plumbline.register(whole).T_RC, atol=1e-8)


def test_noise_that_options_state_is_that_of_the_recording():
    stated = plumbline.register(recording(ALIKE)).to_dict()
    same(plumbline.register(recording(None), RegistrationOptions(noise=ALIKE)).to_dict(), stated)
    same(plumbline.register(recording(NOISE), RegistrationOptions(noise=ALIKE)).to_dict(), stated)


def test_a_method_and_its_name_are_one_choice():
    for name, method in METHODS.items():
        one, two = (plumbline.register(recording(), RegistrationOptions(m)) for m in (name, method))
        same(one.to_dict(), two.to_dict())
    assert plumbline.register(recording()).method == "robust"


def test_the_best_triple_is_the_one_for_the_first_target():
    given = recording(targets={"M": LESION, "L": CT[0]})
    best = plumbline.register(given, RegistrationOptions("best-triple"))
    named = plumbline.register(given, RegistrationOptions(BestTriple(tuple(LESION))))
    elsewhere = plumbline.register(given, RegistrationOptions(BestTriple(tuple(CT[0]))))
    assert best.used == named.used != elsewhere.used


@pytest.mark.parametrize(("aside", "within"), [(0.0, True), (0.01, False)])
def test_a_target_that_was_measured_has_its_real_error(aside, within):
    given = recording(ALIKE)
    there = mapped(LESION)[None] + [[0.0, 0.0, aside]]
    measured = replace(given, targets=replace(given.targets, robot=there))
    (target,) = plumbline.register(measured).to_dict()["targets"]
    gap = np.array(target["robot"]) - there[0]
    assert target["measured_error"] == pytest.approx(np.linalg.norm(gap))
    assert target["within95"] is within


REFUSALS = {
    "method": (lambda: RegistrationOptions("kabsh"), "Best matches are kabsch"),
    "no method": (lambda: RegistrationOptions(3), "expected a Method or text"),
    "arrays": (lambda: plumbline.register(CT), "build_fiducials"),
    "target": (lambda: recording(targets={"M": [1.0, 2.0]}), "target M: found \\[1.0, 2.0\\]"),
    "name": (lambda: recording(targets={"A": LESION}), "every label once"),
    "shapes": (lambda: plumbline.build_fiducials(CT, CT[:3]), "one row a marker"),
    "place": (lambda: plumbline.register(recording()).map([0.1, 0.2]), r"found shape \(2,\)"),
    "no place": (lambda: plumbline.register(recording()).map([0.1, np.nan, 0.2]), "1 numbers not"),
    "place in mm": (
        lambda: plumbline.register(recording()).map(1e3 * LESION),
        "m from the markers, expected at most 5 m; looks like mm",
    ),
    "label": (lambda: plumbline.register(recording()).tre("M"), "give x, y and z, not a label"),
    "noise in mm": (
        lambda: plumbline.MarkerNoise.from_resolution([5.0, 1.0, 1.0], 1e-4),
        r"noise: found 5 m, expected at most 0\.05 m; looks like mm",
    ),
    "two": (lambda: plumbline.build_fiducials(CT[:2], CT[:2]), "at least 3"),
}


@pytest.mark.parametrize("what", REFUSALS)
def test_what_cannot_be_asked_is_refused_in_one_line(what):
    call, words = REFUSALS[what]
    with pytest.raises(PlumblineError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
