"""From fits to a verdict: which kind it is, with what probability, and with which figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logsumexp

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.problem import Array
from plumbline.optim.core.solution import standard_errors
from plumbline.optim.diagnosis.discrepancy.outside import Outside
from plumbline.optim.diagnosis.findings import (
    Cause,
    Estimate,
    Gap,
    Key,
    Kind,
    Noise,
    Place,
    Step,
    Verdict,
)
from plumbline.optim.diagnosis.linearise.linear import Linear
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.noise import implausible_noise
from plumbline.optim.diagnosis.posterior.pool import Pool, settled
from plumbline.optim.diagnosis.posterior.reduction import Choice
from plumbline.optim.diagnosis.posterior.search import Found
from plumbline.optim.diagnosis.posterior.selection import slots
from plumbline.optim.diagnosis.predict.held_out import (
    Evaluation,
    counted_rows,
    judgement_of,
    square_with,
)
from plumbline.optim.diagnosis.verdict.confounding import rivals, unobservable
from plumbline.optim.diagnosis.verdict.veto import LEAST_STANDING, STRUCK
from plumbline.optim.diagnosis.verdict.where import explained_by, shares
from plumbline.optim.diagnosis.verdict.words import blame_of, merged, parameter_name, quantity
from plumbline.optim.measurement.observation import scope_of
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import ASKED, plausible

SIGMA_SPREAD = 0.07
STAND_IN = (0.1, 0.7)  # most that an unknown takes from a lone cause, and from one of several
LITTLE_LEFT = 0.05  # share of the gap's square below which causes stand firmer
MAY_STAND_IN = "a named cause may stand in for part of what the library lacks; "
ALLOWED_FOR = "its probability allows for it, more so where several are named"
NOT_ALLOWED_FOR = "no noise is stated, so its probability allows for it in part only"
MOST_LISTED = 60


def judge(
    recording: Recording,
    found: Found,
    evaluation: Evaluation,
    outside: Outside,
    noise: Noise,
    library: Sequence[type[Effect]],
    seed: int,
) -> Verdict:
    """Put the verdict together."""
    keys = _by_importance(found, seed)
    gap = _gap(evaluation, noise)
    # Other stretches of time do not foretell a bump or a drift in the one that is left out.
    timed = any(effect.runs_with_time() for effect in found.effects)
    coarse = implausible_noise(recording, noise, evaluation, timed=timed)
    beyond = max(outside.probability, misfit(noise, found), float(coarse > 0.0))
    probabilities = doubted(probabilities_of(found, outside), keys, beyond, _left(gap))
    stairs = Stairs.of(recording, found, evaluation)
    causes = tuple(_cause(found, key, probabilities, stairs, noise) for key in keys)
    missed = bool(causes) and _far(gap, noise) and not timed
    kind = _kind(bool(causes), beyond > 0.5 or missed)
    scope = scope_of(found.model.recording)
    where = shares(found.question, found.chosen, seed)
    if kind == Kind.OUTSIDE:
        # More noise than stated, with nothing seen that it depends on, is nowhere.
        where = (Place(outside.stage, outside.element, 1.0),) if outside.words else ()
    return Verdict(
        verdict=kind,
        gap=gap,
        where=where,
        causes=causes,
        candidates=_candidates(found, causes, probabilities, evaluation),
        outside_probability=float(beyond),
        outside_depends_on=outside.words if beyond > 0.5 else "",
        unobservable=tuple(unobservable(found.pool, found.question, scope, noise.sigma, library)),
        staircase=_staircase(stairs, keys, evaluation, always_words(recording)),
        noise=noise,
        distrusted_rows=tuple(int(k) + 1 for k in np.flatnonzero(~evaluation.trusted)),
        notes=_notes(recording, found, outside, noise, gap, kind, coarse=coarse),
        judged=judgement_of(found, evaluation),
        recording=recording.name,
        rows=len(recording),
        sha256=recording.sha256,
    )


def _kind(any_cause: bool, beyond: bool) -> Kind:
    if any_cause:
        return Kind.PARTLY if beyond else Kind.EXPLAINED
    return Kind.OUTSIDE if beyond else Kind.NO_GAP


def _far(gap: Gap, noise: Noise) -> bool:
    """Whether rows left out are missed by far more than their noise, whatever the fit leaves."""
    return noise.source != "fit" and gap.is_far


def misfit(noise: Noise, found: Found) -> float:
    """Probability-like measure that the residual exceeds any noise that may be.

    A noise that is implausible is none. A stated sigma is believed to seven per cent, one from
    repeats as far as their number allows; half is reached at two and a half deviations.
    """
    if noise.sigma > plausible(found.model.recording):
        return 1.0
    if noise.source == "fit":
        return 0.0
    n = max(found.best.gram.count - found.best.problem.size, 1.0)
    known = 0.5 / (3 * noise.repeats) if noise.repeats else SIGMA_SPREAD**2
    spread = float(np.sqrt(known + 0.5 / n))
    return float(expit(2.0 * ((noise.ratio - 1.0) / spread - 2.5)))


def probabilities_of(found: Found, outside: Outside) -> dict[Key, float]:
    """Probability that each cause is at work, given all else in the model, and no unknown."""
    candidates = found.question.candidates
    absent: dict[Key, float] = {}
    log_odds, _ = found.question.scan(found.question.reduce(found.chosen))
    # A rival that would be one cause more beside the slot's own speaks against emptiness only.
    room = float(np.logaddexp(0.0, logsumexp(log_odds)))
    for slot in slots(found.question, found.chosen):
        _count_out(absent, candidates, slot.raised(room).probabilities)
    # What was struck out is not out of the question: others have no claim to its share.
    log_odds, _ = found.whole_question.scan(found.whole_question.reduce(found.chosen))
    top = max(float(log_odds.max(initial=-np.inf)), 0.0)
    more = np.exp(log_odds - top) / (np.exp(-top) + np.exp(log_odds - top).sum())
    _count_out(absent, candidates, more)
    standing = outside.standing
    named = {candidates[c.index].key for c in found.chosen}
    # What is not in the model would have to do what the unknown is believed to do.
    spare = 1.0 - outside.probability
    share = {key: spare * (STRUCK if key in found.vetoed else 1.0) for key in absent}
    share |= {key: standing.get(key, 1.0) for key in named}
    return {key: (1.0 - p) * share[key] for key, p in absent.items()}


def doubted(
    probabilities: dict[Key, float], named: Sequence[Key], beyond: float, left: float
) -> dict[Key, float]:
    """Named causes, as far as they can be believed beside what the library lacks.

    The unknown that does the rest may do more, and causes stand in for part of it: several do so
    far oftener than one. With one of two true causes taken out of the library, 102 of 107 causes
    named alone beside an unknown were right, and 35 of 117 named together, whether half of the
    gap was left or a twentieth (240 recordings, gaps of 1 to 4 sigma: ``withheld bench --only
    beside --count 240 --seed 556``). Less is doubted where less is left than such gaps could show.

    Args:
        probabilities: Of all causes.
        named: The causes of the verdict.
        beyond: Probability that something outside of the library is at work.
        left: Share of the removable gap's square that the causes leave, 0 to 1.
    """
    share = 1.0 - STAND_IN[len(named) > 1] * beyond * min(1.0, float(np.sqrt(left / LITTLE_LEFT)))
    return {key: p * (share if key in named else 1.0) for key, p in probabilities.items()}


def _left(gap: Gap) -> float:
    """Share of what noise leaves to remove, as a square, that has not been removed."""
    room = gap.before**2 - gap.noise_floor**2
    rest = gap.after**2 - gap.noise_floor**2
    return float(np.clip(rest / room, 0.0, 1.0)) if room > 0.0 else 1.0


def _count_out(
    absent: dict[Key, float], candidates: Sequence[Candidate], probabilities: np.ndarray
) -> None:
    """Multiply each cause's probability of absence by that of being absent from one more slot."""
    share: dict[Key, float] = {}
    for candidate, p in zip(candidates, probabilities.tolist(), strict=True):
        share[candidate.key] = share.get(candidate.key, 0.0) + p
    for key, p in share.items():
        absent[key] = absent.get(key, 1.0) * (1.0 - min(p, 1.0))


