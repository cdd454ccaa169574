"""Fits one by one, the baseline of the search: the same minimum, and the same cause on top."""

import io

import numpy as np
import pytest
from rich.console import Console

from plumbline.experiments.benches.central import (
    Bench,
    Cost,
    Race,
    Whole,
    recorded,
    scanned,
    tables,
)
from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.diagnosis.baselines import one_by_one
from plumbline.optim.diagnosis.posterior.search import SOLVER, fit
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.recording.loading import load_recording
from tests.made_up_diagnosis import BENCH

EFFECTS = (
    REGISTRY["joint_offset"](joint=3),
    REGISTRY["joint_scale"](joint=2),
    REGISTRY["joint_compliance"](joint=2),
    REGISTRY["transmission_ripple"](joint=2, order=1),
    REGISTRY["link_geometry"](link=2),
    REGISTRY["sensor_scale"](),
)


@pytest.fixture(scope="module")
def recording():
    return load_recording(BENCH)


@pytest.fixture(scope="module")
def singles(recording):
    return one_by_one(recording, EFFECTS)


def test_a_fit_by_finite_differences_ends_where_ours_does(recording, singles):
    for single in singles:
        weights = np.ones(len(recording))
        _, ours = fit(recording, [single.effect], nuisances_of(recording), weights, SOLVER)
        assert single.cost == pytest.approx(ours.cost, rel=1e-5), single.effect.label


def test_the_lowest_criterion_is_that_of_the_cause(recording, singles):
    best = min(singles, key=lambda single: single.bic)
    assert best.effect == REGISTRY["transmission_ripple"](joint=2, order=1)
    assert scanned(recording).effect == best.effect


def test_the_criterion_pays_for_every_unknown(recording, singles):
    n = 3 * len(recording)
    for single in singles:
        unknowns = nuisances_of(recording).size + len(single.effect.parameters)
        fitted = n * np.log(2 * single.cost / n)
        assert single.bic - fitted == pytest.approx(unknowns * np.log(n))


def test_a_bench_recording_has_the_rows_that_it_was_asked_for(tmp_path):
    recording = recorded(tmp_path, 40, "joint_offset")
    assert len(recording) == 40
    assert recording.chain.n == 6


def test_what_was_measured_is_printed_with_what_is_hoped_for():
    cost = (Cost(100, 1.0, 250.0, "no-gap"), Cost(1000, 4.0, 300.0, "no-gap", 4.0))
    race = Race(100, 2500, 2500, 0.25, 50.0, 200.0, "backlash 2", "joint_offset 1")
    console = Console(width=120, file=io.StringIO())
    for table in tables(Bench(cost, race, Whole(100, 1.5, 1.9, 5))):
        console.print(table)
    said = console.file.getvalue()
    for words in ("x 4.0", "200 times faster", "backlash 2", "joint_offset 1", "1.50 s", "300 MB"):
        assert words in said
