"""What every method answers with: it is judged, shown, drawn, stored and brought back.

An answer is a frozen dataclass. :meth:`Answer.to_dict` holds its figures for whoever reads JSON;
:meth:`Answer.save` stores them beside the fields themselves, from which :meth:`Answer.load` brings
the same answer back without solving anything again. Nothing that is read is ever run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from plumbline.errors import PlumblineError, best_matches, fault, listed, shown
from plumbline.kinematics.files import new_file, read_file, reason
from plumbline.optim.core.constants import LARGEST_ANSWER
from plumbline.optim.core.stored import plain, restored, stored
from plumbline.pictures import CARDS, DRAWN

if TYPE_CHECKING:
    from plumbline.optim.core.judged import Judgement

FORMAT = "plumbline answer"
SAVE_IT = "save the answer again: answer.save(FILE) in Python, not --json"


class Answer:
    """The base of every answer; what differs is :attr:`judged`, :meth:`card` and the fields."""

    kinds: ClassVar[dict[str, type[Answer]]] = {}

    def __init_subclass__(cls) -> None:
        Answer.kinds[cls.__name__] = cls

    if TYPE_CHECKING:  # a field or a property of each answer

        @property
        def judged(self) -> Judgement:
            """Every solve behind it: converged? By stationarity, feasibility and bounds."""

    def card(self) -> str:
        """A compact piece of HTML that needs nothing else, every word of the data escaped."""
        return str(import_module(CARDS[-1]).card_of(self))

    def _repr_html_(self) -> str:
        return self.card()

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures that :meth:`plot` draws, the first of them unless one is named."""
        return tuple(_drawers(self))

    def plot(self, name: str = "") -> Any:
        """The picture that says most about it, or the one of a name.

        Args:
            name: One of :attr:`pictures`.

        Raises:
            PlumblineError: Nobody draws this kind of answer, there is no picture of that name, or
                the data have nothing for it.
        """
        made = _drawers(self)
        if not made:
            raise PlumblineError(f"plot of a {type(self).__name__}: none; use its figures instead")
        if name and name not in made:
            raise PlumblineError(
                f"picture {shown(name)}: not one of a {type(self).__name__}. Best matches are "
                f"{best_matches(name, made) or 'none'}"
            )
        picture = made[name or next(iter(made))]()
        if picture is None:
            raise PlumblineError(
                f"picture {name}: the data have nothing for it, such as a column that was not "
                f"recorded; others are {listed(k for k in made if k != name)}"
            )
        return picture

    def to_dict(self) -> dict[str, Any]:
        """Its figures as plain numbers, strings, lists and dictionaries in SI units.

        What is not finite becomes None, so that it is JSON.
        """
        found = plain(self)
        assert isinstance(found, dict)
        return found

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store it as JSON, whole or not at all.

        Args:
            path: The file.
            overwrite: Whether a file that is there may go.

        Raises:
            PlumblineError: There is a file already, or it cannot be written.
        """
        content = {
            "format": FORMAT,
            "kind": type(self).__name__,
            "figures": self.to_dict(),
            "fields": stored(self),
        }
        text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        new_file(path, text, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Bring back what :meth:`save` stored.

        Raises:
            PlumblineError: No such file, no answer of this kind, or a damaged one.
        """
        content = _content(Path(path))
        kind = content.get("kind")
        if kind != cls.__name__:
            near = best_matches(str(kind), Answer.kinds)
            raise fault(str(path), f"kind {shown(kind)}", cls.__name__, f"load it as {near}")
        try:
            return restored(content["fields"], cls)
        except (KeyError, TypeError, ValueError) as error:
            words = str(error) or type(error).__name__
            raise fault(
                str(path), f"damaged fields ({words[:80]})", "what save wrote", SAVE_IT
            ) from (None)


def _drawers(answer: Answer) -> Mapping[str, Callable[[], Any]]:
    """The pictures of an answer by name, undrawn; none where nobody draws its kind."""
    known = [module.DRAWN for module in map(import_module, DRAWN)]
    return next((d[k](answer) for d in known if (k := type(answer).__name__) in d), {})


def _content(path: Path) -> dict[str, Any]:
    """The JSON object of a file."""
    try:
        data = read_file(path, LARGEST_ANSWER)
    except OSError as error:
        raise PlumblineError(f"{path}: cannot be read ({reason(error)}); check the path") from None
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        raise fault(str(path), "no JSON", "what save wrote", SAVE_IT) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise fault(str(path), "other JSON", f"format {FORMAT!r}", SAVE_IT)
    return content


def kind_of(path: str | Path) -> str:
    """The kind of a stored answer.

    Raises:
        PlumblineError: It is none.
    """
    return str(_content(Path(path)).get("kind"))
