"""
Who may import whom: the table of the house, enforced.

A room is any package beside bridge_core and rugged_teleop, so a new one is covered with no edit.
A module that the table does not name (``safety_mux/inputs.py``) is split off the logic below the
node, and follows the strictest rule, that of ``session``.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
import re
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
NOT_A_ROOM = ('bridge_core', 'rugged_teleop')
STDLIB = frozenset(sys.stdlib_module_names)
# Neither clock, thread, socket, process nor port below the node and the transports: time is an
# argument there. importlib would hide an import from this test.
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
    *('bridge_core.watchdog', 'bridge_core.j1939'),
)

# What a part of a room may import beside itself and the pure standard library.
LOGIC = (
    *('{room}.protocol', '{room}.parameters', 'SPLIT OFF'),
    *('bridge_core.framing', 'bridge_core.watchdog', 'bridge_core.session'),
    *('bridge_core.settings', 'bridge_core.parameters', 'bridge_core.j1939'),
)
ROOM = {
    '__init__': ('{room}.protocol',),
    'protocol': ('bridge_core.framing', 'bridge_core.checksums', 'bridge_core.j1939'),
    'session': LOGIC,
    'arbiter': LOGIC,
    'mapping': LOGIC,
    'limits': LOGIC,
    'convert': ('{room}.protocol', 'SPLIT OFF', 'bridge_core.convert', 'MESSAGES'),
    # The node's parameters, where they have a file of their own: below the node all the same.
    'parameters': ('{room}.protocol', 'SPLIT OFF', 'bridge_core.parameters'),
    'node': ('{room}', 'bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    'simulator': ('{room}.protocol', 'bridge_core'),
    # What a device keeps, and the dialogue with its menus: pure. Only the command has a port.
    'config': ('{room}.protocol', 'bridge_core.checksums'),
    'config.main': ('{room}.protocol', 'bridge_core.transports', 'STDLIB'),
}
# The same for bridge_core, which knows no device.
SHARED = {
    'session': ('bridge_core.framing', 'bridge_core.watchdog'),
    'settings': ('bridge_core.parameters',),
    'services': ('bridge_core.session', 'rclpy'),
    'transports': (*CORE, 'bridge_core.session', 'serial', 'can', 'STDLIB'),
    'outbox': ('STDLIB',),  # a thread, beside the link's
    'convert': ('MESSAGES',),
    'diagnostics': ('bridge_core.session', 'MESSAGES'),
    'node': ('bridge_core', 'rclpy', 'MESSAGES', 'STDLIB'),
    'runner': ('bridge_core', 'rclpy', 'STDLIB'),
    'help': ('bridge_core', 'rclpy', 'STDLIB'),
    'output': ('STDLIB',),  # and the process that writes it
    'drain': ('STDLIB',),
    'parameter_files': ('bridge_core.parameters', 'yaml'),
}
# Simulators and what shows them are for the commands that show them, and for nobody else.
SHOWS = ('rugged_teleop.simulate', 'rugged_teleop.demo')


def packages() -> list[str]:
    """Return the top-level packages of the project."""
    found = sorted(path.parent.name for path in ROOT.glob('*/__init__.py'))
    return [name for name in found if name not in ('test', 'benchmarks')]


def rooms() -> list[str]:
    return [name for name in packages() if name not in NOT_A_ROOM]


def modules() -> dict[str, Path]:
    """Return every module's dotted name with its file; a package goes by ``name.__init__``."""
    files = (path for package in packages() for path in (ROOT / package).rglob('*.py'))
    return {'.'.join(path.relative_to(ROOT).with_suffix('').parts): path for path in files}


