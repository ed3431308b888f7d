# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drive for a while over a link that loses messages: who stops unasked, and is any stop missed?

``python -m assurance.lossy [--minutes 20] [--loss 0.05] [--bursts [S]] [--link mux] [--two-hosts]
[--preset radio] [-p NODE:NAME:=VALUE]... [--json FILE]``: real processes; VSC and drive are played
in C. Meanwhile the remote's e-stop is pressed for 5 ms, 200 times in all, with stick and deadman
held. Each must disable the drive in a second, and nothing may enable it before a reset.

The link is from remote to mux, from mux to drive, or both are; or from drive to mux. It is a relay
that loses messages; with --two-hosts a cable between network namespaces that loses packets (as
root). Stops that nobody asked for are counted by reason, and apart where a pause of the machine
explains them: one that was seen, or a process that says so of itself or of its wire, between which
no link is.

Exit status 1: a stop was missed, or undid itself.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
import contextlib
from dataclasses import dataclass, field
import gc
import json
from pathlib import Path
import re
import signal
import sys
import tempfile
import time
from typing import Final

from assurance.benchmarks.chain import DRIVE, MUX, Nodes, SPINE, Variant, VSC
from assurance.benchmarks.rig import Rig, UnavailableError, use_own_domain
from assurance.pauses import Pauses
from assurance.subjects import BRIEF
from assurance.two_hosts import Cable
from stage.network import Network, NetworkProcess
from stage.relay import Relay, remapped
from stage.rig import Observer
from stage.run_delay import WIRE_HELD_UP

_LINKS: Final = {  # who speaks on it
    'remote': (VSC,),
    'mux': (MUX,),
    'drive': (DRIVE,),
    'both': (VSC, MUX),
}
_FAR: Final = {**_LINKS, 'mux': (DRIVE,), 'both': (VSC, DRIVE)}  # on the other host
_PULSES = 200
_LOOK = 0.1  # s
_CARRIED = 1.0  # s in which a stop reaches the drive
_HELD = 0.6  # s for which deadman and stick are held after it
_BEFORE = 1.0  # s before a stop in which pauses count
_LINE = 60.0  # s between two lines
_TRIES = 10
_HELD_UP = ('was held up for', 'hangs: nothing was heard of it')
_LOGGED = re.compile(r'\[(?:WARN|ERROR)\] \[[\d.]+\] (.*)')
_OF_SOURCES = ('timeout', 'age_limit')
_NUMBERS = re.compile(r'\d+(\.\d+)?')


def _preset(limit: float) -> dict[str, dict[str, float]]:
    """Return what to set, of mux and drive, for a link that needs this ``age_limit`` (s)."""
    sources = [f'estop.{name}.{what}' for name in ('fort', 'drive') for what in _OF_SOURCES]
    drive = ('drive_enabled_timeout', 'drive_enabled_age_limit')
    names = (*sources, 'operator.fort.timeout', *drive)
    mux = {**dict.fromkeys(names, limit), 'operator.fort.age_limit': max(limit, 0.5)}
    mux['neutral_time'] = limit  # an operator's timeout is at most that
    return {MUX: mux, DRIVE: {'command_timeout': limit, 'age_limit': limit}}


# As docs/old_news.md has them.
PRESETS: Final = {'delivered': {}, 'radio': _preset(0.5), 'fading': _preset(0.6)}


@dataclass
class Result:
    """What a run has shown; times in s."""

    seconds: float = 0.0  # in motion
    false: Counter[str] = field(default_factory=Counter)  # stops nobody asked for, by reason
    paused: Counter[str] = field(default_factory=Counter)  # likewise, by pauses of the machine
    reactions: list[float] = field(default_factory=list)  # of stops that latched
    missed: list[str] = field(default_factory=list)

    def row(self) -> str:
        """Return the figures as cells of a table."""
        false, pulses = self.false.total(), len(self.reactions) + len(self.missed)
        cells = (
            *(f'{self.seconds / 60:.1f}', false, f'{3600 * false / max(1.0, self.seconds):.1f}'),
            *(self.paused.total(), pulses, len(self.reactions)),
            f'{1e3 * max(self.reactions, default=0.0):.0f}',
        )
        return ' | '.join(map(str, cells))

    def words(self) -> str:
        """Return the reasons."""
        lines = [f'false, {times} times: {text}' for text, times in self.false.most_common()]
        lines += [f'by a pause, {times} times: {text}' for text, times in self.paused.items()]
        return '\n'.join([*lines, *(f'MISSED: {text}' for text in self.missed)])


