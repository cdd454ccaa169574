r"""Simulation-based calibration: how far a verdict is to be believed, from simulated cases like it.

The user's own rows, tool, noise and gross errors stay; what is wrong is drawn from the library,
with a gap like the one that was found, as many causes at once as were named, and in one case of
four nothing at all. Each case is diagnosed afresh. What comes of it is how often the first cause
was right, how often nothing was mistaken for something, and probabilities that were held against
what turned out. All of it holds among the causes that the library has: nothing here speaks for or
against something outside of it (Talts et al. 2018, arXiv:1804.06788, for posteriors; here for the
probabilities of causes).

The set of causes that holds the truth with 90 %, and where true values rank among stated ones.

The score of a simulated case is the least probability :math:`p` that a true cause of it was given.
Of n cases take the threshold

.. math:: p^* = p_{(\lfloor (n + 1)(1 - 0.9) \rfloor)} \quad \text{from the least},

and the causes stated at :math:`p^*` or more hold those of the next case alike with 90 % at least
(split conformal prediction; Vovk, Gammerman and Shafer 2005, ch. 2). The rank of a true value is
its place in the normal that was stated of it, :math:`\Phi((x^* - x) / \sigma)`: as often in each
tenth, if values and errors are right (Talts et al. 2018, arXiv:1804.06788).

Stated probabilities against how often they were right.

A statement of probability p that turned out y, right or wrong, is believed to have had the
probability q with

.. math:: \operatorname{logit} q = a \operatorname{logit} p + b

(Platt 1999; as a recalibration of probabilities Cox 1958). The fit is the most probable one under
:math:`a \sim N(1, 0.5^2)`, :math:`b \sim N(0, 1)`, so that few statements change little.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import root
from scipy.special import expit, logit, ndtr

from plumbline.errors import PlumblineError
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.core.problem import Array
from plumbline.optim.core.progress import Progress, silent
from plumbline.optim.core.quantities import Share, percent
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.answer import Diagnosis
from plumbline.optim.diagnosis.calibrate.simulation import Fault, Setting
from plumbline.optim.diagnosis.constants import FLAT
from plumbline.optim.diagnosis.diagnose import diagnose
from plumbline.optim.diagnosis.findings import Cause, Key, Verdict
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.prior import OFFSET_WIDTH, SLOPE_WIDTH, SUREST, TRUTH_HELD
from plumbline.optim.recording.recording import Recording

IDENTITY = np.array([1.0, 0.0])  # slope and offset of a line that changes nothing


@dataclass(frozen=True)
class Recalibration:
    """The line in log odds; the identity unless fitted."""

    slope: float = 1.0  # the a of the formula; below 1 where statements were too sure
    offset: float = 0.0  # the b; below 0 where too much was named

    @classmethod
    def of(cls, stated: Sequence[float], right: Sequence[bool]) -> Self:
        """The most probable line of some statements."""
        if not len(stated):
            return cls()
        X = np.column_stack([_log_odds(stated), np.ones(len(stated))])
        signs = np.where(right, 1.0, -1.0)
        widths = np.array([SLOPE_WIDTH, OFFSET_WIDTH])

        def slope(line: Array) -> Array:
            misses = signs * expit(-signs * (X @ line))
            return np.asarray((line - IDENTITY) / widths**2 - misses @ X)

        def curvature(line: Array) -> Array:
            odds = X @ line
            return np.asarray(np.diag(widths**-2.0) + (X.T * (expit(odds) * expit(-odds))) @ X)

        # The cost is convex, with a curvature of at least 1: where its slope vanishes it is least.
        return cls(*root(slope, IDENTITY, jac=curvature, tol=FLAT).x.tolist())

    def __call__(self, stated: float) -> float:
        """What a stated probability is worth."""
        if self == Recalibration():
            return stated
        return float(expit(self.slope * _log_odds([stated])[0] + self.offset))


def _log_odds(stated: Sequence[float]) -> Array:
    return np.asarray(logit(np.clip(np.asarray(stated, dtype=float), SUREST, 1.0 - SUREST)))


def threshold(scores: Sequence[float]) -> float | None:
    """The probability from which the set takes causes; None where there are too few cases."""
    place = int(np.floor((len(scores) + 1) * (1.0 - TRUTH_HELD) + 1e-9))
    return sorted(scores)[place - 1] if place else None


def ranks(causes: Sequence[Cause], fault: Fault) -> tuple[float, ...]:
    """Where the true value of each parameter lies among what was stated of it, 0 to 1."""
    named = {(cause.effect, cause.element): cause for cause in causes}
    found, start = [], 0
    for effect in fault.effects:
        cause = named.get((effect.name, effect.element))
        for k, parameter in enumerate(effect.parameters):
            stated = cause.parameters.get(parameter.name) if cause else None
            if stated is not None and not stated.at_bound and stated.std > 0.0:
                found.append(float(ndtr((fault.values[start + k] - stated.value) / stated.std)))
        start += len(effect.parameters)
    return tuple(found)


def histogram(places: Sequence[float]) -> tuple[int, ...]:
    """How many ranks lie in each tenth."""
    return tuple(int(n) for n in np.histogram(places, 10, (0.0, 1.0))[0])


@dataclass(frozen=True)
class SimulatedCase:
    """One simulated case and its verdict."""

    truth: frozenset[Key]  # what was wrong
    named: tuple[Key, ...]  # the causes of the verdict, most important first
    stated: dict[Key, float]  # probability of each candidate that has one worth the name
    ranks: tuple[float, ...] = ()  # of true values among what was stated of them, 0 to 1


@dataclass(frozen=True, eq=False)
class CalibrationCheck:
    """What simulated cases say of a verdict."""

    verdict: Verdict  # the verdict that was checked, as it was
    cases: tuple[SimulatedCase, ...]  # the simulated cases

    def __repr__(self) -> str:
        of = f"{self.verdict.recording[:60]}: {len(self.cases)} simulated cases"
        return f"<CalibrationCheck of {of}; first cause right in {self.first_right}>"

    @property
    def first_right(self) -> Share:
        """Cases with causes in which the first one named was one of them, element included."""
        wrong = [t for t in self.cases if t.truth]
        return Share.count_of(
            sum(bool(t.named) and t.named[0] in t.truth for t in wrong), len(wrong)
        )

    @property
    def false_alarms(self) -> Share:
        """Cases with nothing wrong in which a cause was named."""
        well = [t for t in self.cases if not t.truth]
        return Share.count_of(sum(bool(t.named) for t in well), len(well))

    @property
    def named_right(self) -> Share:
        """Causes that were named, and were at work."""
        named = [(key, t) for t in self.cases for key in t.named]
        return Share.count_of(sum(key in t.truth for key, t in named), len(named))

    @cached_property
    def recalibration(self) -> Recalibration:
        """Stated probabilities held against what turned out."""
        pairs = [(p, key in t.truth) for t in self.cases for key, p in t.stated.items()]
        return Recalibration.of([p for p, _ in pairs], [right for _, right in pairs])

    @property
    def ranks(self) -> tuple[int, ...]:
        """How many true values rank in each tenth of what was stated of them."""
        return histogram([rank for case in self.cases for rank in case.ranks])

    @cached_property
    def threshold(self) -> float | None:
        """Probability from which causes are in the set that holds the truth with 90 %."""
        wrong = [t for t in self.cases if t.truth]
        return threshold([min(t.stated.get(key, 0.0) for key in t.truth) for t in wrong])

    @property
    def truth_set(self) -> tuple[str, ...] | None:
        """Labels of that set and of what is named; None where too few cases tell of it."""
        if self.threshold is None:
            return None
        named, least = {c.label for c in self.verdict.causes}, self.threshold
        held = (c for c in self.verdict.candidates if c.probability >= least or c.label in named)
        return tuple(c.label for c in held)

    @property
    def recalibrated(self) -> Verdict:
        """The verdict with its probabilities recalibrated, and a note that says so."""
        return replace(
            self.verdict,
            causes=self._held(self.verdict.causes),
            candidates=self._held(self.verdict.candidates),
            notes=(*self.verdict.notes, self.words),
        )

    def _held(self, causes: Sequence[Cause]) -> tuple[Cause, ...]:
        return tuple(replace(c, probability=self.recalibration(c.probability)) for c in causes)

    @property
    def words(self) -> str:
        """A sentence for the verdict's notes."""
        alarms = self.false_alarms
        well = f", a cause was named where nothing was wrong in {alarms}" if alarms.of else ""
        return (
            f"checked on {len(self.cases)} simulated cases at these rows, with a gap like this "
            f"one and causes of the library: the first cause was right in {self.first_right}"
            f"{well}; probabilities are recalibrated by them; {self._held_words}"
        )

    @property
    def _held_words(self) -> str:
        """The set and the ranks."""
        share, told = percent(prior.TRUTH_HELD), self.truth_set
        if told is None:
            among = f"too few with a cause for a set that holds the truth with {share}"
        elif self.threshold == 0.0:
            among = f"no set short of the whole library holds the truth with {share}"
        else:
            among = f"the truth is with {share} among: {', '.join(told) or 'no cause at all'}"
        counts = " ".join(map(str, self.ranks))
        return f"{among}; true values by tenths of what was stated of them: {counts}"

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        counted = {
            "first_right": self.first_right,
            "named_right": self.named_right,
            "false_alarms": self.false_alarms,
        }
        told = {
            name: {"count": c.count, "of": c.of, "ci95": [c.low, c.high]}
            for name, c in counted.items()
        }
        line = self.recalibration
        held = None if self.truth_set is None else list(self.truth_set)
        return {
            "cases": len(self.cases), **told, "slope": line.slope, "offset": line.offset,
            "truth_set": {"holds": prior.TRUTH_HELD, "from": self.threshold, "causes": held},
            "ranks": list(self.ranks),
        }  # fmt: skip

    def _repr_html_(self) -> str:
        return self.recalibrated._repr_html_()


