"""The session itself; the package's page has the rules."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
import math

from bridge_core.watchdog import Watchdog
from esi_drive_bridge.protocol import AxisCommand
from esi_drive_bridge.protocol import Command
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.protocol import Status
from esi_drive_bridge.protocol import status_parser
from esi_drive_bridge.protocol import VALUE_MAX
from esi_drive_bridge.protocol import VALUE_MIN
from esi_drive_bridge.session.events import EnabledChanged
from esi_drive_bridge.session.events import EnableRefused
from esi_drive_bridge.session.events import ErrorsCleared
from esi_drive_bridge.session.events import Event
from esi_drive_bridge.session.events import FaultsChanged
from esi_drive_bridge.session.events import Feedback
from esi_drive_bridge.session.events import Stopped
from esi_drive_bridge.session.settings import Settings

FAREWELL_PACKETS = 3  # a lost or flipped one must not leave the motor enabled

Output = tuple[list[Event], list[bytes]]


class Phase(Enum):
    """See the table on the package's page."""

    DISABLED = 'disabled'
    WAITING = 'waiting for a command'
    ENABLING = 'enabling'
    ENABLED = 'enabled'
    CLEARING = 'clearing errors'


_ACTIVE = (Phase.WAITING, Phase.ENABLING, Phase.ENABLED)
_ON_THE_WIRE = (Phase.ENABLING, Phase.ENABLED)  # packets say enable


