"""Stages that overlap: order, errors, and what is left undone."""

import threading

import pytest

from coslobe.render.pipeline import WAITING, Behind, ahead

PATIENCE = 30  # seconds: only a broken test waits as long


def test_items_come_in_order_and_one_ahead():
    made, second = [], threading.Event()

    def items():
        for k in range(4):
            made.append(k)
            if k == 1:
                second.set()
            yield k

    following = ahead(items())
    assert next(following) == 0
    assert second.wait(PATIENCE)  # made although nobody has asked for it
    assert [0, *following] == made == [0, 1, 2, 3]


def test_what_fails_ahead_fails_where_its_turn_is():
    def items():
        yield 1
        yield 2
        raise ValueError("third")

    following = ahead(items())
    assert [next(following), next(following)] == [1, 2]
    with pytest.raises(ValueError, match="third"):
        next(following)


def test_jobs_are_done_in_order_before_the_end():
    done = []
    with Behind() as behind:
        for k in range(50):
            behind.put(lambda k=k: done.append(k))
    assert done == list(range(50))


def test_a_failed_job_is_the_last_and_its_error_is_raised():
    done = []

    def fail():
        raise ValueError("disk full")

    def work():
        with Behind() as behind:
            behind.put(lambda: done.append(1))
            behind.put(fail)
            while True:  # until it is told
                behind.put(lambda: done.append(2))

    with pytest.raises(ValueError, match="disk full"):
        work()
    assert done == [1]


def test_the_last_jobs_error_is_not_lost():
    def fail():
        raise ValueError("disk full")

    def work():
        with Behind() as behind:
            behind.put(fail)

    with pytest.raises(ValueError, match="disk full"):
        work()


def test_an_interruption_waits_for_the_job_at_hand_only():
    started, released, done = threading.Event(), threading.Event(), []

    def slow():
        started.set()
        released.wait(PATIENCE)
        done.append("at hand")

    def work():
        with Behind() as behind:
            behind.put(slow)
            started.wait(PATIENCE)
            for _ in range(WAITING):
                behind.put(lambda: done.append("waiting"))
            threading.Timer(0.05, released.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["at hand"]
