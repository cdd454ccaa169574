r"""The rivals of every cause: functions that nobody has listed, and what resembles a cause.

With :math:`n_e` effective samples and features :math:`\Phi` of one thing that a joint goes by
(bumps along it, and the same times the sign of the speed; of past commands, those of half a second;
of another joint, bumps along its angle and its speed)
the residual is :math:`r = \Phi w + J z + \epsilon`, :math:`w \sim N(0, \tau^2 I)`, summed over a
grid of :math:`\tau`; z lets the named causes give way.

What resembles a cause has its column, too, but not just its form: with it stands such a function,
or the column times a smooth function of what the joint goes by, a share of the cause's own size
(as in :mod:`plumbline.optim.diagnosis.discrepancy.resembling`). Where something is left given a
cause, it may be this, and the cause not be there at all.

Standard errors are of all these together: of what stands with a cause, part may be the cause's.
Their squares are means over the models m, by probability, of variance and of squared shift,

.. math:: \sigma^2 = \sum_m P(m)\, \bigl(\sigma_m^2 + (\theta_m - \hat\theta)^2\bigr)

(Hoeting, Madigan, Raftery, Volinsky 1999, Statistical Science 14(4), eq. 3). So a number holds on
another motion as well as the model's form does.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plumbline.optim.diagnosis.motion.constants import (
    APART,
    BUMPS,
    DEVIATIONS,
    LEAST_SHARE,
    MEMORIES,
    PASTS,
    WIDTHS,
)
from plumbline.optim.diagnosis.motion.fit import JointFit, square_time
from plumbline.optim.diagnosis.motion.windows import Array, Windows
from plumbline.optim.diagnosis.prior import FINEST

PAST = "past commands"
ANOTHER = "another joint's motion"  # its angle or speed
ALONG = ("velocity", "load", "angle", "command", "time")  # what a function may run along
OWN_PAST = "its own past"
NO_FORM = "nothing that was recorded"  # more than the noise is left, by no function of anything
VARIABLES = (*ALONG, PAST, ANOTHER, OWN_PAST, NO_FORM)


@dataclass(frozen=True)
class UnlistedFunction:
    """How much a function of one variable would explain."""

    on: str  # the variable
    gain: float  # log evidence that it adds
    share: float  # share of the residual's square that it takes


class _Beside:
    """Features (n, F) conditional on a fit, in the sums that evidence takes."""

    def __init__(
        self, fit: JointFit, effective: float, least: float, stated: float, Phi: Array, like: int
    ) -> None:
        r = fit.residual.ravel()
        both = np.hstack([fit.flat * fit.scales, Phi])
        self.p, self.effective = len(fit.theta), effective
        self.square, self.least, self.stated = fit.square, least, max(stated, FINEST**2)
        self.sums, self.pull = both.T @ both / len(r), both.T @ r / len(r)
        self.odds = -float(np.log(like))  # of so many alike that go by the same

    def gain(self, widths: Sequence[float]) -> tuple[float, float]:
        """Log evidence that they add, summed over widths [rad], and what share they take."""
        found = [self._at(width) for width in widths]
        gains, shares = zip(*found, strict=True)
        best = int(np.argmax(gains))
        return float(np.logaddexp.reduce(gains) - np.log(len(gains))), float(shares[best])

    def _at(self, width: float) -> tuple[float, float]:
        """The same at one width."""
        p, many = self.p, self.effective / self.square
        G = self.sums * many
        own = np.linalg.slogdet(G[:p, :p] + np.eye(p))[1] / 2
        precision = self._precision(width)
        A = G + np.diag(precision)
        w = np.linalg.solve(A, self.pull * many)
        taken = float(2 * w @ self.pull - w @ self.sums @ w)
        left = max(self.square - taken, 1e-3 * self.square)
        if left > (1 - LEAST_SHARE) * self.least:  # what is less than that is negligible
            left = max(left, self.least)
        left = max(left, min(self.stated, self.square))  # noise may have any form
        # The noise is integrated out, as in a fit's own evidence.
        better = self.effective / 2 * np.log(self.square / left)
        occam = np.linalg.slogdet(A / precision[:, None])[1] / 2 - own
        return better - occam + self.odds, 1 - left / self.square

    def _precision(self, width: float) -> Array:
        precision = np.ones(len(self.sums))
        precision[self.p :] = 1 / max(width, 1e-150) ** 2
        return precision

    def misses(self, widths: Sequence[float]) -> Iterator[tuple[float, Array]]:
        """Log evidence at each width [rad], and how far off the fit's parameters then are.

        As second moments (P, P) about the fit, in widths of their priors.
        """
        p, many = self.p, self.effective / self.square
        for width in widths:
            C = np.linalg.inv(self.sums * many + np.diag(self._precision(width)))
            shift = (C @ self.pull * many)[:p]
            gain = self._at(width)[0] - np.log(len(widths))
            yield gain, C[:p, :p] + np.outer(shift, shift)


class FunctionRivals:
    """What may be at work together with a fit, or in the place of one of its causes."""

    def __init__(
        self,
        windows: Windows,
        fit: JointFit,
        effective: float,
        least: float = 0.0,
        stated: float = 0.0,
    ) -> None:
        """Beside a fit; squares of what the best model leaves and of the stated noise [rad^2]."""
        self.windows, self.fit = windows, fit
        self.sizes = effective, least, stated
        # What a joint goes by at every sample (n,), by name: positions and speeds are the
        # predicted ones, for measured ones would know what happened
        at = windows.samples
        predicted = windows.measured + fit.residual
        found = {
            "velocity": np.gradient(predicted, windows.dt, axis=1),
            "load": windows.load[at],
            "angle": predicted,
            "command": windows.command[at],
            "time": at * windows.dt,
        }
        self.along = {on: np.asarray(values, dtype=float).ravel() for on, values in found.items()}
        features = list(_features(windows, fit, self.along))
        alike = Counter(on for on, _ in features)
        self.functions = [
            (on, _Beside(fit, *self.sizes, windows.integrated(Phi), alike[on]))
            for on, Phi in features
        ]

    def conditional(self) -> tuple[UnlistedFunction, ...]:
        """Every variable's function, as large as what is left."""
        widths = [width * self.fit.square**0.5 for width in WIDTHS]
        return tuple(UnlistedFunction(on, *f.gain(widths)) for on, f in self.functions)

    def resembling(self, k: int, size: float) -> tuple[UnlistedFunction, ...]:
        """What resembles the cause k, whose effect has such a root mean square [rad]."""
        widths = [share * size for share in DEVIATIONS]
        found = [*self.functions, *self._modulated(k)]
        return tuple(UnlistedFunction(on, *f.gain(widths)) for on, f in found)

    def _modulated(self, k: int) -> Iterator[tuple[str, _Beside]]:
        """Functions that the cause k is multiplied by."""
        own = self.fit.flat[:, k]
        own = own / max(float(np.sqrt(np.mean(own**2))), 1e-300)
        for on in ALONG:
            Phi = _bumps(self.along[on]) * own[:, None]
            if Phi.shape[1]:
                yield on, _Beside(self.fit, *self.sizes, Phi, 1)

    def errors(self, sizes: Mapping[str, float], each: float) -> Array:
        """Standard errors of the parameters (P,), whether something unlisted is at work or not.

        Args:
            sizes: Root mean squares of the effects [rad], by name.
            each: Prior log odds of something unlisted that goes by one variable.
        """
        scales, widths = self.fit.scales, [width * self.fit.square**0.5 for width in WIDTHS]
        alone = self.fit.covariance(self.sizes[0]) / np.outer(scales, scales)
        found = [(0.0, alone)]
        for _, f in self.functions:
            found += [(gain + each, off) for gain, off in f.misses(widths)]
        for k, effect in enumerate(self.fit.effects):
            own = [share * sizes[effect.name] for share in DEVIATIONS]
            for _, f in self._modulated(k):
                found += [(gain + each - np.log(2), off) for gain, off in f.misses(own)]
        weights = np.array([weight for weight, _ in found])
        shares = np.exp(weights - np.logaddexp.reduce(weights))
        square = np.einsum("m,mpp->p", shares, np.array([off for _, off in found]))
        return np.asarray(np.sqrt(square) * scales)


