r"""What a robot does when its drives push: bodies and drives, a part of a row after the other.

Each joint has the inertia :math:`J_j = 1 / W_{jj}`, :math:`W = M^{-1}`, with the others free, and
is loaded by what those push it by,

.. math:: p_j = - J_j \Bigl(\sum_{i \ne j} W_{ji} \tau_i - (W h)_j\Bigr),

where :math:`\tau` is what drives give, friction taken off, which goes by their loads in turn: one
joint after the other, again and again (Gauss and Seidel; MuJoCo's constraints are found so, too).
Bodies are those of the middle of a part (the implicit midpoint rule; Hairer, Lubich, Wanner 2006,
Geometric Numerical Integration, sec. II.1).
"""

import math
from typing import Any

import casadi as cs
import numpy as np

from plumbline.kinematics.drive import Memory
from plumbline.kinematics.law import Law
from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion.bodies import free, with_rotors
from plumbline.optim.diagnosis.motion.carried import model_of
from plumbline.optim.diagnosis.motion.constants import IN_TURN, MIDDLES, PART
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.rollout import PLAIN, drive_of, per_unit
from plumbline.optim.diagnosis.motion.windows import Array, Drives


def forward(r: MotionRecording, drives: Drives, start: Array) -> Array:
    """Positions (N, n) [rad or m] of what the recording's commands make of a robot at rest.

    Args:
        r: The commands and the robot; its positions are not looked at.
        drives: What each joint's drive has.
        start: Where the joints are at first (n,) [rad or m].
    """
    n, parts = r.n, math.ceil(float(np.median(np.diff(r.time))) / PART * (1 - 1e-9))
    dt = np.repeat(np.diff(r.time) / parts, parts)
    command, coupled, bodies = _asked(r, drives, parts), _coupled(r.law, drives), _Bodies(r)
    bare = free(bodies.at(0 * start, 0 * start)[0][None])[0]
    fixed = np.concatenate([r.kp, r.kd, bare, *(theta for _, theta in drives)])
    memory = np.zeros((n, PLAIN))
    memory[:, [0, 4]], memory[:, [1, 3]] = command[0][:, None], start[:, None]
    torque, found = np.zeros(n), [start]
    handle: Any = coupled.buffer()  # addresses alone
    buffer, run = handle
    after, own = np.empty((PLAIN, n)), np.ascontiguousarray(memory.T)
    gives, data = np.empty(n), np.empty((2 + n, n))
    for k, given in enumerate((own, data, torque, fixed, step := np.empty(1))):
        buffer.set_arg(k, given.data)
    buffer.set_res(0, after.data)
    buffer.set_res(1, gives.data)
    for k, h in enumerate(dt):
        step[0], data[0] = h, command[k + 1]
        after[:] = own
        after[1] += h * own[2]
        for _ in range(MIDDLES):
            masses, push = bodies.at((own[1] + after[1]) / 2, (own[2] + after[2]) / 2)
            data[1] = np.linalg.solve(masses, push)
            data[2:] = np.linalg.inv(masses)
            run()
            torque[:] = gives
        own[:] = after
        if k % parts == parts - 1:
            found.append(own[3].copy())
    return np.array(found)


def _asked(r: MotionRecording, drives: Drives, parts: int) -> Array:
    """Commands (K + 1, n) that reach the drives at first and over each part of a row.

    What is held counts by its mean over the part, what runs straight by its end.
    """
    t, n = r.time, r.n
    shares = np.arange(1, parts + 1) / parts
    ends = np.append(t[0], (t[:-1, None] + np.diff(t)[:, None] * shares).ravel())
    out = np.empty((len(ends), n))
    for j, (effects, theta) in enumerate(drives):
        late, u = ends - float(per_unit(effects, "shift") @ theta), r.command[:, j]
        if r.law.holds:
            held = np.append(0.0, np.cumsum(u[:-1] * np.diff(t)))
            past = np.interp(late, t, held) + u[0] * np.minimum(late - t[0], 0.0)
            past += u[-1] * np.maximum(late - t[-1], 0.0)
            out[1:, j] = np.diff(past) / np.diff(ends)
            out[0, j] = u[0]
        else:
            out[:, j] = np.interp(late, t, u)
    return out


class _Bodies:
    """Masses and what gravity and Coriolis ask for, at one state after the other."""

    def __init__(self, r: MotionRecording) -> None:
        self.model = model_of(r)
        self.data, self.index = self.model.createData(), list(r.index)
        self.neutral, self.still = pin.neutral(self.model), np.zeros(self.model.nv)

    def at(self, place: Array, speed: Array) -> tuple[Array, Array]:
        """Masses (n, n) [kg m^2] and torques (n,) [N m]; other joints stand at zero."""
        moved, v = np.zeros((2, self.model.nv))
        moved[self.index], v[self.index] = place, speed
        q = pin.integrate(self.model, self.neutral, moved)
        masses = pin.crba(self.model, self.data, q)[np.ix_(self.index, self.index)]
        return with_rotors(masses), pin.rnea(self.model, self.data, q, v, self.still)[self.index]


def _coupled(law: Law, drives: Drives) -> cs.Function:
    """``memory, (u, W h, W), torques, fixed, dt -> next, torques`` of all joints together."""
    n = len(drives)
    memory, data = cs.SX.sym("memory", n, PLAIN), cs.SX.sym("data", n, 2 + n)
    torque, dt = cs.SX.sym("torque", n), cs.SX.sym("dt")
    fixed = cs.SX.sym("fixed", 3 * n + sum(len(theta) for _, theta in drives))
    kp, kd, bare = (fixed[k * n : (k + 1) * n] for k in range(3))
    gives, W, after, first = cs.vertsplit(torque), data[:, 2:], [Memory(*[cs.SX(0)] * 4)] * n, 3 * n
    thetas = []
    for _, theta in drives:
        thetas.append(fixed[first : first + len(theta)])
        first += len(theta)
    for _ in range(IN_TURN):
        for j, (effects, _) in enumerate(drives):
            others = sum((W[j, i] * gives[i] for i in range(n) if i != j), cs.SX(0))
            J = 1 / W[j, j]
            load = J * (data[j, 1] - others)
            rest = cs.vertcat(load, J, dt, kp[j], kd[j], bare[j])
            before = Memory(*cs.horzsplit(memory[j, :]))
            after[j] = drive_of(law, effects, thetas[j], data[j, 0], rest).step(before)
            gives[j] = J * (after[j].speed - before.speed) / dt + load
    kept = [cs.horzcat(m.asked, m.place, m.speed, m.output, m.sent) for m in after]
    outputs = cs.cse([cs.densify(cs.vertcat(*kept)), cs.vertcat(*gives)])
    return cs.Function("coupled", [memory, data, torque, fixed, dt], outputs)
