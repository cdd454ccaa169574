r"""Mechanisms that resemble a listed effect and are not it: its columns, and a deviation as large.

A listed effect c with columns :math:`X_c` states a form. What nobody has listed may sit at the same
place, depend on the same and move the tip much as c does, but not just so,

.. math:: \delta y = X_c z + D_c w, \qquad z \sim N(0, s^2), \quad w \sim N(0, r^2 s^2 \kappa^2)

with D the columns of c modulated by smooth functions of what its port sees, or an unknown function
of its port, less what another listed effect of that place does, a joint's zero, or the device's
scale, which would be two listed causes and no deviation, and :math:`\kappa` such that both are as
visible (Kennedy and O'Hagan 2001, JRSS B 63(3), whose discrepancy is stated here effect
by effect). While the deviation is within the noise neither form wins by more than the prior's odds;
a strong signal of the exact form wins by what the other's freedom costs.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from plumbline.kinematics.effects import Effect, Stage
from plumbline.kinematics.effects.gear_ripple import GearRipple
from plumbline.kinematics.effects.joint_offset import JointOffset
from plumbline.kinematics.effects.screw_ripple import ScrewRipple
from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.constants import UNMOVED, VARIANTS_SEEN
from plumbline.optim.diagnosis.discrepancy.dependence import ANY, Dependence, leading
from plumbline.optim.diagnosis.discrepancy.functions import (
    as_angles,
    cosines,
    loads,
    normal,
    polynomials,
    turns,
)
from plumbline.optim.diagnosis.discrepancy.torque_dependences import seen_by_drives
from plumbline.optim.diagnosis.findings import NOUNS, Key
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.evidence import Candidate
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.recording.recording import Recording

# Families of many forms, which stand on their own, and shifts of single rows.
APART = ("another joint's angle", "two angles", "own angle, locally", "moment")


def resembling(
    listed: Sequence[Candidate],
    families: Sequence[Dependence],
    recording: Recording,
    ports: Ports,
    visible: Callable[[Array], float],
    without: Callable[[Candidate], Callable[[Array], Array]] = lambda _: lambda block: block,
) -> Iterator[Dependence]:
    """Beside each listed effect what resembles it, with shares of the effect's own prior.

    Args:
        listed: Candidates of the library, by the numbers of their columns in the ports' base.
        families: Unlisted mechanisms at every place.
        recording: The rows (N).
        ports: Ports of these rows.
        visible: Root of the squares of columns (k, N, m) that nuisances leave.
        without: Of an effect, what takes from columns that which is, with its own, another's.
    """
    if recording.stand_in:
        return  # for poses and points that were given there is no joint whose angle or load counts
    load = loads(recording)
    torques = recording.kind.efforts
    for candidate in listed:
        effect = candidate.effect
        place = (str(effect.stage), effect.element)
        own = ports.base[candidate.columns]
        size = visible(own)
        if size <= 0.0:
            continue
        looked = [(on, leading(d), 0.0) for on, d in _modulated(own, recording, load, effect)]
        # What bends a body moves all joints before it: an unknown torque of one is not like it.
        at = None if torques and effect.acts_at else place
        looked += [
            (f.on, f.columns, f.log_prior)
            for f in families
            if (f.stage, f.element) == at and f.on not in APART
        ]
        if effect.stage == Stage.JOINT and effect.element is not None:
            zero = ports.joint[effect.element - 1]
            looked = [
                (on, _off_a_zero(d, zero), log)
                for on, d, log in looked
                if not (isinstance(effect, JointOffset) and on == "own angle")
            ]
        less = without(candidate)
        looked = [(on, less(d), log) for on, d, log in looked]
        sized = ((on, d, log, visible(d) / size) for on, d, log in looked)
        found = [(on, d / ratio, log) for on, d, log, ratio in sized if ratio > UNMOVED]
        # Forms share; those that the data have chosen bear the price of that choice.
        ways = float(np.logaddexp.reduce([log for *_, log in found])) if found else 0.0
        ways += float(np.log(len(prior.DEVIATIONS) / prior.RESEMBLING))
        for seen, deviation, log in found:
            on = seen if _is_constant(effect) else effect.depends_on
            words, share = _words(*place, on, effect.name), candidate.log_prior + log - ways
            limits = (*candidate.limits, *[ANY] * len(deviation))
            for r in prior.DEVIATIONS:
                columns = np.concatenate([own, r * deviation])
                yield Dependence(words, on, *place, columns, share, limits)


def _off_a_zero(columns: Array, port: Array) -> Array:
    """Columns (k, N, m) without what a joint's zero does, which is listed, at its port (N, m)."""
    along = np.tensordot(columns, port, ((1, 2), (0, 1))) / np.sum(port**2)
    return np.asarray(columns - along[:, None, None] * port)


