"""What a servo of second order makes over a sample of what fades beside it."""

import math

import casadi as cs

from plumbline.kinematics.constants import EQUAL, TERMS


def chained(pace: cs.SX, other: cs.SX, stays: cs.SX) -> tuple[cs.SX, cs.SX]:
    r"""Place and speed [1, 1/sample] that a servo of second order gains by what fades beside it.

    Divided differences of :math:`e^{-x}` at its pace, twice, and at the other's, which a series
    tells where these are nearly one (McCurdy, Ng, Parlett 1984, Math. Comp. 43:501).
    """
    apart, fades = pace - other, cs.exp(-other)
    near = cs.fabs(apart) < EQUAL
    x, small = cs.if_else(near, 1, apart), cs.if_else(near, apart, 0)
    terms = [(-small) ** k / math.factorial(k) for k in range(TERMS)]
    once, twice = (fades * sum(t / (k + n) for k, t in enumerate(terms)) for n in (1, 2))
    once = cs.if_else(near, once, (fades - stays) / x)
    twice = cs.if_else(near, twice, (fades - (1 + x) * stays) / x**2)
    return pace**2 * twice, pace**2 * (once - pace * twice)
