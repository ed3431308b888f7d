"""
The part of the scene with what else hears the mux: a monitor on CAN, and a servo on an SSC.

The SSC's RC receiver is the third operator. FORT's right stick turns the monitor all the time,
whoever drives: only the mux's e-stop is between.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import time

from akron_can_bridge.protocol import BasicJoystick
from akron_can_bridge.protocol import decode as decode_can
from akron_can_bridge.protocol import NEUTRAL
from fort_vsc_bridge.protocol import AXIS_NAMES
from fort_vsc_bridge.protocol import Joystick
from rugged_teleop.canbuses import unpack
from rugged_teleop.demo_actor import Actor
from rugged_teleop.demo_actor import Missed
from rugged_teleop.demo_actor import PUSH
from rugged_teleop.demo_actor import SSC
from rugged_teleop.demo_actor import TOLD_LIMIT
from rugged_teleop.ports import Chunk
from ssc_bridge.protocol import parser as ssc_parser
from ssc_bridge.protocol import PulseCommand

MONITOR_STICK = 'right_x'
_RIGHT_X = AXIS_NAMES.index(MONITOR_STICK)
IDLE_US, SHUT_US = 1500, 1000  # the throttle: at rest, and its failsafe in config/demo.yaml
# s, for a receiver without pulses: no signal after 0.1 s, told every 0.05 s, and TOLD_LIMIT.
RECEIVER_LIMIT = 0.3
_REST = BasicJoystick(NEUTRAL, NEUTRAL)
_TRIES = 5
_TURN_LIMIT = 1.0  # s, from pushing the stick to the first frame that turns the monitor
_TURNED = 1.0  # degrees, and more than that if it turns
_OVERLAP = 0.1  # s of bytes before the wanted ones, for a frame that began there


class Further(Actor):
    """Turns the monitor, drives by the SSC's receiver, and watches what the stops do to both."""

    @property
    def further_steps(self) -> list[tuple[str, Callable[[], str]]]:
        """What is expected, and what shows it, in order; from FORT in motion to FORT in motion."""
        return [
            ("FORT's right stick turns the monitor; a servo follows the motors", self.turn),
            ("FORT's e-stop stops motors, monitor and servo", self.stop_all),
            ('acknowledged, all sticks still held: nothing moves', self.hold_while_stopped),
            ("a reset, the monitor's stick still held: nothing moves", self.hold_over_reset),
            ("the SSC's deadman, then its stick: it drives", self.drive_ssc),
            ('the right stick let go, then pushed: the monitor turns again', self.turn),
            ("the SSC's receiver lost stops all, FORT's right stick pushed", self.stop_receiver),
            ('it is back, deadman and stick held: nothing moves', self.end_receiver),
            ('a reset, and FORT drives again', self.return_to_fort),
        ]

    def turn(self) -> str:
        """Turn the monitor while the motors turn."""
        return self.persist(self._turn)

    def _turn(self) -> str:
        if not self._moving():
            self.set_off()
        self._push_aside()
        before = self._rotation
        self.wait(lambda: abs(self._rotation - before) > _TURNED, lambda: 'the monitor stays')
        self.wait(self._is_open, lambda: f'the servo is at {self._last_pulse} us')
        return f'it is at {self._rotation:.1f} degrees, the servo at {self._last_pulse} us'

    def _push_aside(self) -> None:
        """Let go of the right stick, then push it; anew if a time-out has made it neutral."""
        for _ in range(_TRIES):
            self.remote(f'stick {MONITOR_STICK} 0')
            self.wait(lambda: self.watcher.axes[3:5] == (0.0, 0.0))
            self.remote(f'stick {MONITOR_STICK} {PUSH}')
            with contextlib.suppress(Missed):
                self.wait(self._is_turned, limit=_TURN_LIMIT)
                return
        raise Missed(f'the monitor is not told to turn; the mux says: {self.watcher.message}')

    def stop_all(self) -> str:
        """Press the e-stop on FORT's remote."""
        return self._all_stopped(
            "FORT's e-stop, monitor turning", lambda: self.vsc_stop('estop remote on'), TOLD_LIMIT
        )

    def stop_receiver(self) -> str:
        """Take the power from the SSC's receiver: no pulses any more."""
        happened = self._all_stopped(
            "the SSC's receiver lost", lambda: self.receiver('receiver off'), RECEIVER_LIMIT
        )
        # The mux stops the VSC too, which then zeroes its sticks: a little later, as a rule.
        word = 'pushed' if self._pushed_at(self._rest(self.caused_at)) else 'zeroed'
        return f"{happened}; FORT's stick was {word} then"

    def _pushed_at(self, moment: float) -> bool:
        """Tell whether the VSC's last joystick message before then had the right stick pushed."""
        said = self.vsc_said(moment - _OVERLAP)
        words = [message for at, message in said if at < moment and isinstance(message, Joystick)]
        return bool(words) and bool(words[-1].axes[_RIGHT_X].value)

    def _all_stopped(self, cause: str, act: Callable[[], float], limit: float) -> str:
        """Stop motors, monitor and servo in mid-motion, and measure all three."""
        if not (self._is_turned() and self._is_open()):  # a time-out: see persist
            self.turn()
        happened = [
            self.stopped(cause, act, limit),
            self.reacts(f'{cause}, to a neutral frame', 'monitor neutral', self._rest, limit),
            self.reacts(f'{cause}, to the failsafe pulse', 'servo shut', self._shut, limit),
        ]
        before = self._frames(self.caused_at - _OVERLAP)
        if not any(turns for at, turns in before if at < self.caused_at):
            raise Missed('the monitor was not told to turn before')
        return '; '.join(happened)

    def hold_while_stopped(self) -> str:
        """Let FORT speak of its sticks again, while the mux is STOPPED."""
        self.remote('estop remote off')
        self.acknowledge()
        self.wait(lambda: self.watcher.axes[3:4] not in ((), (0.0,)))
        return self._all_still(time.monotonic())

    def hold_over_reset(self) -> str:
        """Reset with all let go that the mux looks at; FORT's right stick is none of it."""
        since = time.monotonic()
        return f'{self.accepted_reset()}; {self._all_still(since)}'

    def drive_ssc(self) -> str:
        """Drive by the SSC's receiver."""
        self.hand = SSC
        return f'{self.set_off()}, owner {SSC}'

    def end_receiver(self) -> str:
        """Give the receiver its power back."""
        since = self.receiver('receiver on')
        self.wait(lambda: self.watcher.clear('SSC'))
        told = self._all_still(since)
        self.remote(f'stick {MONITOR_STICK} 0')
        return told

    def receiver(self, *commands: str) -> float:
        """Steer the SSC and its receiver; return when the last was obeyed."""
        return [self.stage.ssc.apply(command) for command in commands][-1]

    def _all_still(self, since: float) -> str:
        """Watch that after ``since`` no motor, nor the monitor, nor the servo is told to move."""
        told = self.still(since)
        frames, pulses = self._frames(since), self._pulses(since)
        if not frames or any(turns for _, turns in frames):
            raise Missed(f'{len(frames)} frames, or one of them turns the monitor')
        if not pulses or any(us != SHUT_US for _, us in pulses):
            raise Missed(f'the servo is told {sorted({us for _, us in pulses})} us')
        return f'{told}; {len(frames)} frames, all neutral; servo shut'

    # -- what the devices are told ---------------------------------------------------------------

    def _frames(self, since: float) -> list[tuple[float, bool]]:
        return turns_in(self.stage.monitor.received(since))

    def _pulses(self, since: float) -> list[tuple[float, int]]:
        pulses = pulses_in(self.stage.ssc.received(since - _OVERLAP))
        return [(at, us) for at, us in pulses if at > since]

    def _rest(self, since: float) -> float:
        return next((at for at, turns in self._frames(since) if not turns), 0.0)

    def _shut(self, since: float) -> float:
        return next((at for at, us in self._pulses(since) if us == SHUT_US), 0.0)

    def _is_turned(self) -> bool:
        """Tell whether the monitor is being told to turn."""
        frames = self._frames(time.monotonic() - _OVERLAP)
        return bool(frames) and frames[-1][1]

    def _is_open(self) -> bool:
        """Tell whether the servo is beyond idle, as while the motors turn."""
        return self._last_pulse > IDLE_US

    @property
    def _last_pulse(self) -> int:
        """What the servo was told last, in us; 0: nothing lately."""
        return next((us for _, us in reversed(self._pulses(time.monotonic() - _OVERLAP))), 0)

    @property
    def _rotation(self) -> float:
        """Where the monitor points, in degrees."""
        return float(self.stage.monitor.describe()['rotation_deg'])


def turns_in(chunks: list[Chunk]) -> list[tuple[float, bool]]:
    """Return the joystick frames among what a monitor has heard: when, and whether not neutral."""
    found = []
    for at, data in chunks:
        frame = unpack(data)
        message = None if frame is None else decode_can(frame).message
        if isinstance(message, BasicJoystick):
            found.append((at, message != _REST))
    return found


def pulses_in(chunks: list[Chunk]) -> list[tuple[float, int]]:
    """Return the pulses that an SSC was told for its first output, in us, and when."""
    parser, found = ssc_parser(), []
    for at, data in chunks:
        for message in parser.feed(data, at):
            if isinstance(message, PulseCommand):
                found.append((at, message.us[0]))
    return found
