"""The withheld check: is a diagnosis right about recordings whose cause it cannot know?

Three steps, each a command, none of which trusts the one before it:

1. ``make`` (or whoever hands in a folder) writes recordings into one folder and what is really
   wrong into another. The SHA-256 of every truth goes into a ledger before the truth is written.
2. ``run`` diagnoses each recording in a process that can open nothing but a copy of it.
3. ``score`` compares the hashes, opens the truth and counts, with intervals.

A folder made elsewhere needs this and no more::

    cases/NAME/dataset.toml, samples.csv     a recording each; names are free
    truth/NAME.json                          {"effects": [{"effect": "backlash", "element": 2}]}

An empty list says that nothing is wrong; an effect that the library lacks makes the case one from
outside. Optional keys: ``gap_to_noise`` (of each effect), ``rows``, ``noise_std``, ``noise_rms``
(what noise truly added to these very readings, rms per axis), ``observation``,
``parameters.depends_on`` (of an unknown effect, e.g. ``["q2"]``), and ``confounded``: what the
recording cannot tell from the truth, each with ``of`` (effect, element), ``effect`` and
``element``. ``seal`` writes the ledger for such a folder.

Read `sealing`, `design` and `making`; `sandbox`, `blind` and `running`; `truth`, `answer`,
`matching`, `calibration` and `scoring`; shares and their intervals are
`plumbline.optim.core.quantities`.
"""
