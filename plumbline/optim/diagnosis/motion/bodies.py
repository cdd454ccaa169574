r"""What a robot's bodies ask of its joints where they are, and how torques move them over a step.

Over a step under a torque that is held, a body's acceleration changes with where the arm is and how
fast. Its mean and its change, by Simpson's rule and from ends to end,

.. math:: \bar a = \tfrac16 (a_0 + 4 a_m + a_1), \qquad \Delta a = a_1 - a_0, \qquad
          a = M^{-1}(q, \dot q)\, (t - h)

with the middle where cubics through both ends have it, make a step's speed and place to the fourth
order (Hairer, Norsett, Wanner 1993, Solving Ordinary Differential Equations I, sec. II.1). The mean
of the ends makes them to the second: of rows 5 ms apart a wrist errs by an encoder's noise.
"""

import numpy as np

from plumbline.kinematics.oracle import pin
from plumbline.optim.diagnosis.motion.carried import model_of
from plumbline.optim.diagnosis.motion.clock import mean_of_ends
from plumbline.optim.diagnosis.motion.constants import LEAST_INERTIA, UNSTATED
from plumbline.optim.diagnosis.motion.recording import MotionRecording
from plumbline.optim.diagnosis.motion.windows import Array

Bodies = tuple[Array, Array]  # masses (K, n, n) [kg m^2], gravity and Coriolis (K, n) [N m]


def bodies_at(r: MotionRecording, posture: Array, speed: Array) -> Bodies:
    """Masses, gravity and Coriolis of states (K, n) [rad, rad/s]; other joints stand at zero."""
    model = model_of(r)
    data, index, K = model.createData(), list(r.index), len(posture)
    masses, h = np.empty((K, model.nv, r.n)), np.empty((K, model.nv))
    neutral, still = pin.neutral(model), np.zeros(model.nv)
    moved, v = np.zeros((2, K, model.nv))
    moved[:, index], v[:, index] = posture, speed
    for k in range(K):
        q = pin.integrate(model, neutral, moved[k])
        masses[k] = pin.crba(model, data, q)[:, index]
        h[k] = pin.rnea(model, data, q, v[k], still)
    masses = masses[:, index]
    return with_rotors(masses) if r.law.pushes else masses, h[:, index]


def with_rotors(masses: Array) -> Array:
    """Mass matrices (..., n, n), with a rotor that torques move where the file states nothing."""
    own = np.diagonal(masses, axis1=-2, axis2=-1)
    return np.asarray(
        masses + np.eye(own.shape[-1]) * (LEAST_INERTIA * (own <= UNSTATED))[..., None]
    )


def free(masses: Array) -> Array:
    """Inertia about each joint, the others free (K, n) [kg m^2], of mass matrices (K, n, n)."""
    inverse = np.linalg.inv(masses)
    return np.asarray(1 / np.diagonal(inverse, axis1=1, axis2=2))


def over_steps(
    r: MotionRecording, dt: float, states: Bodies, bodies: Bodies, torque: Array
) -> tuple[Array, Array]:
    """Mean acceleration over each step and its change (K - 1, n) [rad/s^2].

    Args:
        r: Whose bodies they are.
        dt: Time from state to state [s].
        states: Places and speeds (K, n) [rad, rad/s].
        bodies: Those there.
        torque: What drives give over each step (K - 1, n) [N m].
    """
    (q, v), (masses, h) = states, bodies
    first = _moved(masses[:-1], torque - h[:-1])
    last = _moved(masses[1:], torque - h[1:])
    middle = (
        mean_of_ends(q) - dt / 8 * np.diff(v, axis=0),
        mean_of_ends(v) - dt / 8 * (last - first),
    )
    masses, h = bodies_at(r, *middle)
    return (first + 4 * _moved(masses, torque - h) + last) / 6, last - first


def _moved(masses: Array, torque: Array) -> Array:
    return np.asarray(np.linalg.solve(masses, torque[..., None])[..., 0], dtype=float)
