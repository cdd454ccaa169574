"""A diagnosis with invented numbers, for what shows one: nothing is fitted here."""

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from plumbline.experiments.report.writing import PAGES
from plumbline.optim.core.judged import Judgement
from plumbline.optim.diagnosis.findings import (
    Blame,
    Cause,
    Estimate,
    Gap,
    NoiseLevel,
    Outcome,
    Place,
    Step,
    Verdict,
)
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

PAGES["MadeUp"] = PAGES["Diagnosis"]  # it is shown as one
BENCH = (
    Path(__file__).resolve().parents[1] / "plumbline" / "experiments" / "recordings" / "bench-ur5"
)


@dataclass(frozen=True, eq=False)
class MadeUp:
    """Looks like a diagnosis."""

    recording: Recording
    verdict: Verdict
    residual_before: np.ndarray
    residual_after: np.ndarray
    trusted: np.ndarray
    places: np.ndarray
    options: DiagnosisOptions = field(default_factory=DiagnosisOptions)

    def transfer(self, other: Recording, *, force: bool = False) -> SimpleNamespace:
        """Half the gap is left on any other recording."""
        gap = self.verdict.gap
        sizes = {"before": gap.before, "after": gap.before / 2, "unit": gap.unit}
        again = {"refitted": ("frame", "tool"), "outside_share": 0.0}
        return SimpleNamespace(**sizes, **again, left_out=(), judged=Judgement())


def angle(value: float, std: float, doc: str = "") -> Estimate:
    """A parameter in radians."""
    return Estimate(value, std, "rad", doc=doc)


def made_up_verdict(recording: Recording, before: float, after: float) -> Verdict:
    """Three causes, one of them a ripple of many orders; rivals, blind spots, notes."""
    sigma = recording.noise_std or 8e-5
    floor = sigma * (1.0 if recording.observation == "joint_position" else np.sqrt(3.0))
    rng = np.random.default_rng(7)
    orders = {}
    for order in (17, 34, 8, 100, 12.5, 64, 3):
        for part, doc in (("sine", "in phase with q"), ("cosine", "in quadrature")):
            orders[f"order {order:g} {part}"] = angle(float(rng.normal(0, 1e-3 / order)), 2e-6, doc)
    compliance = Estimate(8.4e-6, 4e-7, "rad/(N m)", doc="twist per load torque")
    causes = (
        Cause(
            "joint_compliance", "joint", 2, probability=0.998, before=before, after=0.5 * before,
            parameters={"compliance": compliance}, words="joint 2's drive twists under its load",
            confounded_with=(Blame("link_flex", "link", 2, "would change little"),),
        ),
        Cause(
            "gear_ripple", "joint", 1, probability=0.97, parameters=orders, before=0.4 * before,
            after=after, words="joint 1's gear errs periodically, many times per turn",
        ),
        Cause(
            "joint_offset", "joint", 3, probability=0.93,
            parameters={"offset": Estimate(-6.1e-4, 2.3e-5, "rad", True, "error of the zero")},
            before=0.3 * before, after=after, words="joint 3's zero is off",
        ),
    )  # fmt: skip
    others = [("backlash", "joint", 2), ("base_drift", "base", None), ("link_geometry", "link", 2)]
    candidates = tuple(
        Cause(effect, stage, element, probability=0.2 / (k + 1), words="")
        for k, (effect, stage, element) in enumerate(others)
    )
    return Verdict(
        verdict=Outcome.EXPLAINED,
        gap=Gap(recording_unit(recording), before, after, floor, 1 - after / before, (0.71, 0.9),
                held_out_by="groups", removable=0.95),
        where=(Place("joint", 2, 0.62), Place("joint", 1, 0.2), Place("joint", 3, 0.12),
               Place("sensor", None, 0.06)),
        causes=causes,
        candidates=(*causes, *candidates),
        outside_probability=0.012,
        unobservable=(
            *(Blame("hysteresis", "joint", j, "no row excites it") for j in (4, 5, 6)),
            Blame("latency", "sensor", None, "needs the column velocity"),
        ),
        next=({"pose": [0.1, 0.2, 0.3, 0.0, 0.0, 0.0], "why": "tells link_flex from the drive"},),
        staircase=(Step("joint_compliance of joint 2", 0.5 * before),
                   Step("gear_ripple of joint 1", 1.5 * after),
                   Step("joint_offset of joint 3", after)),
        noise=NoiseLevel(sigma, "given", 1.04),
        distrusted_rows=(17, 54),
        notes=("temperature varies by 0.4 K only",),
        recording=recording.name,
        rows=len(recording),
        sha256=recording.sha256,
    )  # fmt: skip


def recording_unit(recording: Recording) -> str:
    """Unit of the gap."""
    return "rad" if recording.observation == "joint_position" else "m"


def made_up(recording: Recording | None = None) -> MadeUp:
    """A diagnosis of a recording, by default of the bundled one."""
    recording = load_recording(BENCH) if recording is None else recording
    rng = np.random.default_rng(5)
    n, m = len(recording), recording.chain.n if recording.observation == "joint_position" else 3
    swing = 6e-4 * np.sin(3.0 * recording.q[:, :m])
    after = rng.normal(0.0, 8.5e-5, (n, m))
    trusted = np.ones(n, dtype=bool)
    trusted[[16, 3]] = False
    rms = [float(np.sqrt((r**2).sum(axis=1).mean())) for r in (after + swing, after)]
    return MadeUp(
        recording=recording,
        verdict=made_up_verdict(recording, *rms),
        residual_before=after + swing,
        residual_after=after,
        trusted=trusted,
        places=recording.chain.placement(recording.q)[:, :3, 3],
    )
