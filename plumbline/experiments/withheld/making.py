"""Making a set: for each case the ledger's line first, then the truth, then the recording.

What was begun can be continued: the same design adds the cases that are missing, and a design that
differs is refused.
"""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality import draw_case, simulate, write
from plumbline.experiments.reality.confounding import confounded
from plumbline.experiments.withheld import sealing
from plumbline.experiments.withheld.design import ONE, Design, Draw, draw_plan
from plumbline.optim.core.progress import Progress

ATTEMPTS = 20  # draws until one makes a case


def make_set(
    cases: Path, truth: Path, design: Design, count: int, progress: Progress | None = None
) -> sealing.Ledger:
    """Write what a set of sealed cases lacks (PlumblineError: it is another, or was changed)."""
    sealing.check_apart(cases, truth)
    plan = json.dumps({"design": asdict(design)}, indent=1, sort_keys=True) + "\n"
    _begin(cases, truth, plan)
    begun = sealing.read_ledger(cases)
    assert begun is not None
    known = begun.by_case
    for number in range(1, count + 1):
        name = f"case-{number:04d}"
        if progress:
            progress(name, (number - 1) / count)
        if not _is_there(cases, truth, known.get(name)):
            _make_one(cases, truth, design, number, name, known.get(name))
    ledger = sealing.read_ledger(cases)
    assert ledger is not None
    return ledger


def _begin(cases: Path, truth: Path, plan: str) -> None:
    """Write the head of the ledger, or refuse to mix two sets."""
    sealed = hashlib.sha256(plan.encode()).hexdigest()
    ledger = sealing.read_ledger(cases)
    if ledger is None and cases.is_dir() and any(cases.glob("*/dataset.toml")):
        raise PlumblineError(f"{cases}: holds recordings without a ledger; use a new folder")
    if ledger is not None and ledger.plan != sealed:
        raise PlumblineError(f"{cases}: holds a set of another design or seed; use a new folder")
    _check_truth_folder(truth, plan, sealed)
    for folder in (truth, cases):
        sealing.make_folder(folder)
    if ledger is None:
        sealing.append(cases / sealing.LEDGER, sealing.head(sealed))
    (truth / sealing.PLAN).write_text(plan, encoding="utf-8")
    shutil.copyfile(cases / sealing.LEDGER, truth / sealing.LEDGER)


def _check_truth_folder(truth: Path, plan: str, sealed: str) -> None:
    """Refuse a folder that holds another set's truth, or verdicts."""
    theirs, note = sealing.read_ledger(truth), truth / sealing.PLAN
    if theirs is not None:
        strange = theirs.plan != sealed
    elif note.is_file():
        strange = note.read_bytes() != plan.encode()
    else:
        strange = truth.is_dir() and any(truth.glob("case-*.json"))
    if strange or (truth / sealing.RUN).exists():
        raise PlumblineError(
            f"{truth}: holds the truth of another set, or verdicts; name a new one"
        )


def _check_place(recording: Path, made: Path, *, begun: bool) -> None:
    """Refuse a folder in a recording's place that holds what this set did not write."""
    if not (recording.exists() or recording.is_symlink()):
        return
    plain = recording.is_dir() and not recording.is_symlink()
    there = {p.relative_to(recording) for p in recording.rglob("*")} if plain else set()
    mine = {p.relative_to(made) for p in made.rglob("*")} if begun else set()
    if not plain or there - mine:
        what = recording / min(there - mine) if there - mine else recording
        raise PlumblineError(f"{what}: not of this set and in its way; take it out of there")


def _is_there(cases: Path, truth: Path, entry: sealing.Entry | None) -> bool:
    if entry is None:
        return False
    recording, fact = cases / entry.case, truth / f"{entry.case}.json"
    if not (recording / "samples.csv").is_file() or not fact.is_file():
        return False
    sealing.check_seal(entry, recording, fact)
    return True


def _make_one(
    cases: Path, truth: Path, design: Design, number: int, name: str, sealed: sealing.Entry | None
) -> None:
    with tempfile.TemporaryDirectory(prefix="plumbline-make-") as scratch:
        made = Path(scratch) / name
        text, without = drawn_case(made, design, number, name)
        truth_hash = hashlib.sha256(text.encode()).hexdigest()
        entry = sealing.Entry(name, truth_hash, sealing.hash_of_recording(made), without)
        if sealed is not None and entry != sealed:
            raise PlumblineError(f"{name}: this version draws another case than the sealed one")
        _check_place(cases / name, made, begun=sealed is not None)
        if sealed is None:
            sealing.append(cases / sealing.LEDGER, sealing.line(entry))
        (truth / f"{name}.json").write_text(text, encoding="utf-8")
        shutil.copyfile(cases / sealing.LEDGER, truth / sealing.LEDGER)
        shutil.rmtree(cases / name, ignore_errors=True)
        shutil.copytree(made, cases / name)


def drawn_case(folder: Path, design: Design, number: int, name: str) -> tuple[str, tuple[str, ...]]:
    """Write a recording; returns the text of its truth and what the run must do without."""
    reason = ""
    for attempt in range(ATTEMPTS):
        draw = draw_plan(design, number, attempt)
        try:
            facts = _simulated(folder, design, draw, name, number, attempt)
        except ValueError as error:
            reason = str(error)
            continue
        rng = np.random.default_rng([design.seed, number, attempt, 23])
        without = _one_of(facts, rng) if ONE in design.leave_out else draw.without
        return json.dumps(facts, indent=1, sort_keys=True) + "\n", without
    raise PlumblineError(f"{name}: {ATTEMPTS} draws gave no case; the last: {reason}")


def _one_of(facts: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, ...]:
    """The effect of one of the causes, whichever: they are listed in the order of the chain."""
    names = [str(effect["effect"]) for effect in facts["effects"]]
    if len(set(names)) < len(names):
        raise PlumblineError(f"{names[0]}: twice in one case, two effects expected; draw another")
    return (str(rng.choice(names)),)


def _simulated(
    folder: Path, design: Design, draw: Draw, name: str, number: int, attempt: int
) -> dict[str, object]:
    seed = (design.seed * 1_000_003 + number) * 101 + attempt
    if design.simulator == "motion":
        from plumbline.experiments.reality.drives import simulate_drives

        return simulate_drives(folder, draw.plan, name, seed)
    if design.simulator == "mujoco":
        from plumbline.experiments.reality.moving import simulate_moving

        return simulate_moving(folder, draw.plan, name, seed)
    if design.simulator == "torque":
        from plumbline.experiments.reality.torques import simulate_torques

        return simulate_torques(folder, draw.plan, name, seed)
    case = draw_case(draw.plan, name, seed)
    alike = [basis for effect in case.effects for basis in effect.alike()]
    case = replace(case, confounded=confounded(case, alike))
    recording, facts = simulate(case)
    write(folder, recording)
    return facts
