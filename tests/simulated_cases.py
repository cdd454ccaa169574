"""Recordings of a simulated arm with chosen faults; the simulator shares no code with models."""

import json
from dataclasses import replace

from plumbline.experiments.reality import Plan, draw_case, simulate, write
from plumbline.experiments.reality.gap import scaled
from plumbline.optim.recording.loading import load_recording


def faultless(rows=60, seed=1, arm="ur5", **plan):
    """A case in which nothing is wrong; the arm stands still and uses its whole range."""
    given = {"surgical": 0.0, "moving": 0.0, "arms": (arm,), "kind": "none", **plan}
    return draw_case(Plan(rows=(rows, rows), **given), f"room-{seed}", seed)


def drawn_scene(arm="ur5", rows=40, seed=5, observation="tip_position"):
    """A scene in which nothing is wrong; the arm moves, so that every mechanism can show."""
    plan = Plan(
        "none", rows=(rows, rows), arms=(arm,), moving=1.0, forced=1.0, observation=observation
    )
    return draw_case(plan, "scene", seed).scene


def with_fault(case, *faults, gap=4.0):
    """The case with faults, each so strong that its unabsorbed gap is so many sigma."""
    found = []
    for fault in faults:
        sized = scaled(case.scene, fault, gap * case.noise_std, case.observation, case.sockets)
        assert sized is not None, f"{fault}: no strength gives this gap; take another seed"
        found.append(sized)
    gaps = tuple(gap for _ in found)
    return replace(case, kind="single", effects=tuple(found), gap_to_noise=gaps)


def recorded(case, folder):
    """The case's recording as a user would load it, and the truth about it."""
    tables, facts = simulate(case)
    write(folder / case.name, tables)
    return load_recording(folder / case.name), facts


def made_elsewhere(cases, truth, count, *, seed=1, **plan):
    """Recordings and truths as somebody without a ledger would hand them in; their names."""
    names = [f"case-{number:04d}" for number in range(1, count + 1)]
    truth.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(names, start=1):
        tables, facts = simulate(draw_case(Plan(**plan), name, seed * 1_000_003 + number))
        write(cases / name, tables)
        (truth / f"{name}.json").write_text(json.dumps(facts))
    return names


def causes(diagnosis):
    """Names and elements of a verdict's causes, in order."""
    return [(c.effect, c.element) for c in diagnosis.verdict.causes]


def contents(folder):
    """Bytes of every file under a folder, by its path."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}
