r"""The best that any judge could do: exact evidence under the priors that generated the case.

A case of the library's own linearised model has one candidate c, drawn with its prior share, a
scale s from the grid of :mod:`plumbline.optim.diagnosis.posterior.evidence`, and parameters z (in
units of the effect's physical scale) from

.. math:: z \sim N(0, s^2 I), \quad l \le z \le u, \quad
          g_-^2\, n \sigma^2 \le |X z|^2 \le g_+^2\, n \sigma^2

that is, within their bounds and with an unabsorbed gap within the level's range; X are the
candidate's columns given the nuisances, whose prior is flat, and n the number of readings. Call
that set :math:`Z_c`. The readings are :math:`t = X z + \epsilon` with known noise, so

.. math:: p(t \mid c) \propto \frac{\sum_s w_s\, |I + s^2 G|^{-1/2}
          \exp(\tfrac12 b^T (G + s^{-2} I)^{-1} b)\; P(z \in Z_c \mid t, s)}
          {\sum_s w_s\, P(z \in Z_c \mid s)}, \qquad G = X^T X/\sigma^2,\ b = X^T t/\sigma^2 .

Both probabilities of the set are counted over draws of Gaussians; all else is exact. The judge with
the highest posterior is right more often than any other (Duda, Hart and Stork 2001, sec. 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.findings import Key
from plumbline.optim.diagnosis.prior import LOG_SCALE_WEIGHTS, SCALES

DRAWS = 2000
LEAST_MASS = 2e-3
HOPELESS = 40.0  # log evidence behind the best at which the set's share need not be counted


@dataclass(frozen=True, eq=False)
class Rival:
    """One variant of one effect, as the oracle sees it."""

    key: Key  # effect and element
    columns: Array  # its columns beside the nuisances, in units of its scales (n, k) [m]
    lower: Array  # lower bounds of its parameters (k,) in those units
    upper: Array  # upper bounds (k,)
    log_prior: float  # log of its share among all


@dataclass(frozen=True, eq=False)
class Ensemble:
    """What a case is drawn from."""

    rivals: tuple[Rival, ...]  # all that may be at work
    sigma: float  # the noise of one reading [m]
    gap: tuple[float, float]  # range of the gap over the noise
    log_mass: Array  # log prior probability of each rival's set (R,)

    @classmethod
    def of(
        cls,
        rivals: Sequence[Rival],
        sigma: float,
        gap: tuple[float, float],
        rng: np.random.Generator,
    ) -> Ensemble:
        """Rivals whose sets are likely enough to be drawn from."""
        masses = [_prior_mass(rival, sigma, gap, rng) for rival in rivals]
        kept = [k for k, mass in enumerate(masses) if mass > LEAST_MASS]
        log_mass = np.log(np.array([masses[k] for k in kept]))
        return cls(tuple(rivals[k] for k in kept), sigma, gap, log_mass)

    @property
    def log_shares(self) -> Array:
        """Log prior share of each rival (R,), which sum to one."""
        shares = np.array([rival.log_prior for rival in self.rivals])
        return shares - logsumexp(shares)

    def draw(self, rng: np.random.Generator) -> tuple[int, Array]:
        """A rival and its parameters (k,)."""
        k = int(rng.choice(len(self.rivals), p=np.exp(self.log_shares)))
        rival = self.rivals[k]
        while True:
            scale = rng.choice(SCALES, p=np.exp(LOG_SCALE_WEIGHTS))
            z = scale * rng.normal(size=(DRAWS, rival.columns.shape[1]))
            good = np.flatnonzero(admitted(rival, z, self.sigma, self.gap))
            # One look a draw of the scale, so that scales keep their weight within the set.
            if len(good) > rng.integers(DRAWS):
                return k, z[rng.choice(good)]

    def posterior(self, t: Array, rng: np.random.Generator) -> Array:
        """Probability of each rival (R,) given readings without the nuisances (n,) [m]."""
        parts = [_evidence(rival, t, self.sigma) for rival in self.rivals]
        best = max(float(part.log_bayes.max()) for part in parts)
        found = np.full(len(parts), -np.inf)
        for k, (rival, part) in enumerate(zip(self.rivals, parts, strict=True)):
            if part.log_bayes.max() > best - HOPELESS:
                shares = part.shares(rival, self.sigma, self.gap, rng)
                with np.errstate(divide="ignore"):
                    terms = LOG_SCALE_WEIGHTS + part.log_bayes + np.log(shares)
                found[k] = logsumexp(terms) - self.log_mass[k]
        log_posterior = found + self.log_shares
        return np.asarray(np.exp(log_posterior - logsumexp(log_posterior)))


def admitted(rival: Rival, z: Array, sigma: float, gap: tuple[float, float]) -> Array:
    """Which parameters (M, k) lie within their bounds and give a gap in the range (M,)."""
    inside = np.all((z >= rival.lower) & (z <= rival.upper), axis=1)
    gram = rival.columns.T @ rival.columns
    square = np.einsum("mi,ij,mj->m", z, gram, z) / (len(rival.columns) * sigma**2)
    return np.asarray(inside & (square >= gap[0] ** 2) & (square <= gap[1] ** 2))


def _prior_mass(
    rival: Rival, sigma: float, gap: tuple[float, float], rng: np.random.Generator
) -> float:
    unit = rng.normal(size=(DRAWS, rival.columns.shape[1]))
    shares = [np.mean(admitted(rival, s * unit, sigma, gap)) for s in SCALES]
    return float(np.exp(LOG_SCALE_WEIGHTS) @ np.array(shares))


@dataclass(frozen=True, eq=False)
class Evidence:
    """The Gaussian part of a rival's evidence, scale by scale."""

    log_bayes: Array  # log Bayes factors against nothing at all (S,)
    mean: Array  # posterior means (S, k)
    spread: Array  # roots of the posterior covariances (S, k, k)

    def shares(
        self, rival: Rival, sigma: float, gap: tuple[float, float], rng: np.random.Generator
    ) -> Array:
        """Posterior probability of the rival's set at every scale (S,)."""
        unit = rng.normal(size=(DRAWS, self.mean.shape[1]))
        found = [
            np.mean(admitted(rival, mean + unit @ spread.T, sigma, gap))
            for mean, spread in zip(self.mean, self.spread, strict=True)
        ]
        return np.array(found)


def _evidence(rival: Rival, t: Array, sigma: float) -> Evidence:
    values, vectors = np.linalg.eigh(rival.columns.T @ rival.columns / sigma**2)
    values = np.maximum(values, 0.0)
    b = vectors.T @ (rival.columns.T @ t) / sigma**2
    precision = values + 1.0 / SCALES[:, None] ** 2
    mean = (b / precision) @ vectors.T
    spread = vectors / np.sqrt(precision)[:, None, :]
    log_bayes = 0.5 * np.sum(b**2 / precision - np.log1p(SCALES[:, None] ** 2 * values), axis=1)
    return Evidence(log_bayes, mean, spread)
