"""``plumbline register FILES``: where targets seen in CT are for the robot, and how surely."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_report
from plumbline.experiments.console.outputs import write_text

if TYPE_CHECKING:
    from plumbline.optim.registration import MarkerNoise, Method
    from plumbline.optim.registration.fiducials import Fiducials


# Which way CT's axes point: left, posterior, superior; or right, anterior, superior.
Axes = Literal["LPS", "RAS"]
Files = Annotated[
    list[Path],
    typer.Argument(
        help="A recording folder; or two lists of 3D Slicer (.mrk.json, .fcsv), CT's and the "
        "robot's; and transforms to judge by them (.tfm, .h5)."
    ),
]
MethodName = Annotated[
    str,
    typer.Option(
        "--method", help="anisotropic, kabsch, three-point, best-triple, combined or robust."
    ),
]
TripleOf = Annotated[
    str | None,
    typer.Option("--triple", metavar="A,B,C", help="Markers of the three-point frame, in order."),
]
Tfm = Annotated[
    Path | None, typer.Option(metavar="OUT.tfm", help="Write the transform for 3D Slicer or ITK.")
]
CtAxes = Annotated[Axes, typer.Option("--ct-axes", help="How CT's coordinates are given.")]
RobotAxes = Annotated[
    Axes | None,
    typer.Option("--robot-axes", help="How the robot's are given; as CT's unless said."),
]
Resolution = Annotated[
    str | None, typer.Option("--ct-resolution", metavar="X,Y,Z", help="CT's pitch in m.")
]
RobotStd = Annotated[
    str | None, typer.Option("--robot-std", metavar="S", help="The robot's std in m, one or three.")
]


@with_report
def register(
    out: Out,
    files: Files,
    method: MethodName = "robust",
    triple: TripleOf = None,
    tfm: Tfm = None,
    ct_axes: CtAxes = "LPS",
    robot_axes: RobotAxes = None,
    ct_resolution: Resolution = None,
    robot_std: RobotStd = None,
) -> None:
    """Register markers of CT and robot; say where targets are and how far to trust it."""
    out.check(files, tfm=tfm)
    from plumbline.experiments.report.registration.page import compared, elsewhere
    from plumbline.experiments.slicer.given import along, given
    from plumbline.optim.registration import RegistrationOptions
    from plumbline.optim.registration import register as registered

    ct, robot = ct_axes, robot_axes or ct_axes
    stated = _noise(ct_resolution, robot_std)
    fiducials, transforms = given(files, ct, robot)
    chosen = _method(fiducials, method, triple)
    answer = registered(fiducials, RegistrationOptions(chosen, stated))
    judged = [elsewhere(answer, other) for other in transforms]
    methods = compared(answer)
    more = {"methods": methods, "transforms": judged}
    if tfm is not None:
        from plumbline.experiments.slicer import tfm_text

        write_text(tfm, tfm_text(along(answer.T_RC, ct, robot)), "--tfm")
    out.hand_out(answer, {**answer.to_dict(), **more}, **more)


def _noise(ct_resolution: str | None, robot_std: str | None) -> MarkerNoise | None:
    from plumbline.optim.registration import MarkerNoise

    if ct_resolution is None:
        if robot_std is not None:
            raise PlumblineError("--robot-std needs --ct-resolution: CT's readings err, too")
        return None
    pitch = _lengths("--ct-resolution", ct_resolution)
    robot = 0.0 if robot_std is None else _lengths("--robot-std", robot_std)
    return MarkerNoise.from_resolution(pitch, robot)


def _lengths(option: str, text: str) -> list[float]:
    """One number for all axes, or three [m]."""
    from plumbline.optim.registration.constants import COARSEST

    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(v >= 0.0 for v in values):
        raise PlumblineError(
            f"{option} {text}: expected one length in m, or three: 0.005,0.001,0.001"
        )
    if max(values) > COARSEST:
        raise PlumblineError(
            f"{option} {text}: at most {COARSEST:g} m; looks like mm: divide by 1000"
        )
    return values if len(values) == 3 else values * 3


def _method(fiducials: Fiducials, name: str, triple: str | None) -> Method | str:
    from plumbline.optim.registration import ThreePoint

    if triple is None:
        return name
    if name != ThreePoint.name:
        raise PlumblineError(f"--triple is for --method three-point, not {name}; leave it out")
    return ThreePoint(_indices(fiducials, triple))


def _indices(fiducials: Fiducials, triple: str) -> tuple[int, int, int]:
    labels = fiducials.markers.labels
    names = [name.strip() for name in triple.split(",")]
    unknown = [name for name in names if name not in labels]
    if unknown or len(names) != 3 or len(set(names)) != 3:
        raise PlumblineError(
            f"--triple {triple}: expected three different markers of {', '.join(labels)}, such as "
            f"{','.join(labels[:3])}"
        )
    a, b, c = (labels.index(name) for name in names)
    return a, b, c
