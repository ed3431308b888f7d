# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A simulated SSC: receiver, switch table, servos, auxiliary channels, messages and menus.

It has one port, Comm 1. What the manual leaves open is settled thus: the nibble of a source counts
from 0; the command pulse is 1 ms below 1.25 ms and 2 ms from 1.75 ms on; no pulse for 0.1 s is no
signal; the serial command array starts as 0, no pulse, and keeps what it was told for ever: the
SSC knows no silence of its host, unless 'alone' says so.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import struct
from typing import Any

from bridge_core.framing import ChecksumError, FrameFormat, StreamParser
from bridge_core.simulation import obey, one_of, setter, switch, within
from ssc_bridge.simulator.auxiliary import Auxiliary
from ssc_bridge.simulator.memory import build_frame, Memory, Settings, sums
from ssc_bridge.simulator.menus import Menu, Menus, Terminal

BOOT_TIME = 0.3
CONFIG_TIME = 5.0  # seconds from power-on during which the menus can be entered (3)
ENTRY = b'ssconfig'
NO_SIGNAL_TIME = 0.1
ALONE_TIME = 1.0  # s without a serial command until 'alone' counts
FAILSAFE_US = 1500  # of the command channel while the transmitter is lost (2)
_INVALID = 0x8000
_STATES = ('no signal', '1 ms', '1.5 ms', '2 ms')
_SOURCES = ('PIN', 'PINv', 'CONST', 'SERIAL', 'LAST')
_MESSAGES = (10, 11, 12, 13, 14)  # with a rate, in the order of the rates


def _decode(frame: bytes) -> tuple[int, bytes]:
    if sums(frame[2:-2]) != frame[-2:]:
        raise ChecksumError('wrong sums')
    return frame[2], frame[4:-2]


_FORMAT = FrameFormat(b'\x81\xa1', 4, 261, lambda head: head[3] + 6, _decode)  # ID and payload


def _source_text(byte: int) -> str:
    """Return a source as the switch table prints it (3.3)."""
    source = byte & 0x0F
    if source > 1:
        return _SOURCES[source] if source < len(_SOURCES) else 'unknown'
    return f'{_SOURCES[source]} {(byte >> 4) + 1}'


