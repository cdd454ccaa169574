"""Every number of these methods stands where it was set."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

MODULES = {"kinematics": "kinematics.constants", "drive": "kinematics.drive"}
STAND = {
    "kinematics": {
        "ROUNDING": 1e-15, "SAME": 1e-12, "SHORT": 1e-9, "NULL": 1e-9, "LEAST_LOAD": 0.01,
        "MISSTATED": 0.1,
        "HOURS": 7200.0,
        "FINER": (-0.5, 0.5, -0.25, 0.25, -0.125, 0.125, -0.0625, 0.0625, -0.03125, 0.03125,
                  -0.015625, 0.015625),
        "TIP_TO_AXIS": 1e-3, "UNLIMITED": 1e3, "COLD": 0.05, "PARALLEL": 0.05, "DRAWN": 1e-9,
        "SERIES_BELOW": 1e-4, "TINY": 1e-12, "ALONG": 1e-12, "SHORTEST": 1e-3, "LARGEST": 1e12,
        "LARGEST_FILE": 64000000, "LARGEST_URDF": 16000000, "STANDARD_GRAVITY": (0.0, 0.0, -9.81),
        "MOST_JOINTS": 500, "MOST_ATTRIBUTES": 100, "LONGEST_NAME": 60, "BLOCK_NUMBERS": 20000,
        "FEWEST_ROWS": 500, "MOST_ROWS": 10000, "MOST_WORK": 4000, "AT_HAND": 8000000,
        "EQUAL": 0.1, "TERMS": 8, "PLANNED": 8,
    },
    "drive": {
        "EDGE": 2.0, "STIFFNESS": 9.0, "SLOWS": 105.26315789473685, "PARTS": 2,
    },
    "budget": {
        "ROUNDING": 1e-09, "DRAWS": 2000, "FEWEST": 4, "SYMMETRIC": 1e-09, "MOST_LINKS": 100,
        "SAME_PLACE": 1e-06,
    },
    "capsule_mpc": {
        "MM": 1000.0, "LONGEST": 5.0, "WIDEST": 0.1, "SLOWEST": 1.0,
        "BRISKEST": (2.0, 50.0, 5000.0), "ROUGHEST": 0.01, "OBSTACLE": 10, "FAR": 1000000.0,
        "STILL": (0.0, 0.0, 0.0), "A_MAX": 1.0,
        "J_MAX": 50.0, "V_OUTER": 0.25, "CONE": 80.0, "NARROWEST": 3.15, "SHALLOW": 1.0,
        "REVOLUTE": 0.01, "PRISMATIC": 0.001, "POWER": 8, "KEPT": 0.95, "TURN": 5.0,
        "REGULAR": 1e-06,
        "ABSENT": -1000000000.0, "DROPPED": -100000000.0, "TOUCHING": 1e-09, "LIMITS": 10.0,
        "ACROSS": 0.5, "COMMON": 0.001, "CURVATURE": 1e-06, "INFINITE": 10000.0, "WATCH": 8.0,
        "SHORT": 0.001, "ROUNDS": 3, "OFF": 0.01, "SLACK": 0.001, "HALVINGS": 4, "ROUNDING": 1e-09,
        "PASSES": 8, "SHORTER": 0.98, "HOLDING": 0.1, "WORSE": 0.005, "SUBSTEPS": 4, "REST": 1e-06,
        "MOST_OF_A_STOP": 60, "NO_WAY": 1e-30, "EXACT": 1e-06, "CREEP": 0.1, "GRAIN": 0.01,
        "LATEST": 0.2, "LATE": 0.1, "GAINS": 0.1, "LEARNT": 60.0, "SEEN_FROM": 0.01,
        "STANDARD": 3.0, "HELD": 0.1, "OBEYED": 0.5, "ASTRAY": 2.0,
        "WATCHED": 1.0, "BETWEEN_LOOKS": 0.1, "NO_SEAT": 1000000.0, "SMOOTHING": 0.106,
        "SEEN": 0.53, "DAMPING": 0.7,
        "AHEAD": 1.2, "STRAIGHT": 1.0, "TURNED": 1.0, "CHANGED": 0.1, "UNEVEN": 0.2,
        "FEWEST_LOOKS": 5, "RECENT_LOOKS": 25, "FASTEST": 2000.0, "MEMORY": 10.0, "EVERY": 0.04,
        "ROOM": 2.0, "FINER": 8, "LIKELY": 8, "ASIDE": 0.35, "SHARES": (1.0, 0.5), "SAMPLES": 17,
        "DIRECTIONS": 12, "OFFSETS": (10.0, 18.0, 28.0, 40.0, 55.0),
        "PATIENCE": 300.0, "MOMENT": 20.0, "IPOPT_TOLERANCE": 0.0001, "FATROP_TOLERANCE": 0.05,
        "ARRIVED": 1e-08, "EASED": 0.001, "STRIDE": 10.0, "INSIDE": 0.001, "COMES": 7.0, "ROD": 8.0,
        "THERE": 3.0, "STALL": 25, "PROGRESS": 1.0, "EXTRA": 1.5, "BACK": 35.0, "DEEP": 0.5,
        "AT_REST": 1e-18, "BESIDE": (0.5, 0.25, 0.75, 0.0, 1.0), "PASSED": 1.05, "OVER": 0.5,
        "ROWS": 5000, "STEPS": 3, "TELLS": 0.05, "SHARE": 2e-3, "ACROSS_AXES": 0.05,
        "MEDIAN": 1.4826, "FINEST": 1e-7, "NO_LAG": 1e-4,
    },
    "core": {
        "NO_CURVATURE": 1e-13, "LOST": 1e-06, "HOPELESS": 100000000.0,
        "LARGEST_ANSWER": 500000000, "STILL": 0.1, "STATIONARY": 1e-05, "FEASIBLE": 1e-08,
        "LEAST_RESIDUAL": 1e-09, "SINGULAR": 1e-10, "LISTED": 4, "CHUNK_NUMBERS": 4000000,
        "NEARBY": 0.1, "LEVEL": 0.95, "SIDES": (0.025000000000000022, 0.975), "NEAR": 1e-06,
        "GROWTH": 2.0, "LEAST": 0.1, "KEPT": 0.5, "MOST_TURN": 0.75, "LEAST_COST": 1e-30,
        "SAMPLE": 500,
        "LEAST_DIAGONAL": 1e-12, "LEAST_DAMPING": 1e-14, "BARELY": 0.005, "SURE": 1e-09,
    },
    "dh_fit": {
        "RANK": 1e-12, "ORTHONORMAL": 1e-14, "FEW": 2000,
        "DELTA_LENGTH": 0.01, "DELTA_ANGLE": 0.08726646259971647, "FRAME_SCALE": 0.01,
        "TOOL_SCALE": 0.01, "WIDE_BOUNDS": 1000.0, "MEDIAN": 2.3659738843753377,
        "COUNT_OF_DIRECTIONS": 2000,
        "FACTOR": 30.0, "DEPENDENT": 1e-08, "ABSENT": 1e-10, "MOST_POSES": 4000, "PARTNER": 1e-06,
        "SLIGHT": 0.1, "WHOLE": 0.01, "UNBOUNDED": 1000.0, "RESTING": 1e-06, "CHANCE": 0.001,
        "STATED_WITHIN": 1.1, "ROUNDING": 1e-09, "COARSE": 3.0, "LEAST_SOFT": 1e-07,
        "MOST_SOFT": 0.01, "MOST_SOFT_ROWS": 600, "FALSE_ALARM": 0.01, "SLACK": 1.7,
        "MOST_SHARE": 0.4, "FEWEST_FREEDOM": 15, "FEWEST_ROWS": 20, "SHAPE_ROUNDS": 30,
        "LEAST_SHAPE": 0.0001, "LEAST_LEFT": 0.1, "COUNT": 4, "FLATTEST": 0.001, "SPARE_STEPS": 2,
        "MOST_STEPS": 40, "CANDIDATES": 400, "TARGETS": 60, "SWEEPS": 8, "TRIES": 200,
        "VAGUE": 1e-08, "AGREES": 1e-09, "POSTURES": 20,
        "BETTER": (1e-12, 1e-15), "LOST": 1e-14, "UNSEEN": 1e-09,
    },
    "hand_eye": {
        "LONGEST": 20.0, "LARGEST_NOISE": 0.1, "LARGEST_ANGLE": 12.0, "SAME_TURN": 0.002,
        "SAME_POSE": 1e-06, "SKEWED": 0.0001, "LEAST_ROWS": 8, "SPARE": 8, "LEAST_ON_PLANE": 3,
        "LEAST_FACE": 4, "FLAT": 0.001, "ALIKE": 0.001, "LEAST_GROUP": 4, "LEAST_GROUPS": 3,
        "PARALLEL": 0.08726646259971647, "CAUCHY": 2.385, "TO_SIGMA": 1.4826, "ROBUST_ROUNDS": 40,
        "ROBUST_SETTLED": 1e-05, "INNER": 1.5, "SCATTER_SETTLED": 0.98, "REFINEMENTS": 12,
        "SURE_SCATTER": 0.0005, "BEYOND": 4.5, "FEW": 0.2, "TRIALS": 120, "SAMPLE": 10,
        "TRIAL_ROUNDS": 12, "KEPT": 4, "THREES": 300, "MOST_MISFIT": 0.02, "SUSPECT": 0.001,
        "BETTER": 5.0, "FOR_EACH_UNKNOWN": 2, "SHAPES": 16, "ARM_SHAPES": 48, "GROSS": 4.5,
        "SCALE_TOLD": 3.0,
        "MAD_EFFICIENCY": 0.37, "NORMAL_95": 1.96, "GROSS_ROUNDS": 3, "LEAST_FREE": 0.05,
        "BIAS_STD": 0.0004,
        "BOARD_REACH": 0.4, "LEAST_BOWED": 20, "ARM_SHIFT": 0.3, "ARM_TURN": 0.3,
        "READINGS_A_SHAPE": 4, "VARIANCE_ROUNDS": 8, "VARIANCE_FLOOR": 0.05, "LEAST_SLANT": 0.001,
        "LINEAR_ROUNDS": 3, "LIKELY_ROUNDS": 15, "VARIANCE_SETTLED": 0.001, "LOST_R": 0.02,
        "LOST_V": 0.05, "INFINITE": 1.0, "POOR_R": 0.0005, "POOR_V": 0.002, "PATCH": 0.03,
        "LINE": 0.01, "ALONG": 0.9396926207859084, "LEAST_TURN": 0.01, "ONE_TURN": 0.005,
        "ONE_AXIS": 0.02, "MANY_GROSS": 0.2, "FEW_READINGS": 2, "UNDERSTATED": 2.0,
        "OVERSTATED": 5.0, "POSES": 5, "MOST_POSES": 50, "TRIES": 400,
        "LARGEST_TILT": 1.0471975511965976, "LEAST_INCIDENCE": 0.5235987755982988,
        "REACH_STEPS": 12, "LONGEST_STEP": 0.4, "ARRIVED": 1e-05, "LEAST_ROBUST": 10,
        "FACE_GROSS": 6.0, "LEAST_GROSS": 0.0005, "LOST_EDGE": 0.01, "LEAST_SINE": 0.001,
        "NEIGHBOURS": 12, "FIRST_REACH": 0.02, "LAST_REACH": 0.003, "SURFACE_GAP": 3.0,
        "SURFACE_DAMPING": 1e-06, "SURFACE_STEPS": 60, "SURFACE_REST": 1e-09, "LEAST_MATCHED": 0.5,
        "SURFACE_POINTS": 30000, "LEAST_SURFACE": 100, "LARGEST_SURFACE": 3.0, "LEAST_POINTS": 4,
        "LEAST_LANDMARKS": 3, "DESIGN_DAMPING": 1e-06,
        "SIZES": (0.01, 0.1, 0.1, 0.01, 0.0001, 0.001, 0.0001), "FIXED": 14, "BOW": 0, "ARM": 1,
        "BIAS": 2, "BEAM": 5, "NUISANCE_RANK": 1e-10, "NOTHING": 1e-12, "LEAST": 1e-12,
        "LEAST_SIGMA": 1e-09, "SCAN_STEP": 1e-06, "LEAST_SPAN": 1e-09, "SHOWN": 4.0,
        "FINEST_NORMAL": 0.001, "SLIDE": 0.3, "MILLIMETRES": 1000.0,
        "KNOWN": 1e-13, "RESTED": 1e-06, "BOARD_PERCENT": 98.0, "LEAST_BOARD": 1e-06,
        "VANISHING": 1e-12,
    },
    "measurement": {
        "ONE_MOTION": 0.05, "TURNED": 1e-05, "ASSUMED": 0.58,
        "SMOOTH": 0.25, "FRAME_SCALE": (0.1, 0.1), "TOOL_SCALE": 0.05, "COINCIDENT": 1e-12,
        "WIDE_BOUNDS": 1000.0, "MASS_PER_METRE": 15.0, "LEAST_HALF": 0.001, "UNIT": 0.0001,
        "WAYS": 6, "POSE_FREEDOM": 8, "REGISTERING_STEPS": 3,
    },
    "model": {
        "LONGEST_WORD": 500, "ORTHONORMAL": 1e-06,
        "MARGIN": 0.02, "CHANGED": 4.0, "WORTH": 0.1, "NAMED": 3, "STILL_HOLDS": 1.5,
        "FIRST_STEPS": 12, "STEPS": 30, "SETTLED": 1e-11, "FAR_STEPS": 60, "LONGEST": 0.4,
        "PLACE_FIRST": 100.0, "EASED": 10.0, "STARTS": 12, "REACHED": 1e-06, "SLACK": 1e-09,
        "LOAD_ROUNDS": 2, "STIFF": 300.0, "DAMPED": 1.0, "LEAST_DAMPED": 0.4, "MJCF_STEP": 0.001,
        "SPAN": 20.0, "SAMPLE": 0.02, "AGREES": 1e-09, "ASKED": 40, "SAME_CONSTANT": 1e-12,
        "LEAST_MASS": 0.001, "LEAST_INERTIA": 1e-06, "UNTURNED": 4e-06, "REST": 1.0,
        "SLIDE_STEP": 0.001, "MOST_POINTS": 2000, "SHAKEN": 0.37, "WIDE": 1000.0, "NEAR_LEVER": 0.1,
        "NEAR_DAMPING": 0.001, "NEAR_STEPS": 12, "PLACED": 1e-09, "STILL": 1e-08, "FARTHEST": 0.1,
        "LAG_ROUNDS": 8, "NARROWEST": 1e-06, "LARGEST_MODEL": 64000000, "MOST_EFFECTS": 2000,
        "SAMPLES": 100, "LARGEST": 1000000000.0,
        "UNSHOWN_CHANGE": 1e-10, "ONE_WITH": 1e-09, "NO_TURN": 1e-06, "HEAD": 10000,
    },
    "pointing": {
        "FIRST_DAMPING": 0.01, "MOST_DAMPING": 1000.0, "SOFTER": 5.0, "HARDER": 4.0, "GAINS": 0.999,
        "SETTLINGS": 15, "PULL": 0.5, "ALIKE": 0.1, "SAME_VALUE": 1e-06, "ORTHONORMAL": 1e-06,
        "BEYOND": 1.001,
        "LEAST_JOINTS": 5, "ROW": 7, "EQUATIONS": 5, "DAMPING": 1e-09,
        "RIGHT_ANGLE": 1.5707963267948966, "TURN": 6.283185307179586, "MM": 1000.0,
        "PARALLEL": 1e-09, "ZERO": 1e-16, "ITERATIONS": 60, "STALLED": 5, "STARTS": 24, "TRIES": 4,
        "MAP_ROUNDS": 6, "WHY_STARTS": 16, "LARGEST_RCM_ERROR": 1e-05, "LARGEST_TURN": 0.0001,
        "ANCHORS": 3, "TRACK_STARTS": 48, "MORE_ANCHORS": 2, "ASKED": 8, "FEW_STARTS": 12,
        "MOST_TRACKS": 12, "NEWTON_STEPS": 6, "LONGEST_STEP": 0.5, "HELD": 1e-14, "LOOKS": 8,
        "HELD_WITHIN": 1e-06, "LARGEST": 5.0, "POINT": 0.001, "LEAST_SIZE": 1e-06,
        "LARGEST_FILE": 200000000, "CHUNK": 2000000, "LEAST_VOLUME": 1e-12, "SHORTEST": 1e-06,
        "SAMPLES": 64, "ROUNDING": 1e-09, "STILL": 1e-09, "RESOLUTION": 0.0001, "SLOTS": 16,
        "NEAR": 0.03, "SPARE": 0.0003, "PENALTY": 100.0, "ROUNDS": 4, "PATIENCE": 2, "NEAREST": 3,
        "ANGLE_ROUNDING": 1e-12, "LEAST_DAMPING": 1e-12,
    },
    "recording": {
        "CHANGES": (0.2, 0.8), "SAME_GRAVITY": 0.1, "MOST_IN_COMMON": 0.5,
        "BLOCK": 10, "FEWEST_BLOCKS": 3, "HARDLY": 1e-9,
        "LARGEST": 1000000000000.0, "MOST_ROWS": 1000000, "MOST_COLUMNS": 10000,
        "LARGEST_SETTINGS": 1000000, "LONGEST_REASON": 200, "MOST_PARTS": 100,
        "SAME_POSTURE": 1e-06, "BETTER_ROWS": 3, "STILL": 1e-09, "TURNS": 12.566370614359172,
        "SLACK": 0.1, "BEYOND_LIMIT": 1e-06, "MILLIMETRES": 31.6, "LARGEST_TWIST": 7.0,
        "AS_DEGREES": 0.05, "EXTREME": 0.1, "OUTSIDE": 0.5, "LARGEST_ARM": 100.0,
        "LARGEST_TOOL": 1.0, "LARGEST_GRAVITY": 50.0, "EARTH": (9.7, 9.9), "MEETS": 0.2,
        "CONVERTED": 0.1, "SMALLEST_SPREAD": 0.001, "NEAR_SCALE": 3.0, "FARTHEST": 2.4,
        "HUGE": 0.05, "UNMET": 0.25, "FEWEST": 5, "OUT_OF_BASE": 0.25, "MOUNTED": 0.1,
        "LEAST_NOISE": 1e-08, "COARSE": 0.01, "UNIT_TOLERANCE": 0.001, "ODD": 0.1, "BETTER": 0.2,
        "ALIKE": 0.02, "LINE": 0.02, "LARGEST_SPEED": 1000.0, "LARGEST_ACCELERATION": 1000000.0,
        "LARGEST_EFFORT": 1000000.0, "KELVIN": 200.0, "FAHRENHEIT": 60.0,
        "TEMPERATURES": (-60.0, 120.0), "LARGEST_PAYLOAD": 5000.0, "BANDWIDTH": 10.0,
        "LEAST_WINDOW": 4, "GAP_IN_TIME": 5.0, "SURE_SPEED": 0.005, "AT_ITS_END": 10,
        "ENDS_WITHIN": 3.5, "ENDS_OFF": 0.05, "UNSIGNED": 0.98, "FEWEST_EFFORTS": 20,
        "LEAST_EFFORT_NOISE": 1e-06, "INERTIA_ROWS": 200, "EFFORT_ROWS": 3000, "ORDER": 5,
        "USUAL": 0.99, "SPEEDS_UP": 3.0, "SHORTEST": 50, "THIRD_DIFFERENCE": 3.0164557016472164,
        "ONE_COURSE": 0.9, "LATEST": 0.2, "SURELY_LATE": 10.0, "LEAST": 0.05, "FINE": 401,
        "MIXED_UP": 9.0, "ROUNDING": 0.01, "TIP_AXES": 3, "FIRST_ROW": 2, "SOCKETS": 1000000,
        "REPEATED": 0.1, "FEW": 5, "UNDER_WAY": 3.0, "EVEN": 2.0, "ONE_ROBOT": 0.01,
        "NO_SOCKET": -1, "PLAUSIBLE": 0.01, "ASKED": 0.1, "MENDED": 0.1, "FEWEST_POSTURES": 10,
        "MOST_SIGNS": 7, "ONE_SET_UP": 0.001, "IN_A_SOCKET": 4, "SOCKET_STARTS": 20,
        "WINDOWS": 40, "ROWS_OFF": 3, "FEWEST_MENDED": 4, "WHOLE": 0.8, "ONE_ANGLE": 0.9,
        "LISTED_SET_UPS": 3, "LEVER": 0.3, "FRAME_STEPS": 8, "HARDLY_TOLD": 0.001, "MOST_NAMED": 30,
        "AGAIN": 6, "BELIED": 3.0, "MEDIAN": 0.6745, "SURELY": 3.0, "FLAT": 1.5,
        "SURELY_ENDS": 20.0, "SURELY_FILTERED": 3.0, "FINER": 9, "FORGOTTEN": 3,
        "BEYOND_ENDS": (0.005, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5),
        "FILTERS": (0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2),
        "SLIDE": 0.3333333333333333,
    },
    "registration": {
        "LARGEST": 5.0, "COARSEST": 0.05, "FEWEST": 3, "FEWEST_DIAGNOSED": 4, "SAME_PLACE": 1e-09,
        "FINEST_GRID": 0.0002, "ON_GRID": 1e-06, "COINCIDENT": 1e-06,
        "MILLIMETRES": (300.0, 3000.0), "ON_A_LINE": 1.0, "STATED": 8.0, "UNEVEN": 1e-09,
        "EXACT": 1e-12, "FEWEST_UNSTATED": 4, "DRAWS": 4000, "SMALLEST": 1e-13,
        "LEAST_SHARE": 1e-08, "LEAST_FREEDOM": 1e-09, "STEPS": 60, "NEARLY": 1e-08,
        "NO_WORSE": 1e-13, "LEAST_DAMPING": 0.001, "MORE_DAMPING": 10.0, "HOPELESS": 1000000.0,
        "CHUNK": 4096, "ALPHA": 0.001, "ALPHA_UNSTATED": 0.005,
        "ROUNDING": 1e-24, "RIVAL": 13.815510557964274, "EVERY": 100, "TRIPLES": 2000, "STARTS": 12,
        "KEPT": 3, "CONCENTRATIONS": 20, "SETTLED": 1e-12, "LEAST_HELD": 5.0, "MANY": 24,
        "LEAST_ANGLE": 2.0, "MEAN_ROUNDS": 30, "STILL": 1e-11, "ALL_ORDERS": 7, "FITTED": 12,
        "ALIKE": 200, "DOUBTFUL": 0.001, "SURPRISING": 0.05, "RELATIVE_DOUBT": 0.01, "NO_PAIR": 0.1,
        "MUCH": 3.0, "MUCH_UNSTATED": 10.0, "NEARLY_ON_A_LINE": 15.0, "FLAT": 0.05, "ASIDE": 0.1,
        "WIDE_TURN": 0.08726646259971647, "FINE": 0.002, "COARSE": 0.005, "ENOUGH_FREEDOMS": 8.0,
        "POSE": 15,
    },
    "diagnosis": {
        "FLAT": 1e-12, "TRIES": 60, "DRAW_ROUNDS": 40, "PLACES": 8,
        "RESTS": (0.0, 0.0, 0.0, 0.0, 0.3333333333333333, 1.0), "REACHING_STEPS": 25, "NEAR": 1e-06,
        "RANDOM_COUNTS": (12, 18, 24, 30, 36, 48, 60, 80, 100), "ORDERS": 6, "ROWS": 12,
        "POOL": 3000, "MOST_RIVALS": 20, "GLANCE": 400, "EXCHANGES": 6, "NOTHING": 1e-09,
        "UNMOVED": 1e-09, "GRID": 60, "NYSTROM": 0.001, "VARIANTS_SEEN": 8, "LISTED": 3,
        "JITTER": 1e-12, "FLATTEST": 1e-100, "LARGEST_SEED": 4294967295, "TWIST": 6,
        "MOST_ROWS": 2000, "MOST_SECONDS": 60.0, "OWN_SHARE": 0.4, "FLATTEST_TOLD": 1e-09,
        "MOST_TOLD": 100.0, "POINTS": 721, "A_PERIOD": 8, "SPEEDS": 60, "MOST_LISTED": 60,
        "LEFT_OPEN": 1.0, "SHOWN": 0.01, "MOST_PLACES": 5,
    },
}  # fmt: skip


def named(tree):
    """Names that a module gives something to."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            (target,) = node.targets if isinstance(node, ast.Assign) else (node.target,)
            yield from ast.unparse(target).strip("()").split(", ")


def is_number(value):
    """Whether it is a number, or several."""
    return isinstance(value, int | float) or (
        isinstance(value, tuple) and all(isinstance(part, int | float) for part in value)
    )


@pytest.mark.parametrize("method", STAND)
def test_every_number_stands_where_it_was_set(method):
    module = import_module(f"plumbline.{MODULES.get(method, f'optim.{method}.constants')}")
    found = named(ast.parse(Path(module.__file__).read_text(encoding="utf-8")))
    assert {name for name in found if is_number(getattr(module, name))} == set(STAND[method])
    for name, value in STAND[method].items():
        assert getattr(module, name) == pytest.approx(value, rel=1e-12), name
