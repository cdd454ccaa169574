"""Rooms with a range finder before boards, and their readings as the library has them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from experiments.reality.ranging.room import Instrument, calibration, draw_room, marks, plan
from kinematics.robot import Robot
from optim.hand_eye.beam import Beam
from optim.hand_eye.readings import Readings
from optim.hand_eye.repeatability import Marks

CLEAN = Instrument(
    noise=0.0, grain=0.0, skew=0.0, repeatability=0.0, flatness=1e-12, aim=0.0, square=0.0
)
PAPER = Instrument()


@lru_cache(maxsize=1)
def chain():
    """The arm as the library knows it."""
    return Robot.bundled("vs060").chain()


@lru_cache(maxsize=8)
def planned(seed=0, angles=90.0):
    """A room and its programme; instruments do not matter to the plan."""
    rng = np.random.default_rng(seed)
    room = draw_room(rng, PAPER, angles)
    return room, plan(room, rng)


def room_of(seed=0, instrument=PAPER, angles=90.0):
    """The planned room with other instruments."""
    room, _ = planned(seed, angles)
    given = instrument
    finder = replace(
        room.finder, noise=given.noise, spot=given.spot, grain=given.grain, skew=given.skew
    )
    factor = given.flatness / PAPER.flatness
    boards = tuple(replace(b, bumps=factor * b.bumps) for b in room.boards)
    return replace(room, finder=finder, boards=boards, instrument=given)


@lru_cache(maxsize=16)
def surveyed(seed=0, instrument=PAPER, angles=90.0):
    """A room, its survey and its readings."""
    room, programme = room_of(seed, instrument, angles), planned(seed, angles)[1]
    survey = calibration(room, np.random.default_rng([seed, 5]), programme)
    return room, survey, readings_of(survey)


@lru_cache(maxsize=16)
def marked(seed=0, instrument=PAPER):
    """Marks in the room."""
    survey, _ = marks(room_of(seed, instrument), np.random.default_rng([seed, 6]))
    T = chain().placement(survey.q)
    return Marks(T[:, :3, :3], T[:, :3, 3], survey.distance, survey.patch)


def readings_of(survey):
    """The readings of a survey, through the arm's model."""
    T = chain().placement(survey.q)
    return Readings.from_arrays(
        T[:, :3, :3], T[:, :3, 3], survey.distance, survey.plane, survey.motion
    )


def truth(room):
    """The true beam."""
    return Beam(room.finder.r, room.finder.v)
