# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which module may import which; CONTRIBUTING says what each is.

Every package but bridge_core and rugged_teleop counts as a bridge (so does safety_mux), so a new
one is covered without an edit here. A module that no rule names, such as
``safety_mux/inputs.py``, follows the strictest rule, that of ``session``.
"""

import ast
from collections.abc import Iterator
import importlib
from pathlib import Path
import re
import subprocess
import sys
import textwrap
from typing import Any

import pytest

from bridge_core.transports.started import environment
from stage.rig import NOT_INSTALLED, ROOT

NOT_A_BRIDGE = ('bridge_core', 'rugged_teleop')
STDLIB = frozenset(sys.stdlib_module_names)
# No clock, thread, socket, process or port below the node and the transports: time is an argument
# there. importlib would hide an import from this test.
IMPURE = frozenset(
    (
        *('time', 'sched', 'threading', '_thread', 'concurrent', 'asyncio', 'signal'),
        *('socket', 'socketserver', 'select', 'selectors', 'multiprocessing', 'subprocess'),
        *('fcntl', 'termios', 'tty', 'pty', 'importlib'),
    )
)
MESSAGES = re.compile(r'\w+_(msgs|srvs|interfaces)$')
CORE = (
    *('bridge_core.checksums', 'bridge_core.framing'),
    *('bridge_core.watchdog', 'bridge_core.j1939', 'bridge_core.numerals'),
)

# What a part of a bridge may import besides itself and the pure standard library.
LOGIC = (
    *('{bridge}.protocol', '{bridge}.parameters', 'OTHER'),
    *('bridge_core.framing', 'bridge_core.watchdog', 'bridge_core.session'),
    *('bridge_core.settings', 'bridge_core.parameters', 'bridge_core.j1939', 'bridge_core.gate'),
    *('bridge_core.proof', 'bridge_core.mux_words', 'bridge_core.actuator'),
    *('bridge_core.reasons', '{bridge}.reasons'),
)
BRIDGE = {
    '__init__': ('{bridge}.protocol', 'bridge_core'),
    # Frames of a protocol by a library for it.
    'modbus': ('{bridge}.protocol', 'bridge_core.framing', 'pymodbus'),
    # Ports that no other device has.
    'ports': (
        *('{bridge}.protocol', 'bridge_core.transports', 'bridge_core.clock'),
        *('bridge_core.waiting', 'gpiod', 'STDLIB'),
    ),
    'protocol': (
        *('bridge_core.framing', 'bridge_core.checksums', 'bridge_core.numerals'),
        *('bridge_core.packets', 'bridge_core.j1939', 'bridge_core.reasons'),
    ),
    'session': (*LOGIC, '{bridge}.modbus'),
    'arbiter': (*LOGIC, '{bridge}.explanation'),
    'mapping': LOGIC,
    'limits': LOGIC,
    # What the arbiter's state is in words.
    'explanation': (*LOGIC, '{bridge}.arbiter'),
    'report': (*LOGIC, 'bridge_core.report', '{bridge}.commissioned'),
    # What a report on disk says of the mux's parameters.
    'commissioned': (*LOGIC, 'bridge_core.fingerprint'),
    'convert': (
        *('{bridge}.protocol', 'OTHER'),
        *('bridge_core.convert', 'bridge_core.numerals', 'MESSAGES'),
    ),
    # The node's parameters, in a file of their own: below the node, too.
    'parameters': ('{bridge}.protocol', 'OTHER', 'bridge_core.parameters', 'bridge_core.share'),
    # What tools are told of the device: plain values, defaults, and where the rest is.
    'device': ('bridge_core.device', '{bridge}.parameters', '{bridge}.reasons'),
    'reasons': ('bridge_core.reasons',),
    'decoders': (
        *('{bridge}.protocol', '{bridge}.modbus'),
        *(f'bridge_core.{n}' for n in ('decoding', 'framing', 'j1939', 'packets')),
    ),
    # What the mux makes of its parameters.
    'configuration': ('{bridge}', 'bridge_core.parameters'),
    # From messages to the arbiter, for the node and for a replay.
    'intake': ('{bridge}', 'bridge_core.reasons'),
    'proofs': (
        '{bridge}',
        *(f'bridge_core.{n}' for n in ('parameters', 'proof', 'reasons', 'watchdog')),
    ),
    # What the mux's decisions become.
    'outputs': ('{bridge}.protocol', 'bridge_core.cdr', 'bridge_core.session', 'MESSAGES'),
    # What the mux's node is made of.
    'listening': ('{bridge}', 'bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    'services': ('{bridge}', 'bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    # What is there, by what devices say of themselves.
    'graph': (*LOGIC, 'bridge_core.device'),
    'model': (*LOGIC, '{bridge}.graph', 'rugged_teleop.reasons'),
    # What browsers are served by.
    'server': ('{bridge}', 'bridge_core.clock', 'aiohttp', 'STDLIB'),
    # What runs without the node, where there may be no ROS.
    'wire': (
        *('{bridge}.session', '{bridge}.protocol', '{bridge}.parameters', '{bridge}.ports'),
        *('bridge_core.transports', 'bridge_core.j1939', 'bridge_core.mux_words'),
    ),
    # Of the page alone: the installed devices.
    'node': (
        *('{bridge}', 'bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
        'rugged_teleop.devices',
    ),
    'simulator': ('{bridge}.protocol', 'bridge_core', 'pymodbus'),
    # A device's configuration and the dialogue with its menus: pure. Only the command has a port.
    'config': ('{bridge}.protocol', 'bridge_core.checksums'),
    'config.main': (
        *('{bridge}.protocol', 'bridge_core.clock', 'bridge_core.output'),
        *('bridge_core.transports', 'bridge_core.waiting', 'STDLIB'),
    ),
}
# A part of the common node.
NODE_PART = ('bridge_core', 'rclpy', 'MESSAGES', 'STDLIB')
# The same for bridge_core, which knows no device.
SHARED = {
    'reasons': (),
    'shared_reasons': ('bridge_core.reasons',),
    'device': ('bridge_core.reasons',),
    'session': ('bridge_core.framing', 'bridge_core.reasons', 'bridge_core.watchdog'),
    'gate': ('bridge_core.reasons', 'bridge_core.watchdog'),
    'proof': (),
    'proof_topics': NODE_PART,
    'mux_words': tuple(
        f'bridge_core.{name}' for name in ('proof', 'reasons', 'session', 'watchdog')
    ),
    'mux_topics': NODE_PART,
    'actuator': tuple(
        f'bridge_core.{name}' for name in ('framing', 'mux_words', 'reasons', 'session')
    ),
    'supervisor': ('bridge_core.session', 'bridge_core.transports.request'),
    'settings': ('bridge_core.parameters',),
    'simulation': ('bridge_core.numerals',),
    'decoding': ('bridge_core.framing', 'bridge_core.j1939'),
    'services': ('bridge_core.session', 'rclpy', 'threading'),
    'raw': ('bridge_core.clock', 'bridge_core.transports.tap', 'MESSAGES', 'STDLIB'),
    'report': ('bridge_core.framing', 'bridge_core.reasons', 'bridge_core.session'),
    'transports': (
        *(*CORE, 'bridge_core.session', 'bridge_core.report', 'bridge_core.realtime'),
        'bridge_core.reasons',
        *('bridge_core.supervisor', 'bridge_core.actuator'),
        *('bridge_core.clock', 'bridge_core.waiting', 'bridge_core.thread_name'),
        *('serial', 'can', 'STDLIB'),
    ),
    'thread_name': ('STDLIB',),
    'waiting': ('STDLIB',),
    'start_wire': ('bridge_core.descriptors', 'bridge_core.transports'),
    'cdr': ('rclpy', 'MESSAGES'),
    'clock': ('STDLIB',),
    'lane': (
        *('bridge_core.cdr', 'bridge_core.clock', 'bridge_core.rclpy_inner'),
        *('bridge_core.thread_name', 'rclpy', 'STDLIB'),
    ),
    'polled': ('bridge_core.rclpy_inner', 'rclpy'),
    'rclpy_inner': ('rclpy',),
    'realtime': ('STDLIB',),
    'convert': ('MESSAGES',),
    **dict.fromkeys(('bridge_diagnostics', 'input_guard', 'stop_topics'), NODE_PART),
    'diagnostics': ('bridge_core.reasons', 'bridge_core.report', 'MESSAGES'),
    'deferred': ('bridge_core.session',),
    'managed_node': ('bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    'node': ('bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    'remappings': ('bridge_core', 'rclpy', 'STDLIB'),
    'runner': ('bridge_core', 'rclpy', 'STDLIB'),
    'help': ('bridge_core', 'rclpy', 'STDLIB'),
    'output': ('STDLIB',),  # and the process that writes it
    'descriptors': ('STDLIB',),
    'refusals': ('STDLIB',),
    'drain': ('STDLIB',),
    'fingerprint': ('bridge_core.parameters', 'STDLIB'),  # for the version that is installed
    'parameter_files': ('bridge_core.parameters', 'yaml'),
}
# Simulators are for the command that shows them, the machine that is played, and for what
# is not installed.
SHOWS = 'rugged_teleop.simulate'
PLAYS = 'rugged_teleop.commission.simulated'
# What the demo may import beside itself, the standard library, rclpy and messages: the nodes that
# it shows run as a process.
DEMO = (
    *('{bridge}.protocol', '{bridge}.simulator', 'bridge_core', 'rugged_teleop'),
    *('stage', 'demo', 'rclpy', 'MESSAGES', 'STDLIB'),
)
# What stands on which floor: an arrow never points upwards, and nobody imports test.
BELOW = {'stage': ('stage',), 'assurance': ('stage', 'demo', 'assurance')}
# A package inside rugged_teleop that keeps the rules of a bridge.
PAGE = 'rugged_teleop.status_page'


def packages() -> list[str]:
    """Return the top-level packages of the project."""
    found = sorted(path.parent.name for path in ROOT.glob('*/__init__.py'))
    return [name for name in found if name not in NOT_INSTALLED]


def bridges() -> list[str]:
    return [name for name in packages() if name not in NOT_A_BRIDGE]


def modules() -> dict[str, Path]:
    """Return the file of each module by dotted name; a package is ``name.__init__``."""
    files = (path for name in (*packages(), 'demo') for path in (ROOT / name).rglob('*.py'))
    found = {'.'.join(path.relative_to(ROOT).with_suffix('').parts): path for path in files}
    return {name.replace(PAGE, 'status_page'): path for name, path in found.items()}


def imported(source: str, module: str) -> Iterator[str]:
    """Yield what a module imports, as dotted names that include the imported name."""
    package = module.split('.')[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.replace(PAGE, 'status_page') for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = package[: len(package) - node.level + 1] if node.level else []
            base = '.'.join([*up, *([node.module] if node.module else [])])
            base = base.replace(PAGE, 'status_page')
            yield from (f'{base}.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.Call) and _is_named(node.func, '__import__'):
            yield '__import__'


def _is_named(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def within(name: str, prefix: str) -> bool:
    return name == prefix or name.startswith(prefix + '.')


def part(module: str) -> str:
    """Return the part that a module belongs to: ``protocol`` for protocol/frames.py."""
    return module.split('.')[1]


def is_allowed(module: str, name: str) -> bool:
    """Return whether the table lets ``module`` import ``name``."""
    package = module.split('.')[0]
    if package == 'demo':
        return any(matches(entry, name.split('.')[0], name) for entry in DEMO)
    if name.split('.')[0] in NOT_INSTALLED:
        return False
    if package == 'rugged_teleop':
        shows = within(module, SHOWS) or module == PLAYS
        return shows or not (within(name, SHOWS) or is_part(name, 'simulator'))
    if within(name, f'{package}.config.main'):
        return False  # a command: nothing imports it
    if within(name, f'{package}.{part(module)}'):
        return True  # a part in several files
    if package not in NOT_A_BRIDGE and part(module) != 'node' and is_part(name, 'node'):
        return False
    if is_part(name, 'simulator'):
        return False
    table, otherwise = (SHARED, CORE) if package == 'bridge_core' else (BRIDGE, LOGIC)
    entries = table.get(module.partition('.')[2]) or table.get(part(module), otherwise)
    return is_pure(name) or any(matches(entry, package, name) for entry in entries)


def matches(entry: str, bridge: str, name: str) -> bool:
    """Return whether an entry of the table covers ``name``."""
    top = name.split('.')[0]
    if entry == 'STDLIB':
        return top in STDLIB
    if entry == 'MESSAGES':
        return MESSAGES.match(top) is not None
    if entry == 'OTHER':  # own files that the table does not name
        return top == bridge != name and part(name) not in BRIDGE
    return within(name, entry.format(bridge=bridge))


def is_pure(name: str) -> bool:
    return name.split('.')[0] in STDLIB - IMPURE or within(name, 'typing_extensions')


def is_part(name: str, which: str) -> bool:
    """Return whether ``name`` is, or is in, that part of a bridge."""
    path = name.split('.')
    return path[1:2] == [which] and path[0] not in (*NOT_A_BRIDGE, 'rclpy')


def violations(module: str, source: str) -> list[str]:
    return [name for name in imported(source, module) if not is_allowed(module, name)]


@pytest.mark.parametrize('module', sorted(modules()))
def test_module_imports_only_what_the_table_allows(module: str) -> None:
    source = modules()[module].read_text(encoding='utf-8')
    assert not violations(module, source), f'{module} may not import these'


@pytest.mark.parametrize('floor', BELOW)
def test_what_proves_stands_on_what_helps(floor: str) -> None:
    for path in (ROOT / floor).rglob('*.py'):
        module = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
        tops = {name.split('.')[0] for name in imported(path.read_text('utf-8'), module)}
        assert tops & {*NOT_INSTALLED} <= {*BELOW[floor]}, path


def test_every_bridge_is_checked() -> None:
    assert {'esi_drive_bridge', 'fort_vsc_bridge', 'safety_mux', 'vm110_bridge'} <= set(bridges())
    for bridge in bridges():
        assert f'{bridge}.node' in modules() or f'{bridge}.node.__init__' in modules()


# Of each rule, what it is to find.
FORBIDDEN = {
    'new_bridge.protocol': (
        *('import time', 'import bridge_core', 'from std_msgs.msg import Bool'),
        *('from bridge_core.watchdog import Watchdog', 'from new_bridge.session import Session'),
    ),
    'new_bridge.protocol.frames': ('from .. import session',),
    'new_bridge.session': (
        *('import threading', 'def late():\n    import socket', 'import rclpy', 'import serial'),
        *("__import__('time')", 'import importlib', 'from new_bridge.simulator import Device'),
        'from new_bridge.wire import BRIDGE',
    ),
    'new_bridge.split_off': ('from new_bridge.node import NewBridge',),
    'new_bridge.wire': ('from new_bridge.convert import joy', 'import rclpy'),
    'new_bridge.node': (
        *('from new_bridge import simulator', 'from fort_vsc_bridge.protocol import Mode'),
        *('import serial', 'from rugged_teleop import stack', 'from demo import stage'),
    ),
    'new_bridge.simulator': ('from other_bridge.simulator import Device', 'import stage.rig'),
    'new_bridge.config.menus': ('from new_bridge.config.main import main',),
    'bridge_core.transports.link': ('from new_bridge.session import Session', 'import rclpy'),
    'bridge_core.watchdog': ('import time',),
    'bridge_core.node': ('from fort_vsc_bridge.session import Session',),
    'rugged_teleop.stack': (
        *('from new_bridge import simulator', 'from demo.stage import DemoStage'),
    ),
    'demo.stage': ('from new_bridge.node import NewBridge',),
}


@pytest.mark.parametrize('module', FORBIDDEN)
def test_forbidden_import_is_found(module: str) -> None:
    for source in FORBIDDEN[module]:
        assert violations(module, source), source


def printed(program: str, *options: str, **environment: str) -> str:
    """Return what a program prints in a Python of its own."""
    command = [sys.executable, *options, '-c', textwrap.dedent(program)]
    given: dict[str, Any] = {'env': environment} if environment else {}
    return str(subprocess.run(command, capture_output=True, text=True, check=True, **given).stdout)


@pytest.mark.parametrize('bridge', ['esi_drive_bridge', 'ssc_bridge', 'akron_can_bridge'])
def test_process_of_an_actuators_wire_loads_nothing_of_ros(bridge: str) -> None:
    """Whatever imports what: here is all that is loaded in the end."""
    module = f'{bridge}.wire'
    importlib.import_module(module)  # as in the node
    program = f"""
        import importlib
        import sys
        import bridge_core.start_wire
        import bridge_core.transports.wire_process
        import {module}
        for late in {module}.BRIDGE.loads:
            importlib.import_module(late)
        print(*sys.modules)
    """
    loaded = printed(program, '-S', **environment(module)).split()
    assert module in loaded
    tops = {name.split('.')[0] for name in loaded}
    assert not [top for top in tops if top.startswith(('rcl', 'rosidl')) or MESSAGES.match(top)]


@pytest.mark.parametrize(
    ('bridge', 'values'),
    [
        ('esi_drive_bridge', {'port': '/dev/none', 'baud': 115200}),
        ('ssc_bridge', {'port': '/dev/none', 'baud': 9600}),
        ('akron_can_bridge', {'interface': 'socketcan', 'channel': 'none'}),
        ('akron_can_bridge', {'interface': 'udp_multicast', 'channel': '239.0.0.1'}),
    ],
)
def test_wire_that_takes_over_has_loaded_all_it_needs(bridge: str, values: dict[str, Any]) -> None:
    """It says that it is ready once; a wire that loads more then is silent for as long."""
    program = f"""
        import importlib
        import sys
        import bridge_core.transports.wire_process
        bridge = importlib.import_module('{bridge}.wire').BRIDGE
        for late in bridge.loads:
            importlib.import_module(late)
        before = set(sys.modules)
        bridge.make_transport({dict(values, bitrate=0)})
        print(*set(sys.modules) - before)
    """
    assert printed(program).split() == []


def test_wire_on_an_interface_of_the_kernel_does_without_python_can() -> None:
    program = """
        import sys
        from akron_can_bridge.wire import BRIDGE
        from bridge_core.transports import TransportError
        given = {'interface': 'socketcan', 'channel': 'none', 'bitrate': 0}
        port = BRIDGE.make_transport(given)
        try:
            port.open()
        except TransportError:
            print('can' in sys.modules)
    """
    assert printed(program) == 'False\n'
