# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

import math
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.session import Level, Pacer, Session as BaseSession, StickStream, Verdict
from bridge_core.watchdog import RateWatch, Watchdog
from fort_vsc_bridge.display_texts import MuxStatus
from fort_vsc_bridge.protocol.frames import MessageType, Received, Rejected
from fort_vsc_bridge.protocol.messages import (
    Gps,
    Heartbeat,
    HostHeartbeat,
    Joystick,
    RemoteStatus,
    SetupString,
    text_lines,
    UserFeedback,
    UserFeedbackGet,
    UserFeedbackName,
)
from fort_vsc_bridge.protocol.values import (
    check_value,
    CONNECTED_MODES,
    Key,
    Mode,
    PERSISTENT_KEYS,
    TEXT_KEYS,
    USER_KEYS,
    VALUE_RANGES,
)
from fort_vsc_bridge.protocol.wires import Frame
from fort_vsc_bridge.session import report
from fort_vsc_bridge.session.device import Configurator
from fort_vsc_bridge.session.events import Event, GpsSentence, ModeChanged, RemoteState, UserValue
from fort_vsc_bridge.session.identity import IdentityReader
from fort_vsc_bridge.session.line_age import AGE_KEY, LineAge
from fort_vsc_bridge.session.send_queue import SendQueue
from fort_vsc_bridge.session.settings import Settings
from fort_vsc_bridge.session.software_stop import SoftwareStop
from fort_vsc_bridge.session.status_display import StatusDisplay
from fort_vsc_bridge.session.stick_reader import NEUTRAL, StickReader
from fort_vsc_bridge.session.stops import StopJudge

_LATELY = 3.0  # seconds for which what came once is named, and a line counts as looped
_LONGEST_INTERVAL = 65.535  # seconds between two remote status messages (7.3.5)
_STATUS_INTERVALS = 3  # that may pass without one
_SHORTEST_STATUS_TIME = 5.0  # seconds
_AGE_QUESTION = UserFeedbackGet(AGE_KEY)
_AGE_FRAME = _AGE_QUESTION.to_bytes()


