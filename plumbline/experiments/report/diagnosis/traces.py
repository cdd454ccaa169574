"""What a joint was expected to do, did, and is foretold to do over time; what is left below."""

from dataclasses import dataclass

from matplotlib.figure import Figure

from plumbline.experiments.report import style
from plumbline.experiments.report.diagnosis.subject import Array

WIDTH, HEIGHT = 6.4, 3.2  # [in]


@dataclass(frozen=True, eq=False)
class Traces:
    """Curves over time (N,), and what their axes are called.

    Attributes:
        time: When [s], in ascending order.
        nominal: What the ideal model has; NaN where that is of another scale.
        actual: What was measured.
        corrected: What the model with its causes has.
        before: Nominal less actual.
        after: Corrected less actual.
        what: Name of the upper axis, with its unit.
        left: Name of the lower axis, with its unit.
    """

    time: Array
    nominal: Array
    actual: Array
    corrected: Array
    before: Array
    after: Array
    what: str
    left: str


def over_time(traces: Traces) -> Figure:
    """The curves, residuals below."""
    t = traces.time
    with style.house_style():
        figure = style.new_figure(WIDTH, HEIGHT)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        for axes in (upper, lower):
            style.calm(axes)
        upper.plot(t, traces.nominal, color=style.FAINT, linewidth=2.2)
        upper.plot(t, traces.actual, color=style.INK, linewidth=1.4)
        upper.plot(t, traces.corrected, color=style.AFTER, linewidth=1.2, linestyle="--")
        upper.set_ylabel(traces.what)
        lower.plot(t, traces.before, color=style.BEFORE, linewidth=1.0)
        lower.plot(t, traces.after, color=style.AFTER, linewidth=1.0)
        lower.set_ylabel(traces.left)
        lower.set_xlabel("time [s]")
        return figure
