"""
Simulate a device on a port of its own: ``simulate fort_vsc --port /tmp/fort_vsc``.

Commands come a line each from standard input; ``help`` lists them. It runs until SIGINT or
SIGTERM, after the end of the input too, and takes its port away when it leaves.
"""

import argparse
from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Sequence
import os
from pathlib import Path
import select
import signal
import sys
from typing import Any
from typing import NoReturn

from esi_drive_bridge.simulator import HELP as ESI_HELP
from esi_drive_bridge.simulator import Simulator as EsiSimulator
from fort_vsc_bridge.simulator import Simulator as FortSimulator
from rugged_teleop.ptys import Device
from rugged_teleop.ptys import HELP as PORT_HELP
from rugged_teleop.ptys import PtyDevice

_OWN_HELP = """\
show                            print what can be seen
help                            print this"""
_VERBOSE_PERIOD = 0.1
# They change all the time: of no use where changes are printed.
_RESTLESS = {
    *('packets', 'sent', 'last_packet', 'host_heartbeats'),
    *('position_rad', 'current_a', 'lost_bytes'),
}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; ``--help`` says the rest."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')


def _fort_vsc(options: argparse.Namespace) -> Device:
    del options
    return FortSimulator()


def _esi_drive(options: argparse.Namespace) -> Device:
    return EsiSimulator(
        axes=options.axes, compact=options.compact, status_rate=options.status_rate
    )


def _fort_vsc_help() -> str:
    return '\n'.join(f'{name} {usage}' for name, (usage, _) in FortSimulator.commands.items())


# How each device is made from the options, and what it obeys.
DEVICES: dict[str, tuple[Callable[[argparse.Namespace], Device], Callable[[], str]]] = {
    'fort_vsc': (_fort_vsc, _fort_vsc_help),
    'esi_drive': (_esi_drive, lambda: ESI_HELP),
}


def parser() -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog='simulate', description=__doc__, allow_abbrev=False)
    devices = result.add_subparsers(dest='device', required=True, metavar='DEVICE')
    for name in DEVICES:
        device = devices.add_parser(name, allow_abbrev=False, help=f'simulate one {name}')
        device.add_argument(
            '--port', type=Path, required=True, help='this path becomes a link to the port'
        )
        device.add_argument('--seed', type=int, help='makes drop and corrupt repeat themselves')
        device.add_argument('--verbose', action='store_true', help='print what changes')
    drive = devices.choices['esi_drive']
    drive.add_argument('--axes', type=int, choices=(1, 2), default=2)
    drive.add_argument('--compact', action='store_true', help='short packets, for 1 axis')
    drive.add_argument('--status-rate', type=_rate, default=100.0, help='Hz, 1 to 1000')
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a simulator; the executable's entry point."""
    command_line = parser()
    options = command_line.parse_args(arguments)
    make, help_of = DEVICES[options.device]
    try:
        device = PtyDevice(make(options), options.port, seed=options.seed)
    except (OSError, ValueError) as error:
        command_line.error(str(error))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(0))
    with device:
        print(f'{options.device} on {options.port}; type help', flush=True)
        for line in _lines(device, options.verbose):
            _obey(device, line, f'{_OWN_HELP}\n{PORT_HELP}\n\n{options.device}:\n{help_of()}')


def _rate(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f'{text} is not within 1 to 1000')
    return value


def _lines(device: PtyDevice, verbose: bool) -> Iterator[str]:
    """Yield what is typed, line by line, for ever; print changes meanwhile."""
    descriptors, text, told = [sys.stdin.fileno()], '', seen(device)
    while True:
        if select.select(descriptors, [], [], _VERBOSE_PERIOD if verbose else None)[0]:
            data = os.read(descriptors[0], 4096)
            if not data:
                descriptors = []
            *lines, text = (text + data.decode(errors='replace')).split('\n')
            yield from lines
        if verbose:
            told = _tell_changes(device, told)


def _tell_changes(device: PtyDevice, told: dict[str, Any]) -> dict[str, Any]:
    state = seen(device)
    for name, value in state.items():
        if value != told.get(name):
            print(f'{name}: {value}', flush=True)
    return state


def seen(device: PtyDevice) -> dict[str, Any]:
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


def _obey(device: PtyDevice, line: str, help_text: str) -> None:
    """Obey one line; print the answer, if there is one."""
    words = line.split()
    if not words:
        return
    if words == ['help']:
        print(help_text, flush=True)
    elif words == ['show']:
        for name, value in device.describe().items():
            print(f'{name}: {_rounded(value)}', flush=True)
    else:
        try:
            device.apply(line)
        except ValueError as error:
            print(f'not done: {error}', flush=True)


if __name__ == '__main__':
    main()
