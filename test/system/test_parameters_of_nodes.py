# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every bad parameter of each node: exit status 2, one line that names it, no port opened.

Most run in this process through the function that the executables call; a few as processes.
"""

from collections.abc import Callable, Iterator, Sequence
import gc
from importlib.util import find_spec
from itertools import cycle
import math
import os
from pathlib import Path
import re
import signal
import threading
import time
from typing import Any, Protocol

import can
import pytest
import yaml

from akron_can_bridge.node import AkronCanBridge
from bridge_core.parameters import Parameter, ParameterError, resolve
from bridge_core.runner import run
from esi_drive_bridge.node import EsiDriveBridge
from fort_vsc_bridge.node import FortVscBridge
from io_bridge.node import IoBridge
from rugged_teleop.multicasts import LOOPBACK
from rugged_teleop.status_page.node import StatusPage
from safety_mux.node import SafetyMux
from safety_mux.parameters import parameter_table
from ssc_bridge.node import SscBridge
from stage.multicast_rig import free_port
from stage.rig import as_yaml, ROOT, TIMEOUT_FACTOR, wait_for
from stage.spine import UntouchedPort
from vm110_bridge.node import Vm110Bridge


class Untouched(Protocol):
    """A port that disturbs nobody and knows whether it was ever opened."""

    values: dict[str, Any]  # the parameters that lead a node there

    @property
    def was_opened(self) -> bool: ...

    def close(self) -> None: ...


class UntouchedSerial(UntouchedPort):
    """A pseudo-terminal."""

    def __init__(self) -> None:
        super().__init__()
        self.values = {'port': self.path}


class UntouchedGroup:
    """
    A multicast group at a port that no socket binds to, of this process or another one.

    :param values: the parameters that lead there, by the port.
    """

    def __init__(self, values: Callable[[int], dict[str, Any]]) -> None:
        port = free_port()
        self.values = values(port)
        self.was_opened = False
        self._closed = threading.Event()
        threading.Thread(target=self._watch, args=(f':{port:04X} ',), daemon=True).start()

    def _watch(self, address: str) -> None:
        before = False  # who looks for a free port binds to it for an instant, too
        while not self._closed.wait(0.01):
            bound = address in Path('/proc/net/udp').read_text()
            self.was_opened |= bound and before
            before = bound

    def close(self) -> None:
        """End the watch."""
        self._closed.set()


def untouched_network() -> Untouched:
    return UntouchedGroup(lambda port: {'interface_address': LOOPBACK, 'input_port': port})


class UntouchedBus:
    """A CAN bus, a multicast group of python-can, on which whoever joins it says something."""

    def __init__(self) -> None:
        group, port = '239.74.163.2', free_port()
        self.values = {'interface': 'udp_multicast', 'channel': f'{group}:{port}'}
        self._bus = can.Bus(group, 'udp_multicast', port=port)

    @property
    def was_opened(self) -> bool:
        return self._bus.recv(0.0) is not None

    def close(self) -> None:
        self._bus.shutdown()


class NoPort:
    """Of a node without a device."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self.was_opened = False

    def close(self) -> None:
        """There is nothing."""


# Each node with a transport that opens nothing. Another node is a line here.
NODES: dict[str, tuple[Any, Callable[[], Untouched]]] = {
    'fort': (FortVscBridge, UntouchedSerial),
    'vm110': (Vm110Bridge, untouched_network),
    'akron': (AkronCanBridge, UntouchedBus),
    'ssc': (SscBridge, UntouchedSerial),
    'esi': (EsiDriveBridge, UntouchedSerial),
    **({'io': (IoBridge, UntouchedSerial)} if find_spec('pymodbus') else {}),
    'mux': (SafetyMux, NoPort),
    'page': (StatusPage, NoPort),
}
PARAMETERS: dict[str, dict[str, Parameter]] = {
    name: {parameter.name: parameter for parameter in node.PARAMETERS}
    for name, (node, _) in NODES.items()
}
PARAMETERS['mux'] |= {parameter.name: parameter for parameter in parameter_table({})}
ALL = [(node, name) for node, table in PARAMETERS.items() for name in table]
Ports = dict[str, Untouched]


def kind_of(parameter: Parameter) -> tuple[type, type]:
    default = parameter.default
    return type(default), type((default or [''])[0]) if isinstance(default, list) else type(
        default
    )


FIRST_OF_KIND = {
    node: {kind_of(each): name for name, each in reversed(table.items())}.values()
    for node, table in PARAMETERS.items()
}


