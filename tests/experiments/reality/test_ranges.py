"""The table of ranges, spreads and chances that simulators draw from."""

import ast
from pathlib import Path

import numpy as np
import pytest

import plumbline.experiments.reality
from plumbline.experiments.reality import moving, unseen
from plumbline.experiments.reality.ranges import CHANCES, SPREADS, TABLES, Ranges
from plumbline.experiments.reality.scene import MECHANISMS, Mechanism

SOURCES = [
    path.read_text() for path in Path(plumbline.experiments.reality.__file__).parent.rglob("*.py")
]
# A published seed draws the same again only while these stand.
ENDS = {
    "session": {
        "period": (8.0, 15.0), "box": (0.2, 0.4), "sockets": (2, 4), "socket": (-0.2, 0.2),
        "parts": (4, 6), "air": (-1.0, 1.0), "swing": (0.3, 1.0), "swing_period": (0.4,
        1.2), "swing_phase": (0.0, 6.0), "rise": (5.0, 15.0), "settle": (0.2, 0.6),
    },
    "case": {
        "mass": (0.9, 1.1), "force": (0.3, 3.0), "noise": (2e-05, 0.0002, 'log'),
        "encoder_noise": (1e-05, 0.0001, 'log'), "tool_aside": (0.02, 0.1), "tool_along":
        (0.05, 0.25), "away": (1.5, 2.5), "lag": (40.0, 180.0),
    },
    "library": {
        "ripple": (0.7, 1.0), "gear_order": (3.0, 250.0, 'log'), "stiffening": (0.1, 0.3),
        "start": (-1.0, 1.0), "unequal": (-0.15, 0.15), "drift_rate": (0.5, 3.0), "moment":
        (0.2, 0.8), "breath": (3.0, 6.0), "breath_power": (2, 3), "play_seat": (0.005,
        0.03), "drive": (0.9, 1.1), "spot": (0.3, 0.6), "cross_order": (2, 6), "cross_mesh":
        (1, 3), "grip": (0.5, 2.0), "jump": (-1.0, 1.0), "breath_begun": (0.0,
        3.141592653589793),
    },
    "unseen": {
        "forgets": (2.0, 8.0), "offset": (0.15, 0.3), "gain": (1.6, 2.4), "bits": (3, 7),
        "cushioned": (0.75, 0.9), "pit": (0.07, 0.12), "slips": (0.2, 3.0, 'log'), "cools":
        (0.05, 0.2), "worn_from": (0.05, 0.5), "worn_for": (0.3, 0.45), "opens": (0.1, 0.6),
        "fades": (0.05, 0.15), "bell": (0.5, 0.9), "closed": (0.5, 0.75), "soaks": (0.1,
        0.3), "bias": (-0.3, 0.3), "softness": (0.03, 0.15), "dipole": (0.3, 0.7), "slack":
        (0.5, 0.67), "layer": (0.7, 1.5),
    },
    "reading": {
        "axis": (0.5, 1.6), "gross": (10.0, 60.0),
    },
    "moving": {
        "compliance": (5e-06, 5e-05, 'log'), "play": (0.0002, 0.003, 'log'), "latency":
        (0.002, 0.03), "payload": (0.15, 0.5), "coulomb": (5.0, 15.0), "dip": (1.0, 3.0),
        "slow": (0.05, 0.2), "tissue": (50.0, 300.0), "tool_aside": (0.03, 0.1),
        "tool_along": (0.05, 0.2), "log_noise": (-10.8, -8.5),
    },
    "motion": {
        "swing": (0.25, 0.45), "speed": (0.15, 0.5), "uneven": (0.8, 1.2), "period": (0.05,
        0.2), "delay": (0.0, 0.008),
    },
    "drive": {
        "delay": (0.01, 0.12, 'log'), "lag": (0.01, 0.15, 'log'), "gain": (0.02, 0.2,
        'log'), "offset": (0.005, 0.1, 'log'), "play": (0.004, 0.05, 'log'), "deadband":
        (0.005, 0.05, 'log'), "fastest": (0.3, 0.7, 'log'), "steepest": (0.5, 3.0, 'log'),
        "compliance": (0.002, 0.02, 'log'), "bandwidth": (1.0, 4.0, 'log'), "breakaway":
        (0.01, 0.05, 'log'), "cogging": (0.005, 0.03, 'log'), "fading": (0.05, 0.3, 'log'),
        "lost": (0.1, 0.6, 'log'), "ringing": (1.0, 3.0, 'log'), "noise": (0.0001, 0.005,
        'log'), "length": (0.2, 0.5), "mass": (0.5, 4.0), "lasts": (40.0, 80.0),
        "frequency": (0.03, 1.5, 'log'),
    },
    "torque": {
        "noise": (0.003, 0.03, 'log'), "slow": (0.05, 0.25), "cogging_order": (4, 8),
        "cogging_phase": (0.0, 6.0), "hangs": (-0.5, 0.5), "joints": (5, 7), "size": (0.3,
        1.5, 'log'), "length": (0.15, 0.4), "mass": (0.6, 1.4), "aside": (-0.3, 0.3),
        "height": (0.3, 0.7), "middle": (-1.0, 1.0), "frequency": (0.1, 0.8), "swing":
        (0.15, 0.6),
    },
    "part": {
        "touch": (3.0, 9.0), "head": (-0.5, 0.5), "breath": (3.0, 5.5), "moment": (0.3,
        0.7), "foot": (0.35, 0.6), "middle": (-0.1, 0.1), "period": (0.1, 0.2),
    },
    "ranging": {
        "lean": (0.0, 0.06), "mount": (-0.008, 0.008), "board": (-0.02, 0.02), "azimuth":
        (-0.3, 0.3), "mark": (-0.8, 0.8), "block_turn": (-0.2, 0.2), "put": (-0.02, 0.02),
        "ct": (-0.1, 0.1), "inside": (0.2, 0.7), "tracker_aside": (-1.0, 1.0),
        "tracker_away": (1.0, 3.0),
    },
    "needles": {
        "scale": (0.4, 1.7), "half": (30, 55), "far": (20, 40), "deep": (95, 140), "close":
        (6, 9), "near": (-1, 3), "sweep": (25, 40), "pass_depth": (100, 140), "rod": (3, 6),
        "gap": (12, 16), "gap_at": (-15, 0), "off": (-20, 20), "width": (14, 24),
        "wall_depth": (100, 125), "wall_at": (-12, -4), "pocket": (10, 20), "swings": (1,
        3), "across": (-25, 25), "along": (-15, 15), "height": (-150, -90), "rod_half": (0,
        12), "body": (3, 7), "circle": (50, 65), "ring_depth": (95, 135), "inner": (18, 35),
        "shallow": (8.0, 30.0), "fast": (50.0, 1000.0, 'log'), "flier_half": (0, 10),
        "flier": (1.5, 5.0), "swing": (10.0, 60.0), "fliers": (1, 2), "when": (0.2, 2.0),
        "drifters": (2, 4), "drifter": (3.0, 8.0), "crowd": (2, 4), "crowd_circle": (40,
        65), "still": (0, 2), "still_body": (2, 6),
    },
    "tips": {
        "turn": (-1.5, 1.5),
    },
}  # fmt: skip
SIGMAS = {
    "session": {
        "velocity": 0.3, "box": 0.5, "socket": 0.9,
    },
    "case": {
        "tool": 0.002, "aim": 0.05,
    },
    "library": {
        "geometry": [1.0, 1.0, 2.0], "needle": 0.05, "twist": [1.0, 1.0, 1.0, 1.5, 1.5,
        1.5],
    },
    "unseen": {
        "seam": 0.3,
    },
    "part": {
        "beam": 0.2, "square": 0.15, "place": 0.05, "mount": 0.02,
    },
    "ranging": {
        "stands": 0.03, "head": 0.05, "scanner": 0.6, "tracker": 1.0,
    },
    "needles": {
        "trocar": 4, "height": 3, "tip": 5, "passed": 2, "narrow": 4, "swing": [8, 12, 8],
        "start": 10, "goal": 15, "spacing": 0.1, "near": 15, "met": 10, "rod": 8, "place":
        [50.0, 50.0, 40.0],
    },
    "tips": {
        "camera": 0.3, "device": 0.5,
    },
}  # fmt: skip
SHARES = {
    "session": {
        "repeated": 0.1, "held": 0.25, "unsided": 0.1,
    },
    "case": {
        "glued": 0.6, "centred": 0.3, "flipped": 0.5,
    },
    "library": {
        "whole_order": 0.5, "dimension": 0.5, "in_a_row": 0.5, "seated_by_load":
        0.3333333333333333, "once": 0.6,
    },
    "drive": {
        "holds": 0.2,
    },
    "needles": {
        "rod": 0.5, "flies": 0.5,
    },
}  # fmt: skip
# Largest strength of a mechanism, and where its search begins if not at 1e-3.
LIMITS = {
    "JointOffset": 0.03, "JointScale": 0.02, "JointCompliance": (0.01, 1e-05), "Backlash":
    0.02, "LoadedPlay": 0.02, "CoupledPlay": 0.02, "Hysteresis": 0.02, "TransmissionRipple":
    0.01, "GearRipple": 0.005, "JointCoupling": 0.02, "Payload": (300.0, 1.0), "Latency": 0.2,
    "LinkGeometry": 0.01, "LinkThermal": (0.0005, 2e-05), "LinkFlex": (0.01, 1e-05),
    "JointTilt": (0.01, 1e-06), "BaseDrift": 0.02, "BaseBump": 0.02, "BaseCompliance": (0.001,
    1e-05), "ToolSlip": 0.02, "NeedleSag": 0.02, "NeedleBending": (0.02, 0.0001),
    "SensorScale": 0.02, "SensorDistortion": 0.3, "Respiration": 0.03, "CrossRipple": 0.01,
    "MagneticSpot": 0.05, "StickSlip": 0.02, "LooseTool": 0.05, "CableCreep": 0.01,
    "EncoderInterpolation": 0.1, "EndCushion": 0.02, "FlexsplineLoad": 0.01, "GearPit": 0.01,
    "HubSlip": 0.02, "LoadWindup": 0.02, "MaxwellSlip": 0.01, "MotorHeat": 0.01, "WornBelt":
    0.02, "BearingRunout": 0.01, "Draught": 0.02, "FloorSag": 0.02, "LooseBolt": 0.01,
    "ThermalBow": 0.01, "ToolRocking": 0.02, "FieldBody": 0.05, "HoseDrag": 0.1,
    "StitchedVolume": 0.02, "TrackerRefraction": 0.02, "Friction": None, "ViscousFriction":
    None, "EffortCompliance": None, "TipForce": None,
}  # fmt: skip
EVERY = [(kind, name) for kind, table in TABLES.items() for name in table]
SPREAD = [(kind, name) for kind, table in SPREADS.items() for name in table]
CHANCE = [(kind, name) for kind, table in CHANCES.items() for name in table]


