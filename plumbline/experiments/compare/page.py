"""What was found as a page of the documents."""

from collections.abc import Sequence
from datetime import date

from plumbline.experiments.compare.contests import OURS, Contest
from plumbline.experiments.compare.running import Cell

HEAD = """\
# Beside the peers

Written by `make compare` (`python -m plumbline.experiments.compare`) on {day}: each way in an
environment and a process of its own, on the same data, on {machine}. Seconds are the
processor's: of the first call, in which plumbline compiles its symbols, and the least of three
after it. Memory is the largest that the process had, imports included; plumbline's imports alone
take {floor:.0f} MB. What could not be run says why.
"""
COLUMNS = ("peer", "version", "figure", "first [s]", "again [s]", "memory [MB]", "note")


def page(
    contests: Sequence[Contest], cells: Sequence[Cell], *, day: date, machine: str, floor: float
) -> str:
    """The page in Markdown: on which day and machine, our imports alone taking ``floor`` [MB]."""
    parts = [HEAD.format(day=day.isoformat(), machine=machine, floor=floor)]
    for contest in contests:
        own = [c for c in cells if c.contest == contest.name]
        if not own:
            continue
        parts.append(f"## {contest.name.capitalize().replace('Dh', 'DH')}\n")
        parts.append(f"{contest.what[:1].upper()}{contest.what[1:]}; {contest.figure}.\n")
        rows = [COLUMNS, ("---",) * len(COLUMNS), *(_row(c) for c in own)]
        parts.append("\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n")
        parts.append(verdict(own) + "\n")
    return "\n".join(parts)


def verdict(cells: Sequence[Cell]) -> str:
    """What we win and what we lose, peer by peer, in plain words."""
    ours = next((c for c in cells if c.peer == OURS), None)
    if ours is None or ours.error is None:
        return "Nothing of ours to compare."
    said = []
    for other in cells:
        if other.peer == OURS:
            continue
        if other.why or other.error is None:
            said.append(f"{other.peer}: not compared.")
            continue
        won: list[str] = []
        lost: list[str] = []
        for name, a, b in (
            ("figure", ours.error, other.error),
            ("first call", ours.first, other.first),
            ("time", ours.seconds, other.seconds),
            ("memory", ours.memory, other.memory),
        ):
            ratio = _ratio(b, a)
            if ratio is not None:
                (won if ratio >= 1 else lost).append(f"{name} {_times(ratio)}")
        words = [f"we win {', '.join(won)}"] if won else []
        words += [f"we lose {', '.join(lost)}"] if lost else []
        said.append(f"{other.peer}: {'; '.join(words)}.")
    return " ".join(said)


def _row(c: Cell) -> tuple[str, ...]:
    if c.why:
        return (c.peer, c.version or "-", "-", "-", "-", "-", f"not run: {c.why}")
    figure = "-" if c.error is None else f"{c.error:.4g}"
    times = ("-" if t is None else f"{t:.3g}" for t in (c.first, c.seconds))
    memory = "-" if c.memory is None else f"{c.memory / 1e6:.0f}"
    return (c.peer, c.version, figure, *times, memory, c.note)


def _ratio(theirs: float | None, mine: float | None) -> float | None:
    """Theirs over ours; None where a number is missing or next to nothing."""
    if theirs is None or mine is None or min(theirs, mine) <= 0.0:
        return None
    return theirs / mine


def _times(ratio: float) -> str:
    more = max(ratio, 1 / ratio)
    return "by nothing" if more < 1.005 else f"by {more:.3g} times"
