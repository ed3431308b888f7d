"""Running nodes: start, signals, the exit status, and leaving the devices safe."""

from collections.abc import Callable
from collections.abc import Sequence
import gc
import os
import signal
import sys
import threading
import time
import traceback

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from bridge_core.node import ManagedNode
from bridge_core.parameter_files import files_of
from bridge_core.parameters import ParameterError

# Who has set one of these has chosen the transports of Fast DDS.
_CHOICES = {
    'FASTDDS_BUILTIN_TRANSPORTS',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
}


_ACKNOWLEDGE_LIMIT = 0.2  # s; of a reader that is frozen or was killed nothing ever comes


class _End:
    """
    SIGINT, SIGTERM or a fault, for the main thread to wait for.

    The interpreter itself writes the signal into the pipe, in whichever thread the kernel delivers
    it. An Event would not do: its set() may interrupt itself, and the thread that waits for it is
    not woken by a signal that another thread took.
    """

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        self._wakeup = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        self._handlers = {
            number: signal.signal(number, lambda *_: None)
            for number in (signal.SIGINT, signal.SIGTERM)
        }

    def tell(self) -> None:
        os.write(self._write, b'\0')

    def wait(self) -> None:
        os.read(self._read, 1)

    def close(self) -> None:
        """Give the signals back to whoever had them."""
        signal.set_wakeup_fd(self._wakeup)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        os.close(self._read)
        os.close(self._write)


def run(factories: Sequence[Callable[..., ManagedNode]], args: list[str] | None = None) -> int:
    """
    Run nodes until SIGINT or SIGTERM, each with an executor and a thread of its own.

    Return the exit status: 0 after a signal, 2 for a bad parameter or argument, 1 for a fault.
    """
    _avoid_shared_memory()
    try:
        # With ROS's own handlers the context would be gone before the last stop could be told.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # RCLError and others are not exported; all mean bad arguments
        print(f'rugged_teleop: {_one_line(error)}', file=sys.stderr)
        return 2
    end = _End()
    nodes: list[ManagedNode] = []
    try:
        files = files_of(sys.argv if args is None else args)
        for factory in factories:
            nodes.append(factory(parameter_files=files))
        return _spin(nodes, end)
    except (ParameterError, ParameterException) as error:
        print(f'rugged_teleop: {_one_line(error)}', file=sys.stderr)
        return 2
    finally:
        _leave(nodes)
        end.close()


def _avoid_shared_memory() -> None:
    """
    Have Fast DDS use UDP, unless the user has chosen: see docs/decisions/0012.

    It has no effect under ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, nor in other middlewares.
    """
    if not _CHOICES & os.environ.keys():
        os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'


def _spin(nodes: Sequence[ManagedNode], end: _End) -> int:
    """Spin until the end; return the exit status."""
    stop = threading.Event()
    statuses = [0]

    def spin(node: ManagedNode) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            node.autostart()
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.1)
        except ExternalShutdownException:
            end.tell()
        except ParameterError as error:
            print(f'rugged_teleop: {_one_line(error)}', file=sys.stderr)
            statuses.append(2)
            end.tell()
        except Exception:
            node.get_logger().fatal(traceback.format_exc())
            statuses.append(1)
            end.tell()
        executor.shutdown()

    threads = [threading.Thread(target=spin, args=(node,), daemon=True) for node in nodes]
    for thread in threads:
        thread.start()
    end.wait()
    stop.set()
    for thread in threads:
        thread.join(timeout=0.5)
    return max(statuses)


def _leave(nodes: list[ManagedNode]) -> None:
    for node in nodes:
        node.shut_down()
    _wait_acknowledged(nodes)
    while nodes:
        nodes.pop().destroy_node()
    rclpy.try_shutdown()
    # Nodes are in reference cycles. Left to the collector, the middleware would end some time, in
    # whichever thread allocates next, and its threads and descriptors would stay until then.
    gc.collect()


def _wait_acknowledged(nodes: Sequence[ManagedNode]) -> None:
    """
    Wait until the last stop has arrived everywhere, at most for _ACKNOWLEDGE_LIMIT.

    A reader throws away what it has not yet taken in of a writer that it sees leave; and it may
    well see that first, since the two come by different sockets and threads.
    """
    end = time.monotonic() + _ACKNOWLEDGE_LIMIT
    for publisher in (publisher for node in nodes for publisher in node.publishers):
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split())
