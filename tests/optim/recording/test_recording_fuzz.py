"""Whatever is done to the files of a recording, it is read or refused: nothing else happens."""

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tests.fuzz.__main__ as bench
from plumbline.errors import PlumblineError
from plumbline.experiments.commands.out import Out
from plumbline.optim import loading
from plumbline.optim.recording.loading import load_recording
from plumbline.optim.recording.recording import Recording
from tests.fuzz import damage
from tests.fuzz import trial as trial_module
from tests.fuzz.damage import ANYWHERE, ODD_FILES, OWN
from tests.fuzz.recordings import KINDS, sound
from tests.fuzz.trial import damaged, trial

SEED = 7
MANY = 180


@pytest.fixture(scope="module")
def trials():
    """Some damaged recordings of every kind, through ``check``."""
    return [trial(number, SEED) for number in range(MANY)]


def test_anything_is_read_or_refused_in_one_line(trials):
    assert [(t.number, t.broke) for t in trials if t.broke] == []


def test_every_kind_of_recording_and_of_damage_is_drawn(trials):
    """Damage that never leaves a recording to read, or always does, tests half of the reader."""
    assert set(Counter(t.kind for t in trials).values()) == {MANY // len(KINDS)}
    done = {words.split(": ")[1] for t in trials for words in t.damages}
    known = {*ANYWHERE, *(change for own in OWN.values() for change in own)}
    assert done == {*ODD_FILES, *(change.__name__ for change in known)}
    codes = Counter(t.code for t in trials)
    assert codes[0] > 0.1 * MANY
    assert codes[2] > 0.3 * MANY


def test_a_trial_follows_from_the_seed_and_its_number(tmp_path):
    written = []
    for k, (seed, number) in enumerate(((1, 5), (1, 5), (1, 6), (2, 5))):
        done = damaged(tmp_path / str(k), "pose", np.random.default_rng([seed, number]))
        files = {p.name: p.read_bytes() for p in (tmp_path / str(k)).iterdir() if p.is_file()}
        written.append((done, files))
    assert written[0] == written[1]
    assert written[0] != written[2]
    assert written[0] != written[3]


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_that_is_not_damaged_is_read(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(trial_module, "damaged", lambda folder, kind, rng: untouched(folder, kind))
    found = trial(KINDS.index(kind), SEED)
    assert (found.code, found.broke) == (0, "")


def untouched(folder, kind):
    folder.mkdir()
    for name, text in sound(kind).items():
        (folder / name).write_text(text)
    return ()


def broken(monkeypatch, change):
    """What a trial says of a sound recording where the reader was changed."""
    monkeypatch.setattr(trial_module, "damaged", lambda folder, kind, rng: untouched(folder, kind))
    monkeypatch.setattr(loading, "load", change)
    return trial(0, SEED, seconds=3.0).broke  # a tenth of the hang; a loaded machine reads in one


def test_a_traceback_is_a_break(monkeypatch):
    def defect(folder, **_):
        raise ZeroDivisionError("ours")

    assert "traceback: ZeroDivisionError" in broken(monkeypatch, defect)


def test_a_hang_is_a_break(monkeypatch):
    assert "hangs" in broken(monkeypatch, lambda folder, **_: time.sleep(30))


def test_a_number_that_is_none_is_a_break(monkeypatch):
    def unsure(folder, **_):
        return replace(load_recording(folder), noise_std=float("nan"))

    assert "traceback: ValueError" in broken(monkeypatch, unsure)
    written = Path.write_text
    monkeypatch.setattr(Out, "say", lambda out, *_: written(Path(out.json), '{"a": NaN}'))
    assert "NaN in the JSON" in broken(monkeypatch, unsure)


def test_what_is_written_into_a_recording_is_a_break(monkeypatch):
    def scribbling(folder, **_):
        (folder / "note").write_text("x")
        return load_recording(folder)

    assert "written into" in broken(monkeypatch, scribbling)


def test_words_that_are_no_line_are_a_break(monkeypatch):
    def long(folder, **_):
        raise PlumblineError("x" * 10_000)

    assert "a line of 100" in broken(monkeypatch, long)


def test_what_is_read_can_be_shown(tmp_path):
    """A damaged recording that loads has finite numbers and printable notes and cards."""
    read = 0
    for number in range(90):
        kind = ("tip_position", "pose", "fixed_point", "joint_position", "rail", "dh")[number % 6]
        folder = tmp_path / str(number)
        damaged(folder, kind, np.random.default_rng([SEED, number]))
        try:
            recording = load_recording(folder)
        except PlumblineError:
            continue
        read += 1
        assert isinstance(recording, Recording)
        assert np.isfinite(recording.q).all()
        assert all(note.isprintable() for note in recording.notes)
        assert recording.name.isprintable()
        assert recording.describe()
        assert recording._repr_html_()
    assert read > 9


def test_the_bench_counts_what_broke_and_ends_with_one(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(bench, "trial", lambda number, *_: replace(SOME, number=number))
    found = bench.fuzzed(10, 9, 3, "check", 1.0)
    assert [k.recordings for k in found.kinds] == [9] + [0] * (len(KINDS) - 1) + [9]
    assert [t.number for t in found.broke] == list(range(10, 19))
    assert len(bench.tables(found)) == 2
    with pytest.raises(bench.typer.Exit) as ended:
        bench.bench(count=1, seed=1, first=0, command="check", seconds=1.0, json=None)
    assert ended.value.exit_code == 1


SOME = trial_module.Trial(0, KINDS[0], ("samples.csv: cut",), -1, "traceback", 0.1)


def test_damage_never_fails_on_any_bytes():
    rng = np.random.default_rng(SEED)
    every = {*ANYWHERE, *(change for own in OWN.values() for change in own)}
    for change in sorted(every, key=lambda change: change.__name__):
        for data in (b"", b"\n", b"a", b"a,b\n1,2\n", b"\xff\xfe\0", b",,,\n,"):
            assert isinstance(change(data, rng), bytes)
    assert damage.LARGEST_FILE == 64_000_000
