"""Benches of single methods: ``python -m experiments.benches.NAME``, ratios within one run."""
