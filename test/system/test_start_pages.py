# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A stranger's walk through each start page, command by command, with a simulated device."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import importlib
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.qos import QoSProfile

from akron_can_bridge.simulator import Simulator as Monitor
from esi_drive_bridge.simulator import Simulator as Drive
from fort_vsc_bridge.simulator import Simulator as Vsc
from io_bridge.simulator import Simulator as Box
from rugged_teleop.canbuses import CanBusDevice, INTERFACE
from rugged_teleop.doctor import main as doctor
from rugged_teleop.multicasts import LOOPBACK, MulticastDevice
from rugged_teleop.ptys import PtyDevice
from ssc_bridge.simulator import Simulator as Ssc
from stage.can_rig import free_channel
from stage.multicast_rig import free_port
from stage.rig import NodeProcess, Observer, ROOT, wait_for
from stage.run_delay import RunDelay, WIRE_HELD_UP
from test.repository.docs_rig import blocks, Command, commands, text_of
from vm110_bridge.simulator import Simulator as BaseUnit

DEVICES = ('fort_vsc', 'vm110', 'akron', 'ssc', 'esi_drive', 'io')
ELSEWHERE = {
    'sudo': 'changes this computer',
    'pip install': 'the same',
    'ros2 run rugged_teleop simulate': 'test_simulate.py does, and the device here is the same',
    'ros2 run rugged_teleop bench --joint left --speed': 'test_bench.py runs it',
}


