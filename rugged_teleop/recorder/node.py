# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The recorder as a node: it keeps the last minute of what the package's nodes say and hear.

It is a process of its own and only listens. The lane's thread receives, the executor's looks for
nodes and topics and asks for parameters, and a third one writes: a disk delays nobody.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from functools import lru_cache, partial
import json
import os
from pathlib import Path
import platform
import sys
import time
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from bridge_core import clock, refusals, shared_reasons
from bridge_core.diagnostics import to_msg
from bridge_core.fingerprint import version
from bridge_core.lane import waited
from bridge_core.managed_node import latched_qos, ManagedNode
from bridge_core.parameter_files import beside
from bridge_core.parameters import MANAGED_PARAMETERS, Parameter, ParameterError
from bridge_core.reasons import Coded, passed_on
from bridge_core.report import NOT_ACTIVE, Status
from bridge_core.runner import run
from rugged_teleop.devices import devices
from rugged_teleop.ledger.book import tail
from rugged_teleop.ledger.stopping import curves_of, Point, Trend
from rugged_teleop.ledger.tried import Tried
from rugged_teleop.ledger.witness import Witness
from rugged_teleop.ledger.writer import LedgerWriter
from rugged_teleop.recorder.asked import AskedParameters
from rugged_teleop.recorder.definitions import definition_of, message_class
from rugged_teleop.recorder.folder import Folder, KEPT
from rugged_teleop.recorder.parameters import check, PARAMETERS
from rugged_teleop.recorder.reasons import REASONS
from rugged_teleop.recorder.report import of_ledger, of_recordings, status_of
from rugged_teleop.recorder.ring import Channel, Heard, Ring
from rugged_teleop.recorder.triggers import Nodes, Schedule, STOP, Triggers

