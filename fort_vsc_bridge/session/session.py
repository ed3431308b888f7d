"""
What the link to a VSC means over time: manual sections 6 to 9.

Only a fresh heartbeat of the VSC vouches for anything (on HID every report is one). Without one
there is no remote, no stick and no permission, whatever else still comes.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

from bridge_core.session import Pacer
from bridge_core.session import StickStream
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from bridge_core.watchdog import Watchdog
from fort_vsc_bridge.protocol import Axis
from fort_vsc_bridge.protocol import AXIS_NAMES
from fort_vsc_bridge.protocol import Button
from fort_vsc_bridge.protocol import BUTTON_NAMES
from fort_vsc_bridge.protocol import Gps
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import HostHeartbeat
from fort_vsc_bridge.protocol import Joystick
from fort_vsc_bridge.protocol import Key
from fort_vsc_bridge.protocol import Message
from fort_vsc_bridge.protocol import MessageType
from fort_vsc_bridge.protocol import Mode
from fort_vsc_bridge.protocol import PERSISTENT_KEYS
from fort_vsc_bridge.protocol import RemoteStatus
from fort_vsc_bridge.protocol import SerialWire
from fort_vsc_bridge.protocol import TEXT_KEYS
from fort_vsc_bridge.protocol import USER_KEYS
from fort_vsc_bridge.protocol import UserFeedback
from fort_vsc_bridge.protocol import UserFeedbackName
from fort_vsc_bridge.protocol import VALUE_RANGES
from fort_vsc_bridge.protocol import Wire
from fort_vsc_bridge.session.events import Event
from fort_vsc_bridge.session.events import GpsSentence
from fort_vsc_bridge.session.events import ModeChanged
from fort_vsc_bridge.session.events import Output
from fort_vsc_bridge.session.events import RemoteState
from fort_vsc_bridge.session.events import Sticks
from fort_vsc_bridge.session.events import UserValue
from fort_vsc_bridge.session.outbox import Outbox
from fort_vsc_bridge.session.settings import DeviceSettings
from fort_vsc_bridge.session.settings import SettingsKeeper
from fort_vsc_bridge.session.stops import CONNECTED_MODES
from fort_vsc_bridge.session.stops import StopJudge

_NEUTRAL = Sticks()


class Session:
    """
    One VSC on one wire; see bridge_core.transports.link.Session for the contract.

    :param wire: how the VSC is joined; the packet protocol if none is given.
    :param link_timeout: seconds without a heartbeat, or without a joystick message, that count as
        lost. :param heartbeat_rate: Hz of our heartbeat, 4 to 20 (the VSC's own limit is 500 ms).
    :param software_estop_timeout: seconds after which a software e-stop, once in use, counts as
        true when it is not repeated.
    :param configure_device: allow writes to the device's EEPROM.
    :param tolerate_faulty_axes: let the sound controls count although others are broken.
    :param settings: what to set in the device if ``configure_device``.
    :raises ValueError: for a value out of range, or settings that would make the link seem lost
        or that this wire cannot read.
    """

    def __init__(
        self,
        wire: Wire | None = None,
        *,
        link_timeout: float = 0.25,
        heartbeat_rate: float = 20.0,
        software_estop_timeout: float = 0.25,
        configure_device: bool = False,
        tolerate_faulty_axes: bool = False,
        settings: DeviceSettings | None = None,
    ) -> None:
        if not 4.0 <= heartbeat_rate <= 20.0:
            raise ValueError(f'heartbeat_rate must be 4 to 20 Hz, not {heartbeat_rate}')
        self.estop = True
        self.own_estop = True
        self.link_up = False
        self.heartbeat: Heartbeat | None = None  # the last one, while the link is up
        self.remote_status: RemoteStatus | None = None  # while a remote is connected
        self.faulty: tuple[str, ...] = ()  # controls that the last joystick message calls so
        self.looped_back = 0  # frames that only a host sends: the line echoes
        self.software_estop_in_use = False
        self.software_estop_refused = False  # somebody relies on one that this wire has not
        self.wire = wire or SerialWire()
        self.counters = self.wire.counters
        self._configure_device = configure_device
        self._tolerate_faulty_axes = tolerate_faulty_axes
        self._heartbeat_heard = Watchdog(link_timeout)
        self._joystick_heard = Watchdog(link_timeout)
        self._software_estop = False
        self._software_estop_heard = Watchdog(software_estop_timeout)
        self._judge = StopJudge()
        self._verdict = Verdict()
        self._verdict_stands = False  # later heartbeats of the same read only make it worse
        self._open = False
        self._leaving = False
        self._pacer = Pacer(1.0 / heartbeat_rate)
        self._sent_stop = False
        self._stream = StickStream()
        self._outbox = Outbox(self.wire)
        self._settings = self._keeper(settings or DeviceSettings(), link_timeout)

    def _keeper(self, settings: DeviceSettings, link_timeout: float) -> SettingsKeeper:
        """Return who sets the device. :raises ValueError: settings that cannot be."""
        _check_intervals(settings, link_timeout)
        wanted = settings if self._configure_device else DeviceSettings()
        keeper = SettingsKeeper(wanted, self._outbox)
        if not self.wire.carries(MessageType.USER_FEEDBACK_GET):
            _refuse_settings(keeper.states, self.wire)
        return keeper

    # -- the link thread's side ------------------------------------------------------------------

    def opened(self, now: float) -> Output:
        """Begin with a new port: nothing was heard yet, and our heartbeat goes first."""
        self._forget()
        self._open, self._leaving = True, False
        if self.wire.carries(MessageType.HOST_HEARTBEAT):
            self._pacer.start(now)
        events: list[Event] = []
        self._refresh(now, events)
        return events, self._heartbeat_frames(now)

    def closed(self, now: float) -> list[Event]:
        """Forget all that was heard."""
        self._forget()
        self._open = False
        self._pacer.stop()
        self._outbox.port_closed()
        events: list[Event] = []
        self._refresh(now, events)
        return events

    def receive(self, data: Any, now: float) -> Output:
        """Take bytes or a frame, as they came. Frames to send come from poll."""
        events: list[Event] = []
        if self._open:
            self._refresh(now, events)  # what went stale before this came
            for message in self.wire.feed(data, now):
                self._take(message, now, events)
            self._refresh(now, events)
        return events, []

    def poll(self, now: float) -> Output:
        """Do what is due."""
        events: list[Event] = []
        if not self._open:
            return events, []
        self._refresh(now, events)
        for message in self.wire.poll(now):
            self._take(message, now, events)
        self._verdict_stands = False  # all that was read at once has been taken
        self._refresh(now, events)
        if self.link_up:
            self._settings.poll(now, remote_connected=self.remote_connected)
        return events, self._heartbeat_frames(now) + self._outbox.take(now)

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if not self._open:
            return math.inf
        due = [self._pacer.due, self.wire.deadline, self._outbox.deadline]
        if self.link_up:
            due += [self._heartbeat_heard.deadline, self._settings.deadline]
        if self._stream.streaming:
            due.append(self._joystick_heard.deadline)
        if self.software_estop_in_use and not self._sent_stop:
            due.append(self._software_estop_heard.deadline)
        return min(due)

    def farewell(self, now: float) -> list[Any]:
        """
        Return a heartbeat that asks for a stop if the software e-stop is in use, else nothing.

        A node that is not part of the stop chain must not trip the machine by being stopped.
        """
        if not (self._open and self.software_estop_in_use):
            return []
        self._leaving = True
        return self._heartbeat_frames(now, at_once=True)

    # -- what is known ---------------------------------------------------------------------------

    @property
    def mode(self) -> Mode | int | None:
        """The VSC's mode, a plain int if it is an unknown one; None without a fresh heartbeat."""
        return None if self.heartbeat is None else self.heartbeat.mode

    @property
    def remote_connected(self) -> bool:
        """The fresh heartbeat's mode is one that needs a remote (manual 6.1 to 6.5)."""
        return self.mode in CONNECTED_MODES

    @property
    def operational(self) -> bool:
        """Sticks count: Operational by a fresh heartbeat, and no stop."""
        return self.mode == Mode.OPERATIONAL and not self._verdict.estop

    @property
    def setting_states(self) -> dict[str, str]:
        """State in words of every wanted setting of the device; empty unless configured."""
        return self._settings.states

    def frame_age(self, now: float) -> float:
        """Return the seconds since a heartbeat or a joystick message; infinite if never."""
        return min(self.heartbeat_age(now), self.joystick_age(now))

    def heartbeat_age(self, now: float) -> float:
        """Return the seconds since a heartbeat was heard on this port; infinite if never."""
        return self._heartbeat_heard.age(now)

    def joystick_age(self, now: float) -> float:
        """Return the seconds since a joystick message was heard on this port."""
        return self._joystick_heard.age(now)

    def stop_reasons(self, now: float) -> list[str]:
        """Say why ``estop`` is true, and what to do; empty if it is false."""
        if not self._open:
            return ['the port to the VSC is not open; plug the VSC in, check the parameter port']
        if self.link_up:
            return list(self._verdict.reasons)
        text = f'no {self.wire.SIGN_OF_LIFE}: {self._heartbeat_heard.describe(now)}; '
        if not self._joystick_heard.expired(now):
            return [f'{text}joystick messages do come: {self.wire.JOYSTICK_ONLY}']
        return [text + self.wire.SILENCE]

    # -- requests --------------------------------------------------------------------------------

    def set_software_estop(self, value: bool, now: float) -> None:
        """
        Ask the VSC to stop, or not to; from the first call on, silence is a stop too.

        :raises ValueError: this wire cannot carry it.
        """
        self.software_estop_refused = not self.wire.carries(MessageType.HOST_HEARTBEAT)
        self.wire.require(MessageType.HOST_HEARTBEAT)
        self.software_estop_in_use = True
        self._software_estop = value
        self._software_estop_heard.feed(now)

    def check_feedback(self, key: int, value: int) -> None:
        """Raise the ValueError that set_feedback would raise; changes nothing, any thread."""
        self.wire.require(MessageType.USER_FEEDBACK)
        if key not in VALUE_RANGES:
            raise ValueError(f'key {key} takes no value; keys are 1-12, 80-85, 99')
        if key in PERSISTENT_KEYS and not self._configure_device:
            raise ValueError(f'key {key} is kept in EEPROM; it needs configure_device')
        low, high = VALUE_RANGES[key]
        if not low <= value <= high:
            raise ValueError(f'key {key} takes {low} to {high}, not {value}')
        self.wire.check(UserFeedback(key, value))

    def check_name(self, key: int, name: str) -> None:
        """Raise the ValueError that set_name would raise; changes nothing, any thread."""
        self.wire.require(MessageType.USER_FEEDBACK_NAME)
        if key not in USER_KEYS and key not in TEXT_KEYS:
            raise ValueError(f'key {key} has no name; keys are 1-9, 90-93')
        self.wire.check(UserFeedbackName(key, name))

    def check_key(self, key: int) -> None:
        """Raise the ValueError that get_feedback would raise; changes nothing, any thread."""
        self.wire.require(MessageType.USER_FEEDBACK_GET)
        if key not in VALUE_RANGES:
            raise ValueError(f'key {key} cannot be asked for; keys are 1-12, 80-85, 99')

    def check_display_text(self, text: str) -> None:
        """Raise the ValueError that set_display_text would raise; changes nothing, any thread."""
        self.wire.require(MessageType.USER_FEEDBACK_NAME)
        for message in _text_lines(text):
            self.wire.check(message)

    def set_feedback(self, key: int, value: int) -> None:
        """Queue a value for a key. :raises ValueError: key, value, or EEPROM not allowed."""
        self.check_feedback(key, value)
        self._outbox.set_value(key, value)

    def set_name(self, key: int, name: str) -> None:
        """Queue a user value's name (keys 1-9) or a line of text (90-93), else ValueError."""
        self.check_name(key, name)
        self._outbox.set_name(key, name)

    def set_display_text(self, text: str) -> None:
        """
        Queue up to 4 lines of up to 20 characters (CAN: 18); lines not given are blanked.

        Switches the remote to its text display unless a display mode (key 99) was set before.

        :raises ValueError: for too many lines, or a line too long or not printable ASCII.
        """
        self.check_display_text(text)
        for message in _text_lines(text):
            self._outbox.set_name(message.key, message.name)
        if not self._outbox.shows(Key.DISPLAY_MODE):
            self._outbox.set_value(Key.DISPLAY_MODE, 1)

    def get_feedback(self, key: int) -> None:
        """Queue a question for a key's value; a UserValue event answers; else ValueError."""
        self.check_key(key)
        self._outbox.get_value(key)

    def rumble(self, *, left: bool, right: bool) -> None:
        """
        Drive the remote's motors for 750 ms; it cannot be ended early (table 24).

        :raises ValueError: this wire cannot carry it.
        """
        self.wire.require(MessageType.USER_FEEDBACK)
        if left and right:
            self._outbox.set_value(Key.BOTH_VIBRATION, 1)
        elif left or right:
            self._outbox.set_value(Key.LEFT_VIBRATION if left else Key.RIGHT_VIBRATION, 1)

    # -- inside ----------------------------------------------------------------------------------

    def _forget(self) -> None:
        self.wire.reset()
        self._verdict_stands = False
        self._heartbeat_heard.reset()
        self._joystick_heard.reset()
        self._settings.forget()

    def _take(self, message: Message, now: float, events: list[Event]) -> None:
        """Hand a message to whom it concerns."""
        self._settings.heard(message.TYPE, now)
        if isinstance(message, Joystick):
            self._take_joystick(message, now, events)
        elif isinstance(message, Heartbeat):
            self._take_heartbeat(message, now, events)
        else:
            self._take_other(message, now, events)

    def _take_heartbeat(self, heartbeat: Heartbeat, now: float, events: list[Event]) -> None:
        verdict = self._judge.judge(heartbeat, now)
        # Two heartbeats in one read: a stop in the first is not undone by the second, or nobody
        # would ever learn of it.
        self._verdict = self._verdict.worst(verdict) if self._verdict_stands else verdict
        self._verdict_stands = True
        self._heartbeat_heard.feed(now)
        changed = heartbeat.mode != self.mode
        was_connected = self.remote_connected
        self.heartbeat = heartbeat
        self._refresh(now, events)
        if changed:
            events.append(ModeChanged(heartbeat.mode))
        if self.remote_connected and not was_connected:
            self._outbox.show_again()

    def _take_joystick(self, message: Joystick, now: float, events: list[Event]) -> None:
        self._joystick_heard.feed(now)
        if not self.link_up:
            return
        sticks = self._sticks_of(message)
        self.faulty = sticks.faulty
        self._stream.told(counts=sticks.operational)
        events.append(sticks)

    def _sticks_of(self, message: Joystick) -> Sticks:
        if not self.operational:
            return _NEUTRAL  # the VSC zeroes the whole message: nothing in it is the remote's
        controls: tuple[Axis | Button, ...] = message.axes + message.buttons
        faulty = tuple(
            f'{name} {control.state.value}'
            for name, control in zip(AXIS_NAMES + BUTTON_NAMES, controls, strict=True)
            if control.value is None
        )
        if faulty and not self._tolerate_faulty_axes:
            return Sticks(operational=True, faulty=faulty)
        return Sticks(
            axes=tuple(axis.value or 0 for axis in message.axes),
            buttons=tuple(button.value or False for button in message.buttons),
            operational=True,
            faulty=faulty,
        )

    def _take_other(self, message: Message, now: float, events: list[Event]) -> None:
        if isinstance(message, RemoteStatus):
            if self.remote_connected:  # else it is that of a remote long gone (7.3.3)
                self.remote_status = message
                events.append(RemoteState(message))
        elif isinstance(message, Gps):
            events.append(GpsSentence(message.source, message.sentence.strip('\r\n\0 ')))
        elif isinstance(message, UserFeedback):
            self._settings.answered(message.key, message.value, now)
            events.append(UserValue(message.key, message.value))
        else:
            self.looped_back += 1

    def _refresh(self, now: float, events: list[Event]) -> None:
        """Bring all that depends on freshness up to date; tell what changed, stops first."""
        link_was_up = self.link_up
        before = (self.estop, self.own_estop, self.link_up)
        self.link_up = self._open and not self._heartbeat_heard.expired(now)
        self.estop = not self.link_up or self._verdict.estop
        self.own_estop = not self.link_up or self._verdict.own_estop
        if before != (self.estop, self.own_estop, self.link_up):
            events.append(StopChanged(self.estop, self.own_estop, self.link_up))
        if not self.link_up and self.heartbeat is not None:
            self.heartbeat = None
            events.append(ModeChanged(None))
        if self.link_up is not link_was_up:
            self._settings.link_changed(self.link_up, now)
        self._refresh_sticks(now, events)
        if self.remote_status is not None and not self.remote_connected:
            self.remote_status = None
            events.append(RemoteState(None))

    def _refresh_sticks(self, now: float, events: list[Event]) -> None:
        """Follow up what was published with a neutral event once it does not hold any more."""
        fresh = self.link_up and not self._joystick_heard.expired(now)
        if self._stream.owes_neutral(fresh=fresh, counts=self.operational):
            self.faulty = ()
            events.append(_NEUTRAL)

    def _heartbeat_frames(self, now: float, *, at_once: bool = False) -> list[Any]:
        """Return our heartbeat when it is due; a stop does not wait for that."""
        stale = self._software_estop_heard.expired(now)
        stop = self.software_estop_in_use and (self._software_estop or stale or self._leaving)
        if not (at_once or self._pacer.is_due(now) or (stop and not self._sent_stop)):
            return []
        self._pacer.sent(now)
        self._sent_stop = stop
        self._judge.asked(stop, now)
        return self.wire.frames(HostHeartbeat(stop))


def _check_intervals(settings: DeviceSettings, link_timeout: float) -> None:
    """Refuse what would make the link seem lost: one missing message must not be a stop."""
    for name in ('joystick_interval_ms', 'heartbeat_interval_ms'):
        interval = getattr(settings, name)
        if interval is not None and 2e-3 * interval > link_timeout:
            limit = f'half of link_timeout ({link_timeout} s)'
            raise ValueError(f'{name} must not be above {limit}, but is {interval}')


def _refuse_settings(wanted: Iterable[str], wire: Wire) -> None:
    """Refuse what would have to be written blindly."""
    for name in wanted:
        raise ValueError(f'{name}: transport {wire.NAME} cannot read it; set it over serial')


def _text_lines(text: str) -> list[UserFeedbackName]:
    lines = text.splitlines()
    if len(lines) > len(TEXT_KEYS):
        raise ValueError(f'the display has {len(TEXT_KEYS)} lines, not {len(lines)}')
    lines += [''] * (len(TEXT_KEYS) - len(lines))
    return [UserFeedbackName(key, line) for key, line in zip(TEXT_KEYS, lines, strict=True)]
