"""Motions: what the drives of a robot do to their commands, joint by joint."""