def _by_importance(found: Found, seed: int) -> list[Key]:
    """Causes by the square that they explain."""
    if not found.chosen:
        return []
    keys = [found.question.candidates[c.index].key for c in found.chosen]
    drops = explained_by(found.question, found.chosen, [str(k) for k in keys], seed)
    return sorted(set(keys), key=lambda k: -drops[str(k)])


def _of(found: Found, keys: Sequence[Key]) -> list[Choice]:
    return [c for c in found.chosen if found.question.candidates[c.index].key in keys]


@dataclass(frozen=True, eq=False)
class Stairs:
    """Held-out figures of some of the causes, by the linear problem about the final fit.

    Attributes:
        pool: The chosen effects alone.
        choices: The choices in it.
        variance: Noise variance that weighs their priors.
        rows: The rows that the figures are of, fold by fold; only what the gap is counted in.
        points: Weighted number of points that the squares are summed over.
    """

    pool: Pool
    choices: list[Choice]
    variance: float
    rows: list[Linear]
    points: float

    @classmethod
    def of(cls, recording: Recording, found: Found, evaluation: Evaluation) -> Stairs:
        """Linearised about the final fit, once."""
        pool, choices = settled(found.pool, found.chosen, found.best.x)
        rows = counted_rows(recording, pool, evaluation)
        points = max(sum(part.n for part in rows) / (3.0 if evaluation.per_row else 1.0), 1.0)
        return cls(pool, choices, found.question.variance(found.chosen), rows, points)

    def figure(self, keys: Sequence[Key]) -> float:
        """Held-out RMS with these causes and no others."""
        chosen = [c for c in self.choices if self.pool.candidates[c.index].key in keys]
        square = square_with(self.pool, chosen, self.variance, self.rows)
        return float(np.sqrt(square / self.points))

    @property
    def keys(self) -> list[Key]:
        """All causes."""
        return list(dict.fromkeys(c.key for c in self.pool.candidates))


