"""Slicer's files mean the same points and motions as our tables, in m and along either axes."""

import json
import os

import numpy as np
import pandas as pd
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.slicer import (
    axes_changed,
    points_table,
    read_fcsv,
    read_markups,
    read_points,
    read_tfm,
    tfm_text,
    to_fiducials,
)
from plumbline.experiments.slicer.given import given
from plumbline.experiments.slicer.tfm import read_h5
from plumbline.optim.registration import Kabsch
from tests.phantoms import CT, LABELS, LESION, T_RC, mapped, registered, rigid
from tests.slicer_files import write_points

# As Slicer writes them, mm: two lists, one of them in RAS, a point without a place among them.
MARKUPS = {
    "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
    "Resources/Schema/markups-schema-v1.0.3.json#",
    "markups": [
        {
            "type": "Fiducial",
            "coordinateSystem": "LPS",
            "coordinateUnits": "mm",
            "controlPoints": [
                {"id": "1", "label": "A", "position": [10.0, 20.0, 147.0]},
                {"id": "2", "label": "B", "position": [], "positionStatus": "undefined"},
            ],
        },
        {
            "type": "Fiducial",
            "coordinateSystem": "RAS",
            "controlPoints": [
                {"id": "1", "label": "C", "position": [-60.0, 10.0, 80.0], "description": "skin"}
            ],
        },
    ],
}
FCSV = """# Markups fiducial file version = 4.13
# CoordinateSystem = {axes}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,-60.0,10.0,80.0,0,0,0,1,1,1,0,C,skin,
2,1.5,2,-3e1,0,0,0,1,1,1,0,"a, b",,vtkMRMLScalarVolumeNode1
"""


def table():
    """Markers as points in CT [m]."""
    return points_table(LABELS, CT, ["", "over, rib", "", 'a "word"', ""])


def write(path, text):
    path.write_text(text if isinstance(text, str) else json.dumps(text), encoding="utf-8")
    return path


def test_half_a_turn_takes_lps_to_ras():
    assert axes_changed([1.0, 2.0, 3.0], "LPS", "RAS").tolist() == [-1.0, -2.0, 3.0]
    assert axes_changed([1.0, 2.0, 3.0], "RAS", "RAS").tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(PlumblineError, match="found 'LAS', expected LPS or RAS"):
        axes_changed([0, 0, 0], "LAS", "RAS")


def test_markups_of_slicer_are_read_in_metres_on_the_axes_asked_for(tmp_path):
    path = write(tmp_path / "F.mrk.json", MARKUPS)
    found = read_markups(path)
    assert found["label"].tolist() == ["A", "C"]  # B has no place yet
    assert found["description"].tolist() == ["", "skin"]
    assert np.allclose(found[["x", "y", "z"]], [[0.01, 0.02, 0.147], [0.06, -0.01, 0.08]])
    ras = read_markups(path, "RAS")[["x", "y", "z"]]
    assert np.allclose(ras, [[-0.01, -0.02, 0.147], [-0.06, 0.01, 0.08]])


@pytest.mark.parametrize(("axes", "sign"), [("LPS", 1), ("RAS", -1), ("1", 1), ("0", -1)])
def test_the_older_list_is_read_with_either_header(tmp_path, axes, sign):
    found = read_fcsv(write(tmp_path / "F.fcsv", FCSV.format(axes=axes)))
    expected = np.array([[-0.06, 0.01, 0.08], [0.0015, 0.002, -0.03]]) * [sign, sign, 1]
    assert np.allclose(found[["x", "y", "z"]], expected)
    assert found["label"].tolist() == ["C", "a, b"]
    assert found["description"].tolist() == ["skin", ""]


@pytest.mark.parametrize("name", ["F.mrk.json", "F.fcsv", "F.json"])
def test_either_list_is_read_by_its_name_labels_and_words_as_they_stand(tmp_path, name):
    path = write_points(tmp_path / name, table())
    pd.testing.assert_frame_equal(read_points(path), table(), rtol=1e-14)
    assert np.allclose(read_points(path, "RAS")[["x", "y"]], -CT[:, :2])


