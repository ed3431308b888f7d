# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every test process gets a ROS domain and a log directory of its own, before rclpy can start."""

from collections.abc import Iterator
import contextlib
import gc
from importlib.util import find_spec
import os
from pathlib import Path
import shutil
import signal
import tempfile
from typing import Any

from hypothesis import HealthCheck, settings
import pytest

from bridge_core import output
from bridge_core.transports import active, can_pumped, can_socket, link, wire
from rugged_teleop import ports
from stage.admission import admit
from stage.can_rig import CanBus, make_bus
from stage.link_rig import Bench
from stage.rig import ENDING, NodeProcess, Observer, own_domain, Pty

_BEGUN: set[Path] = set()  # files of tests
_PRIORITY = os.getpriority(os.PRIO_PROCESS, 0)
_LOG_DIR = tempfile.mkdtemp(prefix='rugged_teleop_log_')
os.environ['ROS_LOG_DIR'] = _LOG_DIR
own_domain()
output._LAST_TIME = 20.0  # s, for the last words of a node on a busy machine
ports._ANSWER_TIME = 20.0  # s, for the answer of a simulated device there
NodeProcess.forked = True
# No test asserts a speed: an example that takes long is one on a busy machine. The examples are
# the same each time: what passed once passes on.
settings.register_profile(
    'settled', deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile('settled')
# Under nohup or in the background a process ignores signals, and so do those that it starts.
for _number in ENDING:
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, signal.SIG_DFL)
# No Debian package has these. make test does, colcon test with what rosdep installs goes without.
_NEEDING = {
    'gpiod': ['test_io_gpio.py', 'test_io_node.py'],
    'pymodbus': ['test_io_modbus.py', 'test_io_node.py', 'test_io_session.py'],
    'cantools': ['test_akron_dbc.py', 'test_fort_vsc_dbc.py'],
    'j1939': ['test_can_neighbour.py'],
    'mcap': [
        *('test_decode_recordings.py', 'test_why.py'),
        *('test_recorder.py', 'test_recorder_node.py', 'test_recorder_spine.py'),
    ],
}
collect_ignore_glob = [
    f'test/*/{name}' for module in _NEEDING if not find_spec(module) for name in _NEEDING[module]
]


def pytest_unconfigure() -> None:
    shutil.rmtree(_LOG_DIR, ignore_errors=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let what waits long come first, what computes last: one worker begins there."""
    items.sort(key=lambda item: (*computing(item), -seconds(item, 'waits')))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Have one worker compute all the time: the others wait for most of theirs."""
    from stage.scheduling import Scheduling

    return Scheduling(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    # More is next to nothing beside work at nice 0; less is not everybody's to take.
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, max(5 * computing(item)[0], _PRIORITY))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    if item.path not in _BEGUN and 'PYTEST_XDIST_WORKER' in os.environ and not computing(item)[0]:
        admit(many=seconds(item, 'waits') > 0)
    _BEGUN.add(item.path)
    yield
    if 'context' in getattr(item, 'fixturenames', ()):
        gc.collect()  # nodes are in cycles, and would stay in the graph of the tests that follow


def computing(item: pytest.Item) -> tuple[bool, float]:
    """Tell whether it has the mark ``computes``, and the seconds that this gives."""
    return item.get_closest_marker('computes') is not None, seconds(item, 'computes')


def seconds(item: pytest.Item, name: str) -> float:
    """Return what its mark of this name gives, 0 without one."""
    mark = item.get_closest_marker(name)
    return sum(mark.args) if mark else 0


def pytest_collection_finish() -> None:
    """Set all that is loaded apart: a node's end has the collector run, which is to be quick."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[Pty]:
    device = Pty(tmp_path / 'device')
    yield device
    device.unplug()


@pytest.fixture
def observer() -> Iterator[Observer]:
    with Observer() as result:
        yield result


@pytest.fixture
def patient_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a link in this process take all, however late a busy machine lets it."""
    for module in (active, wire):
        monkeypatch.setattr(module, 'FROZEN_TIME', 20.0)
    monkeypatch.setattr(link, 'REQUEST_LIMIT', 20.0)
    monkeypatch.setattr(link, 'ANSWER_TIME', 20.0)


@pytest.fixture
def bench(patient_link: None) -> Iterator[Bench]:
    """Give a link with fakes all around, its thread running."""
    result = Bench()
    port = result.transport
    result.link.start()
    yield result
    port.gate.set()
    result.link.stop()


@pytest.fixture
def can_bus() -> Iterator[CanBus]:
    """Give a CAN bus of the test's own; see can_rig."""
    result = make_bus()
    yield result
    result.close()


@pytest.fixture
def patient_writer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep a CAN port's frames for a writer thread that a busy machine holds up."""
    for module in (can_pumped, can_socket):
        monkeypatch.setattr(module, 'OLD', 20.0)


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """
    Give an initialised rclpy context, for nodes in the test's own process.

    Their lanes answer however late a busy machine lets them.
    """
    import rclpy
    from rclpy.context import Context

    from bridge_core import lane

    monkeypatch.setattr(lane, '_CALL_LIMIT', 20.0)
    result = Context()
    rclpy.init(context=result)
    yield result
    result.try_shutdown()
