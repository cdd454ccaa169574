"""Functions of what was recorded, as rows (K, N): what an unknown effect may look like."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations_with_replacement, product

import casadi as cs
import numpy as np

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.constants import TIP_TO_AXIS
from plumbline.kinematics.dynamics import nominal_of, weight_beyond
from plumbline.kinematics.effects.base_bump import LEAST_SHARE, MOST
from plumbline.kinematics.effects.base_drift import SETTLING
from plumbline.kinematics.effects.hysteresis import Hysteresis
from plumbline.kinematics.evaluate import over_rows
from plumbline.kinematics.frames import constant
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.constants import GRID, NYSTROM, UNMOVED
from plumbline.optim.diagnosis.prior import FULLEST, MESHES, PLACES, PLAYS, REACHES, TURNS
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording


def normal(values: Array) -> Array:
    """Columns brought to zero mean and unit spread."""
    return np.asarray((values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-12))


def smooth(inputs: Array, reach: float) -> Array:
    """Leading features (K, N) of a squared-exponential process of inputs (N, d) at these rows.

    Random ones of it (Rahimi and Recht 2007) would make a verdict hang on their draw.
    """
    apart = np.sum((inputs[:, None] - inputs) ** 2, axis=2)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart / reach**2))
    kept = np.maximum(values[-FULLEST:], 0.0)
    return np.asarray((vectors[:, -FULLEST:] * np.sqrt(kept)).T)


def waves(angles: Array) -> Array:
    """Four waves (K, 4, N) for every two whole numbers of turns of two angles (N, 2)."""
    orders = np.array(list(product(range(1, TURNS + 1), range(1, MESHES + 1))))
    plus, minus = orders @ angles.T, (orders * [1, -1]) @ angles.T
    found = np.stack([np.sin(plus), np.cos(plus), np.sin(minus), np.cos(minus)], axis=1)
    return level(found)


def level(functions: Array) -> Array:
    """Functions (..., N) about their means: over a short way a cosine would pass for a constant."""
    return np.asarray(functions - functions.mean(axis=-1, keepdims=True))


def spots(place: Array) -> Array:
    """Bumps of several widths around some of the places (N, 3), each with its slopes (K, 5, N)."""
    size = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
    centres = place[np.linspace(0, len(place) - 1, min(len(place), PLACES)).astype(int)]
    apart = np.moveaxis(place - centres[:, None], 2, 1) / max(size, 1e-12)
    squared = np.sum(apart**2, axis=1, keepdims=True)
    form = np.concatenate([np.ones_like(squared), apart, squared], axis=1)
    return np.concatenate([form * np.exp(-0.5 * squared / width**2) for width in REACHES[:2]])


def steps(values: Array, count: int) -> Array:
    """Steps (K, N) at evenly spread quantiles of the values."""
    moments = np.quantile(values, np.linspace(0, 1, count + 2)[1:-1])
    return np.where(values > moments[:, None], 0.5, -0.5)


def polynomials(inputs: Array, degree: int) -> Array:
    """Products (K, N) of up to ``degree`` inputs (N, d)."""
    picks = [
        p
        for size in range(1, degree + 1)
        for p in combinations_with_replacement(range(inputs.shape[1]), size)
    ]
    return np.stack([inputs[:, list(p)].prod(axis=1) for p in picks])


def cosines(values: Array, count: int) -> Array:
    """Cosines (K, N) over the range of the values, weaker as they get faster."""
    u = (values - values.min()) / max(float(np.ptp(values)), 1e-12)
    k = np.arange(1, count + 1)[:, None]
    return np.asarray(np.cos(np.pi * k * u) / (1 + (k / 3) ** 2))


def as_angles(recording: Recording) -> Array:
    """Joint coordinates (N, n) [rad]; of one that slides half a turn over its recorded way.

    In metres whatever is smooth in an angle would be a straight line over so short a way.
    """
    q = recording.q
    way = np.maximum(np.ptp(q, axis=0), UNMOVED)
    slides = np.array([kind == "prismatic" for kind in recording.chain.kinds])
    return np.where(slides, q * np.pi / way, q)


def turns(angle: Array, count: int, *, constant: bool) -> Array:
    """Sines and cosines (K, N) of the first orders of an angle; a constant, or none in them."""
    k = np.arange(1, count + 1)[:, None]
    found = np.concatenate([np.sin(k * angle), np.cos(k * angle)])
    if constant:
        return np.concatenate([np.ones((1, len(angle))), found])
    return level(found)


def nearness(angle: Array, reach: float) -> Array:
    """Leading features (K, N) of a squared-exponential process of an angle (Rasmussen 2006, 4.9).

    Any smooth function of the angle, whatever its period: what is nearer than ``reach`` errs alike.
    """
    grid = np.linspace(angle.min(), angle.max(), min(len(angle), GRID))
    apart = grid[:, None] - grid
    values, vectors = np.linalg.eigh(np.exp(-0.5 * (apart / reach) ** 2))
    kept = values > values.sum() * NYSTROM
    across = np.exp(-0.5 * ((angle[:, None] - grid) / reach) ** 2)
    return np.asarray((across @ vectors[:, kept] / np.sqrt(values[kept])).T)


def local(angle: Array, reach: float) -> list[Array]:
    """A step at one angle (1, N), or a bump narrower than a reach with its slope (2, N), each."""
    centres = np.linspace(angle.min(), angle.max(), PLACES + 2)[1:-1, None]
    found = [level(side[None]) for side in (angle > centres).astype(float)]
    for width in REACHES[:2]:
        apart = (angle - centres) / (width * reach)
        bumps = np.stack([np.ones_like(apart), apart]) * np.exp(-0.5 * apart**2)
        found += [level(bump) for bump in bumps.transpose(1, 0, 2)]
    return found


def jumps(order: Array) -> Array:
    """What comes after one moment (K, N), each where a bump of the base would be tried."""
    at = np.quantile(order, np.linspace(LEAST_SHARE, 1.0 - LEAST_SHARE, MOST))
    return np.unique(order > at[:, None], axis=0).astype(float)


def memories(angle: Array, order: Array, count: int) -> Array:
    """A constant, an angle (N, 1) and steps (K + 2, N): a joint that jumps now and then."""
    return np.concatenate([np.ones((1, len(angle))), normal(angle).T, steps(order, count)])


def plays(angle: Array) -> Array:
    """Lags (K, N) of play operators of several widths, between -1/2 and 1/2."""
    travel = float(np.ptp(angle))
    if travel < UNMOVED:
        return np.empty((0, len(angle)))
    found = [Hysteresis(joint=1, width=share * travel) for share in PLAYS]
    rows = {"q": angle[:, None]}
    return np.stack([next(iter(play.derive(rows).values())) for play in found])


def loads(recording: Recording, gravity: Array | None = None) -> Array:
    """Gravity torques (N, n) [N m], or what another gravity (3,) in the base frame would make."""
    chain = scope_of(recording).chain
    torque = _torque(chain, None if gravity is None else tuple(gravity.tolist()))
    return over_rows(torque, _carrying(recording))[0][:, 0]


@lru_cache(maxsize=32)
def _torque(chain: Chain, gravity: tuple[float, ...] | None) -> cs.Function:
    chain = chain if gravity is None else replace(chain, gravity=np.array(gravity))
    q, mass = cs.SX.sym("q", chain.n), cs.SX.sym("payload")
    return cs.Function("torque", [cs.vertcat(q, mass)], [chain.gravity_torque(q, mass)])


def _carrying(recording: Recording) -> Array:
    """Postures, and what the arm is known to carry there (N, n + 1)."""
    known = np.zeros(len(recording)) if recording.payload is None else recording.payload
    return np.column_stack([recording.q, known])


def weights(recording: Recording) -> Array:
    """Gravity's direction, and moment [N m], in the frame of every joint (n, 2, 3, N)."""
    borne = _borne(chain := scope_of(recording).chain)
    found = over_rows(borne, _carrying(recording))[0]
    return np.asarray(found.reshape(len(found), chain.n, 2, 3).transpose(1, 2, 3, 0))


