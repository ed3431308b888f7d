"""
What the link to a base unit means over time: manual sections 4 and 5.

Only a fresh VRPI of our own base unit vouches for anything. Without one there is no remote, no
stick and no permission, whatever else still comes.
"""

from __future__ import annotations

import math

from bridge_core.session import Pacer
from bridge_core.session import StickStream
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from bridge_core.watchdog import Watchdog
from vm110_bridge.protocol import AcknowledgeInput
from vm110_bridge.protocol import AcknowledgeOutput
from vm110_bridge.protocol import build_frame
from vm110_bridge.protocol import burst
from vm110_bridge.protocol import BuState
from vm110_bridge.protocol import CommandInput
from vm110_bridge.protocol import Crc
from vm110_bridge.protocol import decode
from vm110_bridge.protocol import Disabled
from vm110_bridge.protocol import Frame
from vm110_bridge.protocol import FrameError
from vm110_bridge.protocol import MAX_POSITION
from vm110_bridge.protocol import Message
from vm110_bridge.protocol import parser
from vm110_bridge.protocol import PeriodicInput
from vm110_bridge.protocol import RELAYS_CLOSED
from vm110_bridge.protocol import RuState
from vm110_bridge.protocol import Unknown
from vm110_bridge.session.encoder import Encoder
from vm110_bridge.session.events import ArmedChanged
from vm110_bridge.session.events import Command
from vm110_bridge.session.events import Event
from vm110_bridge.session.events import Output
from vm110_bridge.session.events import Remote
from vm110_bridge.session.events import RemoteState
from vm110_bridge.session.events import Sticks
from vm110_bridge.session.inbox import CommandInbox
from vm110_bridge.session.outbox import CommandOutbox
from vm110_bridge.session.serials import Arrival
from vm110_bridge.session.serials import SerialNumbers
from vm110_bridge.session.settings import MAX_OUTPUT
from vm110_bridge.session.settings import Settings
from vm110_bridge.session.stops import StopJudge

_NEUTRAL = Sticks()
_MANY = 8  # other base units that are remembered
_MEMORY = 5.0  # seconds for which another base unit counts as being there


