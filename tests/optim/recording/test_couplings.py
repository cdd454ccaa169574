"""Laws of couplings that are known: mimic joints of a URDF, and what a joint adds to another."""

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.optim.recording.loading import load_recording
from tests.random_trees import Tree

FOLLOWS = '<mimic joint="{}" multiplier="-0.5" offset="0.1"/>'


def folder(tmp_path, *, mimic=None, extra=""):
    """A folder of a robot of three joints, the third of which may follow the first."""
    text = Tree(3, ("revolute",) * 3).urdf()
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (20, 3))
    names = [part.split('"')[0] for part in text.split('<joint name="')[1:]]
    moving = [n for n in names if f'<joint name="{n}" type="fixed"' not in text]
    if mimic:
        at = text.index(f'<joint name="{moving[2]}"')
        end = text.index("</joint>", at)
        text = text[:end] + FOLLOWS.format(moving[0]) + text[end:]
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    (tmp_path / "dataset.toml").write_text(
        f'observation = "tip_position"\n[robot]\nurdf = "robot.urdf"\n{extra}\n'
        "[tool]\noffset = [0, 0, 0.1]\n",
        encoding="utf-8",
    )
    shown = q[:, :2] if mimic else q
    measured = rng.uniform(-0.3, 0.3, (20, 3))
    header = ",".join([f"q{k + 1}" for k in range(shown.shape[1])] + ["x", "y", "z"])
    table = np.hstack([shown, measured])
    np.savetxt(tmp_path / "samples.csv", table, delimiter=",", header=header, comments="")
    return tmp_path, q


def test_a_joint_that_mimics_another_needs_no_column(tmp_path):
    place, q = folder(tmp_path, mimic=True)
    read = load_recording(place)
    np.testing.assert_allclose(read.q[:, :2], q[:, :2], atol=1e-12)
    np.testing.assert_allclose(read.q[:, 2], 0.1 - 0.5 * q[:, 0], atol=1e-12)


def test_a_known_coupling_is_added_to_the_reading(tmp_path):
    place, q = folder(tmp_path, extra="couplings = [[2, 1, -0.4]]")
    read = load_recording(place)
    np.testing.assert_allclose(read.q[:, 1], q[:, 1] - 0.4 * q[:, 0], atol=1e-12)
    np.testing.assert_allclose(read.q[:, [0, 2]], q[:, [0, 2]], atol=1e-12)
    assert not [note for note in read.notes if "couplings" in note]


@pytest.mark.parametrize("wrong", ["[[2, 2, 1.0]]", "[[2, 7, 1.0]]", "[[2, 1]]", '"all"'])
def test_a_coupling_that_is_none_is_refused(tmp_path, wrong):
    place, _ = folder(tmp_path, extra=f"couplings = {wrong}")
    with pytest.raises(PlumblineError, match="couplings"):
        load_recording(place)
