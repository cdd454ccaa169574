r"""An effect that is at work in some recordings of a session only.

.. math:: \theta \leftarrow \theta_0 + h_k\, (\theta - \theta_0)

with the null :math:`\theta_0` and :math:`h_k` = 1 in rows of those recordings, 0 in all others. At
its null an effect changes nothing, so nothing else is needed to switch it off elsewhere.
"""

from dataclasses import field, fields, make_dataclass
from functools import lru_cache
from typing import Any, cast

import casadi as cs

from plumbline.kinematics.effects.effect import Effect, State

PART = "part"  # column of a session's rows: one where the row is of the k-th recording (N, K)
OWN = ("parts", "said")
NAMED = "Confined"


def confined(effect: Effect, parts: tuple[int, ...], said: str = "") -> Effect:
    """The same effect in some recordings only.

    Args:
        effect: Any effect.
        parts: Numbers of the recordings, from 0.
        said: Where that is, in words; empty where the others could not show it anyway.
    """
    return cast(Effect, confined_kind(type(effect))(**_fields(effect), parts=parts, said=said))


def parts_of(effect: Effect) -> tuple[int, ...] | None:
    """Numbers of the recordings that it is confined to; None if it is not."""
    return getattr(effect, OWN[0], None)


def said_of(effect: Effect) -> str:
    """Where it is at work, in words; empty if that is nothing to be said."""
    return str(getattr(effect, OWN[1], ""))


def plain(effect: Effect) -> Effect:
    """The effect as it is where it is at work."""
    if parts_of(effect) is None:
        return effect
    return cast(Effect, type(effect).__mro__[1](**_fields(effect)))


def _fields(effect: Effect) -> dict[str, Any]:
    return {f.name: getattr(effect, f.name) for f in fields(effect) if f.name not in OWN}


@lru_cache(maxsize=256)
def confined_kind(base: type[Effect]) -> Any:
    """A class of its own, so that whatever is asked of the effect is answered by its own class."""
    added = [(OWN[0], tuple[int, ...], field(default=())), (OWN[1], str, field(default=""))]
    namespace = {
        "__doc__": f"{base.__name__} in some recordings of a session only.",
        "__module__": __name__,
        "apply": _apply,
        "variant": property(_variant),
        "tag": property(_tag),
    }
    name = NAMED + base.__name__
    return make_dataclass(name, added, bases=(base,), frozen=True, namespace=namespace)


def _apply(self: Effect, state: State, *values: cs.SX) -> State:
    here = cs.sum1(state.row[PART][list(parts_of(self) or ())])
    pairs = zip(values, self.parameters, strict=True)
    return plain(self).apply(state, *(p.null + here * (v - p.null) for v, p in pairs))


def _variant(self: Effect) -> str:
    own, said = plain(self).variant, said_of(self)
    return f"{said}, {own}" if own and said else own or said


def _tag(self: Effect) -> str:
    return f"{plain(self).tag} [recordings {', '.join(str(k + 1) for k in parts_of(self) or ())}]"
