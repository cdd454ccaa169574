"""Where a verdict goes, whatever was recorded: JSON, a report, a model, words.

Of several recordings, and of a motion's drives, it is handed out as any other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out
from plumbline.experiments.console.outputs import check_new, write_json, write_text
from plumbline.experiments.console.progress_bar import progress_bar

if TYPE_CHECKING:
    from plumbline.optim.diagnosis.motion.answer import MotionDiagnosis
    from plumbline.optim.diagnosis.options import DiagnosisOptions
    from plumbline.optim.model import Applied
    from plumbline.optim.recording.recording import Recording

Models = Mapping[str, tuple[Path, Any]]  # by what it is called: its file, and what is written


@dataclass(frozen=True)
class Outputs(Out):
    """Where a verdict goes."""

    also: Path | None = None  # folder of another recording of the same robot
    model: Path | None = None  # file of what was found, for apply and export

    def hand_out_verdict(
        self,
        answer: Any,
        content: Mapping[str, Any],
        lines: Iterable[str] = (),
        models: Callable[[Any, Path], Models] | None = None,
        **page: Any,
    ) -> None:
        """Write and print an answer, whose content is the same for JSON.

        ``lines`` are printed below the verdict; ``models`` gives what is written of it as models,
        its one model unless given; ``page`` is what else its page shows.
        """
        write_json(self.json, content)
        self.write_page(answer, **page)
        models = models or (lambda answer, path: {"Model": (path, answer.model())})
        made = {} if self.model is None else models(answer, self.model)
        for path, _ in made.values():
            check_new(path, "--model", overwrite=self.overwrite)
        for path, model in made.values():
            model.save(path, overwrite=True)
        if self.silent:
            return
        from plumbline.experiments.report.diagnosis.page import in_words
        from plumbline.experiments.report.page.words import console, print_page

        out = console()
        print_page(in_words(answer, page.get("elsewhere")), out)
        files = {"Report": self.report} | {name: path for name, (path, _) in made.items()}
        named = (f"\n{name}: {path}" for name, path in files.items() if path is not None)
        for line in (*lines, *named):
            out.print(line, markup=False, soft_wrap=True)


def refuse(asked: Mapping[str, object], what: str) -> None:
    """Refuse options that one kind of recording has no answer to."""
    for option, value in asked.items():
        if value:
            raise PlumblineError(f"{option} {value}: not for {what}; leave it out")


def diagnose_several(
    folders: Sequence[Path],
    options: DiagnosisOptions,
    outputs: Outputs,
    asked: Mapping[str, object],
) -> None:
    """Diagnose recordings of one robot, or a session's folder, and hand out the verdict."""
    from plumbline.optim.diagnosis.of_any_kind import diagnose_several as diagnosed
    from plumbline.optim.loading import load_part

    refuse(asked, "several recordings")
    other = None if outputs.also is None else load_part(outputs.also)
    given = list(folders) if len(folders) > 1 else folders[0]
    with progress_bar(quiet=outputs.silent) as progress:
        found = diagnosed(given, options, progress=progress)
    content, lines = found.to_dict(), []
    if other is not None:
        tried = _tried(found, other, force=options.force)
        content, lines = content | {"also": tried.to_dict()}, [f"\n{tried.words}"]
    outputs.hand_out_verdict(found, content, lines, _models)


def _tried(found: Any, other: Any, *, force: bool) -> Applied:
    from plumbline.optim.diagnosis.several.sections import Sections, tried

    if isinstance(found, Sections):
        return found.transfer(other, force=force)
    return tried(found, other, force=force)


def _models(found: Any, path: Path) -> Models:
    """The model of the first section, and those of others beside it, named by their kind."""
    from plumbline.optim.diagnosis.several.sections import Sections

    sections = found.sections if isinstance(found, Sections) else [found]
    made: dict[str, tuple[Path, Any]] = {"Model": (path, sections[0].model())}
    for one in sections[1:]:
        kind = one.recording.observation
        if getattr(one.recording, "stand_in", False) and kind != "fiducials":
            continue  # ranges from poses: there is none
        made[f"Model of {kind}"] = (path.with_stem(f"{path.stem}-{kind}"), one.model())
    return made


