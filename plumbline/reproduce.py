"""The published methods made again: what a paper states, and trials drawn as it describes them."""

from plumbline.experiments.reproduce import (
    PAPERS,
    dh_fit,
    dh_fit_sessions,
    hand_eye,
    hand_eye_trials,
    registration,
    registration_pointing,
    registration_trial,
    reproduce,
)

__all__ = [
    "PAPERS",
    "dh_fit",
    "dh_fit_sessions",
    "hand_eye",
    "hand_eye_trials",
    "registration",
    "registration_pointing",
    "registration_trial",
    "reproduce",
]
