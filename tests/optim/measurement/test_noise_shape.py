"""Laws of a noise that is stated for each axis or row, and of an instrument's stated scale."""

from dataclasses import replace

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.measurement.observation import build_model, scope_of
from plumbline.optim.recording.loading import load_recording
from tests.benches import bench, residuals
from tests.scanned import scanned_as_modelled

AXES = [1e-4, 1e-4, 4e-4]


@pytest.mark.parametrize("observation", ["tip_position", "pose", "fixed_point", "joint_position"])
def test_residuals_are_divided_by_what_their_noise_is_more(observation):
    rows = np.linspace(1e-4, 3e-4, 60)
    plain = bench("ur5", observation)
    shaped = bench("ur5", observation, noise_rows=rows)
    effect = REGISTRY["joint_offset"](joint=3)
    ratio = rows / np.sqrt(np.mean(rows**2))
    assert shaped.noise_std == pytest.approx(np.sqrt(np.mean(rows**2)))
    expected = residuals(plain, [effect], [1e-3]) / ratio[:, None]
    np.testing.assert_allclose(residuals(shaped, [effect], [1e-3]), expected, atol=1e-15)


def test_axes_and_rows_together_keep_their_ratios():
    rows = np.repeat([1e-4, 2e-4], 30)
    recording = bench("ur5", "tip_position", noise_axes=AXES, noise_rows=rows)
    sigma = recording.noise_std * recording.noise_shape
    np.testing.assert_allclose(sigma[:, 2] / sigma[:, 0], 4.0)
    np.testing.assert_allclose(np.sqrt(np.mean(sigma**2, axis=1)), rows)
    part = recording.select(np.arange(40))
    np.testing.assert_allclose(part.noise_shape, recording.noise_shape[:40])


def test_readings_of_a_good_axis_count_more():
    """The errors of a fit are those of weighted least squares: each axis at its own noise."""
    recording = bench("ur5", "tip_position", noise_axes=AXES)
    model = build_model(recording, [REGISTRY["joint_offset"](joint=2)])
    J = np.concatenate([J for _, _, J in Mapped(model.problem).jacobians(model.start)])
    plain = build_model(bench("ur5", "tip_position"), [REGISTRY["joint_offset"](joint=2)])
    own = np.concatenate([J for _, _, J in Mapped(plain.problem).jacobians(plain.start)])
    expected = own / (np.array(AXES) / np.sqrt(np.mean(np.square(AXES))))[:, None]
    np.testing.assert_allclose(J, expected, atol=1e-12)


@pytest.mark.parametrize("name", ["respiration", "base_bump", "tool_slip", "gear_ripple"])
def test_what_is_scanned_is_weighed_as_the_model_is(name):
    recording = bench(
        "ur5", "tip_position", noise_axes=AXES, noise_rows=np.linspace(1e-4, 2e-4, 60)
    )
    scanned_as_modelled(name, recording)


def test_a_noise_that_is_none_is_refused():
    for given in ({"noise_axes": [1e-4, 0.0, 1e-4]}, {"noise_axes": [1e-4]}):
        with pytest.raises(PlumblineError, match="noise_std"):
            bench("ur5", "tip_position", **given)
    with pytest.raises(PlumblineError, match="one number"):
        bench("ur5", "fixed_point", noise_axes=AXES)


def test_a_folder_states_noise_and_scale(tmp_path):
    settings = (
        'name = "a"\nobservation = "tip_position"\nnoise_std = [1e-4, 1e-4, 4e-4]\n'
        '[robot]\nbundled = "ur5"\n[instrument]\nscale_std = 2e-5\n[tool]\noffset = [0, 0, 0.1]\n'
    )
    (tmp_path / "dataset.toml").write_text(settings, encoding="utf-8")
    recording = bench("ur5", "tip_position")
    table = np.column_stack([recording.q, recording.measured, np.full(60, 3e-4)])
    header = "q1,q2,q3,q4,q5,q6,x,y,z,noise_std"
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header=header, comments="")
    read = load_recording(tmp_path)
    assert read.noise_std == pytest.approx(3e-4)
    np.testing.assert_allclose(read.noise_shape[:, 2] / read.noise_shape[:, 1], 4.0)
    assert read.scale_std == 2e-5
    assert not [note for note in read.notes if "not used" in note]
    named = settings.replace("[instrument]\nscale_std = 2e-5\n", "")
    (tmp_path / "dataset.toml").write_text(f'instrument = "a tracker"\n{named}', encoding="utf-8")
    assert load_recording(tmp_path).scale_std is None


@pytest.mark.parametrize(
    ("stated", "found"), [("[1e-4, 1e-4]", "2 numbers, expected 3"), ("[1e-4, 0.0, nan]", "0, ")]
)
def test_a_noise_of_a_folder_that_is_none_is_refused_where_it_stands(tmp_path, stated, found):
    settings = f'observation = "tip_position"\nnoise_std = {stated}\n[robot]\nbundled = "ur5"\n'
    (tmp_path / "dataset.toml").write_text(settings, encoding="utf-8")
    recording = bench("ur5", "tip_position")
    table = np.column_stack([recording.q, recording.measured])
    header = "q1,q2,q3,q4,q5,q6,x,y,z"
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header=header, comments="")
    with pytest.raises(PlumblineError, match=f"^dataset.toml, row 2, noise_std: found {found}"):
        load_recording(tmp_path)


def test_a_scale_is_looked_for_within_what_its_maker_states():
    recording = bench("ur5", "tip_position", scale_std=2e-5)
    for effect in REGISTRY["sensor_scale"].candidates(scope_of(recording)):
        for p in effect.parameters:
            assert (p.prior.width, p.prior.lower, p.prior.upper) == (2e-5, -8e-5, 8e-5)
            assert "maker" in p.prior.source
    free = REGISTRY["sensor_scale"].candidates(scope_of(replace(recording, scale_std=None)))
    assert free[0].parameters[0].scale == 3e-4
