"""Simulation-based calibration of the verdict."""
