# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The other joysticks on the bus: manual "Input Messages" and Appendix B.

The unit obeys each joystick at 33 to 38 hex, so one that nobody allowed drives it past the mux.
Docs: docs/decisions/0009-bus-joysticks.md.
"""

from __future__ import annotations

from collections.abc import Iterable
import math

from akron_can_bridge.protocol import (
    Axis,
    BasicJoystick,
    ExtendedJoystick,
    JOYSTICK_ADDRESSES,
    JOYSTICK_TIMEOUT,
    PROPRIETARY_PGN,
    Status,
)
from akron_can_bridge.session.events import AXIS_NAMES, Sticks
from akron_can_bridge.session.settings import Settings
from bridge_core.j1939 import CanFrame, J1939Id
from bridge_core.reasons import Coded
from bridge_core.session import HeldButtons, StickStream
from bridge_core.watchdog import Watchdog

FOREIGN_HOLD = 1.0  # seconds after its last frame for which a foreign joystick is a stop
# The left joystick of a VSC by FORT's manual: its identifiers (table 34), and which bytes of each
# are always FF (8.2.1, 8.2.2).
_VSC = {0x0CFDD633: (4, 6, 7), 0x0CFDD733: (2, 3, 4, 5, 6, 7)}
_MANUAL_HINT = (
    'if it is meant to drive the unit beside the mux, list it in allowed_joysticks; else take it '
    'off this bus'
)
_SOE_HINT = 'take it off this bus, or set soe_permissive to false'
_VSC_HINT = (
    "by identifier and bytes this is a FORT VSC's left joystick: change the VSC's identifiers "
    'with its configuration tool, or give the unit a bus of its own'
)
_SWITCHES = {Status.OFF: False, Status.ON: True}  # others cannot be read
_NO_EXTENDED = ExtendedJoystick(switches=(Status.NOT_AVAILABLE,) * 4)


class Joysticks:
    """Who else sends joystick frames, and what the one at ``joy_source`` says."""

    def __init__(self, settings: Settings) -> None:
        self.faulty: tuple[str, ...] = ()  # controls of joy_source
        self.asked_until = -math.inf  # one that is allowed asks the unit to move
        self.automatic_asked = False  # so, by itself; whoever sees to it takes it back
        self._settings = settings
        self._heard: dict[int, tuple[float, CanFrame]] = {}  # when, and the frame
        self._deflected: dict[int, float] = {}  # when it was last out of its neutral
        self._rested: set[int] = set()  # who was neutral since the last stop, and sound
        self._source = Watchdog(JOYSTICK_TIMEOUT)
        self._extended_heard = Watchdog(JOYSTICK_TIMEOUT)
        self._extended = _NO_EXTENDED
        self._stream = StickStream()
        self._held = HeldButtons(JOYSTICK_TIMEOUT)

    def forget_senders(self) -> None:
        """Forget all that was heard."""
        self._heard.clear()
        self._deflected.clear()
        self._rested.clear()
        self._source.reset()
        self._extended_heard.reset()
        self.faulty = ()

    def hear_sender(self, frame: CanFrame, source: int, now: float) -> None:
        """
        Note a sender, be its data sound or not: a unit may be less strict than we are.

        :param frame: of a joystick that a unit obeys, or A1 to ours, where we are to send that.
        """
        self._heard[source] = (now, frame)

    def hear_sticks(
        self, message: BasicJoystick | ExtendedJoystick, source: int, now: float
    ) -> list[Sticks]:
        """Take a sound frame; return what to report of it. A unit obeys no other addresses."""
        if source not in JOYSTICK_ADDRESSES:
            return []
        allowed = source in self._settings.allowed_joysticks
        if isinstance(message, BasicJoystick):
            self._deflected.pop(source, None)
            axes = message.x.value, message.y.value
            if axes == (0, 0):
                self._rested.add(source)
            else:
                self._deflected[source] = now
                if allowed:
                    self.asked_until = now + JOYSTICK_TIMEOUT
            if None in axes:
                self._rested.discard(source)
        self.automatic_asked |= message.automatic and allowed
        if source != self._settings.joy_source:
            return []
        if isinstance(message, ExtendedJoystick):
            self._extended = message
            self._extended_heard.feed(now)
            return []
        self._source.feed(now)
        sticks = self._sticks_of(message, now)
        self.faulty = sticks.faulty
        self._stream.published(counts=True)
        return [sticks]

    def expire(self, now: float, *, stopped: bool) -> list[Sticks]:
        """
        Forget who is not heard any more.

        Return the one neutral event that is owed once the joystick has fallen silent.
        """
        self._heard = dict(self._present(now))
        if not self._stream.owes_neutral(fresh=not self._source.expired(now), counts=True):
            return []
        self.faulty = ()
        if not stopped:
            self._held.miss(now, stopped=False)
        return [Sticks()]

    @property
    def deadline(self) -> float:
        """The moment at which time alone changes anything; infinite for never."""
        holds = [at + FOREIGN_HOLD for at, _ in self._heard.values()]
        return min([*holds, self._source.deadline if self._stream.streaming else math.inf])

    def moving(self, now: float) -> list[int]:
        """Return the addresses of those that ask the unit to move; ones that are broken may."""
        return [at for at, said in self._deflected.items() if now < said + JOYSTICK_TIMEOUT]

    def stop(self) -> None:
        """Have a stick that is held through a stop count as none that is pushed."""
        self._rested.clear()

    def pushes(self, now: float) -> bool:
        """Tell whether one that is allowed was let go since the last stop, and pushed."""
        allowed = self._settings.allowed_joysticks
        return any(at in allowed and at in self._rested for at in self.moving(now))

    def foreign(self, now: float) -> list[int]:
        """Return the addresses of those that nobody allowed, our own among them."""
        allowed = self._settings.allowed_joysticks
        return [address for address, _ in self._present(now) if address not in allowed]

    def _present(self, now: float) -> list[tuple[int, tuple[float, CanFrame]]]:
        return [item for item in self._heard.items() if now < item[1][0] + FOREIGN_HOLD]

    def describe(self, addresses: Iterable[int]) -> Coded | None:
        """Say who they are and what to do; None: there are none."""
        text = '; '.join(map(self._describe, addresses))
        return Coded('akron.foreign', text) if text else None

    def present(self, now: float) -> dict[int, str]:
        """Return all that are heard by address, with what they count as."""
        foreign = self.foreign(now)
        present = sorted(address for address, _ in self._present(now))
        return {at: 'foreign' if at in foreign else 'allowed' for at in present}

    def _describe(self, address: int) -> str:
        frame = self._heard[address][1]
        hint = _VSC_HINT if _is_of_vsc(frame) else _MANUAL_HINT
        if J1939Id.from_identifier(frame.identifier).pgn == PROPRIETARY_PGN:
            text, hint = 'a foreign controller gives the unit the SOE permission', _SOE_HINT
        elif address == self._settings.source_address:
            text = 'another sender uses our own source_address'
        else:
            text = 'a foreign joystick drives the unit past the mux'
        return f'{text}: address {address:02X}, frame {frame.identifier:08X}; {hint}'

    def _sticks_of(self, basic: BasicJoystick, now: float) -> Sticks:
        extended = _NO_EXTENDED if self._extended_heard.expired(now) else self._extended
        axes = (basic.x, basic.y, extended.grip_x, extended.grip_y, extended.theta)
        switches = basic.switches + extended.switches
        faulty = (*_faulty_axes(axes), *_faulty_switches(switches))
        seen = tuple(_SWITCHES.get(switch) for switch in switches)
        if faulty and not self._settings.tolerate_faulty_axes:
            self._held.miss(now, stopped=False, buttons=seen)
            return Sticks(faulty=faulty)
        pressed = tuple(map(bool, self._held.of(seen, now)))
        return Sticks(tuple(axis.value or 0 for axis in axes), pressed, faulty)


def _is_of_vsc(frame: CanFrame) -> bool:
    unused = _VSC.get(frame.identifier)
    sound = unused is not None and len(frame.data) == 8
    return sound and all(frame.data[place] == 0xFF for place in unused or ())


def _faulty_axes(axes: tuple[Axis, ...]) -> list[str]:
    """Name the broken ones. X and Y every joystick has; a grip need not be there."""
    names = dict(zip(AXIS_NAMES, axes, strict=True))
    return [
        f'{name} {"error" if axis.fault is Status.ERROR else "not available"}'
        for name, axis in names.items()
        if axis.fault is Status.ERROR or (axis.fault is not None and name in AXIS_NAMES[:2])
    ]


def _faulty_switches(switches: tuple[Status, ...]) -> list[str]:
    return [
        f'switch {number} error'
        for number, status in enumerate(switches, 1)
        if status is Status.ERROR
    ]
