# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session against chance."""

import math

from hypothesis import settings as hypothesis_settings, strategies as st
from hypothesis.stateful import initialize, invariant, rule, RuleBasedStateMachine

from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Phase, Session
from stage.esi_drive_rig import axes as both, fields, make_settings, status


class AnyOrder(RuleBasedStateMachine):
    """
    Requests, packets, silence and stalls in any order.

    The rules are checked on the packets that come out, by a book-keeping of its own.
    """

    PERIOD, LIMIT, STATUS_LIMIT, ENABLE_LIMIT = 0.02, 0.1, 0.25, 1.0
    SLEW_LIMIT = 100.0  # counts a second

    def __init__(self) -> None:
        super().__init__()
        slow = both(Mode.VELOCITY, slew_limit=self.SLEW_LIMIT)
        self.session = Session(make_settings(command_rate=50.0, axes=slow))
        self.now = 500.0
        self.heard: dict[str, float] = {}
        self.value: dict[str, bool] = {}
        self.fault = self.says_enabled = False
        self.disabled_at = -math.inf  # since when packets say so
        self.open = False
        self.fresh_edge = False  # false, then true, since the last stop
        self.saw_false = False
        self.was_enabled = False
        self.commanded = False  # since the drive said enabled
        self.last_sent = self.now
        self.sent = [0, 0]

    def _fresh(self, what: str, limit: float) -> bool:
        return self.now < self.heard.get(what, -math.inf) + limit

    def _may_enable(self) -> bool:
        inputs = all(self._fresh(what, self.LIMIT) for what in ('command', 'enable', 'estop'))
        good = self._fresh('status', self.STATUS_LIMIT) and not self.fault
        return inputs and good and self.value['enable'] and not self.value['estop']

    def _check(self, frames: list[bytes]) -> None:
        for frame in frames:
            self.session.sent(frame, self.now)
            growth = self.SLEW_LIMIT * min(self.now - self.last_sent, self.PERIOD) + 1.0
            self.last_sent = self.now
            axes = fields(frame)
            enable = axes[0][0]
            for axis, was in enumerate(self.sent):
                value = self.sent[axis] = axes[axis][2]
                assert abs(value) <= (abs(was) if value * was > 0 else 0) + growth
            assert axes[1][0] == enable
            assert not (enable and axes[0][1])
            if enable:
                assert self._may_enable()
                if not self.was_enabled:
                    assert self.fresh_edge, 'enabled without a new edge'
                    assert axes[0][2] == axes[1][2] == 0
                    self.commanded = False
                if not self.commanded:
                    assert axes[0][2] == axes[1][2] == 0
            else:
                assert axes[0][2] == axes[1][2] == 0
            if self.was_enabled and not enable:
                self.fresh_edge = False
            self.disabled_at = math.inf if enable else min(self.disabled_at, self.now)
            self.was_enabled = enable

    def _poll(self) -> None:
        self._check(self.session.poll(self.now)[1])

    @initialize()
    def begin(self) -> None:
        self._open()

    def _open(self) -> None:
        self.open = True
        self.heard.clear()
        self.disabled_at = -math.inf
        self.saw_false = self.fresh_edge = self.was_enabled = self.fault = False
        self._check(self.session.opened(self.now)[1])

    @rule(steps=st.integers(1, 12), everything=st.booleans())
    def time_passes(self, steps: int, everything: bool) -> None:
        """In steps as a wire would make them, with or without a healthy world."""
        for _ in range(steps):
            self.now += 0.01
            if everything and self.open:
                for what in ('estop', 'enable'):
                    if what in self.value:
                        self._request(what, self.value[what])
                self._command(3.0)
                self._status(1 if self.was_enabled else 0, 0)
            self._poll()

    @rule(seconds=st.floats(0.0, 0.4))
    def stall(self, seconds: float) -> None:
        self.now += seconds

    def _request(self, what: str, value: bool) -> None:
        getattr(self.session, f'set_{what}')(value, self.now)
        if what == 'enable':
            if value and self.saw_false:
                self.fresh_edge = True
            self.saw_false = not value
        self.heard[what], self.value[what] = self.now, value

    @rule(value=st.booleans(), poll=st.booleans())
    def enable(self, value: bool, poll: bool) -> None:
        self._request('enable', value)
        if poll:
            self._poll()

    @rule(value=st.booleans(), poll=st.booleans())
    def estop(self, value: bool, poll: bool) -> None:
        self._request('estop', value)
        if poll:
            self._poll()

    @rule(
        lacking=st.sampled_from(['', '', 'status', 'command', 'estop', 'enable']),
        answer=st.booleans(),
        steps=st.integers(3, 8),
    )
    def by_the_book(self, lacking: str, answer: bool, steps: int) -> None:
        """What chance would rarely find, but for one thing that may be missing."""
        for step in range(steps if self.open else 0):
            self.now += 0.01
            if step >= 3 and lacking == 'enable':
                continue
            self._request('enable', step >= 2)
            if step < 3 or lacking != 'estop':
                self._request('estop', False)
            if step < 3 or lacking != 'command':
                self._command(9.0)
            self._poll()
            if step < 3 or lacking != 'status':
                self._status(1 if self.was_enabled and answer else 0, 0)

    def _command(self, value: float) -> None:
        finite = math.isfinite(value)
        try:
            self.session.set_command((value, value), self.now)
        except ValueError:
            assert not finite
            self.heard.pop('command', None)
        else:
            assert finite
            self.heard['command'] = self.now
            self.commanded = self.commanded or self.session.phase is Phase.ENABLED

    @rule(value=st.floats())
    def command(self, value: float) -> None:
        self._command(value)
        self._poll()

    def _status(self, state: int, errors: int) -> None:
        if not self.open:
            return
        self.heard['status'] = self.now
        self.fault = bool(errors or state & 0x6E)
        self.says_enabled = bool(state & 1)
        self._check(self.session.receive(status(state, state & 1, errors=errors), self.now)[1])

    @rule(state=st.sampled_from([0, 0, 1, 1, 2, 0x10, 0x41]), errors=st.sampled_from([0, 0, 0, 4]))
    def status_packet(self, state: int, errors: int) -> None:
        self._status(state, errors)

    @rule(data=st.binary(max_size=30))
    def garbage(self, data: bytes) -> None:
        if self.open:
            self._check(self.session.receive(data, self.now)[1])

    @rule()
    def clear_errors(self) -> None:
        self.session.clear_errors(self.now)
        self._poll()

    @rule()
    def port_lost_and_found(self) -> None:
        self.session.closed(self.now)
        self.was_enabled = False
        assert self.session.estop
        self._open()

    @invariant()
    def packets_never_stop(self) -> None:
        if self.open:
            self._poll()
            assert self.now - self.last_sent <= self.PERIOD + 1e-9
            assert self.now < self.session.deadline() <= self.last_sent + self.PERIOD + 1e-9

    @invariant()
    def reasons_agree_with_the_stop(self) -> None:
        disobeys = self.says_enabled and self.now >= self.disabled_at + self.ENABLE_LIMIT
        stop = self.fault or disobeys or not self._fresh('status', self.STATUS_LIMIT)
        assert self.session.estop == stop
        assert bool(self.session.stop_reasons(self.now)) == stop
        says_enable = self.session.phase in (Phase.ENABLING, Phase.ENABLED)
        assert bool(self.session.inhibits(self.now)) != says_enable


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = hypothesis_settings(max_examples=120, stateful_step_count=40)
