# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the scene is played with: steering the remotes, waiting, and measuring how a stop works."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from functools import partial
import time
from typing import ParamSpec, TypeVar

from bridge_core.framing import FrameError
from demo.stage import DemoStage
from esi_drive_bridge.protocol import Layout, Status
from fort_vsc_bridge import protocol as fort
from rugged_teleop.ports import DevicePort
from stage.rig import wait_for
from vm110_bridge import protocol as vm110

FAST_RPM = 1000.0  # of the motors, in motion
DEMAND_LIMIT = 0.15  # s, for a stop that somebody demands
SILENT_LIMIT = 0.3  # s, for one that has to be noticed: the link's timeout of 0.25 s and 50 ms
UNIT_SILENT_LIMIT = 0.55  # s, the same for the VM-110: its link's timeout is 0.5 s
RAMP_LIMIT = 0.5  # s, for a takeover: 12 rad/s at 40 rad/s a second, and DEMAND_LIMIT
FORT, VM110, RC = 'fort', 'vm110', 'ssc'  # operators and their e-stops, as the mux names them
_WAIT = 5.0
_STILL = 0.4  # s for which it is watched that nothing moves
_READY = 0.5  # s within which the mux is READY after a reset
_TRIES = 5  # of what a machine that is too busy may undo
_UNRELIABLE = ('stale', 'silent')  # conditions of the mux's inputs
# What the mux says where a timeout took motion back without a stop: let go of the deadman first.
_LOST = ('held its deadman before it could count', 'then give control back')
_LOST_TIME = 1.0  # s of that; a drive takes its time to enable, too
_NO_TIMEOUT = {'none', 'trip', 'hold', 'motion'}  # causes of stops
_ACKNOWLEDGE, _ARM = ('ack', 'mode operational'), ('arm 1',)

P = ParamSpec('P')
T = TypeVar('T')
Step = tuple[str, Callable[[], str]]  # what is expected, and what shows it


class Late(AssertionError):  # noqa: N818 - an expectation that was missed, not a fault
    """It did happen, but later than allowed."""


# A device of the stage; what releases and presses the deadman, centres and pushes the stick.
REMOTES = {
    FORT: (
        'vsc',
        'button left_down 0',
        'button left_down 1',
        'stick left_y 0',
        'stick left_y 0.6',
    ),
    VM110: ('unit', 'switch 1 1 0', 'switch 1 1 1', 'stick 1 2 0', 'stick 1 2 0.6'),
    RC: ('ssc', 'channel 4 1000', 'channel 4 2000', 'channel 3 1500', 'channel 3 1800'),  # us
}


def step(expected: str, act: Callable[P, str], *args: P.args, **kwargs: P.kwargs) -> Step:
    return expected, partial(act, *args, **kwargs)


