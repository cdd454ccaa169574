"""Benchmarks, one file a method; each runs as ``python -m experiments.benches.NAME``."""