_CATALOGUE = {**shared_reasons.REASONS, **REASONS}
_LOOK_PERIOD = 0.5  # s, between two looks for nodes and topics
_STEP_PERIOD = 0.1  # s, between two batches for the disk
_DIAGNOSTICS_PERIOD = 1.0  # s
_LEAVE_TIME = 3.0  # s that the last file has to be completed; a disk that hangs keeps it
_SAVE_TIME = 2.0  # s that the disk has for the minute before, until the answer
_SLOW_DISK = Coded(
    'recorder.slow',
    'use a faster disk: it has not yet taken the minute before; /diagnostics will tell',
)
_NONE = Coded('recorder.none', 'nothing is kept: there is no recording')
_MB = 1_000_000
# A reader that asks for no more than this costs the node that publishes no answers, and never
# holds it up. States that are published on change alone are to be had reliably only.
_PASSING = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Recorder(ManagedNode):
    """Records what led to a stop, and what came of it; see docs/record.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*MANAGED_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder', **options)
        try:
            from rugged_teleop.recorder.writer import FileWriter  # late: mcap is an extra
        except ImportError as error:
            text = f'the recorder needs pip install mcap mcap-ros2-support ({error})'
            raise ParameterError(text) from error
        values = self.values
        self._ring = Ring(values['seconds'], values['memory'] * _MB)
        self._schedule = Schedule(values['after'], values['period'])
        path = (
            Path(values['folder']).expanduser() if values['folder'] else refusals.default_folder()
        )
        self.folder = Folder(path.absolute(), values['quota'] * _MB, values['files'])
        self._ledger_topic = self.create_publisher(String, '~/ledger', latched_qos())
        self._ledger, self._witness = self._make_ledger()
        self._writer = FileWriter(self.folder, self._say)
        self._triggers = Triggers(_read)
        self._asked = AskedParameters(self)
        self._nodes = Nodes()
        # By topic: its publishers are all transient local, and the subscription.
        self._topics: dict[str, tuple[bool, Any]] = {}
        self._unknown: dict[str, str] = {}  # topics that cannot be recorded, and why
        self._batch: list[Heard] = []  # for the disk
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_service(Trigger, '~/save', self._on_save)
        self.create_service(Trigger, '~/keep', self._on_keep)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_PERIOD, self._look_around, clock=steady)
        self.lane.every(_STEP_PERIOD, self._step)
        self.lane.every(_DIAGNOSTICS_PERIOD, self._diagnose)
        self.lane.start()

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse a period that would leave gaps. :raises ParameterError: it."""
        check(values)

    def _make_ledger(self) -> tuple[LedgerWriter, Witness]:
        values = self.values
        trend = Trend(
            _curves(values['commissioning.report']), values['commissioning.stop_tolerance']
        )
        file = values['ledger.file']
        path = Path(file).expanduser().absolute() if file else self.folder.path / 'ledger.jsonl'
        anchor = Path(values['ledger.anchor']).expanduser() if values['ledger.anchor'] else None
        written: list[dict[str, Any]] = []
        with suppress(OSError):  # it is new, or its writer says what is wrong
            _, written = tail(path)
        publish = self._ledger_topic.publish
        ledger = LedgerWriter(
            path, anchor, lambda line: self.lane.post(publish, String(data=line))
        )
        ledger.note('recorder started', node=self.get_fully_qualified_name(), **_versions())
        actuators = {name for name, device in devices().items() if device.actuator}
        tried = Tried(values['commissioning.test_interval'], actuators, written)
        return ledger, Witness(_read, ledger.note, written, trend, tried)

    # Lifecycle.

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to listen."""
        self.active = True
        kept, path = self.values['seconds'], self.folder.path
        self._log(f'keeping the last {kept:g} s; recordings go to {path}', True)
        self._look_around()
        return super().on_activate(state)

    def shut_down(self) -> None:
        """Leave, and end the thread that writes."""
        super().shut_down()
        self._writer.stop(_LEAVE_TIME)
        self._ledger.note('recorder ended')
        self._ledger.stop(_LEAVE_TIME)

    def leave(self) -> None:
        """Complete the file, and forget what was heard."""
        super().leave()
        for _, subscription in self._topics.values():
            self.lane.unsubscribe(subscription)
        self._topics = {}
        try:
            self.lane.call(self._end)
        except TimeoutError as error:
            self._log(str(error), False)

    # What there is to hear; in the executor's thread.

    def _look_around(self) -> None:
        """Subscribe to all that the package's nodes publish and listen to."""
        if not self.active:
            return
        with suppress(OSError, RuntimeError):  # it is tried again; RuntimeError: no home
            for refused in refusals.take():
                self._ledger.note('refused', **refused)
        topics: dict[str, str] = {}
        starts: dict[str, set[bytes]] = {}
        muxes = []
        for name, namespace in self.get_node_names_and_namespaces():
            full = f'{namespace.rstrip("/")}/{name}'
            try:
                published = dict(self.get_publisher_names_and_types_by_node(name, namespace))
                heard = self.get_subscriber_names_and_types_by_node(name, namespace)
            except NodeNameNonExistentError:  # it has just left
                continue
            if 'std_msgs/msg/Bool' not in published.get(f'{full}/estop', ()):
                continue
            publishers = self.get_publishers_info_by_topic(f'{full}/estop')
            starts[full] = {bytes(each.endpoint_gid) for each in publishers}
            if 'diagnostic_msgs/msg/DiagnosticStatus' in published.get(f'{full}/status', ()):
                muxes.append(full)
            topics |= {topic: kinds[0] for topic, kinds in [*published.items(), *heard]}
        before, known = self._nodes, self._asked.known
        self._nodes = Nodes(tuple(sorted(starts)), tuple(sorted({*muxes})))
        if self._nodes != before:
            self.lane.post(self._triggers.know, self._nodes)
        self._asked.look(starts, clock.now())
        if self._nodes != before or self._asked.known is not known:
            self.lane.post(self._witness.know, *self._nodes, self._asked.known)
        for topic, kind in topics.items():
            self._listen(topic, kind)

    def _listen(self, topic: str, kind: str) -> None:
        publishers = self.get_publishers_info_by_topic(topic)
        if not publishers or topic in self._unknown:
            return
        durability = DurabilityPolicy.TRANSIENT_LOCAL
        latched = all(each.qos_profile.durability == durability for each in publishers)
        before, subscription = self._topics.get(topic, (not latched, None))
        if before == latched:
            return
        if subscription is not None:
            self.lane.unsubscribe(subscription)
        try:
            message_type = message_class(kind)
            channel = Channel(topic, kind, definition_of(kind), latched)
        except LookupError as error:
            self._unknown[topic] = str(error)
            self._log(f'{topic} is not recorded: {error}', False)
            return
        on_message = partial(self._on_message, channel)
        qos = _LATCHED if latched else _PASSING
        subscription = self.lane.subscribe(message_type, topic, on_message, qos, raw=True)
        self._topics[topic] = latched, subscription

    # What is heard; on the lane.

    def _on_message(self, channel: Channel, data: bytes, info: Any) -> None:
        at = clock.now() - waited(info)
        sent = info['source_timestamp'] or info['received_timestamp']
        heard = Heard(at, at - (info['received_timestamp'] - sent) * 1e-9, channel, data)
        self._ring.add(heard)
        if self._schedule.is_open:
            self._batch.append(heard)
        reason = self._triggers.reason_of(channel.topic, data)
        if reason:
            self._schedule.ask(reason, at)
        self._witness.hear(channel.topic, data, at)

    def _step(self, now: float) -> None:
        """Begin, continue and end a recording."""
        schedule = self._schedule
        if schedule.is_open and self._writer.error:  # it failed; the next stop has one of its own
            schedule.is_open, schedule.reason = False, ''
        if self._batch:
            self._batch.sort(key=lambda heard: heard.at)
            self._writer.add(self._batch)
            self._batch = []
        if schedule.may_end(now):
            self._end()
        if self.active and schedule.may_begin(now):
            self._begin(now)

    def _begin(self, now: float) -> str:
        self._schedule.begin(now)
        return self._writer.begin(self._reason(), self._asked.known, self._ring.messages())

    def _end(self) -> None:
        if self._schedule.is_open:
            self._writer.add(self._batch)
            self._batch = []
            self._writer.finish(self._reason(), self._asked.known)
            self._schedule.ended(clock.now())
        if not self.active:
            self._ring.clear()
            self._schedule.reason = ''

    def _reason(self) -> str:
        reason, by = self._schedule.reason, self._triggers.stopped_by
        return f'{STOP}_{by}' if reason == STOP and by else reason

    def _on_save(self, request: Any, response: Any) -> Any:
        del request
        try:
            answer = self.lane.call(self._save)
        except TimeoutError as error:
            answer = Coded('recorder.hangs', f'call it again, nothing is recorded: {error}')
        if not isinstance(answer, Coded):  # it is to be on the disk, too
            if not self._writer.wait(_SAVE_TIME):
                answer = _SLOW_DISK
            elif self._writer.error:
                answer = Coded('recorder.failed', f'nothing is recorded: {self._writer.error}')
        return _answered(response, answer)

    def _save(self) -> str:
        if not self.active:
            text = 'nothing is recorded: the recorder is not active'
            return passed_on(NOT_ACTIVE, text)
        now = clock.now()
        if self._writer.error:  # of the one that seems to be open
            self._schedule.is_open = False
        self._schedule.ask('save', now, at_once=True)
        if self._schedule.may_begin(now):
            self._begin(now)
        after = self._schedule.after
        return f'recording to {self.folder.path}, for {after:g} s more'

    def _on_keep(self, request: Any, response: Any) -> Any:
        del request
        names: list[str] = []
        self._writer.keep(names.append)
        if not self._writer.wait(_SAVE_TIME):
            return _answered(response, _SLOW_DISK)
        if not names:
            return _answered(response, _NONE)
        kept = f'{names[0]} is never removed; what is in {KEPT}/ does not count'
        return _answered(response, kept)

    # What is said of it.

    def _say(self, text: str, ok: bool) -> None:
        """Say what became of a recording, in log and ledger."""
        self._log(text, ok)
        self._ledger.note('recording', says=text)

    def _log(self, text: str, ok: bool) -> None:
        if ok:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(text)

    def _diagnose(self, now: float) -> None:
        self._witness.look(now, time.time())
        name = self.get_fully_qualified_name().lstrip('/')
        path = str(self._ledger.book.path)
        array = DiagnosticArray(
            status=[
                to_msg(self._status(), f'{name}: recordings', str(self.folder.path), _CATALOGUE),
                to_msg(self._ledger_status(), f'{name}: ledger', path, _CATALOGUE),
            ]
        )
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _status(self) -> Status:
        writer, schedule = self._writer, self._schedule
        is_open = schedule.is_open and not writer.error
        values = {
            'recording': f'yes, because of {schedule.reason}' if is_open else 'no',
            'last recording': writer.last or 'none',
            'recordings': writer.count,
            'recordings (MB)': writer.size / _MB,
            'dropped messages': writer.dropped,
            'messages in memory': len(self._ring),
            'memory (MB)': self._ring.size / _MB,
            'nodes': ', '.join(self._nodes.all) or 'none',
            'parameters of': ', '.join(sorted(self._asked.known)) or 'none',
            'topics': len(self._topics),
        }
        values |= {f'not recorded {n}': text for n, text in enumerate(self._unknown.values(), 1)}
        nodes, name = self._nodes.all, self.get_fully_qualified_name()
        problems = of_recordings(writer.error, writer.dropped, nodes, name, active=self.active)
        return status_of(problems, values)

    def _ledger_status(self) -> Status:
        ledger, trend = self._ledger, self._witness.trend
        anchor = '' if ledger.anchor is None else ledger.anchor.error
        overdue = self._witness.tried.overdue(time.time())
        slower = [*trend.warnings.values()]
        values = {
            'lines': ledger.book.head.number,
            'head': ledger.book.head.digest,
            'anchored': 'no' if ledger.anchor is None or anchor else 'yes',
            'lost lines': ledger.lost,
            'last stop': self._witness.last_stop or 'none',
            'last seen to work': ', '.join(self._witness.tried.said(time.time())) or 'none',
        }
        for joint, stops in trend.recent.items():
            values[f'stops of {joint} (rad/s, s, commissioned s)'] = '; '.join(map(_stop, stops))
        return status_of(of_ledger(ledger.error, ledger.lost, anchor, slower, overdue), values)