class Steering:
    """Acts on a stage. Whatever is expected and does not happen raises AssertionError."""

    def __init__(self, stage: DemoStage, patience: float = 1.0, *, timed: bool = True) -> None:
        self.stage = stage
        self.patience = patience  # what all limits are multiplied by, on a busy machine
        self.timed = timed  # a stop that took too long fails
        self.tries = round(_TRIES * patience)
        self.reactions: list[tuple[str, float, float]] = []  # cause, s that it took, limit
        self.timeouts = 0  # stops that nobody asked for
        self.latest = 0.0  # s by which this process was woken too late, at worst
        self.operator = FORT  # whose remote moves it
        self.caused_at = 0.0  # when the last stop was caused
        self.tripped_by = 0.0  # when ~/trip had answered
        self._late = 0.0  # s, the worst since then

    def wait(
        self,
        condition: Callable[[], T],
        otherwise: str | Callable[[], str] = '',
        limit: float = _WAIT,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> T:
        """
        Return its first true value, within ``limit`` s.

        :param otherwise: says what is the case. :param meanwhile: undoes what hinders it; anew, as
            on a machine that is too busy a timeout may stop it again.
        """
        what = otherwise or (lambda: f'the mux says: {self.stage.message}')

        def idle(seconds: float) -> None:
            meanwhile()
            self._spin(seconds)

        return wait_for(condition, limit * self.patience, what, idle=idle)

    def wait_in_motion(
        self, condition: Callable[[], T], otherwise: str = '', limit: float = _WAIT
    ) -> T:
        """
        Return its first true value, as ``wait`` does.

        :raises AssertionError: it is STOPPED, or waits for the deadman to be pressed anew.
        """
        kept_at = time.monotonic()

        def seen() -> T:
            nonlocal kept_at
            if not self._is_lost:
                kept_at = time.monotonic()
            lost = self.is_stopped() or time.monotonic() > kept_at + _LOST_TIME
            assert not lost, f'the mux says: {self.stage.message}'
            return condition()

        return self.wait(seen, otherwise, limit)

    def _spin(self, seconds: float) -> None:
        """Take what has come, or wait for it; note by how much this process was woken too late."""
        self.stage.check()
        before = time.monotonic()
        self.stage.observer.spin(seconds)
        self._late = max(self._late, time.monotonic() - before - seconds)
        self.latest = max(self.latest, self._late)

    @property
    def state(self) -> str:
        """The mux's state, by its topic; that of the status may be older."""
        return str(self.stage.state.last.data) if self.stage.state.messages else 'not heard'

    @property
    def owner(self) -> str:
        return self.stage.values.get('owner', 'none')

    def wait_for_owner(self, name: str) -> None:
        self.wait_in_motion(lambda: self.state == 'ACTIVE' and self.owner == name)

    def source(self, name: str) -> str:
        """Return the condition of an e-stop source, in the mux's one word."""
        return self.stage.condition(f"e-stop source '{name}'")

    def is_stopped(self) -> bool:
        """Tell whether it is STOPPED, with the status that says why; either may be the later."""
        return self.state == self.stage.values.get('state') == 'STOPPED'

    @property
    def _is_lost(self) -> bool:
        """Tell whether a timeout has taken motion back without a stop; see _LOST."""
        return any(words in self.stage.message for words in _LOST)

    def moving(self) -> bool:
        packets = self.stage.drive.packets(time.monotonic() - 0.2)
        return bool(packets) and packets[-1].moves

    def still(self, since: float) -> str:
        """Watch that no packet after ``since`` enables anything, for a while more."""
        return f'{self.stage.holds_still(since, _STILL)} packets, all disable'

    def deadman(self, held: bool, operator: str = '') -> float:
        device, *commands = REMOTES[operator or self.operator]
        return float(getattr(self.stage, device).apply(commands[held]))

    def stick(self, pushed: bool, operator: str = '') -> float:
        device, _, _, *commands = REMOTES[operator or self.operator]
        return float(getattr(self.stage, device).apply(commands[pushed]))

    def push(self) -> float:
        """Press the deadman, then push the stick; return when the deadman was pressed."""
        pressed_at = self.deadman(True)
        self.stick(True)
        return pressed_at

    def let_go(self) -> None:
        """Release driving sticks and deadmen of all remotes."""
        for operator in REMOTES:
            self.stick(False, operator)
            self.deadman(False, operator)

    def acknowledge(self) -> float:
        """Acknowledge on FORT's remote, once nothing else stops the VSC; return when."""
        return self.wait(lambda: _moment_of(self.stage.vsc, *_ACKNOWLEDGE), 'the VSC is stopped')

    def arm_unit(self) -> float:
        """Arm the VM-110's remote 1, once nothing else stops the base unit; return when."""
        return self.wait(lambda: _moment_of(self.stage.unit, *_ARM), 'the VM-110 is stopped')

    def try_to_acknowledge(self) -> None:
        """Acknowledge on FORT's remote where it can be done."""
        _moment_of(self.stage.vsc, *_ACKNOWLEDGE)

    def acknowledge_and_rearm(self) -> None:
        """
        Acknowledge and rearm where it can be done.

        The stop of one device opens the hardware chains of the others; see CHAINS of the stage.
        """
        self.try_to_acknowledge()
        if self.stage.unit.describe()['state'] == 'External link error':
            _moment_of(self.stage.unit, *_ARM)

    def accepted_reset(self) -> str:
        """Let all go, acknowledge and rearm, then reset; return the answer."""
        self.let_go()
        for _ in range(self.tries):  # a timeout may come between the look and the reset, or end it
            self.wait(self._may_reset)
            reply = self.stage.reset()
            with contextlib.suppress(AssertionError):
                assert reply.success
                self.wait(lambda: self.state == 'READY', limit=_READY)
                return str(reply.message).split(';')[0]
        raise AssertionError(f'{reply.message}; the mux says: {self.stage.message}')

    def _may_reset(self) -> bool:
        may_reset = self.stage.may_reset()
        if not may_reset and self.is_stopped():
            self.acknowledge_and_rearm()
        return may_reset

    def refused_reset(
        self, expected: Callable[[], bool], afterwards: Callable[[], bool] | None = None
    ) -> str:
        """
        Call for a reset that must be refused, and not for being repeated; return the answer.

        A timeout, on a machine that is too busy, may be what it is refused for; then once more.

        :param expected: what it must be refused for, by the mux's fields, before it and after it,
            unless ``afterwards`` says what must be after it.
        """
        for _ in range(self.tries):
            self.wait(lambda: expected() and self.stage.may_repeat_reset())
            reply = self.stage.reset()
            assert not reply.success, f'it was accepted: {reply.message}'
            self.wait(partial(self.stage.status_since, time.monotonic()))
            if (afterwards or expected)():
                return shortened(reply.message)
        raise AssertionError(f'it was refused, but for something else: {reply.message}')

    def demanded(self, source: str) -> bool:
        """Tell whether the mux is STOPPED, and this e-stop source demands a stop."""
        return self.is_stopped() and self.source(source) == 'stop'

    def held(self) -> bool:
        """Tell whether only what is held hinders a reset; if not, acknowledge and rearm."""
        values = self.stage.values
        clear = self.is_stopped() and values['stops clear'] == 'true'
        if not clear:
            self.acknowledge_and_rearm()
        return clear and values['operators at rest'] == 'false'

    def set_off(self) -> str:
        return self.retry(self._set_off)

    def restart(self) -> str:
        """Go the right way from STOPPED to motion."""
        return f'{self.accepted_reset()}; {self.set_off()}'

    def drive(self, operator: str) -> str:
        self.operator = operator
        return f'{self.set_off()}, owner {operator}'

    def return_to_fort(self) -> str:
        return f'{self.accepted_reset()}; {self.drive(FORT)}'

    def retry(self, act: Callable[[], str], undo: Callable[[], object] | None = None) -> str:
        """
        Return what ``act`` does, which may start from READY or from motion; if need be, again.

        On a machine that is too busy for the stack's timeouts, these rightly stop it again. That
        is reported, and tried again: it is not what this scene is about.

        :param undo: goes back to motion. With it only what was Late is tried again: with all
            devices and nodes on two cores, some tens of milliseconds get lost unseen.
        """
        reports: list[str] = []
        while True:
            try:
                return '; '.join([act(), *reports])
            except AssertionError as error:
                # The state comes before the status that gives its reason.
                self.wait(partial(self.stage.status_since, time.monotonic()))
                again = isinstance(error, Late) if undo else self._is_timed_out()
                if not again or len(reports) == self.tries - 1:
                    raise
                reports.append(
                    f'at first: {shortened(str(error) if undo else self.stage.message)}'
                )
                (undo or self._recover)()

    def _set_off(self) -> str:
        """Rest, then press the deadman, then push the stick; return the speed reached."""
        self.let_go()
        self.wait_in_motion(lambda: self.stage.is_rested(self.operator))
        self.push()
        self.wait_in_motion(lambda: self._slowest > FAST_RPM)
        self.wait_for_owner(self.operator)
        return f'{self._slowest:.0f} rpm'

    @property
    def _slowest(self) -> float:
        """The speed of the slower motor, in rpm."""
        rpm: list[float] = self.stage.drive.describe()['rpm']
        return min(map(abs, rpm))

    def _is_timed_out(self) -> bool:
        """
        Tell whether the mux names a stop that only a timeout can have caused, or a lost owner.

        Devices have timeouts too, and demand a stop when these expire.
        """
        values = self.stage.values
        if self.is_stopped():
            causes = values['stopped by'].split(', ')
            invalid = any(self.stage.condition(cause) == 'invalid' for cause in causes)
            return _NO_TIMEOUT.isdisjoint(causes) and not invalid
        if self._is_lost or (self.state == 'ACTIVE' and values.get('drive enabled') == 'false'):
            return True
        operator = self.stage.condition(f"operator '{self.operator}'")
        return operator in _UNRELIABLE or self.source(self.operator) in (*_UNRELIABLE, 'stop')

    def _recover(self) -> None:
        self.timeouts += 1
        if self.is_stopped():
            self.accepted_reset()

    def stopped(
        self,
        cause: str,
        act: Callable[[], float],
        limit: float = DEMAND_LIMIT,
        state: str = 'STOPPED',
        again: Callable[[], object] | None = None,
    ) -> str:
        """
        Stop in mid-motion, and measure.

        :param act: causes the stop; returns the moment of the cause (seconds, monotonic).
        :param limit: s that it may take, and what this machine was late for us besides.
        :param state: what the mux must be afterwards, unless a timeout comes on top.
        :param again: sets it in motion, if a timeout has stopped it since the step before.
        """
        if not self.moving():
            self._recover()
            (again or self.set_off)()
        self._late = 0.0
        self.caused_at = act()
        took = self.reacts(cause, 'disabled', self._first_disable, limit)
        self.wait(
            lambda: self.state == state or (self.is_stopped() and self._is_timed_out()),
            lambda: f'the mux is {self.state}',
        )
        packets = self.stage.drive.packets(self._first_disable(self.caused_at))
        later = sum(packet.enables for packet in packets)
        assert not later, f'{later} packets after the first disable packet enable again'
        return f'{took}, {self.state}'

    def _first_disable(self, since: float) -> float:
        packet = self.stage.drive.first_disable(since)
        return packet.time if packet else 0.0

    def reacts(self, cause: str, what: str, find: Callable[[float], float], limit: float) -> str:
        """
        Measure from the last cause of a stop on; return how long it took.

        :param cause: for the summary. :param what: happens then, in a word or two.
        :param find: finds the first moment of it after another one; 0: not yet.
        :raises Late: timed, it took longer than allowed and than this process was woken too late.
        """
        seconds = self.wait(lambda: find(self.caused_at), f'not {what}') - self.caused_at
        self.reactions.append((cause, seconds, limit))
        took = f'{what} {seconds * 1e3:.1f} ms after the cause'
        if self.timed and seconds > limit * self.patience + self._late:
            raise Late(
                f'{took}, allowed are {limit * self.patience * 1e3:.0f} ms, and '
                f'{self._late * 1e3:.0f} ms by which this machine was late for us too'
            )
        return took

    # What devices say; each returns when it was written.

    def vsc_stop(self, command: str) -> float:
        """
        Cause a stop at the VSC, and wait for the first frame that reports it.

        That is a heartbeat, or a joystick message before it: in a stop the VSC zeroes the sticks.
        """

        def reports(message: object) -> bool:
            stops = isinstance(message, fort.Heartbeat) and message.estop != 0
            return stops or _deadman_is(False, message)

        return self.vsc_says(self.stage.vsc.apply(command), reports)

    def vsc_deadman(self, held: bool) -> float:
        """Press or release FORT's deadman."""
        return self.vsc_says(self.deadman(held, FORT), partial(_deadman_is, held))

    def vsc_says(self, since: float, wanted: Callable[[object], bool]) -> float:
        return self._says(self.stage.vsc, since, lambda frame: wanted(fort.decode(frame)))

    def vsc_said(self, since: float) -> list[tuple[float, object]]:
        """Return the VSC's messages after ``since``, with the moments of writing."""
        return [(at, fort.decode(frame)) for at, frame in self.stage.vsc.sent(since)]

    def unit_says(self, since: float, wanted: Callable[[vm110.PeriodicInput], bool]) -> float:
        def is_wanted(datagram: bytes) -> bool:
            frame = vm110.Frame.from_bytes(datagram, vm110.Crc.MPEG2)
            is_vrpi = frame.kind == vm110.PacketId.PERIODIC_INPUT
            return is_vrpi and wanted(vm110.PeriodicInput.from_bytes(frame.payload))

        return self._says(self.stage.unit, since, is_wanted)

    def drive_fault(self) -> float:
        """Let the drive report an overcurrent."""
        since = self.stage.drive.apply('fault a overcurrent pulse')
        return self._says(self.stage.drive, since, _is_faulty)

    def _says(self, device: DevicePort, since: float, wanted: Callable[[bytes], bool]) -> float:
        return self.wait(
            lambda: next((at for at, data in device.sent(since) if wanted(data)), 0.0),
            f'{device.name} does not send it',
        )


def _moment_of(device: DevicePort, *commands: str) -> float:
    """Return when it was done; 0 if the device refused it."""
    with contextlib.suppress(ValueError):
        return device.apply(*commands)
    return 0.0


def _deadman_is(held: bool, message: object) -> bool:
    return isinstance(message, fort.Joystick) and message.buttons[0].value is held


def _is_faulty(frame: bytes) -> bool:
    with contextlib.suppress(FrameError):
        return Status.from_bytes(frame, Layout.DUAL).faulty
    return False


def shortened(text: str, length: int = 110) -> str:
    """Return a text of ``length`` characters at most."""
    return text if len(text) <= length else text[: length - 1] + '…'