def test_no_end_no_spread_and_no_chance_moves_unseen():
    """A published seed draws the same again."""
    ends = {
        kind: {name: row[:2] + row[4:] * (row.law == "log") for name, row in table.items()}
        for kind, table in TABLES.items()
    }
    assert ends == ENDS
    assert {k: {n: row.size for n, row in t.items()} for k, t in SPREADS.items() if t} == SIGMAS
    assert {k: {n: row.share for n, row in t.items()} for k, t in CHANCES.items() if t} == SHARES


def test_no_limit_of_a_mechanism_moves_unseen():
    found = {
        name: (limit[0], row["typical"]) if "typical" in row else limit[0]
        for name, row in MECHANISMS.items()
        for limit in [row.get("limit", [None])]
    }
    assert found == LIMITS


def _kinds(kind):
    """All that derives from a kind."""
    below = kind.__subclasses__()
    return below + [one for other in below for one in _kinds(other)]


def test_every_mechanism_has_its_row_and_every_limit_its_unit_and_reason():
    ours = (kind for kind in _kinds(Mechanism) if kind.__module__.startswith("plumbline"))
    kinds = {kind.__name__: kind for kind in ours}
    assert {moving.Friction, *unseen.OF_JOINTS} <= set(kinds.values())
    assert set(MECHANISMS) == {name for name, kind in kinds.items() if kind.effect}
    for name, row in MECHANISMS.items():
        if "limit" in row:
            limit, unit, why = row["limit"]
            assert kinds[name].limit == limit
            assert unit
            assert len(why) > 5


