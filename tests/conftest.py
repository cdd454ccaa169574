"""How the tests share two workers: `--dist loadfile` keeps a file on one; long files come first."""

import os

import pytest
from hypothesis import settings

os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")  # of the cores each worker has one

# The same examples in every run: what is drawn anew would stop a change that has no part in it.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")

# Longest first; whatever is not named takes a quarter of a minute at most. Time alone hangs on it.
LONG = (
    "test_real_recordings.py",
    "test_documents.py",
    "test_outside.py",
    "test_motion.py",
    "test_efforts.py",
    "06_drives.ipynb",
    "test_withheld_run.py",
    "test_motion_commands.py",
    "test_rotors.py",
    "test_motion_search.py",
    "05_diagnose_the_gap.ipynb",
    "07_take_it_home.ipynb",
    "test_every_effect.py",
    "test_motion_physics.py",
    "test_motion_held.py",
    "test_confounded_effects.py",
    "test_diagnose.py",
    "test_diagnose_parts.py",
    "test_joint_posterior.py",
    "test_report.py",
    "test_closed_loop.py",
    "test_hand_eye_robust.py",
    "test_degenerate_recordings.py",
    "test_identified.py",
    "test_dh_fit_honesty.py",
    "test_parts_of_a_recording.py",
    "test_tracking.py",
    "test_dh_fit.py",
    "test_several_recordings.py",
    "test_late_channels.py",
    "test_gear_spectra.py",
    "test_gross_rows.py",
    "test_model.py",
    "test_hand_eye_calibrate.py",
    "test_registration_unstated.py",
    "test_set_up.py",
    "test_resembling.py",
    "test_scatter.py",
    "test_screw.py",
    "test_effect_physics.py",
)
PLACE = {name: k for k, name in enumerate(LONG)}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A long file that came last would run alone."""
    items.sort(key=lambda item: PLACE.get(item.path.name, len(LONG)))
