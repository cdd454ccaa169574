"""What a sweep is asked for, as a TOML file says: a recording or a reality, a grid, a design."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plumbline.errors import best_matches, fault
from plumbline.experiments.sweep import recorded, simulated
from plumbline.kinematics.files import is_folder
from plumbline.optim.recording.settings import Section, read_settings_file

MOST_CASES = 10_000  # of one file: some six hours of diagnoses of two seconds


@dataclass(frozen=True)
class Spec:
    """What a file asks for."""

    recording: Path | None  # the folder; None where each case makes a reality of its own
    cases: tuple[Any, ...]  # in the file's order, each hashable
    name: str = ""  # of the reality and the method


def read_spec(path: Path) -> Spec:
    """Read what is to be swept, refused if it asks for what there is not."""
    settings = read_settings_file(path)
    if "reality" in settings.values:
        return _of_reality(path, settings)
    settings.refuse_unknown(("recording", "vary"))
    named, vary = settings.word("recording"), settings.section("vary")
    if named is None or not is_folder(path.parent / named):
        mend = "name it from where this file lies, or write reality = ... in its place"
        raise settings.fault("recording", "the folder of a recording", mend)
    vary.refuse_unknown(recorded.VARIED)
    given = [vary.values.get(key, [0]) for key in recorded.VARIED]
    _refuse_many(path, [len(values) if isinstance(values, list) else 1 for values in given])
    return Spec(path.parent / named, recorded.combinations(vary))


def _of_reality(path: Path, settings: Section) -> Spec:
    """A reality that is made up anew for every case, and what is asked of it."""
    settings.refuse_unknown(("reality", "method", "vary", "random"))
    reality = _one_of(settings, "reality", tuple(simulated.REALITIES))
    method = _one_of(settings, "method", simulated.REALITIES[reality].methods)
    vary, random = settings.section("vary"), settings.section("random")
    factors = simulated.factors_of(reality, method)
    vary.refuse_unknown(tuple(factors))
    random.refuse_unknown(("cases", "seed", *factors))
    grid = {name: _values(vary, name, factors[name]) for name in vary.values}
    drawn, seed = _whole(random, "cases", 1), _whole(random, "seed", 0)
    _refuse_many(path, [len(values) for values in grid.values()] + [drawn])
    spans = {n: _span(random, n, factors[n]) for n in random.values if n not in ("cases", "seed")}
    cases = simulated.cases(reality, method, grid, simulated.Design(drawn, seed, spans))
    return Spec(None, cases, f"{reality}, {method}")


def _one_of(settings: Section, key: str, known: Sequence[str]) -> str:
    if key not in settings.values and key != "reality":
        return known[0]
    value = settings.word(key)
    if value not in known:
        near = best_matches(str(value), known)
        raise settings.fault(key, f"one of {', '.join(known)}", f"best matches: {near}")
    return str(value)


def _whole(section: Section, key: str, usual: int) -> int:
    value = section.values.get(key, usual)
    if isinstance(value, bool) or not isinstance(value, int) or value < min(usual, 1):
        raise section.fault(key, f"a whole number of at least {min(usual, 1)}", f"write {key} = 10")
    return int(value)


def _values(section: Section, key: str, factor: simulated.Factor) -> tuple[Any, ...]:
    value = section.values[key]
    values = value if isinstance(value, list) else [value]
    odd = next((v for v in values if not factor.takes(v)), None)
    if odd is not None or not values:
        raise section.fault(key, factor.expected, f"write {key} = {factor.example}")
    return tuple(values)


def _span(section: Section, key: str, factor: simulated.Factor) -> tuple[Any, ...]:
    values = _values(section, key, factor)
    if not factor.words and not (len(values) == 2 and values[0] < values[1]):
        raise section.fault(key, "a range [LEAST, MOST]", f"write {key} = {factor.example}")
    return values


def _refuse_many(path: Path, counts: Sequence[int]) -> None:
    if np.prod([float(count) for count in counts]) > MOST_CASES:
        found = " x ".join(map(str, counts))
        raise fault(f"{path.name}, [vary]", f"{found} cases", f"at most {MOST_CASES}", "list fewer")
