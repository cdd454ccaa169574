"""From fits to a verdict: which kind it is, with what probability, and with which figures.

A verdict on efforts in newton metres, whose residuals are fitted in units of each joint's noise.

The gap is the root mean square over all joints of what was measured, as the noise is, so that
some joint misses by as much or more. What a linear problem says of fewer causes keeps its ratio.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from plumbline.kinematics.effects import Effect
from plumbline.optim.core.judged import Judgement
from plumbline.optim.core.quantities import quantity
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import MOST_LISTED
from plumbline.optim.diagnosis.findings import (
    Blame,
    Cause,
    Gap,
    NoiseLevel,
    Outcome,
    Place,
    Verdict,
)
from plumbline.optim.diagnosis.of_recordings import JointGap, TurnGap
from plumbline.optim.diagnosis.posterior.search import SelectedModel
from plumbline.optim.diagnosis.predict.held_out import Evaluation, by_chance, judgement_of
from plumbline.optim.diagnosis.predict.shrink import gap_between
from plumbline.optim.diagnosis.verdict.causes import (
    Stairs,
    always_words,
    by_importance,
    causes_of,
    staircase,
)
from plumbline.optim.diagnosis.verdict.confounding import odds_moved, unobservable
from plumbline.optim.diagnosis.verdict.explanation import Explanation
from plumbline.optim.diagnosis.verdict.lack_of_fit import (
    block_errors,
    freedom_of,
    implausible_noise,
    is_far,
    is_noisier,
    is_seen,
    lack_of_fit,
    noisier_encoder,
    noisiest_joint,
    quieter,
    turned_sides,
)
from plumbline.optim.diagnosis.verdict.parts import friction_curves
from plumbline.optim.diagnosis.verdict.where import expected_shares, shares
from plumbline.optim.diagnosis.verdict.words import blame_of, merged
from plumbline.optim.measurement.observation import rotation_lever, scope_of
from plumbline.optim.measurement.pose_noise import correlation_of_ways
from plumbline.optim.measurement.refit import figure, scattered
from plumbline.optim.measurement.torque import newton_metres, own_units
from plumbline.optim.recording.constants import ASKED
from plumbline.optim.recording.recording import Recording
from plumbline.optim.recording.set_up import plausible
from plumbline.optim.recording.table import row_numbers


def judge(
    recording: Recording,
    selected: SelectedModel,
    evaluation: Evaluation,
    told: Explanation,
    noise: NoiseLevel,
    library: Sequence[type[Effect]],
    seed: int,
) -> Verdict:
    """Put the verdict together."""
    keys = by_importance(selected, seed)
    missing = selected.best.gram.count * max(noise.ratio**2 - 1.0, 0.0) * noise.sigma**2
    told = told.doubted(lack_of_fit(noise, selected), missing, keys)
    named = [key for key in keys if key in told.named]
    confounded = [key for key in keys if key not in told.named]
    fitted = selected.model.recording  # which knows what a turn counts
    gap = replace(gap_of(evaluation, noise), rotation=_rotation(fitted, evaluation, noise))
    # Other stretches of time do not foretell a bump or a drift in the one that is left out.
    timed = any(effect.runs_with_time() for effect in selected.effects)
    coarse = implausible_noise(recording, noise, evaluation, timed=timed)
    left = max(lack_of_fit(noise, selected), float(coarse > 0.0))  # by what is named
    beyond = max(told.unlisted, left)
    stairs = Stairs.of(recording, selected, evaluation)
    # What is missing makes rows near each other err alike: then blocks of them count, not rows.
    errors = block_errors(selected, evaluation.models) if told.is_open and named else 0.0
    causes = causes_of(selected, named, told, stairs, noise, errors)
    judged = judgement_of(selected, evaluation)
    least = by_chance(recording, selected, evaluation) * max(noise.ratio, 1.0)
    noisier = told.unlisted <= 0.5 and is_noisier(noise, selected)
    known = noise.source != "fit" and not noisier
    earned = max(told.conditional, left) < prior.UNLISTED and known
    earned = earned and _is_earned(gap, causes, judged, least)
    seen = is_seen(recording, selected, gap, least if known else np.inf)
    kind = Outcome.of(bool(causes), beyond=seen or beyond > 0.5, earned=earned)
    words = told.words or noisiest_joint(recording, selected)
    return Verdict(
        verdict=kind,
        gap=gap,
        where=_where(selected, told, seed),
        causes=causes,
        candidates=_candidates(selected, causes, told, evaluation),
        outside_probability=float(beyond),
        outside_depends_on=words if beyond > 0.5 else "",
        tree=told.tree,
        unlisted_prior=told.prior,
        unobservable=_unseen(selected, causes, noise.sigma, library),
        staircase=staircase(stairs, [*named, *confounded], evaluation, always_words(recording)),
        noise=noise,
        distrusted_rows=row_numbers(~evaluation.trusted),
        notes=_notes(recording, selected, told, noise, gap, kind, coarse=coarse, noisier=noisier),
        judged=judged,
        recording=recording.name,
        rows=len(recording),
        sha256=recording.sha256,
        friction=friction_curves(selected, noise, errors),
    )


def _unseen(
    selected: SelectedModel, causes: Sequence[Cause], sigma: float, library: Sequence[type[Effect]]
) -> tuple[Blame, ...]:
    """What cannot be seen, and is not listed as confounded with a cause either."""
    asked, keys = selected.selection, {(c.effect, c.element) for c in causes}
    named = [c for c in selected.chosen if asked.candidates[c.index].key in keys]
    alike = {(rival.effect, rival.element) for c in causes for rival in c.confounded_with}
    scope = scope_of(selected.model.recording)
    unseen = unobservable(selected.pool, asked, named, scope, sigma, library)
    return tuple(blame for blame in unseen if (blame.effect, blame.element) not in alike)


def _where(selected: SelectedModel, told: Explanation, seed: int) -> tuple[Place, ...]:
    """Shares of the gap by place: by what listed terms explain, named or not, else unlisted ones.

    Where several may do the same, or causes are many, places have their mean share of what may be
    at work. More noise than stated, with nothing seen that it depends on, is nowhere.
    """
    equals = any(told.probabilities[key] < prior.LEAST_NAMED for key in told.named)
    states = told.swept or (told.states if equals else ())
    if selected.chosen and states:
        return expected_shares(selected.selection, states, seed)
    if selected.chosen or told.unlisted <= 0.5:
        return shares(selected.selection, selected.chosen, seed)
    lacked = sorted(told.lacked_at.items(), key=lambda item: -item[1])
    return tuple(Place(*place, share) for place, share in lacked)


def _is_earned(gap: Gap, causes: Sequence[Cause], judged: Judgement, chance: float) -> bool:
    """Whether a gap may be called explained: down to a noise that is known, by fits that ended.

    Args:
        gap: The gap.
        causes: What is named.
        judged: How the fits ended.
        chance: Ratio of held-out figure to noise that chance alone hardly exceeds, where rows left
            out err as those fitted do: whether that is more than noise is a question of its own.
    """
    # Where chance alone would miss rows by far, they test nothing.
    if gap.is_far or gap.after > max(prior.EARNED, chance) * gap.noise_floor:
        return False
    stuck = any(e.at_bound for cause in causes for e in cause.parameters.values())
    return judged.converged and not stuck


def _candidates(
    selected: SelectedModel,
    causes: Sequence[Cause],
    told: Explanation,
    evaluation: Evaluation,
) -> tuple[Cause, ...]:
    """Everything considered: the causes, then the others by their probability."""
    probabilities = told.probabilities
    moved = odds_moved(selected.pool.selection, selected.chosen, probabilities, told.prior)
    named = {(c.effect, c.element) for c in causes}
    stages = {c.key: str(c.effect.stage) for c in selected.selection.candidates}
    rest = sorted((k for k in probabilities if k not in named), key=lambda k: -probabilities[k])
    after = evaluation.rms_after
    others = [
        Cause(key[0], stages[key], key[1], moved.get(key, ""), probabilities[key], before=after)
        for key in rest[:MOST_LISTED]
    ]
    return (*causes, *others)


def gap_of(evaluation: Evaluation, noise: NoiseLevel) -> Gap:
    """The gap of these residuals, and how much of what noise leaves to remove is gone."""
    sides, floor = (evaluation.rms_before, evaluation.rms_after), noise.sigma * evaluation.per_point
    return gap_between(evaluation.unit, sides, noise, floor, evaluation.interval, evaluation.by)


def _rotation(recording: Recording, evaluation: Evaluation, noise: NoiseLevel) -> TurnGap | None:
    """RMS of the turns [rad] that a pose's positions do not show; none of other readings."""
    if recording.several or not recording.kind.oriented:
        return None
    lever = rotation_lever(recording)
    ends = (evaluation.before, evaluation.after)
    before, after = (figure(r[evaluation.rows, 3:], True) / lever for r in ends)
    floor = noise.sigma * evaluation.per_point / lever
    return TurnGap(before, after, None if noise.source == "fit" else floor)


