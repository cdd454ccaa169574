"""Public recordings are pinned, fetched once, refused when wrong and never written over others.

No data is needed: a made-up file stands in for a source's.
"""

from __future__ import annotations

import hashlib
import logging
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pooch
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments import sources
from plumbline.experiments.sources import Source, SourceFile, fetch, list_sources
from plumbline.experiments.sources.landgraf_ur10 import approach_sides
from plumbline.experiments.sources.weigand_kr300 import held_direction

NAMES = (
    "ur10-grid",
    "ur10-joints",
    "ur10-iso",
    "ur5-grid",
    "ur5-random",
    "panda-1",
    "panda-1-sensor",
    "panda-3",
    "kuka-iiwa14",
    "dinova-1",
    "kr300",
    "kr300-b",
    "so101-multisine",
    "so101-friction-gravity",
    "so101-step-response",
    "so101-chirp-sweep",
    "so101-hold-under-gravity",
    "so101-slow-precision",
    "so101-backlash-detection",
    "so101-workspace-sweep",
    "go2-chirp",
    "ur10-exciting",
)
LICENCES = ("MIT", "Apache-2.0", "BSD-3-Clause")
TABLE = (
    "step_order,x_t,y_t,z_t,x_dif,y_dif,z_dif,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n"
    "0,100,200,300,1,-2,3,180,90,45,-90,0,30\n"
    "1,110,210,310,0,0,0,0,0,0,0,0,0\n"
)


def _by_name(name: str) -> Source:
    return next(source for source in list_sources() if source.name == name)


def _one_line(error: pytest.ExceptionInfo[PlumblineError]) -> str:
    message = str(error.value)
    assert "\n" not in message
    return message


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """`ur5-random` replaced by a made-up table of two rows; returns its place in the cache."""
    sha256 = hashlib.sha256(TABLE.encode()).hexdigest()
    source = replace(_by_name("ur5-random"), files=(SourceFile("UR5/small.csv", sha256),))
    monkeypatch.setitem(sources._CATALOGUE, "ur5-random", source)
    monkeypatch.setenv("PLUMBLINE_DATA", str(tmp_path / "cache"))
    monkeypatch.setattr("pooch.retrieve", _no_network)
    return tmp_path / "cache" / source.folder / "UR5" / "small.csv"


def _no_network(url: str, **_: object) -> str:
    raise ConnectionError(f"no network\nfor {url}")


def _put(local: Path, text: str = TABLE) -> None:
    local.parent.mkdir(parents=True)
    local.write_text(text)


def test_every_promised_name_is_listed_once() -> None:
    assert tuple(source.name for source in list_sources()) == NAMES


@pytest.mark.parametrize("source", list_sources(), ids=lambda source: source.name)
def test_every_file_is_pinned_by_commit_and_hash(source: Source) -> None:
    assert re.fullmatch("[0-9a-f]{40}", source.commit)
    assert source.licence.startswith(tuple(f"{name}, Copyright (c) 20" for name in LICENCES))
    assert len({file.path for file in source.files}) == len(source.files) > 0
    for file in source.files:
        assert re.fullmatch("[0-9a-f]{64}", file.sha256)
        assert source.commit in source.file_url(file)
        assert re.fullmatch(r"https://raw\.githubusercontent\.com/[\w./%-]+", source.file_url(file))


def test_spaces_of_a_path_are_quoted_in_its_address() -> None:
    source = _by_name("kr300")
    assert source.file_url(source.files[0]).endswith("/2020-10-21%2010s%20FF%20A%2008ms/data.mat")


def test_an_unknown_name_is_answered_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(PlumblineError) as error:
        fetch("ur10-gird", tmp_path)
    assert _one_line(error).startswith(
        "Source 'ur10-gird' not recognised. Best matches are 'ur10-grid', "
    )
    assert not list(tmp_path.iterdir())


def test_an_error_is_a_value_error() -> None:
    assert issubclass(PlumblineError, ValueError)


def test_degrees_become_radians_and_the_tip_is_target_minus_error(
    small: Path, tmp_path: Path
) -> None:
    _put(small)
    samples = pd.read_csv(fetch("ur5-random", tmp_path / "out") / "samples.csv")
    joints = samples[[f"q{j}" for j in range(1, 7)]].to_numpy()
    np.testing.assert_allclose(joints[0] / np.pi, [1, 1 / 2, 1 / 4, -1 / 2, 0, 1 / 6], atol=1e-11)
    np.testing.assert_allclose(samples[["x", "y", "z"]].iloc[0], [0.099, 0.202, 0.297], atol=1e-11)
    np.testing.assert_allclose(samples[["x", "y", "z"]].iloc[1], [0.110, 0.210, 0.310], atol=1e-11)


def test_the_folder_says_where_it_comes_from(small: Path, tmp_path: Path) -> None:
    _put(small)
    dataset = tomllib.loads((fetch("ur5-random", tmp_path) / "dataset.toml").read_text())
    source = _by_name("ur5-random")
    assert dataset["name"] == "ur5-random"
    assert source.commit in dataset["source"]
    assert dataset["citation"] == source.citation
    assert dataset["licence"] == source.licence
    assert dataset["sha256"] == {"UR5/small.csv": hashlib.sha256(TABLE.encode()).hexdigest()}