def own_past(windows: Windows, fit: JointFit, sigma: float) -> UnlistedFunction:
    """What the residual's own past foretells of it, as far as it exceeds the stated noise.

    A mechanism with a memory that no function of the moment has. It is as large as what neighbours
    have in common: less is foretold, by readings that are mostly noise. Noise that wanders
    foretells itself too, but stays within what is stated, as near as so many samples tell.
    """
    r, square = fit.residual, max(fit.square, 1e-300)
    back = [max(round(seconds / windows.dt), 1) for seconds in MEMORIES]
    sums = np.cumsum(np.pad(r, ((0, 0), (1, 0))), axis=1)
    at = np.arange(back[-1] + APART, r.shape[1])
    if not len(at):
        return UnlistedFunction(OWN_PAST, -np.inf, 0.0)
    till = at - APART
    means = np.stack([(sums[:, till] - sums[:, till - n]) / n for n in back], axis=-1)
    Phi, now = means.reshape(-1, len(back)), r[:, at].ravel()
    w = np.linalg.lstsq(Phi, now, rcond=1e-9)[0]
    foretold = 1 - float(np.mean((now - Phi @ w) ** 2) / max(float(np.mean(now**2)), 1e-300))
    kept, beyond = float(np.mean(r[:, APART:] * r[:, :-APART])) / square, 1 - sigma**2 / square
    cost = len(back) / 2 * float(np.log(len(now)))
    gain = -len(now) / 2 * float(np.log1p(-max(min(foretold, beyond), 0.0))) - cost
    more = exceeds(max(square / sigma**2, 1.0), r.size / square_time(r))
    return UnlistedFunction(OWN_PAST, min(gain, more), min(max(foretold, kept), beyond))


