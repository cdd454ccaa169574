"""One look for all pictures: calm, safe for the colour-blind, at home on light and dark paper.

Pictures are drawn without pyplot, so that nothing is shared between them. Inks are placeholders
that become CSS colours of the page when a picture is put into it; data colours are those of Okabe
and Ito (2008), Color Universal Design.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from html import escape
from importlib import resources
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform
from numpy.typing import NDArray

INK, MUTED, FAINT, PAPER = "#22262b", "#6f757d", "#b9bec5", "#fdfdfc"
BEFORE, AFTER, GUILTY, FLOOR = "#9aa1aa", "#0072b2", "#d55e00", "#009e73"
CSS = {INK: "var(--ink)", MUTED: "var(--muted)", FAINT: "var(--faint)", PAPER: "var(--paper)"}
# Viridis without its ends, which would drown in dark and in light paper.
SIZES = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.16, 0.93, 256)), "sizes")
SHARES = LinearSegmentedColormap.from_list("shares", [FAINT, "#e69f00", GUILTY])
MOST_VECTORS = 600  # points beyond which a cloud becomes pixels
DPI = 192  # of those pixels
ROWS = "rows-"  # begins the id of a cloud whose points are rows
USE = re.compile(r"(<use\b[^>]*?)/>")
CLOUD = re.compile(rf'<g id="{ROWS}([\d-]+)">(.*?</g>)\s*</g>', re.DOTALL)
SAID = "said-"  # begins the id of a part that says something, in UTF-8 as hexadecimal digits
TITLED = re.compile(rf'<g id="{SAID}([\da-f]+)">')
SCREEN = 96  # [dpi]: pictures that a notebook carries stay small

HOUSE = resources.files("plumbline.experiments.report") / "house.mplstyle"


@cache
def _settings() -> mpl.RcParams:
    with resources.as_file(HOUSE) as path:
        return mpl.rc_params_from_file(path, use_default_template=False)


@contextmanager
def house_style() -> Iterator[None]:
    """The house's settings, for the time being."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_settings())
        yield


@contextmanager
def drawing(
    width: float, height: float, rows: int = 1, columns: int = 1, **how: Any
) -> Iterator[tuple[Figure, Any]]:
    """An empty figure of that size [in] and its axes, in the house's style for the time being."""
    with house_style():
        figure = new_figure(width, height)
        yield figure, figure.subplots(rows, columns, **how)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size [in], laid out by itself."""
    return Figure(figsize=(width, height), layout="constrained", dpi=DPI)


def on_paper(figure: Figure) -> Figure:
    """A picture for a notebook: on white paper, of a screen's resolution."""
    figure.set_facecolor("white")
    figure.set_dpi(SCREEN)
    return figure


def calm(axes: Axes, *, grid: str = "y") -> Axes:
    """Axes with a faint grid behind the data."""
    axes.set_axisbelow(True)
    if grid:
        axes.grid(axis="both" if grid == "both" else "y", color=FAINT, alpha=0.35, linewidth=0.6)
    return axes


def svg(figure: Figure, key: str, label: str) -> str:
    """The figure as an SVG element that can stand in an HTML page beside others.

    Args:
        figure: The figure.
        key: Prefix of the ids inside, so that those of two pictures never meet.
        label: What is to be seen, for those who cannot; escaped by the caller.
    """
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with house_style(), _laid_out(figure):
        figure.savefig(buffer, format="svg", metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = _own_ids(_with_words(_with_rows(text)), key)
    for colour, name in CSS.items():
        text = text.replace(colour, name)
    text = re.sub(r'^<svg ([^>]*?)width="[^"]*" height="[^"]*"', r"<svg \1", text, count=1)
    return text.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1).strip()


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Laid out for SVG for the time being: else a drawing that nobody sees does it."""
    engine, dpi = figure.get_layout_engine(), figure.dpi
    if engine is not None:
        FigureCanvasSVG(figure)
        figure.dpi = FigureCanvasSVG.fixed_dpi
        engine.execute(figure)
        figure.dpi = dpi
        figure.set_layout_engine(None)
    yield
    figure.set_layout_engine(engine)


def numbered(points: PathCollection, rows: NDArray[np.int64]) -> None:
    """Have a cloud of points say the number of a row when the pointer rests on one.

    No coordinate of the cloud may be nan; the numbers (N,) are in the order of its points.
    """
    points.set_gid(ROWS + "-".join(map(str, rows)))


def by_depth(axes: Any, places: NDArray[np.float64]) -> NDArray[np.int64]:
    """The order in which points (N, 3) of axes in space are drawn: the farthest first."""
    depth: NDArray[np.float64] = np.asarray(proj_transform(*places.T, axes.get_proj())[2])
    return np.argsort(depth)[::-1]


def says(artist: Artist, words: str) -> None:
    """Have a part of a picture say something when the pointer rests on it."""
    artist.set_gid(SAID + words.encode().hex())


def _with_words(text: str) -> str:
    """Parts with the title that their id holds."""
    return TITLED.sub(
        lambda found: f"<g><title>{escape(bytes.fromhex(found[1]).decode())}</title>", text
    )


def _with_rows(text: str) -> str:
    """Points with the title that their cloud's id holds."""

    def titled(match: re.Match[str]) -> str:
        numbers = match[1].split("-")
        if len(USE.findall(match[0])) != len(numbers):
            return match[0]
        said = iter(numbers)
        return USE.sub(lambda use: f"{use[1]}><title>row {next(said)}</title></use>", match[0])

    return CLOUD.sub(titled, text)


def _own_ids(text: str, key: str) -> str:
    """Ids with a prefix where something refers to them, and none elsewhere."""
    used = set(re.findall(r'(?:url\(#|href="#)([\w-]+)', text))

    def renamed(match: re.Match[str]) -> str:
        return f' id="{key}-{match[1]}"' if match[1] in used else ""

    text = re.sub(r' id="([^"]*)"', renamed, text)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{key}-", text)
