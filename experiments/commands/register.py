"""``plumbline register FOLDER``: where targets seen in CT are for the robot, and how surely."""

from __future__ import annotations

import difflib
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.commands import (
    CommandError,
    Json,
    Quiet,
    check_distinct,
    check_output,
    talks,
    write_json,
    write_text,
)

if TYPE_CHECKING:
    from optim.fiducials import Fiducials
    from optim.registration import Method, Registration


class Axes(StrEnum):
    """Which way CT's axes point: left, posterior, superior; or right, anterior, superior."""

    LPS = "LPS"
    RAS = "RAS"


Folder = Annotated[Path, typer.Argument(help="A recording: dataset.toml and samples.csv.")]
MethodName = Annotated[
    str,
    typer.Option(
        "--method",
        help="anisotropic, kabsch, three-point, best-triple, combined or robust.",
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


def register(
    folder: Folder,
    method: MethodName = "anisotropic",
    triple: TripleOf = None,
    json: Json = None,
    tfm: Tfm = None,
    ct_axes: CtAxes = Axes.LPS,
    quiet: Quiet = False,
) -> None:
    """Register markers of CT and robot; say where targets are and how far to trust it."""
    check_output(json, "--json", [folder])
    check_output(tfm, "--tfm", [folder])
    check_distinct({"--json": json, "--tfm": tfm})
    from experiments.report.registration import content, print_registration
    from optim.fiducials import load_fiducials

    fiducials = load_fiducials(folder)
    points = fiducials.markers
    answer = _method(fiducials, method, triple)(
        points.ct, points.robot, fiducials.noise, points.labels
    )
    others = _others(fiducials, answer)
    write_json(json, content(fiducials, answer, others))
    if tfm is not None:
        from experiments.slicer import tfm_text

        write_text(tfm, tfm_text(answer.T_RC, ct_axes.value), "--tfm")
    if talks(json, quiet):
        print_registration(fiducials, answer, others)


def _method(fiducials: Fiducials, name: str, triple: str | None) -> Method:
    """The method of a name, for the first target where that matters.

    Raises:
        CommandError: There is no such method, or no such markers.
    """
    from optim.registration import METHODS, ThreePoint

    if name not in METHODS:
        best = ", ".join(difflib.get_close_matches(name, METHODS, cutoff=0.3) or METHODS)
        raise CommandError(f"--method {name!r} not recognised. Best matches are {best}")
    if triple is not None:
        if name != "three-point":
            raise CommandError(f"--triple is for --method three-point, not {name}; leave it out")
        return ThreePoint(_indices(fiducials, triple))
    return _for_target(METHODS[name], fiducials)


def _for_target(method: Method, fiducials: Fiducials) -> Method:
    from optim.registration import BestTriple

    if isinstance(method, BestTriple) and len(fiducials.targets):
        x, y, z = fiducials.targets.ct[0]
        return BestTriple((float(x), float(y), float(z)))
    return method


def _indices(fiducials: Fiducials, triple: str) -> tuple[int, int, int]:
    labels = fiducials.markers.labels
    names = [name.strip() for name in triple.split(",")]
    unknown = [name for name in names if name not in labels]
    if unknown or len(names) != 3 or len(set(names)) != 3:
        raise CommandError(
            f"--triple {triple}: expected three different markers of {', '.join(labels)}, such as "
            f"{','.join(labels[:3])}"
        )
    a, b, c = (labels.index(name) for name in names)
    return a, b, c


def _others(fiducials: Fiducials, answer: Registration) -> list[Registration]:
    """What the other methods find on the same markers."""
    from optim.registration import METHODS

    points = fiducials.markers
    given = points.ct, points.robot, fiducials.noise, points.labels
    rest = [method for name, method in METHODS.items() if name != answer.method]
    found: list[Any] = [_for_target(method, fiducials)(*given) for method in rest]
    return found
