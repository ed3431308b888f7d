# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

import math
from typing import Any

from bridge_core.session import (
    HeldButtons,
    Level,
    Pacer,
    Session as BaseSession,
    StickStream,
    Verdict,
)
from bridge_core.watchdog import Watchdog
from vm110_bridge.parameters import MAX_OUTPUT
from vm110_bridge.protocol import (
    AcknowledgeOutput,
    build_frame,
    burst,
    BuState,
    CommandInput,
    Crc,
    Disabled,
    Input,
    MAX_POSITION,
    Message,
    Packet,
    PacketDecoder,
    PeriodicInput,
    RELAYS_CLOSED,
    RuState,
)
from vm110_bridge.session import report
from vm110_bridge.session.encoder import Encoder
from vm110_bridge.session.events import (
    ArmedChanged,
    Command,
    DeviceState,
    EncoderTurned,
    Event,
    Remote,
    RemoteState,
    Sticks,
)
from vm110_bridge.session.inbox import CommandInbox
from vm110_bridge.session.outbox import CommandOutbox
from vm110_bridge.session.sender import Sender
from vm110_bridge.session.serials import Arrival, SerialNumbers
from vm110_bridge.session.settings import Settings
from vm110_bridge.session.stops import StopJudge

_NEUTRAL = Sticks()
_MANY = 8  # other base units that are remembered
_PUSHED = 1  # bit of a push button with an LED (4.1.5)
_MEMORY = 5.0  # seconds for which what was heard last counts as being there


