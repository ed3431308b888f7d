# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the link: a base unit and its remotes, without a port or a clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
import struct
from typing import Any

from bridge_core.simulation import obey, one_of, setter, switch, whole, within
from vm110_bridge.protocol import BuState, LinkStatus
from vm110_bridge.simulator.packets import build_packet, crc32
from vm110_bridge.simulator.remote import Remote

VRPI_PERIOD = 0.125  # 5.1.1
OUTPUT_TIMEOUT = 2.0  # 5.1.2
RESEND_PERIOD = 0.1  # 5.1.3
COMMAND_TIMEOUT = 2.0  # 5.1.3
BOOT_TIME = 1.0
LATEST = 2.0  # s that what is due may wait for this computer
RADIO_TIMEOUT = 0.3  # silence of the armed remote until the BU is blocked
# How long the RU's application takes for a command or a display (5.3: C-Link is slower).
_ANSWER_TIME = {True: 0.02, False: 0.6}
_DISPLAY_PERIOD = {True: 0.0, False: 1.0}
# What becomes of a base unit that loses its remote; None: it falls silent.
LOST: dict[str, BuState | None] = {
    **{state.name.lower(): state for state in BuState if state <= BuState.DISARMED},
    'silent': None,
}


@dataclass(slots=True)
class _Command:
    """A VRCI on its way."""

    command_id: int
    data: bytes
    resend_at: float
    give_up_at: float


