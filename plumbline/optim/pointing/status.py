"""What becomes of an angle, in words."""

from enum import StrEnum


class Status(StrEnum):
    """Whether a needle can be held at an angle; if not, why."""

    SAFE = "safe"
    REACH = "out of reach"
    LIMIT = "joint limit"
    SINGULAR = "near a singularity"
    COLLISION = "collision"
    INSIDE = "tip inside the body"
    BLOCKED = "path blocked"
    JUMP = "joint jump"


MEANING = {
    Status.SAFE: "held within joint limits, away from singularities, clear of all around",
    Status.REACH: "no posture of the arm holds the needle there, whatever its joint limits",
    Status.LIMIT: "only postures beyond the joint limits hold the needle there",
    Status.SINGULAR: "the smallest singular value of the needle's task is below its limit",
    Status.COLLISION: "arm or needle come nearer to the body, the scene or each other than allowed",
    Status.BLOCKED: "the way from the tip to the lesion comes nearer to a solid than allowed",
    Status.INSIDE: "the stand-off is too short: the needle would not come from outside of the body",
    Status.JUMP: "the path there leaps to another posture of the arm",
}