class Session(BaseSession[bytes, Packet, Event]):
    """
    One base unit on one multicast group; see bridge_core.session.

    ``receive`` takes one datagram, and each frame to send is one.
    """

    CLOSED = 'check the network interface and interface_address: the port is not open'
    DAMAGED = 'look for what else sends to this group and port'

    def __init__(self, settings: Settings) -> None:
        decoder = PacketDecoder(None if settings.crc == 'auto' else Crc(settings.crc))
        super().__init__(decoder, settings.link_timeout)
        self.settings = settings
        self.armed = False
        self.enabled = False
        self.vrpi: PeriodicInput | None = None  # the newest, while the link is up
        self.bu_id = settings.bu_id  # 0 until a base unit was heard
        self.hold_output_in_use = False
        self.hold_asked = False  # VRPO are to be withheld
        self.looped_back = 0  # packets that only a machine controller sends
        self.foreign = 0  # packets of other base units
        self.dropped_commands = 0  # of the RU's application, while the link was down
        self.sender = Sender(whole=settings.sender_ports == 'one')
        self.serials = SerialNumbers()
        self.inbox = CommandInbox(explicit=settings.acknowledge == 'explicit')
        self.outbox = CommandOutbox(settings.command_timeout)
        self._packets = decoder
        self._hold_output = False
        self._hold_heard = Watchdog(settings.hold_output_timeout)
        self._others: dict[int, float] = {}  # when another base unit was heard last
        self._stops = StopJudge()
        self._pacer = Pacer(settings.output_period)
        self._output = bytes(settings.periodic_output_size)
        self._serial = 0
        self._acknowledgements: list[int] = []  # to be sent with the next poll
        self._unheard_at = -math.inf  # a command found no listener
        self._looped_back_at = -math.inf
        self._stream = StickStream()
        # The VRPI that says why switches are zero may be the first one that is lost.
        self._held = HeldButtons(2.0 * settings.link_timeout)
        self._has_news = False  # a VRPI was taken in that is not published yet
        self._stick_ru = 0  # whose sticks were published last
        self._remote: Remote | None = None
        self._told: Any = None  # what the last DeviceState is of
        self._encoder = Encoder()

    # What is known.

    @property
    def crc(self) -> Crc | None:
        """The reading of the CRC; None: not known yet."""
        return self._packets.crc

    @property
    def faulty(self) -> tuple[str, ...]:
        """Joysticks that cannot be where the newest VRPI says they are."""
        return self.vrpi.faulty if self.vrpi is not None and self.enabled else ()

    @property
    def output_held(self) -> bool:
        """
        Whether VRPO are withheld.

        Not while the BU holds its relays open by itself: there is nothing to add, and without VRPO
        it could perhaps not be rearmed. Two devices that are both stopped, each waiting for the
        other one's release, would wait for ever.
        """
        open_by_itself = self.vrpi is not None and self.vrpi.bu_state < RELAYS_CLOSED
        return self.hold_asked and not (open_by_itself and self.own_estop)

    def other_base_units(self, now: float) -> list[int]:
        """Return the IDs of other base units that were heard lately."""
        return [origin for origin, at in self._others.items() if now - at < _MEMORY]

    def problems(self, now: float) -> list[tuple[Level, str]]:
        """Return stops, broken joysticks as errors, and warnings."""
        problems = super().problems(now)
        warnings = [] if self.vrpi is None else report.warnings(self.vrpi)
        problems += [(Level.ERROR, text) for text in report.faults(self.faulty)]
        if self.link_up:
            warnings += report.others(self.other_base_units(now), self.bu_id)
            if self._stops.is_disobeyed:
                problems.append((Level.ERROR, report.DEAF))
            elif self.hold_asked:
                silent = '' if self._hold_output else self._hold_heard.describe(now)
                warnings.append(report.hold(withheld=self.output_held, silent=silent))
        if now - self._unheard_at < _MEMORY:
            warnings.append(report.UNHEARD)
        if now - self._looped_back_at < _MEMORY:
            warnings.append(report.LOOPED_BACK)
        return problems + [(Level.WARN, text) for text in warnings]

    def summary(self) -> str:
        """Return whether a remote is armed, and its state."""
        return report.summary(self.vrpi)

    def values(self, now: float) -> dict[str, Any]:
        """Return states, links, remote and packets in the manual's words."""
        del now
        return {
            'base unit (bu_id)': self.bu_id or 'not heard yet',
            'address of the base unit': self.sender.address or 'not known',
            'CRC': self.crc.value if self.crc else 'not known yet',
            'hold output in use': self.hold_output_in_use,
            'VRPO withheld': self.output_held,
            **(report.vrpi_values(self.vrpi) if self.vrpi is not None else {}),
            **self.packets,
        }

    @property
    def packets(self) -> dict[str, int]:
        """What the counters of the link do not tell, by name."""
        return {
            'packets lost': self.serials.lost,
            'packets repeated': self.serials.repeated,
            'packets reordered': self.serials.reordered,
            'restarts of the base unit': self.serials.restarts,
            'packets of other base units': self.foreign,
            'packets of second senders': self.sender.doubles,
            'changes of its address': self.sender.moves,
            'packets with the other CRC': self._packets.other_crc,
            'packets before the CRC was known': self._packets.before_lock,
            'packets of machine controllers': self.looped_back,
            'commands delivered': self.inbox.delivered,
            'commands repeated': self.inbox.repeats,
            'commands refused (unarmed remote)': self.inbox.refused,
            'commands without a listener': self.inbox.unheard,
            'commands dropped (link down)': self.dropped_commands,
            'commands not acknowledged yet': self.inbox.waiting,
            'commands to the remote under way': self.outbox.size,
            'stray acknowledgements': self.outbox.stray_acknowledgements,
        }

    # The link's side; the base has the rest. There is no farewell: without VRPO the base unit
    # opens its relays by itself (5.1.2).

    def _begin(self, now: float) -> None:
        self._stops = StopJudge(now)
        self._follow_hold(now)
        self._pacer.start(now)

    def _forget(self, now: float, reason: str) -> None:
        del now, reason
        self._others.clear()
        self._acknowledgements.clear()
        self.serials.forgive_gap()

    def _take(self, message: Packet, now: float) -> None:
        if not isinstance(message.message, Input):
            self.looped_back += 1
            self._looped_back_at = now
        elif self._is_ours(message, now):
            self._take_input(message.message, self._arrival(message, now), now)

    def _is_ours(self, packet: Packet, now: float) -> bool:
        """Tell whether our base unit sent it; the first VRPI decides which that is."""
        if self.bu_id == 0 and isinstance(packet.message, PeriodicInput):
            self.bu_id = packet.origin
        if packet.origin != self.bu_id:
            self.foreign += 1
            if self.bu_id:
                self._remember(packet.origin, now)
            return False
        if not self._is_of_sender(packet, now):
            return False
        if self.crc is None:
            self._packets.lock(packet.crc)
        return True

    def _is_of_sender(self, packet: Packet, now: float) -> bool:
        moves, periodic = self.sender.moves, isinstance(packet.message, PeriodicInput)
        ours = self.sender.takes(packet.source, now, silent=not self.link_up, periodic=periodic)
        if self.sender.moves > moves:
            self.serials.begin()
            self.inbox.doubt()
        return ours

    def _remember(self, origin: int, now: float) -> None:
        self._others = {each: self._others[each] for each in self.other_base_units(now)}
        if len(self._others) < _MANY or origin in self._others:
            self._others[origin] = now

    def _arrival(self, packet: Packet, now: float) -> Arrival:
        lines = self.serials.lines
        arrival = self.serials.hear(
            packet.serial, now, silent=not self.link_up, content=packet.message
        )
        if self.serials.lines > lines:
            self.inbox.restart()
        return arrival

    def _take_input(self, message: Input, arrival: Arrival, now: float) -> None:
        if arrival is Arrival.COPY:
            return
        if isinstance(message, PeriodicInput):
            self._take_periodic(message, arrival, now)
        elif arrival is Arrival.OLD:
            return
        elif isinstance(message, CommandInput):
            if arrival is Arrival.NEW:  # a late one is of an unknown moment; its repeats are not
                self._take_command(message, now)
        else:
            for result in self.outbox.acknowledged(message.command_id, now):
                self._emit(result)

    def _take_periodic(self, vrpi: PeriodicInput, arrival: Arrival, now: float) -> None:
        if arrival is not Arrival.NEW:
            # Not how things are now, and not a sign of life; but a stop in it must not be missed.
            self._stops.take_late(vrpi)
            return
        self._stops.take(vrpi, now)
        self._heard.feed(now)
        self.vrpi, self._has_news = vrpi, True

    def _take_command(self, command: CommandInput, now: float) -> None:
        if not self.link_up or self._is_interrupted(now) or self.sender.is_doubled(now):
            # Whether it is allowed is not known, so its repeats are to be judged anew.
            self.dropped_commands += 1
            return
        allowed = self.armed or self.settings.accept_unarmed_commands
        deliver, acknowledge = self.inbox.take(command, now, allowed=allowed)
        if deliver:
            self._emit(Command(command.command_id, command.data))
        if acknowledge:
            self._acknowledgements.append(command.command_id)

    def _judge(self, now: float) -> Verdict:
        verdict = self._stops.verdict()
        if self.sender.is_doubled(now):
            return Verdict.stop(self._two_senders, *verdict.reasons)
        return verdict

    def _silence(self, now: float) -> str:
        return f'{self._silence_hint(now)}; no VRPI from the BU: {self._heard.describe(now)}'

    @property
    def _two_senders(self) -> str:
        address = self.sender.address or ''
        return report.two_senders(self.bu_id, address, self.sender.second)

    def _silence_hint(self, now: float) -> str:
        if self.sender.is_doubled(now):
            return self._two_senders
        others = self.other_base_units(now)
        if others:
            return report.only_others(others, self.bu_id, chosen=self.settings.bu_id != 0)
        if self.serials.restarting(now):
            return report.RESTARTING
        if now - self._packets.other_crc_at < _MEMORY:
            return report.other_crc(chosen=self.settings.crc != 'auto')
        if now - self._packets.other_layout_at < _MEMORY:
            return report.OTHER_LAYOUT
        if now - self._packets.no_origin_at < _MEMORY:
            return report.NO_ORIGIN
        if now - self._packets.bad_crc_at < _MEMORY:
            return report.WRONG_CRC
        return report.NO_CAUSE

    def _follow(self, now: float) -> None:
        if not self.link_up:
            self.vrpi, self._has_news = None, False
        self._follow_armed()
        if self.estop:
            self._held.miss(now, stopped=True)
        if self._stream.owes_neutral(fresh=self.link_up, counts=self.enabled):
            self._emit(_NEUTRAL)
        self._follow_remote()
        self._follow_device(now)
        if not self.link_up:
            self._encoder.rest()
            for result in self.outbox.drop(
                'the link was lost' if self._open else 'the port was closed'
            ):
                self._emit(result)
        if self._has_news:
            self._publish_controls(now)
        for result in self.outbox.expire(now):
            self._emit(result)
        self._follow_hold(now)

    def _follow_armed(self) -> None:
        armed = not self.estop and _is_armed(self.vrpi)
        enabled = armed and _is_enabled(self.vrpi)
        if (armed, enabled) != (self.armed, self.enabled):
            self.armed, self.enabled = armed, enabled
            self._emit(ArmedChanged(armed, enabled))

    def _follow_remote(self) -> None:
        vrpi = self.vrpi
        remote = None
        if vrpi is not None and vrpi.armed_ru:
            remote = Remote(vrpi.armed_ru, vrpi.ru_battery, vrpi.ru_docked)
        if remote != self._remote:
            self._remote = remote
            self._emit(RemoteState(remote))

    def _follow_device(self, now: float) -> None:
        values = report.device_values(self.vrpi)
        told = (self.verdict, self.sender.is_doubled(now), values)
        if told == self._told:
            return
        self._told = told
        level = Level.WARN if self.link_up else Level.ERROR
        problems = [(level, reason) for reason in self.verdict.reasons]
        if self.vrpi is not None:
            problems += [(Level.WARN, text) for text in report.warnings(self.vrpi)]
        self._emit(DeviceState(tuple(problems), report.summary(self.vrpi), values))

    def _publish_controls(self, now: float) -> None:
        """Publish encoder and sticks of a new VRPI, as far as the verdict on it allows."""
        assert self.vrpi is not None
        self._has_news = False
        if self._encoder.take(self.vrpi.encoder, self.vrpi.armed_ru if self.enabled else 0):
            self._emit(EncoderTurned(self._encoder.position))
        sticks = self._sticks_of(self.vrpi, now)
        self._stream.published(counts=sticks.enabled)
        self._emit(sticks)

    def _follow_hold(self, now: float) -> None:
        """Once a hold was asked for at all, silence asks for it too."""
        stale = self._hold_heard.expired(now)
        self.hold_asked = self.hold_output_in_use and (self._hold_output or stale)
        self._stops.hold(self.output_held, now)

    def _expires_at(self) -> float:
        moments = [super()._expires_at(), self.outbox.expires_at]
        if not self.hold_asked:
            moments.append(self._hold_heard.deadline)
        if self.sender.is_doubled(self._stepped_at):
            moments.append(self.sender.doubled_until)
        return min(moments)

    def _sends_at(self) -> float:
        return min(self._pacer.due, self.outbox.sends_at)

    def _due_frames(self, now: float) -> list[bytes]:
        messages: list[Message] = [AcknowledgeOutput(each) for each in self._acknowledgements]
        self._acknowledgements.clear()
        messages += [*self._due_output(now), *self.outbox.due(now)]
        return [self._frame(message) for message in messages]

    def _due_output(self, now: float) -> list[Message]:
        """Return the burst of VRPO when it is due, unless it is withheld."""
        if not self._pacer.is_due(now):
            return []
        self._pacer.sent(now)
        if self.output_held or self.crc is None:
            return []
        self._stops.output_sent(now)
        return [*burst(self._output, self.settings.first_packet_number)]

    # What the node asks.

    def expect_hold(self) -> None:
        """Withhold VRPO from the first on, until the node says not to: not after the opening."""
        self.hold_output_in_use = True

    def set_hold_output(self, value: bool, now: float) -> None:
        """Withhold VRPO, or not; from the first call on, silence withholds them too."""
        self._expire(now)
        self.hold_output_in_use = True
        self._hold_output = value
        self._hold_heard.feed(now)
        self._refresh(now)

    def forget_hold_output(self, now: float) -> None:
        """Be as before the first call of ``set_hold_output``."""
        self._expire(now)
        self.hold_output_in_use = self._hold_output = False
        self._hold_heard.reset()
        self._refresh(now)

    def set_periodic_output(self, data: bytes, now: float) -> None:
        """
        Set what VRPO carry from now on.

        :raises ValueError: not as many bytes as periodic_output_size, or more than may be.
        """
        self._expire(now)
        size = self.settings.periodic_output_size
        if size and len(data) != size:
            raise ValueError(f'periodic_output_size is {size} bytes, not {len(data)}')
        if len(data) > MAX_OUTPUT:
            raise ValueError(f'{len(data)} bytes; {MAX_OUTPUT} are the most')
        self._output = data

    def send_command(self, data: bytes, now: float) -> int:
        """
        Queue a command for the RU's application; return its ID. A CommandResult will follow.

        :raises ValueError: not 16 bytes, too many wait, or no BU is there to take it.
        """
        self._expire(now)
        if not self.link_up:
            raise ValueError('no base unit is heard, so nobody would take the command')
        return self.outbox.add(data, now)

    def command_published(self, command: Command, heard: bool, now: float) -> None:
        """
        Acknowledge a command that was published, unless that waits for ``command_done``.

        :param heard: somebody subscribes, or need not; else each repeat is another try.
        """
        self._expire(now)
        if self.inbox.published(command, heard=heard):
            self._acknowledge(command.command_id)
        if not heard:
            self._unheard_at = now

    def command_done(self, command_id: int, now: float) -> None:
        """
        Acknowledge a command that was carried out.

        :raises ValueError: no such command was delivered lately.
        """
        self._expire(now)
        self.inbox.done(command_id, now)
        self._acknowledge(command_id)

    def _acknowledge(self, command_id: int) -> None:
        if self._open and self.crc is not None:  # else its repeats are acknowledged
            self._acknowledgements.append(command_id)

    # What VRPI mean.

    def _sticks_of(self, vrpi: PeriodicInput, now: float) -> Sticks:
        # Another remote's sticks do not go on where those of the one before left off.
        is_known, self._stick_ru = vrpi.armed_ru == self._stick_ru, vrpi.armed_ru
        buttons = (*self._switches_of(vrpi), int(vrpi.encoder_switch))
        if not self.enabled or not is_known:
            # What is held as a remote is found enabled straight after a stop is not hidden: it
            # prevents the mux's reset.
            seen = () if self.enabled and self._held.after_stop else buttons
            self._held.miss(now, stopped=self.estop, buttons=seen)
            return _NEUTRAL
        if vrpi.faulty and not self.settings.tolerate_faulty_axes:
            self._held.miss(now, stopped=False, buttons=buttons)
            return Sticks(enabled=True, faulty=vrpi.faulty)
        return Sticks(
            axes=tuple(value if abs(value) <= MAX_POSITION else 0 for value in vrpi.joysticks),
            buttons=self._held.of(buttons, now),
            enabled=True,
            faulty=vrpi.faulty,
        )

    def _switches_of(self, vrpi: PeriodicInput) -> list[int]:
        """Return the values of the switches; the LED of one that has one is no press (4.1.5)."""
        leds = self.settings.led_switches
        return [
            value & _PUSHED if number in leds else value
            for number, value in enumerate(vrpi.switches, 1)
        ]

    # Packets.

    def _frame(self, message: Message) -> bytes:
        assert self.crc is not None  # or nobody was heard that it could be for
        frame = build_frame(message, self._serial, self.crc)
        self._serial = (self._serial + 1) & 0xFFFF
        return frame


def _is_armed(vrpi: PeriodicInput | None) -> bool:
    """Tell whether an RU is armed and not stopped (4.1.1, 4.1.3)."""
    return (
        vrpi is not None
        and vrpi.bu_state == BuState.ARMED
        and vrpi.armed_ru != 0
        and vrpi.ru_state in (RuState.ARMED, RuState.ENABLED)
    )


def _is_enabled(vrpi: PeriodicInput | None) -> bool:
    """Tell whether the armed RU's movements are allowed; by both fields that say so."""
    return (
        vrpi is not None
        and vrpi.ru_state == RuState.ENABLED
        and vrpi.ru_disabled == Disabled.ENABLED
    )