def imported(source: str, module: str) -> Iterator[str]:
    """Yield what a module imports, as dotted names down to the imported thing."""
    package = module.split('.')[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = package[: len(package) - node.level + 1] if node.level else []
            base = '.'.join([*up, *([node.module] if node.module else [])])
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
    """Tell whether the table lets ``module`` import ``name``."""
    package = module.split('.')[0]
    if package == 'rugged_teleop':
        return module.startswith(SHOWS) or not (is_show(name) or is_part(name, 'simulator'))
    if within(name, f'{package}.config.main'):
        return False  # a command, at the top
    if within(name, f'{package}.{part(module)}'):
        return True  # a part in several files
    if package not in NOT_A_ROOM and part(module) != 'node' and is_part(name, 'node'):
        return False
    if is_part(name, 'simulator'):
        return False
    table, otherwise = (SHARED, CORE) if package == 'bridge_core' else (ROOM, LOGIC)
    entries = table.get(module.partition('.')[2]) or table.get(part(module), otherwise)
    return is_pure(name) or any(matches(entry, package, name) for entry in entries)


def matches(entry: str, room: str, name: str) -> bool:
    """Tell whether an entry of the table covers ``name``."""
    top = name.split('.')[0]
    if entry == 'STDLIB':
        return top in STDLIB
    if entry == 'MESSAGES':
        return MESSAGES.match(top) is not None
    if entry == 'SPLIT OFF':  # own files that the table does not name
        return top == room != name and part(name) not in ROOM
    return within(name, entry.format(room=room))


def is_pure(name: str) -> bool:
    return name.split('.')[0] in STDLIB - IMPURE


def is_show(name: str) -> bool:
    return name.startswith(SHOWS)


def is_part(name: str, which: str) -> bool:
    """Tell whether ``name`` is, or is in, that part of a room."""
    path = name.split('.')
    return path[1:2] == [which] and path[0] not in (*NOT_A_ROOM, 'rclpy')


def violations(module: str, source: str) -> list[str]:
    return [name for name in imported(source, module) if not is_allowed(module, name)]


@pytest.mark.parametrize('module', sorted(modules()))
def test_module_imports_only_what_the_table_allows(module: str) -> None:
    source = modules()[module].read_text(encoding='utf-8')
    assert not violations(module, source), f'{module} may not import these'


def test_every_room_is_walked() -> None:
    assert {'esi_drive_bridge', 'fort_vsc_bridge', 'safety_mux', 'vm110_bridge'} <= set(rooms())
    for room in rooms():
        assert f'{room}.node' in modules() or f'{room}.node.__init__' in modules()


@pytest.mark.parametrize(
    ('module', 'source'),
    [
        ('new_bridge.protocol', 'import time'),
        ('new_bridge.protocol', 'from bridge_core.watchdog import Watchdog'),
        ('new_bridge.protocol', 'from bridge_core import node'),
        ('new_bridge.protocol', 'import bridge_core'),
        ('new_bridge.protocol', 'from new_bridge.session import Session'),
        ('new_bridge.protocol', 'from std_msgs.msg import Bool'),
        ('new_bridge.protocol.frames', 'from new_bridge import convert'),
        ('new_bridge.protocol.frames', 'from .. import session'),
        ('new_bridge.session', 'import threading'),
        ('new_bridge.session', 'from time import monotonic'),
        ('new_bridge.session', 'def late():\n    import socket'),
        ('new_bridge.session', 'import select as choose'),
        ('new_bridge.session', 'import serial'),
        ('new_bridge.session', 'import can'),
        ('new_bridge.session', 'import rclpy'),
        ('new_bridge.session', 'import importlib'),
        ('new_bridge.session', 'import new_bridge'),
        ('new_bridge.session', "__import__('time')"),
        ('new_bridge.session', 'from bridge_core.framing import Counters'),
        ('new_bridge.session', 'from new_bridge.convert import joy'),
        ('new_bridge.session', 'from new_bridge.simulator import Device'),
        ('new_bridge.session.queue', 'import asyncio'),
        ('new_bridge.arbiter', 'from new_bridge import limits'),
        ('new_bridge.arbiter', 'from .limits import Limiter'),
        ('new_bridge.mapping', 'from sensor_msgs.msg import Joy'),
        ('new_bridge.split_off', 'import time'),
        ('new_bridge.split_off', 'from new_bridge.node import NewBridge'),
        ('new_bridge.convert', 'import rclpy'),
        ('new_bridge.convert', 'from new_bridge.session import Event'),
        ('new_bridge.convert', 'import time'),
        ('new_bridge.parameters', 'from new_bridge.node import NewBridge'),
        ('new_bridge.parameters', 'from bridge_core.node import BRIDGE_PARAMETERS'),
        ('new_bridge.node', 'from new_bridge.simulator import Device'),
        ('new_bridge.node', 'from new_bridge import simulator'),
        ('new_bridge.node', 'from fort_vsc_bridge.protocol import Mode'),
        ('new_bridge.node', 'import serial'),
        ('new_bridge.node', 'from rugged_teleop import stack'),
        ('new_bridge.simulator', 'from new_bridge.session import Session'),
        ('new_bridge.simulator', 'import time'),
        ('new_bridge.simulator', 'from other_bridge.simulator import Device'),
        ('new_bridge.config.menus', 'import time'),
        ('new_bridge.config.menus', 'from bridge_core.transports.serial import SerialTransport'),
        ('new_bridge.config.menus', 'from new_bridge.config.main import main'),
        ('new_bridge.config.image', 'import serial'),
        ('new_bridge.config.main', 'import rclpy'),
        ('new_bridge.config.main', 'from new_bridge.simulator import Device'),
        ('new_bridge.simulator', 'from new_bridge.config.image import Image'),
        ('new_bridge.__init__', 'from new_bridge.node import NewBridge'),
        ('bridge_core.transports.serial', 'import rclpy'),
        ('bridge_core.transports.serial', 'from bridge_core.node import BridgeNode'),
        ('bridge_core.transports.link', 'from new_bridge.session import Session'),
        ('bridge_core.framing', 'from bridge_core.transports import Transport'),
        ('bridge_core.watchdog', 'import time'),
        ('bridge_core.diagnostics', 'import rclpy'),
        ('bridge_core.node', 'from fort_vsc_bridge.session import Session'),
        ('rugged_teleop.stack', 'from new_bridge.simulator import Device'),
        ('rugged_teleop.stack', 'from new_bridge import simulator'),
        ('rugged_teleop.stack', 'from rugged_teleop.demo import main'),
        ('rugged_teleop.stack', 'from rugged_teleop import simulate'),
    ],
)
def test_forbidden_import_is_found(module: str, source: str) -> None:
    assert violations(module, source)


@pytest.mark.parametrize(
    ('module', 'source'),
    [
        ('new_bridge.protocol', 'import struct\nfrom bridge_core.framing import FrameError'),
        ('new_bridge.protocol.frames', 'from .values import Axis'),
        ('new_bridge.session', 'from bridge_core.watchdog import Watchdog\nimport math'),
        ('new_bridge.session', 'from new_bridge import protocol'),
        ('new_bridge.session', 'from .protocol import Status'),
        ('new_bridge.arbiter', 'from new_bridge.inputs import Input'),
        ('new_bridge.convert', 'from sensor_msgs.msg import Joy'),
        ('new_bridge.parameters', 'from bridge_core.parameters import Parameter'),
        ('new_bridge.node', 'import rclpy\nimport time\nfrom new_bridge import session'),
        ('new_bridge.simulator', 'from bridge_core.framing import StreamParser'),
        ('new_bridge.config.menus', 'from new_bridge.config.image import Image'),
        ('new_bridge.config.main', 'import time\nfrom bridge_core.transports import Transport'),
        ('bridge_core.transports.can', 'import can\nimport select'),
        ('rugged_teleop.stack', 'from new_bridge.node import NewBridge'),
        ('rugged_teleop.demo', 'from new_bridge.simulator import Device'),
        ('rugged_teleop.demo_view', 'from rugged_teleop.simulate import Bench'),
    ],
)
def test_allowed_import_passes(module: str, source: str) -> None:
    assert not violations(module, source)
