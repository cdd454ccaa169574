"""The report of a hand-eye calibration and of a scan."""
