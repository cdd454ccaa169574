r"""How well rows to come would tell rival models apart, and which of many rows does it best.

Rival i is a Gaussian :math:`z \sim N(m_i, C_i)` over the unknowns of all rivals, and a row reads
:math:`y = J z + e` with noise of one. While rows are gathered, model j keeps an estimate
:math:`\hat z_j`; if i is right, it errs by :math:`u = z_i - \hat z_j`, and all that is needed is
:math:`U_{ij} = E[u u^T]`, which a row with gain :math:`K_j = C_j J^T S_j^{-1}` turns into

.. math:: U_{ij} \leftarrow (I - K_j J)\, U_{ij}\, (I - K_j J)^T + K_j K_j^T, \qquad
          S_j = J C_j J^T + I

The row adds to the Kullback-Leibler divergence of j from i, by the chain rule,

.. math:: \Delta_{ij} = \tfrac12 \left[\mathrm{tr}\, S_j^{-1} (J U_{ij} J^T + I) - m
          + \log |S_j| - \log |S_i| \right]

The criterion is that of Box and Hill (1967), Technometrics 9(1), 57-71, the sum of
:math:`\pi_i \pi_j \Delta_{ij}`, for rows taken together and bounded by the estimate of a mixture's
entropy from pairwise divergences of Kolchinsky and Tracey (2017), Entropy 19(7), 361, so that no
row is spent on what is told apart already.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import logsumexp

from plumbline.optim.core.judged import root_of
from plumbline.optim.core.problem import Array


@dataclass(frozen=True, eq=False)
class Rivals:
    """Models that compete, as Gaussians over the unknowns of all of them, in units of the noise."""

    labels: tuple[str, ...]  # what each says, in words (M)
    probabilities: Array  # how probable each is (M,), summing to one
    means: Array  # their means (M, P)
    covariances: Array  # their covariances (M, P, P), zero where a model lacks an unknown

    @property
    def leading(self) -> int:
        """Index of the most probable model, the first of equals."""
        return int(np.argmax(self.probabilities))


@dataclass(frozen=True, eq=False)
class Beliefs:
    """What is expected once some rows have been gathered."""

    probabilities: Array  # of every model (M,), as before the rows
    second: Array  # second moment (M, M, P, P) of the error of model j's estimate if i is right
    first: Array  # its mean (M, M, P)
    information: Array  # divergence (M, M) of j from i over the rows gathered
    gathered: int = 0  # how many rows have been gathered

    @classmethod
    def of(cls, rivals: Rivals) -> Self:
        """Before any row."""
        first = rivals.means[:, None] - rivals.means[None]
        second = rivals.covariances[:, None] + first[..., :, None] * first[..., None, :]
        none = np.zeros(first.shape[:2])
        return cls(rivals.probabilities, second, first, none)

    @property
    def covariances(self) -> Array:
        """Covariance (M, P, P) of every model's estimate."""
        own = np.arange(len(self.probabilities))
        return np.asarray(self.second[own, own])

    def after(self, row: Array) -> Self:
        """Once one more row has been gathered.

        Args:
            row: Its Jacobian (m, P), in units of the noise.
        """
        C = self.covariances
        S = row @ C @ row.T + np.eye(len(row))
        K = C @ row.T @ np.linalg.inv(S)
        keep = np.eye(row.shape[1]) - K @ row
        second = keep @ self.second @ keep.transpose(0, 2, 1) + K @ K.transpose(0, 2, 1)
        first = np.einsum("jpq,ijq->ijp", keep, self.first)
        return replace(
            self,
            second=(second + np.swapaxes(second, 2, 3)) / 2,
            first=first,
            information=self.information + divergences(self, row[None])[..., 0],
            gathered=self.gathered + 1,
        )