HEAD: Final = (
    '| link | loss | in motion (min) | false stops | an hour | by pauses of the machine '
    '| stops of 5 ms | latched | slowest (ms) |\n|' + ' --- |' * 9
)


class Run:
    """A spine, and what is seen of it."""

    def __init__(self, chain: Nodes, pauses: Pauses) -> None:
        self.chain, self.result = chain, Result()
        self._pauses = pauses
        self._read: Counter[str] = Counter()  # bytes of each node's output

    def move(self) -> None:
        """Be in motion. :raises UnavailableError: it does not move."""
        for _ in range(_TRIES):
            try:
                self.chain.move()
            except AssertionError as error:
                why = str(error)
            else:
                list(self._logged())
                return
        raise UnavailableError(f'it does not move: {why}')

    def go(self, seconds: float) -> bool:
        """Be in motion for so long; tell whether nothing has stopped it."""
        begin = looked = time.monotonic()
        stopped: float | None = None
        while stopped is None and time.monotonic() < begin + seconds:
            self.chain.pause(_LOOK)
            stopped = self._disabled(looked)
            looked = time.monotonic() - _LOOK
        self.result.seconds += (stopped or time.monotonic()) - begin
        if stopped is not None:
            self._note_false_stop(stopped)
        return stopped is None

    def _disabled(self, since: float) -> float | None:
        packets = self.chain.rig.packets(since)
        return next((packet.at for packet in packets if not packet.enables), None)

    def _note_false_stop(self, at: float) -> None:
        with contextlib.suppress(AssertionError):  # the drive's node may have stopped by itself
            self.chain.wait(lambda: self.chain.state == 'STOPPED', 'the mux', 1.0)
        words = [self.chain.why, *self._logged()]
        why = _NUMBERS.sub('…', ' | '.join(dict.fromkeys(words)))
        by_pause = self._pauses.between(at - _BEFORE, at) > WIRE_HELD_UP
        held_up = by_pause or any(text in why for text in _HELD_UP)
        (self.result.paused if held_up else self.result.false)[why] += 1

    def _logged(self) -> Iterator[str]:
        """Yield what the nodes have logged since it was asked, warnings and worse."""
        for name, node in self.chain.nodes.items():
            text = node.output_from(self._read[name])
            self._read[name] += len(text)
            yield from _LOGGED.findall(text)

    def press(self) -> None:
        """Press the e-stop for 5 ms, and see that it latches."""
        rig, at = self.chain.rig, time.monotonic()
        rig.say('estop 1')
        time.sleep(BRIEF)
        rig.say('estop 0')
        self.chain.pause(_HELD)
        try:
            self.chain.wait(lambda: self._disabled(at), 'a disable packet', _CARRIED - _HELD)
        except AssertionError as error:
            self.result.missed.append(str(error))
            return
        packets = [packet for packet in rig.packets(at) if packet.at > at]
        first = next(number for number, packet in enumerate(packets) if not packet.enables)
        again = sum(packet.enables for packet in packets[first:])
        if again or self.chain.state != 'STOPPED':
            self.result.missed.append(f'{self.chain.why}; {again} packets enable after it')
        else:
            self.result.reactions.append(packets[first].at - at)


