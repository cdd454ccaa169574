"""Beside the peers: ``python -m plumbline.experiments.compare``, or ``make compare``.

Each peer is a small file in ``peers`` that runs in an environment and a process of its own and
prints JSON; ``contests`` says who is asked what on which data, ``running`` runs them, ``page``
writes the page. The environments are made under ``build/peers`` the first time.
"""
