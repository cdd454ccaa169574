"""The scene of a verdict in a notebook: a page of its own in a frame, nothing fetched."""

import html
from dataclasses import dataclass

from plumbline.errors import PlumblineError
from plumbline.experiments.report.diagnosis.scene import scene
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.page.page import environment
from plumbline.optim.diagnosis.answer import Diagnosis


@dataclass(frozen=True)
class Turned:
    """A scene that a reader can turn by dragging."""

    name: str  # of the recording
    page: str  # the whole of it, one HTML file

    def __repr__(self) -> str:
        return f"<scene of {self.name[:60]}: shown in a notebook>"

    def _repr_html_(self) -> str:
        """The page in a frame that may run its own script and reach nothing else."""
        given = html.escape(self.page, quote=True)
        style = "width:100%;height:36rem;border:0"
        return f'<iframe sandbox="allow-scripts" srcdoc="{given}" style="{style}"></iframe>'


def turned(answer: Diagnosis) -> Turned:
    """The arm, its tips, what is left of each row and the parts that account for it, in 3-D.

    Args:
        answer: Of tips or poses.

    Raises:
        PlumblineError: What was observed has no places.
    """
    subject = Subject.of(answer)
    data = scene(subject)
    if not data:
        kind = subject.recording.observation
        raise PlumblineError(f"scene: {kind} observed, tips or poses expected; take answer.plot()")
    page = environment().get_template("page/scene.html.j2")
    return Turned(subject.recording.name, page.render(data=data))
