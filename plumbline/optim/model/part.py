r"""One recording's part of a joint fit: its own frame and tool, with the causes at work in it.

.. math:: P' = P_{aa} - P_{ab} P_{bb}^{-1} P_{ba}

is the inverse covariance of the unknowns a that are of one recording, whatever the others b are.
"""

import numpy as np

from plumbline.errors import best_matches, fault, shown
from plumbline.kinematics.effects.confined import parts_of, plain
from plumbline.optim.model.making import FitEnd
from plumbline.optim.recording.recording import Session


def number_of(session: Session, name: str) -> int:
    """Number of the recording of a name; the first that says where the tip is, without one.

    Raises:
        PlumblineError: There is none of that name.
    """
    names = [part.name for part in session.parts]
    if not name:
        places = [k for k, part in enumerate(session.parts) if part.kind.places]
        return (places or [0])[0]
    if name not in names:
        near = best_matches(name, names)
        raise fault("recording", shown(name), "one of the session", f"best matches: {near}")
    return names.index(name)


def of_part(fit: FitEnd, k: int) -> FitEnd:
    """The fit as recording k has it."""
    own = fit.nuisance.own[k]
    sizes = np.cumsum([fit.nuisance.size, *(len(e.parameters) for e in fit.effects)])
    columns, effects = [own.columns], []
    for effect, first, last in zip(fit.effects, sizes[:-1], sizes[1:], strict=True):
        if k in (parts_of(effect) or (k,)):
            columns.append(np.arange(first, last))
            effects.append(plain(effect))
    mine = np.concatenate(columns)
    rest = np.setdiff1d(np.arange(len(fit.x)), mine)
    P = fit.precision
    cross = P[np.ix_(mine, rest)]
    back = np.linalg.pinv(P[np.ix_(rest, rest)], hermitian=True)
    precision = P[np.ix_(mine, mine)] - cross @ back @ cross.T
    return FitEnd(fit.nuisance.parts[k], effects, fit.x[mine], fit.scale[mine], precision)
