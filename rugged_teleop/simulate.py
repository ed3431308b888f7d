# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Simulate a device on a port of its own.

The VM-110 is on a multicast group, devices on CAN on a bus of python-can's, on this machine only
unless told otherwise. Commands come a line each from standard input; 'help' lists them. It runs
until 'quit', SIGINT, SIGTERM or SIGHUP, after the end of the input too, and takes its port away
when it leaves.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import re
import select
import signal
import sys
from typing import Any, Literal

from akron_can_bridge.protocol import is_pin
from akron_can_bridge.simulator import (
    JoystickSimulator as AkronJoystick,
    Simulator as AkronSimulator,
)
from bridge_core.simulation import help_text
from esi_drive_bridge.simulator import FAULTS, Simulator as EsiSimulator
from fort_vsc_bridge.protocol import AXIS_NAMES, BUTTON_NAMES
from fort_vsc_bridge.simulator import (
    CanSimulator as FortCanSimulator,
    HidSimulator as FortHidSimulator,
    Simulator as FortSimulator,
)
from rugged_teleop.canbuses import CanBusDevice, CHANNEL, INTERFACE
from rugged_teleop.command_line import number_within, Parser, standard_streams
from rugged_teleop.multicasts import GROUP, INPUT_PORT, LOOPBACK, MulticastDevice, PORT_OFFSET
from rugged_teleop.ports import DevicePort, HELP as PORT_HELP
from rugged_teleop.ptys import PtyDevice
from ssc_bridge.simulator import Settings as SscSettings, Simulator as SscSimulator
from vm110_bridge.simulator import Simulator as Vm110Simulator

_OWN_HELP = """\
show                            print what can be seen
help                            print this
quit                            end"""
_EXAMPLES = """\
examples:
  {prog} fort_vsc --port /tmp/fort_vsc
  {prog} vm110 --verbose
  {prog} akron --type 1042
  echo 'fault a overcurrent on' | {prog} esi_drive --port /tmp/esi_drive
"""
_STICKS = {'AXIS': AXIS_NAMES, 'BUTTON': BUTTON_NAMES}
_VERBOSE_PERIOD = 0.1
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# They change all the time: of no use where changes are printed.
_RESTLESS = {
    *('packets', 'sent', 'last_packet', 'host_heartbeats'),
    *('position_rad', 'current_a', 'lost_bytes', 'received', 'displays'),
    *('rotation_deg', 'elevation_deg', 'axes', 'sources', 'cleared'),
    *('inputs_us', 'outputs_us', 'serial_us'),
}


@dataclass(frozen=True)
class Simulated:
    """How a device is made from the options, what it obeys, and what its port is."""

    make: Callable[[argparse.Namespace], Any]
    help: str
    port: Literal['pty', 'multicast', 'can'] = 'pty'


DEVICES = {
    'fort_vsc': Simulated(lambda _: FortSimulator(), help_text(FortSimulator.commands, **_STICKS)),
    'fort_vsc_can': Simulated(
        lambda _: FortCanSimulator(), help_text(FortCanSimulator.commands, **_STICKS), 'can'
    ),
    'fort_vsc_hid': Simulated(
        lambda _: FortHidSimulator(), help_text(FortHidSimulator.commands, **_STICKS)
    ),
    'vm110': Simulated(
        lambda options: Vm110Simulator(options.bu_id, crc=options.crc),
        help_text(Vm110Simulator.commands),
        'multicast',
    ),
    'akron': Simulated(
        lambda options: AkronSimulator(
            options.type,
            pin=options.pin,
            address=options.address,
            feedback=not options.no_feedback,
        ),
        help_text(AkronSimulator.commands),
        'can',
    ),
    'akron_joystick': Simulated(
        lambda options: AkronJoystick(options.address, extended=options.extended),
        help_text(AkronJoystick.commands),
        'can',
    ),
    'esi_drive': Simulated(
        lambda options: EsiSimulator(
            axes=options.axes, compact=options.compact, status_rate=options.status_rate
        ),
        help_text(EsiSimulator.commands, FAULT=FAULTS),
    ),
    'ssc': Simulated(
        lambda options: SscSimulator(SscSettings(inputs=options.inputs)),
        help_text(SscSimulator.commands),
    ),
}


def parser(prog: str = 'simulate') -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    devices = result.add_subparsers(dest='device', required=True, metavar='DEVICE')
    for name, simulated in DEVICES.items():
        device = devices.add_parser(name, help=f'simulate one {name}')
        _PORT_OPTIONS[simulated.port](device)
        device.add_argument('--seed', type=int, help='makes drop and corrupt repeat themselves')
        device.add_argument('--verbose', action='store_true', help='print what changes')
    unit = devices.choices['vm110']
    unit.add_argument('--bu-id', type=_bu_id, default=7, help='of the base unit, 1 to 65535')
    unit.add_argument('--crc', choices=('mpeg2', 'iso_hdlc'), default='mpeg2')
    monitor = devices.choices['akron']
    monitor.add_argument('--type', type=int, default=1032, help='device type, 1032: a 6032')
    monitor.add_argument('--pin', type=_pin, default='', help='empty: one of that type')
    monitor.add_argument('--address', type=_address, default=0x80, help='first address, hex')
    monitor.add_argument('--no-feedback', action='store_true', help='has no position feedback')
    joystick = devices.choices['akron_joystick']
    joystick.add_argument('--address', type=_address, default=0x33, help='33 to 38, hex')
    joystick.add_argument('--extended', action='store_true', help='sends 64983 too')
    drive = devices.choices['esi_drive']
    drive.add_argument('--axes', type=int, choices=(1, 2), default=2)
    drive.add_argument('--compact', action='store_true', help='short packets, for 1 axis')
    drive.add_argument(
        '--status-rate', type=number_within(1.0, 1000.0), default=100.0, help='Hz, 1 to 1000'
    )
    controller = devices.choices['ssc']
    controller.add_argument('--inputs', type=int, choices=range(1, 17), default=8, help='1 to 16')
    return result


def _add_pty_options(device: argparse.ArgumentParser) -> None:
    device.add_argument(
        '--port', type=Path, required=True, help='this path becomes a link to the port'
    )


def _add_multicast_options(device: argparse.ArgumentParser) -> None:
    device.add_argument(
        '--port', type=_input_port, default=INPUT_PORT, help="UDP, the bridge's input_port"
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


def _plug_in(options: argparse.Namespace) -> DevicePort:
    """Make a device with its port. :raises OSError, ValueError: that cannot be."""
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
        device = _plug_in(options)
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


def _input_port(text: str) -> int:
    return _whole(text, 0xFFFF - PORT_OFFSET)


def _bu_id(text: str) -> int:
    return _whole(text, 0xFFFF)


def _pin(text: str) -> str:
    if not text or is_pin(text):
        return text
    raise argparse.ArgumentTypeError(f'{text} is no device PIN such as 1032AE100801035')


def _address(text: str) -> int:
    if re.fullmatch('[0-9A-Fa-f]{1,2}', text) and int(text, 16) <= 0xFD:
        return int(text, 16)
    raise argparse.ArgumentTypeError(f'{text} is not within 0 to FD hex')


def _whole(text: str, high: int) -> int:
    value = int(text) if text.isascii() and text.isdecimal() else 0
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
