# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The reset button at the mux: what it may reset, by which rules, and what ~/status says of it."""

from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from bridge_core import clock
from safety_mux.node import SafetyMux
from safety_mux.protocol import State
from stage.fed_mux import EVERY, SteppedMux
from stage.mux_talkers import sticks

BEFORE_THE_STOP = 'not reset: the reset button was pressed before the stop was over'


class ButtonMux(SteppedMux):
    """A mux with a button. :ivar button: None: silent."""

    def __init__(self, context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.button: bool | None = False
        self._numbers = [0]
        super().__init__(context, monkeypatch, reset_topic='button')

    def _feed(self, now: float) -> None:
        super()._feed(now)
        if self.button is not None:
            self.say(self.button)

    def say(self, pressed: bool, publisher: int = 0) -> None:
        """Say it by one of several publishers, each of which numbers its own messages."""
        self._numbers += [0] * (publisher + 1 - len(self._numbers))
        self._numbers[publisher] += 1
        info = {'publication_sequence_number': self._numbers[publisher]}
        assert self.mux._button is not None
        self.mux._button.on_message(Bool(data=pressed), info)

    def press(self, seconds: float = 0.5) -> State:
        """Press it for a while, release it; return the state after that."""
        self.button = True
        self.run(seconds)
        self.button = False
        return self.run(EVERY)

    def said(self) -> str:
        """Return what ~/status says of the last reset."""
        return self.values().get('last reset', '').partition(' ago: ')[2]


@pytest.fixture
def mux(context: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ButtonMux]:
    result = ButtonMux(context, monkeypatch)
    yield result
    result.mux.destroy_node()


def test_release_resets_and_moves_nothing(mux: ButtonMux) -> None:
    assert mux.press(2.5) is State.STOPPED
    assert mux.said() == (
        'not reset: the reset button was held for 2500 ms; 100 ms to 2000 ms count'
    )
    mux.button = True
    assert mux.run(1.9) is State.STOPPED  # not while it is pressed
    mux.button = False
    assert mux.run(EVERY) is State.READY
    assert mux.said() == ''
    assert mux.run(5.0) is State.READY
    mux.joy = sticks(0.5, deadman=True)
    assert mux.run(0.5) is State.ACTIVE


def test_button_and_service_are_one_reset(mux: ButtonMux) -> None:
    """Two within clear_time are one that is held, whichever way they come."""
    mux.stop = True
    mux.run(0.1)
    assert not mux.reset().ok
    mux.stop = False
    mux.run(0.1)
    assert mux.press(0.2) is State.STOPPED
    assert 'a held or repeated reset does nothing' in mux.said()


@pytest.mark.parametrize(('stopped', 'before'), [(True, 0.0), (True, 0.2), (False, 0.2)])
def test_press_that_began_before_the_stop_was_over_is_not_meant_for_it(
    mux: ButtonMux, stopped: bool, before: float
) -> None:
    """:param before: s, of the press before the stop."""
    if not stopped:
        assert mux.press() is State.READY
        mux.run(10.0)
    elif not before:
        mux.stop = True
        mux.run(0.2)
    mux.button = True
    mux.run(before)
    mux.stop = True
    mux.run(0.2)
    mux.stop = False
    mux.run(1.0)
    mux.button = False
    assert mux.run(1.0) is State.STOPPED
    assert mux.said() == BEFORE_THE_STOP
    assert mux.press() is State.READY


@pytest.mark.parametrize('late', [0.0, 0.02])  # s from the stop to the first word of the press
def test_press_that_began_before_a_stop_between_two_of_its_messages_is_not_meant_for_it(
    mux: ButtonMux, late: float
) -> None:
    drive = mux.topic('estop.drive.topic')

    def stop() -> None:
        drive.take(Bool(data=True), mux.now)
        mux.mux._tick(mux.now)
        drive.take(Bool(data=False), mux.now)

    mux.run(1.0)
    if late:  # in READY, and nothing was heard of it yet
        assert mux.reset().ok
        mux.run(10.0 + EVERY / 2)
        stop()
    mux.button = True
    mux.run(0.2)
    if not late:  # a reset by the service, and the next stop, before its next message
        assert mux.reset().ok
        mux.run(0.02)
        stop()
    assert mux.run(1.0) is State.STOPPED
    mux.button = False
    assert mux.run(1.0) is State.STOPPED
    assert mux.said() == BEFORE_THE_STOP
    assert mux.press() is State.READY


def test_button_that_sticks_or_is_silent_is_an_inhibit(mux: ButtonMux) -> None:
    assert 'reset button' not in mux.message()
    mux.button = True
    assert mux.run(60.0) is State.STOPPED
    assert 'the reset button has been held for 60 s: release it' in mux.message()
    mux.button = None
    mux.run(1.0)
    assert 'the reset button is stale: last heard' in mux.message()
    mux.button = False
    assert mux.run(1.0) is State.STOPPED
    assert mux.press() is State.READY
    mux.button = None
    mux.run(1.0)
    assert 'reset button' not in mux.message()  # nothing to reset


def test_second_publisher_keeps_the_button_from_resetting(mux: ButtonMux) -> None:
    """Neither by its own pulses, nor by what the two say together."""
    for pressed in (True, True, True, True, False):
        mux.run(EVERY)
        mux.say(pressed, publisher=1)
    assert mux.run(EVERY) is State.STOPPED
    assert mux.press() is State.STOPPED
    assert 'the reset button has two live publishers: stop one of them' in mux.said()
    mux.run(4.0)
    assert mux.press() is State.READY


def test_publisher_that_was_started_anew_or_lost_a_message_counts_after_a_while(
    mux: ButtonMux,
) -> None:
    mux.run(10 * EVERY)
    for number in (0, 100):
        mux.button = True
        mux.run(0.2)
        mux._numbers = [number]
        assert mux.press(0.2) is State.STOPPED
        assert 'the reset button has lost messages, or a new publisher' in mux.said()
        mux.run(1.0)
    assert mux.press() is State.READY


def test_publishers_of_a_remapped_button_are_counted(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {'reset_topic': 'button', 'autostart': False}
    mux = SafetyMux(
        context=context,
        parameter_overrides=[Parameter(name, value=value) for name, value in given.items()],
        cli_args=['--ros-args', '-r', 'button:=/panel/button'],
    )
    counted: list[str] = []

    def count(topic: str) -> int:
        counted.append(topic)
        return 1

    monkeypatch.setattr(mux, 'count_publishers', count)
    mux.lane.call(lambda: mux._look_around(clock.now()))
    mux.destroy_node()
    assert '/panel/button' in counted
    assert 'button' not in counted
