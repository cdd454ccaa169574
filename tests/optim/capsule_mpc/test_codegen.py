"""The code of a step in C: the same commands as in Python, and no allocation."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run as command_line
from plumbline.optim.capsule_mpc import (
    LibraryQp,
    Obstacle,
    RealTime,
    Settings,
    Statement,
    TipInstrument,
)
from plumbline.optim.capsule_mpc.codegen import FILES, Example, affine, numbers_of, write
from plumbline.optim.capsule_mpc.compiled import compiler
from plumbline.optim.capsule_mpc.planning import shifted
from plumbline.optim.capsule_mpc.sweeps import Looks

NEEDED = pytest.mark.skipif(compiler() is None, reason="no C compiler here")
SOURCES = [name for name in FILES if name.endswith(".c")]
OBSTACLES = (
    Obstacle((-0.01, 0.03, -0.09), (0.015, 0.025, -0.11), 0.004, (0.005, -0.01, 0.0)),
    Obstacle.sphere((0.0, 0.012, -0.07), 0.005, (0.0, -0.003, 0.002)),
)
START = np.array([-0.03, 0.0, -0.12, 0.035, 0.0, -0.115])
GOAL = np.array([0.04, 0.01, -0.11, -0.04, 0.005, -0.12])
EXAMPLE = Example(START, GOAL, OBSTACLES, 80)
BY_ITS_VELOCITY = "obstacles[i - i % NUMBERS + 7 + i % NUMBERS % 3]"


def statement(**settings):
    """Two instruments that swap sides, with more slots than obstacles."""
    tools = (TipInstrument((-0.04, 0.0, 0.0)), TipInstrument((0.04, 0.0, 0.0)))
    return Statement(tools, 2, Settings(p=6, **settings), 1)


def moved(obstacle, time, rate=None):
    """An obstacle some time later, by its velocity or another rate."""
    off = time * np.array(obstacle.velocity if rate is None else rate)
    a, b = (tuple(float(v) for v in np.array(end) + off) for end in (obstacle.a, obstacle.b))
    return replace(obstacle, a=a, b=b)


def driven(own, found, paths, rate=None):
    """Rates (K, n) [m/s] of Python's planner where found ones (K, n) take the model.

    What rounding leaves over is not handed on: every step begins where the other one did.
    """
    ready, x, dt = RealTime(compiled=False).ready(own), 1e3 * START, own.settings.dt
    looks = Looks(dt)
    path, move, rates = np.tile(x, (own.settings.p, 1)), np.zeros(6), []
    for k, (sent, kept) in enumerate(zip(1e3 * found, paths, strict=True)):
        seen = [moved(o, dt * k, rate).scaled(1e3) for o in OBSTACLES]
        believed, _ = looks.believed(seen)
        plan = ready.plan(x, own.stages(1e3 * GOAL, believed, move), path)
        assert plan.solved
        assert np.abs(shifted(plan.x).ravel() - kept).max() < 1e-7
        rates.append((plan.x[0] - x) / dt)
        move, path, x = dt * sent, kept.reshape(path.shape), x + dt * sent
    return 1e-3 * np.array(rates)


def built(folder, *flags):
    """What the small program prints: rates (K, n), and paths (K, p n)."""
    cc = [compiler(), "-O2", "-Wall", "-Werror", "-Wno-unused-function", *flags]
    subprocess.run([*cc, "-o", "main", *SOURCES, "-lm"], cwd=folder, check=True)
    said = subprocess.run(["./main"], cwd=folder, check=True, capture_output=True, text=True)
    rows = np.array([[float(v) for v in line.split()] for line in said.stdout.splitlines()])
    return rows[:, : len(START)], rows[:, len(START) :]


@NEEDED
def test_a_step_in_c_commands_what_python_does(tmp_path):
    own = statement()
    write(own, tmp_path, EXAMPLE)
    found, paths = built(tmp_path)
    wanted = driven(own, found, paths)
    assert found.shape == wanted.shape == (80, 6)
    assert np.abs(wanted).max() > 0.03
    assert np.abs(found - wanted).max() < 1e-12


@NEEDED
def test_a_step_in_c_believes_places_rather_than_velocities_as_python_does(tmp_path):
    own, rate = statement(), 0.04
    write(own, tmp_path, EXAMPLE)
    source = (tmp_path / "main.c").read_text()
    assert BY_ITS_VELOCITY in source
    (tmp_path / "main.c").write_text(source.replace(BY_ITS_VELOCITY, f"{rate}"))
    found, paths = built(tmp_path)
    wanted = driven(own, found, paths, np.full(3, rate))
    assert np.abs(found - wanted).max() < 1e-12


@NEEDED
def test_a_step_in_c_without_obstacles_or_smoothness_is_the_same(tmp_path):
    tools = statement().bodies
    own = Statement(tools, 0, Settings(p=3, effort=0.0, smooth=0.0))
    write(own, tmp_path, Example(START, GOAL, (), 3))
    ready, stages, x = RealTime(compiled=False).ready(own), own.stages(1e3 * GOAL, []), 1e3 * START
    plan = ready.plan(x, stages, np.tile(x, (3, 1)))
    assert np.abs(built(tmp_path)[0][0] - 1e-3 * (plan.x[0] - x) / 0.02).max() < 1e-12


@NEEDED
@pytest.mark.skipif(shutil.which("nm") is None, reason="no nm here")
def test_nothing_is_allocated_in_a_step(tmp_path):
    write(statement(), tmp_path, EXAMPLE)
    own = [name for name in SOURCES if name != "main.c"]
    subprocess.run([compiler(), "-O2", "-c", *own], cwd=tmp_path, check=True)
    needed, global_data = set(), set()
    for name in own:
        made = str(tmp_path / name).replace(".c", ".o")
        lines = subprocess.run(["nm", made], check=True, capture_output=True, text=True).stdout
        for *_, kind, symbol in (line.split() for line in lines.splitlines()):
            if kind == "U":
                needed.add(symbol)
            elif kind in "BbDCd":
                global_data.add(symbol)
    arithmetic = {
        "sqrt",
        "fmin",
        "fmax",
        "fabs",
        "memset",
        "memcpy",
        "memmove",
        "_GLOBAL_OFFSET_TABLE_",
    }
    assert needed <= {"program", "banded_qp", "banded_qp_turned", "pow", *arithmetic}
    assert not global_data


@NEEDED
def test_a_step_that_is_not_solved_says_so_and_rests(tmp_path):
    write(statement(), tmp_path, Example(START * np.nan, GOAL, OBSTACLES, 5))
    source = (tmp_path / "main.c").read_text().replace("nan", "(0.0 / 0.0)")
    (tmp_path / "main.c").write_text(source)
    with pytest.raises(subprocess.CalledProcessError, match="exit status 1"):
        built(tmp_path)


def test_parameters_of_the_stages_are_affine_in_what_is_given():
    own = statement()
    constant, T = affine(own)
    rng = np.random.default_rng(0)
    for count in (0, 1, 2):
        seen = [moved(o, rng.uniform(0, 1)) for o in OBSTACLES[:count]]
        inside = [obstacle.scaled(1e3) for obstacle in seen]
        move = rng.normal(size=6)
        u = np.concatenate([1e3 * GOAL, 1e3 * numbers_of(own, seen).ravel(), move])
        wanted = own.stages(1e3 * GOAL, inside, move).ravel()
        assert np.abs(constant + T @ u - wanted).max() < 1e-8


def test_more_obstacles_than_slots_are_refused():
    with pytest.raises(PlumblineError, match="found 3, expected at most 2 capsules"):
        numbers_of(statement(), [OBSTACLES[0]] * 3)


def test_code_is_written_for_our_own_solver_alone(tmp_path):
    with pytest.raises(PlumblineError, match=r"expected BandedQp\(\) and 1 pass"):
        write(statement(), tmp_path, EXAMPLE, RealTime(LibraryQp("piqp")))


def test_the_command_writes_the_code(tmp_path, capsys):
    out = tmp_path / "code"
    trocars = ["--trocar", "-0.04,0,0", "--trocar", "0.04,0,0"]
    assert command_line(["codegen", str(out), *trocars, "--balls", "1", "--horizon", "3"]) == 0
    assert sorted(p.name for p in out.iterdir()) == sorted(FILES)
    assert "cc -O3" in capsys.readouterr().out
    assert command_line(["codegen", str(out), "--overwrite", "--trocar", "1,2"]) == 2
    assert "expected x,y,z" in capsys.readouterr().err
