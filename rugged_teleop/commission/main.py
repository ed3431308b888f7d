# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Take a machine through its trial: every stop, operator, joint and cable is worked and measured.

Nothing moves before all stops were seen to work. What comes of it is a folder to keep and to sign:
report.html, report.json, the parameters and a manifest. It can be left and continued with the same
--folder; --step does steps again.

'verify FOLDER' says whether anything in it changed since; 'check FOLDER FILE' whether the
parameters are those that were tried.

Exit status: 0 passed, with or without exceptions, or nothing changed; 1 failed, not complete, or
something changed; 2 wrong arguments.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
from datetime import datetime
import os
from pathlib import Path
import platform
import secrets
import signal
import sys
import tempfile
from typing import Any, NoReturn, TYPE_CHECKING

from bridge_core.fingerprint import differences, fingerprint, version
from bridge_core.options import number_within
from bridge_core.parameter_files import parameters_for
from rugged_teleop.command_line import Parser, require
from rugged_teleop.commission import folder as folders
from rugged_teleop.commission.answers import read_answers, SKIP, WHO
from rugged_teleop.commission.daily import daily_steps, result_of
from rugged_teleop.commission.engine import Engine, LeftError
from rugged_teleop.commission.faces import Player, Terminal
from rugged_teleop.commission.machine import Machine, Node, STOP_LIMITS
from rugged_teleop.commission.step import Question, Record, Step
from rugged_teleop.commission.steps import steps_of
from rugged_teleop.devices import devices
from rugged_teleop.doctor.system import this_computer
from rugged_teleop.domains import claim_domain

if TYPE_CHECKING:
    from rugged_teleop.commission.browser import Browser
    from rugged_teleop.commission.running import Running

_STARTED = 10.0  # s in which nodes that were started have to speak
_EXAMPLES = """\
examples:
  {prog} my.yaml                             # the machine runs; its nodes are up
  {prog} my.yaml --folder acme-7             # again: goes on where it was left
  {prog} my.yaml --folder acme-7 --step motion.fort.remote
  {prog} my.yaml --page --host 0.0.0.0       # on a phone: with the token that it prints
  {prog} my.yaml --daily                     # each stop and each deadman once; for the ledger
  {prog} my.yaml --simulated --answers answers.yaml
  {prog} verify acme-7
  {prog} check acme-7 my.yaml
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    add = result.add_argument
    add('words', nargs='+', metavar='FILE', help="the machine's parameter file; or see above")
    add('--folder', type=Path, help='for the result (commissioning in this directory)')
    add('--step', action='append', default=[], help='do this one, whatever was done before')
    add('--daily', action='store_true', help='the daily check alone: each stop and each deadman')
    add('--simulated', action='store_true', help='play it with simulated devices')
    add('--answers', type=Path, help='YAML: answers by STEP.NAME, and skip: by step, why')
    patience = 'multiply all limits, with --simulated on a machine that is busy otherwise (1)'
    add('--page', action='store_true', help='ask on a page for browsers, not in this terminal')
    add('--host', default='127.0.0.1', help='IP address of the page; 0.0.0.0 for all (127.0.0.1)')
    add('--port', type=int, default=8080, help='its TCP port; 0 for any that is free (8080)')
    add('--patience', type=number_within(1.0, 100.0), default=1.0, metavar='N', help=patience)
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop commission') -> None:
    """Commission a machine; the command's entry point."""
    command_line = parser(prog)
    options = command_line.parse_args(arguments)
    first, *rest = options.words
    try:
        if first == 'verify' and len(rest) == 1:
            print(_words_of(folders.verify(Path(rest[0]))))
        elif first == 'check' and len(rest) == 2:
            _check(Path(rest[0]), Path(rest[1]))
        elif rest:
            command_line.error(f'{" ".join(options.words)}: give one parameter file')
        elif options.patience != 1.0 and not options.simulated:
            command_line.error('--patience: the limits of a real machine are what they are')
        else:
            require(prog, 'rclpy', 'mcap', *(('aiohttp',) if options.page else ()))
            _commission(Path(first), options)
    except folders.FolderError as error:
        print(f'{prog}: {error}', file=sys.stderr)
        sys.exit(1)
    except (OSError, ValueError) as error:
        print(f'{prog}: {error}', file=sys.stderr)
        sys.exit(2)


def read_machine(file: Path) -> tuple[Machine, list[str]]:
    """
    Return the machine of a parameter file, and what the doctor finds wrong in it.

    :raises ValueError: the file is refused, or has no mux, or several.
    """
    from rugged_teleop.doctor.configuration import configured, wiring
    from rugged_teleop.doctor.findings import Level

    nodes, findings = configured([file])
    refused = [each.text for each in findings if each.kind == 'parameters refused']
    if refused:
        raise ValueError('; '.join(refused))
    kinds = devices()
    made = [Node(each.full, each.values, kinds.get(each.name)) for each in nodes]
    muxes = [each.full for each in made if each.device is None]
    given = parameters_for(muxes[0], [file]) if muxes else {}
    findings += wiring(nodes)
    wrong = [each.text for each in findings if each.level is Level.DO]
    return Machine(made, given), wrong


