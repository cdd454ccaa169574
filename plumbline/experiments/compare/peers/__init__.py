"""One file a peer, one function a subject: it solves; ``run.py`` judges by what it gives.

``run.py MODULE SUBJECT GIVEN.npz`` is a process of its own, in an environment of its own; nothing
but ``ours`` imports plumbline.
"""
