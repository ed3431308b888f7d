# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import math
from typing import Any

from bridge_core.actuator import ActuatorSession
from bridge_core.gate import Gate, LEAVING, Policy
from bridge_core.mux_words import MuxWords
from bridge_core.reasons import Coded
from bridge_core.session import Level, Verdict
from bridge_core.watchdog import Watchdog
from ssc_bridge.channels import AuxRequest
from ssc_bridge.protocol import (
    AuxFunction,
    AuxInputs,
    AuxOutputs,
    CommandState,
    Configuration,
    Lockout,
    MAX_OUTPUTS,
    Message,
    MessageType,
    parser,
    Poll,
    PulseCommand,
    PulseInputs,
    PulseOutputs,
    REPEATED,
    Selection,
    Source,
    Status,
)
from ssc_bridge.session import report
from ssc_bridge.session.auxiliary import AuxInputTotals, AuxOutputCommands
from ssc_bridge.session.events import (
    AuxReading,
    CommandStateChanged,
    ConfigurationRead,
    Event,
    FailsafeBegun,
    OutputsSent,
    PulsesIn,
    PulsesOut,
    SourcesChanged,
)
from ssc_bridge.session.outputs import Outputs, OutputState, RELEASE_FRAMES
from ssc_bridge.session.polling import LockoutRequest, Poller
from ssc_bridge.session.settings import Settings
from ssc_bridge.session.sticks import PublishedSticks
from ssc_bridge.session.stops import another, Checked, command_stop, contradiction, doubts

_CONFIGURATION_RATE = 4.0  # Hz, until the device answers
_AT_START = (MessageType.STATUS, MessageType.CONFIGURATION)
_MAX_POSITION = 1.05  # what rounding may add to 1; more is another unit
_ECHO_MEMORY = 5.0  # s for which an echoed frame is a warning
_LOCKED = 'the configuration menus are locked out'
_NOT_LOCKED = (
    'the SSC does not lock its configuration out: enable "On Rcv Msg 98" in its menu Config '
    'Lockout; it locks out by itself 5 s after power-on'
)


