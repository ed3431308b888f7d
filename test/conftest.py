"""Every test process gets a ROS domain and a log directory of its own, before rclpy can start."""

from collections.abc import Iterator
import gc
import os
from pathlib import Path
import re
import shutil
import tempfile
from typing import Any

from hypothesis import HealthCheck
from hypothesis import settings
import pytest

from test.can_rig import CanBus
from test.can_rig import make_bus
from test.can_rig import VARIABLE
from test.link_rig import Bench
from test.rig import Observer
from test.rig import own_domain
from test.rig import Pty
from test.uml import Kernels
from test.uml import missing

_LOGIC = re.compile(
    'arbiter|checksums|convert|crc32|dbc|exploration|framing|image|j1939|limits|mapping|owners'
    '|properties|_protocol|_session|_simulator|fort_vsc_can$|fort_vsc_hid$|vm110_simulator'
)
_LOG_DIR = tempfile.mkdtemp(prefix='rugged_teleop_log_')
os.environ['ROS_LOG_DIR'] = _LOG_DIR
own_domain()
# No test asserts a speed, and an example that takes long is one on a busy machine.
settings.register_profile('clockless', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('clockless')


def pytest_unconfigure() -> None:
    shutil.rmtree(_LOG_DIR, ignore_errors=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """
    Mark what runs once more on a real CAN interface: all that asks for a bus.

    What has processes and time-outs comes first, and has the machine to itself. The kernels of
    test_uml run beside the rest, and are asked last.
    """
    items.sort(key=lambda item: (item.path.name == 'test_uml.py', is_logic(item)))
    for item in items:
        names = getattr(item, 'fixturenames', [])
        if 'can_bus' in names:
            item.add_marker('can_bus')
        if is_logic(item) and 'kernels' not in names:
            names.append('kernels')


def is_logic(item: pytest.Item) -> bool:
    """Tell whether it needs neither processes nor ports nor a clock."""
    return _LOGIC.search(item.path.stem) is not None


def pytest_collection_finish() -> None:
    """Set all that is loaded apart: a node's end has the collector run, which is to be quick."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope='session')
def kernels(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Kernels]:
    """Run what test_uml is to show, from the first test on that needs no quiet."""
    wanted = [item for item in request.session.items if item.path.name == 'test_uml.py']
    can_run = not missing() and VARIABLE not in os.environ
    files = [item.callspec.params['file'] for item in wanted] if can_run else []  # type: ignore[attr-defined]
    with Kernels(tmp_path_factory.mktemp('kernels'), files) as result:
        yield result


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
def bench() -> Iterator[Bench]:
    """Give a link with fakes all around, its thread running."""
    result = Bench()
    result.link.start()
    yield result
    result.transport.gate.set()
    result.link.stop()


@pytest.fixture
def can_bus() -> Iterator[CanBus]:
    """Give a CAN bus of the test's own; see can_rig."""
    result = make_bus()
    yield result
    result.close()


@pytest.fixture
def context() -> Iterator[Any]:
    """Give an initialised rclpy context, for nodes in the test's own process."""
    import rclpy
    from rclpy.context import Context

    result = Context()
    rclpy.init(context=result)
    yield result
    result.try_shutdown()
