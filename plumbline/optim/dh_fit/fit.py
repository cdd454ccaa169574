r"""Fit the link parameters of a robot to tip readings, and say what the readings can tell.

State, solve, report: :mod:`plumbline.optim.dh_fit.statement` states eqs. 8-9 of Chen et al., a
solver of :mod:`plumbline.optim.dh_fit.solvers` solves it, and :mod:`plumbline.optim.dh_fit.answer`
judges the solution. Set-ups that no links explain (:mod:`plumbline.optim.recording.set_up`) are
refused.
"""

from dataclasses import replace

import numpy as np

from plumbline.errors import PlumblineError, one_line
from plumbline.optim.core.judged import Solution
from plumbline.optim.dh_fit.answer import DHFit
from plumbline.optim.dh_fit.constants import COARSE, RESTING, UNBOUNDED
from plumbline.optim.dh_fit.identify import Identifiability, identify
from plumbline.optim.dh_fit.losses import Loss
from plumbline.optim.dh_fit.registration import spread_rows
from plumbline.optim.dh_fit.solvers import SOLVERS, of_links
from plumbline.optim.dh_fit.statement import Pass, Readings
from plumbline.optim.dh_fit.task import DHOptions, LinkTask, readings_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible, wrong_set_up


def fit_dh(
    recording: Recording,
    options: DHOptions | None = None,
    *,
    registration: Readings | None = None,
) -> DHFit:
    """Fit the link parameters to a recording of tip positions; rows ``held_out`` are left out.

    Args:
        recording: Tip positions in the camera's frame.
        options: What is to be fitted, and how.
        registration: Four readings that fix the frame, for ``frame="registration"``; if not given,
            four far-apart rows of the recording, which stay among those that are fitted.

    Raises:
        PlumblineError: No tip positions, fewer than there are unknowns, ones that no links explain
            (a wrong set-up), a chain that is no rows of links, or points that fix no frame.
    """
    options = options or DHOptions()
    if (read := getattr(recording, "observation", type(recording).__name__)) != "tip_position":
        raise PlumblineError(
            f"{recording.name}: observation {read!r}, expected 'tip_position'; "
            "run: plumbline diagnose FOLDER"
        )
    readings = readings_of(recording)
    if options.frame == "joint":
        registration = None
    elif registration is None:
        registration = readings.select(list(spread_rows(readings.tips)))
    task = LinkTask.of(recording, options, registration)
    if wrong := wrong_set_up(recording.training):
        raise PlumblineError(one_line(f"{recording.name}: {wrong.words}; mend it"))
    nominal = task.solved(task.always, SOLVERS[0])
    known, found = _identified(task, recording.name)
    statement = of_links(found.problem).statement
    ended = (found.x, found.iterations, found.message, nominal.x)
    fit = DHFit(recording, options, registration, known, statement.unknowns, *ended)
    # What a stored fit states again is at hand.
    at_hand = {"task": task, "statement": statement}
    vars(fit).update(at_hand, nominal_statement=of_links(nominal.problem).statement)
    _refuse_nonsense(fit)
    return fit


def _refuse_nonsense(fit: DHFit) -> None:
    """A misfit that no robot that is this one has is of another robot, or of another recording."""
    recording, sizes = fit.recording, np.linalg.norm(fit.misfits(), axis=1)
    missed = float(np.median(sizes))
    limit = max(plausible(recording), COARSE * (recording.noise_std or 0.0))
    if not missed <= limit:
        raise PlumblineError(
            f"{recording.name}: fitted links still miss the tips by {1e3 * missed:.3g} mm (median),"
            f" at most {1e3 * limit:.3g} mm is plausible for a reach of "
            f"{recording.reach:.2g} m; joint order, signs or zeros, units, robot or tip "
            "frame wrong? Mend them, or state noise_std"
        )


def _identified(task: LinkTask, name: str) -> tuple[Identifiability, Solution]:
    """What the poses tell, and the solution in what is free in the end."""
    reference = None if task.registration is None else task.registration.q
    known = identify(task.table, task.tool, task.asked, task.readings.q, reference)
    if 3 * len(task.readings) <= known.rank:
        raise PlumblineError(
            f"{name}: {len(task.readings)} readings for {known.rank} parameters that can be "
            f"told, more than {known.rank // 3} needed; record more poses or hold out fewer"
        )
    plain, every = SOLVERS[0], task.options.parameters == "all"
    first = task.solved(known.free, plain)
    weighed = known.weighed(_noise(_unbounded(first), task.options.loss))
    if not every and weighed.kept == known.kept and task.options.solver == plain:
        return weighed, first
    return weighed, task.solved(task.asked if every else weighed.free, task.options.solver)


def _unbounded(first: Solution) -> Solution:
    """The same without bounds, if any of them binds: tight bounds are no noise."""
    stated, readings = of_links(first.problem).statement, of_links(first.problem).readings
    if (np.abs(first.x - stated.nominal) < stated.delta * (1.0 - RESTING)).all():
        return first
    wide = tuple(replace(u, delta=UNBOUNDED * u.delta) for u in stated.unknowns)
    free = replace(stated, unknowns=wide).problem(readings)
    return SOLVERS[0].solve(free, first.x)


def _noise(found: Solution, loss: Loss) -> float:
    """Noise of one axis, 1 sigma [m]."""
    problem = of_links(found.problem)
    e = Pass(problem.statement, problem.readings).misfits(found.x)
    freedom = max(e.size - problem.size, 1)
    return float(np.sqrt(loss.variance(e) * e.size / freedom))
