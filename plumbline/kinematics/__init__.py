"""Symbols in, symbols out: the chain, its load torques and the effects that bend it.

Read first: :mod:`plumbline.kinematics.robot` (a robot and its chain), then
:mod:`plumbline.kinematics.effects.effect` (what an effect is).

Notation: ``T_ab`` maps coordinates in frame b to coordinates in frame a; ``R_ab`` and ``t_ab`` are
its parts. Units are m, rad, s, kg, N and degC throughout.
"""
