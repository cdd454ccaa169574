"""The paper's five groups: before as published, after below it, by a simulator of its own."""

import json
from inspect import signature

import numpy as np
import pytest

from plumbline.experiments.reality.tip_readings import (
    SURGICAL,
    Built,
    draw_session,
    drawn_misfits,
    poses,
    registration_poses,
)
from plumbline.experiments.reproduce import PAPERS, reproduce
from plumbline.experiments.reproduce import dh_fit as module
from plumbline.experiments.reproduce.dh_fit import run
from plumbline.experiments.reproduce.dh_fit_sessions import PAPER

TABLE_BEST = 0.601  # [mm] mean of the fitted table that the paper prints
SEVERAL = 2  # of the five groups: what holds of each is asked of these


@pytest.fixture(scope="module")
def found():
    return run(1, several=SEVERAL)


def test_the_command_asks_for_all_of_the_paper_s_groups(monkeypatch):
    assert PAPERS["dh-fit"] == "dh_fit"
    assert signature(run).parameters["several"].default == len(PAPER) == 5
    monkeypatch.setattr(module, "run", lambda seed, progress: (seed, progress))
    assert reproduce("dh-fit", 4) == (4, None)


def test_before_is_the_paper_s_and_after_is_at_or_below_it(found):
    groups = found.figures["groups"]
    assert len(groups) == SEVERAL
    for group, (before, after) in zip(groups, PAPER[:SEVERAL], strict=True):
        assert np.isclose(group["before"]["mean"], before[0], rtol=1e-6)
        assert group["paper"]["before"]["mean"] == before[0]
        assert group["after"]["mean"] <= min(after[0], TABLE_BEST)
        assert group["after"]["max"] <= after[1]


def test_what_the_24_numbers_lose_is_the_tilts_of_parallel_axes(found):
    for group in found.figures["groups"]:
        steps = group["tilts"]
        assert [step["part"] for step in steps] == [1.0, 0.5, 0.25, 0.0]
        assert steps[0]["published_form"] == pytest.approx(group["published_form"]["mean"])
        left = [step["published_form"] for step in steps]
        assert left == sorted(left, reverse=True)
        assert steps[-1]["rms_deg"] == 0.0
        assert left[-1] < group["after"]["mean"] + 0.04 < group["paper"]["after"]["mean"]
    most = max(found.figures["groups"], key=lambda group: group["published_form"]["mean"])
    assert most["published_form_wider_bounds"] > most["paper"]["after"]["mean"]


def test_each_share_is_a_part_of_what_all_explain(found):
    for group in found.figures["groups"]:
        for shares in group["shares"].values():
            assert all(0.0 <= share <= 1.0 for share in shares.values())
        tilted, published = (
            group["shares"][form]["together"] for form in ("with_tilts", "published")
        )
        assert 0.98 < tilted <= 1.0
        assert published < tilted


def test_registration_points_are_apart_from_fit_points(found):
    for group in found.figures["groups"]:
        points = group["registration_points"]
        assert points["before"]["mean"] != group["before"]["mean"]
        assert points["after"]["mean"] < 0.2 * points["before"]["mean"]


def test_outside_of_the_surgical_space_a_fit_made_in_it_errs_more(found):
    for group in found.figures["groups"]:
        for errors in group["workspace"].values():
            assert errors["outside"]["max"] > errors["inside"]["max"]
        tilted = group["workspace"]["with_tilts"]
        assert tilted["inside"]["max"] < 1.0
        assert tilted["outside"]["max"] < group["workspace"]["published"]["outside"]["max"]


def test_with_less_noise_the_fit_goes_down_with_it(found):
    for group in found.figures["fine"]:
        assert group["after"]["mean"] <= 1.1 * group["noise_floor"]
        assert group["fresh"]["mean"] <= 1.6 * group["fresh_noise_floor"]


def test_fifty_points_lie_within_what_the_paper_says(found):
    assert found.figures["repeatability"]["value"] <= found.figures["repeatability"]["paper"]
    assert found.figures["absolute"]["value"] <= found.figures["absolute"]["paper"]


def test_norms_suffer_less_from_gross_errors(found):
    outliers = found.figures["outliers"]
    assert outliers["norms"] < 0.7 * outliers["squares"]


def test_the_figures_are_json_and_the_tables_are_whole(found):
    json.dumps(found.to_dict(), allow_nan=False)
    for table in found.tables:
        assert all(len(row) == len(table.columns) for row in table.rows)


def test_the_simulated_needle_is_where_elementary_transforms_put_it():
    rng = np.random.default_rng(0)
    built = Built.drawing().with_errors(rng.normal(0.0, 0.05, (6, 5)))
    q = poses(10, rng)
    wanted = []
    for posture in q:
        T = np.eye(4)
        for k, (d, a, alpha, theta, beta) in enumerate(built.rows):
            slide, turn = (posture[0], 0.0) if k == 0 else (0.0, 0.0 if k == 5 else posture[k])
            T = T @ about(2, theta + turn) @ shift([0, 0, d + slide]) @ shift([a, 0, 0])
            T = T @ about(0, alpha) @ about(1, beta)
        wanted.append(T[:3, 3])
    assert np.allclose(built.tips(q), wanted, rtol=0, atol=1e-12)


def about(axis, angle):
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T = np.eye(4)
    T[i, i] = T[j, j] = np.cos(angle)
    T[i, j], T[j, i] = -np.sin(angle), np.sin(angle)
    return T


def shift(by):
    T = np.eye(4)
    T[:3, 3] = by
    return T


def test_a_session_has_the_stated_misfit_and_repeats_itself():
    one, two = (draw_session(3, readings=30, before=7e-3, noise=2e-4) for _ in range(2))
    assert np.isclose(np.linalg.norm(drawn_misfits(one), axis=1).mean(), 7e-3, rtol=1e-9)
    assert np.array_equal(one.tips, two.tips)
    assert SURGICAL.holds(Built.drawing().tips(one.q)).all()


def test_registration_points_are_four_that_no_plane_holds():
    q = registration_poses(np.random.default_rng(0), SURGICAL)
    tips = Built.drawing().tips(q)
    extents = np.linalg.svd(tips - tips.mean(axis=0), compute_uv=False)
    assert extents[2] > 0.3 * extents[0]
