"""A set drawn from the library's own linearised model, judged by the oracle and by the diagnosis.

Poses, columns and noise are the simulator's; what is wrong is a linear combination of the library's
own columns about the nominal fit. Effects of which a dense family is scanned (orders of a gear,
periods of a breath) are left out of the cases, of the oracle and of the diagnosis alike.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import Plan, draw_case, simulate, write
from plumbline.experiments.reality.recorder import Case
from plumbline.experiments.reality.scene import measured
from plumbline.experiments.withheld.design import LEVELS
from plumbline.experiments.withheld.matching import ScoredCase
from plumbline.experiments.withheld.measures import MEASURES
from plumbline.experiments.withheld.oracle import Ensemble, Rival
from plumbline.experiments.withheld.running import run_set
from plumbline.experiments.withheld.scoring import Score, judged_cases, score
from plumbline.experiments.withheld.sealing import (
    LEDGER,
    hash_of_recording,
    make_folder,
    read_ledger,
    seal_folder,
)
from plumbline.kinematics.effects import EFFECTS
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress
from plumbline.optim.diagnosis.linearise.linear import orthonormal
from plumbline.optim.diagnosis.posterior.evidence import NoisePrior
from plumbline.optim.diagnosis.posterior.pool import Pool, make_pool
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.diagnosis.predict.folds import fold_of_rows
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.recording.loading import load_recording

PLAIN = tuple(effect for effect in EFFECTS if effect.scanned is None)
SCANNED = tuple(effect.name for effect in EFFECTS if effect.scanned is not None)
COMPARED = ("ranked_effect", "ranked_element", "top1_effect", "top1_element")
KEPT = ("cases", "truth", "oracle", "verdicts")  # folders of a comparison
MOST_LISTED = 60


@dataclass(frozen=True)
class Behind:
    """How much less often the diagnosis is right than the oracle, on the same cases."""

    key: str  # the figure
    points: float  # difference of the shares in points
    low: float  # lower end of the 95 % interval, from the differences case by case
    high: float  # upper end


@dataclass(frozen=True)
class Comparison:
    """The oracle's score, the diagnosis's, and the difference."""

    level: str
    oracle: Score
    diagnosis: Score
    behind: tuple[Behind, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "level": self.level,
            "oracle": self.oracle.to_dict(),
            "diagnosis": self.diagnosis.to_dict(),
            "behind": {b.key: [b.points, b.low, b.high] for b in self.behind},
        }


def compare(
    folder: Path,
    count: int,
    *,
    level: str = "faint",
    seed: int = 0,
    jobs: int = 0,
    progress: Progress | None = None,
) -> Comparison:
    """Draw cases, ask the oracle and the diagnosis, and compare.

    Raises:
        PlumblineError: The level is not known, or the folder holds another set.
    """
    if level not in LEVELS:
        raise PlumblineError(f"--level {level!r} not recognised; known: {', '.join(LEVELS)}")
    for place in (folder, *(folder / name for name in KEPT)):
        make_folder(place)
    _sign(folder, {"level": level, "seed": seed, "count": count})
    for number in range(1, count + 1):
        if progress:
            progress(f"oracle {number} of {count}", 0.3 * (number - 1) / count)
        _make(folder, level, seed, number)
    cases, truth = folder / "cases", folder / "truth"
    if read_ledger(cases) is None:
        seal_folder(cases, truth, without=SCANNED)
    _copy_ledger(folder)
    run_set(cases, folder / "verdicts", jobs=jobs, progress=_later(progress))
    theirs, _ = judged_cases(folder / "oracle", truth)
    ours, _ = judged_cases(folder / "verdicts", truth)
    return Comparison(level, score(theirs), score(ours), _behind(theirs, ours))


def _sign(folder: Path, settings: dict[str, object]) -> None:
    path, text = folder / "oracle.json", json.dumps(settings) + "\n"
    if path.is_file() and path.read_text(encoding="utf-8") != text:
        raise PlumblineError(f"{folder}: holds another comparison; name a new folder")
    path.write_text(text, encoding="utf-8")


def _copy_ledger(folder: Path) -> None:
    content = (folder / "cases" / LEDGER).read_bytes()
    (folder / "oracle" / LEDGER).write_bytes(content)


def _later(progress: Progress | None) -> Progress | None:
    """The second part of the bar."""
    if progress is None:
        return None
    return lambda words, share: progress(f"diagnosis {words}", 0.3 + 0.7 * share)


def _make(folder: Path, level: str, seed: int, number: int) -> None:
    """Draw one case, keep its truth, and keep what the oracle says of it."""
    name = f"case-{number:04d}"
    answer = folder / "oracle" / f"{name}.json"
    if answer.is_file():
        return
    gap, rows = LEVELS[level]
    plan = Plan("none", gap=gap, rows=rows, moving=0.0)
    rng = np.random.default_rng([seed, number, 17])
    case = draw_case(plan, name, seed * 1_000_003 + number)
    recording = folder / "cases" / name
    columns = dict(simulate(case)[0].columns)
    ideal = measured(case.scene, ())
    _write(recording, case, columns, ideal)
    ensemble, basis = ensemble_of(recording, case.noise_std, gap, rng)
    k, z = ensemble.draw(rng)
    noise = rng.normal(0.0, case.noise_std, ideal.size)
    signal = ensemble.rivals[k].columns @ z
    _write(recording, case, columns, ideal + (signal + noise).reshape(ideal.shape))
    seen = signal + noise
    posterior = ensemble.posterior(seen - basis @ (basis.T @ seen), rng)
    effect, element = ensemble.rivals[k].key
    ratio = float(np.sqrt(np.mean(signal**2)) / case.noise_std)
    facts = {
        "effects": [{"effect": effect, "element": element, "gap_to_noise": ratio}],
        "rows": case.rows,
        "noise_std": case.noise_std,
        "noise_rms": float(np.sqrt(np.mean(noise**2))),
        "observation": "tip_position",
        "seed": case.seed,
    }
    for path, content in (
        (folder / "truth" / f"{name}.json", facts),
        (answer, _verdict(ensemble, posterior, hash_of_recording(recording))),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _write(folder: Path, case: Case, columns: dict[str, Array], points: Array) -> None:
    """Write the recording with other tip readings (N, 3) [m]."""
    tables = replace(simulate(case)[0], columns=columns | dict(zip("xyz", points.T, strict=True)))
    write(folder, tables)


def ensemble_of(
    folder: Path, sigma: float, gap: tuple[float, float], rng: np.random.Generator
) -> tuple[Ensemble, Array]:
    """All rivals about the nominal fit of a recording, and the nuisances' basis (n, p)."""
    recording = load_recording(folder)
    weights = np.ones(len(recording))
    model, nominal = fit(recording, (), nuisances_of(recording), weights, SOLVER)
    folds = fold_of_rows(recording, "auto", 0)
    pool = make_pool(model, nominal.x, folds, NoisePrior.of(sigma), library=PLAIN)
    parts = [J for _, _, J in Mapped(pool.model.problem).jacobians(pool.x)]
    columns = np.concatenate(parts).reshape(-1, len(pool.x)) * pool.model.problem.scale
    basis = orthonormal(columns[:, : pool.always])
    beside = columns - basis @ (basis.T @ columns)
    return Ensemble.of(_rivals(pool, beside), sigma, gap, rng), basis


