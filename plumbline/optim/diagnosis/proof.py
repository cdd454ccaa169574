r"""Whether an exported file alone does what it says: rows that no fit has seen, by its readers.

.. math:: \text{file} = E(\hat\theta_{-f}), \qquad r_n = y_n - y(\text{file}, row_n), \quad n \in f

The causes are fitted again without one fold of the rows (those kept back, where there are any) and
made into a file; the file alone, in Pinocchio or MuJoCo, says that fold. Where a device stands no
file says: its frame is matched to what the file says of the rows that were fitted.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import Effect
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array, Flags
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.constants import MOST_ROWS, MOST_SECONDS
from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
from plumbline.optim.diagnosis.motion.fit import fitted
from plumbline.optim.diagnosis.motion.signals import spread
from plumbline.optim.diagnosis.predict.folds import fold_of_rows
from plumbline.optim.diagnosis.with_verdict import WithVerdict
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.refit import always_fitted, figure, refit
from plumbline.optim.model import Model
from plumbline.optim.model.drives import drives_of
from plumbline.optim.model.export import exported
from plumbline.optim.model.export.exported import Exported
from plumbline.optim.model.fitted import HeldOutGap, chain_of
from plumbline.optim.model.making import FitEnd, model_of
from plumbline.optim.model.rows import columns_of
from plumbline.optim.recording.efforts import motion_of, payload_efforts
from plumbline.optim.recording.recording import Recording
from plumbline.optim.rigid import rigid_match

CORRECTED = "what links cannot hold the readings are told"


@dataclass(frozen=True)
class Proof:
    """What one file says of rows that no fit has seen."""

    file: str  # the format
    reader: str  # who read it
    rows: int  # how many rows were said
    unit: str  # of the figures
    before: float  # RMS of the nominal robot [unit]
    after: float  # RMS of the file [unit]
    lacks: str  # what the format cannot hold, in words


def proofs(found: WithVerdict) -> tuple[Proof, ...]:
    """The proofs of what a diagnosis can be exported as; none where it names no cause."""
    if not isinstance(found, Diagnosis | MotionDiagnosis) or not found.causes:
        return ()
    if isinstance(found, MotionDiagnosis):
        return tuple(_of_motion(found))
    r = found.recording
    if r.several or r.stand_in or not (r.kind.device or r.kind.efforts):
        return ()
    return tuple(_of_rows(found))


def _of_rows(found: Diagnosis) -> Iterator[Proof]:
    train, held = _parted(found)
    sizes = sum(len(e.parameters) for e in found.effects)
    values = found.solution.x[len(found.solution.x) - sizes :]
    always = always_fitted(train)
    nulls = np.array([p.null for e in always for p in e.parameters], dtype=float)
    model, bare = _fitted(train, found.effects, values), _fitted(train, always, nulls)
    per_row = held.kind.device
    seen = held.measured[:, :3] if per_row else held.measured
    before = figure(seen - _said(bare, held), per_row)
    for name, reader, file in _files(model):
        read = partial(_by_file, model, name, file)
        for corrected in (False, True)[: 1 + (per_row and name == "URDF")]:
            there = read(held, corrected)
            if per_row:
                there = _in_device(read(train, corrected), train, there)
            after, unit = figure(seen - there, per_row), "m" if per_row else "N m"
            told = f"{name}, readings corrected" if corrected else name
            lacks = CORRECTED if corrected else file.words
            yield Proof(told, reader, len(held), unit, before, after, lacks)


def _files(model: Model) -> Iterator[tuple[str, str, Exported]]:
    """The formats that can be read again here; one that cannot hold the robot proves nothing."""
    makers = [("URDF", "Pinocchio", model.as_urdf)]
    makers += [("MJCF", "MuJoCo", model.as_mjcf)] if exported.has_mujoco() else []
    for name, reader, make in makers:
        with suppress(PlumblineError):
            yield name, reader, make()


def _parted(found: Diagnosis) -> tuple[Recording, Recording]:
    """Rows to fit, thinned where there are many, and rows to be said."""
    r, trusted = found.recording, found.trusted
    if r.held_out is not None:
        kept = r.held_out
    else:
        kept = fold_of_rows(r, found.options.held_out, found.options.seed) == 0
    train = np.flatnonzero(~kept & trusted)
    chosen = np.linspace(0, len(train) - 1, min(len(train), MOST_ROWS)).astype(int)
    held = np.flatnonzero(kept & trusted)
    few = np.linspace(0, len(held) - 1, min(len(held), MOST_ROWS)).astype(int)
    fit, said = r.select(train[np.unique(chosen)]), r.select(held[np.unique(few)])
    return replace(fit, held_out=None), replace(said, held_out=None)


def _fitted(train: Recording, effects: Sequence[Effect], values: Array) -> Model:
    """The model of effects that are fitted to some rows; its errors are not asked for."""
    solution = refit(train, effects, values, free=effects)
    nuisance = nuisances_of(train)
    unit = np.eye(len(solution.x))
    fit = FitEnd(nuisance, effects, solution.x, solution.problem.scale, unit)
    return model_of(train, fit, HeldOutGap(np.nan, np.nan, np.nan, "m", np.nan))


def _said(model: Model, held: Recording) -> Array:
    """What a model itself says of rows."""
    if held.kind.efforts:
        carried = {} if held.payload is None else {"payload": held.payload}
        return model.tau(held.q, *motion_of(held), **carried)
    return model.in_device(held.q)


def _in_device(fitted_tips: Array, train: Recording, tips: Array) -> Array:
    """Tips (N, 3) in the frame that brings those of the rows that were fitted to what was read."""
    T = rigid_match(fitted_tips, train.measured[:, :3])
    return np.asarray(tips @ T[:3, :3].T + T[:3, 3])


def _by_file(model: Model, name: str, file: Exported, held: Recording, corrected: bool) -> Array:
    """What the file alone says of rows: efforts, or tips in the base frame.

    Args:
        model: What was written.
        name: The format.
        file: The file.
        held: The rows.
        corrected: Whether readings are corrected by the model before, for what links cannot hold.
    """
    if held.kind.efforts:
        carried = payload_efforts(held)  # which belongs to the rows, not to the robot
        if name == "MJCF":
            return carried + exported.torques_by_mujoco(file.text, held.q, *motion_of(held))
        robot = Robot.from_urdf(file.text, gravity=model.robot.gravity)
        chain = chain_of(robot, model.tip_frame, model.observation, model.ranges)
        return carried + exported.torques_by_pinocchio(chain, held.q, *motion_of(held))
    read = exported.frames_by_mujoco if name == "MJCF" else exported.frames_by_pinocchio
    q = held.q
    if corrected:
        context = {name: v for name, v in columns_of(held).items() if name != "q"}
        q = q + model.corrections_beyond_links(q, **context)
    return np.asarray(read(file.text, file.tip_frame, q)[:, :3, 3])


def _of_motion(found: MotionDiagnosis) -> Iterator[Proof]:
    """The drives' file, fitted without one fold of the windows, moved by the commands alone."""
    signals, r = found.signals, found.recording
    straight = r.law.follows and not r.law.holds  # as the replay has it
    if not exported.has_mujoco() or not straight or r.observation != "motion":
        return
    joints = []
    for joint in found.joints:
        windows = signals.windows(
            joint.number - 1, spread(signals.starts[signals.folds != 0], signals.most)
        )
        joints.append(replace(joint, fit=fitted(windows, joint.fit.effects, joint.fit.theta)))
    file = drives_of(signals, joints, found.gap).as_mjcf()
    counted = _counted(found)
    missed, ideal = [], []
    for run in _runs(found, counted):
        q = exported.replay(file.text, signals.time[run], signals.command[run], signals.q[run][0])
        mine = counted[run]
        missed.append((q - signals.q[run])[mine])
        ideal.append((signals.command[run] - signals.q[run])[mine])
    if missed:
        before, after = (figure(np.concatenate(parts), per_row=False) for parts in (ideal, missed))
        rows = sum(map(len, missed))
        yield Proof("MJCF", "MuJoCo", rows, found.gap.unit, before, after, file.words)


def _counted(found: MotionDiagnosis) -> Flags:
    """Samples (M,) of the windows that were left out, what settles aside."""
    signals = found.signals
    counted = np.zeros(len(signals.time), dtype=bool)
    for start in signals.starts[signals.folds == 0]:
        counted[start + signals.settle : start + signals.length] = True
    return counted


def _runs(found: MotionDiagnosis, counted: Flags) -> Iterator[slice]:
    """Runs with samples that count, each up to the last of these, as long as a proof may take."""
    signals, left = found.signals, MOST_SECONDS
    begins = np.unique(signals.first)
    for begin, end in zip(begins, [*begins[1:], len(signals.time)], strict=True):
        asked = begin + np.flatnonzero(counted[begin:end])
        if not len(asked) or left <= 0.0:
            continue
        last = min(int(asked[-1]) + 1, begin + int(left / signals.dt))
        left -= (last - begin) * signals.dt
        yield slice(begin, last)
