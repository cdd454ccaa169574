r"""Which poses to record: the best N within a surgical space.

With J_i the Jacobian (3, P) of a pose's misfit by links and frame, sigma the noise, and the bounds
taken for the width of a prior,

.. math:: M = \mathrm{diag}(3 / \delta^2) + \sigma^{-2} \sum_i J_i^T J_i, \qquad C = M^{-1},

a design is D-optimal if it makes det M largest (Fedorov 1972, Theory of Optimal Experiments), and
safest if it makes the largest expected target error over the space smallest,

.. math:: \max_t \sqrt{\mathrm{tr}(J_t C J_t^T)} .

Either is sought among random reachable poses, by adding the best one at a time and then exchanging
poses until no exchange helps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from plumbline.errors import PlumblineError
from plumbline.kinematics.link_table import link_table
from plumbline.kinematics.robot import Robot
from plumbline.optim.core.problem import Array
from plumbline.optim.dh_fit import constants
from plumbline.optim.dh_fit.identify import noise_free
from plumbline.optim.dh_fit.local import Space
from plumbline.optim.dh_fit.statement import Pass, frame_unknowns, link_unknowns


class DesignCriterion(StrEnum):
    """What a design is to be best at."""

    DETERMINANT = "determinant"
    WORST = "worst"


@dataclass(frozen=True, eq=False)
class PoseDesign:
    """Poses, and what they promise."""

    q: Array  # poses (N, n) [rad or m]
    log_determinant: float  # of M, its columns in units of the bounds
    worst: float  # largest expected error of a target in the space [m]
    mean: float  # root mean square of it over the targets [m]


@dataclass(frozen=True, eq=False)
class Candidates:
    """Reachable poses of a space, and targets in it."""

    q: Array  # candidates (C, n)
    slopes: Array  # their Jacobians (C, 3, P) over the noise, columns in units of the bounds
    targets: Array  # jacobians of targets (T, 3, P) [m]
    prior: Array  # precision before any reading (P, P)

    def design(self, rows: ArrayLike) -> PoseDesign:
        """What some of the candidates promise."""
        chosen = np.asarray(rows)
        C = self.covariance(chosen)
        errors = _target_variance(self.targets, C)
        size = -float(np.linalg.slogdet(C)[1])
        return PoseDesign(
            self.q[chosen], size, float(np.sqrt(errors.max())), float(np.sqrt(errors.mean()))
        )

    def covariance(self, rows: ArrayLike) -> Array:
        """C (P, P) after readings of these candidates."""
        A = self.slopes[np.asarray(rows, dtype=int)].reshape(-1, self.prior.shape[0])
        return np.asarray(np.linalg.inv(self.prior + A.T @ A))

    def random(self, count: int, rng: np.random.Generator) -> PoseDesign:
        """A design of poses drawn blindly."""
        return self.design(rng.choice(len(self.q), count, replace=False))

    def best(
        self, count: int, criterion: DesignCriterion | str = DesignCriterion.DETERMINANT
    ) -> PoseDesign:
        """The best design found of so many poses."""
        if not 1 <= count <= len(self.q):
            raise PlumblineError(f"{count} poses: 1 to {len(self.q)} can be chosen")
        gain = (
            _volume_gain
            if DesignCriterion(criterion) == DesignCriterion.DETERMINANT
            else _worst_gain
        )
        chosen: list[int] = []
        for _ in range(count):
            chosen.append(self._next(chosen, _volume_gain))
        for _ in range(constants.SWEEPS):
            before = list(chosen)
            for k in range(count):
                others = chosen[:k] + chosen[k + 1 :]
                better, current = self._next(others, gain), chosen[k]
                scores = gain(self, self.covariance(others))
                share, least = constants.BETTER
                if scores[better] > scores[current] * (1 + share) + least:
                    chosen[k] = better
            if chosen == before:
                break
        return self.design(chosen)

    def _next(self, chosen: list[int], gain: Callable[[Candidates, Array], Array]) -> int:
        scores = gain(self, self.covariance(chosen))
        scores[chosen] = -np.inf
        return int(np.argmax(scores))


def _volume_gain(among: Candidates, C: Array) -> Array:
    """Growth of log det M by each candidate (C,)."""
    spread = among.slopes @ C @ among.slopes.transpose(0, 2, 1) + np.eye(3)
    return np.asarray(np.linalg.slogdet(spread)[1])


def _worst_gain(among: Candidates, C: Array) -> Array:
    """Minus the largest target variance that each candidate leaves (C,)."""
    S = among.slopes @ C @ among.slopes.transpose(0, 2, 1) + np.eye(3)
    root = np.linalg.inv(np.linalg.cholesky(S))
    reduced = root @ among.slopes  # its product with C takes away what the candidate tells
    W = np.einsum("tap,pq,ibq->tiab", among.targets, C, reduced, optimize=True)
    left = _target_variance(among.targets, C)[:, None] - (W**2).sum(axis=(2, 3))
    return -left.max(axis=0)


def _target_variance(targets: Array, C: Array) -> Array:
    return np.asarray(np.einsum("tap,pq,taq->t", targets, C, targets, optimize=True))


def reachable(
    robot: Robot,
    space: Space,
    *,
    noise: float,
    tool: ArrayLike = (0.0, 0.0, 0.0),
    tip_frame: str | None = None,
    candidates: int = constants.CANDIDATES,
    targets: int = constants.TARGETS,
    delta_length: float = constants.DELTA_LENGTH,
    delta_angle: float = constants.DELTA_ANGLE,
    seed: int = 0,
) -> Candidates:
    """Draw reachable poses of a space, and targets in it.

    Args:
        robot: The robot.
        space: Where the tip shall be, in the robot's base.
        noise: 1 sigma of one axis of a reading [m].
        tool: The tip in the tip frame (3,) [m].
        tip_frame: The tip frame; the robot's own if not given.
        candidates: Poses to choose from.
        targets: Poses at which the error matters.
        delta_length: Half-width of the bounds of lengths [m].
        delta_angle: Half-width of the bounds of angles [rad].
        seed: Of the draw.

    Raises:
        PlumblineError: The space is out of reach, or the noise is not positive.
    """
    if not noise > 0.0:
        raise PlumblineError(f"noise = {noise}: must be > 0 m")
    chain, point = robot.chain(tip_frame), np.asarray(tool, dtype=float)
    rng = np.random.default_rng(seed)
    lower = np.where(np.isfinite(chain.lower), chain.lower, -np.pi)
    upper = np.where(np.isfinite(chain.upper), chain.upper, np.pi)
    found = np.empty((0, chain.n))
    for _ in range(constants.TRIES):
        q = rng.uniform(lower, upper, (4 * (candidates + targets), chain.n))
        found = np.vstack([found, q[space.holds(chain.tips(q, point))]])
        if len(found) >= candidates + targets:
            break
    else:
        raise PlumblineError(
            f"space {space.lower.tolist()} to {space.upper.tolist()}: {len(found)} poses of "
            f"{robot.name} found in it, {candidates + targets} needed; move or widen it"
        )
    q = found[: candidates + targets]
    table = link_table(robot, chain)
    links = link_unknowns(table, delta_length, delta_angle, hayati=True)
    stated, readings = noise_free(table, point, [*frame_unknowns(), *links], q, None)
    scaled = [J * stated.scale for _, J in Pass(stated, readings).jacobians(stated.nominal)]
    J = np.concatenate(scaled)
    known = np.array([u.cell is not None for u in stated.unknowns])
    prior = 3.0 * np.diag(np.where(known, 1.0, constants.VAGUE))
    return Candidates(q[:candidates], J[:candidates] / noise, J[candidates:], prior)