def changed(**more):
    """Markups whose first list says something else."""
    return {"markups": [{**MARKUPS["markups"][0], **more}]}


MARKUPS_FAULTS = {
    "no json": ("{", "broken JSON"),
    "no markups": ({"points": []}, "no markups"),
    "a list": ([1], "no markups"),
    "axes": (changed(coordinateSystem="IJK"), "coordinateSystem: found 'IJK'"),
    "unit": (changed(coordinateUnits="inch"), "found 'inch', expected one of m, cm, mm, um"),
    "points": (changed(controlPoints={"a": 1}), "no list of points"),
    "short": (changed(controlPoints=[{"label": "A", "position": [1, 2]}]), "point 0, position"),
    "words": (changed(controlPoints=[{"position": [1, 2, "3"]}]), "three finite numbers"),
    "true": (changed(controlPoints=[{"position": [1, 2, True]}]), "three finite numbers"),
    "empty": (changed(controlPoints=[]), "no points with a place"),
}
FCSV_FAULTS = {
    "no axes": (FCSV.replace("# CoordinateSystem = {axes}\n", ""), "CoordinateSystem: found noth"),
    "other axes": (FCSV.format(axes="IJK"), "found 'IJK', expected LPS or RAS"),
    "no columns": (FCSV.format(axes="LPS").replace("id,x,", "id,u,"), "a column 'x'"),
    "words": (FCSV.format(axes="LPS").replace("-60.0", "abc"), "row 4: found 'abc,10.0,80.0'"),
    "nan": (FCSV.format(axes="LPS").replace("-60.0", "nan"), "row 4"),
    "no points": ("# CoordinateSystem = LPS\n", "no points"),
}


@pytest.mark.parametrize(
    ("reader", "name", "text", "words"),
    [
        *[(read_markups, "F.mrk.json", *v) for v in MARKUPS_FAULTS.values()],
        *[(read_fcsv, "F.fcsv", *v) for v in FCSV_FAULTS.values()],
    ],
    ids=[*MARKUPS_FAULTS, *[f"fcsv {name}" for name in FCSV_FAULTS]],
)
def test_a_broken_file_is_refused_in_one_line(tmp_path, reader, name, text, words):
    with pytest.raises(PlumblineError) as caught:
        reader(write(tmp_path / name, text))
    assert str(caught.value).startswith(name)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_files_that_are_none_are_refused(tmp_path):
    for reader in (read_markups, read_fcsv, read_tfm):
        with pytest.raises(PlumblineError, match="no readable"):
            reader(tmp_path / "none")
        write(tmp_path / "latin", "x")
        (tmp_path / "latin").write_bytes(b"\xff\xfe\xff")
        with pytest.raises(PlumblineError):
            reader(tmp_path / "latin")
    with pytest.raises(PlumblineError, match=r"expected \.mrk\.json or \.fcsv"):
        read_points(tmp_path / "points.txt")


def test_the_direction_of_a_tfm_by_hand():
    # CT's points move 10 mm to the left of the patient: +x in LPS, -x in RAS.
    to_left = np.eye(4)
    to_left[0, 3] = 0.010
    expected = "Parameters: 1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0 -10.0 0.0 0.0"
    # The file holds the way back, from the robot to CT: -10 mm along L.
    assert expected in tfm_text(to_left).replace("-0.0", "0.0")
    in_ras = to_left.copy()
    in_ras[0, 3] = -0.010
    assert expected in tfm_text(in_ras, "RAS").replace("-0.0", "0.0")


