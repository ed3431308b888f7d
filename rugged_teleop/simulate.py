# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulate a device on a port of its own.

The VM-110 is on a multicast group, devices on CAN on a bus of python-can's, on this machine only
unless told otherwise. Commands come a line each from standard input; 'help' lists them. It runs
until 'quit', SIGINT, SIGTERM or SIGHUP, after the end of the input too, and takes its port away
when it leaves.
"""

import argparse
from collections.abc import Iterator, Sequence
import json
import os
from pathlib import Path
import signal
import sys
from typing import Any

from bridge_core.options import whole_within
from bridge_core.simulation import Report, Simulated
from bridge_core.waiting import ready
from rugged_teleop.canbuses import CanBusDevice, CHANNEL, INTERFACE
from rugged_teleop.command_line import Parser, standard_streams
from rugged_teleop.devices import devices, loaded
from rugged_teleop.multicasts import GROUP, INPUT_PORT, LOOPBACK, MulticastDevice, PORT_OFFSET
from rugged_teleop.ports import DevicePort, HELP as PORT_HELP
from rugged_teleop.ptys import PtyDevice

_OWN_HELP = """\
show                            print what can be seen
help                            print this
quit                            end"""
_EXAMPLES = """\
examples:
  {prog} fort_vsc --port /tmp/fort_vsc
  {prog} vm110 --verbose
  {prog} akron --type 1042
  {prog} esi_drive --port /tmp/esi_drive --apply 'inertia * 0.01' --apply 'brake * 0.5 0.05'
  {prog} esi_drive --port /tmp/esi_drive --as acme-7/report.json
  echo 'fault a overcurrent on' | {prog} esi_drive --port /tmp/esi_drive
"""
_VERBOSE_PERIOD = 0.1
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# They change all the time: of no use where changes are printed.
_RESTLESS = {
    *('packets', 'sent', 'last_packet', 'host_heartbeats'),
    *('position_rad', 'current_a', 'lost_bytes', 'received', 'displays'),
    *('rotation_deg', 'elevation_deg', 'axes', 'sources', 'cleared'),
    *('inputs_us', 'outputs_us', 'serial_us'),
}


_NODES = {name: each for each in devices().values() for name in loaded(each.simulators)}
DEVICES: dict[str, Simulated] = {
    name: loaded(device.simulators)[name] for name, device in _NODES.items()
}


def parser(prog: str = 'simulate') -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    kinds = result.add_subparsers(dest='device', required=True, metavar='DEVICE')
    for name, simulated in DEVICES.items():
        device = kinds.add_parser(name, help=f'simulate one {name}')
        _PORT_OPTIONS[simulated.port](device)
        simulated.options(device)
        device.add_argument('--seed', type=int, help='makes drop and corrupt repeat themselves')
        device.add_argument('--verbose', action='store_true', help='print what changes')
        device.add_argument(
            '--apply', action='append', default=[], metavar='LINE', help='obey this to begin with'
        )
        if simulated.as_measured:
            device.add_argument(
                '--as', type=Path, dest='report', help='be as commission found it; report.json'
            )
            device.add_argument('--node', default='', help='whose, where the report has several')
    return result


def _add_pty_options(device: argparse.ArgumentParser) -> None:
    device.add_argument(
        '--port', type=Path, required=True, help='this path becomes a link to the port'
    )


def _add_multicast_options(device: argparse.ArgumentParser) -> None:
    device.add_argument(
        '--port',
        type=whole_within(1, 0xFFFF - PORT_OFFSET),
        default=INPUT_PORT,
        help="UDP, the bridge's input_port",
    )
    device.add_argument('--group', default=GROUP, help='IPv4 multicast address')
    device.add_argument(
        '--interface-address',
        default=LOOPBACK,
        help='IPv4 address of the interface; empty: routed',
    )


def _add_can_options(device: argparse.ArgumentParser) -> None:
    device.add_argument('--interface', default=INTERFACE, help="python-can's name of its kind")
    device.add_argument('--channel', default=CHANNEL, help='such as can0, or a group:port')


_PORT_OPTIONS = {
    'pty': _add_pty_options,
    'multicast': _add_multicast_options,
    'can': _add_can_options,
}


def plug_in(options: argparse.Namespace) -> DevicePort:
    """Make a device with its port. :raises OSError, ValueError: that cannot be."""
    lines = [*_as_measured(options), *options.apply]
    port = _plug_in(options)
    try:
        port.apply(*lines)
    except ValueError:
        port.close()
        raise
    return port


def _as_measured(options: argparse.Namespace) -> list[str]:
    """Return what makes it the device of a report. :raises OSError, ValueError: nothing can."""
    path, device = getattr(options, 'report', None), options.device
    measured = DEVICES[device].as_measured
    if path is None or measured is None:
        return []
    try:
        report = json.loads(path.read_text(encoding='utf-8'))
        ours = [each for each in report['parameters'] if each.endswith(f'/{_NODES[device].name}')]
        node = options.node or (ours[0] if len(ours) == 1 else '')
        if node not in ours:
            raise ValueError(f'--node: it has {", ".join(ours) or f"no {device}"}')
        lines = measured(Report(report, node))
    except OSError as error:
        raise ValueError(f'--as {path}: {error.strerror}') from error
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError, UnicodeError) as error:
        raise ValueError(f'--as {path}: is no report: {error!r}') from error
    if not lines:
        raise ValueError(f'--as {path}: nothing of {node} was measured: do its steps first')
    print(f'as {path} has it: {"; ".join(lines)}', flush=True)
    return lines


def _plug_in(options: argparse.Namespace) -> DevicePort:
    simulated = DEVICES[options.device]
    device = simulated.make(options)
    if simulated.port == 'pty':
        try:
            return PtyDevice(device, options.port, seed=options.seed)
        except FileExistsError as error:
            raise ValueError(
                f'--port {options.port}: exists and is no link of ours; name another path'
            ) from error
        except OSError as error:
            raise ValueError(f'--port {options.port}: {error.strerror}') from error
    if simulated.port == 'can':
        return CanBusDevice(
            device, options.channel, interface=options.interface, seed=options.seed
        )
    return MulticastDevice(
        device,
        options.port,
        group=options.group,
        interface_address=options.interface_address,
        seed=options.seed,
    )


def main(arguments: Sequence[str] | None = None, prog: str = 'simulate') -> None:
    """Run a simulator; the executable's entry point."""
    with standard_streams(prog):
        _simulate(arguments, prog)


