# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What we tell the unit as one of its joysticks: manual Appendix B, and A1 for SOE mode.

Frames leave every 20 ms while the port is open. They are neutral while the gate (see
bridge_core.gate) is shut. Beside its inputs, what shuts it is a line that took no frame for the
200 ms after which the unit forgets a joystick: a switch that is held would be pressed anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import itertools
import math

from akron_can_bridge.protocol import (
    BasicJoystick,
    ExtendedJoystick,
    JOYSTICK_PERIOD,
    JOYSTICK_TIMEOUT,
    NEUTRAL,
    PAUSE_SWITCH,
    Permission,
    PERMISSIVE_PERIOD,
    SoePermissive,
    Status,
)
from akron_can_bridge.session.settings import Settings
from bridge_core.gate import Gate, LEAVING, Policy
from bridge_core.j1939 import CanFrame, J1939Id
from bridge_core.reasons import Coded
from bridge_core.session import Pacer
from bridge_core.watchdog import Watchdog

PAUSE_TIME = 0.2  # for which the pause switch is held: twice the longest period of a joystick
FAREWELL_FRAMES = 3  # of each kind: a lost one must not leave the unit moving for its 200 ms
_FORGOTTEN = Coded(
    'akron.forgotten', 'no frame went out for 200 ms, so the unit forgot what was held'
)
_RESTARTED = Coded(
    'akron.restarted', 'the unit was silent for 0.5 s or more, so it may have been switched off'
)
_NOTHING = Permission(0)
_ALL = Permission.LEFT | Permission.RIGHT | Permission.UP | Permission.DOWN


@dataclass(frozen=True, slots=True)
class Command:
    """
    What the unit is to do.

    The neutral grip is one that has no target: 0 would be one, and a stop must start no journey.
    """

    basic: BasicJoystick
    extended: ExtendedJoystick


REST = Command(BasicJoystick(NEUTRAL, NEUTRAL), ExtendedJoystick())
_PAUSE = Command(
    BasicJoystick(NEUTRAL, NEUTRAL, tuple(Status(n == PAUSE_SWITCH) for n in range(1, 13))),
    ExtendedJoystick(),
)