@pytest.fixture(scope='module')
def ports() -> Iterator[Ports]:
    result = {name: untouched() for name, (_, untouched) in NODES.items()}
    yield result
    for port in result.values():
        port.close()


def started(node: str, arguments: Sequence[str], port: Untouched | None = None) -> int:
    """
    Run a node in this process; one that takes what it was given is ended after a while.

    :param port: it is ended as soon as it has opened this.
    """
    over = threading.Event()

    def rescue() -> None:
        end = time.monotonic() + 10.0 * TIMEOUT_FACTOR
        while not over.wait(0.02):
            if time.monotonic() > end or (port is not None and port.was_opened):
                os.kill(os.getpid(), signal.SIGTERM)
                return

    thread = threading.Thread(target=rescue)
    thread.start()
    try:
        return run([NODES[node][0]], ['node', '--ros-args', *arguments])
    finally:
        over.set()
        thread.join()


def overrides(values: dict[str, Any], port: Untouched) -> list[str]:
    given = {**port.values, **values}
    return [word for name, value in given.items() for word in ('-p', f'{name}:={as_yaml(value)}')]


def refusal(node: str, values: dict[str, Any], ports: Ports, capfd: Any, *more: str) -> str:
    """Show that the node refuses the values, and more arguments, as it should; return its line."""
    capfd.readouterr()
    port = ports[node]
    status = started(node, [*overrides(values, port), *more])
    error = capfd.readouterr().err
    assert status == 2, f'{values}: {error}'
    lines = error.splitlines()
    assert len(lines) == 1, f'{values}: {error}'
    assert not port.was_opened, f'{values}: opened its port'
    return str(lines[0])


def bad_values(parameter: Parameter) -> Iterator[Any]:
    """Give one value for each way to be wrong: type, range, not a number, no choice."""
    many = isinstance(parameter.default, list)
    kind = type((parameter.default or [''])[0] if many else parameter.default)
    yield from ([each] if many else each for each in _bad_items(parameter, kind))
    if not many:
        good = parameter.default
        yield [good, good]


def _bad_items(parameter: Parameter, kind: type[Any]) -> Iterator[Any]:
    wrong_types: dict[type[Any], tuple[Any, ...]] = {
        bool: (1, 'yes please', 0.5),
        int: (1.5, True, 'seven', math.nan),
        float: ('fast', True, math.nan, math.inf, -math.inf),
        str: (5, 2.5, True),
    }
    yield from wrong_types[kind]
    step = 1 if kind is int else 1e-3
    if parameter.minimum is not None:
        yield kind(parameter.minimum - step)
    if parameter.above is not None:
        yield kind(parameter.above)
        yield kind(parameter.above - step)
    if parameter.maximum is not None:
        yield kind(parameter.maximum + max(step, abs(parameter.maximum) * 1e-6))
    if parameter.choices:
        yield 'nonsense'
        if '' not in parameter.choices:  # what a list that is empty has to hold for ROS
            yield ''


@pytest.mark.parametrize(('node', 'name'), ALL, ids=[f'{node}-{name}' for node, name in ALL])
def test_bad_value_of_each_parameter_is_one_line_and_status_2(
    node: str, name: str, ports: Ports, capfd: Any
) -> None:
    """A start tries one value of the first parameter of each kind."""
    parameter = PARAMETERS[node][name]
    is_first = name in FIRST_OF_KIND[node]
    for number, value in enumerate(bad_values(parameter)):
        if is_first and number == 0:
            line = refusal(node, {name: value}, ports, capfd)
        else:
            with pytest.raises(ParameterError) as caught:
                resolve([parameter], {name: value})
            line = str(caught.value)
        assert f'parameter {name} = ' in line, f'{value}: {line}'
        assert f'allowed is {parameter.allowed}' in line, f'{value}: {line}'


@pytest.mark.parametrize(
    ('node', 'wrong', 'right'),
    [
        ('fort', 'prot', 'port'),
        ('fort', 'device.auto_of_enable', 'device.auto_off_enable'),
        ('vm110', 'inputport', 'input_port'),
        ('akron', 'chanel', 'channel'),
        ('ssc', 'prot', 'port'),
        ('esi', 'comand_rate', 'command_rate'),
        ('mux', 'rates', 'rate'),
        ('mux', 'estop.frot.topic', 'estop.fort.topic'),
        ('mux', 'operator.fort.topc', 'operator.fort.topic'),
        ('mux', 'joint.left.maximum', 'joint.left.max'),
    ],
)
def test_name_that_nobody_knows_is_refused_with_the_nearest(
    node: str, wrong: str, right: str, ports: Ports, capfd: Any
) -> None:
    line = refusal(node, {wrong: 'x'}, ports, capfd)
    assert f'parameter {wrong}: there is no such parameter; did you mean {right}?' in line


