r"""Many whole orders of one angle by one sine and one cosine: Clenshaw's recurrence.

.. math:: \sum_{k=1}^n a_k \sin k\theta + b_k \cos k\theta
          = \sin\theta\, u_1 + \cos\theta\, w_1 - w_2, \qquad
          u_k = a_k + 2 \cos\theta\, u_{k+1} - u_{k+2}

and w alike of b (Clenshaw 1955, Mathematics of Computation 9, p. 118).
"""

from collections.abc import Sequence

import casadi as cs


def fourier_sum(angle: cs.SX, sines: Sequence[cs.SX], cosines: Sequence[cs.SX]) -> cs.SX:
    """The sum at an angle [rad] of orders 1 to n, whose amplitudes are given in that order."""
    s, c = cs.sin(angle), cs.cos(angle)
    u, _ = _ends(sines, 2 * c)
    w, w_next = _ends(cosines, 2 * c)
    return s * u + c * w - w_next


def _ends(amplitudes: Sequence[cs.SX], twice: cs.SX) -> tuple[cs.SX, cs.SX]:
    """The recurrence's last two values."""
    one, two = cs.SX(0), cs.SX(0)
    for amplitude in reversed(amplitudes):
        one, two = amplitude + twice * one - two, one
    return one, two
