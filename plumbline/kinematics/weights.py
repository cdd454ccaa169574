r"""Weights that a robot's file has not right: each loads what gives way by its own share.

.. math:: c \sum_k (1 + \epsilon_k)\, m_k x_k = \sum_k (c + d_k)\, m_k x_k, \qquad
          d_k = c\, \epsilon_k

An error that is in proportion to a load is known no better than the masses that the load is worked
out from: an effect forty times the noise leaves several times the noise where these are a tenth
off, and another effect would be had to explain it.
"""

from collections.abc import Sequence
from dataclasses import replace

import casadi as cs

from plumbline.kinematics.chain import Chain
from plumbline.kinematics.constants import MISSTATED
from plumbline.kinematics.parameters import Parameter

REWEIGHED = ", of bodies that do not weigh what the model says"
Bodies = tuple[int, ...]


def bodies_beyond(chain: Chain, joint: int) -> Bodies:
    """Numbers of the bodies from a joint (from 1) outwards; none of one: its share is the whole."""
    found = tuple(k for k, b in enumerate(chain.joints, 1) if k >= joint and b.mass > 0.0)
    return found if len(found) > 1 else ()


def misstated(compliance: Parameter, bodies: Bodies) -> tuple[Parameter, ...]:
    """Of every body what its weight adds to what a compliance does, over its weight."""
    size = compliance.upper * MISSTATED
    other = replace(compliance, lower=-size, upper=size, scale=compliance.scale * MISSTATED)
    said = f"{compliance.doc}, times the share that body"
    return tuple(replace(other, name=f"body_{k}", doc=f"{said} {k} weighs more") for k in bodies)


def shares(
    chain: Chain, bodies: Bodies, values: Sequence[cs.SX], of_all: cs.SX | float = 0.0
) -> cs.SX:
    """By what the weight of each body, and last a payload's, counts (n + 1)."""
    found = cs.SX(cs.DM.ones(chain.n + 1)) * of_all
    for body, value in zip(bodies, values, strict=True):
        found[body - 1] += value
    return found
