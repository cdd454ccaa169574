"""What lies around a lesion, and which needles reach it: a section through CT, and all angles.

The section is the plane through the lesion and the CT's z axis at one azimuth; coal says for every
point of a grid how far it is from each solid, and the line at zero is drawn.
"""

import coal
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from plumbline.errors import PlumblineError
from plumbline.experiments.report.pointing.figures import COLOURS, around
from plumbline.experiments.report.style import GUILTY, MUTED, PAPER, calm, house_style, new_figure
from plumbline.optim.core.problem import Array
from plumbline.optim.pointing import AngleMap, Mesh, Solid, Status
from plumbline.optim.pointing.aim import directions
from plumbline.optim.pointing.body import Shape

MM = 1e3  # [mm/m]
# Apart from the colours of the statuses.
ORGANS = ("#0072b2", "#e69f00", "#7b5ea7", "#8c564b", "#17becf", "#4d4d4d")
FINE = 140  # points of the grid a side
POINT = 1e-3  # [mm]: radius of the ball that stands for a point


def anatomy(found: AngleMap, azimuth: float) -> Figure:
    """A section with needles at an azimuth [rad], and the map of angles by what blocks them."""
    if found.aim.scene is None:
        raise PlumblineError(
            "no scene in the aim: nothing to draw; give Aim(..., scene=Scene(...))"
        )
    solids = found.aim.scene.anatomy
    colours = {s.name: ORGANS[k % len(ORGANS)] for k, s in enumerate(solids)}
    with house_style():
        figure = new_figure(9.2, 4.8)
        left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="polar")
        _section(left, found, azimuth, colours)
        shown = _angles(right, found, colours)
        handles = [Patch(color=colour, label=name) for name, colour in colours.items()]
        handles += [Patch(color=COLOURS[s], label=s.value) for s in COLOURS if s in shown]
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
        return figure


def _section(axes: Axes, found: AngleMap, azimuth: float, colours: dict[str, str]) -> None:
    """Solids cut by the plane, the lesion, and the map's needles in it, from tip to lesion."""
    aim = found.aim
    reach = 1.05 * aim.needle.standoff
    across = np.linspace(-reach, reach, FINE)
    up = np.linspace(-0.5 * reach, reach, FINE)
    way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    points = aim.lesion + across[None, :, None] * way + up[:, None, None] * [0.0, 0.0, 1.0]
    place = (MM * across, MM * up)
    if aim.body is not None:
        axes.contour(*place, depths(aim.body, points), [0.0], colors=MUTED, linewidths=1.2)
    for solid in aim.scene.anatomy if aim.scene is not None else ():
        _cut(axes, place, solid, depths(solid.shape, points), colours[solid.name])
    for side, beta in ((1.0, azimuth), (-1.0, azimuth + np.pi)):
        turned = np.abs((found.beta - beta + np.pi) % (2 * np.pi) - np.pi)
        if turned.min() > 1e-6:
            continue
        j = int(turned.argmin())
        for i, status in enumerate(found.status[:, j]):
            u = directions(found.theta[i], np.array(beta)) * aim.needle.standoff
            tip = MM * np.array([side * np.hypot(u[0], u[1]), u[2]])
            safe = status == Status.SAFE
            axes.plot(
                [0.0, tip[0]], [0.0, tip[1]], color=_colour(found, i, j, colours),
                linewidth=2.0 if safe else 1.2, linestyle="-" if safe else "--", zorder=4,
            )  # fmt: skip
    axes.plot(0.0, 0.0, "D", color=GUILTY, markeredgecolor=PAPER, markersize=8, zorder=6)
    axes.set(
        aspect="equal",
        xlabel=f"from the lesion along β = {np.degrees(azimuth):.0f}° [mm]",
        ylabel="from the lesion along the CT's z [mm]",
        title="section through the lesion; needles from tip to lesion",
    )
    calm(axes, grid="both")


def _cut(axes: Axes, place: tuple[Array, Array], solid: Solid, away: Array, colour: str) -> None:
    """A solid's section, hatched if the needle may enter it."""
    if away.min() >= 0.0:
        return
    axes.contourf(*place, away, [-np.inf, 0.0], colors=[colour], alpha=0.25 if solid.enter else 0.6)
    axes.contour(*place, away, [0.0], colors=[colour], linewidths=1.4)


def depths(shape: Shape, points: Array) -> Array:
    """Distances (...) of points (..., 3) from a shape, below 0 inside [m]; by coal."""
    T = shape.placement
    body = coal.CollisionObject(shape.shape(), T[:3, :3], MM * T[:3, 3])
    ball = coal.CollisionObject(coal.Sphere(POINT), np.eye(3), np.zeros(3))
    flat, request = points.reshape(-1, 3), coal.DistanceRequest()
    found = np.empty(len(flat))
    for k, point in enumerate(MM * flat):
        ball.setTranslation(point)
        found[k] = coal.distance(body, ball, request, coal.DistanceResult()) / MM
    if isinstance(shape, Mesh):
        found = np.where(shape.contains(flat), -np.abs(found), found)
    return found.reshape(points.shape[:-1])


def _angles(axes: Axes, found: AngleMap, colours: dict[str, str]) -> set[Status]:
    """All angles over theta (outwards) and beta; blocked ones in the colour of what blocks them."""
    theta = np.degrees(found.theta)
    shown: set[Status] = set()
    inner = np.concatenate([[0.0], (theta[1:] + theta[:-1]) / 2])
    outer = np.append(inner[1:], theta[-1] + (theta[-1] - inner[-1]))
    width = float(np.diff(found.beta).min(initial=2 * np.pi))
    for i, j in np.ndindex(*found.status.shape):
        colour = _colour(found, i, j, colours)
        status = Status(str(found.status[i, j]))
        if colour == COLOURS[status]:
            shown.add(status)
        axes.bar(
            found.beta[j], outer[i] - inner[i], width=width, bottom=inner[i],
            color=colour, edgecolor=PAPER, linewidth=0.3,
        )  # fmt: skip
    around(axes)
    axes.set_title("all angles, by what stands in the way\n")
    return shown


def _colour(found: AngleMap, i: int, j: int, colours: dict[str, str]) -> str:
    """That of the solid in the way, if it is of the anatomy, else that of the status."""
    kinds: list[list[Status]] = found.status.tolist()
    of_status = COLOURS[kinds[i][j]]
    worst = found.worst.tolist()[i][j]
    return of_status if worst is None else colours.get(worst.second, of_status)