class Session:
    """
    One drive on one port. Every ``now`` is seconds of a monotonic clock.

    Requests act at once on what the next poll sends; poll after each of them.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._parser = status_parser(settings.layout)
        self.counters = self._parser.counters
        self.saturations = 0  # command values cut to what 16 bits hold, one an axis and command
        self.refused_commands = 0
        self.phase = Phase.DISABLED
        self.last_stop: tuple[str, ...] = ()
        self._period = 1.0 / settings.command_rate
        self._zeros = (0,) * settings.layout.axes
        self._command = Watchdog(settings.command_timeout)
        self._enable = Watchdog(settings.command_timeout)
        self._estop_in = Watchdog(settings.command_timeout)
        self._status = Watchdog(settings.status_timeout)
        self._events: list[Event] = []
        self._open = False
        self._fresh = False  # the status is; as of the last call
        self._enabled = False
        self._enable_value = False
        self._armed = False  # a false of enable was heard while nothing else forbade motion
        self._forget()

    # What the node reads.

    @property
    def estop(self) -> bool:
        """No port, no fresh status, or an error bit; never the echo of an input of this node."""
        return not self._fresh or self.status is None or self.status.faulty

    @property
    def own_estop(self) -> bool:
        """The same: nothing that this node asks comes back as a stop."""
        return self.estop

    @property
    def link_up(self) -> bool:
        """Status packets arrive within ``status_timeout``."""
        return self._fresh

    @property
    def enabled(self) -> bool:
        """The drive says now that every axis is enabled."""
        return self._enabled

    def frame_age(self, now: float) -> float:
        """Return the seconds since the last status packet; infinite if there was none."""
        return self._status.age(now)

    def stop_reasons(self, now: float) -> list[str]:
        """Say in words why ``estop`` is true, and what to do; empty when it is false."""
        if not self._open:
            return ['the port is closed']
        if not self._fresh:
            return [
                f'no status from the drive: {self._status.describe(now)}; check power, the '
                "receive pair, baud, single_axis_layout, and HiDS's SerialInterfaceEnable"
            ]
        return list(self._faults)

    def inhibits(self, now: float) -> list[str]:
        """Say in words why packets say disable; empty when they say enable."""
        if self.phase in _ON_THE_WIRE:
            return []
        reasons = self._forbidden(now) + self._enable_missing(now) + self._command_missing(now)
        if not reasons and not self._armed:
            reasons.append('enable must go false, then true again')
        if self.last_stop:
            reasons.append(f'last stop: {"; ".join(self.last_stop)}')
        return reasons

    def warnings(self, now: float) -> list[str]:
        """Say what is not a stop but not right either."""
        texts = list(self.settings.line_warnings())
        if self._fresh and self.status is not None:
            texts += self.status.warnings()
            age = now - self._disabled_since
            if self.phase not in _ON_THE_WIRE and age > self.settings.enable_timeout:
                still = [name for name, axis in self.status.lettered() if axis.enabled]
                texts += [
                    f'axis {name} is still enabled {age:.1f} s after disable was sent: cut its '
                    'power, then check who else commands the drive'
                    for name in still
                ]
        return texts

    # What the link thread tells.

    def opened(self, now: float) -> Output:
        """Start to send, disabled."""
        self._forget()
        self._open = True
        self._next_send = self._disabled_since = now
        return self._step(now)

    def closed(self, now: float) -> list[Event]:
        """Forget what was heard; ``estop`` is true."""
        del now
        if self.phase is Phase.CLEARING:
            self._finish_clearing(False, 'the port was closed')
        elif self.phase in _ACTIVE:
            self._stop(['the port was closed'])
        self._tell_enabled(False)
        self._open = False
        self._forget()
        return self._take_events()

    def receive(self, data: bytes, now: float) -> Output:
        """Take bytes of any split. Raises nothing."""
        if not self._open:
            return [], []
        self._watch(now)
        self._take_frames(self._parser.feed(data, now), now)
        return self._step(now)

    def poll(self, now: float) -> Output:
        """Let time act, and send what is due."""
        if not self._open:
            return self._take_events(), []
        self._watch(now)
        self._take_frames(self._parser.poll(now), now)
        return self._step(now)

    def deadline(self) -> float:
        """Return when poll must be called at the latest; infinite while the port is closed."""
        if not self._open:
            return math.inf
        moments = [self._next_send, self._parser.deadline]
        if self._fresh:
            moments.append(self._status.deadline)
        if self.phase in _ACTIVE:
            moments += [dog.deadline for dog in (self._enable, self._estop_in)]
            # Often enough that a healthy loop is not taken for a stalled one.
            moments.append(self._polled + self.settings.command_timeout / 2)
        if self.phase in _ON_THE_WIRE:
            moments.append(self._command.deadline)
        if self.phase not in (Phase.DISABLED, Phase.ENABLED):
            moments.append(self._until)
        return min(moments)

    def farewell(self, now: float) -> list[bytes]:
        """Return disable packets, as the port closes on purpose."""
        del now
        if self.phase in _ACTIVE:
            self._stop(['the node leaves'])
        self.phase = Phase.DISABLED
        return [self._packet()] * FAREWELL_PACKETS

    # What the node asks.

    def set_command(self, values: Sequence[float], now: float) -> None:
        """
        Take a command, one value an axis in the joint's SI units. It counts once ENABLED.

        :raises ValueError: for a wrong number of values, NaN or infinity; see refuse_command.
        """
        self._watch(now)
        try:
            counts = self._to_counts(values)
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        self._command.feed(now)
        self._refusal = ''
        if self.phase is Phase.ENABLED:
            self._counts = counts
        elif self.phase is Phase.WAITING:
            self._begin_enabling(now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one, so stop."""
        self._watch(now)
        self.refused_commands += 1
        self._command.reset()
        self._refusal = reason
        if self.phase in _ON_THE_WIRE:
            self._stop(self._command_missing(now))

    def set_enable(self, value: bool, now: float) -> None:
        """Take the enable input; only an edge from false to true, heard both, enables."""
        self._watch(now)
        risen = value and not (self._enable_value and not self._enable.expired(now))
        edge = value and self._armed
        self._enable.feed(now)
        self._enable_value = value
        forbidden = self._forbidden(now)
        self._armed = not value and not forbidden
        if not value and self.phase in _ACTIVE:
            armed = self._armed  # this false is a stop, and the first half of a new edge
            self._stop(['enable went false'])
            self._armed = armed
        elif edge and not forbidden:
            self._begin_waiting(now)
        elif risen and self._open and self.phase not in _ACTIVE:
            reasons = forbidden or ['enable was not heard false before, after the last stop']
            self._events.append(EnableRefused(tuple(reasons)))

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; a true stops even if a false follows before the next poll."""
        self._watch(now)
        self._estop_in.feed(now)
        self._estop_value = value
        if value:
            self._armed = False
            if self.phase in _ACTIVE:
                self._stop(self._forbidden(now))

    def clear_errors(self, now: float) -> None:
        """Ask the drive, disabled, to clear its errors. ErrorsCleared tells how it went."""
        self._watch(now)
        if not self._open or not self._fresh:
            self._events.append(ErrorsCleared(False, '; '.join(self.stop_reasons(now))))
        elif not self.estop:
            self._events.append(ErrorsCleared(True, 'the drive reports no error'))
        elif self.phase is not Phase.CLEARING:
            self.phase = Phase.CLEARING
            self._until = now + self.settings.clear_timeout
            self._clear_sent = False
            self._urgent = True

    # Time.

    def _watch(self, now: float) -> None:
        """
        Let what expired before ``now`` act.

        Called before anything new is taken in, so that what was stale cannot be made fresh unseen.
        """
        if self._fresh and self._status.expired(now):
            self._fresh = False
            self._tell_enabled(False)
        if self._armed and (self._enable.expired(now) or self._forbidden(now)):
            self._armed = False
        if self.phase in _ACTIVE:
            reasons = self._lost(now)
            if reasons:
                self._stop(reasons)
        elif self.phase is Phase.CLEARING and not now < self._until:
            texts = self.stop_reasons(now) or ['no answer from the drive']
            self._finish_clearing(False, f'errors remain: {"; ".join(texts)}')

    def _lost(self, now: float) -> list[str]:
        """Say what ends a phase that leads to motion."""
        reasons = self._forbidden(now) + self._enable_missing(now)
        gap, limit = now - self._polled, self.settings.command_timeout
        if not 0.0 <= gap <= limit:
            reasons.append(f'this node stalled for {gap * 1e3:.0f} ms, limit {limit * 1e3:.0f} ms')
        late = now >= self._until
        if self.phase is not Phase.WAITING or late:
            reasons += self._command_missing(now)
        if self.phase is Phase.ENABLING and late:
            limit = self.settings.enable_timeout
            reasons.append(f'the drive did not become enabled within {limit * 1e3:.0f} ms')
        return reasons

    def _forbidden(self, now: float) -> list[str]:
        """Say what forbids motion, enable and command apart."""
        reasons = self.stop_reasons(now)
        if self.phase is Phase.CLEARING:
            reasons.append('errors are being cleared')
        if self._estop_in.expired(now):
            reasons.append(f'e-stop input is stale: {self._estop_in.describe(now)}')
        elif self._estop_value:
            reasons.append('e-stop input is true')
        return reasons

    def _enable_missing(self, now: float) -> list[str]:
        if self._enable.expired(now):
            return [f'enable is stale: {self._enable.describe(now)}']
        return [] if self._enable_value else ['enable is false']

    def _command_missing(self, now: float) -> list[str]:
        if self._refusal:
            return [f'command refused: {self._refusal}']
        if self._command.expired(now):
            return [f'command is stale: {self._command.describe(now)}']
        return []

    # Phases.

    def _begin_waiting(self, now: float) -> None:
        self.phase = Phase.WAITING
        self._polled = now
        self._until = now + self.settings.command_timeout
        if not self._command.expired(now):
            self._begin_enabling(now)

    def _begin_enabling(self, now: float) -> None:
        self.phase = Phase.ENABLING
        self._until = now + self.settings.enable_timeout
        self._counts = self._at_rest()
        self._urgent = True

    def _stop(self, reasons: Sequence[str]) -> None:
        """Back to disabled, for which a packet goes out at the next poll, and no command stays."""
        was_on_the_wire = self.phase in _ON_THE_WIRE
        self.phase = Phase.DISABLED
        self._armed = False
        self._counts = self._zeros
        self.last_stop = tuple(reasons)
        if was_on_the_wire:
            self._urgent = True
            self._disabled_since = self._polled
        self._events.append((Stopped if was_on_the_wire else EnableRefused)(self.last_stop))

    def _finish_clearing(self, success: bool, text: str) -> None:
        self.phase = Phase.DISABLED
        self._events.append(ErrorsCleared(success, text))

    def _forget(self) -> None:
        """Be as if nothing had ever been heard."""
        for dog in (self._command, self._enable, self._estop_in, self._status):
            dog.reset()
        self._parser.reset()
        self.phase = Phase.DISABLED
        self.status: Status | None = None
        self._faults: tuple[str, ...] = ()
        self._fresh = self._enabled = self._armed = self._urgent = self._clear_sent = False
        self._enable_value, self._estop_value = False, True
        self._refusal = ''
        self._counts = self._zeros
        self._next_send = self._until = self._polled = self._disabled_since = -math.inf

    # Bytes.

    def _take_frames(self, frames: Sequence[bytes], now: float) -> None:
        for frame in frames:
            self._take_status(Status.from_bytes(frame, self.settings.layout), now)

    def _take_status(self, status: Status, now: float) -> None:
        self.status = status
        self._status.feed(now)
        self._fresh = True
        self._events.append(Feedback(status))
        self._tell_enabled(status.enabled)
        faults = tuple(status.faults()) if status.faulty else ()
        if faults != self._faults:
            self._faults = faults
            self._events.append(FaultsChanged(faults))
        self._act_on(status, now)

    def _act_on(self, status: Status, now: float) -> None:
        if self.phase is Phase.CLEARING:
            if self._clear_sent and not status.faulty:
                self._finish_clearing(True, 'the errors are cleared')
        elif status.faulty:
            if self.phase in _ACTIVE:
                self._stop(self._faults)
        elif self.phase is Phase.ENABLING:
            self._counts = self._at_rest()
            if status.enabled:
                self.phase = Phase.ENABLED
        elif self.phase is Phase.ENABLED and not status.enabled:
            # It has had its reason; it must not start again by itself once that is gone.
            self._stop(
                [f'axis {n} disabled itself' for n, a in status.lettered() if not a.enabled]
            )

    def _tell_enabled(self, enabled: bool) -> None:
        if enabled != self._enabled:
            self._enabled = enabled
            self._events.append(EnabledChanged(enabled))

    def _step(self, now: float) -> Output:
        """Return the events so far and the packet that is due."""
        self._polled = now
        frames = []
        if self._urgent or now >= self._next_send:
            frames.append(self._packet())
            following = self._next_send + self._period
            late = self._urgent or following <= now
            self._next_send = now + self._period if late else following
            self._urgent = False
            self._clear_sent = self.phase is Phase.CLEARING
        return self._take_events(), frames

    def _take_events(self) -> list[Event]:
        events, self._events = self._events, []
        return events

    def _packet(self) -> bytes:
        enable, clear = self.phase in _ON_THE_WIRE, self.phase is Phase.CLEARING
        counts = self._counts if enable else self._zeros
        axes = zip(self.settings.modes, counts, strict=True)
        return Command(
            tuple(AxisCommand(enable, clear, mode, value) for mode, value in axes)
        ).to_bytes(self.settings.layout)

    def _at_rest(self) -> tuple[int, ...]:
        """Return the counts that ask for no motion."""
        if self.status is None:
            return self._zeros
        axes = zip(self.settings.modes, self.status.axes, strict=True)
        return tuple(axis.feedback if mode is Mode.POSITION else 0 for mode, axis in axes)

    def _to_counts(self, values: Sequence[float]) -> tuple[int, ...]:
        """Scale and saturate. :raises ValueError: for a wrong number of values or not finite."""
        if len(values) != self.settings.layout.axes:
            raise ValueError(f'{len(values)} values for {self.settings.layout.axes} axes')
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f'not finite: {list(values)}')
        wanted = [v / scale for v, scale in zip(values, self.settings.si_per_count, strict=True)]
        held = [min(max(count, VALUE_MIN), VALUE_MAX) for count in wanted]
        self.saturations += sum(a != b for a, b in zip(wanted, held, strict=True))
        return tuple(round(count) for count in held)
