"""What the options of every method take is what their fields declare, and nothing else."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest

import plumbline
from plumbline import PlumblineError
from plumbline.declared import Among, Count, Declared, Portion, Positive, Range, expect
from plumbline.optim.core.solvers import Ipopt, Solver
from plumbline.optim.registration import Kabsch

ODD: tuple[Any, ...] = (
    None, "x", b"x", -1, 1.5, float("nan"), float("inf"), -1e300, True, [], ["x"], {}, (1, 2, 3),
    [float("nan")] * 3, np.array([1.0, np.nan]), np.array(["x"]), np.zeros((2, 2)), object(),
    Ipopt, int,
)  # fmt: skip


IPOPT = Ipopt()


@dataclass(frozen=True)
class Every(Declared):
    """One field of each kind."""

    steps: Annotated[int, Range(1, 500)] = 10
    clearance: Annotated[float, Range(0.0, 0.1, "(", "give it in m")] = 0.002
    share: Annotated[float, Range(0.0, 1.0, "()")] = 0.5
    form: Annotated[str, Among(("planes", "scalar"))] = "planes"
    sure: bool = True
    solver: Solver = IPOPT
    named: str | Solver = "ipopt"
    most: Count | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    names: Sequence[str] = ()


def _classes() -> list[type]:
    """The classes of options that a user meets in ``plumbline``, without those that need data."""
    rooms = [plumbline, plumbline.solvers, plumbline.registration, plumbline.pointing]
    rooms += [plumbline.dh, plumbline.mpc, plumbline.range_finder]
    found = {c for room in rooms for c in vars(room).values() if isinstance(c, type)}
    found |= {getattr(plumbline, name) for name in plumbline.__all__ if name[0].isupper()}
    return sorted(
        (c for c in found if isinstance(c, type) and issubclass(c, Declared) and c is not Declared),
        key=lambda c: c.__qualname__,
    )


CLASSES = _classes()


# What some classes cannot be made without.
ZERO, ONES = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
NEEDED: dict[str, Any] = dict.fromkeys(("trocar", "centre", "lower", "start", "point"), ZERO)
NEEDED |= {"upper": ONES, "end": ONES, "length": 0.4, "radius": 0.1, "standoff": 0.1}
NEEDED |= {"name": "aorta", "shape": plumbline.pointing.Sphere(ZERO, 0.01)}


def _made(options: type) -> Any:
    fields = [f for f in dataclasses.fields(options) if f.default is dataclasses.MISSING]
    return options(**{f.name: NEEDED[f.name] for f in fields if f.name in NEEDED})


def test_the_face_has_options_of_every_method() -> None:
    names = {c.__name__ for c in CLASSES}
    assert names >= {
        "DiagnosisOptions", "DHOptions", "HandEyeOptions", "PointingOptions", "RegistrationOptions",
        "Settings", "Safety", "Noise", "Confidence", "Plant", "Ipopt", "LevenbergMarquardt",
    }  # fmt: skip


@pytest.mark.parametrize("options", CLASSES, ids=lambda c: c.__name__)
def test_options_refuse_in_one_line_or_hold_what_they_declare(options: type) -> None:
    made = _made(options)
    for field in (f for f in dataclasses.fields(options) if f.init):
        for value in ODD:
            refused = _refused(made, field.name, value)
            if refused is None and isinstance(value, (float, list, np.ndarray)):
                assert np.isfinite(np.array(value, dtype=float)).all(), field.name
            assert "\n" not in (refused or "")


def _refused(made: Any, name: str, value: object) -> str | None:
    """What is said of options with another value in one field; None if it is taken."""
    try:
        dataclasses.replace(made, **{name: value})
    except PlumblineError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"steps": 2.5}, "steps: found 2.5, expected a whole number, 1 to 500; give it so"),
        ({"steps": True}, "steps: found True, expected a whole number"),
        ({"steps": 0}, "steps: found 0, expected 1 to 500"),
        ({"steps": 501}, "steps: found 501, expected 1 to 500"),
        ({"clearance": 0.0}, "expected more than 0 and at most 0.1; give it in m"),
        ({"clearance": 2}, "clearance: found 2, expected more than 0 and at most 0.1"),
        ({"clearance": float("nan")}, "clearance: found nan, expected a finite number"),
        ({"share": 1}, "share: found 1, expected between 0 and 1"),
        ({"form": "plane"}, "form: found 'plane', expected one of planes, scalar; choose one"),
        ({"form": 3}, "form: found 3, expected text"),
        ({"sure": 1}, "sure: found 1, expected True or False"),
        ({"solver": Ipopt}, r"expected a Solver; make one: Ipopt\(\.\.\.\)"),
        ({"solver": "ipopt"}, "solver: found 'ipopt', expected a Solver"),
        ({"solver": Kabsch()}, r"solver: found Kabsch\(scale=False\), expected a Solver"),
        ({"named": 3}, "named: found 3, expected text or a Solver"),
        ({"most": -1}, "most: found -1, expected at least 0 or None"),
        ({"place": (1.0, 2.0)}, "place: found .*, expected 3 items"),
        ({"place": (1.0, 2.0, float("inf"))}, "expected a finite number"),
        ({"names": "backlash"}, "names: found 'backlash', expected a list; put it in brackets"),
        ({"names": ["a", 1]}, "expected text"),
    ],
)
def test_a_value_that_is_not_as_declared_is_told_with_the_way_out(
    given: dict[str, Any], words: str
) -> None:
    with pytest.raises(PlumblineError, match=words) as told:
        Every(**given)
    assert told.value.column == next(iter(given))


def test_numbers_of_numpy_and_lists_are_as_good_as_plain_ones() -> None:
    given: dict[str, Any] = {
        "steps": np.int64(3), "clearance": np.float32(0.01), "sure": np.bool_(False),
        "place": np.zeros(3), "names": ["a"], "named": Ipopt(), "most": np.uint8(1),
    }  # fmt: skip
    made = Every(**given)
    assert made.steps == 3
    assert Every(steps=1, clearance=0.1, share=1e-9).clearance == 0.1  # the ends that belong


def test_an_argument_is_told_as_a_field_is() -> None:
    expect("planner", None, Solver | None)
    with pytest.raises(PlumblineError, match="planner: found 'ipopt', expected a Solver"):
        expect("planner", "ipopt", Solver)
    with pytest.raises(PlumblineError, match="gain: found 0, expected more than 0"):
        expect("gain", 0, Positive)
    with pytest.raises(PlumblineError, match="share: found 0, expected more than 0 and at most 1"):
        expect("share", 0, Portion)


def test_a_type_known_in_a_function_alone_is_not_checked_and_other_fields_are() -> None:
    class Local:
        pass

    @dataclass(frozen=True)
    class Own(Every):
        anything: Any = None
        what: "Local" = dataclasses.field(default_factory=Local)

    assert isinstance(Own().what, Local)
    with pytest.raises(PlumblineError, match="steps: found 0"):
        Own(steps=0)
