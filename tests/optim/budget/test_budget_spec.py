"""Links from a calibration, a loop and figures with their origin; a chain written in a file."""

import json

import numpy as np
import pytest

import plumbline
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run
from plumbline.optim.budget.sources import MEAN_TO_RMS

Source, add_up = plumbline.budget.Source, plumbline.budget.add_up
PLAIN = """
[[link]]
name = "calculation"
mean_length = 1.43e-3
dof = 9
origin = "five markers"
cured = 0.4e-3

[[link]]
name = "control"
rms = 0.1e-3

[[link]]
name = "needle"
mean = [0.3e-3, 0.0, 0.0]
std = 0.2e-3
"""


@pytest.fixture
def spec(tmp_path):
    """A chain in a file."""
    path = tmp_path / "chain.toml"
    path.write_text(PLAIN)
    return path


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A hand-eye answer, stored."""
    case = plumbline.reproduce.hand_eye_trials.set_up(seed=0, number=0)
    home = tmp_path_factory.mktemp("finder")
    folder = plumbline.simulate.writing.write_survey(home / "rows", case.scene, case.survey)
    found = plumbline.hand_eye(folder, plumbline.HandEyeOptions(poses=0))
    found.save(home / "handeye.json")
    return found, home


CT = 1e-3 * np.array([(10, 20, 147), (110, 120, 147), (60, -10, 80), (20, 150, 147)])


def markers():
    """A registration of four markers."""
    noise = plumbline.MarkerNoise.from_resolution(1e-3 * np.ones(3), 1e-4)
    return plumbline.register(plumbline.build_fiducials(CT, CT + 0.1, noise=noise))


def test_a_mean_length_is_less_than_the_rms_by_the_normal_law_s_factor():
    drawn = np.linalg.norm(np.random.default_rng(0).standard_normal((200_000, 3)), axis=1)
    assert pytest.approx(np.sqrt(np.mean(drawn**2)) / drawn.mean(), rel=3e-3) == MEAN_TO_RMS
    link = Source.of_mean_length("calculation", 1.43e-3, origin="five markers")
    assert add_up([link]).rms == pytest.approx(1.552e-3, rel=1e-3)
    assert add_up([link]).parts[0].origin == "five markers"


def test_a_hand_eye_link_errs_as_beams_drawn_from_its_covariance(beam):
    found, _ = beam
    rng = np.random.default_rng(3)
    drawn = rng.multivariate_normal(np.zeros(6), found.calibration.covariance, 40_000)
    off = drawn[:, :3] + 0.35 * drawn[:, 3:]
    link = Source.of_hand_eye("hand-eye", found, 0.35)
    assert add_up([link]).rms == pytest.approx(np.sqrt((off**2).sum(axis=1).mean()), rel=0.02)
    turned = Source.of_hand_eye("hand-eye", found, 0.35, np.stack([np.eye(3)[[1, 2, 0]]] * 2))
    assert turned.points == 2
    assert add_up([turned]).rms == pytest.approx(add_up([link]).rms)


def test_a_loop_s_rows_count_for_as_many_as_are_independent():
    rng = np.random.default_rng(5)
    own = rng.standard_normal((4000, 3))
    slow = np.empty_like(own)
    slow[0] = own[0]
    for k in range(1, len(own)):  # AR(1): as many as (1 - a) / (1 + a) of the rows
        slow[k] = 0.8 * slow[k - 1] + 0.6 * own[k]
    nought = np.zeros_like(own)
    white, red = (Source.of_tracking("loop", nought, 1e-4 * e) for e in (own, slow))
    assert white.dof == pytest.approx(3 * 4000, rel=0.2)
    assert red.dof == pytest.approx(3 * 4000 * 0.2 / 1.8, rel=0.25)
    assert add_up([red]).rms == pytest.approx(np.sqrt(3) * 1e-4, rel=0.1)


def test_what_a_link_must_come_down_to_saves_just_so_much(spec):
    found = plumbline.budget.read_budget(spec)
    goals = found.to_gain(1e-4)
    assert list(goals) == ["calculation"]  # no other is worth a tenth of a millimetre
    links = [Source.of_rms("calculation", goals["calculation"])]
    links += [Source.of_rms("control", 1e-4)]
    links += [Source.of("needle", mean=[3e-4, 0, 0], covariance=4e-8)]
    assert add_up(links).rms == pytest.approx(found.rms - 1e-4)


def test_links_that_push_alike_gain_more_than_their_own():
    push = [1e-3, 0.0, 0.0]
    both = add_up([Source.of("a", mean=push), Source.of("b", mean=push)])
    assert both.to_gain(1e-4)["a"] == pytest.approx(0.9e-3)


def test_a_file_gives_the_budget_of_its_figures(spec):
    found = plumbline.budget.read_budget(spec)
    square = (MEAN_TO_RMS * 1.43) ** 2 + 0.01 + 0.09 + 3 * 0.04
    assert found.rms == pytest.approx(1e-3 * np.sqrt(square))
    assert found.parts[0].origin == "five markers"
    assert found.rms_after == pytest.approx(1e-3 * np.sqrt(0.16 + 0.01 + 0.09 + 0.12))


def test_a_file_takes_stored_answers(beam):
    found, home = beam
    spot = markers()
    spot.save(home / "markers.json", overwrite=True)
    (home / "chain.toml").write_text(
        '[[link]]\nname = "markers"\nanswer = "markers.json"\ntarget = [0.05, 0.1, 0.1]\n'
        '[[link]]\nname = "hand-eye"\nanswer = "handeye.json"\nrange = 0.35\n'
    )
    parts = plumbline.budget.read_budget(home / "chain.toml").parts
    tre = spot.tre([0.05, 0.1, 0.1], None).rms
    beam_rms = add_up([Source.of_hand_eye("b", found, 0.35)]).rms
    assert [part.rms for part in parts] == pytest.approx([tre, beam_rms])
    assert "handeye.json" in parts[1].origin


def test_a_file_takes_what_commands_wrote_as_json(beam, tmp_path):
    """The same links as by the saved answers, to the last digit but one."""
    _, home = beam
    folder = tmp_path / "head"
    folder.mkdir()
    noise = "[noise]\nct_resolution = [0.001, 0.0005, 0.0005]\nrobot_std = 0.0001\n"
    (folder / "dataset.toml").write_text(f'name = "head"\nobservation = "fiducials"\n{noise}')
    rows = ["label,role,ct_x,ct_y,ct_z,robot_x,robot_y,robot_z"]
    for label, p in zip("ABCD", CT, strict=True):
        rows.append(f"{label},marker,{','.join(map(str, [*p, *(p + 0.1)]))}")
    (folder / "samples.csv").write_text("\n".join([*rows, "lesion,target,0.05,0.1,0.1,,,", ""]))
    assert run(["register", str(folder), "--json", str(tmp_path / "r.json"), "--quiet"]) == 0
    plumbline.register(folder).save(tmp_path / "saved.json")
    ask = ["handeye", str(home / "rows"), "--next", "0", "--quiet"]
    assert run([*ask, "--json", str(tmp_path / "h.json")]) == 0
    beam[0].save(tmp_path / "beam.json")
    links = [("r.json", '"lesion"'), ("r.json", "[0.05, 0.1, 0.1]"), ("saved.json", '"lesion"')]
    text = "".join(f'[[link]]\nname = "{k}"\nanswer = "{file}"\ntarget = {target}\n'
                   for k, (file, target) in enumerate(links))  # fmt: skip
    text += "".join(f'[[link]]\nname = "{file}"\nanswer = "{file}"\nrange = 0.35\n'
                    for file in ("h.json", "beam.json"))  # fmt: skip
    (tmp_path / "chain.toml").write_text(text)
    rms = [part.rms for part in plumbline.budget.read_budget(tmp_path / "chain.toml").parts]
    np.testing.assert_allclose(rms[:3], rms[2], rtol=1e-9)
    np.testing.assert_allclose(rms[3], rms[4], rtol=1e-9)


def test_figures_of_a_command_that_are_damaged_are_refused(tmp_path):
    told = {"T_RC": 0, "noise": {"dof": None}, "targets": [{"label": "a", "unknown": None}]}
    (tmp_path / "r.json").write_text(json.dumps(told))
    (tmp_path / "c.toml").write_text('[[link]]\nname = "a"\nanswer = "r.json"\ntarget = "a"\n')
    with pytest.raises(PlumblineError, match="damaged figures"):
        plumbline.budget.read_budget(tmp_path / "c.toml")
    told["targets"] = [{"label": "a", "ct": [0, 0, 0], "unknown": "three on a line"}]
    (tmp_path / "r.json").write_text(json.dumps(told))
    with pytest.raises(PlumblineError, match="three on a line"):
        plumbline.budget.read_budget(tmp_path / "c.toml")


@pytest.mark.parametrize(
    "figure", ["rms = {}", "mean_length = {}", "mean = [0, {}, 0]", "std = {}"]
)
def test_an_error_that_was_meant_in_mm_is_refused_in_one_line(figure, tmp_path, capsys):
    """Five centimetres are more than any link errs by; the next number above is refused."""
    chain = tmp_path / "chain.toml"
    for size, code in ((0.05, 0), (0.0501, 2), (1.1, 2)):
        chain.write_text('[[link]]\nname = "needle"\n' + figure.format(size))
        assert run(["budget", str(chain), "--quiet"]) == code
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    words = "found 1.1, expected at most 0.05 m; looks like mm: divide by 1000"
    assert said[1].startswith("plumbline: chain.toml, row 3, [link]")
    assert said[1].endswith(words)


def test_the_command_tells_what_to_mend_and_replaces_nothing_but_its_own(spec, tmp_path, capsys):
    out, page = tmp_path / "budget.json", tmp_path / "budget.html"
    words = ["budget", str(spec), "--json", str(out), "--report", str(page)]
    assert run(words) == 0
    said = capsys.readouterr().out
    assert "mend calculation first" in said
    assert "For the next 0.100 mm: calculation from 1.55 mm to" in said
    assert json.loads(out.read_text())["parts"][0]["name"] == "calculation"
    assert "five markers" in page.read_text()
    assert run(words) == 0  # in the place of its own
    page.write_text("mine")
    before = spec.read_bytes(), out.read_bytes()
    assert run(words) == 2
    assert "is there already" in capsys.readouterr().err
    assert run(["budget", str(spec), "--json", str(spec), "--overwrite"]) == 2
    assert (spec.read_bytes(), out.read_bytes(), page.read_text()) == (*before, "mine")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "an empty file"),
        ("link = 3", "expected tables [[link]]"),
        ("[[link]]\nrms = 1e-3", "a link without one"),
        ('[[link]]\nname = "a"', "no figure"),
        ('[[link]]\nname = "a"\nrms = "x"', "plumbline: chain.toml, row 3, [link] rms: found 'x'"),
        ('[[link]]\nname = "a"\nrms = 1e-3\n[[link]]\nname = "b"\nrms = -1.0', "row 6, [link] rms"),
        ('[[link]]\nname = "a"\nrms = 1e-3\nsdt = 1.0', "row 4, [link] sdt"),
        ('[[link]]\nname = "a"\nrms = 1e-3\ndof = 0', "a number above 0"),
        ('[[link]]\nname = "a"\nrms = 1e-3\nmean = [0, 0, 0]', "not beside rms"),
        ('[[link]]\nname = "a"\nstd = -1e-3', "at least 0"),
        ('[[link]]\nname = "a"\nrms = 1e-3\ncured = -1', "[link] cured"),
        ('[[link]]\nname = "a"\nanswer = "none.json"', "row 3, [link] answer: found 'none.json'"),
        ('[[link]]\nname = "a"\nanswer = "broken.json"', "no JSON"),
        ('[[link]]\nname = "a"\nanswer = "broken.toml"', "broken.toml"),
        ('[[link]]\nname = "a"\nanswer = "budget.json"', "a Budget, expected"),
        ('[[link]]\nname = "a"\nanswer = "markers.json"', "a place in CT"),
        ('[[link]]\nname = "a"\nanswer = "markers.json"\ntarget = "b"', "expected one of none"),
        ('[[link]]\nname = "a"\nanswer = "beam.json"\nrange = 350', "found 350, expected a range"),
        ('[[link]]\nname = "a"\nanswer = "markers.json"\nrms = 1.0', "found the key 'rms'"),
        ("[[link]\n", "broken TOML"),
        ("\x00", "chain.toml"),
    ],
)
def test_a_damaged_chain_is_refused_in_one_line(text, words, beam, tmp_path, capsys):
    (tmp_path / "chain.toml").write_text(text)
    (tmp_path / "broken.json").write_text('{"format": ')
    (tmp_path / "broken.toml").write_text("[gap\n")
    add_up([Source.of_rms("a", 1e-3)]).save(tmp_path / "budget.json")
    if "markers" in text:
        markers().save(tmp_path / "markers.json")
    beam[0].save(tmp_path / "beam.json")
    assert run(["budget", str(tmp_path / "chain.toml")]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert (said.count("\n"), said.count("chain.toml") < 2) == (1, True)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: Source.of_tracking("a", np.zeros((3, 3)), np.zeros((3, 3))), "N at least 4"),
        (lambda: Source.of_tracking("a", np.zeros((9, 3)), np.full((9, 3), np.nan)), "not finite"),
        (lambda: add_up([Source.of_rms("a", 1e-3)]).to_gain(1.0), "ask for another gain"),
    ],
)
def test_what_is_no_loop_and_no_gain_is_refused(ask, words):
    with pytest.raises(PlumblineError, match=words):
        ask()
