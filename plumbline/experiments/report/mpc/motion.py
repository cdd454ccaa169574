r"""A motion of instruments as moving pictures: two views, the clearance below, one GIF.

Shafts are drawn as wide as they are, in mm, from the tip to a little behind the trocar; a shadow of
each tip's way stays behind it. The lower panel runs along with the least clearance and the distance
d_s that is asked for.
"""

from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from plumbline.experiments.mpc.closed_loop import SUBSTEPS, Run
from plumbline.experiments.reality.task import Scenario
from plumbline.experiments.report.style import FAINT, FLOOR, INK, MUTED, house_style
from plumbline.optim.core.problem import Array

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
OUTSIDE = 25.0  # [mm] of a shaft that is shown behind its trocar
VIEWS = ((0, 2, "from the side"), (0, 1, "from above"))
DT = 0.02  # [s] of a control step
PAPER = "white"
MARGINS = {"left": 0.1, "right": 0.98, "top": 0.9, "bottom": 0.11, "hspace": 0.3, "wspace": 0.28}
KEY = "× goal    ○ trocar    grey: obstacles"
HOLD = 5  # frames that the last picture stays


def outline(ends: Array, radius: float) -> Polygon | Circle:
    """A capsule (2, 2) [mm] seen along the third axis."""
    way = ends[1] - ends[0]
    length = float(np.linalg.norm(way))
    if length < 1e-6:
        return Circle((float(ends[0, 0]), float(ends[0, 1])), radius)
    angle = np.arctan2(way[1], way[0])
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 12)
    half = np.concatenate([turn, turn + np.pi])
    middle = np.repeat(ends, 12, axis=0)
    round_ = radius * np.column_stack([np.cos(angle + half), np.sin(angle + half)])
    return Polygon(middle + round_)


def clearances(scenario: Scenario, found: Run) -> Array:
    """Least clearance (K S + 1,) [mm] along a run."""
    touch = scenario.touch()
    times = DT / SUBSTEPS * np.arange(len(found.tips))
    both = zip(found.tips, times, strict=True)
    return np.array([touch.clearances(scenario.capsules(tips, t)).min() for tips, t in both])


class Film:
    """The frames of one run."""

    def __init__(self, scenario: Scenario, found: Run, safe: float) -> None:
        self.scenario, self.found = scenario, found
        self.gaps = clearances(scenario, found)
        with house_style():
            self.figure = Figure(figsize=(7.2, 5.6), dpi=80, facecolor=PAPER)
            FigureCanvasAgg(self.figure)
            grid = self.figure.add_gridspec(2, 2, height_ratios=(3.6, 1.0), **MARGINS)
            self.views = [self.figure.add_subplot(grid[0, k]) for k in range(2)]
            self.plot = self.figure.add_subplot(grid[1, :])
            self.line = self._graph(safe)
        self.title = self.figure.suptitle("", color=INK, fontsize=10, x=0.02, ha="left")
        self.figure.text(0.98, 0.955, KEY, color=MUTED, fontsize=8, ha="right")

    def _graph(self, safe: float) -> tuple[Line2D, Line2D]:
        times = DT / SUBSTEPS * np.arange(len(self.gaps))
        self.plot.axhline(safe, color=FLOOR, lw=1.2)
        self.plot.annotate("$d_s$", (times[-1], safe), color=FLOOR, va="bottom", ha="right")
        self.plot.plot(times, self.gaps, color=FAINT, lw=1.0)
        self.plot.set(
            ylim=(0.0, max(6 * safe, float(np.percentile(self.gaps, 90)))),
            xlim=(0.0, times[-1]),
            xlabel="time [s]",
        )
        self.plot.set_ylabel("clearance [mm]", fontsize=8)
        (line,) = self.plot.plot([], [], color=INK, lw=1.6)
        (dot,) = self.plot.plot([], [], "o", color=INK, ms=4)
        return line, dot

    def frame(self, k: int) -> list[Line2D]:
        """Draw the state at sample k."""
        time = k * DT / SUBSTEPS
        for axes, (a, b, seen) in zip(self.views, VIEWS, strict=True):
            self._view(axes, a, b, k, time)
            axes.set_title(seen)
        line, dot = self.line
        times = DT / SUBSTEPS * np.arange(k + 1)
        line.set_data(times, self.gaps[: k + 1])
        dot.set_data([time], [self.gaps[k]])
        words = f"{self.scenario.family}: {time:.2f} s, clearance {self.gaps[k]:.2f} mm"
        self.title.set_text(words)
        return list(self.line)

    def _view(self, axes: Axes, a: int, b: int, k: int, time: float) -> None:
        axes.clear()
        kit, tips = self.scenario.instruments, self.found.tips[k]
        for swing in self.scenario.obstacles:
            ends = swing.at(time)[0][:, [a, b]]
            body = PatchCollection([outline(ends, swing.radius)], facecolor=MUTED, alpha=0.6)
            axes.add_collection(body)
        for i, tip in enumerate(tips):
            colour = COLOURS[i % len(COLOURS)]
            way = kit.trocars[i] - tip
            back = kit.trocars[i] + OUTSIDE * way / np.linalg.norm(way)
            shaft = outline(np.stack([tip, back])[:, [a, b]], float(kit.radii[i]))
            axes.add_collection(PatchCollection([shaft], facecolor=colour, alpha=0.85))
            trail = self.found.tips[: k + 1 : SUBSTEPS, i]
            axes.plot(trail[:, a], trail[:, b], color=colour, lw=1.0, alpha=0.5)
            axes.plot(*self.scenario.goals[i, [a, b]], "x", color=colour, ms=7, mew=1.6)
            axes.plot(*kit.trocars[i, [a, b]], "o", mfc=PAPER, mec=colour, ms=4)
        axes.set(aspect="equal", xlim=(-85, 85))
        axes.set_ylim(*((-150, 35) if b == 2 else (-92, 92)))
        axes.set(xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")


def film(scenario: Scenario, found: Run, path: Path, safe: float, every: int = SUBSTEPS) -> int:
    """Write a run as a GIF, a frame every so many samples; returns the number of frames."""
    made = Film(scenario, found, safe)
    samples = [*range(0, len(found.tips), every), *([len(found.tips) - 1] * HOLD)]
    with house_style():
        moving = FuncAnimation(made.figure, made.frame, frames=samples)
        # A frame without paper would leave the one before it standing.
        moving.save(path, writer=PillowWriter(fps=20), savefig_kwargs={"facecolor": PAPER})
    return len(samples)
