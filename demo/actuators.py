# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The part of the scene with what else hears the mux: a monitor on CAN, and a servo on an SSC.

The SSC's RC receiver is the third operator. FORT's right stick turns the monitor, by the mux's
gated Joy: only while FORT has control, and only what was pushed since.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from functools import partial
import time

from akron_can_bridge import protocol as akron
from demo.stage import SHUT_US
from demo.steering import DEMAND_LIMIT, FORT, RC, Steering, Step, step
from rugged_teleop.canbuses import unpack
from rugged_teleop.ports import Chunk
from ssc_bridge import protocol as ssc
from stage.devices import SSC

MONITOR_STICK = 'right_x'
IDLE_US = 1500  # the throttle at rest
# s, for a receiver without pulses: no signal after 0.1 s, reported every 0.05 s; DEMAND_LIMIT.
RECEIVER_LIMIT = 0.3
_REST = akron.BasicJoystick(akron.NEUTRAL, akron.NEUTRAL)
_TURN_LIMIT = 1.0  # s, from pushing the stick to the first frame that turns the monitor
_TURNED = 1.0  # degrees, and more than that if it turns
_WATCHED = 0.6  # s, thirty frames
_LOOK_BACK = 1.0  # s in which a wire sends something, however late it is
_OVERLAP = 0.1  # s of bytes before the wanted ones, for a frame that began there

# docs/devices/akron.md: what a neutral stick does not end.
_AUTOMATIC = (
    'this ends what a stick moves; oscillating, deploying, stowing and Point Aim would go on, so '
    'the node starts none of them unless automatic_motion allows it'
)


