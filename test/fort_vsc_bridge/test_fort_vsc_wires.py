# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One remote on three wires: the same Joy, the same stops, whatever joins it."""

from __future__ import annotations

import contextlib
import math
from typing import Any

from builtin_interfaces.msg import Time
from hypothesis import given, settings, strategies as st
import pytest

from bridge_core.session import Level
from fort_vsc_bridge.convert import joy
from fort_vsc_bridge.protocol.values import AXIS_NAMES, BUTTON_NAMES
from fort_vsc_bridge.protocol.wires import CanWire, HidWire, SerialWire
from fort_vsc_bridge.session import Session, Settings, Sticks
from fort_vsc_bridge.simulator import CanSimulator, HidSimulator, Simulator
from stage.session_rig import SessionBench

HID_STEP = 1 / 127
OPPOSITE = ({'left_up', 'left_down'}, {'left_left', 'left_right'})  # a HID pad has no such


def test_wire_without_a_software_stop_says_so_to_who_asks_and_in_the_diagnostics() -> None:
    session = Session(Settings(wire=HidWire()))
    assert not session.problems(100.0)[1:]
    with pytest.raises(ValueError, match='transport hid cannot carry'):
        session.set_software_estop(False, 100.0)
    text = 'wire that stop elsewhere: transport hid cannot carry software_estop'
    assert [level for level, why in session.problems(100.0) if text in why] == [Level.ERROR]


@pytest.mark.parametrize('wire', [SerialWire(), CanWire(), HidWire()])
def test_link_timeout_is_above_the_time_between_two_signs_of_life(wire: Any) -> None:
    with pytest.raises(ValueError, match='link_timeout = '):
        Settings(wire=wire, link_timeout=wire.INTERVAL)
    # The parameter's own least is above a serial heartbeat's time already.
    least = Settings.TABLE['link_timeout'].minimum
    assert least is not None
    Settings(wire=wire, link_timeout=max(math.nextafter(wire.INTERVAL, 1.0), least))


def test_nothing_is_sent_more_often_than_tables_17_and_34_allow() -> None:
    serial = {kind.name: 1 / period for kind, period in SerialWire.PERIODS.items()}
    assert serial == {
        'HOST_HEARTBEAT': 20,
        'USER_FEEDBACK': 20,
        'USER_FEEDBACK_NAME': 4,
        'USER_FEEDBACK_GET': 20,
        'MESSAGE_CONTROL': 4,  # the table gives no rate
        'SETUP_UNLOCK': 4,  # nor are these two in it
        'SETUP_STRING_GET': 4,
    }
    can = {kind.name: 1 / period for kind, period in CanWire.PERIODS.items()}
    assert can == {'USER_FEEDBACK': 10, 'USER_FEEDBACK_NAME': 10}


class Bench(SessionBench[Session]):
    """A session and its simulated device, joined by one kind of wire."""

    def __init__(self, device: Any, wire: Any, **options: Any) -> None:
        super().__init__(Session(Settings(wire=wire, **options)))
        self.device = device
        self.open()

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while (due := max(self.now, min(self.device.deadline(), self.session.deadline()))) < end:
            self.now = due
            self.take(*self.device.poll(due))
            while self.sent:
                self.device.receive(self.sent.pop(0)[1], due)
            self.now += 1e-4
        self.now = end

    def apply(self, *commands: str) -> None:
        self.take(*self.device.poll(self.now))  # so that it knows the time
        for command in commands:
            self.device.apply(command)

    @property
    def joy(self) -> Any:
        last = [event for event in self.events if isinstance(event, Sticks)][-1]
        return joy(last.axes, last.buttons, Time(), '')


def benches(**options: Any) -> dict[str, Bench]:
    return {
        'serial': Bench(Simulator(), SerialWire(), **options),
        'can': Bench(CanSimulator(), CanWire(), **options),
        'hid': Bench(HidSimulator(), HidWire(), **options),
    }


@pytest.mark.parametrize(
    ('wire', 'method', 'arguments', 'words'),
    [
        ('can', 'set_software_estop', (True,), 'cannot carry a software e-stop'),
        ('can', 'get_feedback', (3,), 'cannot carry a question'),
        ('can', 'set_name', (1, 'x' * 19), 'carries 18 characters at most'),
        ('can', 'set_display_text', ('one\n' + 'x' * 19,), 'carries 18 characters'),
        ('can', 'set_feedback', (85, 1), 'has no key 85'),
        ('hid', 'set_software_estop', (True,), 'cannot carry a software e-stop'),
        ('hid', 'rumble', (True, False), 'cannot carry values, settings'),
        ('hid', 'set_feedback', (99, 1), 'cannot carry values, settings'),
        ('hid', 'set_name', (3, 'x'), 'cannot carry names or text'),
        ('hid', 'set_display_text', ('x',), 'cannot carry names or text'),
        ('hid', 'get_feedback', (3,), 'cannot carry a question'),
    ],
)
def test_what_a_wire_cannot_carry_is_refused_and_sends_nothing(
    wire: str, method: str, arguments: tuple[Any, ...], words: str
) -> None:
    if wire == 'can':
        bench = Bench(CanSimulator(), CanWire(), configure_device=True)
    else:
        bench = Bench(HidSimulator(), HidWire())
    bench.run(0.5)
    session = bench.session
    with pytest.raises(ValueError, match=f'transport {wire} {words}'):
        getattr(session, method)(*arguments, bench.now)
    assert not session.estop
    assert not session.values(bench.now)['software e-stop in use']
    bench.wait(1.0)
    assert bench.sent == []
    assert session.farewell(bench.now) == []


@settings(max_examples=30)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    st.sets(st.sampled_from(BUTTON_NAMES)).filter(
        lambda names: not any(pair <= names for pair in OPPOSITE)
    ),
)
def test_sticks_and_buttons_become_the_same_joy(positions: list[float], pressed: set[str]) -> None:
    joys = {}
    for name, bench in benches().items():
        bench.apply('mode operational')
        bench.apply(*(f'stick {a} {p}' for a, p in zip(AXIS_NAMES, positions, strict=True)))
        bench.apply(*(f'button {button} 1' for button in pressed))
        bench.run(0.5)
        joys[name] = bench.joy
    assert joys['can'] == joys['serial']
    assert joys['hid'].axes == pytest.approx(joys['serial'].axes, abs=HID_STEP)
    assert joys['hid'].buttons == joys['serial'].buttons


STEPS = st.sampled_from(
    [
        *('estop remote on', 'estop remote off', 'estop vsc on', 'estop vsc off'),
        *('radio off', 'radio on', 'ack', 'mode operational', 'mode pause', 'mode menu'),
        *('stick left_y 1', 'stick left_y 0', 'reboot'),
    ]
)


@settings(max_examples=60)
@given(st.lists(STEPS, max_size=12))
def test_stops_modes_and_motion_are_the_same(steps: list[str]) -> None:
    told: dict[str, list[Any]] = {}
    for name, bench in benches().items():
        told[name] = []
        for step in ['mode operational', *steps]:
            with contextlib.suppress(ValueError):  # not now, says the device
                bench.apply(step)
            bench.run(0.6)
            session = bench.session
            told[name].append(
                (
                    session.estop,
                    session.own_estop,
                    session.link_up,
                    session.mode,
                    bench.joy.axes[1],
                )
            )
    assert told['can'] == told['serial']
    assert told['hid'] == told['serial']
