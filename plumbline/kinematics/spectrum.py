r"""Some whole orders of one angle by one sine and one cosine: Horner's rule.

.. math:: \sum_k a_k \sin k\theta + b_k \cos k\theta = \Re \sum_k (b_k - i a_k) z^k, \qquad
          z = e^{i \theta}

from the highest order down, each gap between two orders by one power of z.
"""

from collections.abc import Mapping

import casadi as cs

Complex = tuple[cs.SX, cs.SX]


def fourier_sum(angle: cs.SX, amplitudes: Mapping[int, Complex]) -> cs.SX:
    """The sum at an angle [rad] of orders from 1 on, each with its sine and its cosine."""
    orders = sorted(amplitudes, reverse=True)
    powers = {1: (cs.cos(angle), cs.sin(angle))}
    re, im = cs.SX(0), cs.SX(0)
    for order, below in zip(orders, [*orders[1:], 0], strict=True):
        sine, cosine = amplitudes[order]
        re, im = _times((re + cosine, im - sine), _power(order - below, powers))
    return re


def _power(order: int, known: dict[int, Complex]) -> Complex:
    """A power of z by its halves, which are kept."""
    if order not in known:
        half = order // 2
        known[order] = _times(_power(half, known), _power(order - half, known))
    return known[order]


def _times(a: Complex, b: Complex) -> Complex:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]