class Drive:
    """Decides what goes out. Call ``watch`` after each change and at each deadline."""

    def __init__(self, settings: Settings) -> None:
        self.refused = 0  # commands
        self._settings = settings
        self._gate = Gate(Policy(stop=settings.estop_in_timeout, command=settings.command_timeout))
        self.said = Watchdog(JOYSTICK_TIMEOUT)  # by a frame that went out
        self._limited = Watchdog(settings.estop_in_timeout)
        self._directions: Permission | None = None  # permitted at most; None: nobody ever said
        self._is_refused = False  # the newest command
        self._command = REST
        self.asked_until = -math.inf  # our command asked the unit to move
        self._press_until = -math.inf
        self._pressing = False  # the last frame pressed the pause switch
        self._pacer = Pacer(JOYSTICK_PERIOD)
        self._extended_pacer = Pacer(JOYSTICK_PERIOD)
        self._permissive_pacer = Pacer(PERMISSIVE_PERIOD)
        self._permissive: tuple[int | None, Permission] = (None, _NOTHING)  # as sent last
        self._revoke: int | None = None  # whom to take back what was permitted

    def start(self, now: float) -> None:
        """Have a frame of each kind go at once, and periodically from then on."""
        self._pacer.start(now)
        if self._settings.extended:
            self._extended_pacer.start(now)

    def stop(self) -> None:
        """Send no more."""
        self._pacer.stop()
        self._extended_pacer.stop()
        self._permissive_pacer.stop()
        self.said.reset()
        self._revoke = None

    def forget_inputs(self) -> None:
        """Forget what was heard."""
        self._gate.forget()
        self._is_refused = False
        self._command = REST
        self._press_until = -math.inf
        unit, permitted = self._permissive
        if permitted:
            self._revoke = unit
        self._permissive = (None, _NOTHING)

    @property
    def moving(self) -> bool:
        """Motion is commanded, or something else: what goes out is not neutral."""
        return self._command != REST

    @property
    def pushes(self) -> bool:
        """The command asks for motion: by the stick, or by what starts some that goes on."""
        basic = self._command.basic
        return self.automatic or basic.x.value != 0 or basic.y.value != 0

    @property
    def automatic(self) -> bool:
        """The command starts motion that goes on by itself."""
        return self._command.basic.automatic or self._command.extended.automatic

    @property
    def oscillates(self) -> bool:
        """The command presses oscillate on / set, and asks for no other motion."""
        return self._command.basic.oscillates and not self._command.extended.automatic

    def pause(self, now: float) -> None:
        """
        Press oscillate pause / resume once, with a neutral stick.

        Not if the line takes no frame for a slot: somebody else may have paused it by then.
        """
        self._press_until = now + JOYSTICK_PERIOD
        self._pressing = False
        self._pacer.start(now)

    def _presses(self, now: float) -> bool:
        return now < self._press_until and not self.moving

    @property
    def due(self) -> float:
        """The moment at which a frame is due."""
        return min(self._pacer.due, self._extended_pacer.due, self._permissive_pacer.due)

    @property
    def deadlines(self) -> tuple[float, ...]:
        """When inputs, or what the unit holds, go stale, even if that is past."""
        watched = (self._gate.command, self._gate.stop, self.said, self._limited)
        return tuple(each.deadline for each in watched if each is not None)

    def watch(self, now: float, stops: Sequence[Coded]) -> tuple[Coded, ...]:
        """
        Make the frames neutral where anything forbids motion; return why they became so.

        :param stops: why the session demands a stop.
        """
        forgotten = self.moving and self.said.expired(now)
        reasons = self._gate.watch(now, [*stops, *[_FORGOTTEN] * forgotten])
        if reasons:
            self._rest(now)
        return reasons

    def unit_restarted(self) -> None:
        """Forget what is commanded: a unit that is switched on is to stand."""
        self._gate.shut([_RESTARTED])

    def forbidden(self, now: float, stops: Sequence[Coded]) -> list[Coded]:
        """Say what forbids motion, whatever the command is."""
        return self._gate.forbidden(now, stops)

    def stale(self, now: float) -> bool:
        """Tell whether an input is not heard as often as it must be."""
        command = self._gate.command
        late = command is not None and command.expired(now) and not self._is_refused
        return late or self._gate.stop.expired(now)

    def inhibits(self, now: float, stops: Sequence[Coded]) -> list[Coded]:
        """Say why nothing but neutral goes out; empty while commands do."""
        return self._gate.reasons(now, stops)

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input."""
        self._gate.hear_stop(value, now)

    def set_directions(self, directions: Permission, now: float) -> None:
        """Take which directions may be permitted at most; from now on it has to be repeated."""
        self._limited.feed(now)
        self._directions = directions

    def limit_directions(self) -> None:
        """Permit no direction until somebody says which: somebody once did."""
        self._directions = self._directions or _NOTHING

    def directions(self, now: float) -> Permission:
        """Return which directions may be permitted; all, if nobody ever said."""
        if self._directions is None:
            return _ALL
        return _NOTHING if self._limited.expired(now) else self._directions

    def set_command(self, command: Command, now: float, stops: Sequence[Coded]) -> None:
        """Take a command. It counts at once, or once a neutral one has come."""
        self._is_refused = False
        if self._gate.hear_command(now, stops, neutral=command == REST):
            self._note_push(now)
            self._command = command
            if self.moving:  # a press that went on behind it would resume what it paused
                self._press_until = -math.inf

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: there is none that counts until the next one."""
        self.refused += 1
        self._is_refused = True
        self._gate.reject_command(reason, now)

    def _note_push(self, now: float) -> None:
        if self.pushes:
            self.asked_until = now

    def _rest(self, now: float) -> None:
        """Forget what was asked, and have neutral frames go out with the next poll."""
        self._note_push(now)
        self._command = REST
        self.start(now)

    def joystick_frames(self, now: float) -> list[CanFrame]:
        """Return the frames that are due."""
        due = self._pacer.is_due(now), self._extended_pacer.is_due(now)
        if not any(due):
            return []
        command = _PAUSE if self._presses(now) else self._command
        return list(itertools.compress(self._frames(command), due))

    def permissive_frames(
        self, now: float, unit: int | None, permitted: Permission
    ) -> list[CanFrame]:
        """Return the A1 that is due: periodically, and at once when it changes."""
        if self._revoke not in (None, unit):
            self._permissive_pacer.start(now)
            return [self._permission(_NOTHING, self._revoke)]
        if not self._settings.soe_permissive or unit is None:
            self._permissive_pacer.stop()
            self._permissive = (None, _NOTHING)
            return []
        if (unit, permitted) != self._permissive:
            self._permissive_pacer.start(now)
        return [self._permission(permitted, unit)] * self._permissive_pacer.is_due(now)

    def stick_sent(self, now: float) -> bool:
        """Note that PGN 64982 went out; tell whether it begins to press the pause switch."""
        self._pacer.sent(now)
        self.said.feed(now)
        begins = self._presses(now) and not self._pressing
        self._pressing = self._presses(now)
        if begins:
            self._press_until = now + PAUSE_TIME
        return begins

    def extended_sent(self, now: float) -> None:
        """Note that PGN 64983 went out."""
        self._extended_pacer.sent(now)

    def permission_sent(self, frame: CanFrame, now: float) -> None:
        """Note that an A1 went out."""
        self._permissive_pacer.sent(now)
        self._revoke = None
        unit = J1939Id.from_identifier(frame.identifier).destination
        self._permissive = (unit, SoePermissive.from_bytes(frame.data).permitted)

    def farewell(self, unit: int | None, now: float) -> list[CanFrame]:
        """Return neutral, and no permission. No switch: a toggle may start what it is to end."""
        self._gate.shut([LEAVING])
        self._rest(now)
        frames = self._frames(REST)[: 1 + self._settings.extended]
        if self._settings.soe_permissive and unit is not None:
            frames.append(self._permission(_NOTHING, unit))
        return frames * FAREWELL_FRAMES

    def _frames(self, command: Command) -> list[CanFrame]:
        source = self._settings.source_address
        return [command.basic.to_frame(source), command.extended.to_frame(source)]

    def _permission(self, permitted: Permission, unit: int) -> CanFrame:
        return SoePermissive(permitted).to_frame(self._settings.source_address, unit)
