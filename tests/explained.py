"""What the joint posterior says of a recording, apart from a whole diagnosis."""

from plumbline.kinematics.effects import EFFECTS
from plumbline.optim.diagnosis.diagnose import task_of
from plumbline.optim.diagnosis.options import DiagnosisOptions
from plumbline.optim.diagnosis.posterior.search import find_causes
from plumbline.optim.diagnosis.verdict.explanation import explain


def searched(recording, library=EFFECTS, **given):
    """Where the search of a recording ends, and which rows it distrusts."""
    options = DiagnosisOptions(library=tuple(library), **given)
    return find_causes(task_of(recording, options), lambda words, share: None)


def told(recording, library=EFFECTS, unlisted=0.2, seed=0):
    """What the joint posterior about it says; of no library, what a recording shows by itself."""
    return explain(searched(recording, library)[0], seed, unlisted)


def library_without(*names):
    """The library without some effects."""
    return tuple(effect for effect in EFFECTS if effect.name not in names)