@lru_cache(maxsize=16)
def _borne(chain: Chain) -> cs.Function:
    arm = nominal_of(chain, carrying=True)
    down = cs.DM(chain.gravity / max(float(np.linalg.norm(chain.gravity)), 1e-12))
    each = [
        T.R.T @ cs.horzcat(down, weight_beyond(arm, j + 1, T.t)[1])
        for j, T in enumerate(arm.frames[: chain.n])
    ]
    return cs.Function("borne", [cs.vertcat(arm.q, arm.payload)], [cs.densify(cs.horzcat(*each))])


def bending(recording: Recording) -> Array:
    """Every link as it bends about its middle under the weights beyond it (n, 6, N), alike [N m].

    A twist of its joint's frame; to a twelfth of the end's shift as a beam bends (Timoshenko 1955,
    Strength of Materials I, ch. 5).
    """
    bent = _bent(scope_of(recording).chain)
    return np.asarray(over_rows(bent, _carrying(recording))[0].transpose(1, 2, 0))


@lru_cache(maxsize=16)
def _bent(chain: Chain) -> cs.Function:
    arm, found = nominal_of(chain, carrying=True), []
    for i, T in enumerate(arm.frames[: arm.chain.n]):
        beam = arm.chain.placements[i + 1].t
        u = beam / cs.fmax(cs.norm_2(beam), TIP_TO_AXIS)
        moment = T.R.T @ weight_beyond(arm, i + 1, T.point(beam / 2))[1]
        turned = moment - u * cs.dot(u, moment)
        found.append(cs.vertcat(cs.cross(beam / 2, turned), turned))
    return cs.Function("bent", [cs.vertcat(arm.q, arm.payload)], [cs.densify(cs.horzcat(*found))])


