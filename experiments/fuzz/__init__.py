"""Recordings damaged at random: whatever is done to the files, a command answers or refuses.

:mod:`~experiments.fuzz.recordings` makes sound ones of every kind, :mod:`~experiments.fuzz.damage`
damages them, :mod:`~experiments.fuzz.trial` runs a command on one and says what broke.
"""