class Simulator:
    """
    An SSC, its receiver on: the command channel at 1 ms, all sticks centred.

    :param settings: what it has stored. None: sensible ones, with 8 inputs and 16 outputs.
    :param image: what it has stored, byte by byte; stands above ``settings``.
    :param terminal: habits of its menus.
    """

    def __init__(
        self,
        settings: Settings | None = None,
        *,
        image: bytes | None = None,
        terminal: Terminal | None = None,
    ) -> None:
        self.memory = Memory(image or (settings or Settings()).to_image())
        self.terminal = terminal or Terminal()
        self.channels: list[int | None] = [1000, *[1500] * 15]  # us, as the transmitter has them
        self.receiver = True  # it has power
        self.link = True  # it hears the transmitter
        self.mute = False
        self.keeps = False  # a serial command of 0 leaves the last pulse
        self.alone: dict[int, int] = {}  # us, by output from 0: its pulse while the host is silent
        self.aux = [Auxiliary() for _ in range(6)]
        self.received: dict[int, int] = {}  # good frames, by ID
        self.rejected = 0  # good frames that make no sense
        self._parser = StreamParser(_FORMAT)
        self._now = 0.0
        self._boot(0.0)

    def _boot(self, up_at: float) -> None:
        """Come up with what is stored."""
        self.memory.reload()
        self.settings = self.memory.settings
        self.outputs: list[int | None] = [None] * self.settings.outputs
        self.serial: list[int] = [0] * self.settings.outputs
        for aux, word in zip(self.aux, self.settings.aux, strict=True):
            aux.configure(word)
        self._locked = False
        self._menu: Menu[None] | None = None
        self._up_at = up_at
        self._signal_at = -math.inf
        self._commanded_at = math.inf
        self._pulse_us = FAILSAFE_US
        self._due = dict.fromkeys(_MESSAGES, up_at)
        self._recent = b''
        self._out: list[bytes] = []
        self._parser.reset()

    # -- the link --------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of the host."""
        self._now = now
        if now < self._up_at:
            return
        if self._menu is None:
            data = self._listen(data, now)
        for byte in data:
            self._press(chr(byte).upper())

    def _listen(self, data: bytes, now: float) -> bytes:
        """Take frames and the entry string; return the keys that follow it."""
        self._watch(now)
        self._recent += data
        before, entry, keys = self._recent.partition(ENTRY)
        if not entry or not self.config_available:
            self._recent = before[1 - len(ENTRY) :]
            for kind, payload in self._parser.feed(data, now):
                self._take(kind, payload)
            self._watch(now)
            return b''
        self._recent = b''
        self._menu = Menus(self.memory, self.terminal).main()
        self._say(next(self._menu))
        return keys

    def _press(self, key: str) -> None:
        """Hand a key to the menus; leaving them restarts the unit (3)."""
        if self._menu is None:
            return
        try:
            self._say(self._menu.send(key))
        except StopIteration:
            self.reboot()

    def _say(self, text: str) -> None:
        if text:
            self._out.append(text.encode('ascii', 'replace'))

    def poll(self, now: float) -> list[bytes]:
        """Return the bytes that are due."""
        self._now = now
        if now < self._up_at:
            return []
        for kind, payload in self._parser.poll(now):
            self._take(kind, payload)
        self._watch(now)
        frames, self._out = self._out, []
        if self.operates and self.settings.primary == 1:
            frames += [self._build(kind, now) for kind in _MESSAGES if self._is_due(kind, now)]
        return [] if self.mute else frames

    def _is_due(self, kind: int, now: float) -> bool:
        rate = self.settings.rates[_MESSAGES.index(kind)]
        if not rate or now < self._due[kind]:
            return False
        on_time = self._due[kind] + 1 / rate > now
        self._due[kind] = (self._due[kind] if on_time else now) + 1 / rate
        return True

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if self._now < self._up_at:
            return self._up_at
        rates = zip(_MESSAGES, self.settings.rates, strict=True)
        due = [self._due[kind] for kind, rate in rates if rate and self.operates]
        if self.alone and self._now < self._commanded_at + ALONE_TIME:
            due.append(self._commanded_at + ALONE_TIME)
        return min([*due, self._parser.deadline, *([self._now] if self._out else []), math.inf])

    # -- what the host says ----------------------------------------------------------------------

    def _take(self, kind: int, payload: bytes) -> None:
        if self.settings.primary != 1 or not self.operates:
            return
        self.received[kind] = self.received.get(kind, 0) + 1
        lockouts = dict(zip((98, 20), self.settings.lockouts, strict=True))
        try:
            if kind == 20:
                self._command(payload)
            elif kind == 21:
                self._set_aux(payload)
            elif kind in (*_MESSAGES, 15) and not payload:
                self._out.append(self._build(kind, self._now))
            elif kind != 98 or payload:
                self.rejected += 1
        except (ValueError, struct.error):
            self.rejected += 1
        self._locked = self._locked or lockouts.get(kind, False)

    def _command(self, payload: bytes) -> None:
        """Take a serial command for every output (4.2.2.1)."""
        pulses = list(struct.unpack(f'>{self.settings.outputs}H', payload))
        if max(pulses) > 32000:
            raise ValueError('beyond 32000 us')
        self._commanded_at = self._now
        kept = self.serial if self.keeps else pulses
        self.serial = [us or last for us, last in zip(pulses, kept, strict=True)]

    def _set_aux(self, payload: bytes) -> None:
        """Take levels, pulse times and periods (4.2.2.2)."""
        levels, assigned = payload[:2]
        chosen = [n for n in range(6) if assigned >> n & 1]
        counts = struct.unpack(f'>{len(chosen)}H', payload[2:])
        for number, aux in enumerate(self.aux):
            if levels & 0x80:
                aux.out_level = bool(levels >> number & 1)
        for number, count in zip(chosen, counts, strict=True):
            self.aux[number].set_counts(count & 0x7FFF, period=bool(assigned & 0x80))

    # -- the switch ------------------------------------------------------------------------------

    @property
    def operates(self) -> bool:
        """It drives servos: up, not in its menus, with a valid configuration (3, 3.1)."""
        return self._now >= self._up_at and self._menu is None and self.memory.valid

    @property
    def config_available(self) -> bool:
        """The menus can be entered (3, 3.6); for as long as it takes where nothing is stored."""
        early = self._now < self._up_at + CONFIG_TIME
        return not self._locked and (early or not self.memory.valid)

    @property
    def inputs(self) -> list[int | None]:
        """What the receiver gives, in us; None: no pulse."""
        pulses = self.channels[: self.settings.inputs]
        if not self.receiver:
            return [None] * len(pulses)
        return pulses if self.link else [FAILSAFE_US, *pulses[1:]]

    @property
    def command_state(self) -> int:
        """State of the command channel: 0 no signal, 1, 2 and 3 for 1, 1.5 and 2 ms (2)."""
        if self._now - self._signal_at >= NO_SIGNAL_TIME:
            return 0
        return 1 if self._pulse_us < 1250 else 2 if self._pulse_us < 1750 else 3

    @property
    def sources(self) -> list[int]:
        """The source byte of every output (4.2.1.2)."""
        return [row[self.command_state] for row in self.settings.table[: self.settings.outputs]]

    def _watch(self, now: float) -> None:
        """Follow the command channel, and drive the servos."""
        pulse = self.inputs[0]
        if pulse is not None:
            self._signal_at, self._pulse_us = now, pulse
        if not self.operates:
            self.outputs = [None] * self.settings.outputs
            return
        for output, byte in enumerate(self.sources):
            self.outputs[output] = self._pulse(output, byte)

    def _pulse(self, output: int, byte: int) -> int | None:
        source, pin = byte & 0x0F, byte >> 4
        if source in (0, 1):
            pulse = self.inputs[pin] if pin < self.settings.inputs else None
            return pulse if source == 0 or pulse is None else 3000 - pulse
        if source == 2:
            return self.settings.constants[output]
        if source == 3 and self._now >= self._commanded_at + ALONE_TIME:
            return self.alone.get(output, self.serial[output])
        return self.serial[output] if source == 3 else self.outputs[output]

    # -- what the SSC says -----------------------------------------------------------------------

    def _build(self, kind: int, now: float) -> bytes:
        return build_frame(kind, self._payload(kind, now))

    def _payload(self, kind: int, now: float) -> bytes:
        if kind == 10:
            return struct.pack('>H', self.command_state << 1 | self.config_available)
        if kind == 11:
            return bytes(self.sources)
        if kind in (12, 13):
            pulses = self.outputs if kind == 12 else self.inputs
            words = (_INVALID if pulse is None else pulse for pulse in pulses)
            return struct.pack(f'>{len(pulses)}H', *words)
        if kind == 14:
            return self._aux_inputs(now)
        settings = self.settings
        return struct.pack('>BB6H', settings.config_id, settings.inputs, *settings.aux)

    def _aux_inputs(self, now: float) -> bytes:
        levels = sum(aux.pin << place for place, aux in enumerate(self.aux))
        assigned = sum(aux.measures << place for place, aux in enumerate(self.aux))
        words = [aux.word(now) for aux in self.aux if aux.measures]
        return struct.pack(f'>BB{len(words)}H', levels, assigned, *words)

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'channel 2 1800'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)
        self._watch(self._now)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        menus = self._menu is not None
        return {
            'mode': 'menus' if menus else 'operation' if self.operates else 'not operating',
            'config_available': self.config_available,
            'config_id': self.settings.config_id,
            'command_state': _STATES[self.command_state],
            'receiver': self.receiver,
            'link': self.link,
            'inputs_us': list(self.inputs),
            'outputs_us': list(self.outputs),
            'serial_us': list(self.serial),
            'sources': [_source_text(byte) for byte in self.sources],
            'aux': [aux.describe() for aux in self.aux],
            'stored': 'valid' if self.memory.valid else 'invalid',
            'received': dict(self.received),
            'rejected': self.rejected,
            'mute': self.mute,
        }

    def reboot(self) -> None:
        """Switch off and on: silent for BOOT_TIME; unsaved settings are lost."""
        self._boot(self._now + BOOT_TIME)

    def _set_channel(self, number: str, pulse: str) -> None:
        place = int(within(number, 1, 16)) - 1
        self.channels[place] = None if pulse == 'off' else int(within(pulse, 0, 32767))

    def _set_alone(self, number: str, pulse: str) -> None:
        """Have an output go there by itself 1 s after the last serial command."""
        place = int(within(number, 1, self.settings.outputs)) - 1
        self.alone.pop(place, None)
        if pulse != 'stays':
            self.alone[place] = int(within(pulse, 0, 32000))

    def _set_pin(self, number: str, value: str) -> None:
        self._aux(number).level = switch(value)

    def _set_signal(self, number: str, high: str, low: str) -> None:
        aux = self._aux(number)
        aux.count(self._now)
        aux.high_us, aux.low_us = int(within(high, 0, 1e7)), int(within(low, 0, 1e7))

    def _add_pulses(self, number: str, count: str) -> None:
        self._aux(number).add(int(within(count, 0, 1e6)))

    def _set_memory(self, state: str) -> None:
        one_of({'erased': 0, 'worn': 0, 'sound': 0}, state)
        if state == 'erased':
            self.memory.erase()
        else:
            self.memory.worn = state == 'worn'

    def _aux(self, number: str) -> Auxiliary:
        return self.aux[int(within(number, 1, 6)) - 1]

    # Words: usage, and what obeys.
    commands: dict[str, tuple[str, Callable[..., None]]] = {
        'channel': ('1..16 US|off', _set_channel),
        'receiver': ('on|off', setter('receiver', switch)),
        'link': ('on|off', setter('link', switch)),
        'pin': ('AUX on|off', _set_pin),
        'signal': ('AUX HIGH_US LOW_US', _set_signal),
        'pulses': ('AUX COUNT', _add_pulses),
        'mute': ('on|off', setter('mute', switch)),
        'keep': ('on|off', setter('keeps', switch)),
        'alone': ('OUTPUT US|stays', _set_alone),
        'memory': ('erased|worn|sound', _set_memory),
        'reboot': ('', reboot),
    }
