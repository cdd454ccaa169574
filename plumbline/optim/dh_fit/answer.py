"""A fit of links as it is shown: parameters, remarks, a card, and every figure for JSON.

What is reported are ``quantities``: sums of parameters that the readings tell, most of one term.
Lengths are in m, angles in rad, None where nothing is known.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plumbline.optim.core.answer import Answer, plain
from plumbline.optim.core.constants import FEASIBLE, STILL
from plumbline.optim.core.judged import Judged, Judgement
from plumbline.optim.dh_fit.constants import ROUNDING
from plumbline.optim.dh_fit.fitted import Fitted
from plumbline.optim.dh_fit.identify import Held
from plumbline.optim.dh_fit.quantities import DHParameter, Misfit, Quantity, Status
from plumbline.optim.dh_fit.solvers import promised_drop
from plumbline.optim.dh_fit.statement import Unknown
from plumbline.optim.dh_fit.task import readings_of
from plumbline.optim.recording import storing as storing
from plumbline.optim.recording.constants import ASKED, FIRST_ROW
from plumbline.optim.recording.set_up import plausible

UNITS = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}


@dataclass(frozen=True, eq=False, repr=False)
class DHFit(Fitted, Answer):
    """A fit, which judges itself."""

    def __repr__(self) -> str:
        sizes = f"mean misfit {1e3 * self.before.mean:.3g} mm -> {1e3 * self.after.mean:.3g} mm"
        shape = f"{len(self.readings)} rows, {self.statement.size} unknowns"
        return f"<DHFit of {self.recording.name[:60]}: {shape}; {sizes}>"

    def to_dict(self) -> dict[str, Any]:
        """Every figure; rows not seen and files, which are made of it, have their place."""
        registered = self.registered
        chi_square = None
        if self.chi_square is not None:
            chi_square = {"value": self.chi_square, "freedom": self.freedom, "agrees": self.agrees}
        found: dict[str, Any] = plain(
            {
                "name": self.recording.name,
                "robot": self.recording.robot.name,
                "rows": len(self.readings),
                "unit": "m",
                "objective": {"name": self.options.loss.name, "value": self.objective},
                "solver": {"name": self.solver, "iterations": self.iterations},
                "frame": self.options.frame,
                "before": self.before.numbers,
                "after": self.after.numbers,
                "held_out": None,
                "registration_points": None
                if registered is None
                else {"before": registered[0].numbers, "after": registered[1].numbers},
                "marked_rows": self._marked(),
                "noise": self.noise,
                "noise_stated": self.recording.noise_std,
                "chi_square": chi_square,
                "remarks": list(self.remarks),
                "gross_rows": self._gross(),
                "rank": self.identifiability.rank,
                "quantities": [self._quantity(q) for q in self.quantities],
                "explained_together": self.shares["together"],
                "parameters": [p.to_dict() for p in self.parameters],
                "moves_together": [held.words for held in self.identifiability.held],
                "at_bound": list(self.at_bound),
                "tool": self.tool.tolist(),
                "T_robot_camera": self.T_robot_camera.tolist(),
                "files": {},
            }
        )
        return found

    def _quantity(self, q: Quantity) -> dict[str, Any]:
        parts = [{"name": name, "coefficient": c} for name, c in q.parts]
        return asdict(q) | {"parts": parts, "ci95": list(q.ci95), "share": self.shares.get(q.name)}

    def _gross(self) -> list[dict[str, Any]]:
        """Rows as an editor counts, the header being row 1, and by place, counted from 0."""
        sizes = np.linalg.norm(self.misfits()[self.gross], axis=1).tolist()
        return [
            {"row": FIRST_ROW + k, "index": k, "misfit": size}
            for k, size in zip(self.gross_rows, sizes, strict=True)
        ]

    def _marked(self) -> dict[str, Any] | None:
        """Misfits of the rows that the recording itself marks as held out."""
        rows = readings_of(self.recording, held_out=True)
        if not len(rows):
            return None
        before, after = Misfit.of(self.nominal_misfits(rows)), Misfit.of(self.misfits(rows))
        return {"rows": len(rows), "before": before.numbers, "after": after.numbers}

    @cached_property
    def parameters(self) -> tuple[DHParameter, ...]:
        """Every parameter of the links that was asked for, and the tool."""
        about = {q.parts[0][0]: q for q in self.quantities}
        place = {name: k for k, name in enumerate(self.statement.names)}
        held = {h.name: h for h in self.identifiability.held}
        asked = [u for u in self.identifiability.unknowns if not u.name.startswith("frame")]
        return tuple(
            self._parameter(u, place.get(u.name), about.get(u.name), held.get(u.name))
            for u in asked
        )

    def _parameter(
        self, unknown: Unknown, k: int | None, told: Quantity | None, held: Held | None
    ) -> DHParameter:
        about = (unknown.name, unknown.unit, unknown.nominal)
        if told is not None and told.alone:
            return DHParameter(*about, told.value, told.std, Status.IDENTIFIED, "")
        if told is not None:
            return DHParameter(*about, None, None, Status.IN_A_SUM, f"known only in {told.name}")
        if k is not None and held is None and self.resting[k]:
            value = float(self.x[k])
            side = "upper" if value > unknown.nominal else "lower"
            return DHParameter(*about, value, None, Status.AT_BOUND, f"at its {side} bound")
        words = held.words if held else "moves together with others"
        return DHParameter(*about, None, None, Status.NOT_IDENTIFIABLE, words)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the fit is used, one line each."""
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[str]:
        left, stated = f"{1e3 * self.noise:.3f} mm", self.recording.noise_std
        if self.agrees is False and stated and self.noise > stated:
            yield (
                f"links leave {left} on an axis where {1e3 * stated:.3f} mm are stated "
                f"(chi-square {self.chi_square:.0f} with {self.freedom} degrees of freedom): "
                f"{self._why}"
            )
        elif self.agrees is False and stated:
            yield (
                f"links leave {left} on an axis where {1e3 * stated:.3f} mm are stated: "
                "noise_std is too large, or rows are copies of others"
            )
        doubtful = ASKED * plausible(self.recording)  # more than measuring devices err
        if not stated and self.noise > doubtful:
            yield (
                f"links leave {left} on an axis, more than {1e3 * doubtful:.3g} mm, a thousandth "
                "of the reach: state noise_std if the device is that coarse; "
                f"else {self._why}"
            )
        for words in self.judged.failures:
            yield f"{words}, or try solver gauss-newton"

    @property
    def _why(self) -> str:
        """What is to blame for what links leave: their bounds first, where some rest on one."""
        if self.at_bound:
            rests = f"{', '.join(self.at_bound)} at the bound: widen it (delta-length, delta-angle)"
            return f"{rests}; if that does not help, run plumbline diagnose"
        return "links are not the (whole) cause; run plumbline diagnose"

    @cached_property
    def judged(self) -> Judgement:
        r"""Whether the solver came to its end, by what one more step promises.

        The mean loss drops by :math:`\lambda^2 b / (2 n a)` over a step of :math:`\lambda` standard
        errors, with a and b the traces of the loss's moments.
        """
        drop = promised_drop(self.statement, self.readings, self.x)
        sigma = max(self.noise, ROUNDING)
        A, B = self.options.loss.moments(sigma**2 * np.eye(3))
        moves = np.sqrt(2.0 * len(self.readings) * max(drop, 0.0) * np.trace(A) / np.trace(B))
        low, high = self.statement.lower - self.x, self.x - self.statement.upper
        violation = float(np.concatenate([low, high]).max(initial=0.0))
        name, good = f"the fit by {self.solver}", moves <= STILL and violation <= FEASIBLE
        return Judgement.of([Judged(name, bool(good), float(moves), violation, self.at_bound)])

    @property
    def solver(self) -> str:
        """Name of the solver."""
        return str(getattr(self.options.solver, "name", type(self.options.solver).__name__))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that rest on a bound."""
        return tuple(p.name for p in self.parameters if p.status == Status.AT_BOUND)
