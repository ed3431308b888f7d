"""What the scene is played with: steering the remote, waiting, and measuring how a stop works."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import time

from bridge_core.framing import FrameError
from esi_drive_bridge.protocol import Status
from fort_vsc_bridge.protocol import decode
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import Joystick
from rugged_teleop.demo_stage import LAYOUT
from rugged_teleop.demo_stage import Packet
from rugged_teleop.demo_stage import Stage
from rugged_teleop.ports import DevicePort
from vm110_bridge.protocol import Crc
from vm110_bridge.protocol import Frame
from vm110_bridge.protocol import PacketId
from vm110_bridge.protocol import PeriodicInput

DEADMAN = 'left_down'
STICK = 'left_y'
PUSH = 0.6  # of full deflection
FAST_RPM = 1000.0  # of the motors, in motion
TOLD_LIMIT = 0.15  # s, for a stop that somebody demands
SILENT_LIMIT = 0.3  # s, for one that has to be noticed: the link's time-out of 0.25 s and 50 ms
UNIT_SILENT_LIMIT = 0.55  # s, the same for the VM-110: its link's time-out is 0.5 s
RAMP_LIMIT = 0.5  # s, for a takeover: 12 rad/s at 40 rad/s a second, and TOLD_LIMIT
FORT, VM110, SSC = 'fort', 'vm110', 'ssc'  # operators, as the mux names them
UNIT_DEADMAN, UNIT_STICK = 'switch 1 1', 'stick 1 2'  # of remote 1 of the VM-110
BETWEEN_RESETS = 0.55  # s; within clear_time of another one, or of a trip, a reset does nothing
DEMANDED, HELD = 'demands a stop', 'is not at neutral'  # the mux's words for what hinders a reset
_WAIT = 5.0
_POLL = 0.005
_STILL = 0.4  # s for which it is watched that nothing moves
_SEEN = 0.5  # s within which the answer to a reset is the mux's state
_TRIES = 5
_LATE_TRIES = 5
# How the mux's words begin that explain a stop, and do not stand in the way of a reset.
_EXPLAIN = ('stopped ', 'a trip is active', 'waiting for reset')
# Words for a stop that nobody asked for: some time-out, on a machine that is too busy. The two in
# the devices themselves make these demand a stop.
_LATE = ('was frozen', 'is stale', 'is silent', 'was lost', 'is not enabled', DEMANDED)


class Missed(Exception):  # noqa: N818 - an expectation that was missed, not a fault
    """What was expected did not happen; the text says what did."""


class Late(Missed):
    """It did happen, but later than allowed."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """How long a stop took, in seconds, from its cause to the first packet that disables."""

    cause: str
    seconds: float
    limit: float


@dataclass(frozen=True, slots=True)
class Grip:
    """How deadman and stick of a remote are worked."""

    device: str  # of the stage
    press: str
    push: str
    centre: str
    release: str


GRIPS = {
    FORT: Grip(
        'vsc',
        press=f'button {DEADMAN} 1',
        push=f'stick {STICK} {PUSH}',
        centre=f'stick {STICK} 0',
        release=f'button {DEADMAN} 0',
    ),
    VM110: Grip(
        'unit',
        press=f'{UNIT_DEADMAN} 1',
        push=f'{UNIT_STICK} {PUSH}',
        centre=f'{UNIT_STICK} 0',
        release=f'{UNIT_DEADMAN} 0',
    ),
    SSC: Grip(  # 500 us from the centre are full deflection
        'ssc',
        press='channel 4 2000',
        push=f'channel 3 {1500 + round(500 * PUSH)}',
        centre='channel 3 1500',
        release='channel 4 1000',
    ),
}


class Actor:
    """
    Acts on a stage. Every method that waits raises Missed where it waits in vain.

    :param patience: what all limits are multiplied by, for a machine that is busy with other work.
    """

    def __init__(self, stage: Stage, patience: float = 1.0) -> None:
        self.stage = stage
        self.patience = patience
        self.watcher = stage.watcher
        self.reactions: list[Reaction] = []
        self.time_outs = 0  # stops that nobody asked for
        self.latest = 0.0  # s by which this process was woken too late, at worst
        self.hand = FORT  # whose remote moves it
        self.caused_at = 0.0  # when the last stop was caused
        self._reset_at = -1.0
        self._late = 0.0  # s, the worst since the last cause of a stop

    # -- waiting ---------------------------------------------------------------------------------

    def wait(
        self,
        condition: Callable[[], object],
        otherwise: Callable[[], str] | None = None,
        limit: float = _WAIT,
    ) -> None:
        """Wait until it is true, ``limit`` s at most; ``otherwise`` says what is the case then."""
        limit *= self.patience
        end = time.monotonic() + limit
        while not condition():
            self.stage.check()
            if time.monotonic() > end:
                what = otherwise() if otherwise else f'the mux says: {self.watcher.message}'
                raise Missed(f'not within {limit:g} s; {what}')
            self._sleep()

    def wait_for_moment(self, find: Callable[[], float], otherwise: str) -> float:
        """Wait until ``find`` returns a moment other than 0; return it."""
        found = 0.0

        def is_found() -> bool:
            nonlocal found
            found = find()
            return found > 0.0

        self.wait(is_found, lambda: otherwise)
        return found

    def wait_for_state(self, state: str) -> None:
        """Wait until the mux says this state."""
        self.wait(lambda: self.watcher.state == state, lambda: f'the mux is {self.watcher.state}')

    def still(self, since: float) -> str:
        """Watch that no packet after ``since`` enables anything, for a while more."""
        packets: list[Packet] = []
        end = time.monotonic() + _STILL

        def seen() -> bool:
            packets[:] = self.stage.packets(since)
            if any(packet.enables for packet in packets):
                raise Missed(f'a packet enables the drive: {self.watcher.message}')
            return packets != [] and time.monotonic() > end

        self.wait(seen, lambda: 'no packets at all')
        return f'{len(packets)} packets, all disable'

    def _sleep(self) -> None:
        """Pass some time; note by how much this process was woken too late."""
        before = time.monotonic()
        time.sleep(_POLL)
        self._late = max(self._late, time.monotonic() - before - _POLL)
        self.latest = max(self.latest, self._late)

    # -- steering --------------------------------------------------------------------------------

    def remote(self, *commands: str) -> float:
        """Steer the VSC and its remote; return when the last was obeyed."""
        return [self.stage.vsc.apply(command) for command in commands][-1]

    def unit(self, *commands: str) -> float:
        """Steer the VM-110 and its remote 1; return when the last was obeyed."""
        return [self.stage.unit.apply(command) for command in commands][-1]

    def push(self) -> float:
        """Press the deadman, then push the stick; return when the deadman was pressed."""
        grip = GRIPS[self.hand]
        pressed_at = self._work(grip, grip.press)
        self._work(grip, grip.push)
        return pressed_at

    def let_go(self) -> None:
        """Release driving sticks and deadmen of all remotes."""
        for grip in GRIPS.values():
            self._work(grip, grip.centre, grip.release)

    def _work(self, grip: Grip, *commands: str) -> float:
        device: DevicePort = getattr(self.stage, grip.device)
        return [device.apply(command) for command in commands][-1]

    def acknowledge(self) -> float:
        """Acknowledge on FORT's remote, once nothing else stops the VSC; return when."""
        return self.wait_for_moment(self._try_to_acknowledge, 'the VSC stays stopped')

    def arm_unit(self) -> float:
        """Arm the VM-110's remote 1, once nothing else stops the base unit; return when."""
        return self.wait_for_moment(self._try_to_arm, 'the VM-110 stays stopped')

    def tend(self) -> None:
        """
        Acknowledge and rearm where it can be done.

        The stop of one device opens the hardware chains of the others; see CHAINS of the stage.
        """
        self._try_to_acknowledge()
        if self.stage.unit.describe()['state'] == 'External link error':
            self._try_to_arm()

    def _try_to_acknowledge(self) -> float:
        return _moment_of(lambda: self.remote('ack', 'mode operational'))

    def _try_to_arm(self) -> float:
        return _moment_of(lambda: self.unit('arm 1'))

    def reset(self) -> tuple[bool, str]:
        """Call for a reset; return success and message."""
        reply = self.watcher.call('reset')
        self._reset_at = time.monotonic()  # not before: it may have waited for the mux
        return reply

    def accepted_reset(self) -> str:
        """Let all go, tend to what hinders a reset, then reset; return the answer."""
        self.let_go()
        for _ in range(_TRIES):  # a time-out may come between the look and the reset
            self.wait(self._nothing_hinders)
            success, message = self.reset()
            if success and self._is_ready_soon():
                return message.split(';')[0]
        raise Missed(f'{message}; the mux says: {self.watcher.message}')

    def _is_ready_soon(self) -> bool:
        """Wait for READY; tell whether it came, for a time-out may have ended it unseen."""
        end = time.monotonic() + _SEEN * self.patience
        self.wait(lambda: self.watcher.state == 'READY' or time.monotonic() > end)
        return self.watcher.state == 'READY'

    def _nothing_hinders(self) -> bool:
        hindrances = self.hindrances()
        if hindrances:
            self.tend()
        return hindrances == [] and self._may_repeat_reset()

    def refused_reset(self, reason: str) -> str:
        """
        Call for a reset that must be refused for this reason, and not for being repeated.

        A time-out, on a machine that is too busy, may be what it is refused for; then once more.
        """
        for _ in range(_TRIES):
            self.wait(self._may_repeat_reset)
            success, message = self.reset()
            if success:
                raise Missed(f'it was accepted: {message}')
            if reason in message or not _is_late(message):
                break
        if reason not in message:
            raise Missed(f'it was refused, but not because something {reason}: {message}')
        self.wait_for_state('STOPPED')
        return shortened(message)

    def wait_for_held(self) -> None:
        """Tend to the devices until nothing but what is held on the remote hinders a reset."""

        def only_held() -> bool:
            hindrances = self.hindrances() or ['']
            if any(DEMANDED in text for text in hindrances):
                self.tend()
            return all(HELD in text for text in hindrances)

        self.wait(only_held)

    def hindrances(self) -> list[str] | None:
        """
        Return what the mux's status names that hinders a reset; None if it is not about a stop.

        State and inhibits from the same message: the topic of the state may be ahead of it.
        """
        values = self.watcher.values
        if values.get('state') != 'STOPPED':
            return None
        inhibits = [text for name, text in values.items() if name.startswith('inhibit')]
        return [text for text in inhibits if not text.startswith(_EXPLAIN)]

    def _may_repeat_reset(self) -> bool:
        return time.monotonic() - self._reset_at >= BETWEEN_RESETS

    # -- motion ----------------------------------------------------------------------------------

    def set_off(self) -> str:
        """Take control and drive off, from READY; return the speed reached."""
        return self.persist(lambda: f'{self._set_off():.0f} rpm')

    def return_to_fort(self) -> str:
        """Reset, and drive with FORT."""
        self.hand = FORT
        return f'{self.accepted_reset()}; {self.set_off()}, owner {FORT}'

    def persist(self, act: Callable[[], str]) -> str:
        """
        Return what ``act`` does, which may start from READY or from motion.

        On a machine that is too busy for the stack's time-outs, these rightly stop it again. That
        is told, and tried again: it is not what this scene is about.
        """
        told: list[str] = []
        while True:
            try:
                return '; '.join([act(), *told])
            except Missed:
                trouble = self._trouble()
                if trouble is None or len(told) == _TRIES - 1:
                    raise
                told.append(f'at first: {shortened(trouble)}')
                self._recover()

    def repeated(self, stop: Callable[[], str], undo: Callable[[], object]) -> str:
        """
        Return what ``stop`` does, if need be at a later try; one that was late is told, too.

        With all devices and all six nodes on two cores, some tens of milliseconds get lost now
        and then where nobody sees it.

        :param undo: goes back to motion.
        """
        told: list[str] = []
        while True:
            try:
                return '; '.join([stop(), *told])
            except Late as late:
                if len(told) == _LATE_TRIES - 1:
                    raise
                told.append(f'at first: {late}')
                self.wait_for_state('STOPPED')
                undo()

    def _set_off(self) -> float:
        """Rest, then press the deadman, then push the stick; return the speed reached in rpm."""
        self.let_go()
        self.wait(lambda: self._is_rested() or self._has_fallen())
        self.push()
        self.wait(lambda: self._slowest > FAST_RPM or self._has_fallen())
        if self._has_fallen():
            raise Missed(f'the mux says: {self.watcher.message}')
        self.wait_for_owner(self.hand)
        return self._slowest

    def wait_for_owner(self, name: str) -> None:
        """Wait until the mux says that this operator has control."""
        self.wait(
            lambda: self.watcher.state == 'ACTIVE' and self.watcher.values.get('owner') == name,
            lambda: f'the owner is {self.watcher.values.get("owner") or "none"}',
        )

    def _has_fallen(self) -> bool:
        """Tell whether it is STOPPED, with the status that says why; either may be the later."""
        return self.watcher.state == self.watcher.values.get('state') == 'STOPPED'

    def _is_rested(self) -> bool:
        is_ready = self.watcher.values.get('state') == 'READY'
        advice = f"press the deadman of '{self.hand}'"
        return is_ready and any(advice in text for text in self.watcher.inhibits)

    def _trouble(self) -> str | None:
        """Return what the mux says of a time-out that has stopped it; None if it is no such."""
        inhibits = self.watcher.inhibits
        return next(filter(_is_late, inhibits), None)

    def _recover(self) -> None:
        self.time_outs += 1
        if self._has_fallen():
            self.accepted_reset()

    @property
    def _slowest(self) -> float:
        """The speed of the slower motor, in rpm."""
        rpm: list[float] = self.stage.drive.describe()['rpm']
        return min(abs(value) for value in rpm)

    def _moving(self) -> bool:
        packets = self.stage.packets(time.monotonic() - 0.2)
        return bool(packets) and packets[-1].moves

    # -- stops -----------------------------------------------------------------------------------

    def stopped(
        self,
        cause: str,
        act: Callable[[], float],
        limit: float = TOLD_LIMIT,
        state: str = 'STOPPED',
    ) -> str:
        """
        Stop in mid-motion, and measure.

        :param act: causes the stop; returns the moment of the cause (seconds, monotonic).
        :param limit: s that it may take, and what this machine was late for us besides.
        :param state: what the mux must be afterwards.
        """
        if not self._moving():  # a time-out has stopped it since the step before: see set_off
            self._recover()
            self.set_off()
        self._late = 0.0
        self.caused_at = act()
        took = self.reacts(cause, 'disabled', self._first_disable, limit)
        self._wait_for_stop(state)
        packets = self.stage.packets(self._first_disable(self.caused_at))
        later = sum(packet.enables for packet in packets)
        if later:
            raise Missed(f'{later} packets after the first disable packet enable again')
        return f'{took}, {self.watcher.state}'

    def _wait_for_stop(self, state: str) -> None:
        """Wait for this state, or for the STOPPED of a time-out, which came on top of it."""
        self.wait(
            lambda: (
                self.watcher.state == state or (self._has_fallen() and self._trouble() is not None)
            ),
            lambda: f'the mux is {self.watcher.state}',
        )

    def reacts(self, cause: str, what: str, find: Callable[[float], float], limit: float) -> str:
        """
        Measure from the last cause of a stop on; return how long it took.

        :param cause: for the summary. :param what: happens then, in a word or two.
        :param find: finds the first moment of it after another one; 0: not yet.
        """
        found = self.wait_for_moment(lambda: find(self.caused_at), f'not {what}')
        seconds = found - self.caused_at
        self.reactions.append(Reaction(cause, seconds, limit))
        took = f'{what} {seconds * 1e3:.1f} ms after the cause'
        self.check_limit(took, seconds, limit)
        return took

    def check_limit(self, took: str, seconds: float, limit: float) -> None:
        """Raise Late if it took longer than allowed, and than this process was woken too late."""
        if seconds > limit * self.patience + self._late:
            raise Late(
                f'{took}, allowed are {limit * self.patience * 1e3:.0f} ms, and '
                f'{self._late * 1e3:.0f} ms by which this machine was late for us too'
            )

    def _first_disable(self, since: float) -> float:
        packets = self.stage.packets(since)
        return next((packet.at for packet in packets if not packet.enables), 0.0)

    def vsc_says(self, since: float, wanted: Callable[[object], bool]) -> float:
        """Wait for a message of the VSC after ``since``; return when it was written."""

        def written() -> float:
            return next((at for at, message in self.vsc_said(since) if wanted(message)), 0.0)

        return self.wait_for_moment(written, 'the VSC does not send it')

    def vsc_stop(self, command: str) -> float:
        """
        Cause a stop at the VSC; return when the first frame that tells of it was written.

        That is a heartbeat, or a joystick message before it: in a stop the VSC zeroes the sticks.
        """

        def tells(message: object) -> bool:
            stops = isinstance(message, Heartbeat) and message.estop != 0
            return stops or is_released(message)

        return self.vsc_says(self.remote(command), tells)

    def vsc_said(self, since: float) -> list[tuple[float, object]]:
        """Return the VSC's messages after ``since``, with the moments of writing."""
        return [(at, decode(frame)) for at, frame in self.stage.vsc.sent(since)]

    def unit_says(self, since: float, wanted: Callable[[PeriodicInput], bool]) -> float:
        """Wait for a VRPI of the VM-110 after ``since``; return when it was written."""

        def written() -> float:
            sent = self.stage.unit.sent(since)
            return next((at for at, data in sent if _is_vrpi(data, wanted)), 0.0)

        return self.wait_for_moment(written, 'the VM-110 does not send it')

    def drive_says_fault(self, since: float) -> float:
        """Wait for a status packet with an error; return when it was written."""

        def written() -> float:
            return next((at for at, frame in self.stage.drive.sent(since) if _faulty(frame)), 0.0)

        return self.wait_for_moment(written, 'the drive reports no error')


def _is_late(text: str) -> bool:
    return any(word in text for word in _LATE)


def _moment_of(act: Callable[[], float]) -> float:
    """Return when it was done; 0 if the device refused it."""
    try:
        return act()
    except ValueError:
        return 0.0


def is_released(message: object) -> bool:
    """Tell whether this is FORT's message of its released deadman."""
    return isinstance(message, Joystick) and message.buttons[0].value is False


def _is_vrpi(datagram: bytes, wanted: Callable[[PeriodicInput], bool]) -> bool:
    frame = Frame.from_bytes(datagram, Crc.MPEG2)
    return frame.kind == PacketId.PERIODIC_INPUT and wanted(
        PeriodicInput.from_bytes(frame.payload)
    )


def _faulty(frame: bytes) -> bool:
    try:
        return Status.from_bytes(frame, LAYOUT).faulty
    except FrameError:
        return False


def shortened(text: str, length: int = 110) -> str:
    """Return a text of ``length`` characters at most."""
    return text if len(text) <= length else text[: length - 1] + '…'
