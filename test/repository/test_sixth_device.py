# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The worked example of docs/sixth_device.md: its blocks become a package, and that runs."""

from __future__ import annotations

from collections.abc import Iterator
import importlib
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
import yaml

from rugged_teleop.ptys import PtyDevice
from safety_mux.configuration import check, joy_mapping
from safety_mux.parameters import parameter_table
from stage.rig import latched, NodeProcess, Observer, ROOT
from test.repository.docs_rig import blocks, text_of

PAGE = 'docs/sixth_device.md'
PACKAGE = 'acme_pendant_bridge'
FILES = {
    name: f'{text.strip()}\n'
    for name, text in re.findall(r'```python\n# (\S+)\n(.*?)```', text_of(PAGE), re.DOTALL)
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / PACKAGE).mkdir()
    (tmp_path / PACKAGE / '__init__.py').touch()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    info = tmp_path / f'{PACKAGE}-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text(f'Name: {PACKAGE}\nVersion: 1.0\n')
    entry = f'[rugged_teleop.devices]\n{PACKAGE} = {PACKAGE}.device:DEVICE\n'
    (info / 'entry_points.txt').write_text(entry)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    yield tmp_path
    for name in [name for name in sys.modules if name.partition('.')[0] == PACKAGE]:
        del sys.modules[name]


def test_code_of_the_page_is_in_the_style_of_the_package(folder: Path) -> None:
    config = ('--config', str(ROOT / 'pyproject.toml'))
    for action in (['check'], ['format', '--check']):
        ruff = [sys.executable, '-m', 'ruff', *action, *config, '--exclude', 'test_*.py']
        subprocess.run([*ruff, str(folder / PACKAGE)], check=True)


def test_tests_of_the_page_pass(folder: Path) -> None:
    tests = importlib.import_module(f'{PACKAGE}.test_acme_pendant')
    names = [name for name in vars(tests) if name.startswith('test_')]
    assert len(names) == 3
    for name in names:
        getattr(tests, name)()


def run(*words: str, **options: Any) -> str:
    command = [sys.executable, '-m', 'rugged_teleop', *words]
    done = subprocess.run(command, check=True, capture_output=True, text=True, **options)
    return str(done.stdout)


def test_every_tool_knows_the_device_by_its_entry_point(folder: Path) -> None:
    simulator = importlib.import_module(f'{PACKAGE}.simulator').Simulator()
    simulator.apply('stop on')
    capture = folder / 'capture.bin'
    capture.write_bytes(b''.join(frame for now in range(9) for frame in simulator.poll(now)))
    assert run('decode', str(capture)).count('acme_pendant') == 9
    assert 'acme_pendant' in run('simulate', '--help')
    assert PACKAGE in run('rugged_teleop_stack', '--help')
    with PtyDevice(simulator, folder / 'port') as device:
        found = subprocess.run(
            [sys.executable, '-m', 'rugged_teleop', 'doctor', '--port', str(device.name)],
            capture_output=True,
            text=True,
        ).stdout
    assert f'the node for it: {PACKAGE}' in found


def test_mux_takes_the_parameters_of_the_page() -> None:
    (block,) = (each for each in blocks(text_of(PAGE)) if each.startswith('estop_sources'))
    given = dict(_flat(yaml.safe_load(block)))
    values = {each.name: each.default for each in parameter_table(given)} | given
    check(values, lambda topic: f'/{topic}')
    sample = joy_mapping(values, 'pendant').sample([1.0], [1])
    assert (sample.demand, sample.deadman) == ((5.0, 5.0), True)


def _flat(values: dict[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{name}.')
        else:
            yield prefix + name, value


def test_node_of_the_page_carries_lever_stop_and_a_lost_port(
    folder: Path, observer: Observer
) -> None:
    simulator = importlib.import_module(f'{PACKAGE}.simulator').Simulator()
    source = f'from {PACKAGE}.node import main; main()'
    port = folder / 'port'
    estop = observer.record(Bool, f'/{PACKAGE}/estop', latched())
    joy = observer.record(Joy, f'/{PACKAGE}/joy')

    def says(value: bool) -> None:
        estop.clear()
        observer.wait_for(lambda: estop.last and estop.last.data is value, 15.0, f'estop {value}')

    with (
        PtyDevice(simulator, port) as device,
        NodeProcess(parameters={'port': str(port)}, source=source) as node,
    ):

        def shows(lever: float, trigger: int) -> None:
            observer.wait_for(
                lambda: joy.last and (*joy.last.axes, *joy.last.buttons) == (lever, trigger),
                15.0,
                lambda: f'lever {lever}: {joy.last}; {node.output}',
            )

        says(False)
        device.apply('lever 0.5')
        device.apply('trigger on')
        shows(0.5, 1)
        device.apply('stop on')
        says(True)
        shows(0.0, 0)
        device.apply('stop off')
        says(False)
        device.apply('unplug')
        says(True)
        device.apply('plug')
        says(False)
        shows(0.5, 1)
