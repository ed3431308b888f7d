# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hold a recording against the mux's rules: which was broken, and when."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from bridge_core.parameters import full_topic, ParameterError
from bridge_core.proof import Proof, ProofError
from rugged_teleop.command_line import moment
from rugged_teleop.loaded import Loaded
from rugged_teleop.recordings import Said
from rugged_teleop.why.events import demand_of, fields_of, mux_values, Roles, wire_events
from rugged_teleop.why.rules import (
    Broken,
    DriveMonitor,
    enabled_again,
    Monitor,
    ProofMonitor,
    SELDOM,
)
from safety_mux.configuration import joint_limits
from safety_mux.intake import Intake, Listened
from safety_mux.protocol import AUTONOMY, Decision, Demand, MalformedInput, OperatorSample, State

SLACK = 0.05  # s that messages may be heard late, or in another order
_OBEYS = 0.05  # s in which a drive says what it was told
_STEP = 5.0  # s; later than that nothing comes, so its sender's clock has stepped
_OFTEN = 1.0  # s


@dataclass
class Verdict:
    """What came of one mux. :param unjudged: by rule, what the recording does not show."""

    mux: str
    decisions: int = 0
    broken: list[Broken] = field(default_factory=list)
    unjudged: dict[int, str] = field(default_factory=lambda: dict(SELDOM))


def verdicts(recording: Loaded, slack: float = SLACK) -> list[Verdict]:
    """Judge each mux of a recording. :raises ValueError: there is none, or not its parameters."""
    muxes = sorted(Roles.of(each.topic for each in recording.said).muxes)
    if not muxes:
        raise ValueError('no safety mux is in it')
    return [_verdict(name, recording, slack) for name in muxes]


def lines_of(verdict: Verdict) -> Iterator[str]:
    """Yield a verdict in words."""
    yield f'{verdict.mux}: {verdict.decisions} decisions'
    for each in verdict.broken:
        yield f'  {moment(each.at)}: rule {each.rule} is broken: {each.words}'
    if not verdict.broken:
        yield '  no rule was broken'
    for rule, why in sorted(verdict.unjudged.items()):
        yield f'  rule {rule} is not judged: {why} is not in it'


def _verdict(name: str, recording: Loaded, slack: float) -> Verdict:
    verdict = Verdict(name)
    try:
        values = mux_values(name, recording.parameters.get(name, {}))
        watch = _Watch(name, values, recording, slack, verdict)
    except ParameterError as error:
        words = f'it ran with what this version refuses: {error}'
        verdict.broken.append(Broken(recording.said[0].at, 16, words))
        return verdict
    verdict.broken += sorted(watch.run())
    if not verdict.decisions:
        raise ValueError(f'what {name} decided is not in it')
    return verdict


