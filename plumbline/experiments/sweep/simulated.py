r"""Cases of a reality that is made up anew for each: a method's answer and what is true.

.. math:: \text{options} \to (\text{recording}, \text{truth}) \to \text{answer} \to \text{figures}

What simulates shares no code with what is asked, and nothing of the truth is in the recording.
Figures are in SI units.
"""

import json
import math
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plumbline.experiments.reality.arms import ARMS
from plumbline.experiments.reality.cases import KINDS, OBSERVATIONS
from plumbline.experiments.reality.draws import LIBRARY
from plumbline.experiments.reality.drives import INSIDE as OF_DRIVES
from plumbline.experiments.reality.mpc_scenarios import FAMILIES
from plumbline.experiments.reality.parts import drawing, room
from plumbline.experiments.reality.parts.drawing import RangePlan, draw_fiducials, draw_reached
from plumbline.experiments.reality.torques import INSIDE as OF_EFFORTS
from plumbline.experiments.sweep.outcome import Outcome
from plumbline.optim.registration.registering import METHODS as ESTIMATORS

Options = Mapping[str, Any]
FLAGGED = 0.5  # probability of something outside the library at which it is flagged
REACH = 0.3  # range at which a beam is judged [m], as in the paper's figures
MOST_STEPS = 600  # of a controller's task
ANEW = 50  # draws of a reality, until one can be measured
NONE = "none"  # no effect: nothing is wrong
ANY = "any"  # whichever the draw picks


@dataclass(frozen=True)
class Factor:
    """What may be varied: words, or numbers of a range."""

    usual: Any  # where nothing is said
    least: float = 0.0
    most: float = math.inf
    words: tuple[str, ...] = ()  # what it may be, where it is no number

    @property
    def whole(self) -> bool:
        """Whether it is a whole number."""
        return isinstance(self.usual, int)

    def takes(self, value: Any) -> bool:
        """Whether it may have this value."""
        if self.words:
            return value in self.words
        if isinstance(value, bool) or not isinstance(value, int if self.whole else int | float):
            return False
        return bool(self.least <= value <= self.most)

    @property
    def expected(self) -> str:
        """What it may be, in words."""
        if self.words:
            return f"words of {', '.join(self.words)}"
        kind = "whole numbers" if self.whole else "numbers"
        end = "" if math.isinf(self.most) else f" to {self.most:g}"
        return f"{kind} from {self.least:g}{end}"

    @property
    def example(self) -> str:
        """How it is written."""
        if self.words:
            return json.dumps(list(self.words[:2]))
        return f"[{self.usual}, {2 * self.usual or 1}]"

    def drawn(self, span: Sequence[Any], share: float) -> Any:
        """A value at that share of a range: evenly, or evenly in its logarithm from above zero."""
        if self.words:
            return span[min(int(share * len(span)), len(span) - 1)]
        low, high = float(span[0]), float(span[1])
        value = low * (high / low) ** share if low > 0.0 else low + share * (high - low)
        return round(value) if self.whole else value


@dataclass(frozen=True, eq=False)
class Truth:
    """What is really so."""

    causes: frozenset[tuple[str, int | None]] = frozenset()  # effects with their elements
    listed: bool = True  # whether the library has them
    frame: NDArray[np.float64] | None = None  # (4, 4) from CT to the robot [m]
    beam: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None  # r [m] and v, (3,) each


@dataclass(frozen=True)
class Reality:
    """What can be made up, with what of it may be varied, and which methods read it."""

    draw: Callable[[Path, Options], Truth]
    factors: Mapping[str, Factor]
    methods: tuple[str, ...]


@dataclass(frozen=True)
class Method:
    """What is asked of a recording, and what of it may be varied."""

    ask: Callable[[Path, Options, Truth], dict[str, Any]]
    factors: Mapping[str, Factor] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """One draw and what is asked of it."""

    reality: str
    method: str
    options: tuple[tuple[str, Any], ...]  # value of every factor

    def to_dict(self) -> dict[str, Any]:
        """For JSON and tables."""
        return dict(self.options)


@dataclass(frozen=True)
class Design:
    """A random design, one Latin hypercube over all ranges [McKay, Beckman, Conover 1979]."""

    cases: int = 1
    seed: int = 0
    spans: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    def drawn(self, factors: Mapping[str, Factor]) -> list[dict[str, Any]]:
        """Values of the factors with a range, and a seed of its own for each case."""
        rng = np.random.default_rng(self.seed)
        strata = np.array([rng.permutation(self.cases) for _ in self.spans]).T
        shares = (strata + rng.random(strata.shape)) / self.cases
        return [
            {"seed": k}
            | {
                name: factors[name].drawn(span, float(shares[k, j]))
                for j, (name, span) in enumerate(self.spans.items())
            }
            for k in range(self.cases)
        ]


