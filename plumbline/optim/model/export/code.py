"""A model as a CasADi function, and as C that needs nothing else."""

import tempfile
from pathlib import Path

import casadi as cs

from plumbline.optim.model.arm import Arm, efforts_of
from plumbline.optim.model.export.exported import Exported, lacking
from plumbline.optim.recording.kinds import EFFORTS

NAME = "plumbline_model"
RESULTS = {
    "T_base_tool": "T_base_tool (4, 4) [m], jacobian (6, n) [m or rad a unit], both by columns",
    "tau": "tau (n,) [N m or N], what the drives read",
}


def function(arm: Arm) -> cs.Function:
    """``(q, ...) -> (T_base_tool (4, 4), J (6, n))``: an input for each column that is read.

    Of efforts, ``(q, velocity, acceleration, ...) -> tau (n,)``.
    """
    if arm.observation == EFFORTS:
        efforts = efforts_of(arm)
        moved = [efforts.symbols[name] for name in efforts.used]
        return cs.Function(NAME, moved, [efforts.torque(efforts.row)], [*efforts.used], ["tau"])
    statement = arm.statement
    inputs = [statement.symbols[name] for name in statement.used]
    pose, J = statement.slope(statement.row)
    T = cs.vertcat(cs.horzcat(cs.reshape(pose[:9], 3, 3), pose[9:]), cs.DM([[0.0, 0.0, 0.0, 1.0]]))
    return cs.Function(NAME, inputs, [T, J], list(statement.used), ["T_base_tool", "jacobian"])


def as_c(arm: Arm) -> Exported:
    """The C with what it lacks, which is nothing."""
    return Exported(c_code(arm), "", float("nan"), *lacking(arm, arm))


def c_code(arm: Arm) -> str:
    """The function as one C file; its head names inputs, outputs and units."""
    made = function(arm)
    with tempfile.TemporaryDirectory() as folder:
        generator = cs.CodeGenerator(f"{NAME}.c", {"with_header": False, "main": False})
        generator.add(made)
        generator.generate(f"{folder}/")
        text = (Path(folder) / f"{NAME}.c").read_text(encoding="utf-8")
    inputs = ", ".join(f"{made.name_in(k)} ({made.size1_in(k)})" for k in range(made.n_in()))
    head = [
        f"/* {arm.robot.name} as plumbline found it on {arm.recording}.".replace("*/", ""),
        f" * int {NAME}(const double** arg, double** res, casadi_int* iw, double* w, int mem);",
        f" * arg: {inputs}; SI units, joints as their encoders read.",
        f" * res: {RESULTS[made.name_out(0)]}.",
        " */",
    ]
    return "\n".join(head) + "\n" + text