class _Watch:
    """Tells the monitors of one mux what was recorded. :raises ParameterError: bad values."""

    def __init__(
        self,
        name: str,
        values: Mapping[str, Any],
        recording: Loaded,
        slack: float,
        verdict: Verdict,
    ) -> None:
        self._name, self._values, self._said = name, values, recording.said
        self._slack, self._verdict = slack, verdict
        self._intake = Intake(values, 0.0)
        topic = partial(full_topic, name)
        self._inputs = {topic(values[each.parameter]): each for each in self._intake.topics()}
        self._button = topic(values['reset_topic']) if values['reset_topic'] else ''
        begin = self._said[0].at
        config = self._intake.config
        self._monitor = Monitor(config, joint_limits(values), slack, begin)
        for source in config.sources:
            self._monitor.expect(source.name)
        self._drives: dict[str, tuple[bool, float]] = {}  # what each said, and when
        self._monitors: dict[str, DriveMonitor] = {}  # by topic
        self._provers: dict[str, ProofMonitor] = {}  # by node
        self._offsets: dict[str, tuple[float, float]] = {}  # by topic: when, and of its clock
        drives = {path.rpartition('/')[0] for path, e in self._inputs.items() if e.kind == 'drive'}
        for path, each in self._inputs.items():
            full = path.rpartition('/')[0]
            node = recording.parameters.get(full, {})
            if full in drives or each.kind == 'operator':
                self._provers[full] = ProofMonitor(full in drives)
            if each.kind == 'drive' and 'command_timeout' in node:
                timeout = float(node['command_timeout']) + _OBEYS
                self._monitors[path] = DriveMonitor(timeout, slack)
        is_joints = values['output'] == 'joints'
        self._words = {'estop', 'enable', 'proof', 'command' if is_joints else 'cmd_vel'}
        self._now: dict[str, Any] = {}  # of the mux's outputs
        self._presses: list[float] = []
        self._held: dict[str, bool] = {}

    def run(self) -> Iterator[Broken]:
        """Yield what is broken."""
        asked = self._asked()
        last = self._said[0].at
        for said in self._said:
            if said.at - last > self._slack:
                self._monitor.missed(said.at - last)
                for monitor in self._monitors.values():
                    monitor.missed(said.at - last)
            last = said.at
            self._watch_clock(said)
            if place := bisect_right(asked, said.at + self._slack):
                self._monitor.reset(asked[place - 1])
            if said.message is not None:
                yield from self._hear(said)
        yield from self._on_the_wire()
        for prover in self._provers.values():
            if prover.is_judged:
                self._verdict.unjudged.pop(14 if prover.drives else 13, None)
        if not self._drives:
            self._verdict.unjudged[15] = self._verdict.unjudged[11] = 'what a drive says'

    def _watch_clock(self, said: Said) -> None:
        """Note a step of the clock of a node's computer; a recording's own clock has none."""
        if said.sent_at is None:
            return
        before, offset = self._offsets.get(said.topic), said.sent_at - said.at
        self._offsets[said.topic] = said.at, offset
        if before and said.at - before[0] < _OFTEN and abs(offset - before[1]) > _STEP:
            self._monitor.stepped = said.at
            self._verdict.unjudged.pop(8, None)

    def _asked(self) -> list[float]:
        """Return when somebody asked for a reset that counted; infinite: nothing tells."""
        found = []
        logs = [each for each in self._said if each.type == 'rcl_interfaces/msg/Log']
        for each in logs:
            log = each.message
            is_own = log is not None and '/' + log.name.replace('.', '/') == self._name
            if is_own and log.msg.startswith('~/reset: reset'):
                found.append(each.at)
            if is_own and log.msg.startswith('~/select_autonomy: autonomy has control'):
                self._presses.append(each.at)
        before = False
        for each in self._said:
            if self._button and each.topic == self._button and each.message is not None:
                if before and not each.message.data:
                    found.append(each.at)
                before = bool(each.message.data)
        if not logs:
            self._verdict.unjudged[3] = 'who asked for a reset'
            return [float('inf')]
        return sorted(found)

    def _hear(self, said: Said) -> Iterator[Broken]:
        node, _, word = said.topic.rpartition('/')
        listened = self._inputs.get(said.topic)
        if listened is not None:
            yield from self._input(listened, said)
        elif word == 'challenge' and node in self._provers:
            self._provers[node].asked()
        elif word == 'proof':
            self._proof(node, said.at)
            if node in self._provers:
                with suppress(ProofError):
                    proof = Proof.from_bytes(bytes(said.message.data))
                    sent_at = said.at if said.sent_at is None else said.sent_at
                    yield from self._provers[node].proves(proof, said.at, sent_at)
        if node != self._name:
            return
        if word in self._words:
            for monitor in self._monitors.values():
                names = ('estop', 'enable', 'command') if word == 'proof' else (word,)
                for each in names:
                    monitor.mux_said(each, said.at)
        if word in ('estop', 'enable'):
            self._now[word] = bool(said.message.data)
            for prover in self._provers.values() if word == 'enable' else ():
                prover.mux_enables(bool(said.message.data))
        elif word == 'status':
            yield from self._status(fields_of(said.message), said.at)
        elif word in ('command', 'cmd_vel') and word in self._words:
            yield from self._decided(demand_of(self._values, said.message), said.at)

    def _input(self, listened: Listened, said: Said) -> Iterator[Broken]:
        monitor, message, name = self._monitor, said.message, listened.name
        if listened.kind == 'e-stop source' and not listened.parameter.endswith('own_topic'):
            monitor.source(name, bool(message.data), said.at)
        elif listened.kind == 'operator':
            try:
                sample = self._intake.mappings[name].sample(message.axes, message.buttons)
            except MalformedInput:
                monitor.operator(name, None, said.at)
                return
            if sample.deadman and not self._held.get(name):
                self._presses.append(said.at)
            self._held[name] = sample.deadman
            monitor.operator(name, sample, said.at)
        elif listened.kind == 'autonomy':
            sample = OperatorSample(neutral=True, deadman=False, demand=())
            monitor.operator(AUTONOMY, sample, said.at)
        elif listened.kind == 'drive':
            self._drives[name] = bool(message.data), said.at
            prover = self._provers[said.topic.rpartition('/')[0]]
            yield from prover.enabled(bool(message.data), said.at)
            if said.topic in self._monitors:
                yield from self._monitors[said.topic].says(bool(message.data), said.at)

    def _proof(self, node: str, at: float) -> None:
        """A node that proves how old its words are need not have each of them heard."""
        for topic, each in self._inputs.items():
            if topic.rpartition('/')[0] != node:
                continue
            if each.kind == 'e-stop source':
                self._monitor.source(each.name, None, at)
            elif each.kind == 'operator':
                self._monitor.proven(each.name, at)
            elif each.name in self._drives:
                self._drives[each.name] = self._drives[each.name][0], at

    def _status(self, fields: Mapping[str, str], at: float) -> Iterator[Broken]:
        state, owner = fields.get('state', ''), fields.get('owner', 'none')
        if state in State.__members__:
            self._now |= {'state': State[state], 'owner': None if owner == 'none' else owner}
            inhibits = [text for key, text in fields.items() if key.startswith('inhibit ')]
            yield from self._monitor.status(state, inhibits, at)

    def _decided(self, demand: Demand, at: float) -> Iterator[Broken]:
        if len(self._now) < 4 or len(demand) != self._intake.config.joints:
            return
        now = self._now
        estop, enable = now['estop'], now['enable']
        decision = Decision(now['state'], now['owner'], enable, demand, estop, {})
        limit = self._intake.config.drive_timeout
        waits = None
        if self._drives:
            waits = not all(on and at - last < limit for on, last in self._drives.values())
        self._verdict.decisions += 1
        yield from self._monitor.decided(decision, at, waits=waits)

    def _on_the_wire(self) -> Iterator[Broken]:
        """Judge what went out to drives, where the bytes are recorded."""
        packets: dict[str, list[tuple[float, bool]]] = {}
        for event in wire_events(self._said):
            packets.setdefault(event.what.partition(' ')[2], []).append((event.at, event.value))
        presses = [at - self._slack for at in sorted(self._presses)]
        for node, told in packets.items():
            for at in enabled_again(told, presses):
                yield Broken(at, 4, f'{node} enabled its drive before a new press of a deadman')


def judged(recording: Loaded, slack: float = SLACK) -> int:
    """Print what comes of it; return the exit status."""
    found: Sequence[Verdict] = verdicts(recording, slack)
    for verdict in found:
        for line in lines_of(verdict):
            print(line)
    return int(any(verdict.broken for verdict in found) or not recording.whole)