def _notes(
    recording: Recording,
    selected: SelectedModel,
    told: Explanation,
    noise: NoiseLevel,
    gap: Gap,
    kind: Outcome,
    *,
    coarse: float,
    noisier: bool,
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
        kind == Outcome.NO_GAP
        and noise.source == "fit"
        and noise.sigma > ASKED * plausible(recording)
    ):
        taken = f"{quantity(noise.sigma, gap.unit)} an axis is taken for noise"
        notes.append(f"{taken}, since none is stated: give noise_std, and it is tested")
    if kind == Outcome.NO_GAP:
        notes += noisier_encoder(recording, selected)
    notes += _correlated(recording, noise)
    if told.compared:
        rows = f"{told.compared} of {len(selected.model.recording)} rows, evenly spread"
        notes.append(f"probabilities and the tree are from {rows}; fits and figures are of all")
    if told.apart > prior.LEAST_TOLD:
        notes.append(
            f"two searches from different starts differ by {told.apart:.2f} in a probability: "
            "what is told apart here is told by little"
        )
    formless = lack_of_fit(noise, selected) > 0.5 and not told.words
    measured = replace(noise, sigma=newton_metres(recording) * noise.sigma)
    notes += _missed(gap, measured, formless=formless, noisier=noisier)
    notes += quieter(measured, freedom_of(selected), gap.unit)
    if not recording.chain.has_masses and not recording.stand_in:
        notes.append("the robot's masses are not given: 15 kg per metre of link are assumed")
    if recording.kind.encoders and any(name == "joint_offset" for name, _ in told.named):
        notes.append(
            "a zero of a second encoder is the joint's or its mounting's: [fit] always = "
            '["joint_offset"] fits them all and judges none'
        )
    notes += [*turned_sides(selected, told.words), *_unnamed(selected, told)]
    return tuple(notes)


