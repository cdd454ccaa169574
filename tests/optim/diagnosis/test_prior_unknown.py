"""What the constants of unknown dependences decide: which functions a family holds, and which not.

Held is what the family's functions leave nothing of; each law has one on either side of the limit.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.optim.diagnosis.discrepancy import part_dependences
from plumbline.optim.diagnosis.discrepancy.functions import (
    nearness,
    on_tip,
    overturning,
    plays,
    smooth,
    spots,
    waves,
)
from plumbline.optim.diagnosis.prior import REACHES
from tests.benches import bench

N = 600
RNG = np.random.default_rng(0)


def left(functions, target):
    """Share of a function's square that a family's (K, N) leave."""
    A = np.asarray(functions).reshape(-1, target.shape[-1]).T
    fit = A @ np.linalg.lstsq(A, target, rcond=1e-8)[0]
    return float(np.sum((target - fit) ** 2) / np.sum(target**2))


@pytest.mark.parametrize(
    ("orders", "held"), [((6, 3), True), ((5, -2), True), ((8, 2), False), ((2, 4), False)]
)
def test_of_two_angles_six_turns_of_one_and_three_of_the_other_are_a_family(orders, held):
    angles = RNG.uniform(-np.pi, np.pi, (N, 2))
    wave = np.sin(angles @ np.array(orders))
    assert (left(waves(angles), wave - wave.mean()) < 0.05) == held


@pytest.mark.parametrize(("width", "held"), [(0.003, True), (1.0, True), (0.0005, False)])
def test_plays_are_a_three_hundredth_of_the_travel_to_all_of_it(width, held):
    angle = np.cumsum(RNG.normal(size=N)) / 30.0
    travel = float(np.ptp(angle))
    play = Hysteresis(joint=1, width=width * travel).derive({"q": angle[:, None]})
    assert (min(left([one], *play.values()) for one in plays(angle)) < 1e-3) == held


@pytest.mark.parametrize(("width", "held"), [(0.25, True), (0.6, True), (0.1, False), (1.5, False)])
def test_bumps_are_a_quarter_to_six_tenths_of_the_cloud_wide(width, held):
    place = RNG.normal(size=(N, 1)) * [1.0, 0.0, 0.0]  # along a line, where many are near
    size = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
    apart = np.sum((place - place[0]) ** 2, axis=1)
    bump = np.exp(-0.5 * apart / (width * size) ** 2)
    assert (min(left(form, bump) for form in spots(place)) < 0.02) == held


@pytest.mark.parametrize(("reach", "near"), [*zip(REACHES, (0.25, 0.6, 1.5), strict=True)])
def test_what_is_smooth_errs_alike_over_a_quarter_to_one_and_a_half_of_a_radian(reach, near):
    features = nearness(np.linspace(0.0, 3.0, 61), reach)
    alike = features.T @ features
    assert np.interp(near, np.linspace(0.0, 3.0, 61), alike[0]) == pytest.approx(0.61, abs=0.03)


@pytest.mark.parametrize(("rows", "left"), [(12, 0), (200, 1)])
def test_what_is_smooth_of_several_inputs_is_its_fifteen_leading_functions(rows, left):
    """No other fifteen leave less of what rows that are near have in common."""
    inputs = RNG.normal(size=(rows, 3))
    alike = np.exp(-0.5 * np.sum((inputs[:, None] - inputs) ** 2, axis=2) / 0.6**2)
    features = smooth(inputs, 0.6)
    rest = np.linalg.eigvalsh(alike - features.T @ features)
    assert rest.max() == pytest.approx(left * np.sort(np.linalg.eigvalsh(alike))[-16:][0], abs=1e-9)


def offered(**given):
    """What ranges of one plane may follow: by name, how many functions its largest family has."""
    one = SimpleNamespace(ranges=True)
    time = np.linspace(0.0, 60.0, N)
    r = SimpleNamespace(element=np.ones(N, dtype=int), elements=(1,), time=time, kind=one, **given)
    ports = SimpleNamespace(shift=np.ones((1, N, 1)))
    sizes: dict[tuple[str, int | None], int] = {}
    for f in part_dependences._of_time(r, "plane", ports):
        sizes[f.on, f.element] = max(sizes.get((f.on, f.element), 0), len(f.columns))
    return sizes


def test_what_changes_with_time_has_fifteen_forms_and_three_where_it_warms_up():
    families = offered()
    assert 12 < families["time", None] < 20
    assert 2 <= families["time", 1] <= 4


def body_frames(chain, q, k):
    """Frames (N, 4, 4) of joint k's body, from 0, in the base."""
    cut = replace(chain, joints=chain.joints[: k + 1], T_last_tip=np.eye(4))
    return cut.placement(q[:, : k + 1])


def test_the_base_bears_every_weight_and_the_payload_times_their_arms():
    recording = bench("ur5", "tip_position")
    chain, q = recording.chain, recording.q
    borne = recording.payload[:, None] * chain.gravity
    moment = np.cross(chain.tips(q, np.zeros(3)), borne)
    for k, body in enumerate(chain.joints):
        T = body_frames(chain, q, k)
        moment += np.cross(T[:, :3, :3] @ body.com + T[:, :3, 3], body.mass * chain.gravity)
    np.testing.assert_allclose(overturning(recording).T, moment, atol=1e-9)


def test_what_bears_on_the_tip_twists_drives_by_its_work_and_bends_a_tool_as_a_rod():
    """A rod's end turns by 3 / 2 of its shift over its length."""
    recording = bench("ur5", "tip_position")
    chain, q, tool = recording.chain, recording.q, recording.tool_offset
    last = body_frames(chain, q, chain.n - 1)
    weight = np.tile(chain.gravity, (len(q), 1))
    pressed = np.einsum("nij,nj->ni", chain.placement(q)[:, :3, :3], recording.force)
    bears = (np.zeros(3), weight), (tool, weight), (tool, pressed)
    for (_, torque, bent), (place, force) in zip(on_tip(recording), bears, strict=True):
        for j, step in enumerate(1e-6 * np.eye(chain.n)):
            ahead, behind = (chain.tips(q + way, place) for way in (step, -step))
            work = np.sum((ahead - behind) * force, axis=1) / 2e-6
            np.testing.assert_allclose(np.abs(torque[j]), np.abs(work), atol=1e-6)
        arm = chain.tips(q, tool) - last[:, :3, 3]
        shifted, turned = bent[:3].T, bent[3:].T
        shift = shifted + np.cross(turned, np.einsum("nji,nj->ni", last[:, :3, :3], arm))
        sizes = (np.linalg.norm(v, axis=1) for v in (turned, 1.5 * shift / np.linalg.norm(tool)))
        np.testing.assert_allclose(*sizes, atol=1e-9)
