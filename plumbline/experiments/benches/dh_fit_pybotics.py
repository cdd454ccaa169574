"""The link fit beside pybotics, which lives in an environment of its own (it needs NumPy < 2).

``python -m venv other && other/bin/pip install pybotics`` first, then
``python -m plumbline.experiments.benches.dh_fit_pybotics FOLDER --python other/bin/python``, FOLDER
being a recording of a robot with revolute DH rows, such as ``ur5-grid``. Both fit the same rows and
predict the same others; pybotics as its documentation does it: every parameter of its chain, tool
and world frame, SciPy's least squares with finite differences on the lengths of the misfits.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from plumbline.errors import PlumblineError
from plumbline.experiments.benches import tell, timed
from plumbline.experiments.console.outputs import Json
from plumbline.kinematics.dh import rows_table
from plumbline.optim.dh_fit import DHOptions, Misfit, Readings, Squares, fit_dh
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording

SECONDS = 900.0
SCRIPT = """
import json, sys, time
import numpy as np
from pybotics.robot import Robot
from pybotics.tool import Tool
from pybotics.optimization import OptimizationHandler, optimize_accuracy, compute_absolute_errors
from scipy.optimize import least_squares
given = json.load(open(sys.argv[1]))
robot = Robot.from_parameters(np.array(given["mdh"]))
robot.tool.position = np.array(given["tool"])
robot.world_frame = np.array(given["world"])
q, tips = np.array(given["q"]), np.array(given["tips"])
mask = [True] * robot.kinematic_chain.num_parameters
handler = OptimizationHandler(
    robot, kinematic_chain_mask=mask, tool_mask=[True] * 3 + [False] * 3, world_mask=True
)
begun = time.perf_counter()
start = handler.generate_optimization_vector()
found = least_squares(optimize_accuracy, start, args=(handler, q, tips), x_scale="jac", max_nfev=50)
seconds = time.perf_counter() - begun
handler.apply_optimization_vector(found.x)
q_new, tips_new = np.array(given["q_new"]), np.array(given["tips_new"])
unseen = compute_absolute_errors(q_new, tips_new, handler.robot)
print(json.dumps({"seconds": seconds, "errors": list(unseen), "evaluations": int(found.nfev)}))
"""


@dataclass(frozen=True)
class Compared:
    """Both fits; names of the fields are the keys of the JSON."""

    rows: int  # rows fitted, as many as were predicted
    before: float  # RMS of the nominal links on rows not seen [m]
    ours: float  # RMS of ours [m]
    seconds: float  # time of our whole fit [s]
    pybotics: float  # RMS of pybotics' [m]
    pybotics_seconds: float  # time of its least squares [s]


def compare(recording: Recording, python: Path, rows: int, seed: int) -> Compared:
    """Fit some rows with both, and predict as many others."""
    order = np.random.default_rng(seed).permutation(len(recording))
    train, unseen = np.sort(order[:rows]), np.sort(order[rows : 2 * rows])
    every = Readings(recording.q, recording.measured[:, :3])
    some = recording.select(train)
    fit, (seconds,) = timed(lambda: fit_dh(some, DHOptions(loss=Squares())))
    frame = fit.nominal_statement.frame_at(fit.nominal_x)
    theirs = _pybotics(recording, frame, train, unseen, python)
    return Compared(
        rows,
        Misfit.of(fit.nominal_misfits(every.select(unseen))).rms,
        Misfit.of(fit.misfits(every.select(unseen))).rms,
        seconds,
        float(np.sqrt(np.mean(np.square(theirs["errors"])))),
        float(np.max(theirs["seconds"])),
    )


def _pybotics(
    recording: Recording,
    T_robot_camera: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    train: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    unseen: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    python: Path,
) -> dict[str, list[float]]:
    dh = recording.robot.dh
    if dh is None or any(row.kind != "revolute" for row in dh):
        raise PlumblineError(f"{recording.name}: pybotics needs revolute DH rows; take ur5-grid")
    d, a, alpha, theta = rows_table(dh).T
    # Modified rows: a row begins with the twist and length that end the standard one before.
    mdh = np.column_stack([np.r_[0.0, alpha[:-1]], np.r_[0.0, a[:-1]], theta, d])
    given = {
        "mdh": mdh.tolist(),
        "tool": recording.tool_offset.tolist(),
        "world": np.linalg.inv(T_robot_camera).tolist(),
        "q": recording.q[train].tolist(),
        "tips": recording.measured[train, :3].tolist(),
        "q_new": recording.q[unseen].tolist(),
        "tips_new": recording.measured[unseen, :3].tolist(),
    }
    with tempfile.TemporaryDirectory(prefix="plumbline-pybotics-") as scratch:
        file = Path(scratch) / "readings.json"
        file.write_text(json.dumps(given), encoding="utf-8")
        try:
            done = subprocess.run(
                [str(python), "-c", SCRIPT, str(file)],
                capture_output=True,
                text=True,
                check=True,
                timeout=SECONDS,
            )
        except (OSError, subprocess.SubprocessError) as error:
            said = str(getattr(error, "stderr", "") or error).strip().splitlines()[-1:]
            reason = said[0] if said else type(error).__name__
            raise PlumblineError(f"--python {python}: pybotics did not run ({reason})") from None
    found: dict[str, list[float]] = json.loads(done.stdout)
    return found


def tables(found: Compared) -> list[Table]:
    """Both on rows that neither has seen."""
    table = Table("fit", "RMS", "time", title=f"{found.rows} rows fitted, as many not seen")
    table.add_row("nominal", f"{1e3 * found.before:.3f} mm")
    table.add_row("here", f"{1e3 * found.ours:.3f} mm", f"{found.seconds:.2f} s")
    table.add_row("pybotics", f"{1e3 * found.pybotics:.3f} mm", f"{found.pybotics_seconds:.2f} s")
    return [table]


def bench(
    folder: Annotated[Path, typer.Argument(help="A recording of a robot with DH rows.")],
    python: Annotated[Path, typer.Option(help="The interpreter that has pybotics.")],
    rows: Annotated[int, typer.Option(min=20, help="Rows to fit; as many are predicted.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the draw of rows.")] = 0,
    json: Json = None,
) -> None:
    """Fit a recording with pybotics too, and print both."""
    tell(lambda: compare(load_recording(folder), python, rows, seed), tables, json)


if __name__ == "__main__":
    typer.run(bench)
