"""The bundled robots against their vendors' drawings and data sheets.

The chain here is multiplied out from elementary transforms in NumPy, apart from the library's own.
"""

import tomllib
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / "plumbline" / "kinematics" / "models"
PATHS = sorted(FOLDER.glob("*.toml"))
KINDS = {"revolute", "prismatic", "fixed"}
UNIT = {"x": 0, "y": 1, "z": 2}


def load(name):
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def turn(axis, angle):
    """Rotation about a coordinate axis, 4 x 4."""
    i, j = [(1, 2), (2, 0), (0, 1)][UNIT[axis]]
    transform = np.eye(4)
    transform[[i, j, i, j], [i, j, j, i]] = (
        *(2 * [np.cos(angle)]),
        -np.sin(angle),
        np.sin(angle),
    )
    return transform


def shift(x=0.0, y=0.0, z=0.0):
    """Translation, 4 x 4."""
    transform = np.eye(4)
    transform[:3, 3] = x, y, z
    return transform


def placements(model, q):
    """T_base_i of every row, (rows, 4, 4), at the joint readings q."""
    readings = iter(q)
    frames, pose = [], np.eye(4)
    for row in model["dh"]:
        reading = 0.0 if row["kind"] == "fixed" else next(readings)
        angle = row["theta"] + (reading if row["kind"] == "revolute" else 0.0)
        height = row["d"] + (reading if row["kind"] == "prismatic" else 0.0)
        pose = pose @ turn("z", angle) @ shift(z=height) @ shift(x=row["a"])
        pose = pose @ turn("x", row["alpha"])
        frames.append(pose)
    return np.array(frames)


def movable(model):
    return [row for row in model["dh"] if row["kind"] != "fixed"]


def postures(model, count, seed=0):
    """Readings drawn over the joint ranges, (count, joints)."""
    lower, upper = (np.array([row[key] for row in movable(model)]) for key in ("lower", "upper"))
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))


def test_the_bundle_is_complete():
    names = {"ur3", "ur5", "ur10", "vs060", "bh7", "kr300", "laparoscopic"}
    assert {path.stem for path in PATHS} == names


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_model_states_all_that_a_robot_needs(path):
    model = load(path.stem)
    assert set(model) - {"joints"} == {"name", "source", "tip_frame", "gravity", "dh"}
    assert len(model.get("joints", movable(model))) == len(movable(model))
    assert model["name"] == path.stem
    assert model["source"]
    assert np.linalg.norm(model["gravity"]) == pytest.approx(9.81)
    common = {"d", "a", "alpha", "theta", "kind", "mass", "com"}
    for row in model["dh"]:
        assert row["kind"] in KINDS
        assert set(row) == common | (set() if row["kind"] == "fixed" else {"lower", "upper"})
        assert len(row["com"]) == 3


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_numbers_are_in_metres_radians_and_kilograms(path):
    for row in load(path.stem)["dh"]:
        numbers = [row[key] for key in ("d", "a", "alpha", "theta", "mass")] + row["com"]
        assert all(isinstance(number, float) for number in numbers)
        assert max(abs(row["d"]), abs(row["a"]), *np.abs(row["com"])) < 2.0
        assert max(abs(row["alpha"]), abs(row["theta"])) <= np.pi
        assert 0.0 < row["mass"] < 1000.0


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_right_angles_are_exact(path):
    for row in load(path.stem)["dh"]:
        for key in ("alpha", "theta"):
            quarters = row[key] / (np.pi / 2)
            assert quarters == round(quarters)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_joint_range_is_not_empty(path):
    for row in movable(load(path.stem)):
        assert row["lower"] < row["upper"]
        assert row["upper"] - row["lower"] <= (4 * np.pi if row["kind"] == "revolute" else 1.0)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_centre_of_mass_lies_near_its_link(path):
    """Within a link's length of the link's own frame: a com in another frame would not."""
    model = load(path.stem)
    for row in model["dh"]:
        reach = np.hypot(row["d"], row["a"]) + 0.2
        assert np.linalg.norm(row["com"]) <= reach


@pytest.mark.parametrize(("name", "arm_mass"), [("ur3", 11.0), ("ur5", 18.4), ("ur10", 28.9)])
def test_the_links_of_a_ur_weigh_less_than_the_whole_arm(name, arm_mass):
    """The data sheet's mass counts the base, which is no link, besides."""
    moved = sum(row["mass"] for row in load(name)["dh"])
    assert 0.75 * arm_mass < moved < arm_mass


