"""One file a way of doing it: ``fit(given)`` solves, ``figures(given, found)`` judges.

``run.py NAME GIVEN.npz`` is a process of its own, in an environment of its own; nothing but
``ours_*`` imports plumbline.
"""