def _simulate(arguments: Sequence[str] | None, prog: str) -> None:
    command_line = parser(prog)
    options = command_line.parse_args(arguments)
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)  # until what is made is taken away again
    try:
        device = plug_in(options)
    except (OSError, ValueError) as error:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
        command_line.error(str(error))
    for number in _ENDING:
        signal.signal(number, _leave)
    help_lines = f'{_OWN_HELP}\n{PORT_HELP}\n\n{options.device}:\n{DEVICES[options.device].help}'
    with device:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
        print(f'{options.device} on {device.name}; type help', flush=True)
        for line in _lines(device, options.verbose):
            _obey(device, line, help_lines)


def _leave(*_: object) -> None:
    """End; the same signal again, as ros2 launch sends it after Ctrl-C, changes nothing."""
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)
    sys.exit(0)


def _lines(device: DevicePort, verbose: bool) -> Iterator[str]:
    """Yield what is typed, line by line, for ever; print changes meanwhile."""
    descriptors, text, told = [sys.stdin.fileno()], '', seen(device)
    while True:
        if ready(descriptors, _VERBOSE_PERIOD if verbose else None):
            data = os.read(descriptors[0], 4096)
            if not data:
                descriptors, data = [], b'\n'  # the last line may have no end
            *lines, text = (text + data.decode(errors='replace')).split('\n')
            yield from lines
        if verbose:
            before, told = told, seen(device)
            for name, value in told.items():
                if value != before.get(name):
                    print(f'{name}: {value}', flush=True)


def seen(device: DevicePort) -> dict[str, Any]:
    """Return what can be seen and does not change all the time; numbers rounded."""
    state = device.describe()
    return {name: _rounded(value) for name, value in state.items() if name not in _RESTLESS}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 2)
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return value


def _obey(device: DevicePort, line: str, help_lines: str) -> None:
    """Obey one line; print the answer, if there is one."""
    words = line.split()
    if not words:
        return
    if words == ['quit']:
        sys.exit(0)
    if words == ['help']:
        print(help_lines, flush=True)
    elif words == ['show']:
        for name, value in device.describe().items():
            print(f'{name}: {_rounded(value)}', flush=True)
    else:
        try:
            device.apply(line)
        except (OSError, ValueError) as error:
            print(f'not done: {error}', flush=True)


if __name__ == '__main__':
    main()
