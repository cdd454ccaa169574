"""The blind process: reads tasks, one JSON object a line.

``python -m plumbline.experiments.withheld.blind``

It loads the library once and forks for every task. The fork shuts itself into the task's folder
(`sandbox`), diagnoses the recording that lies in it as ``recording`` and writes ``verdict.json``
beside that. Nothing else passes between the two sides but the names of effects to leave out, the
seed, and one line when it is done.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

import plumbline.experiments.withheld.sandbox as walls
from plumbline.errors import PlumblineError
from plumbline.experiments.console.workers import end_with
from plumbline.optim.diagnosis.of_any_kind import diagnose
from plumbline.optim.diagnosis.options import DiagnosisOptions


def diagnosed(recording: Path, without: list[str], seed: int) -> dict[str, Any]:
    """The verdict on a recording, or why it was refused, as plain data."""
    options = DiagnosisOptions(seed=seed, without=without)
    try:
        return diagnose(recording, options).verdict.to_dict()
    except PlumblineError as error:
        return {"verdict": "refused", "reason": str(error), "causes": [], "candidates": []}


def carry_out(task: dict[str, Any]) -> None:
    """Shut the process in, diagnose, and write the verdict."""
    folder = Path(task["folder"])
    os.chdir(folder)
    held = walls.confine(folder)
    verdict = diagnosed(folder / walls.RECORDING, list(task["without"]), int(task["seed"]))
    verdict["kernel_wall"] = held
    (folder / walls.VERDICT).write_text(json.dumps(verdict, allow_nan=False), encoding="utf-8")


def serve() -> None:
    """Carry out tasks in forks of their own until the other side hangs up."""
    for text in sys.stdin:
        task = json.loads(text)
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            code = 1
            try:
                carry_out(task)
                code = 0
            finally:
                sys.stderr.flush()
                # Not sys.exit: the fork must not run on into its parent's loop.
                if code:
                    sys.excepthook(*sys.exc_info())
                os._exit(code)
        _, status = os.waitpid(child, 0)
        sys.stdout.write(json.dumps({"code": os.waitstatus_to_exitcode(status)}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    end_with(os.getppid())
    serve()
