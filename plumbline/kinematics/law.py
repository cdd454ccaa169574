"""What a command to a joint is, and what is known of the servo that obeys it."""

from enum import StrEnum


class Law(StrEnum):
    """What a command is, and what is known of the servo that obeys it."""

    POSITION = "position"
    SMOOTH = "smooth_position"  # the same, a log's rows of commands that run smoothly between them
    HELD = "held_position"  # the same, which a digital controller holds from sample to sample
    SERVO = "servo"  # position, by gains that are known
    HELD_SERVO = "held_servo"  # the same, its commands held from sample to sample
    VELOCITY = "velocity"
    RATE = "rate"  # velocity, which a digital controller holds from sample to sample
    TORQUE = "torque"  # which a digital controller holds from sample to sample
    SAMPLED_TORQUE = "sampled_torque"  # of a loop much faster than its log

    @property
    def holds(self) -> bool:
        """Whether a command stands until the next one."""
        return self in (Law.HELD, Law.HELD_SERVO, Law.RATE, Law.TORQUE)

    @property
    def ideal(self) -> bool:
        """Whether a command is a position, and nothing known of the servo."""
        return self in (Law.POSITION, Law.SMOOTH, Law.HELD)

    @property
    def follows(self) -> bool:
        """Whether a command is a position, so that where the joint began is forgotten."""
        return self.ideal or self.known

    @property
    def known(self) -> bool:
        """Whether a servo's gains are."""
        return self in (Law.SERVO, Law.HELD_SERVO)

    @property
    def pushes(self) -> bool:
        """Whether a command is a torque."""
        return self in (Law.TORQUE, Law.SAMPLED_TORQUE)