def overturning(recording: Recording) -> Array:
    """Moment (3, N) [N m] of all weights about the base's origin, in the base frame."""
    about = _overturned(scope_of(recording).chain)
    return np.asarray(over_rows(about, _carrying(recording))[0][:, 0].T)


@lru_cache(maxsize=16)
def _overturned(chain: Chain) -> cs.Function:
    arm = nominal_of(chain, carrying=True)
    moment = weight_beyond(arm, 1, cs.SX(3, 1))[1]
    return cs.Function("overturning", [cs.vertcat(arm.q, arm.payload)], [cs.densify(moment)])


def on_tip(recording: Recording) -> Iterator[tuple[str, Array, Array]]:
    """What bears on the tip: in words, as torques of joints (n, N), and as it bends a tool (6, N).

    A kilogram at the tip frame, one at the tool's tip, and a recorded force there. A tool bends as
    a rod does from the tip frame on (Timoshenko 1955, Strength of Materials I, sec. 20): its tip
    shifts as the force across it and turns by 3 / 2 L of that; a twist of the last joint's frame.
    """
    chain, tool = scope_of(recording).chain, recording.tool_offset
    arm = nominal_of(chain, carrying=True)
    (last, tip), force = arm.frames[-2:], cs.SX.sym("f", 3)
    length = float(np.linalg.norm(tool))
    long = length > TIP_TO_AXIS
    u = tip.R @ constant(tool / length if long else np.array([0.0, 0.0, 1.0]))
    bent = force - u * cs.dot(u, force)
    turned = cs.cross(u, bent) * (1.5 / length if long else 0.0)
    shifted = bent - cs.cross(turned, tip.point(constant(tool)) - last.t)
    twist = cs.vertcat(last.R.T @ shifted, last.R.T @ turned)
    weight = np.tile(chain.gravity, (len(recording), 1))
    found = [("a weight at the tip", tip.t, weight)]
    found += [("a weight at the tool's tip", tip.point(constant(tool)), weight)] if long else []
    if recording.force is not None:
        R = chain.placement(recording.q)[:, :3, :3]
        pressed = np.einsum("nij,nj->ni", R, recording.force)
        found.append(("the force on the tip", tip.point(constant(tool)), pressed))
    for words, place, forces in found:
        both = cs.densify(cs.vertcat(arm.load_at(place, force), twist))
        bears = cs.Function("bears", [cs.vertcat(arm.q, force)], [both])
        rows = over_rows(bears, np.column_stack([recording.q, forces]))[0][:, 0].T
        yield words, rows[: chain.n], rows[chain.n :]


def courses(values: Array) -> Array:
    """Straight and settling courses (K, 1, N) over the range of the values, about their means."""
    u = (values - values.min()) / max(float(np.ptp(values)), 1e-12)
    return level(np.stack([u, *(-np.expm1(-u / share) for share in SETTLING)])[:, None])
