# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from akron_can_bridge import protocol
from akron_can_bridge.parameters import Cause, MINI_UNIVERSAL
from akron_can_bridge.protocol import BasicJoystick, ExtendedJoystick, MessageType, Permission
from akron_can_bridge.session import events, report, stops
from akron_can_bridge.session.asker import Asker, in_words
from akron_can_bridge.session.decoder import FrameDecoder, JOYSTICK_PGNS, Received
from akron_can_bridge.session.drive import Command, Drive
from akron_can_bridge.session.events import Event, Handover, Request
from akron_can_bridge.session.finder import Finder
from akron_can_bridge.session.joysticks import Joysticks
from akron_can_bridge.session.motion import Demand, Motion, Oscillation
from akron_can_bridge.session.settings import Settings
from akron_can_bridge.session.unit import NO_FAULT, Unit
from bridge_core.actuator import ActuatorSession
from bridge_core.j1939 import CanFrame, GLOBAL_ADDRESS, J1939Id
from bridge_core.mux_words import MuxWords
from bridge_core.reasons import Coded
from bridge_core.session import Answer, Level, Pacer, Verdict

# Types that count whoever sends them: announcements, and broadcasts of a 6033 and a 6039.
_FROM_ANYONE = tuple(
    bytes((kind,))
    for kind in (
        *(MessageType.ADDRESS_ANNOUNCEMENT, MessageType.MINI_OUTPUTS),
        MessageType.DIGITAL_INPUTS,
    )
)
_PERMISSIVE, _SETUP = bytes((MessageType.SOE_PERMISSIVE,)), bytes((MessageType.ENTER_SETUP,))
_DIRECTIONS = sum(Permission)
_NAME_REQUEST = protocol.FieldRequest().to_bytes()
_IN_SETUP = Coded(
    'akron.busy.setup',
    'the unit is in setup mode, or may be; call ~/reset_controller once that is done',
)
_NOT_INFORMED = Coded(
    'akron.busy.new', 'this node has yet to tell what it knew of the unit before'
)
_STALE = Coded('gate.stale', 'an input is stale', input='input')
# What must not meet a moving unit, and what it is called meanwhile.
_AT_REST = {
    Request.ZERO_POSITIONS: Coded('akron.busy.asked', 'its zero positions are being set'),
    Request.RESET_CONTROLLER: Coded('akron.busy.asked', 'the unit is being reset'),
    Request.ENTER_SETUP: Coded('akron.busy.asked', 'the unit is being put into setup mode'),
}


