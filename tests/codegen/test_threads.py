"""Work on threads, also where few or none can be started."""

import threading

import pytest

from symmb.run.codegen import threads


@pytest.fixture(params=[0, 1, 3])
def few(request, monkeypatch):
    """How many threads can be started at the same time."""
    start, before = threading.Thread.start, threading.active_count()

    def limited(thread):
        if threading.active_count() - before >= request.param:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", limited)
    return request.param


def test_cores_are_as_many_as_threads_can_be_started(few, monkeypatch):
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda process: range(8), raising=False)
    assert threads.cores() == max(few, 1)


def test_all_arguments_get_their_result(few):
    assert threads.side_by_side(lambda k: k**2, range(6)) == [0, 1, 4, 9, 16, 25]


def test_all_pieces_are_done(few):
    lock, done = threading.Lock(), []

    def work(counter):
        while True:
            with lock:
                counter.value += 1
                if counter.value > 1000:
                    return
                done.append(counter.value)

    threads.on_threads(work, 1000, 1.0)
    assert done == list(range(1, 1001))
