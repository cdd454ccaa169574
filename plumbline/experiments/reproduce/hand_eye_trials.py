"""Simulated set-ups of a range finder on an arm, and every method tried on each of them.

The simulator is plain NumPy and shares no code with the methods; they get the encoders' readings,
the ranges, and the arm's model. Marks for choosing an iterate and marks for judging are different
ones, drawn anew for each set-up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import placed, rotations
from plumbline.experiments.reality.ranging import phantoms
from plumbline.experiments.reality.ranging import scene as ranging
from plumbline.experiments.reality.ranging.finder import spoil
from plumbline.experiments.reality.ranging.phantoms import camera_place, target_poses
from plumbline.experiments.reproduce.hand_eye_peers import opencv_hand_eye, scipy_direct
from plumbline.kinematics.chain import Chain
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.hand_eye.accuracy import Accuracy, Marks, leave_one_out, moved, repeatability
from plumbline.optim.hand_eye.calibrate import HandEyeOptions, calibrate
from plumbline.optim.hand_eye.readings import Beam, Readings, mean_beam
from plumbline.optim.hand_eye.single_plane import Selection, select
from plumbline.optim.hand_eye.surface import face_angles, register_surface
from plumbline.optim.hand_eye.three_planes import Weights, solve_three_planes

REALITY = ranging.Instrument(poor=0.04)
# A spot lies 0.4 mm from its mark, and marks are seen from up to 45 deg.
PAPER_AIM = replace(REALITY, aim=0.4e-3 / np.sqrt(2.0), tilt=float(np.deg2rad(45.0)))
PLANE_POINTS = (20, 10)  # the paper's: points, and readings of each
PER_SCENE = 5  # range finders that go through one programme
GROSS = 0.1  # share of the readings that is spoilt
AS_AIMED = ("single_plane", "three_planes", "best", "floor")
RATIOS = tuple(10.0**k for k in range(-8, 5, 2))  # of beta to alpha, lengths in mm


Lengths = dict[str, Array]  # one or several [m], by the name of the figure that they go into


@dataclass(frozen=True, eq=False)
class Trial:
    """One set-up: repeatability [m] of every method on marks that none has seen."""

    selections: tuple[Selection, ...]  # the selection loop on each plane
    lengths: Lengths  # on marks aimed as well as they can be
    as_aimed: Lengths  # on marks aimed as the paper did
    error: float  # error of a point at 0.3 m by our beam [m]
    std: float  # what our covariance says of it [m]


@dataclass(frozen=True, eq=False)
class Detail:
    """What takes longer, on some of the set-ups."""

    lengths: Lengths
    named: float  # share of the gross readings that were named
    spoilt_three: float  # repeatability of the three planes jointly with gross readings [m]
    ratios: Array  # repeatability of the three planes over beta / alpha [m]
    angles: Array  # errors of the block's three angles [rad]


@dataclass(frozen=True, eq=False)
class SetUp:
    """A scene, its readings, and two sets of marks."""

    scene: ranging.Scene
    readings: Readings
    survey: ranging.Survey
    chosen_on: Marks
    judged_on: Marks
    as_aimed: Marks

    @property
    def truth(self) -> Beam:
        """The true beam."""
        return Beam(self.scene.finder.r, self.scene.finder.v)


@lru_cache(maxsize=1)
def chain() -> Chain:
    """The arm that the methods know."""
    return Robot.bundled("vs060").chain()


@lru_cache(maxsize=2)
def programme(
    seed: int, number: int, instrument: ranging.Instrument = REALITY
) -> tuple[ranging.Scene, ranging.Programme]:
    """A scene and its measurement programme, shared by several range finders."""
    rng = np.random.default_rng([seed, number, 1])
    for _ in range(20):
        scene = ranging.draw_scene(rng, instrument)
        try:
            return scene, ranging.plan(scene, rng)
        except ValueError:  # a board out of the arm's reach: the boards are set up anew
            continue
    raise PlumblineError(f"scene {number}: no boards within reach; change the seed")


def set_up(seed: int, number: int) -> SetUp:
    """Set-up of that number."""
    scene, planned = programme(seed, number // PER_SCENE)
    rng = np.random.default_rng([seed, number, 2])
    for _ in range(20):
        mounted = ranging.remounted(scene, rng)
        try:
            survey = ranging.calibration(mounted, rng, planned)
            choice, judge = (ranging.marks(mounted, rng)[0] for _ in range(2))
            poorer = replace(mounted, instrument=PAPER_AIM)
            aimed_at = ranging.marks(poorer, np.random.default_rng([seed, number, 4]))[0]
        except ValueError:  # a beam that misses its board: mounted too far off
            continue
        three = (marks_of(choice), marks_of(judge), marks_of(aimed_at))
        return SetUp(mounted, readings_of(survey), survey, *three)
    raise PlumblineError(f"set-up {number}: no range finder within the programme; change the seed")


def seen_from(one: ranging.Survey | phantoms.Scan) -> tuple[Array, Array, Array]:
    """The flange (N, 3, 3), (N, 3) [m] by encoders and the arm's model, and ranges (N,) [m]."""
    T = chain().placement(one.q)
    return T[:, :3, :3], T[:, :3, 3], one.distance


