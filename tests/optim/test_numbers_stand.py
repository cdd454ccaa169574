"""Every number of these methods stands where it was set."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

STAND = {
    "budget": {
        "ROUNDING": 1e-09, "DRAWS": 2000, "FEWEST": 4, "SYMMETRIC": 1e-09, "MOST_LINKS": 100,
        "SAME_PLACE": 1e-06,
    },
    "core": {
        "LARGEST_ANSWER": 500000000, "STILL": 0.1, "STATIONARY": 1e-05, "FEASIBLE": 1e-08,
        "LEAST_RESIDUAL": 1e-09, "SINGULAR": 1e-12, "LISTED": 4, "CHUNK_NUMBERS": 4000000,
        "NEARBY": 0.1, "LEVEL": 0.95, "SIDES": (0.025000000000000022, 0.975), "NEAR": 1e-06,
        "GROWTH": 2.0, "LEAST": 0.1, "KEPT": 0.5, "MOST_TURN": 0.75, "LEAST_COST": 1e-30,
        "SAMPLE": 500,
    },
    "dh_fit": {
        "DELTA_LENGTH": 0.01, "DELTA_ANGLE": 0.08726646259971647, "FRAME_SCALE": 0.01,
        "TOOL_SCALE": 0.01, "WIDE_BOUNDS": 1000.0, "MEDIAN": 2.3659738843753377,
        "COUNT_OF_DIRECTIONS": 2000, "ROUGH": 0.001, "LEAST_DAMPING": 1e-09, "NARROWING": 10.0,
        "NEAR": 0.01, "QUICK": 6, "PATIENCE": 3, "NEWTON_DAMPING": 1e-06, "FLOOR": 0.001,
        "FACTOR": 30.0, "DEPENDENT": 1e-08, "ABSENT": 1e-10, "MOST_POSES": 4000, "PARTNER": 1e-06,
        "SLIGHT": 0.1, "WHOLE": 0.01, "UNBOUNDED": 1000.0, "RESTING": 1e-06, "CHANCE": 0.001,
        "STATED_WITHIN": 1.1, "ROUNDING": 1e-09, "COARSE": 3.0, "LEAST_SOFT": 1e-07,
        "MOST_SOFT": 0.01, "MOST_SOFT_ROWS": 600, "FALSE_ALARM": 0.01, "SLACK": 1.7,
        "MOST_SHARE": 0.4, "FEWEST_FREEDOM": 15, "FEWEST_ROWS": 20, "SHAPE_ROUNDS": 30,
        "LEAST_SHAPE": 0.0001, "LEAST_LEFT": 0.1, "COUNT": 4, "FLATTEST": 0.001, "SPARE_STEPS": 2,
        "MOST_STEPS": 40, "CANDIDATES": 400, "TARGETS": 60, "SWEEPS": 8, "TRIES": 200,
        "VAGUE": 1e-08, "AGREES": 1e-09, "POSTURES": 20,
    },
    "measurement": {
        "SMOOTH": 0.25, "FRAME_SCALE": (0.1, 0.1), "TOOL_SCALE": 0.05, "COINCIDENT": 1e-12,
        "WIDE_BOUNDS": 1000.0, "MASS_PER_METRE": 15.0, "LEAST_HALF": 0.001, "UNIT": 0.0001,
    },
    "model": {
        "MARGIN": 0.02, "CHANGED": 4.0, "WORTH": 0.1, "NAMED": 3, "STILL_HOLDS": 1.5,
        "FIRST_STEPS": 12, "STEPS": 30, "SETTLED": 1e-11, "FAR_STEPS": 60, "LONGEST": 0.4,
        "PLACE_FIRST": 100.0, "EASED": 10.0, "STARTS": 12, "REACHED": 1e-06, "SLACK": 1e-09,
        "LOAD_ROUNDS": 2, "STIFF": 300.0, "DAMPED": 1.0, "LEAST_DAMPED": 0.4, "MJCF_STEP": 0.001,
        "SPAN": 20.0, "SAMPLE": 0.02, "AGREES": 1e-09, "ASKED": 40, "SAME_CONSTANT": 1e-12,
        "LEAST_MASS": 0.001, "LEAST_INERTIA": 1e-06, "UNTURNED": 4e-06, "REST": 1.0,
        "SLIDE_STEP": 0.001, "MOST_POINTS": 2000, "SHAKEN": 0.37, "WIDE": 1000.0, "NEAR_LEVER": 0.1,
        "NEAR_DAMPING": 0.001, "NEAR_STEPS": 12, "PLACED": 1e-09, "STILL": 1e-08, "FARTHEST": 0.1,
        "LAG_ROUNDS": 8, "NARROWEST": 1e-06, "LARGEST_MODEL": 64000000, "MOST_EFFECTS": 2000,
        "MOST_JOINTS": 64, "SAMPLES": 100, "LARGEST": 1000000000.0,
    },
    "pointing": {
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
    },
}  # fmt: skip


def named(tree):
    """Names that a module gives something to."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            (target,) = node.targets if isinstance(node, ast.Assign) else (node.target,)
            yield from ast.unparse(target).strip("()").split(", ")


@pytest.mark.parametrize("method", STAND)
def test_every_number_stands_where_it_was_set(method):
    module = import_module(f"plumbline.optim.{method}.constants")
    found = set(named(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))))
    assert {n for n in found if isinstance(getattr(module, n), int | float | tuple)} == set(
        STAND[method]
    )
    for name, value in STAND[method].items():
        assert getattr(module, name) == pytest.approx(value, rel=1e-12), name