def exceeds(ratio: float, effective: float) -> float:
    """Log odds of a variance so many times the stated one, by so many independent samples.

    n / 2 (x - 1 - log x).
    """
    return effective / 2 * (ratio - 1.0 - float(np.log(ratio)))


def _bumps(values: Array) -> Array:
    """Bumps along a variable (n, BUMPS), none where it does not change."""
    low, high = np.quantile(values, [0.01, 0.99])
    if not high > low:
        return np.zeros((len(values), 0))
    far = ((values - low) / (high - low))[:, None] - np.linspace(0, 1, BUMPS)
    return np.asarray(np.exp(-0.5 * far**2 * (BUMPS - 1) ** 2))


def _features(
    windows: Windows, fit: JointFit, along: Mapping[str, Array]
) -> Iterator[tuple[str, Array]]:
    """Bumps along every variable, and those of either direction; past commands; other joints."""
    way = np.sign(along["velocity"])[:, None]
    for on, values in along.items():
        bumps = _bumps(values)
        yield on, bumps if on in ("velocity", "time") else np.hstack([bumps, bumps * way])
    yield PAST, _past(windows)
    at = windows.samples.ravel()
    for angle, speed in windows.others:
        yield ANOTHER, np.hstack([_bumps(angle[at]), _bumps(speed[at])])


def _past(windows: Windows) -> Array:
    """What commands have changed by since (n, k): any linear drive acts by such.

    In as many directions as differ, each of unit size.
    """
    at = windows.samples.ravel()
    now = windows.command[at]
    back = [np.maximum(at - round(s / windows.dt), windows.first[at]) for s in PASTS]
    U, sizes, _ = np.linalg.svd(np.column_stack([windows.command[b] - now for b in back]), False)
    kept = sizes > 1e-3 * max(sizes[0], 1e-300)
    return np.asarray(U[:, kept] * np.sqrt(len(at)))
