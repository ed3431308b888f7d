"""
Simulate a device on a port of its own: ``simulate fort_vsc --port /tmp/fort_vsc``.

The VM-110 is on a multicast group: ``simulate vm110``, on this machine only unless told otherwise.
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

from bridge_core.simulation import help_text
from esi_drive_bridge.simulator import HELP as ESI_HELP
from esi_drive_bridge.simulator import Simulator as EsiSimulator
from fort_vsc_bridge.simulator import Simulator as FortSimulator
from rugged_teleop.multicasts import GROUP
from rugged_teleop.multicasts import INPUT_PORT
from rugged_teleop.multicasts import LOOPBACK
from rugged_teleop.multicasts import MulticastDevice
from rugged_teleop.multicasts import PORT_OFFSET
from rugged_teleop.ports import Device
from rugged_teleop.ports import DevicePort
from rugged_teleop.ports import HELP as PORT_HELP
from rugged_teleop.ptys import PtyDevice
from vm110_bridge.simulator import Simulator as Vm110Simulator

_OWN_HELP = """\
show                            print what can be seen
help                            print this"""
_VERBOSE_PERIOD = 0.1
# They change all the time: of no use where changes are printed.
_RESTLESS = {
    *('packets', 'sent', 'last_packet', 'host_heartbeats'),
    *('position_rad', 'current_a', 'lost_bytes', 'received', 'displays'),
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


def _vm110(options: argparse.Namespace) -> Device:
    return Vm110Simulator(options.bu_id, crc=options.crc)


# How each device is made from the options, and what it obeys.
DEVICES: dict[str, tuple[Callable[[argparse.Namespace], Device], Callable[[], str]]] = {
    'fort_vsc': (_fort_vsc, lambda: help_text(FortSimulator.commands)),
    'esi_drive': (_esi_drive, lambda: ESI_HELP),
    'vm110': (_vm110, lambda: help_text(Vm110Simulator.commands)),
}


def parser() -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog='simulate', description=__doc__, allow_abbrev=False)
    devices = result.add_subparsers(dest='device', required=True, metavar='DEVICE')
    for name in DEVICES:
        device = devices.add_parser(name, allow_abbrev=False, help=f'simulate one {name}')
        if name != 'vm110':
            device.add_argument(
                '--port', type=Path, required=True, help='this path becomes a link to the port'
            )
        device.add_argument('--seed', type=int, help='makes drop and corrupt repeat themselves')
        device.add_argument('--verbose', action='store_true', help='print what changes')
    drive = devices.choices['esi_drive']
    drive.add_argument('--axes', type=int, choices=(1, 2), default=2)
    drive.add_argument('--compact', action='store_true', help='short packets, for 1 axis')
    drive.add_argument('--status-rate', type=_rate, default=100.0, help='Hz, 1 to 1000')
    _add_vm110_options(devices.choices['vm110'])
    return result


def _add_vm110_options(unit: argparse.ArgumentParser) -> None:
    unit.add_argument(
        '--port', type=_input_port, default=INPUT_PORT, help="UDP, the bridge's input_port"
    )
    unit.add_argument('--group', default=GROUP, help='IPv4 multicast address')
    unit.add_argument(
        '--interface-address',
        default=LOOPBACK,
        help='IPv4 address of the interface; empty: routed',
    )
    unit.add_argument('--bu-id', type=_bu_id, default=7, help='of the base unit, 1 to 65535')
    unit.add_argument('--crc', choices=('mpeg2', 'iso_hdlc'), default='mpeg2')


def _plug_in(device: Device, options: argparse.Namespace) -> DevicePort:
    """Give a device its port. :raises OSError: that cannot be made."""
    if options.device != 'vm110':
        return PtyDevice(device, options.port, seed=options.seed)
    return MulticastDevice(
        device,
        options.port,
        group=options.group,
        interface_address=options.interface_address,
        seed=options.seed,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a simulator; the executable's entry point."""
    command_line = parser()
    options = command_line.parse_args(arguments)
    make, help_of = DEVICES[options.device]
    try:
        device = _plug_in(make(options), options)
    except (OSError, ValueError) as error:
        command_line.error(str(error))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(0))
    with device:
        print(f'{options.device} on {device.name}; type help', flush=True)
        for line in _lines(device, options.verbose):
            _obey(device, line, f'{_OWN_HELP}\n{PORT_HELP}\n\n{options.device}:\n{help_of()}')


def _rate(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f'{text} is not within 1 to 1000')
    return value


def _input_port(text: str) -> int:
    return _whole(text, 0xFFFF - PORT_OFFSET)


def _bu_id(text: str) -> int:
    return _whole(text, 0xFFFF)


def _whole(text: str, high: int) -> int:
    value = int(text) if text.isdecimal() else 0
    if not 1 <= value <= high:
        raise argparse.ArgumentTypeError(f'{text} is not within 1 to {high}')
    return value


def _lines(device: DevicePort, verbose: bool) -> Iterator[str]:
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


def _tell_changes(device: DevicePort, told: dict[str, Any]) -> dict[str, Any]:
    state = seen(device)
    for name, value in state.items():
        if value != told.get(name):
            print(f'{name}: {value}', flush=True)
    return state


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


def _obey(device: DevicePort, line: str, help_text: str) -> None:
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
        except (OSError, ValueError) as error:
            print(f'not done: {error}', flush=True)


if __name__ == '__main__':
    main()