@pytest.mark.parametrize(("kind", "name"), [*SPREAD, *CHANCE])
def test_a_spread_or_a_chance_has_its_reason_and_is_drawn_from(kind, name):
    spread = SPREADS[kind].get(name)
    row = spread or CHANCES[kind][name]
    assert len(row.why) > 5
    assert spread is None or spread.unit
    used = [f'("{name}"', f'["{name}"]', f', "{name}", 3 * rows']
    assert any(
        f'Ranges("{kind}")' in text and any(form in text for form in used) for text in SOURCES
    )


@pytest.mark.parametrize(("kind", "name"), SPREAD)
def test_what_is_spread_has_its_sigma_about_zero(kind, name):
    size = np.array(SPREADS[kind][name].size)
    drawn = Ranges(kind).near(name, np.random.default_rng(0), (4000, *size.shape)) / size
    assert np.mean(drawn, axis=0) == pytest.approx(0.0, abs=0.06)
    assert np.std(drawn, axis=0) == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize(("kind", "name"), CHANCE)
def test_what_has_a_chance_happens_as_often(kind, name):
    rng, share = np.random.default_rng(0), CHANCES[kind][name].share
    seen = np.mean([Ranges(kind).happens(name, rng) for _ in range(4000)])
    assert seen == pytest.approx(share, abs=0.03)