def _unnamed(selected: SelectedModel, told: Explanation) -> Iterator[str]:
    """What a search chose and the verdict does not name, by reason."""
    improbable = {
        k for k in selected.excluded if told.probabilities.get(k, 0.0) < prior.LEAST_NAMED
    }
    said = {
        "in the model, but each too improbable to be named": (
            selected.selection.keys(selected.chosen) - told.named
        ),
        "a first search chose them, but each is too improbable to be named": improbable,
        "not named, though a first search chose them; rows left out are foretold as well without": (
            selected.excluded - improbable
        ),
    }
    for words, keys in said.items():
        if keys:
            blamed = [blame_of(k, selected.pool.candidates) for k in sorted(keys, key=str)]
            yield f"{words}: {'; '.join(merged(blamed, why=False))}"


def _missed(gap: Gap, noise: NoiseLevel, *, formless: bool, noisier: bool) -> Iterator[str]:
    """What is said of residuals far above the noise: those of the fit, or of rows left out alone.

    Args:
        gap: The gap.
        noise: The noise as measured, and how many times as much the fit leaves.
        formless: Whether the fit leaves more than noise, and nothing tells what that follows.
        noisier: Whether it leaves more than the stated noise, and that is noise.
    """
    if noisier:
        left = quantity(noise.ratio * noise.sigma, gap.unit)
        yield (
            f"noise larger than stated: {left} an axis, {noise.ratio:.2g} times noise_std; what is "
            "left follows nothing that was recorded"
        )
    elif formless and noise.source == "given":
        left = quantity(noise.ratio * noise.sigma, gap.unit)
        yield (
            f"what is left is {noise.ratio:.1f} times the noise that is stated and follows nothing "
            f"that was recorded: so would noise of {left} be, were noise_std too small"
        )
    elif is_far(gap, noise) and noise.ratio < prior.FAR:
        ratio = gap.after / gap.noise_floor
        yield (
            f"rows left out are missed by {ratio:.1f} times their noise: too few rows are left to "
            "fit without them, or what happened among them does not show in the others"
        )


