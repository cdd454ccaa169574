r"""Does an axis go where it is sent, whatever it reads? A drive may be held, or turned round.

And a tracker may follow something else, which stands still but for its noise. From a look a to now
an axis was sent :math:`w = p_k - p_a` by what is under way (:mod:`.underway`), of which dry
friction that nobody told may have taken a part, and a drive may do half of the rest:

.. math:: m = \max(|w| - \tfrac{1}{10}\, v_{max}\, (t - t_a),\, 0), \qquad
          g = \max((y_k - y_a)\, \operatorname{sign} w,\, 0)

It does not obey where, since two looks at least, for every lateness that is looked for,

.. math:: m / 2 - g > 2\,\mathrm{mm} + 3 \sqrt{2}\, \sigma

with :math:`\sigma` the noise of a reading: one look alone may have been a reading that leapt. It
stays so until it is seen to have gone there.
"""

from dataclasses import dataclass

import numpy as np

from plumbline.optim.capsule_mpc import constants
from plumbline.optim.capsule_mpc.statement import Statement
from plumbline.optim.core.problem import Array


@dataclass(frozen=True)
class Astray:
    """An axis that does not go where it is sent."""

    place: Array  # as read at the looks (A,) since which that is so [mm, or units]
    way: float  # sign of the way that it was sent
    sent: Array  # how far, beyond what friction may take, it was sent since (A,) [mm, or units]
    seconds: float  # since the first of them [s]

    def still(self, now: float, least: float) -> bool:
        """Whether it has not come there."""
        gone = np.maximum((now - self.place) * self.way, 0.0)
        return bool((constants.OBEYED * self.sent - gone > least).all())


class Obeying:
    """Holds what is read against what was sent, over the last second."""

    def __init__(self, statement: Statement, noise: float) -> None:
        """For readings with so much noise, 1 sigma [mm, or units]."""
        s = statement.settings
        self._dt = s.dt
        self._every = max(1, round(constants.BETWEEN_LOOKS / s.dt))
        self._most = round(constants.WATCHED / constants.BETWEEN_LOOKS)
        self._slow = constants.HELD * statement.speed * s.dt
        self.least = constants.ASTRAY + constants.STANDARD * np.sqrt(2.0) * noise
        self.reset()

    def reset(self) -> None:
        """Nothing was seen."""
        # When, what was read (n,), and where by every lateness it was sent (T, n).
        self._looks: list[tuple[int, Array, Array]] = []
        self.astray: dict[int, Astray] = {}

    def look(self, read: Array, then: Array, steps: int) -> None:
        """What is read (n,) after so many steps, and where by every lateness it should be."""
        gone = [j for j, one in self.astray.items() if not one.still(read[j], self.least)]
        for j in gone:
            del self.astray[j]
        if gone:
            self._looks.clear()
        if len(self._looks) > 1:
            # What obeys one lateness obeys: of the others most steps need to know nothing.
            middle = len(then) // 2
            if (self._short(read, then, steps, slice(middle, middle + 1))[0].sum(axis=0) > 1).any():
                self._compare(read, then, steps)
        if not self._looks or steps - self._looks[-1][0] >= self._every:
            self._looks = [*self._looks[-self._most + 1 :], (steps, read.copy(), then.copy())]

    def _short(self, read: Array, then: Array, now: int, late: slice) -> tuple[Array, Array, Array]:
        """By some latenesses: which axes fall short since each look (A, n), ways, those beyond."""
        ages = now - np.array([k for k, _, _ in self._looks])
        sent = then[late] - np.array([at[late] for _, _, at in self._looks])  # (A, T, n)
        beyond = np.maximum(np.abs(sent) - (ages[:, None] * self._slow)[:, None], 0.0)
        way = read - np.array([place for _, place, _ in self._looks])
        gone = np.maximum(way[:, None] * np.sign(sent), 0.0)
        short = (constants.OBEYED * beyond - gone).min(axis=1) > self.least
        return np.asarray(short), sent, beyond

    def _compare(self, read: Array, then: Array, now: int) -> None:
        short, sent, beyond = self._short(read, then, now, slice(None))
        steps = now - np.array([k for k, _, _ in self._looks])
        places = np.array([place for _, place, _ in self._looks])
        for j in np.flatnonzero(short.sum(axis=0) > 1).tolist():
            if j not in self.astray:
                since = short[:, j]
                sign, least = float(np.sign(sent[since][0, 0, j])), beyond[since, :, j].min(axis=1)
                seconds = self._dt * float(steps[since].max())
                self.astray[j] = Astray(places[since, j], sign, least, seconds)
