r"""Which named cause answers which true one.

Strictly, a cause is right if effect and element are those of a true cause. Leniently, it is also
right if the truth file lists it as confounded (its ``twins``): another effect or element that this
recording cannot tell from the true cause. Each true cause can be answered once, and the answers are
matched so that as many as possible are right,

.. math:: \text{found} = \max_{\text{matching } M} |M|, \qquad
          \text{added} = |\text{named}| - \text{found}.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from plumbline.experiments.withheld.answer import StatedVerdict
from plumbline.experiments.withheld.truth import Truth
from plumbline.optim.diagnosis.findings import Key


@dataclass(frozen=True)
class ScoredCase:
    """A case's truth and the answer to it."""

    truth: Truth
    answer: StatedVerdict

    def fits(self, named: Key, *, confounded: bool) -> bool:
        """Whether a cause that was named is a true one, or, if those count, confounded with one."""
        return any(self._same(named, true, confounded=confounded) for true in self.truth.causes)

    def effect_fits(self, named: Key | None, *, confounded: bool) -> bool:
        """Whether the effect is right, whatever its element."""
        if named is None:
            return False
        rivals = {rival[0] for _, rival in self.truth.confounded} if confounded else set()
        return named[0] in {true[0] for true in self.truth.causes} | rivals

    def _same(self, named: Key, true: Key, *, confounded: bool) -> bool:
        return named == true or (confounded and (true, named) in self.truth.confounded)

    def _found(self, *, confounded: bool) -> int:
        named = [statement.key for statement in self.answer.causes]
        if not named or not self.truth.causes:
            return 0
        right = [
            [self._same(n, t, confounded=confounded) for t in self.truth.causes] for n in named
        ]
        table = np.array(right, dtype=float)
        rows, columns = linear_sum_assignment(table, maximize=True)
        return int(table[rows, columns].sum())

    @cached_property
    def found(self) -> int:
        """True causes that were named."""
        return self._found(confounded=False)

    @cached_property
    def found_or_confounded(self) -> int:
        """True causes that were named, or effects confounded with them."""
        return self._found(confounded=True)

    @property
    def added(self) -> int:
        """Causes that were named and are none."""
        return len(self.answer.causes) - self.found

    @property
    def added_beyond_confounded(self) -> int:
        """Causes that were named and neither are true nor confounded with a true one."""
        return len(self.answer.causes) - self.found_or_confounded
