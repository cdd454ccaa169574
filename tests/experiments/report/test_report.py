"""A report is whole in one file, the same every time, and shows what is there and no more."""

from __future__ import annotations

import html
import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from plumbline.experiments.report.diagnosis import figures
from plumbline.experiments.report.diagnosis import pictures as pictures_module
from plumbline.experiments.report.diagnosis.arm import (
    arm,
    project,
    skeleton,
    typical_posture,
    upright,
)
from plumbline.experiments.report.diagnosis.causes import ranked, staircase
from plumbline.experiments.report.diagnosis.page import in_words
from plumbline.experiments.report.diagnosis.page import page as page_of
from plumbline.experiments.report.diagnosis.phrases import Elsewhere
from plumbline.experiments.report.diagnosis.pictures import _joint_told, pictures
from plumbline.experiments.report.diagnosis.subject import Subject, running
from plumbline.experiments.report.page.page import page_html
from plumbline.experiments.report.page.words import print_page
from plumbline.experiments.report.style import svg
from plumbline.experiments.report.writing import card_of as card
from plumbline.experiments.report.writing import write_report
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.quantities import chance, measured, percent, quantity, significant
from plumbline.optim.diagnosis.findings import (
    Blame,
    Cause,
    Estimate,
    Gap,
    NoiseLevel,
    Outcome,
    Place,
    Step,
    Verdict,
)
from plumbline.optim.diagnosis.of_recordings import JointGap, OfRecording
from plumbline.optim.diagnosis.verdict.tree import tree_of
from plumbline.optim.diagnosis.verdict.words import (
    gap_words,
    held_words,
    merged,
    noise_words,
    parameter_name,
    ripple_words,
    ripples,
    shared_words,
    tree_lines,
    variants_words,
    without_words,
)
from plumbline.optim.recording.loading import load_recording
from tests.made_up_diagnosis import MadeUp, made_up
from tests.recording_folders import write_folder

KINDS = ("tip_position", "pose", "fixed_point", "joint_position")
HOSTILE = "<b>&\"'</b><script>alert(1)</script>"
NOTHING = Gap("m", 2e-4, 2e-4, 1.5e-4, 0.0, (math.nan, math.nan))
VOID = {"meta", "br", "link", "img", "input", "hr"}


def html_report(diagnosis, **more):
    return page_html(page_of(diagnosis, proof=False, **more))


@pytest.fixture(scope="module")
def bench() -> MadeUp:
    return made_up()


@pytest.fixture(scope="module")
def page(bench: MadeUp) -> str:
    return html_report(bench)