def factors_of(reality: str, method: str) -> dict[str, Factor]:
    """Everything that may be varied, the seed of the draw first."""
    return {"seed": Factor(0), **REALITIES[reality].factors, **METHODS[method].factors}


def cases(
    reality: str, method: str, grid: Mapping[str, Sequence[Any]], design: Design
) -> tuple[Case, ...]:
    """Every combination of the grid at every point of the design."""
    factors = factors_of(reality, method)
    usual = {name: factor.usual for name, factor in factors.items()}
    points = design.drawn(factors)
    return tuple(
        Case(reality, method, tuple((usual | point | dict(zip(grid, values, strict=True))).items()))
        for values in product(*grid.values())
        for point in points
    )


def outcome_of(_: Path | None, case: Case) -> Outcome:
    """Make the reality up and ask; a draw that cannot be measured is refused."""
    options = case.to_dict()
    with tempfile.TemporaryDirectory(prefix="plumbline-case-") as scratch:
        folder = Path(scratch) / "case"
        try:
            truth = REALITIES[case.reality].draw(folder, options)
            return Outcome(case, METHODS[case.method].ask(folder, options, truth))
        except ValueError as error:
            return Outcome.refusal(case, str(error))


def _by_a_design(simulator: str, folder: Path, o: Options) -> Truth:
    """A case of the simulators that the blind check draws from."""
    from plumbline.experiments.withheld.design import Design as OfSet
    from plumbline.experiments.withheld.making import drawn_case
    from plumbline.experiments.withheld.truth import LISTED

    effects = () if o["effect"] == ANY or o["kind"] == "none" else (o["effect"],)
    arms = (o["arm"],) if o.get("arm", ANY) != ANY else ()
    design = OfSet(
        o["seed"], o["kind"], observation=o.get("observation", OBSERVATIONS[0]),
        gap=(o["gap"], o["gap"]), rows=(o["rows"], o["rows"]), gross=o.get("gross", 0.0),
        effects=effects, arms=arms, simulator=simulator,
    )  # fmt: skip
    facts = json.loads(drawn_case(folder, design, 0, "case")[0])
    causes = frozenset((e["effect"], e["element"]) for e in facts["effects"])
    return Truth(causes, all(name in LISTED for name, _ in causes))


def _ranges(folder: Path, o: Options) -> Truth:
    name, plan = _named(o["effect"]), RangePlan(o["rows"], o["motions"])
    seeds = range(ANEW * o["seed"], ANEW * (o["seed"] + 1))
    drawn = draw_reached(folder, ARMS[o["arm"]](), name, o["gap"], seeds, plan)
    causes = frozenset([(name, drawn.element)] if name else [])
    return Truth(causes, name not in room.BEYOND, beam=drawn.beam)


def _fiducials(folder: Path, o: Options) -> Truth:
    name = _named(o["effect"])
    drawn = draw_fiducials(folder, name, o["gap"], o["seed"], o["markers"], o["touches"])
    causes = frozenset([(name, drawn.element)] if name else [])
    return Truth(causes, name not in drawing.BEYOND, frame=drawn.frame)


def _named(effect: str) -> str | None:
    return None if effect == NONE else effect


def _diagnosed(folder: Path, o: Options, truth: Truth) -> dict[str, Any]:
    from plumbline.experiments.sweep.recorded import figures_of
    from plumbline.optim.diagnosis.of_any_kind import diagnose
    from plumbline.optim.diagnosis.options import DiagnosisOptions

    asked = DiagnosisOptions(force=True, unlisted=o["unlisted"])
    verdict = diagnose(folder, asked).verdict
    first = verdict.causes[0] if verdict.causes else None
    right = (first.effect, first.element) in truth.causes if first else not truth.causes
    if not truth.listed:
        right = verdict.outside_probability > FLAGGED
    told = "; ".join(f"{name} {k}" if k else name for name, k in sorted(truth.causes, key=str))
    return {"truth": told, "right": bool(right), **figures_of(verdict)}


def _registered(folder: Path, o: Options, truth: Truth) -> dict[str, Any]:
    from plumbline.optim.registration import RegistrationOptions, register

    answer = register(folder, RegistrationOptions(o["estimator"]))
    assert truth.frame is not None
    middle = np.zeros(3)  # of the head, where targets lie
    away = answer.T_RC[:3, 3] - truth.frame[:3, 3]
    expected = None if answer.unknown else float(answer.tre_rms(middle))
    return {
        "error": float(np.linalg.norm(away)), "expected": expected, "misfit": answer.fre,
        "used": len(answer.used),
    }  # fmt: skip