class Session(ActuatorSession[CanFrame, Received, Event]):
    """One unit on one CAN bus; see bridge_core.session."""

    HELD = 'neutral'
    # What is damaged on the line a CAN controller drops.
    DAMAGED = 'look for another device on this bus, or another firmware'

    def __init__(self, settings: Settings, mux: MuxWords | None = None) -> None:
        self.decoder = FrameDecoder(self._concerns_us, self._is_ours)
        super().__init__(self.decoder, settings.link_timeout, mux)
        self.settings = settings
        self.finder = Finder(settings)
        self.unit = Unit(settings.link_timeout)
        self.joysticks = Joysticks(settings)
        self.drive = Drive(settings)
        self.motion = Motion(self.unit)
        self.oscillation = Oscillation(settings.coast_time)
        self.presses = 0  # of oscillate pause / resume, by stops
        self.demand = Demand(self.drive, self.joysticks)
        self._asker = Asker(settings.answer_timeout)
        self._was_up = False  # link_up as of the last refresh
        self._in_setup = False  # the unit, or it may be
        self._informed = False  # of what a session before this one knew
        self._faults: tuple[str, ...] = ()  # as reported last
        first = (events.LimitsChanged(), events.OutputsChanged(), events.DeviceChanged())
        self._reported: dict[type, Event] = {type(event): event for event in first}
        self._vista = Pacer(1.0 / settings.vista_rate) if settings.vista_rate else None

    # -- what is known ----------------------------------------------------------------------------

    def causes(self, now: float) -> dict[Cause, Coded]:
        """Say what is a stop where ``estop_on`` lists it, and what to do; nothing while closed."""
        if not self._open:
            return {}
        foreign = self.joysticks.describe(self.joysticks.foreign(now))
        if self._heard.expired(now):
            return stops.silent(foreign, self._silence(now))
        overdue = self._asker.overdue(Request.POLL_FAULTS, now)
        faults = None if overdue else self.unit.faults
        found = stops.causes(self.finder.device_type, self.unit, faults, foreign, now)
        if self.motion.moving(now) and now >= self._coasted_at:
            found[Cause.MOTION] = stops.motion(self.motion.describe(now))
        return found

    def inhibits(self, now: float) -> list[Coded]:
        """Return why nothing but neutral goes to the unit; empty while commands do."""
        stops = [*self.stop_reasons(now), *self._busy(), *self.mux.stops(now)]
        return self.drive.inhibits(now, stops)

    @property
    def in_setup(self) -> Coded | None:
        """Say that the unit is in setup mode, or may be, and what to do; None: it is not."""
        return _IN_SETUP if self._in_setup else None

    def warnings(self, now: float) -> list[Coded]:
        """Return what is not a stop but not right either, in words."""
        return report.warnings(self, now)

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return stops, as errors but for a unit that is not enabled, and warnings."""
        not_enabled = self.causes(now).get(Cause.ENABLE) if self.link_up else None
        problems = [
            (Level.WARN if text == not_enabled else Level.ERROR, text)
            for text in self.stop_reasons(now)
        ]
        if self.drive.stale(now):
            problems.append((Level.WARN, _STALE))
        return problems + [(Level.WARN, text) for text in self.warnings(now)]

    def values(self, now: float) -> dict[str, Any]:
        """Return figures by name, in the manual's words."""
        return report.values(self, now)

    # -- the link's side; the base has the rest ---------------------------------------------------

    def sent(self, frame: CanFrame, now: float) -> None:
        """Count a frame as sent: it went out."""
        pgn = J1939Id.from_identifier(frame.identifier).pgn
        if pgn == protocol.BASIC_JOYSTICK_PGN:
            self._stick_sent(now)
        elif pgn == protocol.EXTENDED_JOYSTICK_PGN:
            self.drive.extended_sent(now)
        elif pgn == protocol.FIELD_REQUEST_PGN:
            self.finder.request_sent(now)
        elif frame.data[0] == MessageType.SOE_PERMISSIVE:
            self.drive.permission_sent(frame, now)
        elif frame.data[0] == MessageType.VISTA and self._vista is not None:
            self._vista.sent(now)
        else:
            self._asker.sent(frame.data, now)

    def _stick_sent(self, now: float) -> None:
        if self.settings.pause_on_stop and self.drive.oscillates:
            self.oscillation.ask(now)
        if self.drive.stick_sent(now):
            self.oscillation.press(now)
            self.presses += 1
            self._emit(events.PausePressed())

    def farewell(self, now: float) -> list[CanFrame]:
        """Return neutral frames, and none of the permission."""
        return self.drive.farewell(self.finder.address, now) if self._open else []

    def _begin(self, now: float) -> None:
        self.drive.start(now)
        self.finder.start(now)
        if not self._informed:  # again after lost messages: the question may be among them
            self._emit(events.HandoverWanted())

    def _forget(self, now: float, reason: str) -> None:
        self._in_setup |= self._asker.is_open(Request.ENTER_SETUP)
        self._reported.pop(Handover, None)  # what was reported may be lost, too
        self._emit_all(self._asker.drop(reason))
        self.drive.forget_inputs()
        self.unit.forget_state()
        self.motion.forget_angles()
        self.oscillation.disown()
        self.joysticks.forget_senders()
        if self._open:
            self._begin(now)
        else:
            self.drive.stop()
        self._follow(now)

    def _take(self, message: Received, now: float) -> None:
        frame, sender, content = message
        by_stick = sender.pgn in JOYSTICK_PGNS and sender.source in protocol.JOYSTICK_ADDRESSES
        if by_stick or isinstance(content, protocol.SoePermissive):
            self.joysticks.hear_sender(frame, sender.source, now)
        if isinstance(content, BasicJoystick | ExtendedJoystick):
            self._emit_all(self.joysticks.hear_sticks(content, sender.source, now))
        elif isinstance(content, protocol.Name):
            self._unit_changed(self.finder.claimed(sender.source, content, now))
        elif isinstance(content, protocol.FieldRequest):
            self.finder.asked(now)
        elif content is not None:
            self._in_setup |= isinstance(content, protocol.EnterSetup)  # whoever asked for it
            if self._is_to_us(sender):
                self._take_proprietary(content, sender.source, now)

    def _verdict(self, now: float) -> Verdict:
        """Return the verdict; a lost link counts as ``estop_on`` says, like all causes."""
        if self._open and not self._is_interrupted(now):
            return self._judge(now)
        return super()._verdict(now)

    def _judge(self, now: float) -> Verdict:
        """Return a stop for each cause that counts; none is an echo of what this node asks."""
        counted = self.settings.estop_on
        texts = (text for cause, text in self.causes(now).items() if cause in counted)
        reasons = tuple(dict.fromkeys(texts))
        return Verdict(bool(reasons), bool(reasons), not self._heard.expired(now), reasons)

    def _silence(self, now: float) -> Coded:
        heard, misfit = self._heard.describe(now), self.decoder.misfit(now)
        return stops.silence(self.settings, self.finder, heard, misfit)

    def _follow(self, now: float) -> None:
        if self.link_up != self._was_up:
            self._disown()  # be it a stop or not
            if not self.link_up:
                self.unit.lost()
            else:
                self.unit.found()
                if not self.unit.versions_known:
                    self._asker.start(Request.POLL_VERSIONS, now)
            if self._vista is not None:
                self._vista.start(now)
        self._was_up = self.link_up
        if self._asker.overdue(Request.POLL_FAULTS, now):
            self.unit.faults = None
        self._in_setup |= self._asker.overdue(Request.ENTER_SETUP, now)
        self._emit_all(self._asker.expire(now))
        if self.settings.pause_on_stop:
            # What may explain an oscillation, or may have paused it, beside the unit's controls.
            others = self.joysticks.present(now) or not self.finder.alone
            if others or (self.drive.pushes and not self.drive.oscillates):
                self.oscillation.disown()
        self.demand.follow(now, stopped=bool(self.drive.forbidden(now, self._holds(now))))
        if reasons := self.drive.watch(now, self._holds(now)):
            self._emit(events.Stopped(reasons))
        self._emit_all(self.joysticks.expire(now, stopped=self.estop))
        self.unit.expire(now)
        self._emit_changes(self.unit.limits(now), self.unit.outputs(now), self.finder.describe())
        if self._informed:  # see take_over
            in_setup = self._in_setup or self._asker.is_open(Request.ENTER_SETUP)
            self._emit_changes(Handover(in_setup, self.finder.pin))

    def _expires_at(self) -> float:
        moments = [super()._expires_at(), self._asker.deadline]
        moments += [self.joysticks.deadline, self.unit.deadline]
        later = [*self.drive.deadlines, self.motion.ends_at, self._coasted_at]
        return min(moments + [moment for moment in later if moment > self._stepped_at])

    def _sends_at(self) -> float:
        return self.drive.due  # what waits longer goes with a slot

    def _due_frames(self, now: float) -> list[CanFrame]:
        stopped = self.demand.withheld or self.drive.forbidden(now, self._holds(now))
        permitted = Permission(0) if stopped else self.drive.directions(now)
        return [
            *self.drive.joystick_frames(now),
            *self.drive.permissive_frames(now, self.finder.address, permitted),
            *self._questions(now),
        ]

    # -- what the node asks -----------------------------------------------------------------------

    def set_command(self, basic: BasicJoystick, extended: ExtendedJoystick, now: float) -> None:
        """Take a command; see the module ``drive`` for what it takes to go out."""
        self._expire(now)
        self.drive.set_command(Command(basic, extended), now, self._holds(now))
        self._refresh(now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: there is no fresh one any more."""
        self._expire(now)
        self.drive.refuse_command(reason, now)
        self._refresh(now)

    def _obey_stop(self, value: bool, now: float) -> None:
        self.drive.set_estop(value, now)
        self._refresh(now)

    def set_directions(self, directions: int, now: float) -> None:
        """
        Take which directions the SOE permission may give, as bits of type A1.

        :raises ValueError: for other bits; then it gives none.
        """
        self._expire(now)
        sound = 0 <= directions <= _DIRECTIONS
        self.drive.set_directions(Permission(directions if sound else 0), now)
        self._refresh(now)
        if not sound:
            raise ValueError(f'{directions} is no sum of 1 right, 2 left, 4 up, 8 down')

    def limit_directions(self, now: float) -> None:
        """Give no SOE permission until directions are said: they were, to a session before."""
        self._expire(now)
        self.drive.limit_directions()
        self._refresh(now)

    def take_over(self, before: Handover | None, lost: bool, now: float) -> None:
        """
        Take what a session before this one knew.

        Until then it is neutral and reports no Handover: that would be one of a session that
        knows nothing, to the next one.

        :param before: None: there was none in this process.
        :param lost: its process ended without a farewell: the same unit is followed.
        """
        self._expire(now)
        self._informed = True
        self._reported.pop(Handover, None)
        if before is not None:
            if lost and self.finder.keep(before.pin):
                self._forget_all(now, 'another unit answered first')
            self._in_setup |= before.in_setup
        self._refresh(now)

    def request(self, request: Request, now: float) -> None:
        """
        Ask something of the unit. An Answer will follow.

        :raises ValueError: the unit cannot be asked, or not now.
        """
        self._expire(now)
        if not self.link_up or self.finder.address is None:
            raise ValueError(self.causes(now).get(Cause.LINK, 'no unit is heard at present'))
        if request in _AT_REST and self.drive.moving:
            raise ValueError('motion is commanded; let go of the stick first')
        what = self.motion.describe(now)
        if request in (Request.ZERO_POSITIONS, Request.ENTER_SETUP) and what:  # a reset ends it
            raise ValueError(f'the unit {what}; stop it first')
        if request in _AT_REST and (others := self.joysticks.moving(now)):
            names = ', '.join(f'{address:02X}' for address in others)
            raise ValueError(f'motion is commanded by joystick {names}; let go of it first')
        if request is Request.RESET_CONTROLLER and not self._asker.is_open(request):
            self.finder.expect_reset()
        self._asker.start(request, now, asked=True)
        self._refresh(now)

    def _disown(self) -> None:
        """Permit and pause nothing that was asked for until now."""
        self.demand.withhold()
        self.oscillation.disown()

    # -- motion that a neutral stick does not end -------------------------------------------------

    @property
    def _coasted_at(self) -> float:
        """When motion of the unit becomes one that nobody asks for."""
        return max(self.motion.began_at, self.demand.asked_until) + self.settings.coast_time

    def _take_oscillation(self, message: protocol.RotationSoftLimits, now: float) -> None:
        """
        Pause an oscillation of ours in a stop, by the first type 81 of the stop.

        By a message that comes in the stop, and not by what was known: switch 7 resumes what is
        paused, so the less time there is for somebody else's pause the better.
        """
        if not self.settings.pause_on_stop:
            return
        self.oscillation.hear_limits(message, now)
        if not (self.oscillation.is_ours and self.drive.forbidden(now, self._holds(now))):
            return
        if self._busy() or not self.motion.moving(now):
            self.oscillation.disown()
            return
        self.oscillation.is_ours = False  # there is one try
        self.drive.pause(now)

    # -- questions to the unit --------------------------------------------------------------------

    def _holds(self, now: float) -> list[Coded]:
        """Return all that keeps the frames neutral, apart from the inputs."""
        return [*self.verdict.reasons, *self._busy(), *self.mux.stops(now)]

    def _busy(self) -> list[Coded]:
        busy = [text for request, text in _AT_REST.items() if self._asker.is_open(request)]
        if not self._informed:
            busy.append(_NOT_INFORMED)
        return [*busy, _IN_SETUP] if self._in_setup else busy

    def _questions(self, now: float) -> list[CanFrame]:
        """Return the requests and polls that are due."""
        source, unit = self.settings.source_address, self.finder.address
        frames = []
        # A unit that is being reset announces itself: unasked, or it would be no sign of that.
        resetting = self._asker.is_open(Request.RESET_CONTROLLER)
        if not resetting and self.finder.request_due(now, heard=self.link_up):
            frames.append(protocol.FieldRequest().to_frame(source))
        if self.link_up and self.unit.wants_fault_poll(now):
            self.unit.fault_poll_began(now)
            self._asker.start(Request.POLL_FAULTS, now)
        if unit is None:
            return frames
        messages = self._asker.due(now)
        if self._vista is not None and self.link_up and self._vista.is_due(now):
            messages.append(protocol.VistaPoll())
        return frames + [message.to_frame(source, unit) for message in messages]

    # -- what the unit and its neighbours say -----------------------------------------------------

    def _concerns_us(self, sender: J1939Id, data: bytes) -> bool:
        """Tell whether a frame is for us; PGN EF00 is every maker's own."""
        if sender.pgn == protocol.FIELD_REQUEST_PGN:
            to_unit = sender.destination in (GLOBAL_ADDRESS, self.finder.address)
            return to_unit and data == _NAME_REQUEST
        if sender.pgn != protocol.PROPRIETARY_PGN:
            return sender.pgn == protocol.NAME_PGN or sender.pgn in JOYSTICK_PGNS
        if data[:1] == _PERMISSIVE:
            to_unit = sender.destination in (GLOBAL_ADDRESS, self.finder.address)
            return self.settings.soe_permissive and to_unit
        if sender.source == self.finder.address:
            return self._is_to_us(sender) or data == _SETUP
        return self._is_to_us(sender) and data[:1] in _FROM_ANYONE

    def _is_to_us(self, sender: J1939Id) -> bool:
        return sender.destination in (GLOBAL_ADDRESS, self.settings.source_address)

    def _is_ours(self, sender: J1939Id) -> bool:
        """Tell whether what a frame claims to be is what it must be."""
        return sender.pgn != protocol.PROPRIETARY_PGN or sender.source == self.finder.address

    def _take_proprietary(self, message: protocol.Message, source: int, now: float) -> None:
        if isinstance(message, protocol.AddressAnnouncement):
            self._unit_changed(self.finder.announced(source, message, now))
        if source == self.finder.address:
            if self.finder.heard_after(self._heard.age(now)):
                self.drive.unit_restarted()
                self._disown()
            self._heard.feed(now)
            self._take_status(message, now)
        elif isinstance(message, protocol.DigitalInputs) or (
            isinstance(message, protocol.MiniOutputs) and self.settings.unit_type != MINI_UNIVERSAL
        ):
            self.unit.keep(message, now, neighbour=source)

    def _take_status(self, message: protocol.Message, now: float) -> None:
        """Take what our unit says."""
        self.unit.keep(message, now)
        if isinstance(message, protocol.PositionLimit):
            self.motion.hear_angles(message, now)
            self._emit(events.Positions(message.rotation.radians, message.elevation.radians))
        elif isinstance(message, protocol.RotationSoftLimits):
            self._take_oscillation(message, now)
        elif isinstance(message, protocol.FaultStatus):
            faults = () if message == NO_FAULT else (in_words(message),)
            if faults != self._faults:
                self._faults = faults
                self._emit(events.FaultsChanged(faults))
        if not isinstance(message, protocol.AddressAnnouncement):
            self._emit_all(self._asker.answered(message))
        if self._asker.is_open(Request.RESET_CONTROLLER) and self.finder.is_back(message, now):
            self._in_setup = False
            self._emit_all(self._asker.returned(self.finder.name))

    def _unit_changed(self, text: str) -> None:
        if text:
            pin = '' if self.finder.unit is None else self.finder.unit.pin
            self._emit(events.UnitChanged(text, pin, self.finder.device_type))

    def _emit_all(self, found: Iterable[Event | Answer]) -> None:
        for event in found:
            self._emit(event)

    def _emit_changes(self, *found: Event) -> None:
        """Report each that differs from what was reported last of its kind."""
        for event in found:
            if self._reported.get(type(event)) != event:
                self._reported[type(event)] = event
                self._emit(event)
