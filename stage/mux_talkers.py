# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A mux as a process, and in this one all that it listens to: e-stops, a drive, one operator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

from stage.rig import as_yaml, latched, NodeProcess, Observer, TIMEOUT_FACTOR
from stage.run_delay import RunDelay, WIRE_HELD_UP
from stage.talkers import namespace, Talker, values_of

# Longer than the defaults: a busy machine is not what these tests are about.
TIMEOUT = TIMEOUT_FACTOR
STOPPED_WITHIN, SILENCE_STOPS_WITHIN = 1.4, TIMEOUT + 0.4  # s
PATIENT = {
    'stall_limit': 1.0,  # the most that there may be; stage.patience multiplies it
    'estop.fort.timeout': TIMEOUT,
    'estop.drive.timeout': TIMEOUT,
    'drive_enabled_timeout': TIMEOUT,
    'operator.fort.timeout': TIMEOUT,
    'autonomy.timeout': TIMEOUT,
    'neutral_time': TIMEOUT,
}
OUTPUTS = {
    'joints': (JointState, 'command'),
    'twist': (Twist, 'cmd_vel'),
    'twist_stamped': (TwistStamped, 'cmd_vel'),
}
FRESH = 0.4  # s; of ~/state, four periods
CLEAR_TIME = 0.5  # the mux's default; a reset within it of another counts as repeated