def nodes_of(machine: Machine) -> dict[str, dict[str, Any]]:
    """Return all parameters, by node, as the fingerprint takes them."""
    return {each.full: dict(each.values) for each in (machine.mux, *machine.bridges)}


def _check(folder: Path, file: Path) -> None:
    """Compare, and exit with 1 if what decides is not what was tried."""
    report = folders.verify(folder)
    machine, _ = read_machine(file)
    changed = _changes(report, machine)
    print(_words_of(report))
    if changed:
        print('not validated: ' + '; '.join(changed))
    sys.exit(int(bool(changed)))


def _changes(report: Mapping[str, Any], machine: Machine) -> list[str]:
    """Return what is not as it was tried."""
    changed = differences(report['parameters'], nodes_of(machine))
    mux = report['parameters'].get(machine.mux.full, {})
    for name in STOP_LIMITS:  # which say nothing of the machine, and decide what passes
        if mux.get(name) != machine.values[name]:
            changed.append(f'{name} was {mux.get(name)}, is {machine.values[name]}')
    if report['version'] != version():
        changed.append(f'the package was {report["version"]}, is {version()}')
    return changed


def _words_of(report: Mapping[str, Any]) -> str:
    machine = report['machine'] + ' (simulated)' * report['simulated']
    words = f'{machine}: {report["verdict"]} on {report["date"]} by {report["who"]}'
    return '\n  '.join((words, *report['failed'], *report['exceptions']))


def _commission(file: Path, options: argparse.Namespace) -> None:
    given = file.read_bytes()  # as it is tried; somebody may edit it meanwhile
    machine, findings = read_machine(file)
    if options.daily:
        _daily(file, machine, options)
    steps = steps_of(machine, findings)
    names = {each.name for each in steps}
    for name in options.step:
        if name not in names:
            raise ValueError(f'--step {name}: there is {", ".join(sorted(names))}')
    answers = _answers(options, machine)
    folder = options.folder or Path('commissioning')
    folder.mkdir(parents=True, exist_ok=True)
    before, done = _before(folder, machine, options)
    _end_in_order()
    with contextlib.ExitStack() as exits:
        engine, face, running = _engine(exits, folder, file, machine, steps, answers, options)
        head: dict[str, Any] = {}

        def keep(record: Record) -> None:
            done[record.name] = record
            _save(folder, given, head, steps, done)

        try:
            head = _head(file, machine, before, face, options)
            for step in steps:
                if options.step and step.name not in options.step:
                    continue
                if not options.step and step.name in done and done[step.name].result == 'passed':
                    continue
                engine.run(step, engine.blocked(step, steps, done), keep)
        except (LeftError, KeyboardInterrupt):
            print('left; the same command goes on from here')
        if not head:
            sys.exit(1)
        report = _save(folder, given, head, steps, done)
        running.say(f'trial: {report["verdict"]}; {folder.absolute()}; by {report["who"]}')
        face.end(_words_of(report))
    print(f'see {folder / folders.PAGE}')
    sys.exit(int(report['verdict'] == 'failed' or len(done) < len(steps)))


def _daily(file: Path, machine: Machine, options: argparse.Namespace) -> NoReturn:
    """Do the daily check, and have it written into the ledger."""
    answers, steps = _answers(options, machine), daily_steps(machine)
    done: dict[str, Record] = {}

    def keep(record: Record) -> None:
        done[record.name] = record

    _end_in_order()
    with contextlib.ExitStack() as exits:
        engine, face, running = _engine(exits, None, file, machine, steps, answers, options)
        who = ''
        try:
            who = face.ask(Step(name='daily', title='The daily check'), Question('who', 'who:'))
            for step in steps:
                engine.run(step, engine.blocked(step, steps, done), keep)
        except (LeftError, KeyboardInterrupt):
            print('left')
        result = result_of(steps, done, who or 'nobody')
        is_written = running.say(f'daily check: {result}')
        note = '' if is_written else '\nIt is in no ledger: is the recorder running?'
        face.end(f'daily check: {result}{note}')
    sys.exit(int(not result.startswith('passed')))


