# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Shared by tests: a ROS domain of their own, a port to unplug, child processes, an observer.

Nothing here sleeps for a fixed time: ``wait_for`` polls a condition up to a deadline, and reports
what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
from dataclasses import dataclass, field
import functools
import json
import os
from pathlib import Path
import select
from signal import SIGCONT, SIGHUP, SIGINT, SIGQUIT, SIGSTOP, SIGTERM
import socket
import subprocess
import sys
import tempfile
import time
import tty
from typing import Any, TypeVar

from rugged_teleop.domains import claim_domain
from stage.forks import ForkedProcess, Server

ROOT = Path(__file__).resolve().parents[1]
NOT_INSTALLED = ('demo', 'stage', 'test', 'assurance')  # top-level folders of code
ENDING = (SIGTERM, SIGINT, SIGHUP, SIGQUIT)  # what ends a node
_POLL = 0.005
# Factor on all timeouts: a busy machine is slow, and test_uml.py's slower.
TIMEOUT_FACTOR = float(os.environ.get('RUGGED_TELEOP_PATIENCE', '3'))
_TRANSITIONS = {  # lifecycle_msgs/Transition, and the state behind it
    'configure': (1, 'inactive'),
    'cleanup': (2, 'unconfigured'),
    'activate': (3, 'active'),
    'deactivate': (4, 'inactive'),
}
T = TypeVar('T')


@functools.cache
def own_domain() -> socket.socket:
    """Give this process, and the children it starts, a ROS domain and a log directory, once."""
    if 'ROS_LOG_DIR' not in os.environ:
        os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='rugged_teleop_log_')
    return claim_domain()


_claims: list[socket.socket] = []


def claim(name: str) -> bool:
    """
    Claim a name, such as a port's, among all the processes that run tests here.

    Return false where it is taken. The kernel drops a claim with the process, however it ends.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f'\0rugged_teleop_test_{name}')
    except OSError:
        holder.close()
        return False
    _claims.append(holder)
    return True


def wait_for(
    condition: Callable[[], T],
    timeout: float = 5.0,
    what: str | Callable[[], str] = 'the condition',
    *,
    idle: Callable[[float], object] = time.sleep,
) -> T:
    """
    Return the first true value of ``condition``. :raises AssertionError: none within ``timeout``.

    :param what: names what is missing on a timeout; a function is called only then.
    :param idle: waits between two tries (seconds), for example by spinning an executor.
    """
    timeout *= TIMEOUT_FACTOR
    end = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > end:
            text = what() if callable(what) else what
            raise AssertionError(f'not within {timeout:g} s: {text}')
        idle(_POLL)
    return value


def holds_for(
    condition: Callable[[], bool],
    duration: float,
    what: str = 'the condition',
    *,
    idle: Callable[[float], object] = time.sleep,
) -> None:
    """Check that ``condition`` stays true. :raises AssertionError: as soon as it is false."""
    end = time.monotonic() + duration
    while time.monotonic() < end:
        assert condition(), f'did not hold for {duration:g} s: {what}'
        idle(_POLL)


class Pty:
    """
    The device's side of a serial port that can be unplugged.

    :param path: symbolic link by which the port is opened; it is removed while unplugged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = self._slave = -1
        self.received = b''  # all input so far, across reconnects
        self.replug()

    def replug(self) -> None:
        """Plug it in again, as a new device under the same name."""
        assert self.master < 0, 'it is still plugged in'
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Unplug it like a USB adapter: its name is removed, and its users get an error."""
        if self.master >= 0:
            self.path.unlink()
            os.close(self._slave)
            os.close(self.master)
            self.master = self._slave = -1

    def write(self, data: bytes) -> None:
        """Send to the other side."""
        os.write(self.master, data)

    def read(self) -> bytes:
        """Return the input since the last call, without waiting, and add it to ``received``."""
        data = b''
        with contextlib.suppress(BlockingIOError):
            while select.select([self.master], [], [], 0)[0]:
                data += os.read(self.master, 65536)
        self.received += data
        return data

    def wait_received(self, data: bytes, timeout: float = 2.0) -> None:
        """Read until ``data`` has arrived since the start or the last ``clear``."""

        def found() -> bool:
            self.read()
            return data in self.received

        wait_for(found, timeout, lambda: f'{data.hex(" ")} in {self.received[-200:].hex(" ")}')

    def clear(self) -> None:
        """Discard what was received."""
        self.read()
        self.received = b''


def ending_with(parent: int) -> list[str]:
    """
    Return what to put before a command that has to end with us, however we do.

    A node that is left alone would try its port for ever. A parent that was killed before the
    command asked for its signal sends none: there is another parent then.
    """
    words = ['setpriv', '--pdeathsig', 'KILL', 'sh', '-c', '[ "$PPID" = "$0" ] && exec "$@"']
    return [*words, str(parent)]


@functools.cache
def forks() -> Server:
    """Return what forks nodes for this process, once."""
    own_domain()
    return Server(ending_with(os.getpid()))


def run_python(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with these words to its end. :param options: of subprocess.run."""
    given: dict[str, Any] = {'cwd': ROOT, 'timeout': 60.0 * TIMEOUT_FACTOR, **options}
    if 'stdout' not in given:
        given['capture_output'] = True
    return subprocess.run([sys.executable, *words], text=True, **given)