def _calibrated(folder: Path, o: Options, truth: Truth) -> dict[str, Any]:
    from plumbline.optim.hand_eye.answer import hand_eye
    from plumbline.optim.hand_eye.calibrate import HandEyeOptions
    from plumbline.optim.hand_eye.readings import Beam

    fit = hand_eye(folder, HandEyeOptions(poses=0)).calibration
    assert truth.beam is not None
    error = fit.beam.error_at(Beam(*truth.beam), REACH)
    return {"error": error, "expected": fit.point_std(REACH), "gross": len(fit.gross)}


def _fitted(folder: Path, o: Options, truth: Truth) -> dict[str, Any]:
    from plumbline.optim.dh_fit import fit_dh
    from plumbline.optim.recording.loading import load_recording

    fit = fit_dh(load_recording(folder))
    doubts = len(fit.remarks)
    return {"after": fit.after.rms, "before": fit.before.rms, "noise": fit.noise, "doubts": doubts}


def _controlled(folder: Path, o: Options, truth: Truth) -> dict[str, Any]:
    from plumbline.experiments.mpc.campaign import CONTROLLERS, done, drawn

    run = done(drawn(o["family"], o["seed"]), CONTROLLERS[o["controller"]], True, MOST_STEPS)
    mm, (p50, p99) = 1e-3, np.percentile(run.seconds, [50.0, 99.0]).tolist()
    return {
        "clearance": mm * run.clearance, "reached": run.reached, "steps": run.steps,
        "step_p50": p50, "step_p99": p99,
    }  # fmt: skip


def _effects(*names: Iterable[str], usual: str = ANY) -> Factor:
    return Factor(usual, words=(usual, *(name for group in names for name in group)))


GAP = Factor(2.0, 1e-3, 1e3)  # what is wrong over the noise, frame and tool fitted again
KIND = Factor("single", words=KINDS)
ARM = Factor("ur5", words=tuple(ARMS))
ANY_ARM = Factor(ANY, words=(ANY, *ARMS))
METHODS: Mapping[str, Method] = {
    "diagnose": Method(_diagnosed, {"unlisted": Factor(0.2, 1e-3, 0.999)}),
    "dhfit": Method(_fitted),
    "register": Method(
        _registered,
        {"estimator": Factor("robust", words=tuple(ESTIMATORS)), "touches": Factor(1, 1, 1)},
    ),
    "handeye": Method(_calibrated),
    "control": Method(
        _controlled, {"controller": Factor("horizon", words=("horizon", "one step"))}
    ),
}
REALITIES: Mapping[str, Reality] = {
    "arm": Reality(
        partial(_by_a_design, "numpy"),
        {
            "kind": KIND, "effect": _effects(LIBRARY), "gap": GAP,
            "rows": Factor(100, 20, 5000), "gross": Factor(0.0, 0.0, 0.3), "arm": ANY_ARM,
            "observation": Factor(OBSERVATIONS[0], words=OBSERVATIONS),
        },
        ("diagnose", "dhfit"),
    ),
    "efforts": Reality(
        partial(_by_a_design, "torque"),
        {"kind": KIND, "effect": _effects(OF_EFFORTS), "gap": GAP, "rows": Factor(500, 20, 20000)},
        ("diagnose",),
    ),
    "drives": Reality(
        partial(_by_a_design, "motion"),
        {"kind": KIND, "effect": _effects(OF_DRIVES), "gap": GAP, "rows": Factor(1500, 20, 20000)},
        ("diagnose",),
    ),
    "ranges": Reality(
        _ranges,
        {
            "effect": _effects(room.OF_ARM, room.OF_ROOM, room.BEYOND,
                               usual=NONE),
            "gap": GAP, "rows": Factor(300, 60, 5000), "motions": Factor(10, 4, 100), "arm": ARM,
        },
        ("handeye", "diagnose"),
    ),
    "fiducials": Reality(
        _fiducials,
        {
            "effect": _effects(drawing.OF_HEAD, drawing.BEYOND, usual=NONE), "gap": GAP,
            "markers": Factor(8, 3, 100), "touches": Factor(5, 1, 100),
        },
        ("register", "diagnose"),
    ),
    "instruments": Reality(  # whose task is drawn where it is done
        lambda folder, o: Truth(),
        {"family": Factor("crossing", words=tuple(FAMILIES))},
        ("control",),
    ),
}  # fmt: skip
