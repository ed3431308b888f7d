"""Input messages: PGN 64982 and 64983, from joysticks at addresses 33 to 38 hex."""

from __future__ import annotations

from dataclasses import dataclass
import struct

from akron_can_bridge.protocol.frames import BASIC_JOYSTICK_PGN
from akron_can_bridge.protocol.frames import EXTENDED_JOYSTICK_PGN
from akron_can_bridge.protocol.frames import Sendable
from akron_can_bridge.protocol.values import Axis
from akron_can_bridge.protocol.values import pack_statuses
from akron_can_bridge.protocol.values import Status
from akron_can_bridge.protocol.values import UNAVAILABLE
from akron_can_bridge.protocol.values import unpack_statuses

JOYSTICK_PERIOD = 0.02  # Appendix B: what Akron Brass devices do; 100 ms is the most
JOYSTICK_TIMEOUT = 0.2  # Appendix B: the unit then clears that sender's input

_BASIC = struct.Struct('<HH4s')  # X, Y; detents, then switches 1-4, 5-8, 9-12
_EXTENDED = struct.Struct('<HHH2s')  # grip X, Y, theta; detents, then switches 13-16
assert _BASIC.size == _EXTENDED.size == 8
_OFF = Status.OFF
_RESERVED = (_OFF, _OFF)


def _check_count(what: str, statuses: tuple[Status, ...], count: int) -> None:
    if len(statuses) != count:
        raise ValueError(f'{count} {what} are needed, not {len(statuses)}')
    pack_statuses(statuses)


@dataclass(frozen=True, slots=True)
class BasicJoystick(Sendable):
    """
    PGN 64982: X turns, Y back elevates up (Appendix B).

    :param switches: 1 to 12: pattern stream, pattern fog, discharge on, oscillate on / set, flow
        high, flow low, oscillate pause / resume, deploy, stow, discharge off, CAFS dry, CAFS wet.
    :param detents: X, Y; ignored by Akron Brass devices.
    """

    PGN = BASIC_JOYSTICK_PGN
    LENGTHS = range(8, 9)
    PRIORITY = 3
    x: Axis
    y: Axis
    switches: tuple[Status, ...] = (_OFF,) * 12
    detents: tuple[Status, ...] = (_OFF,) * 2

    def __post_init__(self) -> None:
        _check_count('switches', self.switches, 12)
        _check_count('detents', self.detents, 2)

    @classmethod
    def _from_payload(cls, payload: bytes) -> BasicJoystick:
        x, y, rest = _BASIC.unpack(payload)
        statuses = unpack_statuses(rest)
        return cls(Axis.from_word(x), Axis.from_word(y), statuses[4:], statuses[:2])

    def _to_payload(self) -> bytes:
        rest = pack_statuses(self.detents + _RESERVED + self.switches)
        return _BASIC.pack(self.x.to_word(), self.y.to_word(), rest.to_bytes(4, 'big'))


@dataclass(frozen=True, slots=True)
class ExtendedJoystick(Sendable):
    """
    PGN 64983: grip X and Y are target angles, 100 % = 175 and 90 degrees (Appendix B).

    A neutral grip is a target too, of 0 degrees; who has no target leaves it UNAVAILABLE.

    :param switches: 13 to 16. :param detents: grip X, Y, theta.
    """

    PGN = EXTENDED_JOYSTICK_PGN
    LENGTHS = range(8, 9)
    PRIORITY = 3
    grip_x: Axis = UNAVAILABLE
    grip_y: Axis = UNAVAILABLE
    theta: Axis = UNAVAILABLE
    switches: tuple[Status, ...] = (_OFF,) * 4
    detents: tuple[Status, ...] = (_OFF,) * 3

    def __post_init__(self) -> None:
        _check_count('switches', self.switches, 4)
        _check_count('detents', self.detents, 3)

    @classmethod
    def _from_payload(cls, payload: bytes) -> ExtendedJoystick:
        *words, rest = _EXTENDED.unpack(payload)
        x, y, theta = map(Axis.from_word, words)
        statuses = unpack_statuses(rest)
        return cls(x, y, theta, statuses[4:], statuses[:3])

    def _to_payload(self) -> bytes:
        rest = pack_statuses((*self.detents, _OFF, *self.switches))
        words = (axis.to_word() for axis in (self.grip_x, self.grip_y, self.theta))
        return _EXTENDED.pack(*words, rest.to_bytes(2, 'big'))