def readings_of(survey: ranging.Survey) -> Readings:
    """The readings of a survey."""
    return Readings.from_arrays(*seen_from(survey), survey.plane, survey.motion)


def marks_of(survey: ranging.Survey) -> Marks:
    """Readings of marks."""
    return Marks(*seen_from(survey), survey.patch)


def rebuilt(beam: Beam, scan: phantoms.Scan) -> Array:
    """Points (N, 3) of a scan in the base frame [m]."""
    return beam.points(*seen_from(scan))


def trial(case: SetUp) -> Trial:
    """Every method on one set-up."""
    planes = [case.readings.on_plane(int(k)) for k in case.readings.planes]
    selections = tuple(select(readings, case.chosen_on) for readings in planes)
    start = mean_beam([s.best.beam for s in selections])
    kept = Readings.joined([s.readings for s in selections])
    joint = solve_three_planes(kept, [s.best for s in selections])
    ours = calibrate(case.readings)
    printed = solve_three_planes(kept, [s.best for s in selections], own_planes=True)

    single = [s.best.beam for s in selections]
    beams = {
        "single_plane": single,
        "three_planes": [joint.beam],
        "best": [ours.beam],
        "closed_form": [s.first.beam for s in selections],
        "scipy": [scipy_direct(kept, start)],
        "scipy_cauchy": [scipy_direct(case.readings, start, "cauchy")],
        "three_planes_as_printed": [printed.beam],
        "floor": [case.truth],
    }
    lengths = {key: _repeated(several, case.judged_on) for key, several in beams.items()}
    lengths["closed_form"] = lengths["closed_form"].mean(keepdims=True)
    as_aimed = {key: _repeated(beams[key], case.as_aimed) for key in AS_AIMED}
    as_aimed["single_plane"] = as_aimed["single_plane"].mean(keepdims=True)
    error = ours.beam.error_at(case.truth, 0.3)
    return Trial(selections, lengths, as_aimed, error, ours.point_std(0.3))


def _repeated(beams: Sequence[Beam], marks: Marks) -> Array:
    return np.array([repeatability(beam, marks) for beam in beams])


