"""Benches of the methods, one file each: ``python -m experiments.benches.NAME``."""
