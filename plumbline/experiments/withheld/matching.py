r"""Which named cause answers which true one.

Strictly, a cause is right if effect and element are those of a true cause. Of confounded ones, what
the truth file lists is right as well: another effect or element that this recording cannot tell
from the true cause. Each true cause can be answered once, and the answers are matched so that as
many as possible are right,

.. math:: \text{found} = \max_{\text{matching } M} |M|, \qquad
          \text{added} = |\text{named}| - \text{found}.
"""

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
        """Whether a cause that was named is a true one or, if that counts, confounded with one."""
        return any(self._same(named, true, confounded) for true in self.truth.causes)

    def effect_fits(self, named: Key, *, confounded: bool) -> bool:
        """Whether the effect is right, whatever its element."""
        rivals = {rival[0] for _, rival in self.truth.confounded} if confounded else set()
        return named[0] in {true[0] for true in self.truth.causes} | rivals

    @cached_property
    def found(self) -> int:
        """True causes that were named."""
        return self._found(confounded=False)

    @cached_property
    def found_or_confounded(self) -> int:
        """True causes that were named, or what they are confounded with."""
        return self._found(confounded=True)

    def _same(self, named: Key, true: Key, confounded: bool) -> bool:
        return named == true or (confounded and (true, named) in self.truth.confounded)

    def _found(self, *, confounded: bool) -> int:
        named = [statement.key for statement in self.answer.causes]
        if not named or not self.truth.causes:
            return 0
        right = [[self._same(n, t, confounded) for t in self.truth.causes] for n in named]
        table = np.array(right, dtype=float)
        return int(table[linear_sum_assignment(table, maximize=True)].sum())
