# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Harm the running system in motion, many times, and see what reaches the actuators.

``python -m assurance.campaign [-n COUNT] [--subject drive] [--localhost] [--json FILE]
[FAULT...]``: real processes; the drive and its VSC are played in C (rig.c), servo and monitor by
the simulators.

``python -m assurance.campaign random``: see random_campaign.py. Without that word:

- dead: the node ends. The device is told to stop within DEAD, that is the last it hears, and no
  process of the node is left.
- hung: the node stands still. The device is told to stop within HUNG, and no packet is later than
  GAP.
- wire: the process that owns the wire ends or stands still. The node's ``~/estop`` is true within
  TOLD, with the reason, and in the end one process owns it.
- quiet: nothing is harmed that motion needs. Nothing stops by itself, no packet is later than
  GAP, and a stop is carried out in HUNG. On a lossy link it is a stop of 5 ms, in OLD.
- old: what comes over a link grows old, from the remote to the mux or from there to the drive.
  The drive is told to stop within OLD of when the link's delay is beyond ``age_limit``; neither
  reset nor deadman move anything before it is young again.

After each, nothing moves until a reset and the deadman, and then it does.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
import contextlib
from dataclasses import asdict, dataclass, replace
import gc
import itertools
import json
import os
from pathlib import Path
import re
import signal
import sys
import tempfile
import time
from typing import Any

from assurance import held_lock, random_campaign
from assurance.benchmarks.chain import Variant
from assurance.benchmarks.rig import family, running, UnavailableError, use_own_domain, wires_of
from assurance.subjects import Sent, Subject, SUBJECTS, Terminal, TIMEOUT
from stage.devices import MUX, VSC
from stage.network import Network
from stage.relay import Relay, remapped
from stage.rig import Observer
from stage.run_delay import RunDelay

DEAD, HUNG, GAP, TOLD = 0.02, TIMEOUT + 0.01, 0.02, 0.1  # s
LIMIT = 0.25  # s; age_limit as delivered
OLD = LIMIT + 0.05
_COUNT = 20
_BLOCK = 0.1  # s for which the middleware blocks at a time
_AFTER = 0.7  # s for which it is watched that nothing moves by itself
_LAST = 5  # packets that are shown
_OLDEST = 2.0  # s
_TIMES = re.compile(r'[\d.]+ (ms|s)\b')  # they differ each time


class NoWireError(Exception):
    """No process of its own owns the wire."""


@dataclass
class Trial:
    """What one fault did; times in s from the fault; None: it never happened."""

    held: bool = False
    stopped: float | None = None  # first packet that says stop
    last: str = ''  # the last packets before the node came back, S a stop, m motion
    early: int = 0  # packets that say stop before it was asked for
    moved: int = 0  # packets that say motion, from the first stop until motion was permitted
    gap: float = 0.0  # the longest between two packets during the fault
    told: float | None = None  # the node's ~/estop
    mux_told: float | None = None  # the mux's
    waited: float = 0.0  # of all these processes, for a processor: what the machine took
    left: int = 0  # processes of the node that outlive it; owners of the wire off one
    back: bool = False  # in motion again, after reset and deadman
    mux: str = ''
    diagnostics: str = ''
    note: str = ''


@dataclass(frozen=True)
class Fault:
    """
    :param kind: what is expected; see above. :param lasts: s until it is undone.
    :param variant: another way to start the node of this name.
    :param within: s in which a node that is hung, or a link that is old, has to be stopped.
    :param network: of the link on which ``link`` speaks, a node.
    """

    name: str
    kind: str
    inject: Callable[[Subject], object]
    undo: Callable[[Subject], object] = lambda subject: None
    lasts: float = 1.0
    variant: Callable[[str], Variant | None] = lambda name: None
    within: float = HUNG
    network: Network | None = None
    link: str = ''


def signalled(number: signal.Signals) -> Callable[[Subject], None]:
    return lambda subject: subject.node.signal(number)


def wire_signalled(number: signal.Signals) -> Callable[[Subject], None]:
    def inject(subject: Subject) -> None:
        wires = wires_of(subject.node.process.pid)
        if not wires:
            raise NoWireError('no process of its own owns the wire')
        os.kill(wires[0], number)

    return inject


def wire_resumed(subject: Subject) -> None:
    """Let it go on, if the node has not ended it."""
    for wire in wires_of(subject.node.process.pid):
        os.kill(wire, signal.SIGCONT)