@lru_cache(maxsize=1)  # a status is read for recordings, and again for the ledger
def _read(kind: str, data: bytes) -> Any:
    return deserialize_message(data, message_class(kind))


def _stop(numbers: Iterable[float | None]) -> str:
    return ' '.join('-' if each is None else f'{each:.2f}' for each in numbers)


def _versions() -> dict[str, str]:
    return {
        'version': version(),
        'ros': os.environ.get('ROS_DISTRO', 'unknown'),
        'python': platform.python_version(),
        'computer': platform.node(),
        'system': platform.release(),
    }


def _curves(report: str) -> dict[str, list[Point]]:
    """Return how joints stopped when commissioned. :raises ParameterError: it is no report."""
    if not report:
        return {}
    path = Path(report).expanduser()
    try:
        file = path / 'report.json' if path.is_dir() else path
        return curves_of(json.loads(file.read_text(encoding='utf-8')))
    except (OSError, ValueError) as error:
        text = f'parameter commissioning.report = {report!r}: {error}'
        raise ParameterError(text) from error


def _answered(response: Any, text: str) -> Any:
    """Return the answer: a reason why it failed, with its code behind it, or else what is done."""
    response.success = not isinstance(text, Coded)
    response.message = f'{text} [{text.code}]' if isinstance(text, Coded) else text
    return response


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([Recorder], beside('recorder', sys.argv), last=True))


if __name__ == '__main__':
    main()
