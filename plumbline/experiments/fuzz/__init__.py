"""Recordings damaged at random: whatever is done to the files, a command answers or refuses.

:mod:`~plumbline.experiments.fuzz.recordings` makes sound ones of every kind,
:mod:`~plumbline.experiments.fuzz.damage` damages them, :mod:`~plumbline.experiments.fuzz.trial`
runs a command on one and says what broke.
"""
