"""The large run: every kind of case, so many each, from drawing to the table of results.

A set is a folder; what is there already is kept, so a run that was interrupted goes on. Its table
is Markdown: the figures with their intervals, and the command and the seed that they come from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from plumbline.experiments.console.tables import table
from plumbline.experiments.withheld.design import Design
from plumbline.experiments.withheld.making import make_set
from plumbline.experiments.withheld.measures import MEASURES
from plumbline.experiments.withheld.running import run_set
from plumbline.experiments.withheld.scoring import Score, error_words, median, percent, score_run
from plumbline.optim.core.progress import Progress

RICH = Design(seed=0, observation="mixed", gross=0.02)


def _designed(words: str, leave_out: Sequence[str] = (), **of: Any) -> tuple[str, Design]:
    return words, replace(RICH, leave_out=tuple(leave_out), **of)


SETS: Mapping[str, tuple[str, Design]] = {
    name: _designed(**told)
    for name, told in table("plumbline.experiments.withheld", "sets.toml").items()
}
WORDS = {measure.key: measure.words for measure in MEASURES}


@dataclass(frozen=True)
class Result:
    """One set and its score."""

    name: str
    words: str
    score: Score


@dataclass(frozen=True)
class Bench:
    """All that a large run found."""

    count: int
    seed: int
    results: tuple[Result, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "count": self.count,
            "seed": self.seed,
            "sets": {result.name: result.score.to_dict() for result in self.results},
        }


def bench(
    folder: Path,
    count: int,
    *,
    seed: int,
    jobs: int = 0,
    only: tuple[str, ...] = (),
    progress: Progress | None = None,
) -> Bench:
    """Make, run and score every set, or those of a name; what the folder holds already is kept."""
    results = []
    for name, (words, design) in SETS.items():
        if only and name not in only:
            continue
        place = folder / name
        tell = _named(name, progress)
        make_set(place / "cases", place / "truth", replace(design, seed=seed), count, tell)
        run_set(place / "cases", place / "verdicts", jobs=jobs, progress=tell)
        results.append(Result(name, words, score_run(place / "verdicts", place / "truth")))
    return Bench(count, seed, tuple(results))


def _named(name: str, progress: Progress | None) -> Progress | None:
    return None if progress is None else lambda words, share: progress(f"{name}: {words}", share)


def markdown(found: Bench) -> str:
    """The table of results."""
    lines = [
        "# Withheld check: results",
        "",
        f"`plumbline withheld bench FOLDER --count {found.count} --seed {found.seed}`: every set",
        "drawn from that seed, sealed, diagnosed blind and scored. Percent, with 95 % intervals",
        "(Wilson). Where it says *or confounded*, an effect that the recording cannot tell from",
        "the true one counts as right. Drawing, scoring and the sets are described in",
        "`experiments/withheld/`.",
    ]
    for result in found.results:
        lines += ["", f"## {result.name}: {result.words}", ""]
        lines += [f"{result.score.cases} cases, ledger `{result.score.ledger[:16]}`.", ""]
        lines += ["| figure | value | counted |", "|---|---|---|"]
        for key, words in WORDS.items():
            share = result.score.overall.share(key)
            if share.of:
                lines.append(f"| {words} | {percent(share)} | {share.count} of {share.of} |")
        shrink = result.score.overall.shrink
        if shrink.of:
            lines.append(f"| removable gap removed, median | {median(shrink)} | {shrink.of} |")
        said = (
            error_words("Causes named, strictly", result.score.named_strictly),
            error_words("confounded ones counted as right", result.score.named),
            error_words("something outside", result.score.outside),
        )
        lines += ["", "; ".join(said) + "."]
    return "\n".join(lines) + "\n"