def _rivals(pool: Pool, given: Array) -> list[Rival]:
    found = []
    for candidate in pool.candidates:
        parameters = candidate.effect.parameters
        lower = np.array([(p.lower - p.null) / p.scale for p in parameters])
        upper = np.array([(p.upper - p.null) / p.scale for p in parameters])
        columns = given[:, candidate.columns]
        found.append(Rival(candidate.key, columns, lower, upper, candidate.log_prior))
    return found


def _verdict(ensemble: Ensemble, posterior: Array, recording: str) -> dict[str, Any]:
    """The posterior as a verdict: the best cause named, all of them ranked."""
    total: dict[tuple[str, int | None], float] = {}
    for rival, p in zip(ensemble.rivals, posterior.tolist(), strict=True):
        total[rival.key] = total.get(rival.key, 0.0) + p
    ranked = sorted(total, key=lambda key: -total[key])[:MOST_LISTED]
    causes = [
        {"effect": key[0], "element": key[1], "probability": min(total[key], 1.0)} for key in ranked
    ]
    stamp = {"recording": recording, "without": list(SCANNED)}
    return {
        "verdict": "explained",
        "causes": causes[:1],
        "candidates": causes,
        "withheld": stamp,
    }


def _behind(theirs: list[ScoredCase], ours: list[ScoredCase]) -> tuple[Behind, ...]:
    """Differences of shares, with the interval of a mean of paired differences."""
    found = []
    for measure in MEASURES:
        if measure.key not in COMPARED:
            continue
        pairs = zip(theirs, ours, strict=True)
        each = [measure.count(a)[0] - measure.count(b)[0] for a, b in pairs]
        reach = 1.96 * float(np.std(each)) / np.sqrt(len(each))
        middle = float(np.mean(each))
        found.append(
            Behind(measure.key, 100 * middle, 100 * (middle - reach), 100 * (middle + reach))
        )
    return tuple(found)