@pytest.fixture(scope="module", params=KINDS)
def of_each_kind(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> MadeUp:
    folder = write_folder(tmp_path_factory.mktemp(request.param), request.param)
    return made_up(load_recording(folder))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without pictures, which take the longest."""
    monkeypatch.setattr(pictures_module, "pictures", lambda subject: ())


SCRIPT = (files("plumbline.experiments.report") / "page/script.js.j2").read_text().strip()


def scripts(text: str) -> list[str]:
    """What stands in the script elements of a page: the house's own, and no word of the data."""
    return [
        found.strip() for found in re.findall(r"<script\b[^>]*>(.*?)</script>", text, re.DOTALL)
    ]


class Tags(HTMLParser):
    """Tags, ids and links of a page; unbalanced ones are kept in ``open``."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: set[str] = set()
        self.ids: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        given = dict(attrs)
        self.ids += [given["id"] or ""] if "id" in given else []
        self.links += [given[k] or "" for k in ("src", "href", "xlink:href") if k in given]

    def handle_endtag(self, tag: str) -> None:
        assert self.open
        assert self.open.pop() == tag


def tags(text: str) -> Tags:
    found = Tags()
    found.feed(text)
    return found


def said(verdict: Verdict, elsewhere: Elsewhere | None = None, width: int = 100) -> str:
    """What the terminal shows, on one line."""
    console = Console(file=io.StringIO(), width=width)
    print_page(in_words(SimpleNamespace(verdict=verdict), elsewhere), console)
    return " ".join(console.file.getvalue().split())


def test_a_report_needs_nothing_but_itself(page):
    found = tags(page)
    assert not found.open
    assert not {"link", "iframe", "object", "img"} & found.names
    assert scripts(page) == [SCRIPT]
    assert found.links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in found.links)
    assert "@import" not in page
    assert set(re.findall(r"url\((.)", page)) <= {"#"}


def test_every_reference_inside_of_a_report_is_met_once(page):
    ids = tags(page).ids
    assert len(ids) == len(set(ids))
    referred = set(re.findall(r'(?:url\(#|href="#)([\w-]+)', page))
    assert referred
    assert referred <= set(ids)


def test_the_same_diagnosis_gives_the_same_bytes_and_distrusted_rows_are_in_no_picture(
    page, tmp_path
):
    again = made_up()
    extreme = again.residual_after.copy()
    extreme[~again.trusted] = 1e3
    again = replace(again, residual_after=extreme)
    assert write_report(again, tmp_path / "report.html").read_bytes() == page.encode()


def test_a_report_names_no_place_and_no_time_of_its_making(page):
    assert "/work" not in page
    assert str(math.inf) not in page
    assert not re.search(r"\b20\d\d-\d\d-\d\d", page)


def test_names_of_the_data_are_escaped_wherever_they_appear(bench):
    blame = Blame(HOSTILE, "link", 2, HOSTILE)
    cause = Cause(
        HOSTILE,
        HOSTILE,
        1,
        probability=0.9,
        parameters={HOSTILE: Estimate(1.0, 0.1, HOSTILE, doc=HOSTILE)},
        confounded_with=(blame,),
        words=HOSTILE,
    )
    verdict = replace(
        bench.verdict,
        causes=(cause,),
        candidates=(cause,),
        unobservable=(blame,),
        outside_depends_on=HOSTILE,
        staircase=(Step(HOSTILE, 1e-4),),
        notes=(HOSTILE,),
        recording=HOSTILE,
        next=({HOSTILE: HOSTILE},),
    )
    elsewhere = Elsewhere(HOSTILE, 3, 1e-3, 1e-4, "m")
    recording = replace(bench.recording, name=HOSTILE, notes=(HOSTILE,))
    text = html_report(replace(bench, verdict=verdict, recording=recording), elsewhere=elsewhere)
    for shown in (text, card(verdict)):
        found = tags(shown)
        assert not found.open
        assert scripts(shown) == [SCRIPT] * (shown is text)
        assert HOSTILE not in shown
        assert "<b>&amp;" not in shown
        assert "&lt;script&gt;" in shown


def test_square_brackets_in_names_are_shown_not_obeyed(bench):
    verdict = replace(bench.verdict, recording="[red]a[/red]", notes=("[link=x]b[/link]",))
    text = said(verdict)
    assert "[red]a[/red]" in text
    assert "[link=x]b[/link]" in text


def test_every_kind_of_observation_has_its_pictures(of_each_kind):
    shown = {picture.key: picture for picture in pictures(Subject.of(of_each_kind))}
    n = of_each_kind.recording.chain.n
    assert {"where", "staircase", "ranking", "joints", "time", "noise"} <= set(shown)
    assert ("workspace" in shown) == (of_each_kind.recording.observation != "joint_position")
    assert len(shown["joints"].figures) == n
    assert all(isinstance(f, Figure) for p in shown.values() for f in p.figures)
    assert all(p.title and p.words.endswith(".") for p in shown.values())


def test_every_kind_of_observation_has_a_report_in_its_unit(of_each_kind):
    text = html_report(of_each_kind)
    encoders = of_each_kind.recording.observation == "joint_position"
    assert f"{quantity(of_each_kind.verdict.gap.before, 'rad' if encoders else 'm')}" in text
    assert ("residual [mrad]" in text) == encoders
    assert ("size of residual [mm]" in text) != encoders


def test_encoders_with_velocity_are_drawn_over_it(of_each_kind):
    q = of_each_kind.recording.q
    moving = replace(
        of_each_kind, recording=replace(of_each_kind.recording, velocity=q - q.mean(0))
    )
    drawn = figures.over_velocity(Subject.of(moving))
    encoders = of_each_kind.recording.observation == "joint_position"
    assert len(drawn) == (q.shape[1] if encoders else 0)


def test_without_time_there_is_no_picture_of_time(bench):
    timeless = replace(bench, recording=replace(bench.recording, time=None))
    assert "time" not in {p.key for p in pictures(Subject.of(timeless))}


def test_a_verdict_without_causes_has_its_pictures(bench):
    verdict = Verdict(Outcome.NO_GAP, NOTHING)
    shown = pictures(Subject.of(replace(bench, verdict=verdict)))
    assert {picture.key for picture in shown} == {"workspace", "joints", "time", "noise"}
    assert all(svg(f, "a", "b") for picture in shown for f in picture.figures)


@pytest.mark.parametrize("kind", list(Outcome))
def test_a_verdict_without_causes_is_shown_too(bench, kind, undrawn):
    verdict = Verdict(kind, NOTHING, rows=90)
    text = html_report(replace(bench, verdict=verdict))
    assert "nan" not in text
    shown = kind.value.replace("-", " ").capitalize()
    assert all(shown in one for one in (text, said(verdict), card(verdict)))


def test_large_clouds_become_pixels_and_small_ones_stay_sharp(bench):
    many = np.tile(np.arange(len(bench.recording)), 30)
    large = MadeUp(
        bench.recording.select(many),
        bench.verdict,
        bench.residual_before[many],
        bench.residual_after[many],
        np.ones(len(many), dtype=bool),
        bench.places[many],
    )
    drawn = [svg(figures.over_joints(Subject.of(d))[0], "a", "b") for d in (bench, large)]
    assert ["data:image/png;base64," in text for text in drawn] == [False, True]
    assert len(drawn[1]) < 400_000


def test_the_terminal_says_what_the_verdict_says(bench):
    text = said(bench.verdict, Elsewhere("bench-2", 80, 6e-4, 1.6e-4, "m"))
    gap = bench.verdict.gap
    assert f"gap before {quantity(gap.before, 'm')} gap after {quantity(gap.after, 'm')}" in text
    for words in (
        "bench-ur5: Explained",
        "1. joint_compliance of joint 2 probability > 99 %",
        "8.40 ± 0.40 µrad/(N m)",
        "-0.610 mrad, at its bound",
        "Of what the causes explain: joint 2 62 %",
        "cannot tell joint_compliance of joint 2 from link_flex of link 2",
        "cannot see hysteresis of joints 4, 5, 6: no row excites it",
        "2 rows were taken for gross errors, the header being row 1: 17, 54.",
        "On bench-2 (80 rows)",
        "0.160 mm",
    ):
        assert words in text


TREE = (
    {
        "stage": "joint",
        "element": 2,
        "probability": 0.97,
        "dependences": [
            {
                "on": "own angle",
                "probability": 0.9,
                "mechanisms": [
                    {"effect": "joint_scale", "probability": 0.8},
                    {"effect": None, "probability": 0.1},
                ],
            },
            {
                "on": "load",
                "probability": 0.07,
                "mechanisms": [{"effect": "joint_compliance", "probability": 0.07}],
            },
            {"on": "time", "probability": 1e-3, "mechanisms": []},
        ],
    },
    {"stage": "base", "element": None, "probability": 1e-3, "dependences": []},
)
TREE_LINE = (
    "joint 2 97 %: own angle 90 % (joint_scale 80 %, unlisted 10 %), load 7 % (joint_compliance)"
)


def test_card_terminal_and_page_tell_the_place_before_what_may_be_at_work_there(bench, undrawn):
    verdict = replace(bench.verdict, tree=TREE)
    page = html_report(replace(bench, verdict=verdict))
    for shown in (said(verdict), html.unescape(card(verdict)), html.unescape(page)):
        assert TREE_LINE in shown
    assert tree_lines(verdict) == (TREE_LINE,)
    assert "What may be at work" not in said(bench.verdict)


def test_what_is_at_work_together_is_told_as_sure_as_its_cause_is():
    tree = tree_of(
        {("joint", 2): 1.0},
        {("joint", 2, "load", "joint_compliance"): 0.999, ("joint", 2, "own angle", None): 0.97},
    )
    (line,) = tree_lines(SimpleNamespace(tree=tree))
    assert line == "joint 2 > 99 %: load > 99 % (joint_compliance), own angle 97 % (unlisted)"
    assert sum(d["probability"] for d in tree[0]["dependences"]) == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "of"), [("m", "axis"), ("N m", "joint"), ("rad", "joint")])
def test_noise_is_of_an_axis_of_places_and_of_a_joint_of_what_joints_do(unit, of):
    assert f" per {of} (1 sigma)" in noise_words(NoiseLevel(0.1, "given", 1.0), unit)


def test_what_is_outside_is_told_with_what_may_be_at_work_not_as_unknown(bench, undrawn):
    verdict = replace(bench.verdict, tree=TREE, outside_probability=0.98)
    for shown in (said(verdict), html.unescape(html_report(replace(bench, verdict=verdict)))):
        told, unknown = shown.split("What this recording cannot tell")
        assert "something outside of the library: 98 %" in told
        assert "outside of the library" not in unknown


def test_a_cause_says_how_much_hangs_on_prior_odds_where_it_does(bench, undrawn):
    first, *others = bench.verdict.causes
    line = "71 % to 96 % with prior odds a third to three times as high"
    for sensitivity, told in (((0.71, 0.96), True), ((0.9991, 0.9994), False), (None, False)):
        causes = (replace(first, sensitivity=sensitivity), *others)
        verdict = replace(bench.verdict, causes=causes)
        assert (line in said(verdict)) == told
        assert (line in html_report(replace(bench, verdict=verdict))) == told


def test_the_card_tells_what_is_alike_from_what_is_not_seen(bench):
    text = html.unescape(card(bench.verdict))
    assert "<li>cannot tell joint_compliance of joint 2 from link_flex of link 2</li>" in text
    assert "<li>cannot see hysteresis of joints 4, 5, 6: no row excites it</li>" in text
    assert "outside of the library" not in text.split("What this recording cannot tell")[1]


@pytest.mark.parametrize(
    ("depends_on", "sentence"),
    [
        ("the temperature", "what is left depends on the temperature"),
        (
            "joint 1's error depends on its speed",
            "what is left: joint 1's error depends on its speed",
        ),
    ],
)
def test_card_terminal_and_page_tell_of_an_unknown_in_the_same_words(
    bench, depends_on, sentence, undrawn
):
    """What is told in a sentence of its own is not put into another one."""
    verdict = replace(
        bench.verdict,
        verdict=Outcome.PARTLY,
        outside_probability=1.0,
        outside_depends_on=depends_on,
    )
    page = html_report(replace(bench, verdict=verdict))
    for shown in (html.unescape(page), html.unescape(card(verdict))):
        assert "<li>something outside of the library: > 99 %</li>" in shown
        assert f"<li>{sentence}</li>" in shown
    assert sentence in said(verdict)


def test_an_unknown_that_depends_on_nothing_seen_is_on_the_card(bench):
    verdict = replace(bench.verdict, outside_probability=0.93)
    assert "something outside of the library: 93 %<" in card(verdict)


def test_dozens_of_ripple_orders_are_one_line(bench, undrawn):
    parameters = {}
    for order in range(3, 45):
        parameters[f"order {order} sine"] = Estimate(3e-5 / order, 1e-6, "rad")
        parameters[f"order {order} cosine"] = Estimate(4e-5 / order, 1e-6, "rad")
    cause = replace(bench.verdict.causes[1], parameters=parameters)
    text = said(replace(bench.verdict, causes=(cause,)))
    line = "42 orders; the strongest 3, 4, 5 per turn, of 0.0167 mrad and less"
    assert line in text
    assert "sine" not in text
    assert line in card(replace(bench.verdict, causes=(cause,)))
    assert "order 44: " in html_report(
        replace(bench, verdict=replace(bench.verdict, causes=(cause,)))
    )


def test_a_ripple_s_amplitude_and_error_are_those_of_its_parts():
    parts = {
        "order 8 sine": Estimate(3e-4, 1e-6, "rad"),
        "order 8 cosine": Estimate(4e-4, 1e-6, "rad"),
    }
    (ripple,) = ripples(Cause("gear_ripple", "joint", 1, parameters=parts))
    assert ripple.order == 8.0
    assert ripple.amplitude == pytest.approx(5e-4)
    assert ripple.std == pytest.approx(1e-6)
    assert ripple_words([ripple]) == "order 8 per turn, amplitude 0.500 mrad"


@pytest.mark.parametrize(
    ("value", "std", "unit", "words"),
    [
        (2.4031e-4, 6.1e-6, "rad", "0.2403 ± 0.0061 mrad"),
        (-1.2e-3, 3e-5, "m", "-1.200 ± 0.030 mm"),
        (8.4e-6, 4e-7, "rad/(N m)", "8.40 ± 0.40 µrad/(N m)"),
        (0.084, 2.5e-3, "rad/(N m)", "84.0 ± 2.5 mrad/(N m)"),
        (12.0, 250.0, "kg", "12.0 ± 250 kg"),
        (1.0e-3, math.nan, "m", "1.00 mm"),
        (0.0, 0.0, "m", "0 mm"),
        (-1e-9, 2e-4, "m", "0.00 ± 0.20 mm"),
        (math.nan, 1.0, "m", "unknown mm"),
    ],
)
def test_a_value_has_the_digits_that_its_error_bears(value, std, unit, words):
    assert measured(value, std, unit) == words


@pytest.mark.parametrize("effect", REGISTRY)
def test_units_are_shown_as_a_reader_writes_them(effect):
    for parameter in REGISTRY[effect].declared:
        shown = measured(parameter.scale, 0.01 * parameter.scale, parameter.unit)
        assert "^" not in shown
        assert "e-" not in shown, f"{effect}, {parameter.name}: {shown}"


@pytest.mark.parametrize(
    ("name", "variant", "shown"),
    [
        ("sine", "order 17", "order 17 sine"),
        ("sine", "orders 24 and 48", "order 24 sine"),
        ("cosine_twice", "orders 24 and 48", "order 48 cosine"),
        ("compliance", "by the measured effort", "compliance, by the measured effort"),
        ("offset", "", "offset"),
    ],
)
def test_a_parameter_is_named_before_what_tells_it_from_its_like(name, variant, shown):
    assert parameter_name(name, variant) == shown


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.8243, "0.824"), (0.08, "0.0800"), (9.999, "10.0"), (1234.5, "1234"), (2e-7, "2.00e-07")],
)
def test_significant_digits_are_three(value, words):
    assert significant(value) == words


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.999, "> 99 %"), (1.0, "100 %"), (0.001, "< 1 %"), (0.0, "0 %"), (0.874, "87 %")],
)
def test_what_is_not_certain_never_reads_as_certain(share, words):
    assert percent(share) == words


@pytest.mark.parametrize(("probability", "words"), [(1.0, "> 99 %"), (0.0, "< 1 %"), (0.5, "50 %")])
def test_no_probability_is_called_certain(probability, words):
    assert chance(probability) == words


def test_alike_blames_are_one_line_with_the_largest_number():
    blames = [
        Blame("link_flex", "link", k, f"its signal is {v} times the noise")
        for k, v in ((5, 0.03), (4, 0.2))
    ]
    blames += [Blame("latency", "sensor", None, "needs the column velocity")]
    assert merged(blames) == (
        "link_flex of links 4, 5: its signal is at most 0.2 times the noise",
        "latency: needs the column velocity",
    )
    assert merged(blames, why=False) == ("link_flex of links 4, 5", "latency")


def test_effects_unseen_at_the_same_places_for_the_same_reason_are_one_line():
    why = "at its usual size its whole signal is {} times the noise"
    blames = [
        Blame(effect, "joint", k, why.format(size))
        for effect, size in (("joint_scale", 0.02), ("gear_ripple", 0.04))
        for k in (5, 6)
    ]
    blames += [Blame("backlash", "joint", 6, "no row excites it")]
    assert merged(blames) == (
        "joint_scale, gear_ripple of joints 5, 6: "
        "at their usual size their whole signal is at most 0.04 times the noise",
        "backlash of joint 6: no row excites it",
    )


def test_the_joint_that_is_told_is_the_one_whose_own_residual_shrinks_most():
    before = np.array([[9.0, 0.4]] * 5)
    subject = SimpleNamespace(
        before=before, after=before * [1.0, 0.5], encoder_columns={0: 0, 4: 1}, unit="N m"
    )
    assert _joint_told(subject).startswith("Joint 5 gains most: 0.400 N m")
    subject.after = before
    assert _joint_told(subject).startswith("Joint 1 disagrees most: 9.00 N m")


def test_where_no_cause_is_named_no_picture_speaks_of_one(bench):
    verdict = replace(bench.verdict, causes=())
    shown = replace(bench, verdict=verdict, residual_after=bench.residual_before)
    titles = [picture.title for picture in pictures(Subject.of(shown))]
    assert titles[0] == "62 % of the gap points to joint 2"
    assert not any(word in title for title in titles for word in ("explained", "where it was"))


def test_a_tree_tells_every_place_where_something_may_be_at_work():
    places = {("joint", k): 1.0 - 0.1 * k for k in range(1, 7)} | {("joint", None): 0.12}
    tree = tree_of(places, {(*place, "load", None): p for place, p in places.items()})
    *_, elsewhere = lines = tree_lines(SimpleNamespace(tree=tree))
    assert elsewhere == "elsewhere: joint 6 40 %, all joints 12 %"
    assert len(lines) == 6


def test_what_leaves_the_gap_after_is_told_with_what_has_no_name(bench):
    verdict = bench.verdict
    steps = [Step("frame and tool alone", 1.0), *(Step(c.label, 0.5) for c in verdict.causes)]
    shown = replace(verdict, staircase=(*steps, Step("base_drift", 0.3)))
    assert held_words(replace(verdict, staircase=tuple(steps))) == "3 causes"
    drives = replace(verdict, staircase=(Step("before", 1.0), Step("drive 2", 0.3)))
    assert held_words(drives) == "3 causes"
    assert "with 3 causes and 1 unnamed effect in it, by" in gap_words(shown)
    assert held_words(replace(shown, causes=())) == "4 unnamed effects"


@pytest.mark.parametrize("most", [0.6, 0.84])
def test_one_probability_of_many_causes_says_where_it_comes_from(most):
    causes = [SimpleNamespace(probability=p) for p in (most, most + 1e-4, most - 1e-3, 0.99)]
    told, said = SimpleNamespace(causes=causes, outside_probability=0.99), f"{100 * most:.0f} %"
    assert shared_words(told).startswith(f"3 causes stand at {said}: something unlisted is at work")
    assert shared_words(SimpleNamespace(causes=causes[1:], outside_probability=0.99)) == ""
    assert shared_words(SimpleNamespace(causes=causes, outside_probability=0.01)) == ""


@pytest.mark.parametrize(
    ("at", "said"), [(("link", None), "all links"), (("sensor", None), "the sensor")]
)
def test_a_place_without_a_number_has_its_article(bench, at, said):
    verdict = replace(bench.verdict, where=(Place(*at, 1.0),))
    shown = {p.key: p for p in pictures(Subject.of(replace(bench, verdict=verdict)))}
    assert f"comes from {said}" in shown["where"].title


@pytest.mark.parametrize("stage", ["joint", "actuation"])
def test_a_guilty_joint_s_disc_is_coloured_its_drive_s_too(stage):
    shown = made_up()
    guilty = replace(shown.verdict, where=(Place(stage, 2, 1.0),))
    discs = [
        line.get_color()
        for line in arm(Subject.of(replace(shown, verdict=guilty))).axes[0].lines
        if line.get_markersize() == 15
    ]
    assert len(set(discs)) == 2
    assert discs.count(discs[1]) == 1


def test_the_arm_s_joints_are_where_the_chain_has_them(bench):
    chain, q = bench.recording.chain, bench.recording.q[7]
    body = skeleton(chain, q, bench.recording.tool_offset)
    T = chain.placement(q)[0]
    np.testing.assert_allclose(body.tool[0], T[:3, 3], atol=1e-12)
    tip = T[:3, :3] @ bench.recording.tool_offset + T[:3, 3]
    np.testing.assert_allclose(body.tool[1], tip, atol=1e-12)
    for joint, link in zip(body.joints, body.links, strict=True):
        np.testing.assert_allclose(link[0], joint, atol=1e-12)
        assert (link[1] - link[0]) @ (link[2] - link[1]) == pytest.approx(0.0, abs=1e-12)


def test_the_projection_keeps_lengths_that_face_the_eye():
    azimuth = 0.7
    across = np.array([[-np.sin(azimuth), np.cos(azimuth), 0.0]])
    assert np.linalg.norm(project(across, azimuth)) == pytest.approx(1.0)
    assert np.linalg.norm(project(np.array([[0.0, 0.0, 1.0]]), azimuth)) < 1.0


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (0, 0, 9.81), (9.81, 0, 0), (1, -5, 2)])
def test_gravity_points_down_the_paper_whatever_the_mounting(gravity):
    R = upright(np.array(gravity, dtype=float))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    down = R @ np.array(gravity, dtype=float)
    np.testing.assert_allclose(down, [0, 0, -np.linalg.norm(gravity)], atol=1e-12)


def test_the_typical_posture_was_recorded(bench):
    q = typical_posture(bench.recording.q)
    assert (bench.recording.q == q).all(axis=1).any()


def test_a_running_median_follows_the_middle():
    x = np.random.default_rng(0).uniform(0.0, 1.0, 2000)
    middle, median = running(x, 3.0 * x)
    np.testing.assert_allclose(median, 3.0 * middle, rtol=1e-12)
    assert len(running(x[:10], x[:10])[0]) == 0


def test_causes_lead_the_ranking_and_improbable_rivals_are_left_out(bench):
    rivals = [Cause("backlash", "joint", k, probability=1e-4 * k) for k in range(1, 31)]
    shown = ranked(replace(bench.verdict, candidates=(*rivals, *bench.verdict.causes)))
    assert len(shown) == 6
    assert {c.effect for c in shown[:3]} == {c.effect for c in bench.verdict.causes}
    assert [c.element for c in shown[3:]] == [30, 29, 28]


def test_the_staircase_says_how_it_goes_with_the_gap(bench):
    def words(verdict):
        shown = pictures(Subject.of(replace(bench, verdict=verdict)))
        return next(picture.words for picture in shown if picture.key == "staircase")

    assert "The last bar is the gap's own" in words(bench.verdict)
    alone = (Step("frame and tool alone", 1e-4),)
    assert "in proportion" not in words(replace(bench.verdict, causes=(), staircase=alone))


def test_the_staircase_starts_at_the_gap_and_ends_at_what_is_left(bench):
    axes = staircase(bench.verdict).axes[0]
    widths = [bar.get_width() for bar in axes.patches]
    gap = bench.verdict.gap
    assert widths[0] == pytest.approx(1e3 * gap.before)
    assert widths[-1] == pytest.approx(1e3 * gap.after)
    led = replace(
        bench.verdict, staircase=(Step("frame and tool alone", gap.before), Step("x", gap.after))
    )
    bars = staircase(led).axes[0].patches
    assert len(bars) == 2


def test_a_staircase_of_nothing_has_a_floor_to_stand_on(bench):
    nothing = Gap("rad", 0.0, 0.0, 0.0, 0.0, (0.0, 0.0))
    verdict = replace(bench.verdict, gap=nothing, staircase=(Step("frame and tool alone", 0.0),))
    axes = staircase(verdict).axes[0]
    assert axes.get_xlim()[1] > 0.0


def test_a_variant_lists_every_order_once():
    said = ["order 1", "", "orders 1 and 2", "order 50.5", "stiffening", "order 50.5"]
    assert variants_words(said) == "orders 1, 2 and 50.5; stiffening"
    assert variants_words(["order 2"]) == "order 2"
    apart = ["in b, order 88", "order 3", "in b, order 5.63", "in c, order 3", "in b, soft"]
    assert variants_words(apart) == "in b, orders 5.63 and 88; order 3; in c, order 3; in b, soft"
    assert variants_words([]) == ""


def test_a_direction_is_told_to_four_digits():
    sag = REGISTRY["needle_sag"](axis=(0.25390968140331077, 0.12049950981852037, 0.9596925246))
    assert "(0.2539, 0.1205, 0.9597)" in sag.variant
    assert not re.search(r"[0-9]{7}", sag.variant + sag.tag)


def test_what_is_left_is_one_figure_wherever_it_is_said(bench):
    """The gap with all causes; a cause says how many times as much is left without it."""
    out = io.StringIO()
    print_page(in_words(bench), Console(file=out, width=400))
    gap, causes = bench.verdict.gap, bench.verdict.causes
    other = replace(bench.verdict, causes=tuple(replace(c, after=0.9 * c.after) for c in causes))
    for shown in (out.getvalue(), card(bench.verdict)):
        assert quantity(gap.after, gap.unit) in shown
        assert all(without_words(cause).capitalize() in shown for cause in causes)
    for cause in other.causes:
        assert quantity(cause.after, gap.unit) not in card(other)


def test_without_a_cause_as_many_times_as_much_is_left_as_its_figures_say(bench):
    cause = replace(bench.verdict.causes[0], before=3.4e-4, after=1e-4)
    assert without_words(cause) == "without it 3.4 times as much is left"
    assert without_words(replace(cause, before=1.003e-4)) == "without it 1.00 times as much is left"
    assert without_words(replace(cause, after=math.nan)) == ""


def test_a_terminal_tells_the_values_of_six_causes_and_names_every_one(bench):
    causes = tuple(replace(bench.verdict.causes[0], element=k) for k in range(1, 9))
    shown = said(replace(bench.verdict, causes=causes))
    sentence = causes[0].words.split(" ", 2)[2]  # after "joint 2"
    assert shown.count(sentence) == 6
    assert all(f"{cause.label} " in shown for cause in causes)
    assert "2 further causes, with values in JSON and report" in shown
    assert "further cause" not in said(replace(bench.verdict, causes=causes[:6]))


def test_page_and_card_fold_all_causes_but_six(bench, undrawn):
    causes = tuple(replace(bench.verdict.causes[0], element=k) for k in range(1, 9))
    for many, folded in ((causes, 2), (causes[:7], 1), (causes[:6], 0)):
        told = replace(bench, verdict=replace(bench.verdict, causes=many))
        for shown in (html_report(told), card(told.verdict)):
            first, _, more = shown.partition("further cause")
            assert all(f"{cause.label}<" in first for cause in many[:6])
            assert all(f"{cause.label}<" in more.split("</details>")[0] for cause in many[6:])
            assert ("further cause" in shown) == bool(folded)


def test_the_gap_is_told_joint_by_joint_where_joints_are_measured_by_themselves(bench, undrawn):
    joints = (JointGap(1, "joint 1", 0.0123, 1e-3, "rad"), JointGap(2, "joint 2", 2.5, 0.75, "N m"))
    told = replace(bench, verdict=replace(bench.verdict, joints=joints))
    for shown in (said(told.verdict), html_report(told)):
        before, _, after = shown.lower().partition("joint by joint")
        assert "12.3 mrad" not in before
        assert all(x in after for x in ("12.3 mrad", "1.00 mrad", "2.50 n m", "0.750 n m"))
    assert "joint by joint" not in said(bench.verdict).lower()
    assert "joint by joint" not in html_report(bench).lower()


def test_a_terminal_of_80_columns_keeps_recordings_apart_that_begin_alike(bench):
    names = [f"transmission-of-the-bench-on-{day}" for day in ("monday", "moonday")]
    alike = [OfRecording(n, "tip_position", 40, "m", 2e-3, 1e-4, 1e-4, 1e-4, "fit") for n in names]
    verdict = replace(bench.verdict, recordings=tuple(alike))
    console = Console(file=io.StringIO(), width=80)
    print_page(in_words(SimpleNamespace(verdict=verdict)), console)
    table = console.file.getvalue().split("Recording by recording")[1]
    lines = table.strip("\n").split("\n\n")[0].splitlines()[1:]  # below what it is of
    assert not any("…" in line for line in lines)
    wide = next(k for k in range(80) if all(line[2 + k : 3 + k].strip() == "" for line in lines))
    whole = "".join(line[: 2 + wide].strip() for line in lines)
    assert all(name in whole for name in names)


@pytest.mark.parametrize(
    ("many", "probability", "bars"), [(5, 0.011, 5), (5, 0.009, 3), (12, 0.5, 10)]
)
def test_rivals_of_a_hundredth_and_three_at_least_ten_at_most_have_a_bar(many, probability, bars):
    rivals = [
        SimpleNamespace(effect=f"effect {k}", element=None, probability=probability)
        for k in range(many)
    ]
    assert len(ranked(SimpleNamespace(causes=(), candidates=rivals))) == bars
