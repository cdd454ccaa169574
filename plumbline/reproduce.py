"""The published methods made again: what a paper states, and trials drawn as it describes them."""

from plumbline.experiments.reproduce import PAPERS as PAPERS
from plumbline.experiments.reproduce import Compared as Compared
from plumbline.experiments.reproduce import dh_fit as dh_fit
from plumbline.experiments.reproduce import dh_fit_sessions as dh_fit_sessions
from plumbline.experiments.reproduce import figure as figure
from plumbline.experiments.reproduce import hand_eye as hand_eye
from plumbline.experiments.reproduce import hand_eye_trials as hand_eye_trials
from plumbline.experiments.reproduce import registration as registration
from plumbline.experiments.reproduce import registration_pointing as registration_pointing
from plumbline.experiments.reproduce import registration_trial as registration_trial
from plumbline.experiments.reproduce import reproduce as reproduce
