"""Campaigns and loops of the capsule controller."""
