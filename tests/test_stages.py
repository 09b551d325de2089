"""Time counted towards stages, by a clock that is moved by hand."""

from collections.abc import Iterator

import pytest

from bushseg import stages
from bushseg.stages import Stages


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(stages, "time", clock)
    return clock


def test_a_stage_adds_up_and_what_lies_between_is_not_counted(clock: Clock) -> None:
    passed = Stages()
    for seconds in (1.0, 2.0):
        with passed.timed("read"):
            clock.now += seconds
        clock.now += 50
        with passed.timed("write"):
            clock.now += 0.5
    assert passed.seconds == {"read": 3.0, "write": 1.0}
    assert list(passed.seconds) == ["read", "write"]


def test_a_stage_inside_another_counts_alone(clock: Clock) -> None:
    passed = Stages()
    with passed.timed("write"):
        clock.now += 1
        for _ in passed.each("read", [1, 2]):
            clock.now += 2
            with passed.timed("look up"):
                clock.now += 4
    assert passed.seconds == {"write": 5.0, "read": 0.0, "look up": 8.0}


def test_a_stage_that_fails_is_counted(clock: Clock) -> None:
    passed = Stages()

    def fail() -> None:
        with passed.timed("read"):
            clock.now += 2
            raise ValueError("damaged")

    with pytest.raises(ValueError, match="damaged"):
        fail()
    assert passed.seconds == {"read": 2.0}


def test_what_it_takes_to_come_by_items_is_counted_and_their_use_is_not(clock: Clock) -> None:
    def items() -> Iterator[int]:
        for number in range(3):
            clock.now += 1
            yield number
        clock.now += 0.25  # closing the file

    passed, seen = Stages(), []
    for item in passed.each("read", items()):
        clock.now += 10
        seen.append(item)
    assert seen == [0, 1, 2]
    assert passed.seconds == {"read": 3.25}
