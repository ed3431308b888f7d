# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What goes to the pulse outputs: limits, rates, and the failsafe of each.

A message 20 carries all outputs at once (4.2.2.1), so none can be left out of it. Released means
no pulse there: 0, as 3.3 has it for constants. Once all outputs are released, such messages go out
for a while and then none. Silence alone would not do: the manual does not say that the SSC ever
forgets a command.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
import math

from bridge_core.session import Pacer
from bridge_core.watchdog import Watchdog
from ssc_bridge.channels import Failsafe, Servo
from ssc_bridge.protocol import MAX_OUTPUTS, PulseCommand
from ssc_bridge.session.settings import Settings

# Of an output: what goes out, where its servo was last, and whether it was commanded; see Channel.
OutputState = tuple[float, float, bool]
RELEASE_FRAMES = 3  # at least; one may be lost
# s; twice as long as a port may take nothing before it is given up.
RELEASE_TIME = 1.0
# s from the configuration to the first command, for the device to tell what its outputs do now;
# the longer one while that is not known of an output that is to be held.
_LOOK_FIRST = 0.1
_LOOK_LONGEST = 0.3


class Channel:
    """One pulse output. :param timeout: s after which a command is stale."""

    __slots__ = ('_at', '_commanded', '_target', 'command', 'servo', 'us')

    def __init__(self, servo: Servo, timeout: float) -> None:
        self.servo = servo
        self.command = Watchdog(timeout)
        self.us = 0.0  # what goes out; 0: no pulse
        self._target = 0.0
        self._at = 0.0  # where the servo was last, as far as is known; 0: nowhere yet
        self._commanded = False  # ``us`` is what was asked for last, not what was found

    def go_on(self, state: OutputState) -> None:
        """Go on from what a message has made of it, within its limits."""
        us, at, self._commanded = state
        self.us, self._at = self.servo.limited(us), self.servo.limited(at)

    @property
    def is_sought(self) -> bool:
        """What it has now is to be held, and is not known."""
        return self.servo.failsafe is Failsafe.HOLD and not (self._commanded or self._at)

    def ask(self, us: float, now: float) -> bool:
        """Take a command; tell whether it had to be limited."""
        self._target = self.servo.limited(us)
        self.command.feed(now)
        return self._target != us

    def driven_elsewhere(self, us: int, *, serial: bool) -> None:
        """
        Note what the device drives the output with, while that is not our doing.

        An output to be held that was never commanded goes on following that: else it would jump to
        where a pilot had it at the start as soon as he gives it to us.

        :param serial: it is driven with what is sent, as far as is known.
        """
        follows = self.servo.failsafe is Failsafe.HOLD and not (self._commanded or serial)
        if us and (follows or not self.us):
            self._at = self.servo.limited(us)

    def after(self, seconds: float) -> OutputState:
        """Return the state after this much time, see go_on."""
        us, commanded = self.us, self._commanded
        if self.command.heard:
            us = self._towards(self._target, self.servo.rate_us_per_s * seconds)
            commanded = True
        elif self.servo.failsafe is Failsafe.PULSE:
            us = self.servo.failsafe_us
        elif self.servo.failsafe is Failsafe.RELEASE:
            us = 0.0
        elif not commanded:  # else it is held: no pulse, too, if that was asked for
            us = self._at
        return us, us or self._at, commanded

    def _towards(self, target: float, change: float) -> float:
        if not (target and self._at):
            return target  # no pulse at all, or the first one ever
        return self._at + min(max(target - self._at, -change), change)