def check_calibration(
    diagnosis: Diagnosis,
    cases: int = 60,
    *,
    jobs: int = -1,
    progress: Progress | None = None,
) -> CalibrationCheck:
    """Diagnose simulated cases at the rows of a recording, with the options of its diagnosis.

    Args:
        diagnosis: Of the recording.
        cases: How many cases to simulate; each takes as long as the diagnosis itself did.
        jobs: How many to diagnose at a time; -1 for one a core.
        progress: Called with words and the share done.

    Raises:
        PlumblineError: Fewer than one case.
    """
    if cases < 1:
        raise PlumblineError(f"cases {cases}: at least 1 is needed to learn anything")
    tell = progress or silent
    tell("simulating cases", 0.0)
    options = replace(diagnosis.options, force=True)
    drawn = _simulated(diagnosis, cases)
    work = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_tried)(recording, fault, options) for recording, fault in drawn
    )
    done = []
    for case in work:
        done.append(case)
        tell(f"case {len(done)} of {cases}", len(done) / cases)
    return CalibrationCheck(diagnosis.verdict, tuple(done))


def _simulated(diagnosis: Diagnosis, cases: int) -> Iterator[tuple[Recording, Fault]]:
    """Recordings and what is wrong in them."""
    verdict, selected, options = diagnosis.verdict, diagnosis.selected, diagnosis.options
    setting = Setting(selected.model.recording, selected, verdict.noise.sigma, options.effects)
    gross = selected.model.problem.weights == 0.0
    left = Mapped(selected.model.problem).residuals(diagnosis.solution.x)
    count = min(max(len(verdict.causes), 1), prior.MOST_SIMULATED_CAUSES)
    for number in range(cases):
        rng = np.random.default_rng([options.seed, number, 23])
        fault = Fault()
        for _ in range(0 if rng.random() < prior.NOTHING_WRONG else count):
            ratio = _gap(verdict) * prior.GAP_SPREAD ** rng.uniform(-1.0, 1.0) / np.sqrt(count)
            fault = fault.and_also(
                setting.draw(max(float(ratio), prior.LEAST_GAP), rng, fault.keys)
            )
        errors = rng.normal(0.0, setting.sigma, left.shape)
        errors[gross] = left[gross]
        yield setting.recorded(fault, errors), fault


def _gap(verdict: Verdict) -> float:
    """The gap over the noise, as far as frame and tool do not absorb it."""
    gap = verdict.gap
    beyond = max(gap.before**2 - gap.noise_floor**2, 0.0)
    return float(np.sqrt(beyond) / gap.noise_floor) if gap.noise_floor > 0.0 else prior.LEAST_GAP


def _tried(
    recording: Recording,
    fault: Fault,
    options: DiagnosisOptions,
) -> SimulatedCase:
    verdict = diagnose(recording, options).verdict
    stated = {
        (c.effect, c.element): c.probability
        for c in verdict.candidates
        if c.probability >= prior.LEAST_TOLD
    }
    named = tuple((c.effect, c.element) for c in verdict.causes)
    return SimulatedCase(fault.keys, named, stated, ranks(verdict.causes, fault))