CONTRADICTIONS = yaml.safe_load((ROOT / 'test/system/contradictions.yaml').read_text('utf-8'))
CASES = [(node, what) for node in NODES for what in CONTRADICTIONS.get(node, ())]


@pytest.mark.parametrize(('node', 'what'), CASES)
def test_contradiction_is_one_line_and_status_2(
    node: str, what: str, ports: Ports, capfd: Any
) -> None:
    values, words = CONTRADICTIONS[node][what]
    line = refusal(node, values, ports, capfd)
    assert line.startswith('rugged_teleop: ')
    assert re.search(words, line), line


TOPICS = [name for name, each in PARAMETERS['mux'].items() if name.endswith('topic')]
FORBIDDEN = ('two words', 'a//b', '1st', 'ends/', '~x', 'a' * 247)


@pytest.mark.parametrize(('name', 'topic'), [*zip(TOPICS, cycle(FORBIDDEN), strict=False)])
def test_topic_name_that_ros_forbids_is_one_line_and_status_2(
    name: str, topic: str, ports: Ports, capfd: Any
) -> None:
    assert name in refusal('mux', {name: topic}, ports, capfd)


@pytest.mark.parametrize('alias', ['/site/fort_vsc_bridge/estop', 'drive_stop', '/estop'])
def test_one_topic_under_two_names_is_one_line_and_status_2(
    alias: str, ports: Ports, capfd: Any
) -> None:
    remapped = ('-r', 'drive_stop:=fort_vsc_bridge/estop', '-r', '/estop:=fort_vsc_bridge/estop')
    more = ('-r', '__ns:=/site', *remapped)
    line = refusal('mux', {'estop.drive.topic': alias}, ports, capfd, *more)
    assert 'is also that of estop' in line


@pytest.mark.parametrize('name', ['main gate', 'gr\u00fcn', 'g' * 230])
def test_source_name_that_cannot_be_a_topic_is_one_line_and_status_2(
    name: str, tmp_path: Path, capfd: Any
) -> None:
    file = tmp_path / 'mux.yaml'
    file.write_text(
        f'safety_mux:\n  ros__parameters:\n    estop_sources: ["{name}"]\n'
        f'    estop: {{"{name}": {{topic: gate/estop}}}}\n'
    )
    capfd.readouterr()
    assert started('mux', ['--params-file', str(file)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert name in line


# As processes.


@pytest.mark.parametrize('node', [node for node in NODES if node not in ('mux', 'page')])
def test_good_parameters_open_the_port(node: str) -> None:
    """So that a port which stays closed tells something."""
    port = NODES[node][1]()
    try:
        assert started(node, overrides({}, port), port) == 0
        assert port.was_opened
    finally:
        port.close()


def test_good_value_at_each_end_of_a_range_is_taken() -> None:
    """Of lists the least goes first and the greatest last: some have to rise."""
    for table in PARAMETERS.values():
        for parameter in table.values():
            ends = [end for end in (parameter.minimum, parameter.maximum) if end is not None]
            for place, end in zip((0, -1), ends, strict=False):
                value: Any = parameter.default
                if isinstance(value, list):
                    value = list(value)
                    value[place] = type(value[0])(end)
                else:
                    value = type(value)(end)
                assert parameter.validate(value) == value, parameter.name


def test_refused_start_gives_back_every_descriptor_and_signal(ports: Ports, capfd: Any) -> None:
    """Refused 500 times over, a start that kept a pipe came past 1,024 descriptors, and hung."""

    def kept() -> list[int]:
        return [len(os.listdir(f'/proc/self/{what}')) for what in ('fd', 'task')]

    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    refusal('esi', {'command_rate': -1.0}, ports, capfd)
    before = kept()
    gc.disable()  # a start leaves it to nobody when the middleware ends
    try:
        for _ in range(10):
            refusal('esi', {'command_rate': -1.0}, ports, capfd)
        # Threads that have ended are gone a moment later; a leak would stay.
        wait_for(
            lambda: all(now <= was for now, was in zip(kept(), before, strict=True)),
            5.0,
            lambda: f'descriptors and threads as before: {before}, now {kept()}',
        )
    finally:
        gc.enable()
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == handlers