def diagnose_motion(
    folder: Path, options: DiagnosisOptions, outputs: Outputs, asked: Mapping[str, object]
) -> None:
    """Diagnose a motion and hand out the verdict (PlumblineError: motions lack what is asked)."""
    from plumbline.optim.diagnosis.motion.tracking import load_drives
    from plumbline.optim.diagnosis.of_any_kind import diagnose_drives

    refuse(asked, "a motion")
    recording = load_drives(folder)
    other = None if outputs.also is None else load_drives(outputs.also)
    with progress_bar(quiet=outputs.silent) as progress:
        found = diagnose_drives(recording, options, progress=progress)
    content = found.to_dict()
    lines = [] if other is None else _elsewhere(found, other, content)
    outputs.hand_out_verdict(found, content, lines)


def _elsewhere(found: MotionDiagnosis, other: Any, content: dict[str, Any]) -> list[str]:
    """How the model does on another motion, into the content and as lines."""
    from plumbline.optim.core.quantities import quantity

    before, after = found.transfer(other)
    seen = [j for j in range(other.n) if before[j] == before[j]]
    square = [(sum(float(x[j]) ** 2 for j in seen) / len(seen)) ** 0.5 for x in (before, after)]
    rows = [{"element": j + 1, "before": before[j], "after": after[j]} for j in seen]
    content["transfer"] = {
        "recording": other.name, "rows": len(other), "unit": other.unit,
        "before": square[0], "after": square[1], "joints": rows, "notes": list(other.notes),
    }  # fmt: skip
    sizes = [quantity(value, other.unit) for value in square]
    told = [f"On {other.name}, nothing fitted again: {sizes[0]} -> {sizes[1]}"]
    for row in rows:
        a, b = (quantity(float(row[k]), other.unit) for k in ("before", "after"))
        told.append(f"  {other.noun} {row['element']}: {a} -> {b}")
    return told


def next_motion(out: Out, folder: Path, csv: Path | None, *, seed: int) -> None:
    """Propose motions that part what a motion leaves open, and write their commands."""
    from plumbline.optim.diagnosis.motion.diagnose import diagnose_motion as diagnosed
    from plumbline.optim.diagnosis.motion.tracking import load_drives
    from plumbline.optim.diagnosis.options import DiagnosisOptions

    recording = load_drives(folder)
    with progress_bar(quiet=out.silent) as progress:
        found = diagnosed(recording, DiagnosisOptions(seed=seed), progress=progress)
    law = recording.law
    moved = (recording.time, recording.command if law.follows else recording.q)
    kind = "places" if law.pushes else "commands" if law.follows else "rates"
    _propose(out, recording.name, list(found.verdict.next), moved, csv, kind)


def next_efforts(
    out: Out, recording: Recording, csv: Path | None, options: DiagnosisOptions
) -> None:
    """The same where efforts were measured: motions within what the joints did."""
    import numpy as np

    from plumbline.optim.diagnosis.diagnose import diagnose
    from plumbline.optim.diagnosis.motion.proposals import proposals_of_efforts

    with progress_bar(quiet=out.silent) as progress:
        found = diagnose(recording, options, progress=progress)
    rows = list(proposals_of_efforts(found.verdict.causes, recording.chain.n))
    time = recording.time if recording.time is not None else np.arange(len(recording)) * 1.0
    _propose(out, recording.name, rows, (time, recording.q), csv)


def _propose(
    out: Out, name: str, rows: list[dict[str, Any]], moved: tuple[Any, Any], csv: Path | None,
    kind: str = "commands",
) -> None:  # fmt: skip
    """Hand out the motions of these rows, after what was moved: times (N,), places (N, n).

    As commands, as the rates of them, or as places that a controller of torques is to follow.
    """
    import numpy as np
    import pandas as pd

    from plumbline.optim.diagnosis.motion.proposals import commanded

    write_json(out.json, {"recording": name, "motions": rows})
    if csv is not None and rows:
        wanted = dict.fromkeys((int(r["joint"]), str(r["motion"]).split(",")[0]) for r in rows)
        time, command = commanded(list(wanted), *moved)
        command = np.gradient(command, time, axis=0) if kind == "rates" else command
        names = [f"{'q' if kind == 'places' else 'u'}{j + 1}" for j in range(command.shape[1])]
        table = pd.DataFrame(np.column_stack([time, command]), columns=["time", *names])
        write_text(csv, table.to_csv(index=False, float_format="%.9g"), "--csv")
    if not out.silent:
        for row in rows:
            print(f"joint {row['joint']}: {row['motion']}, tells {row['tells']}")
        if not rows:
            print("Nothing is left open that a motion of these drives would part.")
