"""Where a range finder's beam sits on the flange, from readings on planes (Zeng et al. 2017).

Read first: :mod:`plumbline.optim.hand_eye.readings` (the unknown),
:mod:`plumbline.optim.hand_eye.single_plane` (the closed form),
:mod:`plumbline.optim.hand_eye.three_planes` (the paper's joint problem), then
:mod:`plumbline.optim.hand_eye.calibrate` (what we make of it).
"""