def _numbers(node):
    """Numbers written out in an expression, zero and one aside."""
    constants = [c.value for c in ast.walk(node) if isinstance(c, ast.Constant)]
    return [v for v in constants if isinstance(v, int | float) and v not in (0, 1)]


def _written_out(node):
    """A spread or a chance that a draw has as a bare number."""
    text = ast.unparse(node)
    if isinstance(node, ast.Call) and text.startswith("rng.normal("):
        return [n for scale in node.args[1:2] if isinstance(scale, ast.Constant)
                for n in _numbers(scale)]  # fmt: skip
    if isinstance(node, ast.Compare) and text.startswith("rng.random("):
        return _numbers(node.comparators[0])
    if isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant):
        return _numbers(node.left) if ast.unparse(node.right).startswith("rng.normal(") else []
    return []


@pytest.mark.parametrize("text", SOURCES)
def test_no_draw_has_its_spread_or_its_chance_as_a_bare_number(text):
    assert [n for node in ast.walk(ast.parse(text)) for n in _written_out(node)] == []


@pytest.mark.parametrize("line", ["rng.normal(0.0, 0.3, 3)", "rng.random() < 0.2",
                                  "rng.random(n) < 0.2", "0.2 * rng.normal(size=3)"])  # fmt: skip
def test_a_bare_number_in_a_draw_is_seen(line):
    assert any(_written_out(node) for node in ast.walk(ast.parse(line)))


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_range_has_a_unit_a_reason_and_room_and_is_drawn_from(kind, name):
    low, high, unit, why, law = TABLES[kind][name]
    assert low < high
    assert unit
    assert len(why) > 5
    assert law in ("uniform", "log")
    fields = "RANGES.one(field" if kind == "drive" else f'"{name}"'
    assert any(
        f'Ranges("{kind}")' in text and (f'"{name}"' in text or fields in text) for text in SOURCES
    )


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_what_is_drawn_fills_its_range_evenly(kind, name):
    low, high, _, _, law = TABLES[kind][name]
    ends = np.log([low, high]) if law == "log" else np.array([low, high], dtype=float)
    drawn = Ranges(kind).many(name, np.random.default_rng(0), 2000)
    share = ((np.log(drawn) if law == "log" else drawn) - ends[0]) / np.ptp(ends)
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    assert np.quantile(share, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.04)


def test_whole_numbers_are_drawn_up_to_both_ends():
    rng = np.random.default_rng(0)
    assert {Ranges("session").whole("sockets", rng) for _ in range(100)} == {2, 3, 4}