class Outputs:
    """All pulse outputs of one device."""

    def __init__(self, settings: Settings) -> None:
        named = {servo.channel: servo for servo in settings.servos}
        self.servos = {servo.name: servo for servo in settings.servos}
        self.limited = 0  # commands that were beyond an output's limits
        self.sent: tuple[OutputState, ...] = ()  # in the last message; empty: there was none yet
        self._channels = [
            Channel(
                named.get(number) or Servo.unnamed(number, settings.failsafe),
                settings.command_timeout,
            )
            for number in range(1, MAX_OUTPUTS + 1)
        ]
        self._pacer = Pacer(1.0 / settings.command_rate)
        self._stepped = -math.inf
        self._urgent = False  # a failsafe has begun, and what was sent before is in force
        self._fails_first = False  # the next message brings failsafes, whatever is asked meanwhile
        self._in_use = bool(settings.servos)  # outputs are ours: there is something to undo
        self._release_frames = max(RELEASE_FRAMES, math.ceil(RELEASE_TIME * settings.command_rate))
        self._looks_until: float | None = None  # at least, while something to be held is sought
        self._releases = 0  # frames without a pulse that are still to be sent
        # What holds once the message of the last ``frames`` has gone out: ``sent``, ``_releases``.
        self._offered: tuple[tuple[OutputState, ...], int] = (), 0

    def follow_on(self, states: Sequence[OutputState]) -> None:
        """Take the outputs as ours, as a session before this one has left them."""
        self.claim()
        self.sent = tuple(states)
        self._fails_first = True
        for channel, state in zip(self._channels, states, strict=False):
            channel.go_on(state)

    def begin(self, now: float) -> None:
        """
        Begin to send: the device is there, whatever it may have missed.

        What was sent before it went, by this process or one before it, must not stay in force.
        """
        self._releases = self._release_frames if self._in_use else 0
        if self._urgent:  # a failsafe waits for nothing that the device might tell
            return
        is_sought = any(channel.is_sought for channel in self._channels)
        self._looks_until = now + _LOOK_FIRST if is_sought else None
        self._pacer.start(now + (_LOOK_LONGEST if is_sought else _LOOK_FIRST))

    def claim(self) -> None:
        """Take the outputs as ours: somebody commanded them before this session."""
        self._in_use, self._releases = True, self._release_frames

    def end(self) -> None:
        """Send no more: the port is closed, and all commands are forgotten."""
        self._pacer.stop()
        self._urgent = False
        self._fails_first = bool(self.sent)

    def ask(self, number: int, us: float, now: float) -> None:
        """Command an output, 1 to 23, in µs; 0 is no pulse."""
        self.limited += self._channels[number - 1].ask(us, now)
        self._in_use = True

    def forget_commands(self) -> list[str]:
        """Forget all commands: every output goes to its failsafe; return who was commanded."""
        names = self._drop([channel for channel in self._channels if channel.command.heard])
        self._fails_first |= self._urgent
        return names

    def expire(self, now: float) -> list[str]:
        """Forget commands that are stale; return whose they were."""
        stale = [channel for channel in self._channels if channel.command.heard]
        return self._drop([channel for channel in stale if channel.command.expired(now)])

    def _drop(self, channels: Sequence[Channel]) -> list[str]:
        for channel in channels:
            channel.command.reset()
        self._urgent = self._urgent or bool(channels and self.sent)
        return [channel.servo.name for channel in channels]

    def driven_elsewhere(
        self, us: Sequence[int | None], now: float, serial: Collection[int] = ()
    ) -> None:
        """Note what drives the outputs, as the device says. :param serial: those on SERIAL."""
        if self._looks_until is not None:
            self._pacer.start(max(self._looks_until, now))
        for number, pulse in enumerate(us, 1):
            if pulse is not None:
                self._channels[number - 1].driven_elsewhere(pulse, serial=number in serial)

    def commanded(self) -> dict[int, str]:
        """Return the outputs with a fresh command: number to name."""
        numbered = enumerate(self._channels, 1)
        return {number: chan.servo.name for number, chan in numbered if chan.command.heard}

    def without_command(self) -> list[str]:
        """Name the outputs with a name that have no fresh command."""
        names = {chan.servo.name for chan in self._channels if not chan.command.heard}
        return [name for name in self.servos if name in names]

    def frames(self, now: float, count: int, *, at_once: bool = False) -> list[bytes]:
        """Return the message 20 for the first ``count`` outputs, if it is due and needed."""
        if not (at_once or self._urgent or self._pacer.is_due(now)):
            return []
        self._looks_until = None
        # After a stall a servo must not jump by all the time that was lost.
        seconds = min(max(now - self._stepped, 0.0), 2.0 * self._pacer.period)
        channels = self._channels[:count]
        if self._fails_first:  # however soon somebody commands anew
            for channel in channels:
                channel.command.reset()
        states = tuple(channel.after(seconds) for channel in channels)
        driven = any(channel.command.heard for channel in channels) or any(us for us, *_ in states)
        releases = self._release_frames if driven else self._releases - 1
        if not self._in_use or releases < 0:  # a hold would be a command to outputs not ours
            self._step_on(now)
            return []
        self._offered = states, releases
        return [PulseCommand(tuple(round(us) for us, *_ in states)).to_bytes()]

    def note_sent(self, now: float) -> None:
        """Go on from the message that ``frames`` has offered: it went out."""
        self.sent, self._releases = self._offered
        for channel, state in zip(self._channels, self.sent, strict=False):
            channel.go_on(state)
        self._step_on(now)

    def _step_on(self, now: float) -> None:
        self._pacer.sent(now)
        self._stepped, self._urgent, self._fails_first = now, False, False

    def expires_at(self) -> float:
        """Return when the next command becomes stale."""
        return min(channel.command.deadline for channel in self._channels)

    def sends_at(self) -> float:
        """Return when a message is due."""
        return -math.inf if self._urgent else self._pacer.due