def always_words(recording: Recording) -> str:
    """What is fitted before any cause, as the first bar of the staircase says it."""
    effects = set(recording.always) - {"frame", "tool"}
    if recording.observation == "joint_position":
        return "zeros of the encoders alone" if effects == {"joint_offset"} else "before"
    sockets = recording.observation == "fixed_point"  # which no frame is needed for
    fitted = {"tool"} if sockets else {"frame", "tool"}
    if effects or not fitted <= set(recording.always):
        return "before"
    return "sockets and tool alone" if sockets else "frame and tool alone"


def _staircase(
    stairs: Stairs, keys: Sequence[Key], evaluation: Evaluation, first: str
) -> tuple[Step, ...]:
    steps = [Step(first, evaluation.rms_before)]
    for k, key in enumerate(keys, start=1):
        label = blame_of(key, stairs.pool.candidates).label
        steps.append(Step(label, stairs.figure(keys[:k])))
    return tuple(steps)


def _cause(
    found: Found, key: Key, probabilities: dict[Key, float], stairs: Stairs, noise: Noise
) -> Cause:
    mine = _of(found, [key])
    variants = [found.question.candidates[c.index].effect.variant for c in mine]
    effect = found.question.candidates[mine[0].index].effect
    return Cause(
        effect=key[0],
        stage=str(effect.stage),
        element=key[1],
        probability=probabilities.get(key, 0.0),
        parameters=_parameters(found, key, noise),
        before=stairs.figure([k for k in stairs.keys if k != key]),
        after=stairs.figure(stairs.keys),
        confounded_with=tuple(rivals(found.question, found.chosen, mine)),
        words=effect.sentence,
        variant="; ".join(dict.fromkeys(filter(None, variants))),
    )


def _parameters(found: Found, key: Key, noise: Noise) -> dict[str, Estimate]:
    """Estimates by name; variants of one cause are told apart by what sets them apart."""
    sigma = noise.sigma * max(noise.ratio, 1.0)
    std, free = found.best.std(sigma), _std_by_rows(found, sigma)
    stuck = set(found.best.at_bound())
    terms = [t for t in found.model.terms if (t.effect.name, t.effect.element) == key]
    width = {found.question.candidates[c.index].effect: c.scale for c in found.chosen}
    out: dict[str, Estimate] = {}
    variants = Counter(t.effect.variant for t in terms)
    for term in terms:
        variant = term.effect.variant if len(terms) > 1 or term.effect.scanned else ""
        if variants[term.effect.variant] > 1:
            variant += term.effect.tag
        for column, p in zip(
            range(term.columns.start, term.columns.stop), term.effect.parameters, strict=True
        ):
            name = found.best.problem.names[column]
            told = free[column] < width.get(term.effect, np.inf) * p.scale
            value, error = float(found.best.x[column]), float(std[column])
            unit = term.effect.unit_of(p, found.model.recording.chain)
            out[parameter_name(p.name, variant)] = Estimate(
                value, error, unit, name in stuck, p.doc, bool(told)
            )
    return out