class Simulator:
    """
    A base unit with three remotes, none of them armed.

    :param bu_id: origin of its packets. :param crc: 'mpeg2' or 'iso_hdlc'.
    :param output_size: bytes of periodic data that it is configured for; None: any.
    """

    def __init__(
        self, bu_id: int = 7, *, crc: str = 'mpeg2', output_size: int | None = None
    ) -> None:
        self.bu_id = bu_id
        self.crc = crc
        self.output_size = output_size
        self.remotes = {str(n): Remote(0x1000 + n) for n in (1, 2, 3)}
        self.vlaps = 1
        self.g_link = True  # False: C-Link carries all, more slowly (5.3)
        self.ec_link = int(LinkStatus.UNUSED)
        self.lost: BuState | None = BuState.BLOCKED
        self.output_timeout = OUTPUT_TIMEOUT
        self.answers = True  # the RU's application acknowledges VRCO
        self.failed = False
        self.lose = self.double = 0  # packets to come
        self.swap = False  # the next two packets change places
        self.received: dict[str, int] = {}  # packets of the machine controller, by ID
        self.rejected = 0
        self.machine_lost = 0  # gaps in the machine controller's serial numbers
        self.machine_commands: deque[tuple[float, int, bytes]] = deque(
            maxlen=100
        )  # VRCO, each once
        self.acknowledged: list[int] = []  # VRCI that were acknowledged
        self.failed_commands: list[int] = []  # VRCI that were not, within 2 s
        self.display = b''
        self.displays = 0
        self._display_at = -math.inf
        self._held_back: bytes | None = None
        self._now = 0.0
        self._boot(0.0)

    def _boot(self, up_at: float) -> None:
        """Forget all but what a base unit has on its nameplate."""
        self.armed: Remote | None = None
        self.fault: BuState | None = None  # a latched one: until armed anew
        self._is_silent = False  # likewise, as it has lost its remote
        self._serial = 0
        self._machine_serial: int | None = None
        self._command_id = 0
        self._under_way: list[_Command] = []
        self._known: dict[int, bytes] = {}  # VRCO that were processed
        self._answers_due: list[tuple[float, int]] = []
        self._output_heard: float | None = None  # None: counts from the first poll on
        self._radio_heard = 0.0
        self._burst: dict[int, bytes] = {}
        self._vrpi_due = self._up_at = up_at

    # -- the link --------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> None:
        """Take one datagram of the machine controller."""
        self._now = now
        if now < self._up_at:
            return
        kind, payload = self._check(data)
        if kind == 'VRPO':
            self._take_output(payload, now)
        elif kind == 'VRAO':
            self._take_acknowledgement(*struct.unpack('<H', payload))
        elif kind == 'VRCO':
            self._take_command(struct.unpack_from('<H', payload)[0], payload[6:], now)
        self._watch(now)

    def _check(self, data: bytes) -> tuple[str, bytes]:
        """Return ID and payload; an empty ID for what a base unit ignores (5.1.5)."""
        sizes = {b'VRPO': range(2, 491), b'VRCO': range(22, 23), b'VRAO': range(2, 3)}
        if not 20 <= len(data) <= 512 or data[:4] not in sizes:
            self.rejected += 1
            return '', b''
        revision, origin, serial, size = struct.unpack_from('<4H', data, 4)
        good = data[-4:] == struct.pack('<I', crc32(data[:-4], self.crc))
        sizes_fit = size == len(data) - 20 and size in sizes[data[:4]]
        if not good or revision or origin or not sizes_fit:
            self.rejected += 1
            return '', b''
        if self._machine_serial is not None:
            self.machine_lost += (serial - self._machine_serial - 1) & 0xFFFF
        self._machine_serial = serial
        kind = data[:4].decode()
        self.received[kind] = self.received.get(kind, 0) + 1
        return kind, data[16:-4]

    def poll(self, now: float) -> list[bytes]:
        """Return the datagrams that are due."""
        self._now = now
        if now < self._up_at:
            return []
        self._watch(now)
        packets = self._answer(now) + self._resend(now)
        if now >= self._vrpi_due:
            # Its clock goes on while this computer is busy: what waited is sent at once then.
            on_time = self._vrpi_due + LATEST > now
            self._vrpi_due = (self._vrpi_due if on_time else now) + VRPI_PERIOD
            packets.append(self._packet('VRPI', self._vrpi()))
        return [] if self._is_silent else self._spoil(packets)

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if self._now < self._up_at:
            return self._up_at
        resends = (min(c.resend_at, c.give_up_at) for c in self._under_way)
        return min([self._vrpi_due, *resends, *(due for due, _ in self._answers_due)])

    def _packet(self, kind: str, payload: bytes) -> bytes:
        packet = build_packet(kind, payload, self._serial, self.bu_id, self.crc)
        self._serial = (self._serial + 1) & 0xFFFF
        return packet

    def _spoil(self, packets: list[bytes]) -> list[bytes]:
        """Lose, double and swap what was asked for."""
        result: list[bytes] = []
        for packet in packets:
            if self.lose:
                self.lose -= 1
            elif self.swap and self._held_back is None:
                self._held_back = packet
            else:
                result.append(packet)
                if self._held_back is not None:
                    result.append(self._held_back)
                    self._held_back, self.swap = None, False
                if self.double:
                    self.double -= 1
                    result.append(packet)
        return result

    # -- what the machine controller says --------------------------------------------------------

    def _take_output(self, payload: bytes, now: float) -> None:
        """Put a burst together (4.2), and show it as often as the link to the remote allows."""
        self._output_heard = now
        (number,) = struct.unpack_from('<H', payload)
        if number == 0:
            self._burst = {}
        self._burst[number] = payload[2:]
        whole = b''.join(self._burst[n] for n in sorted(self._burst))
        complete = sorted(self._burst) == list(range(len(self._burst)))
        if not complete or (self.output_size is not None and len(whole) != self.output_size):
            return
        if now - self._display_at >= _DISPLAY_PERIOD[self.g_link]:
            self._display_at = now
            self.display = whole
            self.displays += 1

    def _take_acknowledgement(self, command_id: int) -> None:
        if any(command.command_id == command_id for command in self._under_way):
            self.acknowledged.append(command_id)
        self._under_way = [c for c in self._under_way if c.command_id != command_id]

    def _take_command(self, command_id: int, data: bytes, now: float) -> None:
        if not self.answers:
            return
        if self._known.get(command_id) != data:
            self._known[command_id] = data
            self.machine_commands.append((now, command_id, data))
        if command_id not in [number for _, number in self._answers_due]:
            self._answers_due.append((now + _ANSWER_TIME[self.g_link], command_id))

    def _answer(self, now: float) -> list[bytes]:
        due = [number for at, number in self._answers_due if now >= at]
        self._answers_due = [entry for entry in self._answers_due if now < entry[0]]
        return [self._packet('VRAI', struct.pack('<H', number)) for number in due]

    def _resend(self, now: float) -> list[bytes]:
        packets = []
        for command in list(self._under_way):
            if now >= command.give_up_at:
                self._under_way.remove(command)
                self.failed_commands.append(command.command_id)
            elif now >= command.resend_at:
                command.resend_at = now + RESEND_PERIOD
                payload = struct.pack('<H4x', command.command_id) + command.data
                packets.append(self._packet('VRCI', payload))
        return packets

    # -- states ----------------------------------------------------------------------------------

    @property
    def output_missing(self) -> bool:
        """No VRPO for 2 s (5.1.2)."""
        heard = self._output_heard
        return heard is not None and self._now - heard >= self.output_timeout

    @property
    def state(self) -> BuState:
        """Section 4.1.1."""
        if self.failed:
            return BuState.FAILED
        if self.fault is not None:
            return self.fault
        return BuState.DISARMED if self.armed is None else BuState.ARMED

    @property
    def relays_closed(self) -> bool:
        """The ES-Link relays (4.1.1)."""
        return self._now >= self._up_at and self.state >= 0x10

    @property
    def eg_link(self) -> LinkStatus:
        """Section 4.1.2."""
        return LinkStatus.NO_LINK if self.output_missing else LinkStatus.OPERATIONAL

    def _watch(self, now: float) -> None:
        """Latch what ends an armed state."""
        if self._output_heard is None:
            self._output_heard = now
        remote = self.armed
        if remote is None:
            return
        if remote.connected:
            self._radio_heard = now
        if self.fault is None and self.output_missing:
            self.fault = BuState.EXTERNAL_LINK_ERROR
        if self.fault is None and self.ec_link not in (0, 1):
            self.fault = BuState.EXTERNAL_LINK_ERROR
        remote.tripped = remote.tripped or remote.stopped
        if remote.tripped:
            self.fault = BuState.STOPPED
        elif now - self._radio_heard >= RADIO_TIMEOUT:
            self.fault = BuState.BLOCKED if self.lost is None else self.lost
            self._is_silent, self.armed = self.lost is None, None

    def _vrpi(self) -> bytes:
        heard = sum(remote.connected for remote in self.remotes.values())
        unarmed = heard - (self.armed is not None and self.armed.connected)
        c_link = LinkStatus.OPERATIONAL if self.armed else LinkStatus.PASSIVE
        links = (self.eg_link, self.ec_link, c_link)
        head = struct.pack('<6B', self.state, self.vlaps, unarmed, *links)
        if self.armed is None:
            return head + bytes(40)
        return head + struct.pack('<H', self.armed.ru_id) + self.armed.payload()

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'stick 1 2 0.8'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)
        self._watch(self._now)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        return {
            'bu_id': self.bu_id,
            'state': self.state.name.replace('_', ' ').capitalize(),
            'relays_closed': self.relays_closed,
            'armed': next((n for n, r in self.remotes.items() if r is self.armed), 'none'),
            'eg_link': self.eg_link.name.replace('_', ' ').capitalize(),
            'g_link': self.g_link,
            'remotes': {name: remote.describe() for name, remote in self.remotes.items()},
            'received': dict(self.received),
            'rejected': self.rejected,
            'machine_lost': self.machine_lost,
            'display': self.display.hex(' '),
            'displays': self.displays,
            'commands': [data.hex() for _, _, data in self.machine_commands],
            'acknowledged': list(self.acknowledged),
            'failed_commands': list(self.failed_commands),
        }

    def arm(self, name: str) -> None:
        """Arm a remote. :raises ValueError: what forbids it."""
        remote = self._remote(name)
        if self.failed or self._now < self._up_at:
            raise ValueError('the base unit is not operative')
        if remote.stopped or not remote.connected:
            raise ValueError('release its stop switch, and turn it on, first')
        if self.output_missing:
            raise ValueError('EG-Link gets no VRPO')
        if self.ec_link not in (0, 1):
            raise ValueError('EC-Link is in error')
        if self.armed not in (None, remote) and self.fault is None:
            raise ValueError('another remote is armed')
        self.armed, self.fault, self._is_silent = remote, None, False
        remote.tripped = False
        self._radio_heard = self._now

    def disarm(self) -> None:
        """Disarm the armed remote; a stop stays until one is armed again."""
        self.armed = None

    def reboot(self) -> None:
        """Switch off and on: silent for BOOT_TIME; numbers begin anew."""
        self.failed = False
        self._boot(self._now + BOOT_TIME)

    def _shock(self, name: str) -> None:
        self._remote(name).tripped = self._remote(name) is self.armed

    def _remote(self, name: str) -> Remote:
        return self.remotes[one_of(self.remotes, name)]

    def _set_stick(self, name: str, number: str, value: str) -> None:
        place = int(within(number, 1, 4)) - 1
        self._remote(name).joysticks[place] = round(1000 * within(value, -1.0, 1.0))

    def _set_switch(self, name: str, number: str, value: str) -> None:
        place = int(within(number, 1, 8)) - 1
        self._remote(name).switches[place] = int(within(value, -1, 1000))

    def _turn_encoder(self, name: str, steps: str) -> None:
        self._remote(name).encoder += int(within(steps, -1000, 1000))

    def _set_lost(self, state: str) -> None:
        """Be in this state once the armed remote is lost, or say nothing more."""
        self.lost = LOST[one_of(LOST, state)]

    def _set_timeout(self, seconds: str) -> None:
        """Wait so long for VRPO."""
        self.output_timeout = within(seconds, 0.1, 60.0)

    def _send_command(self, data: str) -> None:
        content = bytes.fromhex(data)
        if len(content) > 16:
            raise ValueError(f'{len(content)} bytes; 16 are the most')
        self._command_id = (self._command_id + 1) & 0xFFFF
        give_up_at = self._now + COMMAND_TIMEOUT
        self._under_way.append(
            _Command(self._command_id, content.ljust(16, b'\0'), self._now, give_up_at)
        )

    @staticmethod
    def _sets_remote(field: str, read: Callable[[str], Any]) -> Callable[..., None]:
        """Return what sets a field of a remote."""
        return lambda unit, name, text: setattr(unit._remote(name), field, read(text))

    # Words: usage, and what obeys.
    commands: dict[str, tuple[str, Callable[..., None]]] = {
        'arm': ('RU', arm),
        'disarm': ('', disarm),
        'stick': ('RU 1..4 -1..1', _set_stick),
        'switch': ('RU 1..8 -1..1000', _set_switch),
        'encoder': ('RU STEPS', _turn_encoder),
        'battery': ('RU 0..100', _sets_remote('battery', whole(0, 100))),
        'rssi': ('RU 0..100', _sets_remote('rssi', whole(0, 100))),
        'vlaps': ('0..3', setter('vlaps', whole(0, 3))),
        'lost': ('STATE', _set_lost),
        'timeout': ('SECONDS', _set_timeout),
        'glink': ('on|off', setter('g_link', switch)),
        'eclink': ('0..5', setter('ec_link', whole(0, 5))),
        'command': ('HEX', _send_command),
        'answers': ('on|off', setter('answers', switch)),
        'lose': ('PACKETS', setter('lose', whole(0, 1e6))),
        'double': ('PACKETS', setter('double', whole(0, 1e6))),
        'swap': ('', lambda unit: setattr(unit, 'swap', True)),
        'shock': ('RU', _shock),
        'fail': ('', lambda unit: setattr(unit, 'failed', True)),
        'reboot': ('', reboot),
        'stop': ('RU on|off', _sets_remote('stopped', switch)),
        'tilt': ('RU on|off', _sets_remote('tilted', switch)),
        'inactive': ('RU on|off', _sets_remote('inactive', switch)),
        'dock': ('RU on|off', _sets_remote('docked', switch)),
        'cable': ('RU on|off', _sets_remote('cable', switch)),
        'radio': ('RU on|off', _sets_remote('radio', switch)),
        'push': ('RU on|off', _sets_remote('encoder_switch', switch)),
    }
