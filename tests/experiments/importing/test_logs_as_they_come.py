"""Laws of logs as laboratories have them: doubled rows, odd clocks, joints that lack."""

import json

import numpy as np
import pandas as pd
import pytest

import plumbline
from plumbline import PlumblineError, Robot, import_files
from plumbline.experiments.importing import mapping, parquet, targets, text, understood
from plumbline.experiments.importing.tables import Raw
from plumbline.experiments.importing.understood import Request, understand
from plumbline.experiments.importing.units import UNITS

N = 12
JOINTS = tuple(f"q{k}" for k in range(1, 7))
Q = np.random.default_rng(7).uniform(-1.0, 1.0, (N, 6))
TIPS = Robot.bundled("ur5").chain().tips(Q, [0.0, 0.0, 0.1])
TIME = 1.0 * np.arange(N)


def table(name, columns):
    return Raw(name, {key: np.asarray(value) for key, value in columns.items()}, "made up")


def arm(time=TIME):
    return table("arm.csv", dict(zip(("time", *JOINTS), (time, *Q.T), strict=True)))


def tracker(time=TIME):
    return table("tracker.csv", dict(zip(("time", *"xyz"), (time, *TIPS.T), strict=True)))


def refused(raws, match, **asked):
    with pytest.raises(PlumblineError, match=match):
        understand(raws, Request(joints=JOINTS, **asked))


def test_a_shift_of_a_clock_that_no_table_has_is_refused():
    refused([arm(), tracker()], "no table 'hand'", gap=0.1, shifts={"hand": 1.0})
    late = understand([arm(TIME + 5.0), tracker()], Request(gap=0.1, shifts={"arm": -5.0}))
    assert len(late.samples) == N


def test_tables_without_a_clock_are_asked_for_it_at_once():
    bare = table("tracker.csv", dict(zip("xyz", TIPS[:5].T, strict=True)))
    refused([arm(), bare], r"say --gap 0.01 \(in s\) --map time=tracker.csv@COLUMN:s")
    refused([arm(), bare], r"say --map time=tracker.csv@COLUMN:s", gap=0.1)


def test_a_map_of_a_clock_that_no_table_has_is_refused():
    asked = Request(joints=JOINTS, columns=[mapping.parse("time=T")])
    log = {**dict(zip(JOINTS, Q.T, strict=True)), **dict(zip("xyz", TIPS.T, strict=True))}
    with pytest.raises(PlumblineError, match="--map T: no such column among 9"):
        understand([table("log.csv", log)], asked)
    found = understand([table("log.csv", {**log, "T [ms]": 1e3 * TIME})], asked)
    np.testing.assert_allclose(found.samples["time"], TIME)


def test_dates_that_are_not_iso_are_told_what_one_is():
    dates = [f"01.02.2024 10:00:{k:02d},5" for k in range(N)]
    refused([arm(dates), tracker()], "a date as 2026-11-28T10:00:00.5", gap=0.1)


def test_a_gap_is_no_less_than_nothing(tmp_path):
    log = tmp_path / "log.csv"
    pd.DataFrame({"q1": [0.0, 1.0]}).to_csv(log)
    with pytest.raises(PlumblineError, match="gap -1: expected seconds, 0 or more"):
        import_files(log, tmp_path / "made", robot="ur5", gap=-1.0)


def test_tables_that_do_not_meet_say_how_far_apart_they_are():
    refused(
        [arm(TIME + 0.2), tracker()],
        r"nearest 0\.2 s late; .* 0 to 11 s .* 0\.2 to 11\.2 s",
        gap=0.1,
    )
    refused([arm(TIME - 30.0), tracker()], r"nearest 19 s early", gap=0.1)


@pytest.mark.parametrize(("clock", "taken"), [(0.9e11, True), (1.1e11, False)])
def test_a_clock_beyond_the_year_5138_is_in_another_unit(clock, taken):
    raws = [table("log.csv", {"time": [0.0, clock], "q1": [0, 1], "m1": [0, 1]})]
    if taken:
        assert understand(raws, Request()).samples["time"].max() == clock
    else:
        refused(raws, r"a clock at 1\.1e\+11 s.*say its unit: --map time=log.csv@time:ns")


@pytest.mark.parametrize("stamp", [1.7e18, 1.7e15, 1.7e12])
def test_stamps_of_our_time_that_are_not_seconds_are_told(stamp):
    assert 1.7e9 < understood.LATEST < stamp


def test_a_row_that_a_log_holds_twice_was_read_once():
    again = np.r_[TIME, TIME[:3]]
    rows = dict(
        zip((*JOINTS, *"xyz"), np.vstack([np.c_[Q, TIPS], np.c_[Q, TIPS][:3]]).T, strict=True)
    )
    found = understand([table("log.csv", {"time": again, **rows})], Request())
    assert len(found.samples) == N
    assert "3 rows left out: copies of another, clock and all" in found.notes
    still = understand([table("log.csv", rows)], Request())
    assert len(still.samples) == N + 3, "without a clock two rows alike may be two readings"


