"""Work in a second process. Oracles: the same work done here, and the process in which it was done."""

import os
import signal

import pytest

from identification import second_process
from identification.second_process import started

pytestmark = pytest.mark.skipif(not second_process._has_free_core(), reason="one core, or no fork")


def test_the_work_is_done_once_and_elsewhere():
    wait = started(os.getpid)
    assert wait() not in (os.getpid(), 0)
    assert wait() == wait()


def test_an_error_is_raised_where_the_result_is_asked_for():
    def fail():
        raise ValueError("no motion can be planned")

    wait = started(fail)
    with pytest.raises(ValueError, match="no motion can be planned"):
        wait()


def test_work_whose_process_is_killed_is_done_here():
    here = os.getpid()

    def work():
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return os.getpid()

    assert started(work)() == here


def test_without_a_free_core_the_work_is_done_here_when_it_is_asked_for(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    done = []
    wait = started(lambda: done.append(os.getpid()))
    assert done == []
    wait()
    assert done == [os.getpid()]
