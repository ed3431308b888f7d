"""
What the link to a unit means over time; see bridge_core.transports.link.Session for the contract.

Only a fresh frame from the address that our unit announced vouches for it. Its silence, a missing
enable input, a motor fault and a foreign joystick are stops where ``estop_on`` lists them.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from akron_can_bridge.protocol import AddressAnnouncement
from akron_can_bridge.protocol import BASIC_JOYSTICK_PGN
from akron_can_bridge.protocol import BasicJoystick
from akron_can_bridge.protocol import Counters
from akron_can_bridge.protocol import decode
from akron_can_bridge.protocol import DigitalInputs
from akron_can_bridge.protocol import EXTENDED_JOYSTICK_PGN
from akron_can_bridge.protocol import ExtendedJoystick
from akron_can_bridge.protocol import Fault
from akron_can_bridge.protocol import FaultStatus
from akron_can_bridge.protocol import FieldRequest
from akron_can_bridge.protocol import FrameError
from akron_can_bridge.protocol import Message
from akron_can_bridge.protocol import MessageType
from akron_can_bridge.protocol import MiniOutputs
from akron_can_bridge.protocol import Name
from akron_can_bridge.protocol import NAME_PGN
from akron_can_bridge.protocol import PositionLimit
from akron_can_bridge.protocol import PROPRIETARY_PGN
from akron_can_bridge.protocol import Status
from akron_can_bridge.protocol import Unknown
from akron_can_bridge.protocol import VistaPoll
from akron_can_bridge.session.asker import Asker
from akron_can_bridge.session.asker import in_words
from akron_can_bridge.session.drive import Command
from akron_can_bridge.session.drive import Drive
from akron_can_bridge.session.events import Answer
from akron_can_bridge.session.events import Event
from akron_can_bridge.session.events import FaultsChanged
from akron_can_bridge.session.events import LimitsChanged
from akron_can_bridge.session.events import Output
from akron_can_bridge.session.events import OutputsChanged
from akron_can_bridge.session.events import Positions
from akron_can_bridge.session.events import Request
from akron_can_bridge.session.events import Stopped
from akron_can_bridge.session.events import UnitChanged
from akron_can_bridge.session.finder import Finder
from akron_can_bridge.session.joysticks import Joysticks
from akron_can_bridge.session.settings import Cause
from akron_can_bridge.session.settings import MINI_UNIVERSAL
from akron_can_bridge.session.settings import Settings
from akron_can_bridge.session.stops import causes
from akron_can_bridge.session.unit import Unit
from bridge_core.j1939 import CanFrame
from bridge_core.j1939 import GLOBAL_ADDRESS
from bridge_core.j1939 import J1939Id
from bridge_core.session import Pacer
from bridge_core.session import StopChanged

FAULT_PERIOD = 1.0  # of fault polls while something is wrong
# All that this session takes, as (identifier, mask); the priority does not count.
FILTERS = (
    (BASIC_JOYSTICK_PGN << 8, 0x03FFFF00),
    (EXTENDED_JOYSTICK_PGN << 8, 0x03FFFF00),
    (NAME_PGN << 8, 0x03FF0000),
    (PROPRIETARY_PGN << 8, 0x03FF0000),
)
_JOYSTICK_PGNS = (BASIC_JOYSTICK_PGN, EXTENDED_JOYSTICK_PGN)
_FROM_ANYONE = tuple(
    bytes((kind,))
    for kind in (
        *(MessageType.ADDRESS_ANNOUNCEMENT, MessageType.MINI_OUTPUTS),
        MessageType.DIGITAL_INPUTS,
    )
)
_NO_FAULT = FaultStatus(Fault(0), 0)
# What must not meet a moving unit, and what it is called meanwhile.
_AT_REST = {
    Request.ZERO_POSITIONS: 'its zero positions are being set',
    Request.RESET_CONTROLLER: 'the unit is being reset',
    Request.ENTER_SETUP: 'the unit is being put into setup mode',
}


class Session:
    """
    One unit on one CAN bus.

    Requests act at once on what the next poll sends; poll after each of them.

    :param settings: see Settings.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()
        self.estop = True
        self.link_up = False
        self.counters = Counters()
        self.other_frames = 0  # of those that are none of our business
        self.finder = Finder(self.settings)
        self.unit = Unit(self.settings.link_timeout)
        self.joysticks = Joysticks(self.settings)
        self.drive = Drive(self.settings)
        self._asker = Asker(self.settings.answer_timeout)
        self._events: list[Event] = []
        self._open = False
        self._stops: list[str] = ['the port is not open']
        self._limits, self._outputs = LimitsChanged(), OutputsChanged()  # as told last
        self._in_error = False  # type 01 says operational error
        self._faults_told: tuple[str, ...] = ()
        self._faults_at = -math.inf  # when they were asked for or told
        self._vista: Pacer | None = None
        if self.settings.vista_rate:
            self._vista = Pacer(1.0 / self.settings.vista_rate)

    # -- the link thread's side ------------------------------------------------------------------

    def opened(self, now: float) -> Output:
        """Begin with a new port: neutral frames, and a look for the unit."""
        self._open = True
        self.drive.opened(now)
        self.finder.opened(now)
        return self.poll(now)

    def closed(self, now: float) -> list[Event]:
        """Forget what was heard."""
        self._open = False
        self._watch(now)
        self._events += self._asker.drop('the port was closed')
        self.drive.closed()
        self.unit.forget()
        self.joysticks.forget()
        self._watch(now)
        return self._take_events()

    def receive(self, frame: CanFrame, now: float) -> Output:
        """Take one frame. Frames to send come from poll."""
        if not self._open:
            return self._take_events(), []
        self.counters.frames += 1
        self.counters.bytes += len(frame.data)
        sender = J1939Id.from_identifier(frame.identifier)
        if self._concerns_us(sender, frame.data):
            self._watch(now)  # what went stale before this came
            self._take(frame, sender, now)
            self._watch(now)
        else:
            self.other_frames += 1
        return self._take_events(), []

    def poll(self, now: float) -> Output:
        """Let time act, and send what is due, stops first."""
        if not self._open:
            return self._take_events(), []
        self._watch(now)
        frames = self.drive.joystick_frames(now)
        frames += self.drive.permissive_frames(now, self.finder.address, self._holds())
        frames += self._questions(now)
        self._watch(now)
        return self._take_events(), frames

    def deadline(self) -> float:
        """Return when poll wants to be called next; what waits longer is seen to with a slot."""
        if not self._open:
            return math.inf
        link = self.unit.heard.deadline if self.link_up else math.inf
        return min(self.drive.deadline, self.joysticks.deadline, link)

    def farewell(self, now: float) -> list[CanFrame]:
        """Return neutral frames, and none of the permission."""
        return self.drive.farewell(self.finder.address, now) if self._open else []

    # -- what is known ---------------------------------------------------------------------------

    @property
    def own_estop(self) -> bool:
        """The same as ``estop``: none of its causes is an echo of what this node asks."""
        return self.estop

    def frame_age(self, now: float) -> float:
        """Return the seconds since the unit was heard; infinite if it never was."""
        return self.unit.heard.age(now)

    def stop_reasons(self, now: float) -> list[str]:
        """Say why ``estop`` is true, and what to do; empty if it is false."""
        if not self._open:
            return ['the port is not open']
        counted = self.settings.estop_on
        texts = (text for cause, text in self.causes(now).items() if cause in counted)
        return list(dict.fromkeys(texts))

    def causes(self, now: float) -> dict[Cause, str]:
        """Say what is a stop where ``estop_on`` lists it, and what to do; nothing while closed."""
        if not self._open:
            return {}
        return causes(self.settings, self.finder, self.unit, self.joysticks, now)

    def inhibits(self, now: float) -> list[str]:
        """Say why nothing but neutral goes to the unit; empty while commands do."""
        return self.drive.inhibits(now, [*self.stop_reasons(now), *self._busy()])

    # -- requests --------------------------------------------------------------------------------

    def set_command(self, basic: BasicJoystick, extended: ExtendedJoystick, now: float) -> None:
        """Take a command; see the module ``drive`` for what it takes to go out."""
        self._watch(now)
        self.drive.set_command(Command(basic, extended), now, self._holds())

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: there is no fresh one any more."""
        self._watch(now)
        self.drive.refuse_command(reason)

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; true stops even if false follows before the next poll."""
        self._watch(now)
        self.drive.set_estop(value, now)

    def request(self, request: Request, now: float) -> None:
        """
        Ask something of the unit. An Answer will follow.

        :raises ValueError: the unit cannot be asked, or not now.
        """
        self._watch(now)
        if not self.link_up or self.finder.address is None:
            raise ValueError(self.causes(now).get(Cause.LINK, 'no unit is heard at present'))
        if request in _AT_REST and self.drive.moving:
            raise ValueError('motion is commanded; let go of the stick first')
        if request in _AT_REST and (others := self.joysticks.moving(now)):
            names = ', '.join(f'{address:02X}' for address in others)
            raise ValueError(f'motion is commanded by joystick {names}; let go of it first')
        self._asker.start(request, now)

    # -- time ------------------------------------------------------------------------------------

    def _watch(self, now: float) -> None:
        """Bring all that depends on time up to date, stops first; tell what changed."""
        self._judge(now)
        reasons = self.drive.watch(now, self._holds())
        if reasons:
            self._events.append(Stopped(reasons))
        self._events += self.joysticks.poll(now)
        limits, outputs = self.unit.limits(now), self.unit.outputs(now)
        if limits != self._limits:
            self._events.append(limits)
        if outputs != self._outputs:
            self._events.append(outputs)
        self._limits, self._outputs = limits, outputs

    def _judge(self, now: float) -> None:
        before = (self.estop, self.link_up)
        self.link_up = self._open and not self.unit.heard.expired(now)
        if self.link_up and not before[1]:
            self._meet(now)
        elif before[1] and not self.link_up:
            self.unit.lost()
            self._in_error = False
        self._stops = self.stop_reasons(now)
        self.estop = bool(self._stops)
        if before != (self.estop, self.link_up):
            self._events.append(StopChanged(self.estop, self.own_estop, self.link_up))

    def _meet(self, now: float) -> None:
        """Ask what is asked of a unit that is heard for the first time, or again."""
        self._faults_at = -math.inf
        if not self.unit.versions_known:
            self._asker.start(Request.POLL_VERSIONS, now)
        if self._vista is not None:
            self._vista.start(now)

    def _holds(self) -> list[str]:
        """Return all that keeps the frames neutral, apart from the inputs."""
        return [*self._stops, *self._busy()]

    def _busy(self) -> list[str]:
        return [text for request, text in _AT_REST.items() if self._asker.is_open(request)]

    def _questions(self, now: float) -> list[CanFrame]:
        """Return the requests and polls that are due."""
        source, unit = self.settings.source_address, self.finder.address
        frames = []
        if self.finder.request_due(now, heard=self.link_up):
            frames.append(FieldRequest().to_frame(source))
        if self._wants_faults(now):
            self._faults_at = now
            self._asker.start(Request.POLL_FAULTS, now)
        answers, messages = self._asker.poll(now)
        self._take_answers(answers)
        if unit is None:
            return frames
        if self._vista is not None and self.link_up and self._vista.is_due(now):
            self._vista.sent(now)
            messages.append(VistaPoll())
        return frames + [message.to_frame(source, unit) for message in messages]

    def _wants_faults(self, now: float) -> bool:
        """Tell whether a fault poll is due: all is not well, or no type 01 would say so."""
        if not self.link_up or now < self._faults_at + FAULT_PERIOD:
            return False
        is_told = self.unit.broadcast(PositionLimit, now) is not None
        return self._in_error or self.unit.faults != _NO_FAULT or not is_told

    def _take_answers(self, answers: Sequence[Answer]) -> None:
        for answer in answers:
            if answer.request is Request.POLL_FAULTS and not answer.success:
                self.unit.faults = None
        self._events += answers

    def _take_events(self) -> list[Event]:
        events, self._events = self._events, []
        return events

    # -- frames ----------------------------------------------------------------------------------

    def _take(self, frame: CanFrame, sender: J1939Id, now: float) -> None:
        """Hand each message to whom it concerns; count what is none."""
        if sender.pgn in _JOYSTICK_PGNS:
            self.joysticks.hear(sender, now)
        try:
            message = decode(frame).message
        except FrameError:
            self.counters.malformed += 1
            return
        if isinstance(message, Unknown):
            self.counters.unknown_types += 1
        elif isinstance(message, BasicJoystick | ExtendedJoystick):
            self._events += self.joysticks.take(message, sender.source, now)
        elif isinstance(message, Name):
            self._unit_changed(self.finder.claimed(sender.source, message, now))
        else:
            self._take_proprietary(message, sender.source, now)

    def _concerns_us(self, sender: J1939Id, data: bytes) -> bool:
        """Tell whether a frame is for us; PGN EF00 is every maker's own."""
        if sender.pgn != PROPRIETARY_PGN:
            return sender.pgn == NAME_PGN or sender.pgn in _JOYSTICK_PGNS
        if sender.destination not in (GLOBAL_ADDRESS, self.settings.source_address):
            return False
        return sender.source == self.finder.address or data[:1] in _FROM_ANYONE

    def _take_proprietary(self, message: Message, source: int, now: float) -> None:
        if isinstance(message, AddressAnnouncement):
            self._unit_changed(self.finder.announced(source, message, now))
        if source == self.finder.address:
            self.unit.heard.feed(now)
            self._take_status(message, now)
        elif isinstance(message, DigitalInputs) or (
            isinstance(message, MiniOutputs) and not self._is_mini
        ):
            self.unit.take(message, now, neighbour=source)

    @property
    def _is_mini(self) -> bool:
        return self.settings.unit_type == MINI_UNIVERSAL

    def _take_status(self, message: Message, now: float) -> None:
        """Take what our unit says."""
        self.unit.take(message, now)
        if isinstance(message, PositionLimit):
            self._take_position(message)
        elif isinstance(message, FaultStatus):
            self._take_faults(message, now)
        self._take_answers(self._asker.answered(message))

    def _take_position(self, message: PositionLimit) -> None:
        in_error = message.operational_error in (Status.ON, Status.ERROR)
        if in_error and not self._in_error:
            self._faults_at = -math.inf
        self._in_error = in_error
        self._events.append(Positions(message.rotation.radians, message.elevation.radians))

    def _take_faults(self, message: FaultStatus, now: float) -> None:
        self.unit.faults = message
        if not self._in_error:  # or it may be older than the error
            self._faults_at = now
        faults = () if message == _NO_FAULT else (in_words(message),)
        if faults != self._faults_told:
            self._faults_told = faults
            self._events.append(FaultsChanged(faults))

    def _unit_changed(self, text: str) -> None:
        if text:
            self._events.append(UnitChanged(text))
