"""
What the link to an SSC means over time: manual sections 2 and 4.

Only a fresh status message vouches for anything: it tells whether the RC receiver still sends. And
only what fits the configuration that the device told is believed.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
import math
from typing import Any

from bridge_core.session import StickStream
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from bridge_core.watchdog import Watchdog
from ssc_bridge.protocol import AuxInputs
from ssc_bridge.protocol import ChannelSource
from ssc_bridge.protocol import CommandState
from ssc_bridge.protocol import Configuration
from ssc_bridge.protocol import decode
from ssc_bridge.protocol import FrameError
from ssc_bridge.protocol import MessageType
from ssc_bridge.protocol import parser
from ssc_bridge.protocol import PulseCommand
from ssc_bridge.protocol import PulseInputs
from ssc_bridge.protocol import PulseOutputs
from ssc_bridge.protocol import Selection
from ssc_bridge.protocol import Source
from ssc_bridge.protocol import Status
from ssc_bridge.protocol import Unknown
from ssc_bridge.session.auxiliary import AuxInputBook
from ssc_bridge.session.auxiliary import AuxOutputBook
from ssc_bridge.session.events import CommandStateChanged
from ssc_bridge.session.events import ConfigurationRead
from ssc_bridge.session.events import Event
from ssc_bridge.session.events import FailsafeBegun
from ssc_bridge.session.events import Output
from ssc_bridge.session.events import PulsesIn
from ssc_bridge.session.events import PulsesOut
from ssc_bridge.session.lockout import LockoutKeeper
from ssc_bridge.session.outputs import Outputs
from ssc_bridge.session.outputs import RELEASE_FRAMES
from ssc_bridge.session.polling import Poller
from ssc_bridge.session.settings import REPEATED
from ssc_bridge.session.settings import Settings
from ssc_bridge.session.sticks import neutral
from ssc_bridge.session.sticks import sticks_of
from ssc_bridge.session.stops import Checked
from ssc_bridge.session.stops import contradiction
from ssc_bridge.session.stops import StopJudge

_CONFIGURATION_RATE = 4.0  # Hz, until the device answers
_AT_START = (MessageType.STATUS, MessageType.CONFIGURATION)
_MAX_POSITION = 1.05  # what rounding may add to 1; more is another unit


class Session:
    """
    One SSC on one serial link; see bridge_core.transports.link.Session for the contract.

    :param settings: see Settings.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()
        self.estop = True
        self.link_up = False
        self.status: Status | None = None  # the newest, while the link is up
        self.configuration: Configuration | None = None  # of what is, or was last, on this port
        self.selections: tuple[Selection, ...] = ()  # sources of the outputs, while the link is up
        self.faulty: tuple[str, ...] = ()  # controls without a believable pulse
        self.mismatches = 0  # messages that contradict the configuration
        self.unchecked = 0  # messages that came before the configuration was known
        self.refused_commands = 0
        self.looped_back = 0  # frames that only a host sends: the line echoes
        self.outputs = Outputs(self.settings)
        self._lockout = LockoutKeeper()
        self._parser = parser()
        self.counters = self._parser.counters
        rates = dict(zip(REPEATED, self.settings.poll_rates, strict=True))
        self._poller = Poller({**rates, MessageType.CONFIGURATION: _CONFIGURATION_RATE})
        self._status_heard = Watchdog(self.settings.link_timeout)
        self._inputs_heard = Watchdog(self.settings.link_timeout)
        self._estop_in_heard = Watchdog(self.settings.command_timeout)
        self._estop_in = True
        self._judge = StopJudge(self.settings.estop_states)
        self._verdict = Verdict()
        self._verdict_stands = False  # later messages of the same bytes only make it worse
        self._stream = StickStream()
        self._aux_inputs = AuxInputBook()
        self._aux_outputs = AuxOutputBook()
        self._events: list[Event] = []
        self._open = False
        self._stopped = True  # as of the last refresh: nothing may be commanded
        self._takers: dict[type, Callable[[Any, float], None]] = {
            ChannelSource: self._take_sources,
            PulseOutputs: self._take_outputs,
            PulseInputs: self._take_inputs,
            AuxInputs: self._take_aux,
        }

    # -- the link thread's side ------------------------------------------------------------------

    def opened(self, now: float) -> Output:
        """Begin with a new port: nothing was heard yet."""
        self._forget(now)
        self._open = True
        return self.poll(now)

    def closed(self, now: float) -> list[Event]:
        """Forget all that was heard."""
        self._open = False
        self._refresh(now)
        self._forget(now)
        return self._take_events()

    def receive(self, data: bytes, now: float) -> Output:
        """Take bytes as they came. Frames to send come from poll."""
        if self._open:
            self._refresh(now)  # what went stale before these bytes came
            self._verdict_stands = False
            for frame in self._parser.feed(data, now):
                self._take(frame, now)
            self._refresh(now)
        return self._take_events(), []

    def poll(self, now: float) -> Output:
        """Do what is due."""
        if not self._open:
            return self._take_events(), []
        self._refresh(now)
        for frame in self._parser.poll(now):
            self._take(frame, now)
        self._refresh(now)
        frames = self._output_frames(now)
        frames += self._lockout.frames(now)
        frames += self._poller.take(now, self._wanted())
        return self._take_events(), frames

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if not self._open:
            return math.inf
        due = [self._poller.deadline(self._wanted()), self._parser.deadline]
        due.append(self._lockout.deadline)
        if self.configuration is not None:
            due += [self.outputs.deadline(), self._aux_outputs.deadline]
        if self.link_up:
            due.append(self._status_heard.deadline)
        if self._stream.streaming:
            due.append(self._inputs_heard.deadline)
        if not self._stopped:
            due.append(self._estop_in_heard.deadline)
        return min(due)

    def farewell(self, now: float) -> list[bytes]:
        """Return what brings every output to its failsafe, as nobody will command any more."""
        self._stop(['the node leaves'], now)
        # As often as releases are sent: one may be lost.
        return [
            frame
            for _ in range(RELEASE_FRAMES)
            for frame in self._output_frames(now, at_once=True)
        ]

    # -- what is known ---------------------------------------------------------------------------

    @property
    def own_estop(self) -> bool:
        """The same as ``estop``: nothing that this node sends comes back as a stop."""
        return self.estop

    @property
    def command_state(self) -> CommandState | None:
        """What the command channel says; None without a fresh status."""
        return None if self.status is None else self.status.command_state

    def frame_age(self, now: float) -> float:
        """Return the seconds since the last message that the manual knows; infinite if never."""
        return self._poller.age(now)

    def stop_reasons(self, now: float) -> list[str]:
        """Say why ``estop`` is true, and what to do; empty if it is false."""
        if not self._open:
            return ['the port to the SSC is not open; plug it in, check the parameter port']
        if self.link_up:
            return list(self._verdict.reasons)
        return [
            f'no status from the SSC: {self._status_heard.describe(now)}; check its power, the '
            'serial cable, that this port is its Primary Comm, and that it is not in its '
            'configuration menus'
        ]

    def inhibits(self, now: float) -> list[str]:
        """Say why no command to an output is obeyed; empty if they are."""
        reasons = self.stop_reasons(now)
        if self._estop_in_heard.expired(now):
            reasons.append(f'e-stop input is stale: {self._estop_in_heard.describe(now)}')
        elif self._estop_in:
            reasons.append('e-stop input is true')
        return reasons

    def warnings(self) -> list[str]:
        """Say what is not a stop but not right either."""
        configuration = self.configuration
        if configuration is None:
            return []
        missing = [
            f'servo {servo.name}: there is no output {servo.channel}, only '
            f'{configuration.outputs}; check servo.{servo.name}.channel'
            for servo in self.settings.servos
            if servo.channel > configuration.outputs
        ]
        return [*self.settings.line_warnings(configuration), *missing, *self._without_effect()]

    def source_texts(self) -> list[str]:
        """Name the source of every output, as the switch has it now; empty if not known."""
        return [selection.text(self.settings.first_nibble) for selection in self.selections]

    def _without_effect(self) -> list[str]:
        """Name the outputs that are commanded while the switch does not give them to SERIAL."""
        commanded = self.outputs.commanded()
        return [
            f'{commanded[number]}: output {number} is on {text}, not on SERIAL, so that commands '
            'have no effect; see the switch table for the present command state'
            for number, text in enumerate(self.source_texts(), 1)
            if number in commanded and self.selections[number - 1].source != Source.SERIAL
        ]

    # -- requests --------------------------------------------------------------------------------

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; a true stops even if a false follows before the next poll."""
        self._refresh(now)
        self._estop_in_heard.feed(now)
        self._estop_in = value
        self._refresh(now)

    def set_pulses(self, us: Sequence[int], now: float) -> None:
        """
        Command outputs 1 and up, µs: 0 (no pulse) to 32000; ignored at a stop.

        :raises ValueError: for other numbers, none, or more than there are outputs.
        """
        self._refresh(now)
        with_numbers = dict(enumerate(us, 1))
        try:
            PulseCommand(tuple(us))
            self._check_outputs(with_numbers)
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        self._command(with_numbers, now)

    def set_servos(self, positions: Mapping[str, float], now: float) -> None:
        """
        Command servos by name, -1 to 1; ignored at a stop.

        :raises ValueError: for an unknown servo, one without an output, or another number.
        """
        self._refresh(now)
        try:
            us = dict(self._pulse_of(name, position) for name, position in positions.items())
            self._check_outputs(us)
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        self._command(us, now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one."""
        self._refresh(now)
        self.refused_commands += 1
        self._tell_failsafe(self.outputs.forget(), [f'command refused: {reason}'])

    def set_level(self, number: int, high: bool, now: float) -> None:
        """Set a digital output, aux 1 to 6. :raises ValueError: it is none, or a stop."""
        self._check_aux(now)
        self._aux_outputs.set_level(number, high)

    def set_pulse(self, number: int, seconds: float, now: float) -> None:
        """Set a pulse time, aux 1 to 6; this triggers a one-shot pulse. Else ValueError."""
        self._check_aux(now)
        self._aux_outputs.set_pulse(number, seconds)

    def set_period(self, number: int, seconds: float, now: float) -> None:
        """Set the period of free running pulses, aux 1 to 6. :raises ValueError: as set_level."""
        self._check_aux(now)
        self._aux_outputs.set_period(number, seconds)

    def lockout(self, now: float) -> None:
        """Lock the configuration menus out; a LockoutDone tells how it went."""
        self._refresh(now)
        self._lockout.ask(now)
        if self.status is None:
            self._events += self._lockout.fail('; '.join(self.stop_reasons(now)))
        elif not self.status.config_available:
            self._events += self._lockout.told(config_available=False)

    # -- inside: requests ------------------------------------------------------------------------

    def _pulse_of(self, name: str, position: float) -> tuple[int, float]:
        servo = self.outputs.servos.get(name)
        if servo is None:
            raise ValueError(f'no servo {name!r}; there are {list(self.outputs.servos)}')
        if not abs(position) <= _MAX_POSITION:
            raise ValueError(f'{name}: {position} is not within -1 to 1')
        return servo.channel, servo.pulse(position)  # its limits hold in Outputs

    def _check_outputs(self, us: Mapping[int, float]) -> None:
        if not us:
            raise ValueError('nothing is commanded')
        if self.configuration is not None and max(us) > self.configuration.outputs:
            raise ValueError(f'output {max(us)}: there are {self.configuration.outputs}')

    def _command(self, us: Mapping[int, float], now: float) -> None:
        if not self._stopped:
            for number, pulse in us.items():
                self.outputs.ask(number, pulse, now)

    def _check_aux(self, now: float) -> None:
        self._refresh(now)
        if not self._judge.confirmed:
            raise ValueError('the SSC has not told yet what its auxiliary channels are')
        if self._stopped and not self.settings.keep_aux_outputs:
            raise ValueError(f'stopped: {"; ".join(self.inhibits(now))}')

    # -- inside: messages ------------------------------------------------------------------------

    def _take(self, frame: bytes, now: float) -> None:
        """Count, and hand each message to whom it concerns."""
        try:
            message = decode(frame)
        except FrameError:
            self.counters.malformed += 1
            return
        if isinstance(message, Unknown):
            self.counters.unknown_types += 1
        elif isinstance(message, Status):
            self._take_status(message, now)
        elif isinstance(message, Configuration):
            self._take_configuration(message, now)
        elif isinstance(message, Checked):
            self._take_checked(message, now)
        else:
            self.looped_back += 1

    def _take_status(self, status: Status, now: float) -> None:
        self._poller.heard(MessageType.STATUS, now)
        self._status_heard.feed(now)
        if self.status and status.config_available and not self.status.config_available:
            # Only a reset ends a lockout: whatever was known of the device may be wrong now.
            self._forget_device('the SSC was reset')
        before, self.status = self.status, status
        self._rejudge()
        self._refresh(now)
        if before is None or before.command_state != status.command_state:
            self._events.append(CommandStateChanged(status.command_state))
        self._events += self._lockout.told(config_available=status.config_available)
        if before is None and self.settings.lockout_on_start:
            self.lockout(now)

    def _take_configuration(self, configuration: Configuration, now: float) -> None:
        self._poller.heard(MessageType.CONFIGURATION, now)
        if not self.link_up or (self._judge.confirmed and configuration == self.configuration):
            return  # nothing vouches for it; or it is the late answer to an earlier poll
        self._judge.confirmed = True
        self.configuration = configuration
        self.outputs.begin(now)
        self._aux_inputs.configure(configuration.aux)
        self._aux_outputs.configure(configuration.aux)
        if not self.settings.keep_aux_outputs:
            self._aux_outputs.stop(now)
        self._rejudge()
        self._events.append(ConfigurationRead(configuration))

    def _take_checked(self, message: Checked, now: float) -> None:
        """Take a message if it fits the configuration."""
        self._poller.heard(message.TYPE, now)
        if not (self._judge.confirmed and self.link_up and self.configuration):
            self.unchecked += 1
            return
        text = contradiction(message, self.configuration)
        if text:
            self.mismatches += 1
            self._judge.contradicted(message.TYPE, text)
            self._rejudge()
            return
        if self._judge.contradictions.pop(message.TYPE, None):
            self._rejudge()
        self._takers[type(message)](message, now)

    def _take_sources(self, message: ChannelSource, now: float) -> None:
        del now
        self.selections = message.selections

    def _take_outputs(self, message: PulseOutputs, now: float) -> None:
        del now
        self.outputs.driven_elsewhere(message.us)
        self._events.append(PulsesOut(message.us))

    def _take_inputs(self, message: PulseInputs, now: float) -> None:
        self._inputs_heard.feed(now)
        self._events.append(PulsesIn(message.us))
        if not (self.settings.axes or self.settings.buttons):
            return
        counts = not self._verdict.estop
        sticks = sticks_of(message.us, self.settings) if counts else neutral(self.settings)
        self.faulty = sticks.faulty
        self._stream.told(counts=counts)
        self._events.append(sticks)

    def _take_aux(self, message: AuxInputs, now: float) -> None:
        del now
        self._aux_outputs.seen(message.levels)
        self._events.append(self._aux_inputs.take(message))

    def _rejudge(self) -> None:
        """Bring the verdict up to date; within one read it only becomes worse."""
        verdict = self._judge.judge(self.command_state)
        self._verdict = self._verdict.worst(verdict) if self._verdict_stands else verdict
        self._verdict_stands = True

    # -- inside: time ----------------------------------------------------------------------------

    def _forget(self, now: float) -> None:
        """Be as if nothing had ever been heard on this port."""
        self._parser.reset()
        self._poller.start(now)
        for dog in (self._status_heard, self._inputs_heard, self._estop_in_heard):
            dog.reset()
        self.configuration = None
        self.outputs.end()
        self._forget_device('the link was lost')

    def _forget_device(self, text: str) -> None:
        """Forget what only a device that answers vouches for, but not what is to be undone."""
        self.status = None
        self.selections = ()
        self.faulty = ()
        self._judge.forget()
        self._events += self._lockout.fail(text)

    def _refresh(self, now: float) -> None:
        """Bring all that depends on freshness up to date; tell what changed, stops first."""
        before = (self.estop, self.link_up)
        self.link_up = self._open and not self._status_heard.expired(now)
        self.estop = not self.link_up or self._verdict.estop
        if before != (self.estop, self.link_up):
            self._events.append(StopChanged(self.estop, self.own_estop, self.link_up))
        if not self.link_up and self.status is not None:
            self._forget_device('the link was lost')
            self._events.append(CommandStateChanged(None))
        self._refresh_sticks(now)
        reasons = self.inhibits(now)
        if reasons:
            self._stop(reasons, now)
        else:
            self._stopped = False
            self._tell_failsafe(self.outputs.expire(now), ['the command is stale'])
        self._events += self._lockout.expire(now)

    def _refresh_sticks(self, now: float) -> None:
        """Follow up what was published with a neutral event once it does not hold any more."""
        fresh = self.link_up and not self._inputs_heard.expired(now)
        if self._stream.owes_neutral(fresh=fresh, counts=not self.estop):
            self.faulty = ()
            self._events.append(neutral(self.settings))

    def _stop(self, reasons: Sequence[str], now: float) -> None:
        """Have every output at its failsafe; what was asked is forgotten."""
        self._tell_failsafe(self.outputs.forget(), reasons)
        if not (self._stopped or self.settings.keep_aux_outputs):
            self._aux_outputs.stop(now)
        self._stopped = True

    def _tell_failsafe(self, names: Sequence[str], reasons: Sequence[str]) -> None:
        if names:
            self._events.append(FailsafeBegun(tuple(names), tuple(reasons)))

    def _take_events(self) -> list[Event]:
        events, self._events = self._events, []
        return events

    # -- inside: what is sent --------------------------------------------------------------------

    def _wanted(self) -> tuple[MessageType, ...]:
        """Return what may be polled; without the configuration nothing else makes sense."""
        return REPEATED if self._judge.confirmed else _AT_START

    def _output_frames(self, now: float, *, at_once: bool = False) -> list[bytes]:
        if self.configuration is None:
            return []
        pulses = self.outputs.frames(now, self.configuration.outputs, at_once=at_once)
        return pulses + self._aux_outputs.take(now, at_once=at_once)