def patient(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Return PATIENT without what a mux with these parameters has no use for."""
    unused = set()
    if not parameters.get('autonomy.topic'):
        unused.add('autonomy.timeout')
    if parameters.get('drive_enabled_topic') == '':
        unused.add('drive_enabled_timeout')
    return {name: value for name, value in PATIENT.items() if name not in unused}


def sticks(forward: float = 0.0, *, deadman: bool = False) -> Joy:
    """Return what a FORT remote sends: axis 1 is forward, button 0 the deadman."""
    return Joy(axes=[0.0, float(forward), 0.0, 0.0, 0.0, 0.0], buttons=[int(deadman), *[0] * 7])


class MuxBench:
    """
    The mux with its default sources 'fort' and 'drive' and its operator 'fort'.

    :param arguments: ROS arguments before the parameters, such as a file.
    :param space: its namespace; one of its own by default.
    :param parameters: with __ for a dot; None leaves out one of PATIENT.
    """

    def __init__(
        self,
        observer: Observer,
        rate: float = 25.0,
        *,
        arguments: Sequence[str] = (),
        space: str | None = None,
        **parameters: Any,
    ) -> None:
        self.observer = observer
        self.arguments = arguments
        self.space = namespace() if space is None else space
        self.name = f'{self.space}/safety_mux'
        given = {key.replace('__', '.'): value for key, value in parameters.items()}
        given = patient(given) | given
        self.given = {name: value for name, value in given.items() if value is not None}
        self.start()
        self.reset_at = 0.0
        record = observer.record
        self.estop = record(Bool, f'{self.name}/estop', latched())
        self.enable = record(Bool, f'{self.name}/enable')
        kind, topic = OUTPUTS[self.given.get('output', 'joints')]
        self.command = record(kind, f'{self.name}/{topic}', 1000)
        self.state = record(String, f'{self.name}/state', latched())
        self.status = record(DiagnosticStatus, f'{self.name}/status', latched())
        self.stop_demand = {
            source: record(Bool, f'{self.name}/stop_demand/{source}', latched())
            for source in ('fort', 'drive')
        }

        self._rate, self._talkers = rate, list[Talker]()
        talker = self.talker
        self.fort_estop = talker(Bool, 'fort_vsc_bridge/estop', Bool(data=False))
        self.fort_own_estop = talker(Bool, 'fort_vsc_bridge/own_estop', Bool(data=False))
        self.drive_estop = talker(Bool, 'esi_drive_bridge/estop', Bool(data=False))
        self.drive_enabled = talker(Bool, 'esi_drive_bridge/enabled', Bool(data=True))
        self.joy = talker(Joy, 'fort_vsc_bridge/joy', sticks())
        # Now: a mux that discovers a client late may drop its first response.
        for service in ('reset', 'trip', 'end_trip'):
            observer.client(Trigger, f'{self.name}/{service}')
        observer.client(SetBool, f'{self.name}/select_autonomy')

    def talker(self, kind: Any, topic: str, message: Any = None, *, qos: Any = 100) -> Talker:
        """Return what says this on a topic of the mux's namespace, until the bench is closed."""
        topic = f'{self.space}/{topic}'
        result = Talker(self.observer, kind, topic, message, rate=self._rate, qos=qos)
        self._talkers.append(result)
        return result

    def start(self) -> None:
        """Start the mux, or start it again."""
        given = (('-p', f'{name}:={as_yaml(value)}') for name, value in self.given.items())
        arguments = (*self.arguments, *chain.from_iterable(given))  # the last one counts
        self.node = NodeProcess(
            'safety_mux.node', arguments=arguments, namespace=self.space, patient=True
        )

    def wait(self, condition: Any, what: str, timeout: float = 10.0) -> Any:
        return self.observer.wait_for(condition, timeout, lambda: f'{what}; {self.report()}')

    def report(self) -> str:
        status = self.status.last
        return f'mux: {self.state.last and self.state.last.data}, {status and status.message}'

    def says(self, state: str) -> bool:
        """Tell whether the newest state is this one, and fresh."""
        record = self.state
        return bool(record.times) and (
            time.monotonic() - record.times[-1] < FRESH and record.last.data == state
        )

    def inhibits(self) -> list[str]:
        """Return what holds now, by a fresh status; not what it was once stopped for."""
        record = self.status
        if not record.times or time.monotonic() - record.times[-1] > 0.3:
            return []
        values = values_of(record.last)
        found = [text for key, text in values.items() if key.startswith('inhibit')]
        return [text for text in found if not text.startswith('stopped ')]

    def why(self) -> str:
        """Return the newest status's message."""
        return str(self.status.last.message) if self.status.last else ''

    def explains(self, *texts: str) -> bool:
        """Tell whether all these texts are among the inhibits."""
        return all(text in '; '.join(self.inhibits()) for text in texts)

    def is_past(self, text: str) -> bool:
        """Tell whether there are inhibits, and none has this text."""
        inhibits = self.inhibits()
        return bool(inhibits) and not any(text in inhibit for inhibit in inhibits)

    def may_reset(self) -> bool:
        """Tell whether nothing is missing but the reset, which is not to be a repeated one."""
        if time.monotonic() < self.reset_at + CLEAR_TIME or not self.says('STOPPED'):
            return False
        inhibits = self.inhibits()
        return len(inhibits) == 1 and inhibits[0].startswith('waiting for reset')

    def reset(self) -> Any:
        reply = self.observer.call(Trigger, f'{self.name}/reset')
        self.reset_at = time.monotonic()
        return reply

    def trip(self) -> Any:
        return self.observer.call(Trigger, f'{self.name}/trip')

    def end_trip(self) -> Any:
        return self.observer.call(Trigger, f'{self.name}/end_trip')

    def select_autonomy(self, select: bool = True) -> Any:
        request = SetBool.Request(data=select)
        return self.observer.call(SetBool, f'{self.name}/select_autonomy', request)

    def ready(self) -> None:
        """Be READY, with a rested operator."""
        # A machine that holds a source up right before the reset makes it one that is refused.
        # One that counts may still answer that it waited too long.
        self.wait(
            lambda: self.says('READY') or (self.may_reset() and self.reset().success),
            'a reset that counts',
        )

        def is_rested() -> bool:
            if self.may_reset():  # it held one up right after that
                self.reset()
            return self.says('READY') and self.explains('press the deadman')

        self.wait(is_rested, 'a rested operator', 20.0)

    def active(self, forward: float = 0.5) -> None:
        """Be ACTIVE and in motion."""
        self.delay = RunDelay([self.node.process.pid])
        self.ready()

        def moves() -> bool:
            """Press, then push; from the start where the machine held the mux up."""
            if self.says('STOPPED'):
                assert self.held_up(), self.report()
                self.joy.message = sticks()
                self.ready()
            self.joy.message = sticks(forward if self.says('ACTIVE') else 0.0, deadman=True)
            # What has not come of a topic yet would come after a stop of the others.
            enabled = self.enable.last.data and not self.estop.last.data
            return self.says('ACTIVE') and any(self.demand) and enabled

        self.wait(moves, 'motion', 20.0)
        self.delay = RunDelay([self.node.process.pid])

    def held_up(self) -> bool:
        """Tell whether a stop since ``active`` may be the doing of a busy machine."""
        return self.delay.exceeds(WIRE_HELD_UP)

    def stopped_since(self, cause: float, within: float = STOPPED_WITHIN) -> None:
        """See STOPPED in time, and nothing but stop, disable and 0 from then on."""
        delay = RunDelay([self.node.process.pid])
        stops: list[float] = []  # ~/state may come first: it is another topic

        def is_stopped() -> bool:
            stops.extend(at for at, estop in self.estop.since(cause) if estop.data and not stops)
            return bool(stops) and self.says('STOPPED')

        self.wait(is_stopped, 'STOPPED')
        assert stops[0] - cause <= within + delay.seconds()
        self.wait(self.is_stopped, 'stop, disable and 0')
        self.observer.holds_for(self.is_stopped, 0.2, 'stop, disable and 0')

    def is_stopped(self) -> bool:
        """Tell whether the newest outputs are stop, disable and 0."""
        if not all(each.messages for each in (self.estop, self.enable, self.command)):
            return False
        outputs = (self.estop.last.data, self.enable.last.data, any(self.demand))
        return outputs == (True, False, False)

    @property
    def demand(self) -> tuple[float, ...]:
        """The newest command: of joints, or forward and turn of a twist; empty before it."""
        message = self.command.last
        if message is None:
            return ()
        if isinstance(message, JointState):
            return tuple(message.velocity)
        twist = message.twist if isinstance(message, TwistStamped) else message
        return twist.linear.x, twist.angular.z

    def close(self) -> None:
        self.node.__exit__(None, None, None)
        for talker in self._talkers:
            talker.leave()


NewMux = Callable[..., MuxBench]
