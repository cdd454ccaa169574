"""How fitted effects and their fit are stored: names, fields and numbers, never objects.

An effect is found again by its name: in the library, or among the classes that the reader's own
code has defined. Nothing is imported by what a file says.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

from plumbline.errors import PlumblineError, best_matches, shown
from plumbline.kinematics.effects import MOTION_EFFECTS, REGISTRY, Effect
from plumbline.kinematics.effects.confined import NAMED, confined_kind
from plumbline.kinematics.effects.motion_effect import MotionEffect
from plumbline.optim.core.answer import register, restored
from plumbline.optim.core.judged import Solution
from plumbline.optim.core.problem import Array
from plumbline.optim.measurement.nuisance import Anchor, nuisances_of
from plumbline.optim.measurement.observation import MeasurementModel, build_model
from plumbline.optim.recording.recording import Recording


def _of_effect(effect: Effect) -> dict[str, Any]:
    """An effect's name, the name of its class, and the fields that tell its variants apart."""
    return {"name": effect.name, "form": type(effect).__name__, "fields": asdict(effect)}


def _to_effect(data: Any) -> Effect:
    return restored(data["fields"], effect_named(data["name"], data["form"]))


register(Effect, _of_effect, _to_effect)


def _to_motion_effect(data: Any) -> MotionEffect:
    """A motion's effect by its name, and by the fields that tell its forms apart."""
    known, name = {effect.name: effect for effect in MOTION_EFFECTS}, data["name"]
    if name not in known:
        raise PlumblineError(
            f"effect {shown(name)} not recognised, one of a motion's expected "
            f"(best matches: {best_matches(name, known)}); diagnose the recording again"
        )
    return restored(data["fields"], known[name])


register(MotionEffect, lambda e: {"name": e.name, "fields": asdict(e)}, _to_motion_effect)


def effect_named(name: str, form: str = "") -> type[Effect]:
    """The library's effect, else the last one defined under that name, of a class ``form``."""
    if form.startswith(NAMED) and form not in {k.__name__ for k in _defined(Effect)}:
        confined_kind(effect_named(name, form.removeprefix(NAMED)))
    known: list[type[Effect]] = [k for k in _defined(Effect) if getattr(k, "name", "") == name]
    if name in REGISTRY:
        known.append(REGISTRY[name])
    apart = [kind for kind in known if form or not kind.__name__.startswith(NAMED)]
    fitting = [kind for kind in apart if form in ("", kind.__name__)]
    if fitting:
        return fitting[-1]
    mend = "import the module that defines it first"
    raise PlumblineError(
        f"effect {shown(name)} not recognised, one of the library or of your own expected "
        f"(best matches: {best_matches(name, REGISTRY)}); {mend}",
        remedy=mend,
    )


def _defined(kind: Any) -> Iterator[Any]:
    for child in kind.__subclasses__():
        yield child
        yield from _defined(child)


@dataclass(frozen=True, eq=False)
class StoredFit:
    """What a fit is made of besides its recording and its effects."""

    x: Array  # where it ended (P,)
    weights: Array  # weights of its rows (N,)
    ridge: tuple[float, ...] | None  # what held each effect near its null
    anchor: Anchor | None  # where the device's frame was registered
    iterations: int  # how many steps it took
    message: str  # what the solver said

    @classmethod
    def of(cls, model: MeasurementModel, solution: Solution) -> Self:
        """What is stored of a model and its fit."""
        weights, anchor = model.problem.weights, model.nuisance.anchor
        return cls(solution.x, weights, model.ridge, anchor, solution.iterations, solution.message)

    def again(
        self, recording: Recording, effects: Sequence[Effect]
    ) -> tuple[MeasurementModel, Solution]:
        """The model of the rows of the fit and its effects, and where its fit ended."""
        nuisance = nuisances_of(recording, self.anchor)
        model = build_model(
            recording, effects, nuisance=nuisance, weights=self.weights, ridge=self.ridge
        )
        if self.x.shape != model.start.shape:
            raise PlumblineError(
                f"{self.x.size} values, one expected for each of {model.start.size} unknowns"
            )
        return model, Solution(model.problem, self.x, self.iterations, self.message)