def _holder(name: str) -> Variant:
    return Variant('assurance.held_lock', ('--', name))


def _loud(name: str) -> Variant:
    return Variant(f'{name}.node', ('--log-level', 'rcl:=debug'))


def links() -> Iterator[Fault]:
    """Return what may be wrong with a link: name, network, and when it exceeds LIMIT, in s."""
    bloat = Network(rate=4e6, queue=1_000_000, other=4.5e6)
    growing = (
        ('delayed', Network(delay=1.0), 0.0),
        ('creeping', Network(creep=0.5, most=_OLDEST), LIMIT / 0.5),
        ('bufferbloat', bloat, LIMIT * bloat.rate / (bloat.other - bloat.rate)),
    )
    for name, link in (('remote', VSC), ('mux', MUX)):
        for what, network, exceeds in growing:
            within = exceeds + OLD
            rest: dict[str, Any] = {'lasts': within + 0.5, 'within': within, 'link': link}
            yield Fault(f'{what} {name}', 'old', _nothing, network=network, **rest)
        lossy = Network(loss=0.05)
        yield Fault(
            f'lossy {name}', 'quiet', _nothing, _nothing, 5.0, within=OLD, network=lossy, link=link
        )


def _nothing(subject: Subject) -> None:
    """Do it when the stage is at hand; see ``stage_of``."""
    del subject


FAULTS = (
    Fault('SIGKILL', 'dead', signalled(signal.SIGKILL)),
    Fault('SIGSEGV', 'dead', signalled(signal.SIGSEGV)),
    Fault('SIGHUP', 'dead', signalled(signal.SIGHUP), lasts=1.5),
    Fault('SIGSTOP', 'hung', signalled(signal.SIGSTOP), signalled(signal.SIGCONT)),
    Fault(
        'lock held',
        'hung',
        signalled(signal.SIGUSR1),
        lasts=held_lock.HELD + 0.2,
        variant=_holder,
    ),
    Fault(
        'publish blocks',
        'hung',
        signalled(signal.SIGUSR2),
        lasts=held_lock.HELD + 2.0,
        variant=_holder,
        within=HUNG + 2 * _BLOCK,  # between two blocks it runs, and what it takes then is fresh
    ),
    Fault(
        'Ctrl-S',
        'quiet',
        _nothing,  # with the terminal at hand
        lasts=2.0,
        variant=_loud,
    ),
    Fault('wire SIGKILL', 'wire', wire_signalled(signal.SIGKILL), lasts=2.0),
    Fault('wire SIGSTOP', 'wire', wire_signalled(signal.SIGSTOP), wire_resumed, lasts=2.0),
    *links(),
)


# One trial.


def harm(subject: Subject, fault: Fault) -> Trial:
    """
    Do it once, and let the system recover.

    :raises AssertionError: it does not recover. :raises NoWireError: there is nothing to harm.
    """
    subject.move()
    trial, pids = Trial(), family(subject.node.process.pid)
    if fault.kind == 'dead':
        subject.expect_end()
    delay = RunDelay([subject.node.process.pid])
    begin = time.monotonic()
    fault.inject(subject)
    stop_at = begin
    if fault.kind == 'quiet':
        subject.pause(fault.lasts)
        stop_at = time.monotonic()
        trial.early = sum(packet.is_stop for packet in subject.sent(begin))
        subject.ask_stop(brief=fault.network is not None)
        subject.pause(0.5)
    elif fault.kind == 'old':
        subject.pause(fault.lasts)
        subject.try_to_move()
    else:
        subject.pause(min(fault.lasts, 0.3))
        subject.stop()
        subject.pause(max(0.0, fault.lasts - 0.3))
    end, trial.waited = time.monotonic(), delay.seconds()
    observe(subject, trial, begin, stop_at, end)
    if fault.kind == 'dead':
        trial.left = sum(map(lives, pids))
    fault.undo(subject)
    if fault.kind == 'dead':
        subject.restart()
    recover(subject, trial, fault, stop_at)
    if fault.kind == 'wire':
        trial.left = abs(len(wires_of(subject.node.process.pid)) - 1)
    trial.held = holds(trial, fault, subject.period)
    return trial


