"""Where a range finder's beam sits on the flange, from readings on planes (Zeng et al. 2017).

Read first: :mod:`optim.hand_eye.beam` (the unknown), :mod:`optim.hand_eye.single_plane` (the closed
form), :mod:`optim.hand_eye.three_planes` (the paper's joint problem), then
:mod:`optim.hand_eye.calibrate` (what we make of it).
"""
