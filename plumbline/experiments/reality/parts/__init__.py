"""Ranges on boards and touches of markers with one thing wrong: plain NumPy, sharing nothing.

Read `room` and `room_flaws` (a range finder on an arm among three boards), `head` and `head_flaws`
(markers on a head, in CT and by a robot), then `drawing` (a sealed case of either).
"""
