"""The README and the documents run: examples, commands, links, and the output that is shown."""

import re
from pathlib import Path

import pytest
import typer

from plumbline.experiments.commands.app import app, run
from plumbline.experiments.report.effect_list import markdown
from tests.forks import forking
from tests.made_up_diagnosis import BENCH

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
EFFECTS, OWN_EFFECT = ROOT / "docs/background/effects.md", ROOT / "docs/howto/own_effect.md"
PAGES = (README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
SHORT = 200  # lines of the README: what fits on a few screens is read
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")
ROOMS = "kinematics|optim|experiments"
INSIDE = re.compile(rf"\bplumbline\.({ROOMS})\b|from plumbline import .*\b({ROOMS})\b")
GAP = "[...]"  # lines of the output that the README leaves out


def name_of(page):
    """A page's path from the project's root."""
    return page.relative_to(ROOT).as_posix()


def blocks(language, page=README):
    """Texts of the fenced blocks of a page in a language, in their order."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def lines_of_consoles():
    """Lines of the console blocks of all pages."""
    found = "".join(text for page in PAGES for text in blocks("console", page)).splitlines()
    return [line for line in found if line.strip()]


def commands(program):
    """Command lines of all pages that begin with a program, comments taken off, each once."""
    plain = [line.split("#")[0].split() for line in lines_of_consoles()]
    return list(dict.fromkeys(tuple(words[1:]) for words in plain if words[:1] == [program]))


WITH_EXAMPLES = [page for page in PAGES if blocks("python", page)]


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


def test_the_readme_is_short():
    assert len(README.read_text(encoding="utf-8").splitlines()) <= SHORT


FACE = """
import plumbline
for name in plumbline.__all__:
    getattr(plumbline, name)
from plumbline.experiments.report.style import drawing, svg
with drawing(1.0, 1.0) as (figure, _):
    svg(figure, "", "")
"""


@pytest.fixture(scope="module")
def forks():
    """In a process of its own: an example's effect shall not join those that other tests find."""
    with forking(FACE, "-W", "error") as forks:
        yield forks


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=name_of)
def test_the_examples_of_a_page_run(page, my_robot, forks):
    script = my_robot.parent / "examples.py"
    code, said = forks.run(script, "\n\n".join(blocks("python", page)))
    assert code == 0, said
    reports = [name for name in ("my-robot.html", "bench-ur5.html") if name in script.read_text()]
    assert all((my_robot.parent / name).stat().st_size > 10_000 for name in reports)


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=name_of)
def test_the_examples_of_a_page_reach_everything_through_the_face(page):
    text = "\n".join(blocks("python", page))
    assert not INSIDE.search(text), f"{name_of(page)}: go through the face"


@pytest.mark.parametrize(
    "line",
    [
        "from plumbline.kinematics.effects import EFFECTS",
        "    import plumbline.optim",
        'bench = files("plumbline.experiments")',
        "plumbline.optim.dh_fit.export.as_urdf(fit)",
        "from plumbline import kinematics",
    ],
)
def test_an_example_that_reaches_inside_is_seen(line):
    assert INSIDE.search(line)


def test_the_example_of_an_effect_is_of_about_forty_lines():
    (effect,) = [block for block in blocks("python", OWN_EFFECT) if "class ToolSlip" in block]
    assert len(effect.splitlines()) <= 44


def test_the_table_of_effects_is_the_library_s():
    text = EFFECTS.read_text(encoding="utf-8")
    assert markdown() in text, f"put this table into {name_of(EFFECTS)}:\n{markdown()}"


@pytest.mark.parametrize("words", commands("plumbline"), ids=" ".join)
def test_a_command_of_a_page_parses(words):
    name, command, rest = "plumbline", typer.main.get_command(app), words
    while hasattr(command, "resolve_command"):
        context = command.make_context(name, list(rest))
        name, command, rest = command.resolve_command(context, list(rest))
        assert command is not None
    assert command.make_context(name, list(rest)).params


@pytest.mark.parametrize("words", commands("make"), ids=" ".join)
def test_a_target_of_a_page_is_in_the_makefile(words):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{words[0]}:", makefile, re.MULTILINE)
    for setting in words[1:]:
        assert re.search(rf"^{setting.split('=')[0]} \?=", makefile, re.MULTILINE)


def test_nothing_in_a_console_block_goes_untested():
    first = {line.split()[0] for line in lines_of_consoles()}
    assert first == {"plumbline", "make"}


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


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_path_that_a_page_names_is_there(page):
    text = page.read_text(encoding="utf-8")
    rooms = f"{ROOMS}|tests|notebooks|plumbline|docs"
    named = re.findall(rf"`((?:{rooms})/[\w./-]*)`", text)
    linked = re.findall(r"\]\((?!https?:|#)([\w./-]+)", text)
    missing = [path for path in named if not (ROOT / path).exists()]
    assert not missing + [path for path in linked if not (page.parent / path).exists()]
