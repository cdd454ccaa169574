"""Whatever is done to the files of a recording, it loads or is refused: nothing else happens."""

import hashlib
import re
import shutil

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from optim.loading import load_recording
from optim.recording import RecordingError
from tests.recording_folders import KINDS, write_folder

# What breaks readers: odd numbers, separators, line ends, marks of CSV, TOML and XML.
NASTY = st.sampled_from(
    [
        *("", " ", "nan", "inf", "-", "1e999", "1e308", "-1e300", "0x10", "1_000", "1,5", "1e-320"),
        *('"', "'", "\0", "#", "true", "[]", "{}", "\ufeff", "\u2028", "\x85", "\u0663", "0", "-0"),
        *("-1", "\r", "\n\n", "=", "..", "[[robot.dh]]", "q1", "x", "<", "&a;", "\\"),
        *("9" * 400, "2" * 5000),
    ]
)
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["insert", "replace", "cut", "drop", "double", "flip"]),
        st.sampled_from(
            ["samples.csv", "samples.csv", "dataset.toml", "dataset.toml", "robot.urdf"]
        ),
        st.floats(0.0, 1.0),
        NASTY | st.text(max_size=4) | st.floats().map(repr),
    ),
    min_size=1,
    max_size=3,
)


def edited(data, edit, place, new):
    """Bytes after one edit at a relative place: of a byte, a token, or a line."""
    at = int(place * len(data))
    raw = new.encode("utf-8", "surrogatepass")
    if edit == "insert":
        return data[:at] + raw + data[at:]
    if edit == "cut":
        return data[:at]
    if edit == "flip":
        return (
            data[:at]
            + bytes(byte ^ (len(raw) + 1) % 256 for byte in data[at : at + 1])
            + data[at + 1 :]
        )
    pattern = rb"[^,\n\"\[\]= ]+" if edit == "replace" else rb"[^\n]*\n"
    spans = [match.span() for match in re.finditer(pattern, data)]
    if not spans:
        return raw
    a, b = spans[min(int(place * len(spans)), len(spans) - 1)]
    between = {"replace": raw, "drop": b"", "double": 2 * data[a:b]}[edit]
    return data[:a] + between + data[b:]


def outcome(folder):
    """The message of a refusal, or the recording."""
    try:
        return "", load_recording(folder)
    except RecordingError as error:
        return str(error), None


@settings(
    max_examples=150,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(kind=st.sampled_from(KINDS), edits=EDITS)
def test_anything_loads_or_is_refused_in_one_line(tmp_path, kind, edits):
    """Whatever happens to the files, nothing but a RecordingError of one line comes out."""
    folder = tmp_path / hashlib.sha256(repr((kind, edits)).encode()).hexdigest()[:12]
    write_folder(folder, kind)
    for edit, file, place, new in edits:
        path = folder / file
        if path.exists():
            path.write_bytes(edited(path.read_bytes(), edit, place, new))
    message, recording = outcome(folder)
    shutil.rmtree(folder)
    if recording is None:
        assert len(message.splitlines()) == 1
        assert message.isprintable()
        assert 20 < len(message) < 600
    else:
        assert np.isfinite(recording.q).all()
        assert all(note.isprintable() for note in recording.notes)
        assert recording.describe()
        assert recording._repr_html_()