def divergences(beliefs: Beliefs, rows: Array) -> Array:
    """What each of some rows would add to the divergence of model j from i (M, M, N).

    Args:
        beliefs: What is expected after the rows gathered so far.
        rows: Jacobians (N, m, P), in units of the noise.
    """
    count, m, _ = rows.shape
    spread = _spreads(beliefs, rows)
    own = np.arange(len(spread))
    S = spread[own, own]
    _, size = np.linalg.slogdet(S)
    misfit = np.einsum("jnab,ijnab->ijn", np.linalg.inv(S), spread)
    found = 0.5 * (misfit - m + size[None] - size[:, None])
    assert found.shape == (len(own), len(own), count)
    return np.maximum(found, 0.0)


def _spreads(beliefs: Beliefs, rows: Array) -> Array:
    """Second moments (M, M, N, m, m) of what model j is surprised by if i is right.

    One product of matrices for all: the moments' upper triangles with the products of the rows.
    """
    count, m, P = rows.shape
    models = len(beliefs.probabilities)
    a, b = np.triu_indices(m)
    p, q = np.triu_indices(P)
    left, right = rows[:, a][..., p] * rows[:, b][..., q], rows[:, a][..., q] * rows[:, b][..., p]
    products = (left + np.where(p == q, 0.0, right)).reshape(-1, len(p))
    moments = beliefs.second[..., p, q].reshape(models**2, -1)
    found = np.empty((models, models, count, m, m))
    found[..., a, b] = (moments @ products.T).reshape(models, models, count, -1)
    found[..., b, a] = found[..., a, b]
    return found + np.eye(m)


# How good each row would be (N,), by what is expected after those gathered so far, and by the rows'
# Jacobians (N, m, P), in units of the noise
Criterion = Callable[[Beliefs, Array], Array]


def resolution(beliefs: Beliefs, rows: Array) -> Array:
    """Box-Hill, bounded: how much of the doubt about the model the rows are expected to remove.

    Estimated information about which model is right (N,), above that gathered so far.
    """
    p = beliefs.probabilities
    told = beliefs.information[..., None] + divergences(beliefs, rows)
    mixed = logsumexp(-told, b=p[None, :, None], axis=1)
    return np.asarray(-(p @ mixed))


def at_random(seed: int, beliefs: Beliefs, rows: Array) -> Array:
    """Any row is as good as any other (N,), for comparison: new numbers for every row."""
    return np.random.default_rng([seed, beliefs.gathered]).random(len(rows))


def expected_probabilities(
    rivals: Rivals, gram: Array, draws: int = 1000, seed: int = 0, only: int | None = None
) -> Array:
    r"""Expected probability of model j after some rows if i is right (M, M).

    Readings are drawn from every model; all that counts of them is :math:`J^T y \sim N(G z, G)`,
    and the evidence of model j is that of a Gaussian, by Woodbury's identity.

    Args:
        rivals: The models.
        gram: :math:`G = J^T J` (P, P) of the rows, in units of the noise.
        draws: Readings drawn from every model.
        seed: Of the draws.
        only: The one model to draw from, where the others are of no interest; their rows are NaN.
    """
    rng = np.random.default_rng(seed)
    z_noise, y_noise = rng.normal(size=(2, draws, len(gram)))
    root = root_of(gram)
    found = np.full((len(rivals.labels), len(rivals.labels)), np.nan)
    for i in range(len(found)) if only is None else [only]:
        mean, C = rivals.means[i], rivals.covariances[i]
        b = (mean + z_noise @ root_of(C)) @ gram + y_noise @ root
        logs = np.stack([_evidence(rivals, j, gram, b) for j in range(len(found))])
        logs += np.log(np.maximum(rivals.probabilities, 1e-300))[:, None]
        found[i] = np.exp(logs - logsumexp(logs, axis=0)).mean(axis=1)
    return found


def _evidence(rivals: Rivals, j: int, gram: Array, b: Array) -> Array:
    """Log evidence (D,) of readings by their :math:`J^T y` (D, P), but for what all share."""
    mean, C = rivals.means[j], rivals.covariances[j]
    A = np.eye(len(gram)) + C @ gram
    left = b - mean @ gram
    square = -2.0 * (b @ mean) + float(mean @ gram @ mean)
    square = square - np.einsum("dp,pq,dq->d", left, np.linalg.solve(A, C), left)
    return np.asarray(-0.5 * (square + np.linalg.slogdet(A)[1]))