class Session(BaseSession[Frame, Received, Event]):
    """One VSC on one wire; see bridge_core.session."""

    HELD = 'sticks are 0'
    CLOSED = Coded(
        'fort.port.closed', 'plug the VSC in, and check port (can: channel): it is not open'
    )

    def __init__(self, settings: Settings) -> None:
        wire, timeout = settings.wire, settings.link_timeout
        super().__init__(wire.decoder(timeout), timeout)
        self.settings = settings
        self.DAMAGED = wire.DAMAGED
        self.remote_status: RemoteStatus | None = None  # while a remote is connected
        self.faulty: tuple[str, ...] = ()  # controls that the last joystick message calls so
        self.looped_back = 0  # frames that only a host sends: the line echoes
        self.rejected = 0  # frames that are not the VSC's, or of a firmware that is not known
        self.software_estop_refused = False  # somebody relies on one that this wire has not
        self._newest: Heartbeat | None = None
        self._said: Heartbeat | None = None  # as emitted
        self._connected_at = -math.inf  # a remote, the last time
        self._rejection = ''  # why the last one was, and what to do
        self._rejected_lately = Watchdog(_LATELY)
        self._looped_back_lately = Watchdog(_LATELY)
        self._remote_status_at = self._remote_expires_at = -math.inf
        self._joystick_heard = Watchdog(timeout)
        self._joystick_alone = False  # it comes, and the heartbeat does not
        self._settled_at = math.inf  # long enough after the link came up, or was opened, or lost
        self._stream = StickStream()
        # The heartbeat that says why the VSC zeroes its buttons may be the first one that is lost.
        self._sticks = StickReader(2.0 * timeout, tolerate=settings.tolerate_faulty_axes)
        self._judgement = StopJudge(settings.transition_time)
        rate = settings.wire.most_heartbeats
        self._rate = RateWatch(rate) if math.isfinite(rate) else None
        limit, wire = settings.line_age_limit, settings.wire
        self._line = LineAge(limit, wire.INTERVAL) if wire.queues and limit else None
        self._asked_age = False  # somebody else asked for the value of that key
        self._stop = SoftwareStop(
            settings.software_estop_timeout, required=settings.require_software_estop
        )
        self._offered: tuple[Frame, str] | None = None  # our heartbeat, what ends the stop in it
        period = 1.0 / settings.heartbeat_rate
        self._pacer = Pacer(period, early=period / 4)
        self._queue = SendQueue(wire)
        shows = settings.show_status
        self._display = StatusDisplay(self._queue, settings.wire.check) if shows else None
        self._device = Configurator(settings.to_configure, self._queue)
        self._identity = IdentityReader(self._queue, wanted=settings.read_identity)

    # What is known.

    @property
    def heartbeat(self) -> Heartbeat | None:
        """The newest one, while it is fresh."""
        return self._newest if self.verdict.link_up else None

    @property
    def mode(self) -> Mode | int | None:
        """The VSC's mode, a plain int if it is an unknown one; None without a fresh heartbeat."""
        return self.heartbeat.mode if self.heartbeat else None

    @property
    def remote_connected(self) -> bool:
        """The fresh heartbeat's mode is one that needs a remote (manual 6.1 to 6.5)."""
        return self.mode in CONNECTED_MODES

    @property
    def operational(self) -> bool:
        """Sticks count: Operational by a fresh heartbeat, and no stop."""
        return self.mode == Mode.OPERATIONAL and not self.verdict.estop

    def as_of(self, now: float) -> float:
        """Return when the newest heartbeat was said, at the earliest."""
        if self._line is not None:
            return self._line.said_at
        return -math.inf if self.settings.wire.queues else now - self._heard.age(now)

    @property
    def setting_states(self) -> dict[str, str]:
        """State in words of every wanted setting of the device; empty unless configured."""
        return self._device.states

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return stops, broken controls, what does not come or is not set, and a low battery."""
        wire = self.settings.wire
        problems = super().problems(now)
        if self.faulty:
            text = f'have the remote repaired: it reports {", ".join(self.faulty)}'
            problems.append((Level.ERROR, Coded('fort.stick.faulty', text)))
        if self.link_up and not self._rejected_lately.expired(now):
            problems.append((Level.ERROR, Coded('fort.link.foreign', self._rejection)))
        if self.link_up and now >= self._settled_at:
            if self._judgement.awaits_stop and not self.estop:
                problems.append((Level.ERROR, report.DEAF))
            if self._joystick_heard.expired(now):
                text = f'{wire.NO_JOYSTICK}: no joystick messages come'
                problems.append((Level.WARN, Coded('fort.link.no_joystick', text)))
        problems += report.line_problems(self._line, queues=wire.queues)
        problems += report.remote_problems(self.remote_status)
        problems += report.setting_problems(self.setting_states, self.settings.passed_over)
        if self.software_estop_refused:
            text = (
                f'wire that stop elsewhere: transport {wire.NAME} cannot carry software_estop, '
                'but it comes, and the VSC does not stop'
            )
            problems.append((Level.ERROR, Coded('fort.stop.not_carried', text)))
        if not self._looped_back_lately.expired(now):
            problems.append((Level.WARN, report.LOOPED_BACK))
        return problems

    def summary(self) -> str:
        """Return 'ok', and why the sticks are zeroed."""
        return '; '.join(['ok', *report.quiet_because(self.heartbeat)])

    def inhibits(self, now: float) -> list[Coded]:
        """Return why the sticks are zeroed though nothing is a stop."""
        del now
        return report.quiet_because(self.heartbeat)

    def values(self, now: float) -> dict[str, Any]:
        """Return heartbeat, faulty controls, battery and settings."""
        connected_for = now - self._connected_at if self.remote_connected else 0.0
        return {
            **report.heartbeat_values(self.heartbeat),
            'remote connected': self.remote_connected,
            'software e-stop in use': self._stop.in_use,
            'faulty controls': ', '.join(self.faulty) or 'none',
            **({'shown on the remote': ' / '.join(self._display.lines)} if self._display else {}),
            'rejected frames': self.rejected,
            'own frames that came back': self.looped_back,
            **report.line_values(self._line, now),
            **self._identity.values,
            **{f'setting {name}': state for name, state in self.setting_states.items()},
            **report.remote_values(self.remote_status),
            'remote status message': report.remote_status_state(
                self.remote_status, connected_for, self.settings.wire.NO_REMOTE_STATUS
            ),
        }

    # The link's side; the base has the rest.

    def farewell(self, now: float) -> list[Frame]:
        """
        Return a heartbeat that asks for a stop if the software e-stop is in use.

        A node that is not part of the stop chain must not trip the machine by being stopped. What
        is shown of the mux is taken off the display behind it, even sooner than table 17 allows:
        there is no later moment.
        """
        frames: list[Frame] = []
        if self._open and self._stop.in_use:
            self._stop.leaving = True
            frames += self._heartbeat_frames(now, at_once=True)
        if self._open and self._display is not None and self._display.lines:
            frames += self.settings.wire.frames(UserFeedback(Key.DISPLAY_MODE, 0))
        return frames

    def sent(self, frame: Frame, now: float) -> None:
        """Count our heartbeat, or what waited in the queue, as sent."""
        if self._offered is not None and frame is self._offered[0]:
            _, remedy = self._offered
            self._pacer.sent(now)
            self._stop.sent(remedy)
            self._judgement.asked(remedy, now)
        else:
            self._queue.sent(frame, now)
            if self._line is not None and frame == _AGE_FRAME:
                self._line.asked(now)

    def _begin(self, now: float) -> None:
        self._stop.opened()
        self._judgement.asked('', now)
        self._joystick_alone = False
        self._settled_at = now + self.settings.link_timeout
        self._queue.drop_passing()  # asked while the port was closed, perhaps of another VSC
        if self._display is not None:
            self._display.begin(now)
        if self._line is not None:
            self._line.begin(now)
        if self.settings.wire.carries(MessageType.HOST_HEARTBEAT):
            self._pacer.start(now)

    def _forget(self, now: float, reason: str) -> None:
        del now, reason
        self._joystick_heard.reset()
        self._device.look_anew()
        self._queue.drop_passing()

    def _take(self, message: Received, now: float) -> None:
        if isinstance(message, Rejected):
            self.rejected += 1
            self._rejection = message.text
            self._rejected_lately.feed(now)
            return
        if watch := self._device.watches.get(message.TYPE):
            watch.heard(now)
        if isinstance(message, Heartbeat):
            self._newest = message
            self._heard.feed(now)
            self._judgement.heard(message, now)
            if self._line is not None:
                self._line.heard(now)
            if self._rate is not None:
                self._rate.feed(now)
        elif isinstance(message, Joystick):
            self._take_joystick(message, now)
        elif isinstance(message, RemoteStatus):
            if self.remote_connected:  # else it is that of a remote long gone (7.3.3)
                self._take_remote_status(message, now)
        elif isinstance(message, Gps):
            if self.link_up:
                self._events.append(GpsSentence(message.source, message.sentence.strip('\r\n\0 ')))
        elif isinstance(message, UserFeedback):
            # On a line that loops it may be one of ours, which looks the same (table 17).
            if self._looped_back_lately.expired(now):
                self._take_value(message, now)
        elif isinstance(message, SetupString):
            self._identity.answered(message)
        else:
            self.looped_back += 1
            self._looped_back_lately.feed(now)

    def _take_value(self, message: UserFeedback, now: float) -> None:
        asked = True
        if self._line is not None and message.key == AGE_KEY:
            self._line.answered(now)
            asked, self._asked_age = self._asked_age, False
        if not self.link_up:
            return
        if setting := self._device.keys.get(message.key):
            setting.answered(message.value, now)
        if asked:
            self._events.append(UserValue(message.key, message.value))

    def _take_remote_status(self, message: RemoteStatus, now: float) -> None:
        """Take it for as long as a few more of them take: their interval is the device's."""
        gap = min(now - self._remote_status_at, _LONGEST_INTERVAL)
        self._remote_status_at = now
        self._remote_expires_at = now + max(_STATUS_INTERVALS * gap, _SHORTEST_STATUS_TIME)
        self.remote_status = message
        self._events.append(RemoteState(message))

    def _take_joystick(self, message: Joystick, now: float) -> None:
        self._joystick_heard.feed(now)
        # Not the last ones of a VSC that falls silent, nor the first of one that was just found.
        self._joystick_alone = not self.link_up and now >= self._settled_at
        if not self.link_up:
            return
        sticks = self._sticks.read(
            message, now, operational=self.operational, stopped=self.verdict.estop
        )
        self.faulty = sticks.faulty
        self._stream.published(counts=sticks.operational)
        self._events.append(sticks)

    def _judge(self, now: float) -> Verdict:
        """Return what the newest heartbeat says; what this node asked comes back as an echo."""
        assert self._newest is not None
        verdict = self._judgement.judge(self._newest, now)
        reasons: list[Coded] = []
        if self._rate is not None and self._rate.exceeded(now):
            reasons.append(report.TWO_VSCS)
        if self._line is not None and self._line.is_late(now):
            reasons.append(report.late(self._line, now))
        return Verdict.stop(*reasons, *verdict.reasons) if reasons else verdict

    def _silence(self, now: float) -> Coded:
        wire = self.settings.wire
        what, to_do = 'silent', wire.SILENCE
        if not self._rejected_lately.expired(now):
            what, to_do = 'foreign', self._rejection
        elif wire.GARBLED and self._garbled(now):
            what, to_do = 'garbled', wire.GARBLED
        elif self._joystick_alone and not self._joystick_heard.expired(now):
            what, to_do = 'no_heartbeat', wire.JOYSTICK_ONLY
        text = f'{to_do}: no {wire.SIGN_OF_LIFE}, {self._heard.describe(now)}'
        return Coded(f'fort.link.{what}', text)

    def _follow(self, now: float) -> None:
        newest, stopped = self.heartbeat, self.verdict.estop
        before, self._said = self._said, newest
        if (newest is None) is not (before is None):
            self._settled_at = now + self.settings.link_timeout
            self._device.link_changed(newest is not None, now)
            self._identity.link_changed(newest is not None, now)
        if newest != before:
            self._events.append(ModeChanged(newest))
        if stopped:
            self._sticks.miss(now, stopped=True)
        fresh = newest is not None and not self._joystick_heard.expired(now)
        if self._stream.owes_neutral(fresh=fresh, counts=self.operational):
            self.faulty = ()
            self._events.append(NEUTRAL)
            if not stopped:
                self._sticks.miss(now, stopped=False)
        connected = self.remote_connected
        if connected and (before is None or before.mode not in CONNECTED_MODES):
            self._connected_at = now
            self._queue.show_again()
        if self.remote_status is not None and not (connected and now < self._remote_expires_at):
            self.remote_status = None
            self._events.append(RemoteState(None))

    def _expires_at(self) -> float:
        moments = [super()._expires_at()]
        if not self.own_estop:
            moments.append(self._judgement.becomes_own_at)
        if self._stream.streaming:
            moments.append(self._joystick_heard.deadline)
        if self.remote_status is not None:
            moments.append(self._remote_expires_at)
        if self._rate is not None and self._rate.exceeded(self._stepped_at):
            moments.append(self._rate.until)
        if self._line is not None:
            moments.append(self._line.changes_at(self._stepped_at))
        return min(moments)

    def _sends_at(self) -> float:
        due = [self._pacer.due, self._queue.deadline, self._stop.deadline]
        if self._display is not None:
            due.append(self._display.deadline)
        if self.verdict.link_up:
            due += [self._device.deadline, self._identity.due]
        if self._line is not None and not self._queue.has(_AGE_QUESTION):
            due.append(self._line.ask_at)
        return min(due)

    def _due_frames(self, now: float) -> list[Frame]:
        if self.verdict.link_up:
            self._device.poll(now, remote_connected=self.remote_connected)
            self._identity.poll(now)
        if self._line is not None and now >= self._line.ask_at:
            self._queue.put_first(_AGE_QUESTION)
        if self._display is not None:
            self._display.poll(now)
        return self._heartbeat_frames(now) + self._queue.due(now)

    def _heartbeat_frames(self, now: float, *, at_once: bool = False) -> list[Frame]:
        """Return our heartbeat when it is due; a stop does not wait for that."""
        if not (at_once or self._pacer.is_due(now) or self._stop.is_new(now)):
            return []
        remedy = self._stop.offer(now)
        frames = self.settings.wire.frames(HostHeartbeat(bool(remedy)))
        self._offered = frames[0], remedy
        return frames

    # What the node asks.

    def expect_software_estop(self) -> None:
        """Ask for a stop from the first heartbeat on, as with ``require_software_estop``."""
        if self.settings.wire.carries(MessageType.HOST_HEARTBEAT):
            self._stop.in_use = True

    def set_software_estop(self, value: bool, now: float) -> None:
        """
        Ask the VSC to stop, or not to; from the first call on, silence is a stop too.

        With ``require_software_estop`` it is a stop before the first call as well.

        :raises ValueError: this wire cannot carry it.
        """
        self._expire(now)
        self.software_estop_refused = not self.settings.wire.carries(MessageType.HOST_HEARTBEAT)
        self.settings.wire.require(MessageType.HOST_HEARTBEAT)
        self._stop.want(value, now)

    def forget_software_estop(self, now: float) -> None:
        """Be as before the first call of ``set_software_estop``."""
        self._expire(now)
        self.software_estop_refused = False
        self._stop.forget_topic()

    def set_feedback(self, key: int, value: int, now: float) -> None:
        """Queue a value for a key. :raises ValueError: key, value, or EEPROM not allowed."""
        self._expire(now)
        if key in PERSISTENT_KEYS and not self.settings.configure_device:
            raise ValueError(f'key {key} is kept in EEPROM; it needs configure_device')
        check_value(key, value)
        self._queue.put(UserFeedback(key, value))
        if self._open and key in self._device.keys:  # else it is dropped, and overrules nothing
            self._device.keys[key].overrule(value, now)

    def set_name(self, key: int, name: str, now: float) -> None:
        """Queue a user value's name (keys 1-9) or a line of text (90-93), else ValueError."""
        self._expire(now)
        if key not in USER_KEYS and key not in TEXT_KEYS:
            raise ValueError(f'key {key} has no name; keys are 1-9, 90-93')
        self._show([UserFeedbackName(key, name)], now)

    def hear_status(self, status: MuxStatus, now: float) -> None:
        """Show what the mux says on the remote; with the parameter ``show_status`` only."""
        self._expire(now)
        assert self._display is not None
        self._display.hear(status, now)

    def set_display_text(self, text: str, now: float) -> None:
        """
        Queue up to 4 lines of up to 20 characters (CAN: 18); lines not given are blanked.

        Switches the remote to its text display unless a display mode (key 99) was set before. With
        ``show_status`` they are shown while the mux is ACTIVE.

        :raises ValueError: for too many lines, or a line too long or not printable ASCII.
        """
        self._expire(now)
        self._show(text_lines(text), now)
        if not self._queue.shows(Key.DISPLAY_MODE):
            self._queue.put(UserFeedback(Key.DISPLAY_MODE, 1))

    def _show(self, messages: list[UserFeedbackName], now: float) -> None:
        if self._display is not None and messages[0].key in TEXT_KEYS:
            self._display.take_text(messages, now)
        else:
            self._queue.put(*messages)

    def get_feedback(self, key: int, now: float) -> None:
        """Queue a question for a key's value; a UserValue event answers; else ValueError."""
        self._expire(now)
        if key not in VALUE_RANGES:
            raise ValueError(f'key {key} cannot be asked for; keys are 1-12, 80-85, 99')
        self._asked_age |= key == AGE_KEY
        self._queue.put(UserFeedbackGet(key))

    def rumble(self, left: bool, right: bool, now: float) -> None:
        """
        Drive the remote's motors for 750 ms; it cannot be ended early (table 24).

        :raises ValueError: this wire cannot carry it.
        """
        self._expire(now)
        if left or right:
            one = Key.LEFT_VIBRATION if left else Key.RIGHT_VIBRATION
            self._queue.put(UserFeedback(Key.BOTH_VIBRATION if left and right else one, 1))