def loose_joints(recording: Recording, noise: NoiseLevel) -> str:
    """What is said of joints that scatter."""
    assert recording.scatter is not None
    sigma = noise.ratio * noise.sigma / scattered(recording)
    kinds = zip(recording.scatter.tolist(), recording.chain.kinds, strict=True)
    sizes = [quantity(k * sigma, "rad" if kind == "revolute" else "m") for k, kind in kinds]
    which = [f"joint {j + 1} by {sizes[j]}" for j in np.flatnonzero(recording.scatter)]
    if len(set(sizes)) == 1:
        which = [f"each joint by {sizes[0]}"]
    return (
        f"from row to row {', '.join(which)} (1 sigma) is elsewhere than it reads, as where "
        f"encoders or drives do not repeat, beside {quantity(sigma, recording.kind.unit)} of each "
        "reading: no model foretells that"
    )


def _correlated(recording: Recording, noise: NoiseLevel) -> Iterator[str]:
    """What is said of rows that know of each other, or err with their speed."""
    if recording.jitter:
        off = recording.jitter * noise.sigma
        by = f"{off:.2g} of a row" if recording.time is None else quantity(off, "s")
        yield (
            f"noise along the way grows with the speed, as where a clock is uncertain by {by} "
            "(1 sigma): fast rows count for less"
        )
    if recording.scatter is not None:
        yield loose_joints(recording, noise)
    if recording.pose_spread is not None:
        yield (
            "errors of a pose's place and turn go along (by up to "
            f"{correlation_of_ways(recording.pose_spread):.2f}) or differ from way to way: they "
            "are weighed as that"
        )
    if recording.wander:
        yield (
            f"the noise of a row correlates by {recording.wander:g} with that of the row before "
            "it: what it foretells of it counts once"
        )
    if recording.wander and recording.time is None:
        yield (
            "no time is recorded: if the rows stand in the order in which they were taken, a "
            "column time (the row's number will do) lets a bump, a slip or a drift be told"
        )
    if recording.alike:
        yield (
            f"readings of one posture correlate by {recording.alike:.2g}: together they count for "
            "little more than one"
        )


def in_own_unit(verdict: Verdict, recording: Recording, evaluation: Evaluation) -> Verdict:
    """The verdict with its gap, its causes' gaps and its noise in the unit that was measured."""
    if not recording.kind.efforts:
        return verdict
    by, own = newton_metres(recording), own_units(recording)
    sides = (evaluation.before * own / by, evaluation.after * own / by)
    measured = replace(evaluation, before=sides[0], after=sides[1], interval=evaluation.told)
    gap, least = gap_of(measured, verdict.noise), max(evaluation.rms_after, 1e-300)
    per = by * measured.rms_after / least  # of what the linear problem says of fewer causes
    first, *steps = verdict.staircase
    return replace(
        verdict,
        gap=replace(
            gap, before=by * gap.before, after=by * gap.after, noise_floor=by * gap.noise_floor
        ),
        noise=replace(verdict.noise, sigma=by * verdict.noise.sigma),
        causes=tuple(_scaled(cause, per) for cause in verdict.causes),
        candidates=tuple(_scaled(cause, per) for cause in verdict.candidates),
        staircase=(
            replace(first, gap=by * gap.before),
            *(replace(step, gap=per * step.gap) for step in steps),
        ),
        joints=tuple(_joints(recording, evaluation)),
    )


def _joints(recording: Recording, evaluation: Evaluation) -> Iterator[JointGap]:
    """What is left of every joint's efforts on rows that were left out [N m], [N] if it slides."""
    rows, own = evaluation.rows, own_units(recording)
    pairs = zip(evaluation.before[rows].T, evaluation.after[rows].T, strict=True)
    for j, (kind, sides) in enumerate(zip(recording.chain.kinds, pairs, strict=True)):
        before, after = (float(own[j] * np.sqrt(np.mean(side**2))) for side in sides)
        yield JointGap(
            j + 1, f"joint {j + 1}", before, after, "N" if kind == "prismatic" else "N m"
        )


def _scaled(cause: Cause, by: float) -> Cause:
    return replace(cause, before=by * cause.before, after=by * cause.after)
