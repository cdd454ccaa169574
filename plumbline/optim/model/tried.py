"""A model of either kind, an arm or a robot's drives, on another recording of what it is of."""

from plumbline.errors import fault
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.model.apply import Applied
from plumbline.optim.model.apply import apply as apply_arm
from plumbline.optim.model.driven import Driven
from plumbline.optim.model.fitted import Fitted
from plumbline.optim.recording.recording import Recording


def apply(
    model: Fitted | Driven, other: Recording | MotionRecording, *, force: bool = False
) -> Applied:
    """Try a model on another recording of the robot; with force on one set up otherwise, too.

    Raises:
        PlumblineError: It is of another robot, or measures something else, or another simple set-up
            explains its rows far better.
    """
    if isinstance(model, Driven):
        if isinstance(other, MotionRecording):
            return model.tried(other)
        like, mend = f"a motion as in {model.recording}", "give a motion of the same drives"
        raise fault(f"{other.name}, observation", other.observation, like, mend)
    if isinstance(other, MotionRecording):
        like, mend = f"{model.observation} as in {model.recording}", "give one of the same robot"
        raise fault(f"{other.name}, observation", other.observation, like, mend)
    return apply_arm(model, other, force=force)
