"""How the tests share two workers: `--dist loadfile` keeps a file on one; long files come first."""

import pytest

# Longest first; whatever is not named takes a quarter of a minute at most. Time alone hangs on it.
LONG = (
    "test_outside.py",
    "test_real_recordings.py",
    "test_documents.py",
    "test_motion.py",
    "test_confounded_effects.py",
    "test_efforts.py",
    "06_drives.ipynb",
    "test_joint_posterior.py",
    "test_diagnose.py",
    "test_withheld_run.py",
    "test_motion_commands.py",
    "test_parts_of_a_recording.py",
    "test_hand_eye_robust.py",
    "test_rotors.py",
    "test_identified.py",
    "test_motion_search.py",
    "test_degenerate_recordings.py",
    "test_gross_rows.py",
    "test_gear_spectra.py",
    "05_diagnose_the_gap.ipynb",
    "test_diagnose_parts.py",
    "07_take_it_home.ipynb",
    "test_implausible_noise.py",
    "test_scatter.py",
    "test_dh_fit_honesty.py",
    "test_every_effect.py",
    "test_next_experiment.py",
    "test_motion_physics.py",
    "test_motion_held.py",
    "test_report.py",
    "test_late_channels.py",
    "test_set_up.py",
    "test_dh_fit.py",
    "test_closed_loop.py",
    "test_pages.py",
    "test_several_recordings.py",
    "test_resembling.py",
    "test_hand_eye_calibrate.py",
    "test_screw.py",
    "test_calibration_check.py",
    "test_widths_between.py",
    "test_codegen.py",
    "test_capsule_mpc.py",
    "test_registration_unstated.py",
    "test_tracking.py",
    "test_model.py",
    "test_effect_physics.py",
)
PLACE = {name: k for k, name in enumerate(LONG)}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A long file that came last would run alone."""
    items.sort(key=lambda item: PLACE.get(item.path.name, len(LONG)))
