"""The simulated sessions of the link fit's paper: its figures before the fit set their size."""

from plumbline.experiments.reality.tip_readings import Box, Session, draw_session
from plumbline.kinematics.robot import Robot
from plumbline.optim.dh_fit import DHOptions, Misfit, Readings
from plumbline.optim.recording.building import build_recording
from plumbline.optim.recording.recording import Recording

# Mean, maximum and standard deviation [mm] of five sets of 30 readings, before and after.
PAPER = (
    ((6.782, 14.051, 2.584), (0.687, 1.982, 0.405)),
    ((8.124, 12.086, 1.781), (0.741, 1.423, 0.264)),
    ((7.328, 11.869, 2.841), (0.912, 1.824, 0.415)),
    ((7.948, 11.842, 1.794), (0.804, 1.607, 0.481)),
    ((8.425, 13.408, 2.108), (0.938, 1.414, 0.281)),
)
READINGS = 30
NOISE = 2.5e-4  # [m] of one axis: 0.43 mm in space, an optical tracker's 0.35 and the arm's own
FINE_NOISE = 2e-5  # [m]
WANDER = (2e-5, 5e-5)  # [m], [rad]
FINE_WANDER = (2e-6, 5e-6)
PUBLISHED = DHOptions(frame="registration", parameters="all", hayati=False)
WITH_TILTS = DHOptions(frame="registration")
JOINT = DHOptions(frame="joint")


def recording_of(session: Session, name: str = "simulated") -> Recording:
    """A session as a recording of the bundled arm."""
    return build_recording(
        observation="tip_position",
        robot=Robot.bundled("bh7"),
        q=session.q,
        measured=session.tips,
        always=("frame",),
        name=name,
    )


def registration_of(session: Session) -> Readings:
    """Its four registration points."""
    return Readings(session.registration_q, session.registration_tips)


def draw(
    seed: int,
    k: int,
    noise: float,
    wander: tuple[float, float],
    box: Box | None,
    *,
    tilt: float = 1.0,
) -> Session:
    """Group k (from 0) of a seed, with errors of the size that the paper's misfits have.

    Camera's noise [m], joints' wander [m, rad], box and part of the tilts are those of
    :func:`~plumbline.experiments.reality.tip_readings.draw_session`.
    """
    before = 1e-3 * PAPER[k][0][0]
    return draw_session(
        1000 * seed + k,
        readings=READINGS,
        before=before,
        noise=noise,
        wander=wander,
        box=box,
        tilt=tilt,
    )


def in_mm(misfit: Misfit) -> dict[str, float]:
    """Mean, maximum and standard deviation [mm]."""
    return {"mean": 1e3 * misfit.mean, "max": 1e3 * misfit.max, "std": 1e3 * misfit.std}


def words(misfit: Misfit) -> str:
    """The same in one cell."""
    return " / ".join(f"{value:.3f}" for value in in_mm(misfit).values())
