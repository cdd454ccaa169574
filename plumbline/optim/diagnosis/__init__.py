"""Where the gap lies, which effect causes it, and how far it shrinks.

The rooms, in the order in which imports run: each uses those above it alone.

================  ==================================================================================
``prior``         Every width, odds, range and threshold, with unit and source.
``constants``     The numbers that are none of these: rounding, effort, what a line names.
``of_recordings`` What is said of each of several recordings, and of what carries over.
``meaning``       What a verdict comes to, in a sentence each.
``findings``      What a verdict is: data, without a computation.
``with_verdict``  An answer that has a verdict: what it passes on of it.
``linearise``     The model as linear least squares about a fit, and the ports of the chain.
``posterior``     Which effects: evidence (``evidence``), what fills a slot (``slots``), terms that
                  enter or leave (``selection``, ``joint``),
                  fit and linearisation in turn (``search``), gross errors (``robust``).
``discrepancy``   What no effect explains: smooth unknowns against the causes (``dependences``).
``predict``       Rows left out: the folds (``folds``), figures on them (``held_out``, ``shrink``).
``verdict``       What is said: probabilities and their tree (``explanation``, ``tree``), lack of
                  fit, shares of places (``where``), words.
``design``        The next experiment: rows that tell the leading explanations apart.
``options``       How a diagnosis is asked for, and that as it is stored.
``motion``        Drives: commands rolled out over windows, joint by joint.
``answer``        The diagnosis: a verdict with the recording and the fit that it rests on.
``proof``         Exported files alone, on rows that no fit has seen.
``diagnose``      The whole, end to end.
``several``       Several recordings: each alone, all (``motions``), compared (``transfer``).
``of_any_kind``   Any kind of recording, to the engine that its rows need.
``calibrate``     Simulation-based calibration: the diagnosis of simulated cases like this one.
================  ==================================================================================
"""
