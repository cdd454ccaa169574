"""The README runs: its examples, its commands, and the output that it shows."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from plumbline.experiments.__main__ import app, run
from plumbline.experiments.effect_list import markdown
from tests.made_up_diagnosis import BENCH

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")
GAP = "[...]"  # lines of the output that the README leaves out


def blocks(language):
    """Texts of the fenced blocks in a language, in their order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def commands(program):
    """Command lines of the console blocks that begin with a program, comments taken off."""
    lines = "".join(blocks("console")).splitlines()
    plain = [line.split("#")[0].split() for line in lines]
    return [words[1:] for words in plain if words[:1] == [program]]


def same(said, shown):
    """Whether two words agree, numbers in them to a tenth."""
    numbers = [[float(m[0]) for m in NUMBER.finditer(word)] for word in (said, shown)]
    if len(numbers[0]) != len(numbers[1]) or NUMBER.sub("0", said) != NUMBER.sub("0", shown):
        return False
    return all(abs(a - b) <= 0.1 * abs(b) for a, b in zip(*numbers, strict=True))


def place_of(part, words, first):
    """Where a part begins among words, at the earliest from ``first``; None if nowhere."""
    for k in range(first, len(words) - len(part) + 1):
        if all(same(a, b) for a, b in zip(words[k:], part, strict=False)):
            return k
    return None


@pytest.fixture
def my_robot(tmp_path):
    """The README's own recording, its samples continued with those of the bundled one."""
    (head,) = blocks("csv")
    full = [line.split(",")[:9] for line in (BENCH / "samples.csv").read_text().splitlines()]
    samples = "\n".join(",".join(row) for row in full) + "\n"
    assert samples.startswith(head)
    folder = tmp_path / "my-robot"
    folder.mkdir()
    (folder / "dataset.toml").write_text(blocks("toml")[0])
    (folder / "samples.csv").write_text(samples)
    return folder


def test_the_recording_of_the_readme_can_be_used_as_it_stands(my_robot, capsys):
    assert run(["check", str(my_robot)]) == 0
    assert "not used" not in capsys.readouterr().out


def test_the_examples_run(my_robot):
    script = my_robot.parent / "examples.py"
    script.write_text("\n\n".join(blocks("python")), encoding="utf-8")
    # In a process of its own: the example's effect shall not join those that other tests find.
    done = subprocess.run(
        [sys.executable, "-W", "error", script.name],
        cwd=my_robot.parent,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert (my_robot.parent / "my-robot.html").stat().st_size > 10_000


def test_the_example_of_an_effect_is_of_about_forty_lines():
    (effect,) = [block for block in blocks("python") if "class ToolSlip" in block]
    assert len(effect.splitlines()) <= 44


def test_the_table_of_effects_is_the_library_s():
    assert markdown() in README, f"put this table into the README:\n{markdown()}"


@pytest.mark.parametrize("words", commands("plumbline"), ids=" ".join)
def test_a_command_of_the_readme_parses(words):
    name, command, rest = "plumbline", typer.main.get_command(app), words
    while hasattr(command, "resolve_command"):
        context = command.make_context(name, list(rest))
        name, command, rest = command.resolve_command(context, list(rest))
        assert command is not None
    assert command.make_context(name, list(rest)).params


@pytest.mark.parametrize("words", commands("make"), ids=" ".join)
def test_a_target_of_the_readme_is_in_the_makefile(words):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{words[0]}:", makefile, re.MULTILINE)
    for setting in words[1:]:
        assert re.search(rf"^{setting.split('=')[0]} \?=", makefile, re.MULTILINE)


def test_nothing_in_a_console_block_goes_untested():
    lines = [line for line in "".join(blocks("console")).splitlines() if line.strip()]
    assert len(lines) == len(commands("plumbline")) + len(commands("make")) > 0


def test_the_output_shown_is_what_the_command_prints(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("results").mkdir()
    assert run(["diagnose", str(BENCH), "--report", "results/bench-ur5.html"]) == 0
    said = [word for word in capsys.readouterr().out.split() if "█" not in word]
    first = 0
    for part in blocks("text")[0].split(GAP):
        found = place_of(part.split(), said, first)
        assert found is not None, f"not printed any more:\n{part}"
        first = found + len(part.split())


def test_an_output_with_another_word_or_number_is_seen():
    said = ["joint", "2", "0.451", "mm"]
    assert place_of(["2", "0.449", "mm"], said, 0) == 1
    assert place_of(["2", "0.351", "mm"], said, 0) is None
    assert place_of(["2", "0.451", "m"], said, 0) is None


def test_every_path_that_the_readme_names_is_there():
    named = re.findall(r"`((?:kinematics|optim|experiments|tests|notebooks)/[\w./-]*)`", README)
    assert len(named) >= 8
    assert not [path for path in named if not (ROOT / path).exists()]
