"""Recordings: what rows hold, how they are read, and what is checked before a fit."""
