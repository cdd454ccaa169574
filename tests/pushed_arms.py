"""Arms that torques move, each as URDF and as MuJoCo has it."""

import mujoco
import numpy as np

JOINT = (
    '<joint name="j{k}" type="revolute"><origin xyz="{x} 0 0"/><parent link="l{k}"/>'
    '<child link="l{n}"/><axis xyz="{axis}"/><limit lower="-9" upper="9" effort="900" '
    'velocity="99"/></joint><link name="l{n}"><inertial><origin xyz="{c} {aside}"/>'
    '<mass value="{m}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'
    "</inertial></link>"
)
BODY = (
    '<body pos="{x} 0 0"><joint name="j{k}" axis="{axis}"/><inertial pos="{c} {aside}" '
    'mass="{m}" diaginertia="{i} {i} {i}"/>'
)


def pushed_arm(axes, lengths, masses, inertias, step, aside):
    """URDF and MuJoCo's model of links [m], [kg], [kg m^2] in a row; centres lie aside [m]."""
    begins = (0.0, *lengths)
    links = [
        {"k": k, "n": k + 1, "x": begins[k], "axis": axes[k], "m": masses[k],
         "c": lengths[k] / 2, "i": inertias[k], "aside": aside}
        for k in range(len(axes))
    ]  # fmt: skip
    urdf = '<robot name="r"><link name="l0"/>' + "".join(JOINT.format(**one) for one in links)
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(axes)))
    bodies = "".join(BODY.format(**one) for one in links) + "</body>" * len(axes)
    arm = (
        f'<mujoco><option timestep="{step}" integrator="RK4"/><worldbody>{bodies}</worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )
    return urdf + "</robot>", mujoco.MjModel.from_xml_string(arm)


def held_near(plan, data, nominal, way, gains):
    """Torques (n,) that hold an arm near a way of sines about a posture, as computed torque does.

    Args:
        plan: MuJoCo's data of the arm as it is believed to be.
        data: The same of the arm itself.
        nominal: The model of the former.
        way: Posture (n,), sizes, pulses and angles now of its sines (n, K).
        gains: Of place and of speed.
    """
    at, size, turn, angle = way
    off = at + (size * np.sin(angle)).sum(axis=1) - data.qpos
    slow = (size * turn * np.cos(angle)).sum(axis=1) - data.qvel
    plan.qpos[:], plan.qvel[:] = data.qpos, data.qvel
    ahead = (size * turn**2 * np.sin(angle)).sum(axis=1)
    plan.qacc[:] = gains[0] * off + gains[1] * slow - ahead
    mujoco.mj_inverse(nominal, plan)
    return plan.qfrc_inverse.copy()