@pytest.mark.parametrize(("lacking", "said"), [((), "q6"), (("q2",), "q2 and q6|q2, q6")])
def test_the_joints_that_lack_a_column_are_named(lacking, said):
    columns = {f"position.{name}": TIME for name in JOINTS[:5] if name not in lacking}
    names = tuple(f"ax{name}" for name in JOINTS)
    columns = {key.replace("q", "axq"): value for key, value in columns.items()}
    with pytest.raises(PlumblineError, match="is called as (" + said.replace("q", "axq") + ")"):
        understand([table("log", {**columns, **dict.fromkeys("xyz", TIME)})], Request(joints=names))


def test_a_joint_that_mimics_another_needs_no_column_in_a_log_either():
    names, kinds = tuple(f"ax{k}" for k in range(1, 4)), ("revolute", "revolute", "prismatic")
    rows = {"ax1": TIME, "ax3": TIME, **dict.fromkeys("xyz", TIME)}
    asked = Request(
        joints=names, kinds=kinds, followers=("ax2",), units=(UNITS["mm"], UNITS["deg"])
    )
    found = understand([table("log", rows)], asked)
    assert found.sources["q1"].unit == "deg"
    assert found.sources["q2"].unit == "mm"
    assert found.sources["q2"].place == "log@ax3"


def test_of_several_units_the_likeliest_is_meant_where_joints_are_not_known():
    units = UNITS["mm"], UNITS["deg"]
    assert targets.unit_for("q1", None, units, ()).name == "deg"
    assert targets.unit_for("x", None, units, ()).name == "mm"


@pytest.mark.parametrize(
    ("cells", "mark", "comma"),
    [
        (["0,1234", "12,5"], ",", True),
        (["0,1234", "1,234"], ",", True),
        (["1,234", "12,345"], ",", False),  # thousands, it may be
        (["1,2", "0.5"], ",", False),
        (["1,234"], ";", True),
        (["1.5"], ",", False),
    ],
)
def test_quoted_cells_hold_decimal_commas_unless_they_may_be_thousands(cells, mark, comma):
    assert text._decimal_commas(cells, mark) is comma


def test_a_quoted_log_with_decimal_commas_between_commas_is_read(tmp_path):
    rows = pd.DataFrame(np.c_[Q, TIPS], columns=[*JOINTS, *"xyz"])
    cells = rows.map(lambda value: f"{value:.9f}".replace(".", ","))
    cells.to_csv(tmp_path / "log.csv", index=False, quoting=1)
    made = import_files(tmp_path / "log.csv", tmp_path / "made", robot="ur5", tool="0,0,100mm")
    np.testing.assert_allclose(made.q, Q, atol=1e-8)
    np.testing.assert_allclose(made.measured, TIPS, atol=1e-8)


STEPS = 0.1 * np.arange(60)


def motion(time, group=None):
    command = np.r_[np.sin(STEPS[:30]), 2.0 + np.sin(STEPS[:30])][:, None]
    robot = Robot.from_dh([{"a": 0.3, "alpha": 0.0}])
    return plumbline.build_motion(robot=robot, time=time, command=command, q=command, group=group)


def test_motions_that_have_numbers_are_not_told_apart_once_more():
    assert any("elsewhere at once" in note for note in motion(STEPS).notes)
    numbered = motion(STEPS, np.repeat([0, 1], 30))
    assert not any("elsewhere at once" in note for note in numbered.notes)


@pytest.mark.parametrize(("other", "mend"), [(4, "delete one of the two"), (3, "sort the rows")])
def test_of_two_rows_of_one_time_one_is_to_be_deleted(other, mend):
    time = STEPS.copy()
    time[5] = time[other]
    with pytest.raises(PlumblineError, match=mend):
        motion(time)


def data_set(folder, *, names, frames=2 * N, info=None):
    """A LeRobot data set of two joints and two episodes, a file each, as v2.1 writes it."""
    pytest.importorskip("pyarrow")
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    parts = {key: {"names": names} for key in ("action", "observation.state")}
    told = json.dumps({"features": parts, "total_frames": frames})
    (folder / "meta/info.json").write_text(told if info is None else info)
    for episode in range(2):
        rows = {"action": list(Q[:, :2]), "observation.state": list(Q[:, 2:4]), "timestamp": TIME}
        one = pd.DataFrame({**rows, "episode_index": episode})
        one.to_parquet(folder / f"data/chunk-000/episode_{episode:06d}.parquet")
    return folder


@pytest.mark.parametrize(
    ("names", "frames", "said"),
    [
        (["lift", "turn"], 2 * N, ()),
        (["lift", "turn"], 3 * N, ("meta/info.json states 36 frames, 24 are here",)),
        (None, 2 * N, (parquet.UNNAMED,)),
        (["lift"], 2 * N, (parquet.UNNAMED,)),
    ],
)
def test_a_data_set_that_lacks_frames_or_names_is_told(tmp_path, names, frames, said):
    [raw] = parquet.read_dataset(data_set(tmp_path / "set", names=names, frames=frames))
    assert raw.notes == said
    assert len(raw) == 2 * N


@pytest.mark.parametrize("info", ["{", "[1, 2]", ""])
def test_a_data_set_whose_description_is_broken_is_refused(tmp_path, info):
    with pytest.raises(PlumblineError, match=r"meta/info\.json: found no table of JSON"):
        parquet.read_dataset(data_set(tmp_path / "set", names=["lift", "turn"], info=info))