@pytest.mark.parametrize(
    ("name", "stretched", "side", "height"),
    [
        ("ur3", 0.45690, 0.19425, 0.06655),
        ("ur5", 0.81725, 0.19145, -0.005491),
        ("ur10", 1.18430, 0.256141, 0.01160),
    ],
)
def test_a_ur_at_zero_lies_stretched_along_minus_x(name, stretched, side, height):
    """Zero posture: the arm level along -x, wrist 1 and flange offsets along -y, d1 - d5 up."""
    tip = placements(load(name), np.zeros(6))[-1][:3, 3]
    np.testing.assert_allclose(tip, [-stretched, -side, height], atol=1e-9)


def test_a_ur5_upright_is_a_metre_tall():
    tip = placements(load("ur5"), np.radians([0, -90, 0, -90, 0, 0]))[-1][:3, 3]
    np.testing.assert_allclose(tip, [0.0, -0.19145, 1.001059], atol=1e-9)


@pytest.mark.parametrize(("name", "reach"), [("ur3", 0.500), ("ur5", 0.850), ("ur10", 1.300)])
def test_a_ur_s_advertised_reach_lies_between_wrist_and_flange(name, reach):
    """The furthest that wrist 1 gets from the base's axis, the data sheet's reach, the flange's."""
    model = load(name)
    origins = np.array([placements(model, q)[:, :3, 3] for q in postures(model, 4000)])
    furthest = np.hypot(origins[..., 0], origins[..., 1]).max(axis=0)
    assert furthest[3] < reach < furthest[5]
    assert furthest[3] == pytest.approx(reach, rel=0.1)


def vs060_from_its_drawing(q):
    """T_base_flange from the vendor's lengths, joint by joint along vertical and lateral axes."""
    return (
        shift(z=0.1815) @ turn("z", q[0]) @ shift(z=0.1635) @ turn("y", q[1])
        @ shift(z=0.305) @ turn("y", q[2]) @ shift(x=-0.010, z=0.1645) @ turn("z", q[3])
        @ shift(z=0.1355) @ turn("y", q[4]) @ shift(z=0.070) @ turn("z", q[5])
    )  # fmt: skip


def test_a_vs060_agrees_with_the_vendor_s_drawing_in_every_posture():
    model = load("vs060")
    for q in postures(model, 50):
        pose = placements(model, q)[-1]
        np.testing.assert_allclose(pose, vs060_from_its_drawing(q), atol=1e-12)


def test_a_kr300_reaches_two_and_a_half_metres():
    """R2500 in its name: from axis 1 to the wrist's centre, the arm level and stretched."""
    elbow = np.arctan2(0.041, 1.0)
    wrist = placements(load("kr300"), [0, 0, elbow, 0, 0, 0])[4, :3, 3]
    assert np.hypot(wrist[0], wrist[1]) == pytest.approx(2.5, abs=5e-3)


def test_a_kr300_stands_with_its_forearm_level_at_home():
    """A2 = -90, A3 = 90 degrees: upper arm up, forearm and flange ahead, z of the base down."""
    pose = placements(load("kr300"), np.radians([0, -90, 90, 0, 0, 0]))[-1]
    ahead, high = 0.350 + 1.0 + 0.240, 0.675 + 1.15 - 0.041
    np.testing.assert_allclose(pose[:3, 3], [ahead, 0.0, -high], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)


def test_a_kr300_carries_its_payload_as_a_lump():
    last = load("kr300")["dh"][-1]
    assert last["mass"] == pytest.approx(17.78 + 200.0)
    moment = 17.78 * -0.050 + 200.0 * 0.100
    assert last["mass"] * last["com"][2] == pytest.approx(moment, rel=1e-6)


def test_a_bh7_s_column_lifts_and_its_needle_has_no_joint():
    model = load("bh7")
    assert [row["kind"] for row in model["dh"]] == ["prismatic", *4 * ["revolute"], "fixed"]
    low, high = (placements(model, [height, 0.1, 0.2, 0.3, 0.4]) for height in (0.0, 0.175))
    np.testing.assert_allclose(high[:, :3, 3] - low[:, :3, 3], [[0.0, 0.0, 0.175]] * 6, atol=1e-12)
    needle = high[5][:3, 3] - high[4][:3, 3]
    np.testing.assert_allclose(needle, 0.150 * high[4][:3, 2], atol=1e-12)


def test_a_laparoscopic_arm_inserts_along_the_instrument_s_axis():
    model = load("laparoscopic")
    assert [row["kind"] for row in model["dh"]] == [*6 * ["revolute"], "prismatic"]
    q = postures(model, 1)[0]
    out, deep = (placements(model, [*q[:6], depth])[-1] for depth in (0.0, 0.2))
    np.testing.assert_allclose(deep[:3, 3] - out[:3, 3], 0.2 * out[:3, 2], atol=1e-12)
    np.testing.assert_allclose(deep[:3, :3], out[:3, :3], atol=1e-12)
