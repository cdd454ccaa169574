"""Simulated tip readings for the tests of the link fit; the simulator shares no code with it."""

from dataclasses import replace

import numpy as np

from plumbline.experiments.reality.tip_readings import Built, draw_errors, draw_session
from plumbline.kinematics.link_table import link_table
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import Readings
from plumbline.optim.dh_fit.losses import Squares
from plumbline.optim.dh_fit.statement import frame_unknowns, link_unknowns, state
from plumbline.optim.recording.building import build_recording

BH7 = Robot.bundled("bh7")


def session(seed=0, *, noise=2e-4, tilts=True, before=5e-3, readings=30):
    """An arm in front of a camera; without tilts its errors are those that DH rows can hold."""
    found = draw_session(seed, readings=readings, before=before, noise=noise, wander=(0.0, 0.0))
    if tilts:
        return found
    errors = draw_errors(np.random.default_rng(seed), 1e-3, np.deg2rad(0.3))
    errors[:, 4] = 0.0
    built, chance = Built.drawing().with_errors(errors), np.random.default_rng(seed + 1)
    flat = replace(found, built=built)
    return replace(
        flat,
        tips=flat.visit(flat.q, chance),
        registration_tips=flat.visit(flat.registration_q, chance),
    )


def recording(simulated, **changed):
    """The session as a recording."""
    given = {"q": simulated.q, "measured": simulated.tips, "always": ("frame",)} | changed
    return build_recording(observation="tip_position", robot=BH7, **given)


def four(simulated):
    """Its registration points."""
    return Readings(simulated.registration_q, simulated.registration_tips)


def stated(simulated, loss=None, *, frame="registration", hayati=False, delta=(0.01, 0.09)):
    """The problem in all parameters, and its readings."""
    table = link_table(BH7, BH7.chain())
    unknowns = link_unknowns(table, *delta, hayati=hayati)
    if frame == "joint":
        unknowns = [*frame_unknowns(), *unknowns]
    readings = Readings(simulated.q, simulated.tips)
    registration = four(simulated) if frame == "registration" else None
    statement = state(
        table,
        np.zeros(3),
        unknowns,
        loss or Squares(),
        readings=readings,
        registration=registration,
    )
    return statement, readings


def simulated_recording(robot, rows, rng, *, shift=1e-3, noise=1e-5, tool=(0.01, 0.02, 0.1)):
    """A recording of any robot whose links are wrong by a little, and its true placements."""
    chain = robot.chain()
    table = link_table(robot, chain)
    moved = table.values + rng.normal(0.0, shift, table.values.shape)
    tilted = np.array([row.parallel for row in table.rows])
    moved[:, 4] = np.where(tilted, moved[:, 4], table.values[:, 4])
    *placements, last = table.with_values(moved).placements()
    joints = [replace(j, T_parent_joint=T) for j, T in zip(chain.joints, placements, strict=True)]
    true = replace(chain, joints=tuple(joints), T_last_tip=last)
    lower = np.where(np.isfinite(chain.lower), np.maximum(chain.lower, -2.5), -2.5)
    upper = np.where(np.isfinite(chain.upper), np.minimum(chain.upper, 2.5), 2.5)
    q = rng.uniform(lower, upper, (rows, chain.n))
    T = true.placement(q)
    tips = T[:, :3, :3] @ np.array(tool) + T[:, :3, 3]
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    measured = tips @ R.T + [0.3, -1.0, 2.0] + rng.normal(0.0, noise, tips.shape)
    return build_recording(
        observation="tip_position", robot=robot, q=q, measured=measured, tool_offset=tool
    )
