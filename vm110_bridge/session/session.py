# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

import math
from typing import Any

from bridge_core.reasons import Coded, passed_on
from bridge_core.session import Level, Pacer, Session as BaseSession, Verdict
from bridge_core.watchdog import Watchdog
from vm110_bridge.parameters import MAX_OUTPUT
from vm110_bridge.protocol import (
    AcknowledgeOutput,
    build_frame,
    burst,
    CommandInput,
    CommandOutput,
    Crc,
    Input,
    Message,
    Packet,
    PacketDecoder,
    PeriodicInput,
    PeriodicOutput,
    RELAYS_CLOSED,
)
from vm110_bridge.session import report
from vm110_bridge.session.controls import Controls
from vm110_bridge.session.events import (
    ArmedChanged,
    Command,
    DeviceState,
    Event,
    Remote,
    RemoteState,
)
from vm110_bridge.session.inbox import CommandInbox
from vm110_bridge.session.lateness import Lateness
from vm110_bridge.session.origin import MEMORY, Origin
from vm110_bridge.session.outbox import CommandOutbox
from vm110_bridge.session.serials import Arrival, WINDOW
from vm110_bridge.session.settings import Settings
from vm110_bridge.session.stops import StopJudge


class Session(BaseSession[bytes, Packet, Event]):
    """
    One base unit on one multicast group; see bridge_core.session.

    ``receive`` takes one datagram, and each frame to send is one.
    """

    CLOSED = Coded(
        'vm110.port.closed',
        'check the network interface and interface_address: the port is not open',
    )
    DAMAGED = 'look for what else sends to this group and port'

    def __init__(self, settings: Settings) -> None:
        decoder = PacketDecoder(None if settings.crc == 'auto' else Crc(settings.crc))
        super().__init__(decoder, settings.link_timeout)
        self.settings = settings
        self.vrpi: PeriodicInput | None = None  # the newest, while the link is up
        self.hold_output_in_use = False
        self.hold_asked = False  # VRPO are to be withheld
        self.output_held = False  # and they are
        self.dropped_commands = 0  # of the RU's application, while the link was down
        self.origin = Origin(settings.bu_id, whole=settings.sender_ports == 'one')
        self.controls = Controls(settings)
        self.inbox = CommandInbox(explicit=settings.acknowledge == 'explicit')
        self.outbox = CommandOutbox(settings.command_timeout)
        self._packets = decoder
        self._lateness = Lateness(settings.line_age_limit or math.inf)
        self._hold_output = False
        self._hold_heard = Watchdog(settings.hold_output_timeout)
        self._stops = StopJudge()
        self._pacer = Pacer(settings.output_period)
        self._output = bytes(settings.periodic_output_size)
        self._serial = 0
        self._offered: dict[bytes, tuple[int, Message]] = {}  # by the last poll: serial, message
        self._acknowledgements: list[int] = []  # that are owed
        self._unheard_at = -math.inf  # a command found no listener
        self._has_news = False  # a VRPI was taken in that is not published yet
        self._remote: Remote | None = None
        self._told: Any = None  # what the last DeviceState is of

    # What is known.

    @property
    def crc(self) -> Crc | None:
        """The reading of the CRC; None: not known yet."""
        return self._packets.crc

    @property
    def armed(self) -> bool:
        """Whether a remote is armed and nothing is stopped."""
        return self.controls.armed

    @property
    def enabled(self) -> bool:
        """Whether the armed remote's movements are allowed."""
        return self.controls.enabled

    @property
    def faulty(self) -> tuple[str, ...]:
        """Joysticks that cannot be where the newest VRPI says they are."""
        return self.vrpi.faulty if self.vrpi is not None and self.enabled else ()

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return stops, broken joysticks as errors, and warnings."""
        problems = super().problems(now)
        warnings = [] if self.vrpi is None else report.warnings(self.vrpi)
        problems += [(Level.ERROR, text) for text in report.faults(self.faulty)]
        if self.link_up:
            lateness, heard = self._lateness, self._hold_heard
            if lateness.lag >= lateness.limit / 2 and not lateness.is_late:
                warnings.append(report.late(lateness))
            warnings += report.others(self.origin.others(now), self.origin.bu_id)
            if self._stops.is_disobeyed:
                problems.append((Level.ERROR, report.DEAF))
            elif self.hold_asked:
                silent = heard.describe(now) if heard.expired(now) else ''
                warnings.append(report.hold(withheld=self.output_held, silent=silent))
        if now - self._unheard_at < MEMORY:
            warnings.append(report.UNHEARD)
        if self.origin.is_looped_back(now):
            warnings.append(report.LOOPED_BACK)
        return problems + [(Level.WARN, text) for text in warnings]

    def summary(self) -> str:
        """Return whether a remote is armed, and its state."""
        return report.summary(self.vrpi)

    def values(self, now: float) -> dict[str, Any]:
        """Return states, links, remote and packets in the manual's words."""
        del now
        return {
            'base unit (bu_id)': self.origin.bu_id or 'not heard yet',
            'address of the base unit': self.origin.sender.address or 'not known',
            'CRC': self.crc.value if self.crc else 'not known yet',
            'hold output in use': self.hold_output_in_use,
            'VRPO withheld': self.output_held,
            'later than before (s)': self._lateness.lag,
            **report.vrpi_values(self.vrpi),
            **self.packets,
        }

    @property
    def packets(self) -> dict[str, int]:
        """What the counters of the link do not tell, by name."""
        serials, sender = self.origin.serials, self.origin.sender
        return {
            'packets lost': serials.lost,
            'packets repeated': serials.repeated,
            'packets reordered': serials.reordered,
            'restarts of the base unit': serials.restarts,
            'packets of other base units': self.origin.foreign,
            'packets of second senders': sender.doubles,
            'changes of its address': sender.moves,
            'packets with the other CRC': self._packets.other_crc,
            'packets before the CRC was known': self._packets.before_lock,
            'packets of machine controllers': self.origin.looped_back,
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
        self._acknowledgements.clear()
        self.origin.forget_others()

    def _take(self, message: Packet, now: float) -> None:
        moves, lines = self.origin.sender.moves, self.origin.serials.lines
        arrival = self.origin.place(message, now, silent=not self.link_up)
        if self.origin.sender.moves > moves:
            self.inbox.doubt()
        if self.origin.serials.lines > lines:
            self.inbox.restart()
        if (moves, lines) != (self.origin.sender.moves, self.origin.serials.lines):
            self._lateness.begin()
        if arrival is not None:
            if self.crc is None:
                self._packets.lock(message.crc)
            assert isinstance(message.message, Input)
            self._note_number(message, arrival, now)
            self._take_input(message.message, arrival, now)

    def _note_number(self, packet: Packet, arrival: Arrival, now: float) -> None:
        if not isinstance(packet.message, PeriodicInput):
            if arrival is Arrival.NEW:
                self._lateness.passed()
        elif arrival is Arrival.NEW:
            self._lateness.heard(packet.serial, now)
        elif packet.serial < WINDOW and arrival is Arrival.OLD and not self.link_up:
            # A base unit that was restarted: its numbers may go on by luck. Greater ones are more
            # likely copies that came a slower way, whose next packets are late.
            self._lateness.begin()

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
        if not self.link_up or self._is_interrupted(now) or self._is_unsure(now):
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
        reasons: list[Coded] = []
        if self.origin.sender.is_doubled(now):
            reasons.append(self._two_senders)
        if self._lateness.is_late:
            reasons.append(report.late(self._lateness))
        return Verdict.stop(*reasons, *verdict.reasons) if reasons else verdict

    def _is_unsure(self, now: float) -> bool:
        """Tell whether the newest VRPI need not be how things are: of another sender, or late."""
        return self.origin.sender.is_doubled(now) or self._lateness.is_late

    def _silence(self, now: float) -> Coded:
        hint = self._silence_hint(now)
        return passed_on(hint, f'{hint}; no VRPI from the BU: {self._heard.describe(now)}')

    @property
    def _two_senders(self) -> Coded:
        sender = self.origin.sender
        return report.two_senders(self.origin.bu_id, sender.address or '', sender.second)

    def _silence_hint(self, now: float) -> Coded:
        if self.origin.sender.is_doubled(now):
            return self._two_senders
        others = self.origin.others(now)
        if others:
            return report.only_others(others, self.origin.bu_id, chosen=self.settings.bu_id != 0)
        if self.origin.serials.restarting(now):
            return report.RESTARTING
        if now - self._packets.other_crc_at < MEMORY:
            return report.other_crc(chosen=self.settings.crc != 'auto')
        hints = (
            (self._packets.other_layout_at, report.OTHER_LAYOUT),
            (self._packets.no_origin_at, report.NO_ORIGIN),
            (self._packets.bad_crc_at, report.WRONG_CRC),
        )
        return next((hint for at, hint in hints if now - at < MEMORY), report.NO_CAUSE)

    def _follow(self, now: float) -> None:
        if not self.link_up:
            self.vrpi, self._has_news = None, False
        if self.controls.permit(self.vrpi, estop=self.estop):
            self._emit(ArmedChanged(self.armed, self.enabled))
        for sticks in self.controls.lapse(now, link_up=self.link_up, estop=self.estop):
            self._emit(sticks)
        self._follow_remote()
        self._follow_device()
        if self.link_up:
            ended = self.outbox.expire(now)
        else:
            ended = self.outbox.drop('the link was lost' if self._open else 'the port was closed')
        if self.vrpi is not None and self._has_news:
            self._has_news = False
            for event in self.controls.read(self.vrpi, now, estop=self.estop):
                self._emit(event)
        for result in ended:
            self._emit(result)
        self._follow_hold(now)

    def _follow_remote(self) -> None:
        vrpi = self.vrpi
        remote = None
        if vrpi is not None and vrpi.armed_ru:
            remote = Remote(vrpi.armed_ru, vrpi.ru_battery, vrpi.ru_docked)
        if remote != self._remote:
            self._remote = remote
            self._emit(RemoteState(remote))

    def _follow_device(self) -> None:
        values = report.vrpi_values(self.vrpi)
        told = (self.verdict, values)
        if told == self._told:
            return
        self._told = told
        level = Level.WARN if self.link_up else Level.ERROR
        problems = [(level, reason) for reason in self.verdict.reasons]
        if self.vrpi is not None:
            problems += [(Level.WARN, text) for text in report.warnings(self.vrpi)]
        self._emit(DeviceState(tuple(problems), report.summary(self.vrpi), values))

    def _follow_hold(self, now: float) -> None:
        """
        Once a hold was asked for at all, silence asks for it too.

        VRPO go on while the BU is known to hold its relays open by itself: there is nothing to
        add, and without VRPO it could perhaps not be rearmed. Two devices that are both stopped,
        each waiting for the other one's release, would wait for ever.
        """
        stale = self._hold_heard.expired(now)
        self.hold_asked = self.hold_output_in_use and (self._hold_output or stale)
        is_open = self.vrpi is not None and self.vrpi.bu_state < RELAYS_CLOSED
        by_itself = is_open and self._stops.verdict().own_estop and not self._is_unsure(now)
        self.output_held = self.hold_asked and not by_itself
        self._stops.hold(self.output_held, now)

    def _expires_at(self) -> float:
        moments = [super()._expires_at(), self.outbox.expires_at]
        if not self.hold_asked:
            moments.append(self._hold_heard.deadline)
        if self.origin.sender.is_doubled(self._stepped_at):
            moments.append(self.origin.sender.doubled_until)
        return min(moments)

    def _sends_at(self) -> float:
        return min(self._pacer.due, self.outbox.sends_at)

    def _due_frames(self, now: float) -> list[bytes]:
        messages: list[Message] = [AcknowledgeOutput(each) for each in self._acknowledgements]
        messages += [*self._due_output(now), *self.outbox.due(now)]
        if not messages:
            return []
        assert self.crc is not None  # or nobody was heard that it could be for
        self._offered.clear()
        for number, message in enumerate(messages, self._serial):
            serial = number & 0xFFFF
            self._offered[build_frame(message, serial, self.crc)] = serial, message
        return list(self._offered)

    def _due_output(self, now: float) -> list[PeriodicOutput]:
        """Return the burst of VRPO when it is due, unless it is withheld."""
        if not self._pacer.is_due(now):
            return []
        if self.output_held or self.crc is None:
            self._pacer.sent(now)
            return []
        return burst(self._output, self.settings.first_packet_number)

    def sent(self, frame: bytes, now: float) -> None:
        """Count a packet as sent; see the base. The first of a burst takes the slot."""
        serial, message = self._offered.pop(frame)
        self._serial = (serial + 1) & 0xFFFF
        if isinstance(message, AcknowledgeOutput):
            self._acknowledgements.remove(message.command_id)
        elif isinstance(message, CommandOutput):
            self.outbox.sent(now)
        else:
            self._stops.output_sent(now)
            if self._pacer.is_due(now):
                self._pacer.sent(now)

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