def observe(subject: Subject, trial: Trial, begin: float, stop_at: float, end: float) -> None:
    sent = subject.sent(begin - 0.1)
    trial.stopped = first_stop(sent, stop_at)
    trial.last = ''.join('S' if packet.is_stop else 'm' for packet in sent[-_LAST:])
    times = [packet.at for packet in sent if packet.at < end]
    trial.gap = max((b - a for a, b in itertools.pairwise([*times, end])), default=end - begin)
    trial.told = first_true(subject.estop, stop_at)
    trial.mux_told = first_true(subject.mux_estop, stop_at)
    trial.mux, trial.diagnostics = subject.mux_says(), subject.diagnostics()
    lines = subject.node.output.splitlines()
    trial.note = next((line for line in reversed(lines) if held_lock.BLOCKED in line), '')


def first_stop(sent: Sequence[Sent], since: float) -> float | None:
    return next((p.at - since for p in sent if p.at > since and p.is_stop), None)


def first_true(record: Any, since: float) -> float | None:
    return next((at - since for at, message in record.since(since) if message.data), None)


def recover(subject: Subject, trial: Trial, fault: Fault, stop_at: float) -> None:
    """See that nothing moves by itself, and that it moves when told to."""
    if fault.kind != 'quiet':
        subject.wait(subject.is_back, 'the node without a stop', 30.0)
    subject.pause(_AFTER)
    subject.move()
    trial.back = True
    sent = subject.sent(stop_at)
    stop = first_stop(sent, stop_at)
    if stop is not None:
        trial.stopped = stop  # a wire's successor may take longer than the fault
        since = stop_at + stop
        if fault.kind == 'hung':  # until it is stopped, what it takes in between counts
            since = max(since, subject.asked_at + fault.within)
        trial.moved = sum(
            not packet.is_stop for packet in sent if since < packet.at < subject.released_at
        )


def lives(pid: int) -> bool:
    """Tell whether a process has not ended; one that nobody has waited for has."""
    with contextlib.suppress(OSError):
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    return False


def holds(trial: Trial, fault: Fault, period: float) -> bool:
    """Tell whether this is what the kind of fault expects; packets are due each period (s)."""
    rests = trial.back and trial.stopped is not None and not (trial.moved or trial.early)
    if fault.kind == 'dead':
        is_last = 'm' not in trial.last[-1:]
        return rests and within(trial.stopped, DEAD) and is_last and not trial.left
    if fault.kind == 'wire':
        return rests and within(trial.told, TOLD) and not trial.left
    paced = fault.network is not None or trial.gap <= period + GAP
    return rests and within(trial.stopped, fault.within) and paced


def within(seconds: float | None, limit: float) -> bool:
    return seconds is not None and seconds <= limit


# Many.


@contextlib.contextmanager
def stage_of(subject: str, fault: Fault) -> Iterator[tuple[Subject, Fault]]:
    """Set up a subject, and complete the fault with what it needs beside the node."""
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        observer = exits.enter_context(Observer('campaign'))
        kind = SUBJECTS[subject]
        variant = fault.variant(kind.name)
        variants = {kind.name: variant} if variant else {}
        if variant and fault.name == 'Ctrl-S':
            terminal = exits.enter_context(Terminal())
            variants = {kind.name: variant._replace(terminal=terminal.its)}
            shown = _completed(
                fault,
                lambda _: terminal.press_ctrl_s(),
                lambda _: terminal.press_ctrl_q(),
            )
            yield kind(folder, observer, exits, variants), shown
        elif fault.name == 'publish blocks':
            reader = exits.enter_context(running('-m', 'assurance.held_lock', 'reader'))
            exits.callback(reader.send_signal, signal.SIGCONT)
            target = kind(folder, observer, exits, variants)

            def inject(subject: Subject) -> None:
                reader.send_signal(signal.SIGSTOP)
                fault.inject(subject)

            yield target, _completed(fault, inject, lambda _: reader.send_signal(signal.SIGCONT))
        elif fault.network is not None:
            relay = exits.enter_context(Relay(fault.link))
            relay.set()
            variants = {fault.link: Variant(f'{fault.link}.node', tuple(remapped(fault.link)))}

            def calm(subject: Subject) -> None:
                relay.set()
                subject.pause(_OLDEST)  # until all that was sent before has come

            target = kind(folder, observer, exits, variants)
            yield target, _completed(fault, lambda _: relay.set(fault.network), calm)
        else:
            yield kind(folder, observer, exits, variants), fault


def _completed(
    fault: Fault, inject: Callable[[Subject], object], undo: Callable[[Subject], object]
) -> Fault:
    return replace(fault, inject=inject, undo=undo)


