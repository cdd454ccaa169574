"""How a diagnosis is asked for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from plumbline.declared import Among, Declared, Range
from plumbline.errors import PlumblineError, best_matches, listed, shown
from plumbline.kinematics.effects import EFFECTS, MOTION_EFFECTS, Effect
from plumbline.optim.core.answer import parts_of, register, restored_parts
from plumbline.optim.core.solvers import Solver
from plumbline.optim.diagnosis.constants import LARGEST_SEED
from plumbline.optim.diagnosis.posterior.search import SOLVER
from plumbline.optim.diagnosis.predict.folds import KINDS
from plumbline.optim.diagnosis.prior import UNLISTED
from plumbline.optim.measurement.storing import effect_named


@dataclass(frozen=True)
class DiagnosisOptions(Declared):
    """What may be chosen about a diagnosis.

    Attributes:
        held_out: What is left out together: ``"groups"``, ``"time"``, ``"workspace"``, ``"rows"``,
            or ``"auto"``, see :func:`plumbline.optim.diagnosis.predict.folds.fold_of_rows`.
        seed: Of folds, bootstrap and chains; the same input gives the same verdict.
        without: Names of effects that are left out of the library.
        library: Effects to consider.
        solver: What fits.
        force: Diagnose even what another simple set-up explains far better.
        unlisted: Prior probability that a gap comes of something that the library lacks.

    Raises:
        PlumblineError: An option that there is not, or an effect that the library lacks.
    """

    held_out: Annotated[str, Among(KINDS)] = "auto"
    seed: Annotated[int, Range(0, LARGEST_SEED)] = 0
    without: Sequence[str] = ()
    library: Sequence[type[Effect]] = EFFECTS
    solver: Solver = SOLVER
    force: bool = False
    unlisted: Annotated[float, Range(0.0, 1.0, "()", "give a probability")] = UNLISTED

    def __post_init__(self) -> None:
        """Refuse what there is not."""
        super().__post_init__()
        known_names = [effect.name for effect in self.library]
        known_names += [effect.name for effect in MOTION_EFFECTS]
        for name in self.without:
            if name not in known_names:
                raise _unknown(name, known_names)

    @property
    def effects(self) -> tuple[type[Effect], ...]:
        """The library without what is left out of it."""
        return tuple(effect for effect in self.library if effect.name not in self.without)


def _of_options(o: DiagnosisOptions) -> dict[str, Any]:
    """What is stored of options: the library by its effects' names."""
    solver = {"kind": type(o.solver).__name__, "fields": parts_of(o.solver)}
    library = [effect.name for effect in o.library]
    return parts_of(o) | {"without": list(o.without), "library": library, "solver": solver}


def _to_options(data: Any) -> DiagnosisOptions:
    """The options again (PlumblineError: the library had an effect that is not known here)."""
    library = tuple(effect_named(name) for name in data["library"])
    given = restored_parts(data, DiagnosisOptions, "library", "without")
    return DiagnosisOptions(library=library, without=tuple(data["without"]), **given)


register(DiagnosisOptions, _of_options, _to_options)


def _unknown(name: str, known: Sequence[str]) -> PlumblineError:
    """The error of an effect that the library lacks: it names those that are called alike."""
    near = listed([n for n in known if name.lower() in n]) or best_matches(name, known)
    return PlumblineError(
        f"without {shown(name)} not recognised. Best matches are {near}; see 'plumbline list "
        "--effects'",
        column="without",
        value=shown(name),
        limit="an effect of the library",
        remedy="see 'plumbline list --effects'",
    )
