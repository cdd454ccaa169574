"""Parts of one piece of work come out as they would in turn, whoever does them."""

import json
import multiprocessing
import os
import signal
import sys
import threading

import pytest

from plumbline import diagnose
from plumbline.errors import PlumblineError
from plumbline.optim.core.side_by_side import cores, side_by_side
from tests.benches import bench
from tests.few_effects import only
from tests.motions import recorded

copies = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux alone")


@pytest.fixture(params=[1, 2, 3])
def at_hand(request, monkeypatch):
    """As many cores as that, whatever the machine has."""
    monkeypatch.setattr("joblib.cpu_count", lambda: request.param)
    return request.param


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)


def done_apart(work, parts):
    """What comes of parts of which the second begins when the first is in another process."""
    met = multiprocessing.get_context("fork").Barrier(2)

    def waited(part):
        if part in parts[:2]:
            met.wait(30)
        return work(part)

    return side_by_side(waited, parts)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_parts_come_in_their_order_however_many_cores_there_are(count, at_hand):
    assert side_by_side(lambda k: k**2, range(count)) == [k**2 for k in range(count)]


@copies
def test_two_cores_do_two_parts_at_a_time_in_two_processes(two):
    assert len(set(done_apart(lambda _: os.getpid(), range(2)))) == 2


def test_what_one_core_does_it_does_itself(monkeypatch):
    monkeypatch.setattr("joblib.cpu_count", lambda: 1)
    assert side_by_side(lambda _: os.getpid(), range(3)) == [os.getpid()] * 3


def test_as_many_cores_are_used_as_the_environment_allows(monkeypatch):
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    assert cores() == 1


def test_from_another_thread_all_is_done_in_turn(two):
    found = []
    thread = threading.Thread(target=lambda: found.append(cores()))
    thread.start()
    thread.join()
    assert found == [1]


@copies
def test_a_part_does_its_own_parts_in_turn(two):
    assert done_apart(lambda _: cores(), range(2)) == [1, 1]
    assert cores() == 2


@copies
def test_an_error_in_any_process_is_the_error_of_all(two):
    mine = os.getpid()

    def work(part):
        if os.getpid() != mine:
            raise PlumblineError("refused elsewhere")
        return part

    with pytest.raises(PlumblineError, match="refused elsewhere"):
        done_apart(work, range(2))
    assert not multiprocessing.active_children()


@copies
def test_what_a_killed_process_had_to_do_is_done_all_the_same(two):
    mine, gone = os.getpid(), multiprocessing.get_context("fork").Event()

    def work(part):
        if os.getpid() != mine:
            gone.set()
            os.kill(os.getpid(), signal.SIGKILL)
        gone.wait(30)
        return part

    assert side_by_side(work, range(5)) == list(range(5))
    assert gone.is_set()


@copies
@pytest.mark.parametrize("lacks", ["context.BaseContext.Lock", "context.ForkProcess.start"])
def test_where_processes_may_not_be_copied_or_share_locks_all_is_done_in_turn(
    lacks, two, monkeypatch
):
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(f"multiprocessing.{lacks}", refused)
    assert side_by_side(lambda part: (part, os.getpid()), range(3)) == [
        (part, os.getpid()) for part in range(3)
    ]


@copies
def test_who_interrupts_leaves_no_process_behind(two):
    mine = os.getpid()

    def work(part):
        if os.getpid() == mine:
            raise KeyboardInterrupt
        signal.pause()

    with pytest.raises(KeyboardInterrupt):
        done_apart(work, range(2))
    assert not multiprocessing.active_children()


def test_each_part_that_is_begun_here_is_told(monkeypatch):
    monkeypatch.setattr("joblib.cpu_count", lambda: 1)
    told = []
    side_by_side(str, range(3), told.append)
    assert told == [0, 1, 2]


@copies
@pytest.mark.parametrize(
    ("made", "options"),
    [
        (lambda: bench("ur5", "tip_position"), only("joint_offset", "gear_ripple", "backlash")),
        (lambda: recorded([{}, {}]), None),
    ],
)
def test_a_diagnosis_says_the_same_on_one_core_and_on_two(made, options, monkeypatch):
    recording, said = made(), []
    for count in (1, 2):
        monkeypatch.setattr("joblib.cpu_count", lambda count=count: count)
        said.append(json.dumps(diagnose(recording, options).to_dict(), sort_keys=True))
    assert said[0] == said[1]