def campaign(subject: str, fault: Fault, count: int) -> list[Trial]:
    """Do it so often; a trial after which it does not recover is one that did not hold."""
    trials: list[Trial] = []
    while len(trials) < count:
        with stage_of(subject, fault) as (target, complete):
            try:
                while len(trials) < count:
                    gc.collect()  # not in a trial, where it would hold up a simulated device
                    trials.append(harm(target, complete))
            except NoWireError as error:
                return [Trial(note=str(error))]
            except (AssertionError, UnavailableError) as error:
                trials.append(Trial(note=' '.join(str(error).split())[-300:]))
    return trials


def row(subject: str, fault: Fault, trials: Sequence[Trial]) -> str:
    """Return a row of the table: the worst of each."""

    def worst(name: str) -> str:
        if (name == 'gap' and fault.kind == 'dead') or (name == 'mux_told' and subject != 'drive'):
            return ''
        values = [getattr(trial, name) for trial in trials if trial.back]
        if not values or None in values:
            return '-' if not values else 'never'
        return f'{1e3 * max(values):.0f}'

    lasts = Counter(trial.last for trial in trials if trial.back).most_common(1)
    cells = (
        f'{subject}: {fault.name}',
        fault.kind,
        f'{sum(trial.held for trial in trials)} of {len(trials)}',
        *map(worst, ('stopped', 'gap', 'told', 'mux_told')),
        lasts[0][0] if lasts else '-',
        str(sum(trial.early for trial in trials)),
        str(sum(trial.moved for trial in trials)),
        str(sum(trial.left for trial in trials)),
        worst('waited'),
    )
    return f'| {" | ".join(cells)} |'


HEAD = (
    '| fault | kind | held | stop out (ms) | gap (ms) | node says stop (ms) | mux says stop (ms) '
    '| last packets | stopped unasked | moved by itself | processes left '
    '| waited for a processor (ms) |\n|' + ' --- |' * 12
)


def said(trials: Sequence[Trial]) -> str:
    """Return what was said most often, and what went wrong."""
    lines = []
    for name in ('mux', 'diagnostics', 'note'):
        told = (getattr(trial, name) for trial in trials)
        texts = Counter(_TIMES.sub(r'… \1', text) for text in told if text)
        lines += [f'    {name} ({times} times): {text}' for text, times in texts.most_common(2)]
    return '\n'.join(lines)


def main() -> None:
    if sys.argv[1:2] == ['random']:
        random_campaign.main(sys.argv[2:])
        return
    parser = argparse.ArgumentParser(prog='python -m assurance.campaign', allow_abbrev=False)
    parser.add_argument('faults', nargs='*', metavar='FAULT', help='such as SIGKILL; all if none')
    parser.add_argument('-n', type=int, default=_COUNT, help=f'how often each ({_COUNT})')
    parser.add_argument('--subject', choices=SUBJECTS, help='one of them')
    parser.add_argument('--json', type=Path, help='write every trial to this file')
    network = 'without config/fastdds_loopback.xml: through shared memory, where a reader that is '
    network += 'halted holds up this process, too, and with it the simulated servo and monitor'
    parser.add_argument('--localhost', action='store_true', help=network)
    given = parser.parse_intermixed_args()
    unknown = set(given.faults) - {fault.name for fault in FAULTS}
    if unknown:
        parser.error(f'no fault {unknown.pop()!r}; there are {", ".join(f.name for f in FAULTS)}')
    use_own_domain(profile=not given.localhost)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nodes inherit what nohup made of it
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and leave no node behind
    gc.disable()
    print(HEAD, flush=True)
    results, words = {}, []
    try:
        for fault in FAULTS:
            for subject in SUBJECTS:
                if given.faults and fault.name not in given.faults:
                    continue
                if given.subject in (None, subject) and (subject == 'drive' or not fault.link):
                    trials = campaign(subject, fault, given.n)
                    print(row(subject, fault, trials), flush=True)
                    name = f'{subject}: {fault.name}'
                    results[name] = [asdict(trial) for trial in trials]
                    words.append(f'{name}\n{said(trials)}')
    except UnavailableError as error:
        raise SystemExit(f'campaign: skipped, {error}') from error
    finally:
        print('\n' + '\n'.join(words))
        if given.json:
            given.json.write_text(json.dumps(results, indent=1) + '\n', encoding='utf-8')
    held = all(trial['held'] for trials in results.values() for trial in trials)
    raise SystemExit(0 if held else 1)


if __name__ == '__main__':
    main()