@contextlib.contextmanager
def running(given: argparse.Namespace, network: Network) -> Iterator[Run]:
    """Have the spine on a link like this."""
    parameters = {name: dict(PRESETS[given.preset].get(name, {})) for name in SPINE}
    for name, key, value in given.p:
        parameters[name][key] = value
    words = {
        name: [word for each in values.items() for word in ('-p', '{}:={}'.format(*each))]
        for name, values in parameters.items()
    }
    cable = Cable() if given.two_hosts else None
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        rig = exits.enter_context(Rig(folder))
        carriers: list[NetworkProcess] = [cable.network] if cable else []
        for name in () if cable else _LINKS[given.link]:
            carriers.append(Relay(name))
            words[name] += remapped(name)
        for carrier in carriers:
            exits.enter_context(carrier)
        observer = exits.enter_context(Observer('lossy'))
        pauses = exits.enter_context(Pauses())
        variants = {name: Variant(f'{name}.node', tuple(words[name])) for name in SPINE}
        hosts = dict.fromkeys(_FAR[given.link], cable.there) if cable else {}
        chain = Nodes(rig, observer, exits, variants=variants, hosts=hosts)
        chain.neutral_time += PRESETS[given.preset].get(MUX, {}).get('neutral_time', 0.0)
        run = Run(chain, pauses)
        run.move()
        for carrier in carriers:
            carrier.set(network)
        yield run


def drive(run: Run, minutes: float, pulses: int) -> None:
    """Be in motion for so long, with a stop now and then. :raises UnavailableError: it cannot."""
    result, line = run.result, time.monotonic() + _LINE
    each = 60 * minutes / max(1, pulses)
    while result.seconds < 60 * minutes:
        run.move()
        pressed = len(result.reactions) + len(result.missed)
        if run.go(max(_LOOK, each * (pressed + 1) - result.seconds)) and pressed < pulses:
            run.press()
        gc.collect()  # not while it is measured
        if time.monotonic() > line:
            line += _LINE
            print(f'    {result.row()}', flush=True)


def given_by(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return what the command line says."""
    parser = argparse.ArgumentParser(prog='python -m assurance.lossy', allow_abbrev=False)
    parser.add_argument('--minutes', type=float, default=20.0, help='of motion (20)')
    parser.add_argument('--loss', type=float, default=0.05, help='share that is lost (0.05)')
    bursts = 's, at most, of the bursts that it is lost in (0: each by itself)'
    parser.add_argument('--bursts', type=float, nargs='?', const=0.15, default=0.0, help=bursts)
    parser.add_argument('--delay', type=float, default=0.0, help='s, each way (0)')
    parser.add_argument('--jitter', type=float, default=0.0, help='s on top, at most (0)')
    parser.add_argument('--pulses', type=int, default=_PULSES, help=f'stops of 5 ms ({_PULSES})')
    parser.add_argument('--link', choices=_LINKS, default='mux', help='who speaks on it (mux)')
    parser.add_argument('--two-hosts', action='store_true', help='in network namespaces; as root')
    parser.add_argument('--preset', choices=PRESETS, default='delivered', help='of time-outs')
    one = 'another parameter, such as safety_mux:estop.fort.age_limit:=0.4'
    parser.add_argument(
        '-p', action='append', type=_parameter, default=[], metavar='NODE:NAME:=VALUE', help=one
    )
    parser.add_argument('--json', type=Path, help='write all figures to this file')
    return parser.parse_args(arguments)


def _parameter(text: str) -> tuple[str, str, str]:
    found = re.fullmatch(r'(\w+):([\w.]+):=(.+)', text)
    if found is None or found[1] not in SPINE:
        raise argparse.ArgumentTypeError(f'{text!r} is not NODE:NAME:=VALUE, of {SPINE}')
    return found[1], found[2], found[3]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; return the exit status."""
    given = given_by(arguments)
    network = Network(loss=given.loss, burst=given.bursts, delay=given.delay, jitter=given.jitter)
    use_own_domain(profile=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and leave no node behind
    result = None
    gc.disable()
    try:
        with running(given, network) as run:
            result = run.result
            drive(run, given.minutes, given.pulses)
    except UnavailableError as error:
        print(f'lossy: ended, {error}', file=sys.stderr)
        return 2
    finally:
        if result is not None:
            hosts = ', two hosts' if given.two_hosts else ''
            print(f'{HEAD}\n| {given.link}{hosts}, {given.preset} | {network} | {result.row()} |')
            print(result.words())
    if given.json:
        text = json.dumps(vars(given) | vars(result), default=str, indent=1)
        given.json.write_text(text + '\n', encoding='utf-8')
    return int(bool(result.missed))


if __name__ == '__main__':
    sys.exit(main())