class Session:
    """
    One base unit on one multicast group; see bridge_core.transports.link.Session for the contract.

    ``receive`` takes one datagram, and each frame to send is one. Which reading of the CRC and
    which base unit were locked to holds for the session's whole life.

    :param settings: see Settings.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()
        self.estop = True
        self.own_estop = True
        self.link_up = False
        self.armed = False
        self.enabled = False
        self.vrpi: PeriodicInput | None = None  # the newest, while the link is up
        self.bu_id = self.settings.bu_id  # 0 until a base unit was heard
        self.hold_output_in_use = False
        self.looped_back = 0  # packets that only a machine controller sends
        self.foreign = 0  # packets of other base units
        self.serials = SerialNumbers()
        self.inbox = CommandInbox(explicit=self.settings.explicit_acknowledge)
        self.outbox = CommandOutbox(self.settings.command_timeout)
        self._parser = parser(self.settings.crc)
        self.counters = self._parser.counters
        self._heard = Watchdog(self.settings.link_timeout)
        self._hold_output = False
        self._hold_heard = Watchdog(self.settings.hold_output_timeout)
        self._others: dict[int, float] = {}  # when another base unit was heard last
        self._judge = StopJudge()
        self._verdict = Verdict()
        self._open = False
        self._pacer = Pacer(self.settings.output_period)
        self._output = bytes(self.settings.periodic_output_size)
        self._serial = 0
        self._acknowledgements: list[int] = []  # to be sent with the next poll
        self._stream = StickStream()
        self._stick_ru = 0  # whose sticks they were
        self._remote: Remote | None = None
        self._encoder = Encoder()

    # -- the link thread's side ------------------------------------------------------------------

    def opened(self, now: float) -> Output:
        """Begin with a new port: nothing was heard yet; VRPO go as soon as they can."""
        self._forget()
        self._open = True
        self._judge = StopJudge(now)
        self._pacer.start(now)
        events: list[Event] = []
        self._refresh(now, events)
        return events, self._output_frames(now)

    def closed(self, now: float) -> list[Event]:
        """Forget what was heard; what waits to be sent has failed."""
        self._forget()
        self._open = False
        self._pacer.stop()
        events: list[Event] = [*self.outbox.drop('the port was closed')]
        self._refresh(now, events)
        return events

    def receive(self, data: bytes, now: float) -> Output:
        """Take one datagram. Acknowledgements go out at once, all else comes from poll."""
        events: list[Event] = []
        frames: list[bytes] = []
        if self._open:
            self._refresh(now, events)  # what went stale before this came
            frame = self._parser.feed(data)
            if frame is not None:
                self._take(frame, now, events, frames)
            self._refresh(now, events)
        return events, frames

    def poll(self, now: float) -> Output:
        """Do what is due."""
        events: list[Event] = []
        if not self._open:
            return events, []
        self._refresh(now, events)
        results, commands = self.outbox.poll(now)
        frames = self._acknowledgement_frames() + self._output_frames(now)
        return [*events, *results], frames + [self._frame(command) for command in commands]

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if not self._open:
            return math.inf
        due = min(self._pacer.due, self.outbox.deadline)
        return min(due, self._heard.deadline) if self.link_up else due

    def farewell(self, now: float) -> list[bytes]:
        """Return nothing: without VRPO the base unit opens its relays by itself (5.1.2)."""
        del now
        return []

    # -- what is known ---------------------------------------------------------------------------

    @property
    def crc(self) -> Crc | None:
        """The reading of the CRC; None: not known yet."""
        return self._parser.crc

    @property
    def faulty(self) -> tuple[str, ...]:
        """Joysticks that cannot be where the newest VRPI says they are."""
        return self.vrpi.faulty if self.vrpi is not None and self.enabled else ()

    def frame_age(self, now: float) -> float:
        """Return the seconds since a VRPI that was news; infinite if there was none."""
        return self._heard.age(now)

    def other_base_units(self, now: float) -> list[int]:
        """Return the IDs of other base units that were heard lately."""
        return [origin for origin, at in self._others.items() if now - at < _MEMORY]

    def hold_asked(self, now: float) -> bool:
        """Tell whether VRPO are to be withheld; once asked for at all, silence asks for it too."""
        stale = self._hold_heard.expired(now)
        return self.hold_output_in_use and (self._hold_output or stale)

    def output_held(self, now: float) -> bool:
        """
        Tell whether VRPO are withheld.

        Not while the BU holds its relays open by itself: there is nothing to add, and without VRPO
        it could perhaps not be rearmed. Two devices that are both stopped, each waiting for the
        other one's release, would wait for ever.
        """
        open_by_itself = self.vrpi is not None and self.vrpi.bu_state < RELAYS_CLOSED
        return self.hold_asked(now) and not (open_by_itself and self.own_estop)

    @property
    def packets(self) -> dict[str, int]:
        """What the counters of the link do not tell, by name."""
        return {
            'packets lost': self.serials.lost,
            'packets repeated': self.serials.repeated,
            'packets reordered': self.serials.reordered,
            'restarts of the base unit': self.serials.restarts,
            'packets of other base units': self.foreign,
            'packets with the other CRC': self._parser.other_crc,
            'packets before the CRC was known': self._parser.before_lock,
            'packets of machine controllers': self.looped_back,
            'commands delivered': self.inbox.delivered,
            'commands repeated': self.inbox.repeats,
            'commands refused (unarmed remote)': self.inbox.refused,
            'commands not acknowledged yet': self.inbox.waiting,
            'commands to the remote under way': self.outbox.size,
            'stray acknowledgements': self.outbox.stray_acknowledgements,
        }

    def stop_reasons(self, now: float) -> list[str]:
        """Say why ``estop`` is true, and what to do; empty if it is false."""
        if not self._open:
            return ['the port is not open; check the network interface and interface_address']
        if self.link_up:
            return list(self._verdict.reasons)
        return [f'no VRPI from the BU: {self._heard.describe(now)}; {self._silence_hint(now)}']

    def _silence_hint(self, now: float) -> str:
        others = self.other_base_units(now)
        if others:
            names = ', '.join(map(str, others))
            return f'base unit {names} is heard, but bu_id is {self.bu_id}'
        if self.serials.restarting:
            return 'its serial numbers begin anew: was it restarted? wait a second'
        if self._parser.other_crc and not self._heard.heard:
            return 'packets with the other CRC come; set crc to auto'
        if self.counters.checksum_errors and not self._heard.heard:
            return 'packets with a wrong CRC come; is something else on this group and port?'
        return "check the BU's power, its EG-Link cable, group, input_port and interface_address"

    # -- requests --------------------------------------------------------------------------------

    def set_hold_output(self, value: bool, now: float) -> None:
        """Withhold VRPO, or not; from the first call on, silence withholds them too."""
        self.hold_output_in_use = True
        self._hold_output = value
        self._hold_heard.feed(now)

    def set_periodic_output(self, data: bytes) -> None:
        """
        Set what VRPO carry from now on.

        :raises ValueError: not as many bytes as periodic_output_size, or more than may be.
        """
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
        if not self.link_up:
            raise ValueError('no base unit is heard, so nobody would take the command')
        return self.outbox.add(data, now)

    def command_done(self, command_id: int, now: float) -> None:
        """
        Acknowledge a command that was carried out.

        :raises ValueError: no such command was delivered lately.
        """
        self.inbox.done(command_id, now)
        self._acknowledgements.append(command_id)

    # -- inside ----------------------------------------------------------------------------------

    def _frame(self, message: Message) -> bytes:
        assert self.crc is not None  # or nobody was heard that it could be for
        frame = build_frame(message, self._serial, self.crc)
        self._serial = (self._serial + 1) & 0xFFFF
        return frame

    def _forget(self) -> None:
        self._heard.reset()
        self._others.clear()
        self._acknowledgements.clear()
        self.serials.forgive_gap()

    def _take(self, frame: Frame, now: float, events: list[Event], frames: list[bytes]) -> None:
        """Count, and hand each message of our base unit to whom it concerns."""
        try:
            message = decode(frame)
        except FrameError:
            self.counters.malformed += 1
            return
        if isinstance(message, Unknown):
            self.counters.unknown_types += 1
        elif not isinstance(message, PeriodicInput | CommandInput | AcknowledgeInput):
            self.looped_back += 1
        elif frame.origin == 0:  # the machine controller's; no base unit has it
            self.counters.malformed += 1
        elif self._is_ours(frame, message, now):
            self._take_input(frame.serial, message, now, events, frames)

    def _is_ours(self, frame: Frame, message: Message, now: float) -> bool:
        """Tell whether our base unit sent it; the first VRPI decides which that is."""
        if self.bu_id == 0 and isinstance(message, PeriodicInput):
            self.bu_id = frame.origin
        if frame.origin != self.bu_id:
            self.foreign += 1
            if len(self._others) < _MANY or frame.origin in self._others:
                self._others[frame.origin] = now
            return False
        if self.crc is None:
            self._parser.lock(frame.crc)
        return True

    def _take_input(
        self,
        serial: int,
        message: PeriodicInput | CommandInput | AcknowledgeInput,
        now: float,
        events: list[Event],
        frames: list[bytes],
    ) -> None:
        restarts = self.serials.restarts
        arrival = self.serials.hear(serial, now, silent=not self.link_up)
        if self.serials.restarts > restarts:
            self.inbox.restart()
        if arrival is Arrival.OLD:
            return
        if isinstance(message, PeriodicInput):
            self._take_periodic(message, arrival, now, events)
        elif isinstance(message, CommandInput):
            self._take_command(message, now, events, frames)
        else:
            events += self.outbox.acknowledged(message.command_id, now)

    def _take_periodic(
        self, vrpi: PeriodicInput, arrival: Arrival, now: float, events: list[Event]
    ) -> None:
        if arrival is Arrival.LATE:
            # Not how things are now, and not a sign of life; but a stop in it must not be missed.
            if self.link_up:
                self._verdict = self._verdict.worst(self._judge.judge_late(vrpi))
            return
        self._judge.hold(self.output_held(now), now)
        self._verdict = self._judge.judge(vrpi, now)
        self._heard.feed(now)
        self.vrpi = vrpi
        self._refresh(now, events)
        self._tell_remote(events)
        self._encoder.take(vrpi.encoder, vrpi.armed_ru if self.enabled else 0, events)
        sticks = self._sticks_of(vrpi)
        self._stream.told(counts=sticks.enabled)
        events.append(sticks)

    def _sticks_of(self, vrpi: PeriodicInput) -> Sticks:
        # Another remote's sticks do not go on where those of the one before left off.
        is_known, self._stick_ru = vrpi.armed_ru == self._stick_ru, vrpi.armed_ru
        if not self.enabled or not is_known:
            return _NEUTRAL
        if vrpi.faulty and not self.settings.tolerate_faulty_axes:
            return Sticks(enabled=True, faulty=vrpi.faulty)
        return Sticks(
            axes=tuple(value if abs(value) <= MAX_POSITION else 0 for value in vrpi.joysticks),
            buttons=(*vrpi.switches, int(vrpi.encoder_switch)),
            enabled=True,
            faulty=vrpi.faulty,
        )

    def _take_command(
        self, command: CommandInput, now: float, events: list[Event], frames: list[bytes]
    ) -> None:
        allowed = self.armed or self.settings.accept_unarmed_commands
        deliver, acknowledge = self.inbox.take(command, now, allowed=allowed)
        if deliver:
            events.append(Command(command.command_id, command.data))
        if acknowledge:
            frames.append(self._frame(AcknowledgeOutput(command.command_id)))

    def _tell_remote(self, events: list[Event]) -> None:
        """Tell of the armed remote when something about it changed."""
        vrpi = self.vrpi
        remote = None
        if vrpi is not None and vrpi.armed_ru:
            remote = Remote(vrpi.armed_ru, vrpi.ru_battery, vrpi.ru_docked)
        if remote != self._remote:
            self._remote = remote
            events.append(RemoteState(remote))

    def _refresh(self, now: float, events: list[Event]) -> None:
        """Bring all that depends on freshness up to date; tell what changed, stops first."""
        before = (self.estop, self.own_estop, self.link_up)
        was_armed = (self.armed, self.enabled)
        self.link_up = self._open and not self._heard.expired(now)
        self.estop = not self.link_up or self._verdict.estop
        self.own_estop = not self.link_up or self._verdict.own_estop
        self.armed = not self.estop and _is_armed(self.vrpi)
        self.enabled = self.armed and _is_enabled(self.vrpi)
        if before != (self.estop, self.own_estop, self.link_up):
            events.append(StopChanged(self.estop, self.own_estop, self.link_up))
        if was_armed != (self.armed, self.enabled):
            events.append(ArmedChanged(self.armed, self.enabled))
        self._refresh_sticks(events)
        if not self.link_up and self.vrpi is not None:
            self.vrpi = None
            self._tell_remote(events)
            self._encoder.rest()
            events += self.outbox.drop('the link was lost')

    def _refresh_sticks(self, events: list[Event]) -> None:
        """Follow up what was published with a neutral event once it does not hold any more."""
        if self._stream.owes_neutral(fresh=self.link_up, counts=self.enabled):
            events.append(_NEUTRAL)

    def _output_frames(self, now: float) -> list[bytes]:
        """Return the burst of VRPO when it is due, unless it is withheld."""
        held = self.output_held(now)
        self._judge.hold(held, now)
        if not self._pacer.is_due(now):
            return []
        self._pacer.sent(now)
        if held or self.crc is None:
            return []
        self._judge.output_sent(now)
        packets = burst(self._output, self.settings.first_packet_number)
        return [self._frame(packet) for packet in packets]

    def _acknowledgement_frames(self) -> list[bytes]:
        """Return the VRAO that were asked for since the last poll."""
        frames = [self._frame(AcknowledgeOutput(command)) for command in self._acknowledgements]
        self._acknowledgements.clear()
        return frames


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