class Walk:
    """Somebody who types what a page says, on a computer with another device than the page's."""

    def __init__(
        self, folder: Path, observer: Observer, name: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self._observer, self._folder, self._capsys = observer, folder, capsys
        self._diagnostics = observer.record(DiagnosticArray, '/diagnostics', keep=1)
        self._exits = contextlib.ExitStack()
        self._nodes: list[int] = []
        self.instead: dict[str, str] = {}
        getattr(self, f'_plug_in_{name}')()
        self.did: list[str] = []

    def _plug_in_fort_vsc(self) -> None:
        port = self._pty(Vsc(), '/dev/fort_vsc')
        assert '`mode operational`' in text_of('docs/start/fort_vsc.md')
        port.apply('mode operational')

    def _plug_in_ssc(self) -> None:
        self._pty(Ssc(), '/dev/ttyUSB0')

    def _plug_in_io(self) -> None:
        self._pty(Box(), '/dev/ttyUSB0')

    def _plug_in_esi_drive(self) -> None:
        self._pty(Drive(), '/dev/ttyUSB0')

    def _pty(self, device: Any, path: str) -> PtyDevice:
        self.instead[path] = str(self._folder / 'port')
        return self._exits.enter_context(PtyDevice(device, self._folder / 'port'))

    def _plug_in_vm110(self) -> None:
        port = free_port()
        self._exits.enter_context(MulticastDevice(BaseUnit(7), port))
        self.instead['192.168.1.10'] = f'{LOOPBACK}\n    input_port: {port}'

    def _plug_in_akron(self) -> None:
        self.monitor = self._exits.enter_context(CanBusDevice(Monitor(), free_channel()))
        self.instead |= {'socketcan': INTERFACE, 'can0': self.monitor.channel}

    def close(self) -> None:
        self._exits.close()

    def do(self, block: str) -> None:
        """Type a block, or write it into my.yaml."""
        for page, here in self.instead.items():
            block = block.replace(page, here)
        block = block.replace('my.yaml', str(self._folder / 'my.yaml'))
        if block.startswith('/**'):
            (self._folder / 'my.yaml').write_text(block)
            return
        for command in commands(block):
            self._type(command)

    def _type(self, command: Command) -> None:
        words = command.words
        if any(command.text.startswith(each) for each in ELSEWHERE):
            return
        self.did.append(' '.join(words[: 3 + (words[1] == 'run')]))
        if words[0] == 'ls':
            assert Path(words[-1]).exists()
        elif words[2:4] == ['rugged_teleop', 'doctor']:
            self._doctor(words[4:], command.comment)
        elif words[2:4] == ['rugged_teleop', 'bench']:
            self._bench(words[3:], command.comment)
        elif words[:3] == ['ros2', 'run', 'rugged_teleop']:
            node = NodeProcess(f'{words[3]}.node', arguments=words[5:], patient=True)
            self._nodes.append(self._exits.enter_context(node).process.pid)
        else:
            assert words[:3] == ['ros2', 'topic', 'echo'], command
            self._echo(words[-1], command.comment)

    def _bench(self, arguments: list[str], expected: str) -> None:
        """Run it, anew only where the machine held up the node or its wire: that is a stop."""
        tool = [sys.executable, '-m', 'stage.patience', 'rugged_teleop', *arguments]
        tool += ['--seconds', '0.5']
        while True:
            delay = RunDelay(self._nodes)
            done = subprocess.run(tool, cwd=ROOT, text=True, capture_output=True, check=False)
            if expected in done.stdout:
                if '--stick' not in arguments or self.monitor.describe()['rotation_deg']:
                    return
            else:
                assert 'demands a stop' in done.stderr, (done.stdout, done.stderr)
            assert delay.exceeds(WIRE_HELD_UP), done.stderr

    def _doctor(self, arguments: list[str], expected: str) -> None:
        """
        Run it until it says so, and that nothing is to be done.

        Who was held up has heard the device in part.
        """
        said = ''

        def says() -> bool:
            nonlocal said
            with pytest.raises(SystemExit) as caught:
                doctor.main([*arguments, '--seconds', '0.6'])
            said = self._capsys.readouterr().out
            return expected in said and not caught.value.code

        wait_for(says, 30.0, lambda: f'{expected} in {said}')

    def _echo(self, topic: str, expected: str) -> None:
        node = self._observer.node
        publishers = self._observer.wait_for(
            lambda: node.get_publishers_info_by_topic(topic), 20.0, f'a publisher of {topic}'
        )
        package, _, name = publishers[0].topic_type.split('/')
        kind = getattr(importlib.import_module(f'{package}.msg'), name)
        offered = publishers[0].qos_profile
        qos = QoSProfile(depth=10, reliability=offered.reliability, durability=offered.durability)
        record = self._observer.record(kind, topic, qos)
        self._observer.wait_for(
            lambda: record.messages and expected in shown(record.last),
            20.0,
            lambda: f'{expected or topic}: {record.messages[-2:]}; {self._diagnostics.messages}',
        )


def shown(message: Any) -> str:
    """Return as much of what ros2 topic echo prints as the pages tell."""
    if hasattr(message, 'status'):
        return ' '.join(each.name for each in message.status)
    data = getattr(message, 'data', '')
    return f'data: {str(data).lower() if isinstance(data, bool) else data}'


@pytest.fixture
def walk(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    observer: Observer,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Walk]:
    # test_doctor_graph.py looks at nodes that run; here are none yet.
    monkeypatch.setattr(doctor, 'look_apart', lambda *_: [])
    result = Walk(tmp_path, observer, request.param, capsys)
    yield result
    result.close()


@pytest.mark.parametrize(('walk', 'device'), [(each, each) for each in DEVICES], indirect=['walk'])
def test_start_page_brings_the_device_onto_a_topic(walk: Walk, device: str) -> None:
    for block in blocks(text_of(f'docs/start/{device}.md')):
        walk.do(block)
    run = 'ros2 run rugged_teleop'
    node = {'akron': 'akron_can'}.get(device, device)
    assert {f'{run} doctor', f'{run} {node}_bridge', 'ros2 topic echo'} <= {*walk.did}


@pytest.mark.parametrize('device', DEVICES)
def test_what_a_start_page_quotes_is_said(device: str) -> None:
    """The words before the first ellipsis of each quoted message stand in the device's page."""
    explained = text_of(f'docs/devices/{device}.md') + text_of('docs/common.md')
    explained = explained.replace('`', '')
    _, _, table = text_of(f'docs/start/{device}.md').partition('| it says | do this |\n')
    cells = re.findall(r'^\| (.+?) \|', table, re.MULTILINE)[1:]
    assert len(cells) >= 4
    quoted = {cell.split('…')[0].strip(' ,') for cell in cells}
    assert {text for text in quoted if text not in explained} == set()
