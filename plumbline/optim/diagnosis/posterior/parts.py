r"""Which listed terms together with an unlisted mechanism are parts of it, and how probably.

A mechanism has a place and something that drives it. What nobody has listed need not be one term of
ours: listed columns take up what its own leave. A listed term of its place and driver is one more
form of it, no cause more. Of another place, or driver, it may be a part with a stated probability
:math:`\pi` beforehand, of another place and driver with :math:`\pi^2`: each may be told wrongly.

Whatever a mechanism at a place does, it moves row n only along what that place can move,
:math:`D_n`. So what speaks for a term of another place in the rest of the rows,
:math:`(I - D_n D_n^+) t_n`, speaks against its being a part,

.. math:: P(\text{part}) = \frac{\pi^a}{\pi^a + (1 - \pi^a) B_k}, \qquad
          B_k = \frac{p(\text{rest} \mid k \text{ and the other listed terms})}
                     {p(\text{rest} \mid \text{the others})}.

Where the place can move all there is, nothing is left to tell, and B = 1; nor is B less: a rest
that says nothing for the term leaves what all of the rows say.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Mechanism = tuple[str, int | None, str, str | None]  # stage, element, on what it depends, effect
# What drives a mechanism of one place alone, and what goes along with what else in a recording.
OWN_DRIVERS = frozenset({"own angle", "another joint's angle", "angle", "nothing"})
SAME_DRIVER = {"velocity": "direction", "history": "direction", "temperature": "time"}
SAME_DRIVER |= {"two angles": "own angle", "place, locally": "place"}
SAME_DRIVER |= {
    "own angle, across the axis": "own angle",
    "own angle, locally": "own angle",
    "moment": "time",
    "load, mounted otherwise": "load",
}


def apart(mechanisms: Sequence[Mechanism]) -> NDArray[np.intp]:
    """Of every two mechanisms (L, L), in how much they differ: in place, and in what drives them.

    A joint's angle drives that joint alone.
    """
    places = [m[:2] for m in mechanisms]
    at = np.array([places.index(place) for place in places])
    words = [[SAME_DRIVER.get(word, word) for word in m[2].split(" and ")] for m in mechanisms]
    drivers = [
        [(word, place if word in OWN_DRIVERS else None) for word in own]
        for own, place in zip(words, places, strict=True)
    ]
    every = dict.fromkeys(one for own in drivers for one in own)
    driven = np.array([[one in own for one in every] for own in drivers], dtype=np.intp)
    return (at[:, None] != at).astype(np.intp) + (driven @ driven.T == 0)
