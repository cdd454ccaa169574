"""What every diagnosis passes on of its verdict, whatever was recorded."""

from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from plumbline.optim.core.answer import Answer
from plumbline.optim.core.judged import Judgement
from plumbline.optim.diagnosis.findings import Cause, Gap, Place, Verdict
from plumbline.optim.diagnosis.of_recordings import JointGap

T = TypeVar("T")


class Told(Generic[T]):
    """A field or property of the verdict that is the answer's as well, by its own name or this."""

    def __init__(self, name: str = "") -> None:
        self.name = name

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.name or name

    def __get__(self, answer: Any, owner: type) -> T:
        found: Any = self if answer is None else getattr(answer.verdict, self.name)
        return cast("T", found)


class WithVerdict(Answer):
    """An answer with a verdict: its fields that are asked for most are the answer's as well."""

    if TYPE_CHECKING:  # a field of each

        @property
        def verdict(self) -> Verdict:
            """What was found."""

    #: the recording, the kind of verdict, the first causes and the gap, on one line
    headline = Told[str]()
    gap = Told[Gap]()  #: how large the gap is and how far it shrinks, on rows that were left out
    by_joint = Told[tuple[JointGap, ...]]("joints")  #: the gap joint by joint, of motions, efforts
    causes = Told[tuple[Cause, ...]]()  #: the causes, most important first
    candidates = Told[tuple[Cause, ...]]()  #: everything considered, most probable first
    #: shares of the explained gap by stage and element, which sum to one
    where = Told[tuple[Place, ...]]()
    outside_probability = Told[float]()  #: that something outside the library is at work
    next = Told[tuple[dict[str, Any], ...]]()  #: what to record next
    notes = Told[tuple[str, ...]]()  #: what else the reader should know

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.verdict.headline}>"

    @property
    def judged(self) -> Judgement:
        """Whether every fit behind the verdict converged, with the figures."""
        return self.verdict.judged

    def card(self) -> str:
        """The verdict's card of HTML."""
        return self.verdict.card()

    def plot(self, name: str = "") -> Any:
        """The verdict's picture, the gap as the causes go in, or the one of a name."""
        return super().plot(name) if name else self.verdict.plot()

    def to_dict(self) -> dict[str, Any]:
        """The verdict's figures as plain data in SI units."""
        return self.verdict.to_dict()
