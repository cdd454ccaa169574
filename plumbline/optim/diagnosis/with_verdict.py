"""What every diagnosis passes on of its verdict, whatever was recorded."""

from typing import TYPE_CHECKING, Any

from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement
from plumbline.optim.diagnosis.findings import Cause, Gap, Place, Verdict
from plumbline.optim.diagnosis.of_recordings import JointGap


class WithVerdict(Answer):
    """An answer with a verdict: its fields that are asked for most are the answer's as well."""

    if TYPE_CHECKING:  # a field of each

        @property
        def verdict(self) -> Verdict:
            """What was found."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.verdict.headline}>"

    @property
    def judged(self) -> Judgement:
        """Whether every fit behind the verdict converged, with the figures."""
        return self.verdict.judged

    @property
    def headline(self) -> str:
        """The recording, the kind of verdict, the first causes and the gap, on one line."""
        return self.verdict.headline

    @property
    def gap(self) -> Gap:
        """How large the gap is and how far it shrinks, on rows that were left out."""
        return self.verdict.gap

    @property
    def by_joint(self) -> tuple[JointGap, ...]:
        """The gap joint by joint, of motions and efforts."""
        return self.verdict.joints

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes, most important first."""
        return self.verdict.causes

    @property
    def candidates(self) -> tuple[Cause, ...]:
        """Everything considered, most probable first."""
        return self.verdict.candidates

    @property
    def where(self) -> tuple[Place, ...]:
        """Shares of the explained gap by stage and element, which sum to one."""
        return self.verdict.where

    @property
    def outside_probability(self) -> float:
        """Probability that something outside the library is at work."""
        return self.verdict.outside_probability

    @property
    def next(self) -> tuple[dict[str, Any], ...]:
        """What to record next."""
        return self.verdict.next

    @property
    def notes(self) -> tuple[str, ...]:
        """What else the reader should know."""
        return self.verdict.notes

    def card(self) -> str:
        """The verdict's card of HTML."""
        return self.verdict.card()

    def plot(self, name: str = "") -> Any:
        """The verdict's picture, the gap as the causes go in, or the one of a name."""
        return super().plot(name) if name else self.verdict.plot()

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units."""
        return self.verdict.to_dict()