def _end_in_order() -> None:
    """End a simulated machine also where this process is told to."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: sys.exit(128 + number))


def _save(
    folder: Path,
    given: bytes,
    head: Mapping[str, Any],
    steps: Sequence[Step],
    done: Mapping[str, Record],
) -> dict[str, Any]:
    in_order = {each.name: done[each.name] for each in steps if each.name in done}
    report = folders.report_of({**head, 'date': _date()}, steps, in_order)
    folders.write(folder, report, given)
    return report


def _answers(options: argparse.Namespace, machine: Machine) -> dict[str, Any]:
    nobody = options.simulated and not options.page
    answers = dict.fromkeys(WHO, 'not given') if nobody else {}
    if options.answers:
        answers |= read_answers(options.answers, [*steps_of(machine), *daily_steps(machine)])
    return answers


def _before(
    folder: Path, machine: Machine, options: argparse.Namespace
) -> tuple[Mapping[str, Any], dict[str, Record]]:
    """Return what stands above the steps of a trial that was left, and what was done in it."""
    folders.complete(folder)
    if not (folder / folders.REPORT).exists():
        return {}, {}
    before = folders.verify(folder)
    if changed := _changes(before, machine):
        raise ValueError(f'{folder} is of another trial: {"; ".join(changed)}')
    if before['simulated'] is not options.simulated:
        raise ValueError(
            f'{folder} is of {"a simulated" if before["simulated"] else "the"} machine'
        )
    return before, folders.records_of(before)


def _head(
    file: Path,
    machine: Machine,
    before: Mapping[str, Any],
    face: Terminal | Browser,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return what stands above the steps."""
    parameters = nodes_of(machine)
    step = Step(name='what', title='Which machine, where, and who tries it')
    return {
        **{name: before.get(name) or face.ask(step, Question(name, f'{name}:')) for name in WHO},
        'version': version(),
        'ros': os.environ.get('ROS_DISTRO', 'jazzy'),
        'python': platform.python_version(),
        'computer': _computer(),
        'simulated': options.simulated,
        'patience': options.patience,
        'file': file.name,
        'fingerprint': fingerprint(parameters),
        'parameters': parameters,
    }


def _computer() -> str:
    """Return what it is, and what its rights are for this user."""
    rights = this_computer()
    locks = 'may' if rights.locks else 'may not'
    return (
        f'{platform.node()}, {platform.system()} {platform.release()}; real-time priority up to '
        f'{rights.priority}, memory {locks} be locked'
    )


def _engine(
    exits: contextlib.ExitStack,
    kept: Path | None,
    file: Path,
    machine: Machine,
    steps: Sequence[Step],
    answers: Mapping[str, Any],
    options: argparse.Namespace,
) -> tuple[Engine, Terminal | Browser, Running]:
    """Return engine, face and machine; all end with ``exits``."""
    from rugged_teleop.commission.running import Running  # lazily: it needs ROS

    player: Player | None = None
    without_mux: Callable[[str], contextlib.AbstractContextManager[None]]
    if options.simulated:
        from rugged_teleop.commission.simulated import SimulatedMachine

        folder = Path(exits.enter_context(tempfile.TemporaryDirectory(prefix='rugged_teleop_')))
        exits.enter_context(contextlib.closing(claim_domain()))
        simulated = exits.enter_context(SimulatedMachine(file, folder, machine))
        skips = dict(answers.get(SKIP) or {})
        player = Player(
            answers, simulated.act, simulated.turned, skips, simulated.meter, simulated.waited
        )
        without_mux = simulated.without_mux
    else:

        def without_mux(drive: str) -> contextlib.AbstractContextManager[None]:
            return _asks_for_no_mux(face, drive)

    running = exits.enter_context(Running(machine, without_mux, kept))
    if options.simulated:
        running.wait_for_nodes(_STARTED * options.patience)
    face: Terminal | Browser = player or Terminal(answers)
    if options.page:
        face = _on_page(exits, running, steps, answers, player, options)
    return Engine(running, face, _date, options.patience), face, running


def _on_page(
    exits: contextlib.ExitStack,
    running: Running,
    steps: Sequence[Step],
    answers: Mapping[str, Any],
    player: Player | None,
    options: argparse.Namespace,
) -> Browser:
    """Return who is asked on a page. :raises OSError: it cannot be served."""
    from rugged_teleop.commission.browser import Browser  # lazily: it needs aiohttp
    from rugged_teleop.status_page.access import Access
    from rugged_teleop.status_page.server import address_of, Server

    token = secrets.token_urlsafe(18)
    names = (platform.node(), f'{platform.node()}.local')
    access = Access(options.host, names, token, control=True)
    face = Browser(running, lambda snapshot: server.publish(snapshot), answers, steps, player)
    server = Server(options.host, options.port, access, desk=face.take, front='commission.html')
    port = server.start()
    exits.callback(server.close)
    running.on_spin = face.refresh
    print(f'open {address_of(options.host, port, token)}', flush=True)
    return face


@contextlib.contextmanager
def _asks_for_no_mux(face: Terminal | Browser, drive: str) -> Iterator[None]:
    face.prompt(
        f'End the mux and {drive}. Start {drive} alone, not wired to the mux, with proof none'
    )
    try:
        yield
    finally:
        face.prompt('End it, and start both again as they were')


def _date() -> str:
    return datetime.now().astimezone().isoformat(' ', 'seconds')


if __name__ == '__main__':
    main()
