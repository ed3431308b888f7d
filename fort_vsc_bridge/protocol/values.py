# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Modes, keys, sticks and buttons as the messages carry them: manual section 6, 7.3, 7.4, 7.5."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag

from bridge_core.numerals import check_range


class Mode(IntEnum):
    """Table 12; those that are not in it are seen on devices, or named by public decoders."""

    ERROR = 0x00
    SEARCHING = 0x01
    WAKEUP = 0x02  # a public decoder
    INITIALIZE = 0x03  # likewise
    LOCAL = 0x04
    REMOTE_TRANSITION = 0x05  # likewise
    REMOTE = 0x06
    VEHICLE_ON = 0x07  # likewise
    STATIONARY = 0x08  # likewise
    OPERATIONAL = 0x09
    MENU = 0x0A
    PAUSE = 0x0B


CONNECTED_MODES = frozenset((Mode.REMOTE, Mode.OPERATIONAL, Mode.MENU, Mode.PAUSE))
# What the VSC goes back to after every stop, one that we asked for too (6.6).
MODES_AFTER_A_STOP = frozenset((Mode.LOCAL, Mode.SEARCHING))


class AutonomyMode(IntEnum):
    """Table 19."""

    USER_CONTROL = 0
    SHARED_CONTROL = 1
    AUTONOMOUS_CONTROL = 2


class EStopBits(IntFlag):
    """
    Who demands the stop: two bits each, as seen on devices.

    The manual (table 19) only promises that each bit is an e-stop, so any bit is one, named here
    or not.
    """

    SRC = 0x03  # button of the remote, or the remote is lost
    VSC = 0x0C  # wired input of the VSC
    USER = 0xC0  # host heartbeat 0x21: asked for, or missing past the User E-STOP Timeout


class Key(IntEnum):
    """User feedback keys: tables 24, 27 and 29. Table 42 prints 81 twice, the second is 84."""

    USER_1 = 1
    USER_2 = 2
    USER_3 = 3
    USER_4 = 4
    USER_5 = 5
    USER_6 = 6
    USER_7 = 7
    USER_8 = 8
    USER_9 = 9
    LEFT_VIBRATION = 10
    RIGHT_VIBRATION = 11
    BOTH_VIBRATION = 12
    INACTIVITY_PAUSE = 80  # minutes - 1
    AUTO_OFF_ENABLE = 81
    ORIENTATION_PAUSE_ENABLE = 82
    FREE_FALL_PAUSE_ENABLE = 83
    INACTIVITY_PAUSE_ENABLE = 84
    USER_ESTOP_TIMEOUT = 85
    TEXT_LINE_1 = 90
    TEXT_LINE_2 = 91
    TEXT_LINE_3 = 92
    TEXT_LINE_4 = 93
    DISPLAY_MODE = 99


USER_KEYS = range(1, 10)
VIBRATION_KEYS = range(10, 13)
PERSISTENT_KEYS = range(80, 86)  # kept in EEPROM, which wears out
TEXT_KEYS = range(90, 94)
INT32 = (-0x80000000, 0x7FFFFFFF)
_SWITCH = (0, 1)

# Least and greatest value that may be set for each key that is a number (table 24).
VALUE_RANGES: dict[int, tuple[int, int]] = {
    **dict.fromkeys(USER_KEYS, INT32),  # the SRC shows only what fits 16 bits, else XXXXXX
    **dict.fromkeys(VIBRATION_KEYS, _SWITCH),
    **dict.fromkeys(PERSISTENT_KEYS, _SWITCH),
    Key.INACTIVITY_PAUSE: (0, 10),
    Key.DISPLAY_MODE: (0, 3),
}


def check_value(key: int, value: int) -> None:
    """Let a value pass that its key takes. :raises ValueError: key or value that cannot be."""
    if key not in VALUE_RANGES:
        raise ValueError(f'key {key} takes no value; keys are 1-12, 80-85, 99')
    low, high = VALUE_RANGES[key]
    if not low <= value <= high:
        raise ValueError(f'key {key} takes {low} to {high}, not {value}')


MODES: dict[int, Mode] = {int(mode): mode for mode in Mode}
AUTONOMY_MODES: dict[int, AutonomyMode] = {int(mode): mode for mode in AutonomyMode}


def mode_name(mode: Mode | AutonomyMode | int | None) -> str:
    """Return a mode in the manual's words, such as 'Local'; 'Unknown (0x33)'; None: 'None'."""
    if mode is None:
        return 'None'
    if isinstance(mode, IntEnum):
        return mode.name.capitalize().replace('_', ' ')
    return f'Unknown (0x{mode:02X})'


