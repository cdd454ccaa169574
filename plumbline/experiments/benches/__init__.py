"""Benches of single methods: ``python -m plumbline.experiments.benches.NAME``."""
