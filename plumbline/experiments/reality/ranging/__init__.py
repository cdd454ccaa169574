"""A range finder on an arm before boards: plain NumPy, sharing nothing with what it judges.

Read `board` and `finder` (what a reading is), `wrist` and `aim` (how poses are planned), `scene`
(the measurement), then `phantoms` and `camera` (what a calibrated finder is tried on and against).
"""