def test_the_current_folder_is_where_it_goes_unless_told(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _put(small)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert fetch("ur5-random") == tmp_path / "here" / "ur5-random"


def test_what_exists_is_never_overwritten(small: Path, tmp_path: Path) -> None:
    _put(small)
    kept = tmp_path / "out" / "ur5-random" / "mine.txt"
    kept.parent.mkdir(parents=True)
    kept.write_text("mine")
    with pytest.raises(PlumblineError, match="exists and is not empty: move it away") as error:
        fetch("ur5-random", tmp_path / "out")
    assert str(kept.parent) in _one_line(error)
    assert [path.name for path in kept.parent.iterdir()] == ["mine.txt"]
    assert kept.read_text() == "mine"


def test_a_file_in_the_way_is_refused(small: Path, tmp_path: Path) -> None:
    _put(small)
    (tmp_path / "ur5-random").write_text("a file")
    with pytest.raises(PlumblineError, match="exists and is no folder"):
        fetch("ur5-random", tmp_path)
    assert (tmp_path / "ur5-random").read_text() == "a file"


def test_an_empty_folder_is_filled(small: Path, tmp_path: Path) -> None:
    _put(small)
    (tmp_path / "ur5-random").mkdir()
    folder = fetch("ur5-random", tmp_path)
    assert sorted(path.name for path in folder.iterdir()) == ["dataset.toml", "samples.csv"]


def test_a_folder_appears_whole_or_not_at_all(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    _put(small)
    monkeypatch.setattr(pd.DataFrame, "to_csv", full_disk)
    with pytest.raises(PlumblineError, match="No space left on device") as error:
        fetch("ur5-random", tmp_path / "out")
    _one_line(error)
    assert not list((tmp_path / "out").iterdir())


def test_a_changed_file_is_refused_and_left_alone(small: Path, tmp_path: Path) -> None:
    _put(small, TABLE.replace("300", "301"))
    with pytest.raises(PlumblineError, match=r"has SHA-256 .* expected .* remove it") as error:
        fetch("ur5-random", tmp_path / "out")
    assert str(small) in _one_line(error)
    assert small.read_text() == TABLE.replace("300", "301")
    assert not (tmp_path / "out").exists()


def test_a_file_is_downloaded_once(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []

    def deliver(url: str, known_hash: str, fname: str, path: str) -> str:
        asked.append((url, known_hash))
        _put(Path(path) / fname)
        return str(Path(path) / fname)

    monkeypatch.setattr("pooch.retrieve", deliver)
    fetch("ur5-random", tmp_path / "one")
    fetch("ur5-random", tmp_path / "two")
    source = sources._CATALOGUE["ur5-random"]
    assert asked == [(source.file_url(source.files[0]), f"sha256:{source.files[0].sha256}")]


def test_a_download_is_named_only_when_asked(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    listener = logging.Handler()
    monkeypatch.setattr(listener, "emit", lambda record: told.append(record.getMessage()))

    def deliver(url: str, known_hash: str, fname: str, path: str) -> str:
        pooch.get_logger().info("fetching %s", fname)
        _put(Path(path) / fname)
        return str(Path(path) / fname)

    monkeypatch.setattr("pooch.retrieve", deliver)
    pooch.get_logger().addHandler(listener)
    try:
        fetch("ur5-random", tmp_path / "aloud", progress=True)
        assert told == ["fetching small.csv"]
        shutil.rmtree(small.parent)
        fetch("ur5-random", tmp_path / "quiet")
        assert told == ["fetching small.csv"]
    finally:
        pooch.get_logger().removeHandler(listener)


def test_a_failed_download_is_told_in_one_line(small: Path, tmp_path: Path) -> None:
    with pytest.raises(PlumblineError, match=r"could not be fetched .no network for") as error:
        fetch("ur5-random", tmp_path / "out")
    assert str(small) in _one_line(error)
    assert not (tmp_path / "out").exists()


def test_a_read_only_cache_is_never_written_into(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def must_not(*_: object, **__: object) -> None:
        raise AssertionError("asked for a download into a read-only folder")

    monkeypatch.setattr("pooch.retrieve", must_not)
    cache = tmp_path / "cache"
    cache.mkdir()
    cache.chmod(0o555)
    try:
        with pytest.raises(
            PlumblineError, match=r"is missing and .* cannot be written to"
        ) as error:
            fetch("ur5-random", tmp_path / "out")
        assert not list(cache.iterdir())
    finally:
        cache.chmod(0o755)
    message = _one_line(error)
    assert str(small) in message
    assert "https://raw.githubusercontent.com/" in message
    assert "PLUMBLINE_DATA" in message


def test_without_the_variable_the_systems_cache_is_used(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PLUMBLINE_DATA")
    monkeypatch.setattr("pooch.os_cache", lambda project: tmp_path / "system" / project)
    _put(tmp_path / "system" / "plumbline" / "jacobi_ur5_wam" / "UR5" / "small.csv")
    assert (fetch("ur5-random", tmp_path / "out") / "samples.csv").is_file()


def test_a_side_of_approach_is_claimed_only_for_a_short_clear_step() -> None:
    joints = np.array([[0.0, 0.0], [0.5, -0.5], [0.5005, -0.4], [0.0, 0.0]])
    time = np.array([0.0, 10.0, 20.0, 100.0])
    np.testing.assert_array_equal(approach_sides(joints, time), [[0, 0], [1, -1], [0, 1], [0, 0]])


def test_a_direction_is_held_at_rest() -> None:
    velocity = np.array([[0.0, 1e-5], [0.1, -0.2], [1e-5, 1e-5], [-0.1, 0.0]])
    np.testing.assert_array_equal(held_direction(velocity), [[0, 0], [1, -1], [1, -1], [-1, -1]])
