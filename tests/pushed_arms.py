"""Arms that torques move, each as URDF and as MuJoCo has it."""

import mujoco

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