def _is_constant(effect: Effect) -> bool:
    """Whether an effect is the same in every row: only how it deviates depends on anything."""
    return effect.depends_on == "nothing" or isinstance(effect, JointOffset)


def resembled(pool: Pool, looks: Sequence[Sequence[SelectedTerm]]) -> list[Candidate]:
    """Effects that may be at work: the chosen ones, and the best with them or in their place.

    Of many causes one form each: a joint's orders may be dozens, and each would be resembled anew.

    Args:
        pool: The candidates.
        looks: Chosen terms, those of all causes first.
    """
    selection, chosen = pool.selection, looks[0]
    forms = {pool.candidates[c.index].key: c.index for c in reversed(chosen)}
    many = len(forms) > prior.MANY_CAUSES
    found = dict.fromkeys(reversed(forms.values()) if many else (c.index for c in chosen))
    for state in looks:
        log_odds, _ = selection.odds(selection.reduce(state))
        keys: dict[Key, int] = {}
        likeliest = np.argsort(-log_odds, kind="stable").tolist()
        for i in likeliest[: VARIANTS_SEEN * prior.MOST_RESEMBLED]:
            if np.isfinite(log_odds[i]):
                keys.setdefault(pool.candidates[i].key, i)
        found.update(dict.fromkeys(list(keys.values())[: prior.MOST_RESEMBLED]))
    return [pool.candidates[i] for i in found]


def _words(stage: str, element: int | None, on: str, name: str) -> str:
    """What a mechanism does that resembles an effect of this name."""
    where = f"the {stage}'s" if element is None else f"{NOUNS.get(stage, stage)} {element}'s"
    on = "its group or stretch of time" if on == "group" else on  # a slip needs no column of groups
    same = f"nearly as {name} has it"
    return (
        f"{where} error is {same}" if on == "nothing" else f"{same}, {where} error depends on {on}"
    )


def _modulated(
    own: Array, recording: Recording, load: Array, effect: Effect
) -> Iterator[tuple[str, Array]]:
    """Columns (k, N, m) of an effect times smooth functions of what its port sees, named."""
    for on, functions in _seen(recording, load, effect):
        unit = _unit(functions)
        yield on, (unit[:, None, :, None] * own[None]).reshape(-1, *own.shape[1:])


def _seen(recording: Recording, load: Array, effect: Effect) -> Iterator[tuple[str, Array]]:
    """Functions (K, N) of the angle, the load (N, n), the place, time and temperature, named.

    Of a ripple also of its own phase: harmonics, so that any form of the same period is near it.
    """
    element = effect.element
    joint = 1 if element is None else element
    angle = as_angles(recording)[:, joint - 1]
    turn = "own angle" if effect.stage == Stage.JOINT else "angle"
    if isinstance(effect, GearRipple | ScrewRipple):
        yield turn, turns(effect.order * recording.q[:, joint - 1], 2, constant=False)
    if recording.kind.efforts:
        yield from seen_by_drives(recording, joint)
    elif effect.stage != Stage.SENSOR:
        if effect.stage != Stage.LINK or effect.depends_on != "nothing":
            yield turn, turns(angle, 2, constant=False)
        own = load[:, min(joint - 1 + (element is None), load.shape[1] - 1)]
        if np.ptp(own) > UNMOVED:
            yield "load", polynomials(normal(own[:, None]), 2)
    else:
        place = recording.chain.placement(recording.q)[:, :3, 3]
        yield "place", polynomials(normal(place), 2)
    if recording.time is not None and np.ptp(recording.time) > 0:
        yield "time", cosines(recording.time, prior.WARMTH)
    if recording.temperature is not None and np.ptp(recording.temperature) > 0:
        yield "temperature", cosines(recording.temperature, prior.WARMTH)


def _unit(functions: Array) -> Array:
    """The same (K, N) about their means, each of mean square one."""
    level = functions - functions.mean(axis=1, keepdims=True)
    return np.asarray(level / np.maximum(level.std(axis=1, keepdims=True), 1e-12))
