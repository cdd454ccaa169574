"""A command a method of the field: register, handeye, scan, budget, reproduce, codegen.

Where targets seen in CT are for the robot, and how surely; where a range finder's beam sits on the
flange; a block's face angles, and a scan laid on the surface of CT; what each link of a chain
contributes to the error at a point; a published method's figures beside ours; a step of the capsule
controller in C.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out, with_out, with_report
from plumbline.experiments.console.outputs import check_new, write_text
from plumbline.experiments.console.progress_bar import progress_bar

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
Spec = Annotated[Path, typer.Argument(metavar="SPEC.toml", help=r"The links, by \[\[link]].")]
BUILD = "cc -O3 -o main main.c capsule_step.c program.c banded_qp.c -lm"
DEPTH, ASIDE = 0.12, 0.02  # [m] of the example's tips behind their trocars, and to the side


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
    from plumbline.experiments.slicer.given import given
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
        from plumbline.experiments.slicer.tfm import along, tfm_text

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


@with_report
def handeye(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="A recording of kind plane_range.")],
    poses: Annotated[
        int, typer.Option("--next", min=0, max=50, help="How many next poses to suggest.")
    ] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the next poses' candidates.")] = 0,
) -> None:
    """Calibrate a range finder on an arm from readings on planes."""
    out.check([folder])
    from plumbline.optim.hand_eye.answer import hand_eye
    from plumbline.optim.hand_eye.calibrate import HandEyeOptions

    found = hand_eye(folder, HandEyeOptions(poses=poses, seed=seed))
    out.hand_out(found, found.to_dict())


@with_report
def scan(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="A recording of kind surface_scan.")],
    beam: Annotated[
        Path | None,
        typer.Option(metavar="HANDEYE.json", help="The beam, as handeye --json wrote it."),
    ] = None,
) -> None:
    """Rebuild a scan; say the angles of its faces, or where CT lies for the robot."""
    out.check([folder])
    from plumbline.optim.hand_eye.scan import ScanOptions
    from plumbline.optim.hand_eye.scan import scan as rebuild
    from plumbline.optim.hand_eye.scan_recording import beam_from_json, load_scan

    recording = load_scan(folder)
    given = ScanOptions() if beam is None else ScanOptions(*beam_from_json(beam))
    answer = rebuild(recording, given)
    out.hand_out(answer, answer.to_dict())


@with_report
def budget(out: Out, spec: Spec) -> None:
    """Say what each link of a chain contributes to the error, and what to mend first."""
    out.check((), {"SPEC": spec})
    from plumbline.optim.budget import read_budget

    found = read_budget(spec)
    out.write_page(found)
    out.say(found.to_dict(), f"{found.table()}\n{found.headline}.\n{found.next_step()}")


@with_report
def reproduce(
    out: Out,
    paper: Annotated[str, typer.Argument(help="registration, hand-eye, dh-fit or mpc.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
) -> None:
    """Reproduce a published method: the paper's figures beside ours."""
    out.check()
    from plumbline.experiments.reproduce import PAPERS
    from plumbline.experiments.reproduce import reproduce as run

    if paper not in PAPERS:
        raise PlumblineError(f"no paper {paper!r}; there are {', '.join(PAPERS) or 'none yet'}")
    with progress_bar(quiet=out.quiet) as progress:
        found = run(paper, seed, progress)
    out.hand_out(found, found.to_dict())


@with_out
def codegen(
    out: Out,
    folder: Annotated[Path, typer.Argument(help="Where the sources go; made if need be.")],
    trocar: Annotated[list[str], typer.Option(help="x,y,z of a trocar [m]; once for each.")],
    horizon: Annotated[int, typer.Option(min=1, help="Steps of the horizon.")] = 10,
    capsules: Annotated[int, typer.Option(min=0, help="Capsules among the obstacles.")] = 0,
    balls: Annotated[int, typer.Option(min=0, help="Spheres among the obstacles.")] = 0,
) -> None:
    """Write a controller's step for instruments through trocars in C, with a program to try it."""
    out.check()
    if folder.exists() and not folder.is_dir():
        raise PlumblineError(f"{folder}: a file; name a folder")
    from plumbline.optim.capsule_mpc import Settings, Statement, TipInstrument
    from plumbline.optim.capsule_mpc.codegen import FILES, Example, write

    for name in FILES:
        check_new(folder / name, "FOLDER", overwrite=out.overwrite)
    points = [_point(words) for words in trocar]
    tools = tuple(TipInstrument(point) for point in points)
    statement = Statement(tools, capsules, Settings(p=horizon), balls)
    start = [[x, y - ASIDE, z - DEPTH] for x, y, z in points]
    goal = [[x, y + ASIDE, z - DEPTH] for x, y, z in points]
    try:
        write(statement, folder, Example(start, goal))
    except OSError as error:
        raise PlumblineError(f"{folder}: {error.strerror}; name another folder") from None
    content = {"folder": str(folder), "files": list(FILES)}
    out.say(content, f"{', '.join(FILES)} written to {folder}\n{BUILD}")


def _point(words: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in words.split(","))
    except ValueError:
        raise PlumblineError(f"--trocar {words}: expected x,y,z in m, such as -0.04,0,0") from None
    return x, y, z