def detail(case: SetUp, done: Trial, seed: int, number: int) -> Detail:
    """What takes longer, on one set-up."""
    rng = np.random.default_rng([seed, number, 3])
    beam = calibrate(case.readings).beam
    spoilt, spoilt_three, named = _spoilt(case, done, rng)
    head = phantoms.draw_head(rng)
    scan, seen = phantoms.tracked(case.scene, head, rng)
    views = rebuilt(beam, scan).reshape(len(seen), -1, 3)
    many, once = leave_one_out(views.mean(axis=1), seen), leave_one_out(views[:, 0], seen)
    planes = _plane_points(case, beam, np.random.default_rng([seed, number, 5]))
    faces = phantoms.block(case.scene, rng)
    corners = rebuilt(beam, faces)
    angles = face_angles([corners[faces.part == k] for k in range(3)])
    surface, targets = _head(case.scene, head, beam, rng)
    singles = [s.best for s in done.selections]
    kept = Readings.joined([s.readings for s in done.selections])
    ratios = [solve_three_planes(kept, singles, Weights(1.0, b)).beam for b in RATIOS]
    flat = calibrate(case.readings, HandEyeOptions(shapes=0)).beam
    lengths = {
        "flat_boards": repeatability(flat, case.judged_on),
        "fre": many.fre, "tre": many.tre,  # marks rebuilt from five poses; left out one by one
        "fre_one_pose": once.fre, "tre_one_pose": once.tre,
        "fre_plane_points": planes.fre, "tre_plane_points": planes.tre,
        "surface": surface, "inner_targets": targets, "gross": spoilt,
        "camera_opencv": _camera(case.scene, case.survey, rng),
    }  # fmt: skip
    return Detail(
        {key: np.atleast_1d(np.asarray(values)) for key, values in lengths.items()},
        named, spoilt_three, _repeated(ratios, case.judged_on), np.abs(angles - np.pi / 2.0),
    )  # fmt: skip


def _spoilt(case: SetUp, done: Trial, rng: np.random.Generator) -> tuple[float, float, float]:
    """Our statement and the joint one where a tenth of the readings is gross; share named."""
    distance, rows = spoil(case.survey.distance, GROSS, rng)
    own = case.readings
    readings = Readings.from_arrays(own.R, own.t, distance, own.plane, own.motion)
    ours = calibrate(readings)
    joint = solve_three_planes(readings, [s.best for s in done.selections])
    found = len(np.intersect1d(ours.gross, rows)) / len(rows)
    spoilt, three = _repeated([ours.beam, joint.beam], case.judged_on)
    return float(spoilt), float(three), found


def _plane_points(case: SetUp, beam: Beam, rng: np.random.Generator) -> Accuracy:
    """Points of the planes, the mean of several readings each, against the tracker."""
    survey, true = ranging.marks(case.scene, rng, *PLANE_POINTS)
    rebuilt_means = marks_of(survey).means(beam)
    T = placed(rotations(rng.normal(0.0, 1.0, 3)), rng.uniform(-1.0, 1.0, 3))
    noise = rng.normal(0.0, case.scene.instrument.tracker / np.sqrt(3.0), true.shape)
    return leave_one_out(rebuilt_means, moved(T, true) + noise)


def _head(
    scene: ranging.Scene, head: phantoms.Head, beam: Beam, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Distances of the scan from the CT surface, and the errors of the targets inside [m]."""
    scan, at_base, in_ct = phantoms.scan_head(scene, head, rng)
    fit = register_surface(rebuilt(beam, scan), head.surface, (at_base, in_ct))
    found = moved(np.asarray(np.linalg.inv(fit.T), dtype=float), head.targets)
    T_base_ct: Array = head.T @ np.asarray(np.linalg.inv(head.T_ct), dtype=float)
    true = moved(T_base_ct, head.targets)
    return fit.distances, np.linalg.norm(found - true, axis=1)


def _camera(scene: ranging.Scene, survey: ranging.Survey, rng: np.random.Generator) -> float:
    """How far OpenCV misplaces a camera that sees a target on the first board [m]."""
    first = survey.q[survey.plane == 1]
    try:
        found = opencv_hand_eye(*target_poses(scene, first, 1, rng))
    except PlumblineError:
        return float("nan")
    return float(np.linalg.norm(found[:3, 3] - camera_place(scene)[:3, 3]))
