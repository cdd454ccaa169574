"""Robots of the package of descriptions: as good as a URDF in the folder, or one line."""

import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.kinematics import robot as descriptions
from plumbline.kinematics.robot import Robot
from plumbline.optim.recording.loading import load_recording
from tests.recording_folders import complaint, postures, write_folder

TOLERANCE = 2e-4  # [m]: the maker rounds the lengths of the URDF and of the DH rows differently


def installed() -> bool:
    """Whether the optional package is there."""
    try:
        distribution(descriptions.PACKAGE)
    except PackageNotFoundError:
        return False
    return True


needs_package = pytest.mark.skipif(
    not installed(), reason=f"{descriptions.PACKAGE} is not installed: {descriptions.EXTRA}"
)


def described(folder, name):
    """A good folder whose robot is called by its description."""
    write_folder(folder)
    settings = folder / "dataset.toml"
    lines = settings.read_text().splitlines()
    swapped = [f'description = "{name}"' if "bundled" in line else line for line in lines]
    kept = [line for line in swapped if not line.startswith("tip_frame")]
    settings.write_text("\n".join(kept) + "\n")
    return folder


def test_without_the_package_one_line_names_the_extra(tmp_path, monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(descriptions, "distribution", missing)
    said = complaint(described(tmp_path / "case", "ur10"))
    assert "dataset.toml" in said
    assert 'pip install "plumbline-robotics[robots]"' in said


def test_the_extra_brings_the_package():
    root = Path(__file__).resolve().parents[2]
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    extra = project["optional-dependencies"]["robots"]
    assert [line.split(">")[0] for line in extra] == [descriptions.PACKAGE]
    assert f"{project['name']}[robots]" in descriptions.EXTRA


@needs_package
def test_a_described_arm_is_the_bundled_arm():
    q = postures()
    ours = Robot.bundled("ur10").chain().placement(q)[:, :3, 3]
    theirs = Robot.described("ur10").chain("tool0").placement(q)[:, :3, 3]
    # Their base is turned by half a turn about z, which no length sees.
    np.testing.assert_allclose(
        np.linalg.norm(theirs, axis=1), np.linalg.norm(ours, axis=1), atol=TOLERANCE
    )


@needs_package
def test_an_unknown_name_is_refused_with_the_nearest_ones():
    with pytest.raises(PlumblineError, match=r"'ur11' not recognised\. Best matches are .*ur10"):
        Robot.described("ur11")


@needs_package
def test_a_recording_names_its_robot_by_description(tmp_path):
    recording = load_recording(described(tmp_path / "case", "ur5"))
    assert recording.robot.name == "ur5"
    assert recording.robot.urdf is not None
    other = load_recording(described(tmp_path / "other", "ur10"))
    assert recording.sha256 != other.sha256  # the description is part of what is hashed