def test_a_quarter_turn_by_hand():
    # x of CT goes to y of the robot: rows of the file are those of the inverse, y to x.
    turn = np.eye(4)
    turn[:2, :2] = [[0, -1], [1, 0]]
    turn[:3, 3] = [0.0, 0.0, 0.5]
    lines = tfm_text(turn).replace("-0.0", "0.0").splitlines()
    assert lines[:3] == [
        "#Insight Transform File V1.0",
        "#Transform 0",
        "Transform: AffineTransform_double_3_3",
    ]
    assert lines[3] == "Parameters: 0.0 1.0 0.0 -1.0 0.0 0.0 0.0 0.0 1.0 0.0 0.0 -500.0"
    assert lines[4] == "FixedParameters: 0 0 0"


def test_a_published_pair_of_display_and_file_agrees(tmp_path):
    # What Slicer displays as "transform to parent" (RAS, rounded), and the file it saved of it
    # (Slicer's forum, topic 270).
    shown = np.array([[-0.12, -0.96, 0.26, 710], [0.99, -0.1, 0.1, 19], [-0.07, 0.27, 0.96, -58]])
    parameters = (
        "-0.12281062601468536 0.9902729990354874 0.06989222618721933 -0.9559259621663395 "
        "-0.0968506562880039 -0.26898522478338405 -0.2598992353790456 -0.09944665326067206 "
        "0.9609182640368552 -64.32660836989362 -696.1487386450094 -130.6846842169375"
    )
    text = tfm_text(np.eye(4)).splitlines()
    text[3] = f"Parameters: {parameters}"
    T = read_tfm(write(tmp_path / "T.tfm", "\n".join(text)), "RAS")
    assert np.allclose(T[:3, :3], shown[:, :3], atol=0.006)
    assert np.allclose(T[:3, 3] * 1e3, shown[:, 3], atol=0.6)


@pytest.mark.parametrize("axes", ["LPS", "RAS"])
@pytest.mark.parametrize("seed", range(4))
def test_a_transform_is_read_back(tmp_path, seed, axes):
    T = rigid(seed)
    assert np.allclose(read_tfm(write(tmp_path / "T.tfm", tfm_text(T, axes)), axes), T, atol=1e-14)


def test_the_centre_of_rotation_is_heeded(tmp_path):
    T, centre = rigid(1), np.array([10.0, -20.0, 30.0])
    back = np.linalg.inv(T)
    offset = back[:3, 3] * 1e3
    translation = offset - centre + back[:3, :3] @ centre
    numbers = " ".join(repr(float(v)) for v in [*back[:3, :3].ravel(), *translation])
    text = (
        "#Insight Transform File V1.0\n#Transform 0\n"
        f"Transform: MatrixOffsetTransformBase_double_3_3\nParameters: {numbers}\n"
        "FixedParameters: 10 -20 30\n"
    )
    assert np.allclose(read_tfm(write(tmp_path / "T.tfm", text)), T, atol=1e-12)


def test_a_file_moves_points_as_the_registration_does(tmp_path):
    # Both point lists in RAS, the transform written for RAS: what Slicer shows to the parent.
    ct, robot = (axes_changed(p, "LPS", "RAS") for p in (CT, mapped(CT)))
    answer = registered(Kabsch(), ct, robot)
    T = read_tfm(write(tmp_path / "T.tfm", tfm_text(answer.T_RC, "RAS")), "LPS")
    assert np.allclose(T, T_RC, atol=1e-9)


TFM = tfm_text(np.eye(4))
TFM_FAULTS = {
    "composite": (TFM.replace("AffineTransform", "CompositeTransform"), "CompositeTransform"),
    "two": (TFM + TFM, "expected one AffineTransform_double_3_3"),
    "none": ("#Insight Transform File V1.0\n", "no transform"),
    "short": (TFM.replace("1.0 0.0 0.0 ", "", 1), "Parameters: found"),
    "words": (TFM.replace("FixedParameters: 0 0 0", "FixedParameters: a b c"), "3 numbers"),
    "no centre": (TFM.replace("FixedParameters: 0 0 0", ""), "FixedParameters: found nothing"),
    "flat": (TFM.replace("1.0 0.0 0.0 ", "0.0 0.0 0.0 ", 1), "rank below 3"),
}


