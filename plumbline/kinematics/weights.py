r"""Weights that a robot's file has not right: each loads what gives way by its own share.

.. math:: c \sum_k (1 + \epsilon_k)\, m_k x_k = \sum_k (c + d_k)\, m_k x_k, \qquad
          d_k = c\, \epsilon_k

An error that is in proportion to a load is known no better than the masses that the load is worked
out from: an effect forty times the noise leaves several times the noise where these are a tenth
off, and another effect would be had to explain it. How wide :math:`d_k` is follows from what c was
found to be.
"""

from collections.abc import Sequence
from dataclasses import replace

import casadi as cs

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.parameters import Parameter

LADEN = ", under a tool of unknown mass"  # of what gives way under more than the model knows of
CARRIED = Parameter(
    "rad kg/(N m)",
    0.0,
    1.0,
    scale=5e-6,
    doc="compliance times the tool's mass",
    source="by hand: tools of a kilogram",
)
REWEIGHED = ", of bodies that do not weigh what the model says"
Bodies = tuple[tuple[int, float], ...]  # number, and 1 sigma of its mass [its mass]


def bodies_beyond(chain: Chain, joint: int) -> Bodies:
    """The bodies from a joint (from 1) outwards; none of one: its share is the whole."""
    heavy = (k for k, b in enumerate(chain.joints, 1) if k >= joint and b.mass > 0.0)
    found = tuple((k, chain.misstated) for k in heavy)
    return found if len(found) > 1 else ()


def as_found(own: Sequence[Parameter], found: Sequence[float]) -> tuple[Parameter, ...]:
    """Parameters as wide as they were found to be large; of none as they are."""
    return tuple(replace(p, scale=abs(v) or p.scale) for p, v in zip(own, found, strict=True))


def with_shares(
    own: Sequence[Parameter], found: Sequence[float], about: float, bodies: Bodies
) -> tuple[Parameter, ...]:
    """Parameters of what gives way, as found, and of every body what its weight adds.

    That is to what a compliance ``about`` does, over the body's weight.
    """
    if not bodies:
        return tuple(own)
    other = replace(own[0], lower=-about, upper=about)
    said = f"{other.doc}, times the share that body"
    more = (
        replace(other, name=f"body_{k}", doc=f"{said} {k} weighs more", scale=about * misstated)
        for k, misstated in bodies
    )
    return (*as_found(own, found), *more)


def shares(
    chain: Chain, bodies: Bodies, values: Sequence[cs.SX], of_all: cs.SX | float = 0.0
) -> cs.SX:
    """By what the weight of each body, and last a payload's, counts (n + 1)."""
    found = cs.SX(cs.DM.ones(chain.n + 1)) * of_all
    for (body, _), value in zip(bodies, values, strict=True):
        found[body - 1] += value
    return found