class Actuators(Steering):
    """Turns the monitor, drives by the SSC's receiver, and watches what the stops do to both."""

    @property
    def actuator_steps(self) -> list[Step]:
        """What is expected, and what shows it; from FORT in motion to FORT in motion."""
        turn, drive = partial(self.retry, self._turn), self.drive_only
        let_go = "FORT's deadman released stops the monitor too, its stick still pushed"
        return [
            step("FORT's right stick turns the monitor; a servo follows the motors", turn),
            step("FORT's e-stop stops motors, monitor and servo", self.stop_all),
            step('acknowledged, all sticks still held: nothing moves', self.hold_while_stopped),
            step("a reset, the monitor's stick still held: nothing moves", self.hold_over_reset),
            step('FORT drives; that stick, held since before, turns nothing', drive, FORT),
            step('the right stick let go, then pushed: the monitor turns again', turn),
            step(let_go, self.stop_monitor),
            step("the SSC drives; FORT's right stick, pushed, turns nothing", drive, RC),
            step("the SSC's receiver lost stops all", self.stop_receiver),
            step('it is back, deadman and stick held: nothing moves', self.end_receiver),
            step('a reset, and FORT drives again', self.return_to_fort),
        ]

    def _turn(self) -> str:
        """Turn the monitor while the motors turn."""
        if not self.moving():
            self.set_off()
        self._push_aside()
        before = self._rotation
        self.wait_in_motion(lambda: abs(self._rotation - before) > _TURNED, 'the monitor stays')
        self.wait_in_motion(self._is_open, 'the servo stays')
        return f'it is at {self._rotation:.1f} degrees, the servo at {self._last_pulse} us'

    def _push_aside(self) -> None:
        """Let go of the right stick, then push it; anew if a timeout has made it neutral."""
        for _ in range(self.tries):
            self.stage.vsc.apply(f'stick {MONITOR_STICK} 0')
            self.wait_in_motion(lambda: self.stage.axes[3:5] == (0.0, 0.0))
            self.stage.vsc.apply(f'stick {MONITOR_STICK} 0.6')
            with contextlib.suppress(AssertionError):
                self.wait_in_motion(self._is_turned, limit=_TURN_LIMIT)
                return
        raise AssertionError(f'no frame turns the monitor; the mux says: {self.stage.message}')

    def stop_all(self) -> str:
        press = partial(self.vsc_stop, 'estop remote on')
        happened = self.all_stopped("FORT's e-stop, monitor turning", press, DEMAND_LIMIT)
        return f'{happened}; {_AUTOMATIC}'

    def drive_only(self, operator: str) -> str:
        """Drive, FORT's right stick pushed since before; nothing of it reaches the monitor."""
        self.wait(self._is_pushed_aside, meanwhile=self.try_to_acknowledge)
        since = time.monotonic()
        happened = self.drive(operator)
        self.wait(lambda: time.monotonic() > since + _WATCHED)
        return f'{happened}; {self.no_turn(since)}'

    def stop_monitor(self) -> str:
        release = partial(self.vsc_deadman, False)
        cause = 'deadman released, monitor turning'
        return self.monitor_stopped(cause, release, DEMAND_LIMIT, 'READY')

    def stop_receiver(self) -> str:
        self.wait(lambda: self._is_open() or self.is_stopped(), 'the servo stays')
        cut = partial(self.stage.ssc.apply, 'receiver off')
        cause = "the SSC's receiver lost"
        happened = self.stopped(cause, cut, RECEIVER_LIMIT)
        return f'{happened}; {self.servo_shut(cause, RECEIVER_LIMIT)}'

    def all_stopped(self, cause: str, act: Callable[[], float], limit: float) -> str:
        """Stop motors, monitor and servo in mid-motion, and measure all three."""
        return f'{self.monitor_stopped(cause, act, limit)}; {self.servo_shut(cause, limit)}'

    def monitor_stopped(
        self, cause: str, act: Callable[[], float], limit: float, state: str = 'STOPPED'
    ) -> str:
        """Stop motors and monitor in mid-motion, the servo open, and measure both."""
        turn = partial(self.retry, self._turn)
        if not (self._is_turned() and self._is_open()):  # a timeout: see retry
            turn()
        happened = [
            self.stopped(cause, act, limit, state, turn),
            self.reacts(f'{cause}, to a neutral frame', 'monitor neutral', self._rest, limit),
        ]
        before = self._frames(self.caused_at - _LOOK_BACK)
        turned = any(turns for at, turns in before if at < self.caused_at)
        assert turned, 'no frame turned the monitor before'
        return '; '.join(happened)

    def servo_shut(self, cause: str, limit: float) -> str:
        return self.reacts(f'{cause}, to the failsafe pulse', 'servo shut', self._shut, limit)

    def hold_while_stopped(self) -> str:
        """Let FORT report its sticks again, while the mux is STOPPED."""
        self.stage.vsc.apply('estop remote off')
        self.acknowledge()
        self.wait(self._is_pushed_aside, meanwhile=self.try_to_acknowledge)
        return self.all_still(time.monotonic())

    def hold_over_reset(self) -> str:
        """Reset with all let go that the mux looks at; FORT's right stick is none of it."""
        since = time.monotonic()
        return f'{self.accepted_reset()}; {self.all_still(since)}'

    def end_receiver(self) -> str:
        since = self.stage.ssc.apply('receiver on')
        self.wait(lambda: self.stage.is_clear(SSC))
        happened = self.all_still(since)
        self.stage.vsc.apply(f'stick {MONITOR_STICK} 0')
        return happened

    def all_still(self, since: float) -> str:
        """Watch that after ``since`` no packet, frame or pulse moves motor, monitor or servo."""
        happened = self.still(since)
        frames = self.no_turn(since)
        self.wait(lambda: bool(self._pulses(since)), 'the servo gets [] us', limit=1.0)  # as there
        pulses = {us for _, us in self._pulses(since)}
        assert pulses == {SHUT_US}, f'the servo gets {sorted(pulses)} us'
        return f'{happened}; {frames}; servo shut'

    def no_turn(self, since: float) -> str:
        """Return how many frames there were since then. :raises AssertionError: one turns it."""
        self.wait(lambda: bool(self._frames(since)), '0 frames', limit=1.0)  # its wire may be new
        frames = self._frames(since)
        assert not any(turns for _, turns in frames), 'a frame turns the monitor'
        return f'{len(frames)} frames, all neutral'

    def _frames(self, since: float) -> list[tuple[float, bool]]:
        return turns_in(self.stage.monitor.received(since))

    def _pulses(self, since: float) -> list[tuple[float, int]]:
        pulses = pulses_in(self.stage.ssc.received(since - _OVERLAP))
        return [(at, us) for at, us in pulses if at > since]

    def _rest(self, since: float) -> float:
        return next((at for at, turns in self._frames(since) if not turns), 0.0)

    def _shut(self, since: float) -> float:
        return next((at for at, us in self._pulses(since) if us == SHUT_US), 0.0)

    def _is_pushed_aside(self) -> bool:
        """Tell whether FORT reports its right stick as pushed."""
        return self.stage.axes[3:4] not in ((), (0.0,))

    def _is_turned(self) -> bool:
        """Tell whether the newest frame turns the monitor."""
        frames = self._frames(time.monotonic() - _OVERLAP)
        return bool(frames) and frames[-1][1]

    def _is_open(self) -> bool:
        """Tell whether the servo is beyond idle, as while the motors turn."""
        return self._last_pulse > IDLE_US

    @property
    def _last_pulse(self) -> int:
        """The servo's newest pulse, in us; 0: none lately."""
        return next((us for _, us in reversed(self._pulses(time.monotonic() - _OVERLAP))), 0)

    @property
    def _rotation(self) -> float:
        """Where the monitor points, in degrees."""
        return float(self.stage.monitor.describe()['rotation_deg'])


def turns_in(chunks: list[Chunk], source: int | None = None) -> list[tuple[float, bool]]:
    """
    Return the joystick frames among what a monitor has heard: when, and whether not neutral.

    :param source: address of the joystick; None: of all.
    """
    found = []
    for at, data in chunks:
        frame = unpack(data)
        if frame is None:
            continue
        message, sender = akron.decode(frame)
        if isinstance(message, akron.BasicJoystick) and source in (None, sender.source):
            found.append((at, message != _REST))
    return found


def pulses_in(chunks: list[Chunk]) -> list[tuple[float, int]]:
    """Return the pulses for an SSC's first output, in us, and when they came."""
    parser, found = ssc.parser(), []
    for at, data in chunks:
        for message in parser.feed(data, at):
            if isinstance(message, ssc.PulseCommand):
                found.append((at, message.us[0]))
    return found
