"""Capsule MPC."""