def _is_stopped(pid: int) -> bool:
    threads = Path(f'/proc/{pid}/task').glob('*/stat')
    return all(thread.read_text().rpartition(') ')[2].startswith('T') for thread in threads)


class NodeProcess:
    """
    A child process: a module that runs a node, or ``source`` code. Use it as a context manager.

    :param module: such as ``fort_vsc_bridge.node``.
    :param parameters: given with ``-p``; the values are written as YAML.
    :param name: the node's name. :param namespace: such as ``/left``.
    :param arguments: further ROS arguments, such as ``('--params-file', path)``.
    :param terminal: a descriptor that it writes to, instead of what ``output`` returns.
    :param patient: a module's wire may be held up, see ``stage.patience``.
    """

    forked = False  # in all tests, see stage.forks; what measures starts as users do

    def __init__(
        self,
        module: str = '',
        parameters: Mapping[str, Any] | None = None,
        *,
        name: str = '',
        namespace: str = '',
        arguments: Sequence[str] = (),
        source: str = '',
        terminal: int | None = None,
        patient: bool = False,
    ) -> None:
        arguments = ['--ros-args', *_remapped(parameters or {}, name, namespace), *arguments]
        # A file, not a pipe: a node with much output must not block until the test reads it.
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed on exit
        stdout = self._output.fileno() if terminal is None else terminal
        modules = ['stage.patience', module] if patient else [module]
        program = ['-c', source] if source else ['-m', *modules]
        self.process: subprocess.Popen[bytes] | ForkedProcess
        if self.forked and forks().serves():
            self.process = ForkedProcess(forks(), [*program, *arguments], stdout)
            return
        self.process = subprocess.Popen(
            [*ending_with(os.getpid()), sys.executable, *program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
            env={**os.environ, 'PYTHONUNBUFFERED': '1'},
            start_new_session=True,  # with a share of the processors of its own
        )

    @property
    def output(self) -> str:
        """Its output so far, logs included."""
        return os.pread(self._output.fileno(), 1 << 20, 0).decode(errors='replace')

    def output_from(self, offset: int) -> str:
        """Its output from this byte on, of which there may be any amount."""
        size = os.fstat(self._output.fileno()).st_size
        return os.pread(self._output.fileno(), size, offset).decode('latin-1')

    def wait_output(self, text: str) -> None:
        """Wait until it has printed ``text``."""
        wait_for(lambda: text in self.output, 15.0, lambda: f'{text!r} in:\n{self.output}')

    def wait(self, timeout: float = 15.0) -> int:
        """Wait for its end; return the exit status, negative after a signal."""
        wait_for(
            lambda: self.process.poll() is not None,
            timeout,
            lambda: f'the end of {self.process.args!r}:\n{self.output}',
        )
        return self.process.wait()

    def signal(self, number: int) -> None:
        """Send a signal. No thread runs after SIGSTOP: they do until one of them has taken it."""
        self.process.send_signal(number)
        if number == SIGSTOP:
            wait_for(lambda: _is_stopped(self.process.pid), 5.0, 'a process that is stopped')

    def end(self, number: int = SIGTERM, timeout: float = 5.0) -> int:
        """Send a signal that ends it; return the exit status."""
        self.signal(number)
        return self.wait(timeout)

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(3.0 * TIMEOUT_FACTOR)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        if error is not None and not self._output.closed:
            print(f'{self.process.args!r} printed:\n{self.output}')
        self._output.close()


def _remapped(parameters: Mapping[str, Any], name: str, namespace: str) -> Iterator[str]:
    """Return ROS arguments for parameters and a name."""
    for key, value in parameters.items():
        yield from ('-p', f'{key}:={as_yaml(value)}')
    if name:
        yield from ('-r', f'__node:={name}')
    if namespace:
        yield from ('-r', f'__ns:={namespace}')


def as_yaml(value: Any) -> str:
    """Return a value as ``-p`` expects it: JSON is YAML, except for some floats."""
    if isinstance(value, float):
        text = repr(value)
        if text in ('nan', 'inf', '-inf'):
            return text.replace('nan', '.nan').replace('inf', '.inf')
        return text if '.' in text else text.replace('e', '.0e')  # 1e-05 would be a string
    if isinstance(value, list | tuple):
        return '[' + ', '.join(as_yaml(item) for item in value) + ']'
    return json.dumps(value, default=str)  # a path


@dataclass
class Record:
    """Messages of a topic and their arrival (seconds, monotonic), oldest first."""

    topic: str
    messages: list[Any] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    @property
    def last(self) -> Any:
        """The newest message; None before the first."""
        return self.messages[-1] if self.messages else None

    @property
    def data(self) -> list[Any]:
        """The ``data`` fields, for std_msgs."""
        return [message.data for message in self.messages]

    def since(self, moment: float) -> Iterator[tuple[float, Any]]:
        """Return (arrival, message) of the messages that arrived after ``moment``."""
        pairs = zip(self.times, self.messages, strict=True)
        return ((arrival, message) for arrival, message in pairs if arrival > moment)

    def clear(self) -> None:
        """Discard all messages."""
        self.messages.clear()
        self.times.clear()


class Observer:
    """
    A node in the test's process, with a context of its own; it works only while it is spun.

    ``wait_for`` spins it between two checks. Use it as a context manager.
    """

    def __init__(self, name: str = 'observer') -> None:
        import rclpy
        from rclpy.context import Context

        from stage.observer_node import ObserverNode

        own_domain()
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = ObserverNode(name, context=self.context)
        self._clients: dict[str, Any] = {}

    def spin(self, duration: float = 0.0) -> None:
        """Process what has arrived; wait at most ``duration`` s for it."""
        self.node.take(duration)

    def wait_for(
        self,
        condition: Callable[[], T],
        timeout: float = 10.0,
        what: str | Callable[[], str] = 'the condition',
    ) -> T:
        """Spin until ``condition`` is true; see the function ``wait_for``."""
        return wait_for(condition, timeout, what, idle=self.spin)

    def holds_for(
        self, condition: Callable[[], bool], duration: float, what: str = 'the condition'
    ) -> None:
        """Spin and check that ``condition`` stays true; see the function ``holds_for``."""
        holds_for(condition, duration, what, idle=self.spin)

    def record(self, kind: Any, topic: str, qos: Any = 10, *, keep: int | None = None) -> Record:
        """
        Subscribe and keep what comes.

        :param qos: a depth or QoSProfile; ``latched()`` too. :param keep: the newest only.
        """
        record = Record(topic)

        def on_message(message: Any) -> None:
            record.times.append(time.monotonic())
            record.messages.append(message)
            if keep is not None and len(record.times) > 2 * keep:
                del record.times[:-keep], record.messages[:-keep]

        self.node.create_subscription(kind, topic, on_message, qos)
        return record

    def publisher(self, kind: Any, topic: str, qos: Any = 10) -> Any:
        """Return a publisher that is matched with a subscription."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.wait_for(publisher.get_subscription_count, 15.0, f'a subscriber of {topic}')
        return publisher

    def client(self, kind: Any, service: str) -> Any:
        """Return the client of a service. It is kept: have it long before a first ``call``."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        return self._clients[service]

    def call(
        self, kind: Any, service: str, request: Any = None, timeout: float = 15.0, tries: int = 1
    ) -> Any:
        """
        Call a service and return its response.

        A node that has not discovered this client yet drops its response. Clients are kept, so
        this happens to a first call only; set ``tries`` above 1 only for services that may be
        called twice.
        """
        client = self.client(kind, service)
        self.wait_for(client.service_is_ready, timeout, f'service {service}')
        for remaining in reversed(range(tries)):
            future = client.call_async(kind.Request() if request is None else request)
            try:
                self.wait_for(future.done, timeout / tries, f'response of {service}')
            except AssertionError:
                if not remaining:
                    raise
            else:
                break
        return future.result()

    def set_parameter(self, node: str, name: str, value: Any) -> tuple[bool, str]:
        """Set a parameter of another node; return success and reason."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        response = self.call(SetParameters, f'{node}/set_parameters', request, tries=10)
        result = response.results[0]
        return result.successful, result.reason

    def change_state(self, node: str, transition: str) -> bool:
        """Request a transition: ``configure``, ``activate``, ``deactivate`` or ``cleanup``."""
        from lifecycle_msgs.srv import ChangeState

        number, state = _TRANSITIONS[transition]
        request = ChangeState.Request()
        request.transition.id = number
        try:
            return bool(self.call(ChangeState, f'{node}/change_state', request, 3.0).success)
        except AssertionError:
            return self.state(node) == state

    def state(self, node: str) -> str:
        """Return the label of a managed node's state, such as ``active``."""
        from lifecycle_msgs.srv import GetState

        return str(self.call(GetState, f'{node}/get_state', tries=10).current_state.label)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self.context.try_shutdown()

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def latched() -> Any:
    """
    Return the QoS by which a late subscriber gets the last value of a state topic.

    It keeps 100 values, 5 s of an e-stop: a test that a busy machine holds up misses no short one.
    """
    from rclpy.qos import DurabilityPolicy, QoSProfile

    return QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