class Session(ActuatorSession[bytes, Message | Poll, Event]):
    """One SSC on one port; see bridge_core.session."""

    CLOSED = Coded(
        'port.closed', 'the port to the SSC is not open; plug it in, check the parameter port'
    )
    HELD = 'outputs at failsafe'

    def __init__(self, settings: Settings, mux: MuxWords | None = None) -> None:
        super().__init__(parser(settings.baud), settings.link_timeout, mux)
        self.settings = settings
        self.status: Status | None = None  # the newest, while the link is up
        self.configuration: Configuration | None = None  # of what is, or was last, on this port
        self.selections: tuple[Selection, ...] = ()  # sources of the outputs, while the link is up
        self.mismatches = 0  # messages that contradict the configuration
        self.unchecked = 0  # messages that came before the configuration was known
        self.refused_commands = 0
        self.looped_back = 0  # frames that only a host sends: the line echoes
        self.echo = Watchdog(_ECHO_MEMORY)
        self.outputs = Outputs(settings)
        self._told: tuple[OutputState, ...] = ()  # of them, to the session after this one
        self.is_commanded = bool(settings.servos)  # somebody is to command outputs, or did
        rates = dict(zip(REPEATED, settings.poll_rates, strict=True))
        self._poller = Poller({**rates, MessageType.CONFIGURATION: _CONFIGURATION_RATE})
        self.sticks = PublishedSticks(settings)
        self.gate = Gate(Policy(stop=settings.command_timeout))  # to all that may be commanded
        self._confirmed = False  # the configuration was read, and nothing contradicted it since
        self._settled_at = math.inf  # long enough after it was for pulse inputs to have come
        self._contradictions: dict[MessageType, str] = {}  # of the newest message of each type
        self._published: CommandState | None = None
        self._published_sources: tuple[Selection, ...] = ()
        self._aux_inputs = AuxInputTotals()
        self._aux_outputs = AuxOutputCommands(keep=settings.keep_aux_outputs)
        self._lockout = LockoutRequest()

    # What is known.

    @property
    def command_state(self) -> CommandState | None:
        """What the command channel says; None without a fresh status."""
        return None if self.status is None else self.status.command_state

    @property
    def _another(self) -> Coded | None:
        """Say that this is another SSC than is wanted; None: it is that one, or not known."""
        return another(self.configuration, self.settings.config_id)

    @property
    def _is_untold(self) -> bool:
        """Tell whether one SSC alone is wanted, and this one has not told yet which it is."""
        return self.configuration is None and self.settings.config_id != -1

    def inhibits(self, now: float) -> list[Coded]:
        """Return why no command to an output is obeyed, in words; empty too if there is none."""
        return self.forbidden(now) if self.is_commanded else []

    def forbidden(self, now: float) -> list[Coded]:
        """Return what forbids commands, whether there are any or not, in words."""
        return self.gate.forbidden(now, [*self.stop_reasons(now), *self.mux.stops(now)])

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return stops, controls that are not believed, what does not come, and warnings."""
        return [*super().problems(now), *report.problems(self, now)]

    def values(self, now: float) -> dict[str, Any]:
        """Return command state, sources, how the device is set up, and counters."""
        return report.values(self, now)

    def sticks_missing(self, now: float) -> bool:
        """Tell whether pulse inputs do not come, though there was time enough for them."""
        awaited = self._confirmed and self.settings.has_controls
        return awaited and now >= self._settled_at and self.sticks.heard.expired(now)

    def source_texts(self) -> list[str]:
        """Name the source of every output, as the switch has it now; empty if not known."""
        first = self.settings.first_input_nibble
        return [selection.text(first) for selection in self.selections]

    # The link's side; the base has the rest.

    def follow_on(self, states: Sequence[OutputState]) -> None:
        """Go on from what a session before this one has sent: it is in force until undone."""
        self.is_commanded = True
        self.outputs.follow_on(states)

    def follow_on_aux(self, functions: tuple[AuxFunction, ...], numbers: Collection[int]) -> None:
        """Undo, at the end if not before, what one before this may have set of these channels."""
        self._aux_outputs.configure(functions)
        if not self.settings.keep_aux_outputs:
            self._aux_outputs.claim(numbers, -math.inf)

    def leaves_at(self) -> float:
        """Have a device tell which one it is where there is something to undo."""
        undoes = bool(self.outputs.sent) or self._aux_outputs.deadline < math.inf
        return math.inf if undoes and self._is_untold else -math.inf

    def farewell(self, now: float) -> Iterator[bytes]:
        """
        Yield what brings every output to its failsafe, as nobody will command any more.

        Only what was sent has to be undone; and it has to, although this port, or this session,
        is so new that the device has not told how many outputs it has. Where it has not told which
        one it is, either, and one alone is wanted, it gets nothing: it may be another.
        """
        self.gate.shut([LEAVING])
        self._stop(self.gate.watch(now), now)
        if self._is_untold or self._another:
            return
        for _ in range(RELEASE_FRAMES):  # one may be lost
            if self.outputs.sent:
                yield from self.outputs.frames(now, self._count(), at_once=True)
            yield from self._aux_outputs.frames(now, at_once=True)

    def sent(self, frame: bytes, now: float) -> None:
        """Go on from a frame of the last poll or farewell: it went out."""
        kind = MessageType(frame[2])
        if kind is PulseCommand.TYPE:
            self.outputs.note_sent(now)
        elif kind is AuxOutputs.TYPE:
            self._aux_outputs.note_sent(frame, now)
        elif kind is Lockout.TYPE:
            self._lockout.pacer.sent(now)
        else:
            self._poller.note_sent(kind, now)

    def _begin(self, now: float) -> None:
        self._poller.start(now)

    def _forget(self, now: float, reason: str) -> None:
        del reason  # of the verdict, which made _follow forget the device
        self.sticks.heard.reset()
        self.gate.forget()
        if self._open:  # the outputs go on to their failsafe
            self._poller.start(now)
        else:
            self.configuration = None
            self.outputs.end()
        self._told = ()  # it may be just that which was lost; nor was the farewell told
        self._tell_sent()

    def _forget_device(self, reason: str) -> None:
        """Forget what only a device that answers vouches for, but not what is to be undone."""
        self.status = None
        self.selections = ()
        self.sticks.faulty = ()
        self._confirmed = False
        self._contradictions.clear()
        self._finish_lockout(False, reason)

    def _take(self, message: Message | Poll, now: float) -> None:
        if isinstance(message, Status):
            self._take_status(message, now)
        elif isinstance(message, Configuration):
            self._take_configuration(message, now)
        elif isinstance(message, Checked):
            self._take_checked(message, now)
        else:
            self.looped_back += 1
            self.echo.feed(now)

    def _take_status(self, status: Status, now: float) -> None:
        self._poller.heard(MessageType.STATUS, now)
        self._heard.feed(now)
        if self.status and status.config_available and not self.status.config_available:
            # Only a reset ends a lockout: whatever was known of the device may be wrong now.
            self._forget_device('the SSC was reset')
        is_first, self.status = self.status is None, status
        if not status.config_available:
            self._finish_lockout(True, _LOCKED)
        elif is_first and self.settings.lockout_on_start:
            self._lockout.start(now)

    def _take_configuration(self, configuration: Configuration, now: float) -> None:
        self._poller.heard(MessageType.CONFIGURATION, now)
        if not self.link_up or (self._confirmed and configuration == self.configuration):
            return  # nothing vouches for it; or it is the late answer to an earlier poll
        contradicts, self._confirmed = self._confirmed, False
        self.mismatches += contradicts
        self.configuration = configuration
        if self._another:
            return
        self._aux_outputs.configure(configuration.aux)
        if contradicts:  # what counted until now: it is read again
            return
        self._confirmed = True
        self._settled_at = now + self.settings.link_timeout
        self.outputs.begin(now)
        self._aux_inputs.configure(configuration.aux)
        if not self.settings.keep_aux_outputs:
            self._aux_outputs.stop(now)
        self._emit(ConfigurationRead(configuration))

    def _take_checked(self, message: Checked, now: float) -> None:
        """Take a message if it fits the configuration."""
        if not (self._confirmed and self.link_up and self.configuration):
            self.unchecked += 1
            return
        self._poller.heard(message.TYPE, now)  # one that does not count is asked for at once
        text = contradiction(message, self.configuration)
        if text:
            self.mismatches += 1
            self._confirmed = False
            self._contradictions[message.TYPE] = text
            return
        self._contradictions.pop(message.TYPE, None)
        if isinstance(message, PulseInputs):
            self.sticks.heard.feed(now)
            self._emit(PulsesIn(message.us))
            if self.settings.has_controls:
                self._emit(self.sticks.hear(message.us, now, counts=not self.verdict.estop))
        elif isinstance(message, PulseOutputs):
            rows = enumerate(self.selections, 1)
            serial = {number for number, each in rows if each.source == Source.SERIAL}
            self.outputs.driven_elsewhere(message.us, now, serial)
            self._emit(PulsesOut(message.us))
        elif isinstance(message, AuxInputs):
            self._aux_outputs.seen(message.levels)
            self._emit(AuxReading(self._aux_inputs.add(message)))
        else:
            self.selections = message.selections

    def _judge(self, now: float) -> Verdict:
        """Return a stop for doubts and by the command channel; nothing sent comes back as one."""
        del now
        text = self._another
        reasons = [text] if text else doubts(self._contradictions, confirmed=self._confirmed)
        state = self.command_state
        if state is not None and state in self.settings.stop_states:
            reasons.append(command_stop(state))
        return Verdict.stop(*reasons) if reasons else Verdict()

    def _silence(self, now: float) -> Coded:
        age = self._heard.describe(now)
        if self._garbled(now) and self.counters.malformed > self.counters.frames:
            text = (
                'update the firmware of the SSC, or report it with a capture: its packets come, '
                f'but their byte count is not that of the manual (4.1); no status: {age}'
            )
            return Coded('ssc.link.byte_count', text)
        if self._garbled(now):
            text = (
                'check baud (an SSC has 115200), that port is the SSC, and that it is not in its '
                f'configuration menus: bytes come, but no frame; no status: {age}'
            )
            return Coded('ssc.link.garbled', text)
        return Coded(
            'ssc.link.silent',
            "check the SSC's power, the serial cable, that this port is its Primary Comm, that it "
            f'is not in its configuration menus: no status from the SSC: {age}',
        )

    def _follow(self, now: float) -> None:
        if not self.link_up and self.status is not None:
            self._forget_device('; '.join(self.verdict.reasons))
        if self.command_state != self._published:
            self._published = self.command_state
            self._emit(CommandStateChanged(self._published))
        if self.selections != self._published_sources:
            self._published_sources = self.selections
            self._emit(SourcesChanged(tuple(self.source_texts())))
        if sticks := self.sticks.lapse(now, link_up=self.link_up, stopped=self.verdict.estop):
            self._emit(sticks)
        self._stop(self.gate.watch(now, [*self.verdict.reasons, *self.mux.stops(now)]), now)
        self._begin_failsafe(self.outputs.expire(now), ['the command is stale'])
        if now >= self._lockout.deadline:
            self._finish_lockout(False, _NOT_LOCKED)

    def _expires_at(self) -> float:
        moments = [super()._expires_at(), self.gate.deadline, self.outputs.expires_at()]
        return min(*moments, self._lockout.deadline, self.sticks.deadline)

    def _sends_at(self) -> float:
        if self.outputs.sent != self._told:
            return -math.inf  # to tell
        moments = [self._poller.deadline(self._wanted()), self._lockout.pacer.due]
        if self.configuration is not None and not self._another:
            moments += [self.outputs.sends_at(), self._aux_outputs.deadline]
        return min(moments)

    def _due_frames(self, now: float) -> list[bytes]:
        self._tell_sent()
        frames: list[bytes] = []
        if self.configuration is not None and not self._another:
            frames += self.outputs.frames(now, self._count()) + self._aux_outputs.frames(now)
        if self._lockout.pacer.is_due(now):
            frames.append(Lockout().to_bytes())
        return frames + self._poller.frames(now, self._wanted())

    # What the node asks.

    def _obey_stop(self, value: bool, now: float) -> None:
        self.gate.hear_stop(value, now)
        self._refresh(now)

    def set_pulses(self, us: Sequence[int], now: float) -> None:
        """
        Command outputs 1 and up, µs: 0 (no pulse) to 32000; ignored at a stop.

        :raises ValueError: for other numbers, none, or more than there are outputs.
        """
        self._command(lambda: dict(enumerate(PulseCommand(tuple(us)).us, 1)), now)

    def set_servos(self, positions: Mapping[str, float], now: float) -> None:
        """
        Command servos by name, -1 to 1; ignored at a stop.

        :raises ValueError: for an unknown servo, one without an output, or another number.
        """
        self._command(lambda: dict(self._pulse_of(*each) for each in positions.items()), now)

    def claim_outputs(self, now: float) -> None:
        """Bring all outputs to their failsafe: a session before this one may have driven them."""
        self.is_commanded = True
        self.outputs.claim()
        self._refresh(now)

    def claim_aux(self, numbers: Collection[int], now: float) -> None:
        """Undo what a session before this one may have set of these channels, 1 to 6."""
        if not self.settings.keep_aux_outputs:
            self._aux_outputs.claim(numbers, now)
        self._refresh(now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one."""
        self._expire(now)
        self.refused_commands += 1
        self._begin_failsafe(self.outputs.forget_commands(), [f'command refused: {reason}'])

    def set_aux(self, requests: Sequence[AuxRequest], now: float) -> None:
        """Set auxiliary outputs at once. :raises ValueError: cannot be, or a stop; none is set."""
        self._expire(now)
        if not self._confirmed:
            raise ValueError('the SSC has not reported yet what its auxiliary channels are')
        if not (self.gate.is_open or self.settings.keep_aux_outputs):
            raise ValueError(f'stopped: {"; ".join(self.forbidden(now))}')
        self._aux_outputs.ask(requests)

    def lock_out(self, now: float) -> None:
        """Lock the configuration menus out; an Answer follows."""
        self._expire(now)
        self._lockout.start(now)
        if self.status is None:
            self._finish_lockout(False, '; '.join(self.stop_reasons(now)))
        elif not self.status.config_available:
            self._finish_lockout(True, _LOCKED)

    # What follows from it.

    def _pulse_of(self, name: str, position: float) -> tuple[int, float]:
        servo = self.outputs.servos.get(name)
        if servo is None:
            raise ValueError(f'no servo {name!r}; there are {list(self.outputs.servos)}')
        if not abs(position) <= _MAX_POSITION:
            raise ValueError(f'{name}: {position} is not within -1 to 1')
        return servo.channel, servo.pulse(position)  # its limits hold in Outputs

    def _command(self, us_of: Callable[[], Mapping[int, float]], now: float) -> None:
        """
        Command outputs by number.

        :param us_of: returns µs. :raises ValueError: it does, or there is none, or no such output.
        """
        self._expire(now)
        try:
            us = us_of()
            if not us:
                raise ValueError('nothing is commanded')
            self.is_commanded = True
            most = self.configuration.outputs if self.configuration else MAX_OUTPUTS
            if max(us) > most:
                raise ValueError(f'output {max(us)}: there are {most}')
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        if self.gate.is_open:
            for number, pulse in us.items():
                self.outputs.ask(number, pulse, now)

    def _finish_lockout(self, success: bool, text: str) -> None:
        """Answer a lockout that is asked for."""
        self._events += self._lockout.finish(success, text)

    def _stop(self, reasons: Sequence[str], now: float) -> None:
        """Have every output at its failsafe, if there are reasons; what was asked is forgotten."""
        if reasons:
            self._begin_failsafe(self.outputs.forget_commands(), reasons)
            if not self.settings.keep_aux_outputs:
                self._aux_outputs.stop(now)

    def _begin_failsafe(self, names: Sequence[str], reasons: Sequence[str]) -> None:
        if names:
            self._emit(FailsafeBegun(tuple(names), tuple(reasons)))

    def _wanted(self) -> tuple[MessageType, ...]:
        """Return what may be polled; without the configuration nothing else makes sense."""
        return REPEATED if self._confirmed else _AT_START

    def _count(self) -> int:
        """Return how many outputs there are, as far as is known."""
        return self.configuration.outputs if self.configuration else len(self.outputs.sent)

    def _tell_sent(self) -> None:
        if self.outputs.sent != self._told:
            self._told = self.outputs.sent
            self._emit(OutputsSent(self.settings.port, self._told))
