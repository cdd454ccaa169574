"""How the tests share two workers: `--dist loadfile` keeps a file on one; long files come first."""

import pytest

# Longest first; whatever is not named takes a quarter of a minute at most. Time alone hangs on it.
LONG = (
    "test_outside.py",
    "test_real_recordings.py",
    "test_documents.py",
    "test_diagnose.py",
    "test_confounded_effects.py",
    "test_joint_posterior.py",
    "test_motion.py",
    "test_motion_clocks.py",
    "test_next_experiment.py",
    "test_gross_rows.py",
    "test_parts_of_a_recording.py",
    "test_diagnose_parts.py",
    "test_gear_spectra.py",
    "test_degenerate_recordings.py",
    "test_rotors.py",
    "test_dh_fit_honesty.py",
    "06_drives.ipynb",
    "test_motion_physics.py",
    "test_calibration_check.py",
    "test_several_recordings.py",
    "test_implausible_noise.py",
    "05_diagnose_the_gap.ipynb",
    "test_motion_search.py",
    "test_withheld_run.py",
    "07_take_it_home.ipynb",
    "test_judged_diagnosis.py",
    "test_readings_without_noise.py",
    "test_every_effect.py",
    "test_correlated_rows.py",
    "test_sections.py",
    "04_capsule_mpc.ipynb",
    "test_resembling.py",
    "test_reproduce_dh_fit.py",
    "test_sweep_cluster.py",
    "03_dh_fit.ipynb",
    "01_registration_and_pointing.ipynb",
    "02_hand_eye.ipynb",
    "test_recording_fuzz.py",
)
PLACE = {name: k for k, name in enumerate(LONG)}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A long file that came last would run alone."""
    items.sort(key=lambda item: PLACE.get(item.path.name, len(LONG)))
