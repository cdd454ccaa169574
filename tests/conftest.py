"""How the tests share two workers: `--dist loadfile` keeps a file on one; long files come first."""

import pytest

# Longest first; whatever is not named takes a quarter of a minute at most. Time alone hangs on it.
LONG = (
    "test_withheld_run.py",
    "test_outside.py",
    "test_diagnose.py",
    "test_documents.py",
    "07_take_it_home.ipynb",
    "05_diagnose_the_gap.ipynb",
    "test_real_recordings.py",
    "test_every_effect.py",
    "test_confounded_effects.py",
    "test_gross_rows.py",
    "test_outputs.py",
    "test_motion.py",
    "test_reproduce_dh_fit.py",
    "test_jumps.py",
    "04_capsule_mpc.ipynb",
    "test_motion_physics.py",
    "test_calibration_check.py",
    "test_recording_fuzz.py",
)
PLACE = {name: k for k, name in enumerate(LONG)}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A long file that came last would run alone."""
    items.sort(key=lambda item: PLACE.get(item.path.name, len(LONG)))
