"""Every method has a report of one kind: whole in itself, escaped, saying how it was made."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpl_toolkits.mplot3d.proj3d import proj_transform

import plumbline.experiments
from plumbline import PlumblineError, fit_dh, load, register, write_report
from plumbline.experiments.commands.app import run
from plumbline.experiments.report.dh_fit.page import page as fit_page
from plumbline.experiments.report.diagnosis import pictures as pictures_module
from plumbline.experiments.report.diagnosis.rows import band, picture
from plumbline.experiments.report.diagnosis.subject import Subject
from plumbline.experiments.report.diagnosis.turned import scene, turned
from plumbline.experiments.report.drawn import of_diagnosis
from plumbline.experiments.report.page.page import PICTURES, Grid, Made, Page, Part, page_html
from plumbline.experiments.report.registration.figures import misfits_and_targets
from plumbline.experiments.report.reproduction import compared
from plumbline.experiments.report.style import by_depth, house_style, new_figure, numbered, svg
from plumbline.experiments.report.writing import PAGES, card_of, report_html
from plumbline.experiments.reproduce import Compared, Reproduction, Table, figure
from plumbline.optim.core.answer import Answer
from plumbline.optim.hand_eye.answer import HandEye
from plumbline.optim.hand_eye.calibrate import calibrate
from plumbline.optim.registration import MarkerNoise, ThreePoint
from tests.experiments.report.test_report import HOSTILE, SCRIPT, scripts, tags
from tests.fuzz.recordings import sound
from tests.made_up_diagnosis import BENCH, made_up
from tests.phantoms import registered
from tests.ranging_scenes import CLEAN, surveyed

CT = np.array([(0.01, 0.02, 0.147), (0.11, 0.12, 0.147), (0.06, -0.01, 0.08)])


def a_registration():
    noise = MarkerNoise.from_resolution(1e-3 * np.ones(3), 1e-4)
    return registered(ThreePoint(), CT, CT + 0.1, noise, ["A", HOSTILE, "C"])


def a_fit():
    return fit_dh(load(BENCH))


def a_hand_eye():
    _, _, readings = surveyed(0, CLEAN)
    return HandEye(HOSTILE, 90, calibrate(readings), (), np.empty(0), None, 0.0, 1e-4, (), ("a",))


def a_reproduction():
    table = Table("Runs", ("family", "least clearance"), (("a", "2 mm"), (HOSTILE, "10 mm")))
    rows = (("a", figure(2.0, "mm", 1.5, std=0.5)), (HOSTILE, figure(30.0, "mm", asked=2.0)))
    shown = (Compared(f"Least clearance {HOSTILE}", rows),)
    return Reproduction("MPC", "a paper", {}, (table,), ("a note",), compared=shown)


MAKERS = (a_registration, a_fit, a_hand_eye, a_reproduction)


@pytest.fixture(scope="module", params=MAKERS, ids=lambda make: make.__name__)
def answer(request):
    return request.param()


@pytest.fixture(scope="module")
def page(answer):
    return report_html(answer)


def test_a_page_needs_nothing_but_itself_and_is_the_same_every_time(answer, page):
    found = tags(page)
    assert not found.open
    assert not {"link", "iframe", "object", "img"} & found.names
    assert scripts(page) == [SCRIPT]
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in found.links)
    assert len(found.ids) == len(set(found.ids))
    assert report_html(answer) == page
    assert not re.search(r"\b20\d\d-\d\d-\d\d", page)


def test_no_column_of_a_table_is_empty(tmp_path):
    for name, text in sound("fiducials").items():  # a target whose place was not measured
        (tmp_path / name).write_text(text)
    for grid in re.findall(r"<table.*?</table>", report_html(register(tmp_path)), re.DOTALL):
        rows = re.findall(r"<tr>(.*?)</tr>", grid, re.DOTALL)[1:]
        cells = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in rows]
        assert all(any(column) for column in zip(*cells, strict=True))


def test_words_of_the_data_are_escaped_on_every_page_and_card(answer, page):
    for shown in (page, card_of(answer)):
        assert HOSTILE not in shown
        assert "<script>alert" not in shown


def test_a_page_says_when_and_by_which_command_it_was_made(answer, tmp_path):
    text = write_report(
        answer, tmp_path / "a.html", Made("2026-01-02 03:04", "plumbline <x>")
    ).read_text()
    assert "2026-01-02 03:04" in text
    assert "<code>plumbline &lt;x&gt;</code>" in text
    assert "plumbline-robotics 0." in text
    assert re.match(r"20\d\d-\d\d-\d\d \d\d:\d\d", Made.now().date)


def test_a_page_that_cannot_be_written_is_refused_in_one_line(answer, tmp_path):
    with pytest.raises(PlumblineError, match=r"a\.html: cannot be written \(No such file"):
        write_report(answer, tmp_path / "none" / "a.html")


def test_what_has_no_page_is_refused_with_what_has():
    with pytest.raises(PlumblineError, match="object: there is none, expected one of Registration"):
        report_html(object())
    assert set(Answer.kinds) <= set(PAGES) | {"Made", "WithVerdict"}


def test_a_table_says_whether_a_click_sorts_it():
    def made(sorts):
        part = Part("t", (), Grid(("a",), (("1",),), (0,), sorts))
        return page_html(Page("n", "v", "explained", (), (), (part,)))

    assert '<table class="sorts">' in made(True)
    assert '<table class="sorts">' not in made(False)


def test_points_say_their_row_when_the_pointer_rests_on_them():
    with house_style():
        figure = new_figure(3, 3)
        numbered(figure.add_subplot().scatter(range(40), range(40)), np.arange(40) + 7)
    text = svg(figure, "k", "l")
    assert re.findall(r"<title>row (\d+)</title></use>", text) == [str(k + 7) for k in range(40)]
    assert not tags(text).open
    diagnosis = made_up()
    said = set(re.findall(r"<title>row (\d+)</title>", report_html(diagnosis)))
    assert said == {str(k + 2) for k in np.flatnonzero(diagnosis.trusted)}


def test_points_in_space_say_their_row_whichever_is_drawn_first():
    rng = np.random.default_rng(0)
    places = rng.uniform(-1.0, 1.0, (20, 3)) * [3.0, 1.0, 0.5]
    with house_style():
        figure = new_figure(4, 4)
        axes = figure.add_subplot(projection="3d")
        cloud = axes.scatter(*places.T)
        axes.set_aspect("equal")
        order = by_depth(axes, places)
        numbered(cloud, order)
    drawn = re.findall(r'<use [^>]*x="([-.\d]+)" y="([-.\d]+)"[^>]*><title>row (\d+)',
                       svg(figure, "k", "l"))  # fmt: skip
    x, y = np.array([[float(a), float(b)] for a, b, _ in drawn]).T
    rows = [int(row) for *_, row in drawn]
    assert sorted(rows) == list(range(20)) != rows
    flat = np.array(proj_transform(*places[rows].T, axes.get_proj())[:2])
    assert np.corrcoef(x, flat[0])[0, 1] > 1.0 - 1e-9
    assert np.corrcoef(y, flat[1])[0, 1] < -1.0 + 1e-9


def test_a_bar_says_what_it_is_and_keeps_hostile_words_as_text():
    (text,) = [svg(figure, "k", "l") for figure in (misfits_and_targets(a_registration()),)]
    said = re.findall(r"<title>(.*?)</title>", text)
    assert [words.partition(": ")[0] for words in said][::2] == ["A", "C"]
    assert html.unescape(said[1]).startswith(f"{HOSTILE}: ")
    assert not tags(text).open


def test_the_scene_s_arrows_lead_from_the_model_s_tips_to_the_measured_ones():
    diagnosis = made_up()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    recording = diagnosis.recording
    tips = recording.chain.tips(recording.q, recording.tool_offset)
    moved = replace(recording, measured=tips @ turn.T + 0.5)
    left = np.tile([1e-3, 0.0, 0.0], (len(tips), 1))  # predicted less measured, device's frame
    shown = replace(diagnosis, recording=moved, residual_before=left, residual_after=left)
    found = json.loads(scene(Subject.of(shown)))
    np.testing.assert_allclose(found["after"], np.tile([0.0, 1.0, 0.0], (88, 1)), atol=1e-3)
    np.testing.assert_allclose(found["tips"], tips[diagnosis.trusted], atol=1e-4)
    assert found["rows"] == (np.flatnonzero(diagnosis.trusted) + 2).tolist()
    assert found["turns"][1] == 0.62  # a joint's own share colours its disc, not the link behind it
    assert found["shares"][1] == 0.0
    encoders = replace(recording, observation="joint_position")
    assert scene(replace(Subject.of(diagnosis), recording=encoders)) == ""


def test_ranks_are_drawn_with_the_band_that_holds_even_ones(monkeypatch):
    rng = np.random.default_rng(0)
    even = rng.multinomial(200, np.full(10, 0.1), 2000)
    low, high = band([20] * 10)
    assert np.mean((even >= low) & (even <= high)) == pytest.approx(0.96, abs=0.02)
    assert picture((20,) * 10).title.endswith(": 0 of 10 outside of the band")
    counts = (60, 10, *(15,) * 6, 10, 60)
    assert picture(counts).title.endswith(": 4 of 10 outside of the band")
    # Ranks are drawn below; no other picture is needed here, and they take the longest.
    monkeypatch.setattr(pictures_module, "pictures", lambda subject: ())
    assert 'id="ranks"' in report_html(made_up(), ranks=counts)
    assert 'id="ranks"' not in report_html(made_up())


def test_a_notebook_shows_the_report_s_scene_in_a_frame_that_fetches_nothing():
    diagnosis = made_up()
    shown = turned(diagnosis)._repr_html_()
    [page] = re.findall(r'srcdoc="([^"]*)"', shown)
    page = html.unescape(page)
    [data] = re.findall(r'data-scene="([^"]*)"', page)
    assert json.loads(html.unescape(data)) == json.loads(scene(Subject.of(diagnosis)))
    assert not tags(page).open
    assert "http" not in page
    assert of_diagnosis(diagnosis)["scene"]() == turned(diagnosis)
    encoders = replace(diagnosis.recording, observation="joint_position")
    with pytest.raises(PlumblineError, match="scene: joint_position observed, tips or poses"):
        turned(replace(diagnosis, recording=encoders))


def test_the_commands_write_their_reports(tmp_path, capsys):
    target = tmp_path / "fit.html"
    assert run(["dhfit", str(BENCH), "--report", str(target), "-q"]) == 0
    assert f"<code>plumbline dhfit {BENCH} --report {target} -q</code>" in target.read_text()
    assert run(["dhfit", str(BENCH), "--report", "-", "-q"]) == 2
    assert "standard output is for --json; name a file" in capsys.readouterr().err


def test_every_picture_of_a_name_is_drawn_and_another_name_is_refused(answer):
    if isinstance(answer, Reproduction):
        return
    assert answer.pictures
    assert all(svg(answer.plot(name), "k", "l") for name in answer.pictures)
    with pytest.raises(PlumblineError, match=f"Best matches are {answer.pictures[0]}"):
        answer.plot(answer.pictures[0][:-1])


def test_a_diagnosis_s_pictures_are_those_of_its_report():
    diagnosis = made_up()
    drawn = of_diagnosis(diagnosis)
    assert {"where", "staircase", "ranking", "workspace", "joints", "time", "noise"} <= set(drawn)
    picture = drawn["joints"]()
    assert repr(picture).startswith("<Picture 'joints': ")
    found = tags(picture._repr_html_())
    assert not found.open
    assert "script" not in found.names
    assert picture._repr_html_().count("<svg ") == 6
    assert drawn["velocity"]() is None


def test_a_reproduction_s_picture_has_our_figures_and_what_they_are_held_against():
    (shown,) = a_reproduction().compared
    (axes,) = compared(shown).axes
    marks = {
        (line.get_marker(), *line.get_xydata()[0])
        for line in axes.lines
        if len(line.get_xdata()) == 1
    }
    assert marks == {("o", 2.0, 0.0), ("D", 1.5, 0.0), ("o", 30.0, 1.0), ("D", 2.0, 1.0)}
    (spread,) = (line for line in axes.lines if np.ptp(line.get_xdata()) > 0.0)
    np.testing.assert_allclose(spread.get_xydata(), [[1.5, 0.0], [2.5, 0.0]])
    assert axes.get_xscale() == "log"
    near = compared(Compared("near", shown.rows[:1]))
    assert near.axes[0].get_xscale() == "linear"
    assert near.axes[0].get_xlabel() == "[mm]; diamonds: paper"


@pytest.mark.parametrize(("correlation", "said"), [(-0.91, 6), (0.89, 0)])
def test_of_a_fit_the_strongest_pairs_that_the_rows_hardly_tell_apart_are_said(
    monkeypatch, correlation, said
):
    fit = a_fit()
    n = len(fit.statement.names)
    every = np.full((n, n), correlation)
    every[1, 0] = -0.95
    monkeypatch.setattr(type(fit), "correlations", every)
    parts = [part for part in fit_page(fit).parts if isinstance(part, Part)]
    lines = [line for part in parts for line in part.points]
    pairs = [line for line in lines if "are correlated" in line]
    assert len(pairs) == max(said, 1)
    assert pairs[0].endswith("-0.950")
    more = n * (n - 1) // 2 - said
    assert any(f"and {more} more pairs above 0.9" in line for line in lines) == (said > 0)


def test_every_picture_that_is_told_is_drawn_and_every_one_drawn_is_told():
    rooms = [Path(plumbline.experiments.__file__).parent / name for name in ("report", "withheld")]
    sources = "".join(path.read_text() for room in rooms for path in room.rglob("*.py"))
    rooms = "|".join(PICTURES)
    named = set(re.findall(rf'"((?:{rooms})\.(?!page")\w+)(?=[{{"])', sources))
    suffixes = re.findall(r'"(_\w+)" (?:\*|if)', sources)
    told = {f"{room}.{part}" for room, table in PICTURES.items() for part in table}
    longer = {f"{name}{suffix}" for name in named for suffix in suffixes} & told
    assert named | longer == told
