"""
The scripted scene: a start, seven stops in mid-motion, the wrong ways to go on and the right one.

Each step states what is expected, waits for it up to a deadline and prints one line. Reactions run
from the moment at which the cause was written on a port (or the plug was pulled) to the moment at
which the first packet that disables the drive was read, both taken in this process with the
monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import time

from bridge_core.framing import FrameError
from esi_drive_bridge.protocol import Status
from fort_vsc_bridge.protocol import decode
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import Joystick
from rugged_teleop.demo_stage import DemoError
from rugged_teleop.demo_stage import LAYOUT
from rugged_teleop.demo_stage import Packet
from rugged_teleop.demo_stage import Stage

DEADMAN = 'left_down'
STICK = 'left_y'
PUSH = 0.6  # of full deflection
TOLD_LIMIT = 0.15  # s, for a stop that somebody demands
SILENT_LIMIT = 0.3  # s, for one that has to be noticed: the link's time-out of 0.25 s and 50 ms
RETURN_LIMIT = 2.0  # s, from plugging in to a healthy link
START_LIMIT = 20.0  # s, for discovery on a busy machine
_WAIT = 5.0
_POLL = 0.005
_STILL = 0.4  # s for which it is watched that nothing moves
# How the mux's words begin that explain a stop, and do not stand in the way of a reset.
_EXPLAIN = ('stopped ', 'a trip is active', 'waiting for reset')
_DEMANDED, _HELD = 'demands a stop', 'is not at neutral'
_FAST_RPM = 1000.0


class Missed(Exception):  # noqa: N818 - an expectation that was missed, not a fault
    """What was expected did not happen; the text says what did."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """How long a stop took, in seconds, from its cause to the first packet that disables."""

    cause: str
    seconds: float
    limit: float


class Scene:
    """
    The scene on a stage.

    :param say: prints a line.
    """

    def __init__(self, stage: Stage, say: Callable[[str], None] = print) -> None:
        self.reactions: list[Reaction] = []
        self._stage = stage
        self._say = say
        self._reset_at = -1.0

    @property
    def steps(self) -> list[tuple[str, Callable[[], str]]]:
        """What is expected, and what shows it, in order. It returns what happened."""
        again = ('reset and a new deadman move it again', self.restart)
        return [
            ('VSC and drive are found', self.connect),
            ('a start is a stop: deadman and stick move nothing', self.push_at_start),
            ('a reset with stick and deadman held is refused', self.reset_while_held),
            ('a reset with all let go is accepted and moves nothing', self.reset_rightly),
            ('deadman, then stick: the motors turn', self.drive_off),
            ('e-stop on the remote stops', self.stop_remote),
            ('a reset while the e-stop is pressed is refused', self.reset_while_pressed),
            ('released, but not acknowledged: refused', self.reset_unacknowledged),
            ('acknowledged, stick and deadman still held: refused', self.reset_still_held),
            ('stick let go, deadman held: refused', self.reset_deadman_held),
            ('a reset with all let go is accepted and moves nothing', self.reset_rightly),
            ('the stick without the deadman moves nothing', self.stick_alone),
            ('the deadman pressed with the stick pushed moves nothing', self.deadman_late),
            ('neutral, deadman, stick: the motors turn', self.drive_off),
            ('the wired e-stop of the VSC stops', self.stop_wired),
            again,
            ('a released deadman stops', self.stop_deadman),
            ('the deadman alone moves it again, without a reset', self.drive_on),
            ('a VSC that falls silent stops', self.stop_silence),
            ('it speaks again, stick and deadman held: nothing moves', self.end_silence),
            again,
            ('a fault of the drive stops', self.stop_fault),
            ('a reset before the errors are cleared is refused', self.clear_fault),
            again,
            ('~/trip stops', self.stop_trip),
            again,
            ('the VSC unplugged stops', self.stop_unplug),
            ('plugged in: healthy in the same process, nothing moves', self.plug),
            again,
            ('the stack ended in mid-motion: its last packets disable', self.end),
        ]

    def play(self) -> bool:
        """
        Play all steps, up to the first that fails; print the summary. Tell whether all held.

        What follows a failed step would start from somewhere else, and tell nothing.
        """
        steps = self.steps
        for number, (expected, show) in enumerate(steps):
            try:
                happened = show()
            except (Missed, DemoError) as error:
                self._say(f'FAILED  {expected}: {error}')
                self._say(
                    f'{number} of {len(steps)} expectations held, one failed, '
                    f'{len(steps) - number - 1} were not tried. The stack said:'
                )
                self._say(self._stage.output())
                return False
            self._say(f'ok      {expected}: {happened}')
        self._summarise(len(steps))
        return True

    def _summarise(self, count: int) -> None:
        self._say(f'\nall {count} expectations held. From cause to the first disable packet:')
        for reaction in self.reactions:
            self._say(
                f'  {reaction.seconds * 1e3:7.1f} ms  {reaction.cause}'
                f' (at most {reaction.limit * 1e3:.0f} ms)'
            )

    # -- start -----------------------------------------------------------------------------------

    def connect(self) -> str:
        """Wait for all three nodes, and for both devices without a stop."""
        watcher = self._stage.watcher
        self._wait(
            lambda: watcher.clear('VSC') and watcher.clear('drive') and watcher.values != {},
            lambda: f'heard e-stops {watcher.estops}, mux {watcher.message or "not heard"}',
            START_LIMIT,
        )
        took = time.monotonic() - self._stage.started_at
        self._expect_state('STOPPED')
        return f'both without a stop after {took:.1f} s, the mux is STOPPED'

    def push_at_start(self) -> str:
        """Behave as if it had been reset."""
        self._remote('mode operational')
        since = self._push()
        return self._still(since)

    def reset_while_held(self) -> str:
        """Reset with stick and deadman held, as the step before left them."""
        return self._refused(_HELD)

    def reset_rightly(self) -> str:
        """Let all go, and reset."""
        self._let_go()
        since = time.monotonic()
        self._wait(self._may_reset, lambda: self._stage.watcher.message)
        success, message = self._reset()
        if not success:
            raise Missed(message)
        self._expect_state('READY')
        return f'{message.split(";")[0]}; {self._still(since)}'

    def drive_off(self) -> str:
        """Rest, then press the deadman, then push the stick."""
        self._let_go()
        watcher = self._stage.watcher
        self._wait(
            lambda: (
                watcher.values.get('state') == 'READY' and 'press the deadman' in watcher.message
            ),
            lambda: watcher.message,
        )
        self._push()
        self._wait(lambda: self._slowest > _FAST_RPM, lambda: watcher.message)
        self._expect_state('ACTIVE')
        return f'{self._slowest:.0f} rpm'

    def drive_on(self) -> str:
        """Take control again after the deadman was released."""
        return self.drive_off()

    def restart(self) -> str:
        """Go the right way from STOPPED to motion."""
        reset = self.reset_rightly()
        return f'{reset.split(";")[0]}; {self.drive_off()}'

    # -- stops -----------------------------------------------------------------------------------

    def stop_remote(self) -> str:
        """Press the e-stop on the remote."""
        return self._stopped('e-stop of the remote', lambda: self._vsc_stop('estop remote on'))

    def stop_wired(self) -> str:
        """Open the VSC's wired e-stop input; close and acknowledge it afterwards."""
        happened = self._stopped('wired e-stop', lambda: self._vsc_stop('estop vsc on'))
        self._remote('estop vsc off', 'ack', 'mode operational')
        return happened

    def stop_deadman(self) -> str:
        """Release the deadman, with the stick still pushed."""

        def release() -> float:
            at = self._remote(f'button {DEADMAN} 0')
            return self._written(at, lambda m: isinstance(m, Joystick) and not _deadman_held(m))

        return self._stopped('deadman released', release, state='READY')

    def stop_silence(self) -> str:
        """Let the VSC hang, its port still open."""

        def hang() -> float:
            at = self._remote('stall on')
            beats = [t for t, m in self._messages(at - 1.0) if isinstance(m, Heartbeat)]
            return beats[-1]

        return self._stopped('VSC silent, since its last heartbeat', hang, SILENT_LIMIT)

    def end_silence(self) -> str:
        """Let the VSC go on."""
        since = self._remote('stall off')
        self._wait_for_held()
        return f'{self._refused(_HELD)}; {self._still(since)}'

    def stop_fault(self) -> str:
        """Let the drive report an overcurrent."""

        def fail() -> float:
            at = self._stage.drive.apply('fault a overcurrent pulse')
            return self._wait(lambda: self._fault_written(at), lambda: 'no status packet has it')

        return self._stopped('overcurrent in the drive', fail)

    def clear_fault(self) -> str:
        """Try to go on without clearing the errors, then clear them."""
        self._let_go()
        happened = self._refused(_DEMANDED)
        success, message = self._stage.watcher.call('clear_errors')
        if not success:
            raise Missed(message)
        return f'{happened}; ~/clear_errors: {message}'

    def stop_trip(self) -> str:
        """Call the mux's own stop."""

        def trip() -> float:
            at = time.monotonic()
            self._stage.watcher.call('trip')
            return at

        return self._stopped('~/trip, from its call', trip)

    def stop_unplug(self) -> str:
        """Pull the VSC's plug."""
        return self._stopped('VSC unplugged', lambda: self._remote('unplug'), SILENT_LIMIT)

    def plug(self) -> str:
        """Plug the VSC in again; stick and deadman are still held on the remote."""
        pid, since = self._stage.stack.pid, self._remote('plug')
        self._wait(
            lambda: self._stage.watcher.clear('VSC'),
            lambda: self._stage.watcher.message,
            RETURN_LIMIT,
        )
        took = time.monotonic() - since
        self._stage.check()
        return f'after {took:.1f} s in process {pid}; {self._still(since)}'

    def end(self) -> str:
        """End the stack while the motors turn."""
        since = time.monotonic()
        status = self._stage.end_stack()
        packets = self._stage.packets(since)
        if status != 0 or not packets or packets[-1].enables:
            raise Missed(f'exit status {status}, last packet {packets[-1:]}')
        count = len(packets) - max((n for n, p in enumerate(packets, 1) if p.enables), default=0)
        return f'{count} disable packets, exit status 0'

    # -- wrong ways to go on ---------------------------------------------------------------------

    def reset_while_pressed(self) -> str:
        """Reset at once."""
        return self._refused(_DEMANDED)

    def reset_unacknowledged(self) -> str:
        """Release the e-stop, and do not acknowledge it on the remote."""
        self._remote('estop remote off')
        return self._refused(_DEMANDED)

    def reset_still_held(self) -> str:
        """Acknowledge, with stick and deadman held all the time."""
        since = self._remote('ack', 'mode operational')
        self._wait_for_held()
        return f'{self._refused(_HELD)}; {self._still(since)}'

    def reset_deadman_held(self) -> str:
        """Centre the stick, keep the deadman."""
        self._remote(f'stick {STICK} 0')
        self._wait(lambda: self._stick == 0.0, lambda: 'the stick does not come back')
        return self._refused(_HELD)

    def stick_alone(self) -> str:
        """Push the stick, without the deadman."""
        return self._still(self._remote(f'stick {STICK} {PUSH}'))

    def deadman_late(self) -> str:
        """Press the deadman now: the stick is not neutral."""
        return self._still(self._remote(f'button {DEADMAN} 1'))

    # -- helpers ---------------------------------------------------------------------------------

    def _wait(
        self, condition: Callable[[], object], otherwise: Callable[[], str], limit: float = _WAIT
    ) -> float:
        """Wait until it is true; return its value. :raises Missed: not within ``limit`` s."""
        end = time.monotonic() + limit
        while not (value := condition()):
            self._stage.check()
            if time.monotonic() > end:
                raise Missed(f'not within {limit:g} s; {otherwise()}')
            time.sleep(_POLL)
        return float(value) if isinstance(value, int | float) else 0.0

    def _still(self, since: float) -> str:
        """Watch that no packet after ``since`` enables anything, for a while more."""
        end = time.monotonic() + _STILL
        while time.monotonic() < end:
            packets = self._stage.packets(since)
            if any(packet.enables for packet in packets):
                raise Missed(f'a packet enables the drive: {self._stage.watcher.message}')
            time.sleep(_POLL)
        if not packets:
            raise Missed('no packets at all')
        return f'{len(packets)} packets, all disable'

    def _expect_state(self, state: str) -> None:
        watcher = self._stage.watcher
        self._wait(lambda: watcher.state == state, lambda: f'the mux is {watcher.state}')

    def _remote(self, *commands: str) -> float:
        """Steer the VSC and its remote; return when the last was done."""
        return [self._stage.vsc.apply(command) for command in commands][-1]

    def _push(self) -> float:
        """Press the deadman and push the stick; return when the deadman was pressed."""
        at = self._remote(f'button {DEADMAN} 1')
        self._remote(f'stick {STICK} {PUSH}')
        return at

    def _let_go(self) -> None:
        self._remote(f'stick {STICK} 0', f'button {DEADMAN} 0')

    @property
    def _stick(self) -> float:
        axes = self._stage.watcher.axes
        return axes[1] if len(axes) > 1 else 0.0

    @property
    def _slowest(self) -> float:
        """The speed of the slower motor, as the drive measures it."""
        rpm: list[float] = self._stage.drive.describe()['rpm']
        return min(abs(value) for value in rpm)

    def _hindrances(self) -> list[str] | None:
        """
        Return what the mux's status names that hinders a reset; None if it is not about a stop.

        State and inhibits from the same message: the topic of the state may be ahead of it.
        """
        values = self._stage.watcher.values
        if values.get('state') != 'STOPPED':
            return None
        inhibits = [text for name, text in values.items() if name.startswith('inhibit')]
        return [text for text in inhibits if not text.startswith(_EXPLAIN)]

    def _may_reset(self) -> bool:
        """Tell whether nothing is missing but the reset. Two calls too close count as one held."""
        return time.monotonic() - self._reset_at > 0.55 and self._hindrances() == []

    def _wait_for_held(self) -> None:
        """Wait until nothing but what is held on the remote hinders a reset."""

        def only_held() -> bool:
            hindrances = self._hindrances()
            return bool(hindrances) and all(_HELD in text for text in hindrances or ())

        self._wait(only_held, lambda: self._stage.watcher.message)

    def _reset(self) -> tuple[bool, str]:
        self._reset_at = time.monotonic()
        return self._stage.watcher.call('reset')

    def _refused(self, reason: str) -> str:
        """Call for a reset that must be refused, for this reason and not for being repeated."""
        self._wait(lambda: time.monotonic() - self._reset_at > 0.55, lambda: 'the clock stands')
        success, message = self._reset()
        if success:
            raise Missed(f'it was accepted: {message}')
        if reason not in message:
            raise Missed(f'it was refused, but not because something {reason}: {message}')
        self._expect_state('STOPPED')
        return _shortened(message)

    def _stopped(
        self,
        cause: str,
        act: Callable[[], float],
        limit: float = TOLD_LIMIT,
        state: str = 'STOPPED',
    ) -> str:
        """Stop in mid-motion, measure; ``act`` returns when the cause was there."""
        if not self._stage.packets(time.monotonic() - 0.2)[-1].moves:
            raise Missed('nothing was moving before')
        at = act()
        first = self._wait(lambda: self._first_disable(at), lambda: 'no packet disables')
        self.reactions.append(Reaction(cause, first - at, limit))
        self._expect_state(state)
        later = [packet for packet in self._stage.packets(first) if packet.enables]
        if later:
            raise Missed(f'{len(later)} packets after the first disable packet enable again')
        took = f'disabled {(first - at) * 1e3:.1f} ms after the cause'
        if first - at > limit:
            raise Missed(f'{took}, allowed are {limit * 1e3:.0f} ms')
        return f'{took}, {state}'

    def _first_disable(self, since: float) -> float:
        packets: list[Packet] = self._stage.packets(since)
        return next((packet.at for packet in packets if not packet.enables), 0.0)

    def _vsc_stop(self, command: str) -> float:
        """Cause a stop at the VSC; return when the first heartbeat that has it was written."""
        at = self._remote(command)
        return self._written(at, lambda m: isinstance(m, Heartbeat) and m.estop != 0)

    def _written(self, since: float, wanted: Callable[[object], bool]) -> float:
        """Wait for a message of the VSC; return when it was written."""

        def written() -> float:
            return next((at for at, m in self._messages(since) if wanted(m)), 0.0)

        return self._wait(written, lambda: 'the VSC does not send it')

    def _messages(self, since: float) -> list[tuple[float, object]]:
        return [(at, decode(frame)) for at, frame in self._stage.vsc.sent(since)]

    def _fault_written(self, since: float) -> float:
        for at, frame in self._stage.drive.sent(since):
            try:
                if Status.from_bytes(frame, LAYOUT).faulty:
                    return at
            except FrameError:
                continue
        return 0.0


def _deadman_held(joystick: Joystick) -> bool:
    return joystick.buttons[0].value is True


def _shortened(text: str, length: int = 110) -> str:
    return text if len(text) <= length else text[: length - 1] + '…'