def estop_sources(bits: int) -> list[str]:
    """Name the sources in an E-stop indication in words; empty only if it is 0."""
    named = {
        EStopBits.SRC: 'SRC (remote)',
        EStopBits.VSC: 'VSC (wired input)',
        EStopBits.USER: 'USER (this computer)',
    }
    words = [text for mask, text in named.items() if bits & mask]
    rest = bits & ~int(EStopBits.SRC | EStopBits.VSC | EStopBits.USER)
    return words + ([f'unknown source (bits 0x{rest:X})'] if rest else [])


class InputState(Enum):
    """Whether the device vouches for a stick or button (tables 31 and 33)."""

    VALID = 'valid'
    ERROR = 'error'
    UNAVAILABLE = 'unavailable'


_NOT_SET = 0b00
_SET = 0b01
_ERROR = 0b10
_UNAVAILABLE = 0b11

AXIS_NAMES = ('left_x', 'left_y', 'left_z', 'right_x', 'right_y', 'right_z')
_PAD = ('down', 'right', 'up', 'left')
BUTTON_NAMES = tuple(f'{pad}_{button}' for pad in ('left', 'right') for button in _PAD)
MAX_MAGNITUDE = 1023  # ten bits; a stick at its stop reads this much


@dataclass(frozen=True, slots=True)
class Axis:
    """
    One axis: -1023 to 1023 (X right, Y forward positive), or None where the state is not VALID.

    :raises ValueError: for a value out of range, or one that does not go with the state.
    """

    value: int | None
    state: InputState = InputState.VALID

    def __post_init__(self) -> None:
        if (self.value is None) is (self.state is InputState.VALID):
            raise ValueError(f'an axis that is {self.state.value} cannot have value {self.value}')
        if self.value is not None:
            check_range('an axis', self.value, -MAX_MAGNITUDE, MAX_MAGNITUDE)

    def to_word(self) -> int:
        """Return the word of table 30; a faulty axis is faulty in all three statuses."""
        if self.value is None:
            return 0x002A if self.state is InputState.ERROR else 0xFFFF
        direction = 4 if self.value > 0 else 2 if self.value < 0 else 0
        return abs(self.value) << 6 | _SET << direction


def _axis_of_status(statuses: int) -> Axis:
    """Return what three 2-bit statuses say where none is a valid direction."""
    neutral, negative, positive = statuses & 3, statuses >> 2 & 3, statuses >> 4 & 3
    flags = (neutral, negative, positive)
    if _ERROR in flags:
        return Axis(None, InputState.ERROR)
    if _UNAVAILABLE in flags:
        return Axis(None, InputState.UNAVAILABLE)
    return Axis(0) if flags == (_SET, _NOT_SET, _NOT_SET) else Axis(None, InputState.ERROR)


def _axes_by_word() -> tuple[Axis, ...]:
    """
    Read all words of table 30: 2 bits neutral, 2 negative, 2 positive status, 10 magnitude.

    No direction or several at once is an error: which one is true is not ours to guess. Neutral
    with some magnitude is neutral: the flag is the device's own verdict, taken with its dead zone.
    """
    axes = [_axis_of_status(statuses) for statuses in range(64)] * (MAX_MAGNITUDE + 1)
    magnitudes = range(MAX_MAGNITUDE + 1)
    axes[_SET << 2 :: 64] = [Axis(-magnitude) for magnitude in magnitudes]
    axes[_SET << 4 :: 64] = [Axis(magnitude) for magnitude in magnitudes]
    return tuple(axes)


AXES = _axes_by_word()  # by word


@dataclass(frozen=True, slots=True)
class Button:
    """One button: pressed or not, or None where the state is not VALID."""

    value: bool | None
    state: InputState = InputState.VALID

    def __post_init__(self) -> None:
        if (self.value is None) is (self.state is InputState.VALID):
            raise ValueError(f'a button that is {self.state.value} cannot have value {self.value}')

    def to_bits(self) -> int:
        """Return the two bits of table 33."""
        return _BUTTONS.index(self)


_BUTTONS = (  # by the two bits of table 33
    Button(False),
    Button(True),
    Button(None, InputState.ERROR),
    Button(None, InputState.UNAVAILABLE),
)
PADS = tuple(tuple(_BUTTONS[byte >> shift & 3] for shift in (0, 2, 4, 6)) for byte in range(256))


def pack_pad(buttons: tuple[Button, ...]) -> int:
    """Return one byte of table 32: down, right, up, left from the lowest bits on."""
    return sum(button.to_bits() << 2 * place for place, button in enumerate(buttons))
