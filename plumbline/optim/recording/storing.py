"""How robots, chains and recordings are stored: from what they were made of, never as objects.

A robot is its URDF, MJCF or DH rows, a chain its joints, a recording its robot and its arrays.
"""

from typing import Any

from plumbline.errors import PlumblineError
from plumbline.kinematics.chain import Chain, Joint
from plumbline.kinematics.dh import DHRow
from plumbline.kinematics.evaluate import Array
from plumbline.kinematics.oracle import pin
from plumbline.kinematics.robot import Robot
from plumbline.kinematics.tree import tree_of
from plumbline.optim.core.answer import parts_of, register, restored, restored_parts
from plumbline.optim.recording.recording import Recording, Session


def _of_robot(robot: Robot) -> dict[str, Any]:
    if robot.urdf is None and robot.dh is None and robot.mjcf is None:
        raise PlumblineError(
            f"{robot.name}: made of no file, URDF, MJCF or DH rows expected to store it; make it "
            "by Robot.from_urdf, from_mjcf or from_dh"
        )
    shared = {"name": robot.name, "gravity": robot.gravity, "tip_frame": robot.default_tip}
    if robot.mjcf is not None:
        return shared | {"mjcf": robot.mjcf}
    return shared | ({"urdf": robot.urdf} if robot.dh is None else {"dh": robot.dh})


def _to_robot(data: Any) -> Robot:
    gravity = restored(data["gravity"], Array)
    if "urdf" in data:
        return Robot.from_urdf(data["urdf"], name=data["name"], gravity=gravity)
    if "mjcf" in data:
        return Robot.from_mjcf(data["mjcf"], name=data["name"], gravity=gravity)
    rows = [vars(row) for row in restored(data["dh"], tuple[DHRow, ...])]
    return Robot.from_dh(rows, name=data["name"], tip_frame=data["tip_frame"], gravity=gravity)


def _to_chain(data: Any) -> Chain:
    joints = restored(data["joints"], tuple[Joint, ...])
    T, gravity = (restored(data[name], Array) for name in ("T_last_tip", "gravity"))
    model, last = pin.Model(), 0
    for joint in joints:
        turns = joint.kind == "revolute"
        kind = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
        placement = pin.SE3(joint.T_parent_joint)
        last = model.addJoint(last, kind(joint.axis), placement, joint.name)
        model.lowerPositionLimit[-1], model.upperPositionLimit[-1] = joint.lower, joint.upper
        inertia = pin.Inertia(joint.mass, joint.com, 0.0 * T[:3, :3])
        model.appendBodyToJoint(last, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame(data["tip_frame"], last, pin.SE3(T), pin.FrameType.OP_FRAME))
    model.gravity.linear = gravity
    return Chain(model, joints, T, data["tip_frame"], gravity)


def _to_recording(data: Any) -> Recording:
    given = restored_parts(data, Recording)
    robot, tip, joints = given["robot"], given["tip_frame"], given["q"].shape[1]
    torques = given["observation"] == "joint_torque"
    chain = tree_of(robot, joints, tip) if torques else robot.chain(tip)
    return Recording(**given, chain=chain)


register(Robot, _of_robot, _to_robot)
register(Chain, lambda chain: parts_of(chain, "model"), _to_chain)
register(
    Recording,
    lambda r: parts_of(r, "chain", *(() if r.several else ("session", "part"))),
    _to_recording,
)
# What was suspected in one recording alone was asked in a search, which is not stored.
register(
    Session,
    lambda session: parts_of(session, "suspects"),
    lambda data: Session(**restored_parts(data, Session)),
)
