"""Efforts of an arm whose instrument runs through a trocar, by Pinocchio's forces on bodies."""

import numpy as np
import pinocchio as pin

TROCAR, SIDE = np.array([0.3, -0.1, 0.6]), np.array([2.0, -1.0, 0.5])
SHAFT = np.array([0.06, -0.03, 0.3])


def through_a_trocar(chain, motion, shaft, friction, side):
    """Torques (N, n) that move the arm against friction [N] along its shaft and a push (3,) [N]."""
    model, tip = chain.model, chain.T_last_tip
    data, found = model.createData(), []
    along, last = tip[:3, :3] @ shaft / np.linalg.norm(shaft), model.njoints - 1
    for q, v, a in zip(*motion, strict=True):
        place = chain.configuration(q)
        pin.forwardKinematics(model, data, place, v)
        body, twist = data.oMi[last], data.v[last]
        speed = along @ (twist.linear + np.cross(twist.angular, tip[:3, 3]))
        slides = speed / np.hypot(speed, 1e-3)  # a millimetre a second is a standstill
        rubs = pin.SE3(np.eye(3), tip[:3, 3]).act(
            pin.Force(-friction * slides * along, np.zeros(3))
        )
        pushed = pin.SE3(np.eye(3), TROCAR).act(pin.Force(-side, np.zeros(3)))
        forces = [pin.Force.Zero()] * last + [rubs + body.actInv(pushed)]
        found.append(pin.rnea(model, data, place, v, a, forces))
    return np.array(found)