def _std_by_rows(found: Found, sigma: float) -> Array:
    """Standard errors (P,) that the rows alone would give, without the effects' priors."""
    _, J = found.best.mapped.shared(found.best.x)
    pulls = J[:, found.model.nuisance.shared.numel() :]
    return standard_errors(found.best.gram.matrix - pulls @ pulls.T, sigma)


def _candidates(
    found: Found,
    causes: Sequence[Cause],
    probabilities: dict[Key, float],
    evaluation: Evaluation,
) -> tuple[Cause, ...]:
    """Everything considered: the causes, then the others by their probability."""
    named = {(c.effect, c.element) for c in causes}
    stages = {c.key: str(c.effect.stage) for c in found.question.candidates}
    rest = sorted((k for k in probabilities if k not in named), key=lambda k: -probabilities[k])
    after = evaluation.rms_after
    others = [
        Cause(key[0], stages[key], key[1], probability=probabilities[key], before=after)
        for key in rest[:MOST_LISTED]
    ]
    return (*causes, *others)


def _gap(evaluation: Evaluation, noise: Noise) -> Gap:
    before, after = evaluation.rms_before, evaluation.rms_after
    floor = noise.sigma * evaluation.per_point
    shrink = 1 - after / before if before > 0 else 0.0
    room = before - floor
    known = noise.source != "fit" and room > 0.05 * floor
    removable = (before - after) / room if known else float("nan")
    return Gap(
        unit=evaluation.unit,
        before=before,
        after=after,
        noise_floor=float(floor),
        shrink=float(shrink),
        shrink_ci95=evaluation.interval,
        held_out_by=evaluation.by,
        removable=float(removable),
    )


def _notes(
    recording: Recording,
    found: Found,
    outside: Outside,
    noise: Noise,
    gap: Gap,
    kind: Kind,
    *,
    coarse: float,
) -> tuple[str, ...]:
    notes = list(recording.notes)
    if coarse:
        most = quantity(plausible(recording), gap.unit)
        notes.append(
            f"{quantity(coarse, gap.unit)} an axis is left, and no set-up that is right leaves "
            f"more than {most} (1 % of the reach, or of a radian): sockets, joints, signs, units "
            "or rows are mixed up, or the device is too coarse to show a gap"
        )
    elif (
        kind == Kind.NO_GAP and noise.source == "fit" and noise.sigma > ASKED * plausible(recording)
    ):
        taken = f"{quantity(noise.sigma, gap.unit)} an axis is taken for noise"
        notes.append(f"{taken}, since none is stated: give noise_std, and it is tested")
    if kind == Kind.PARTLY:
        known = noise.source != "fit"
        notes.append(MAY_STAND_IN + (ALLOWED_FOR if known else NOT_ALLOWED_FOR))
    if _far(gap, noise):
        ratio = gap.after / gap.noise_floor
        notes.append(
            f"rows left out are missed by {ratio:.1f} times their noise: too few rows are left to "
            "fit without them, or what happened among them does not show in the others"
        )
    for key, words in outside.richer.items():
        label = blame_of(key, found.pool.candidates).label
        notes.append(f"{label} is there, but not in so simple a form: {words}")
    for key, p in outside.standing.items():
        if p < LEAST_STANDING:
            label = blame_of(key, found.pool.candidates).label
            notes.append(
                f"{label} is named for want of a better answer: something that the library lacks, "
                "or has in a plainer form only, is likelier in its place"
            )
    if not recording.chain.has_masses:
        notes.append("the robot's masses are not given: 15 kg per metre of link are assumed")
    if found.vetoed:
        struck = [blame_of(k, found.pool.candidates) for k in sorted(found.vetoed, key=str)]
        notes.append(
            "struck out, since rows left out or an unknown dependence do without: "
            f"{'; '.join(merged(struck, why=False))}"
        )
    return tuple(notes)