@pytest.mark.parametrize("name", TFM_FAULTS)
def test_a_file_of_no_affine_transform_is_refused(tmp_path, name):
    text, words = TFM_FAULTS[name]
    with pytest.raises(PlumblineError, match=r"T\.tfm") as caught:
        read_tfm(write(tmp_path / "T.tfm", text))
    assert words in str(caught.value)


def test_a_matrix_that_is_no_transform_is_not_written():
    for T in (np.eye(3), np.full((4, 4), np.nan), np.diag([1.0, 1.0, 0.0, 1.0]), 2 * np.eye(4)):
        with pytest.raises(PlumblineError):
            tfm_text(T)


def test_two_lists_are_a_recording_matched_by_label():
    ct = pd.concat([table(), points_table(["M"], LESION)], ignore_index=True)
    robot = points_table(LABELS[::-1], mapped(CT)[::-1])
    fiducials = to_fiducials(ct, robot)
    assert fiducials.markers.labels == LABELS
    assert fiducials.targets.labels == ("M",)
    assert np.allclose(fiducials.markers.robot, mapped(fiducials.markers.ct))
    assert np.isnan(fiducials.targets.robot).all()
    with pytest.raises(PlumblineError, match="point X"):
        to_fiducials(ct, points_table(["X"], LESION))


@pytest.mark.parametrize("axes", ["LPS", "RAS"])
def test_a_transform_in_hdf5_is_the_one_in_text(axes, tmp_path):
    """Slicer writes either by the ending: the same 12 numbers, mm, from parent, and a centre."""
    h5py = pytest.importorskip("h5py")
    text, binary = tmp_path / "moved.tfm", tmp_path / "moved.h5"
    write(text, tfm_text(T_RC))
    rows = [line.split(": ") for line in text.read_text().splitlines() if ": " in line]
    said = {key: value.strip() for key, value in rows}
    with h5py.File(binary, "w") as file:
        group = file.create_group("TransformGroup/0")
        group["TransformType"] = np.array([said["Transform"].encode()])
        for key in ("Parameters", "FixedParameters"):
            group[f"Transform{key}"] = np.array(said[key].split(), dtype=float)
    assert np.allclose(read_h5(binary, axes), read_tfm(text, axes), atol=1e-12)
    assert not np.allclose(read_h5(binary, axes), np.eye(4), atol=1e-3)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n" + b"x" * 900, b"junk" * 500])
def test_what_is_no_hdf5_is_refused_in_one_line(content, tmp_path):
    pytest.importorskip("h5py")
    file = tmp_path / "moved.h5"
    file.write_bytes(content)
    with pytest.raises(PlumblineError, match=r"moved\.h5.*save it in Slicer as \.tfm") as caught:
        read_h5(file)
    assert "\n" not in str(caught.value)


def test_a_pipe_named_like_a_transform_is_refused_and_not_waited_for(tmp_path):
    pytest.importorskip("h5py")
    file = tmp_path / "moved.h5"
    os.mkfifo(file)
    with pytest.raises(PlumblineError, match=r"moved\.h5.*a pipe, no regular file"):
        read_h5(file)


@pytest.mark.parametrize(("share", "turned"), [(-0.487, False), (-0.513, True)])
def test_a_transform_is_taken_the_other_way_round_where_that_fits_three_times_better(
    tmp_path, share, turned
):
    """A shift by 10 mm fits markers that were shifted by a share of it in that ratio."""
    T = np.eye(4)
    T[0, 3] = 0.01
    (tmp_path / "found.tfm").write_text(tfm_text(T))
    for name, shift in (("ct", 0.0), ("robot", share)):
        points = points_table(LABELS, CT + np.array([0.01 * shift, 0.0, 0.0]))
        write_points(tmp_path / f"{name}.mrk.json", points)
    paths = [tmp_path / name for name in ("ct.mrk.json", "robot.mrk.json", "found.tfm")]
    _, (found,) = given(paths)
    assert found.inverted is turned
