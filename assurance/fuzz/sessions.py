# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Sessions: a stop ends by a whole, sound message that says so, and by nothing else.

Whether there was one is judged here, by tables and checks of this package's own (see sound.py), on
all bytes of the time that a message counts for. The same holds for what is sent to an actuator.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any
import zlib

from akron_can_bridge.node import AkronCanBridge
from assurance.fuzz.campaign import Target
from assurance.fuzz.mutate import Input, joined, Kit, Repair, unrepaired
from esi_drive_bridge.node import EsiDriveBridge
from ssc_bridge.node import SscBridge
from stage.session_rig import SessionBench

_PAUSES = (0.0, 0.0, 0.01, 0.02, 0.049, 0.051, 0.1, 0.24, 0.26, 0.51, 1.1)
LATE = 0.11  # s that a frame may wait behind a partial one
_ENDS = 8  # of so many inputs one goes on with silence, damage, health, and a stop


@dataclass
class Heard:
    """What came, and what may count of it."""

    reads: list[tuple[float, bytes]] = field(default_factory=list)

    def since(self, moment: float) -> list[bytes]:
        return [data for at, data in self.reads if at >= moment]


Judge = Callable[[Heard, float, float], bool]  # now, and how long a message counts


@dataclass(frozen=True)
class Device:
    """
    A session, and what its device says.

    :param make: the session. :param timeout: s, its link_timeout.
    :param releases: whether what was heard since a moment may end a stop.
    :param health: reads that end every stop. :param stop: a read that is one.
    :param damaged: the same, with a message that matters damaged. :param memory: s, of others.
    :param before: what the node asks before a read, by its number.
    :param may_send: whether a frame may be sent; the same question as ``releases``.
    :param node: whose ``on_event`` logs.
    """

    name: str
    make: Callable[[], Any]
    timeout: float
    releases: Callable[[list[bytes], list[bytes]], bool]
    health: Sequence[bytes]
    stop: bytes
    damaged: Sequence[bytes]
    seeds: Sequence[Input]
    tokens: Sequence[bytes]
    repair: Repair = unrepaired
    frame_of: Callable[[bytes], Any] = bytes
    before: Callable[[Any, int, float], None] | None = None
    may_send: Callable[[Any, list[bytes]], bool] | None = None
    node: Any = None
    memory: float = 0.0


class SessionTarget(Target):
    """One session; see Device."""

    lines = (80_000, 1500)  # it sends meanwhile, whatever it reads
    most = 8000

    def __init__(self, device: Device) -> None:
        self.name = device.name
        self.kit = Kit(device.seeds, device.tokens, _PAUSES, device.repair)
        self._device = device
        self._bench: SessionBench[Any] | None = None

    def run(self, reads: Input) -> Hashable:
        """Hear it all; return which events there were and how it ended."""
        device = self._device
        bench = self._bench = SessionBench(device.make())
        heard = Heard()
        bench.open()
        for number, (pause, data) in enumerate(reads):
            if pause:
                bench.wait(pause)
                self._judge(bench, heard)
            if device.before is not None:
                device.before(bench.session, number, bench.now)
            heard.reads.append((bench.now, data))
            bench.take(device.frame_of(data))
            self._judge(bench, heard)
        seen = frozenset(type(event).__name__ for event in bench.events)
        result = seen, bench.session.estop, bench.session.link_up, min(len(bench.sent), 3)
        if device.node is not None:
            self._count_lines(bench, reads)
        if zlib.crc32(joined(reads)) % _ENDS == 0:
            self._end(bench)
        return result

    def _judge(self, bench: SessionBench[Any], heard: Heard) -> None:
        device, now = self._device, bench.now
        lately = heard.since(now - device.timeout - LATE)
        ever = heard.since(0.0)
        if not bench.session.estop:
            assert device.releases(lately, ever), 'no stop, and no message says so'
        if device.may_send is not None:
            for at, frame in bench.sent:
                if not device.may_send(frame, []):
                    then = [d for t, d in heard.reads if at - device.timeout - LATE <= t <= at]
                    assert device.may_send(frame, then), f'sent without reason: {frame!r}'
        bench.sent.clear()

    def _count_lines(self, bench: SessionBench[Any], reads: Input) -> None:
        """Log what the node does: lines without a site are as many as come."""
        node = _LoggingNode()
        for event in bench.events:
            if type(event).__name__ != 'Stopped':  # once for each time that motion was asked
                self._device.node.on_event(node, event)
        most = 1 + sum(pause for pause, _ in reads)
        assert node.lines <= most, f'{node.lines} log lines, {most:.0f} are enough'

    def _end(self, bench: SessionBench[Any]) -> None:
        device, session = self._device, bench.session
        bench.wait(max(device.timeout, device.memory) + 2 * LATE)
        assert session.estop, 'silence is no stop'
        for data in device.damaged:
            bench.take(device.frame_of(data))
        assert session.estop, 'a damaged message ended a stop'
        bench.wait(LATE)
        for data in device.health:
            bench.take(device.frame_of(data))
        assert not session.estop, f'it stays deaf: {session.stop_reasons(bench.now)}'
        bench.take(device.frame_of(device.stop))
        assert session.estop, 'a stop was missed'

    def kept(self) -> Any:
        """Return the session."""
        return None if self._bench is None else self._bench.session


class _LoggingNode:
    """Stands for a node in its ``on_event``: counts lines that no site holds back."""

    def __init__(self) -> None:
        self.lines = 0

    def log(self, level: Any, text: str, *, site: str = '') -> None:
        del level, text
        self.lines += not site

    def __getattr__(self, name: str) -> Any:
        for node in (SscBridge, EsiDriveBridge, AkronCanBridge):
            if name.startswith('_log') and hasattr(node, name):
                return getattr(node, name).__get__(self)
        return _Anything()


class _Anything:
    """Takes what is published."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        del arguments, named
        return self

    def __getattr__(self, name: str) -> Any:
        return self

    def __getitem__(self, key: Any) -> Any:
        return self

    def __setitem__(self, key: Any, value: Any) -> None: ...

    def __iter__(self) -> Any:
        return iter(())
