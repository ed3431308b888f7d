# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Running nodes: start, signals, the exit status, and leaving the devices safe."""

from collections.abc import Callable, Collection, Iterable, Sequence
import gc
import os
from pathlib import Path
import re
import signal
import sys
import threading
import traceback

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity
from rclpy.signals import SignalHandlerOptions

from bridge_core import clock, refusals
from bridge_core.descriptors import close_inherited_descriptors, fill_standard_descriptors
from bridge_core.help import help_text
from bridge_core.managed_node import ManagedNode
from bridge_core.output import log_file, NO_SHOW, unblocked_output, without_ros_log_file
from bridge_core.parameter_files import (
    check_each_used,
    check_files,
    check_overrides,
    files_of,
    sections_of,
)
from bridge_core.parameters import ParameterError
from bridge_core.rclpy_inner import DatingExecutor
from bridge_core.realtime import use_realtime
from bridge_core.remappings import check_remappings
from bridge_core.share import loopback_profiles
from bridge_core.thread_name import show_thread
from bridge_core.transports import TransportError

_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_WIDE = ('', 'SUBNET', 'SYSTEM_DEFAULT', 'OFF')  # any other word is LOCALHOST to rcl
_ONLY = 'ROS_LOCALHOST_ONLY'  # rcl puts a 1 above range and peers
_PEERS = 'ROS_STATIC_PEERS'
_PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
# Who has set one of these has chosen the transports of Fast DDS.
_CHOICES = {'FASTDDS_BUILTIN_TRANSPORTS', *_PROFILES}
_SOURCE = re.compile(r', at /\S+\.c:\d+')  # of rcl, which nobody here has
_GARBAGE = 50_000  # objects until the collector looks for cycles
# s for which a thread may keep the interpreter while others want it; 5 ms by default. A stop waits
# for that long if it comes amid other work.
_SWITCH_INTERVAL = 0.0002

# s; writers ask each 0.2 s. Of a reader that is frozen or was killed nothing ever comes.
_ACKNOWLEDGE_LIMIT = 0.3
_THREADS_LIMIT = 2.0  # s; see docs/common.md, When it is stopped
_SPIN_LIMIT = 0.5  # s that the farewells wait for the executors
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class _End:
    """
    A signal that ends a process, or a fault, for the main thread to wait for.

    SIGHUP comes from a closed terminal or SSH session. It and SIGQUIT stay ignored where they are,
    as under nohup.

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
            for number in _SIGNALS
            if number in _SIGNALS[:2] or signal.getsignal(number) is not signal.SIG_IGN
        }

    def tell(self) -> None:
        os.write(self._write, b'\0')

    def wait(self) -> None:
        os.read(self._read, 1)

    def close(self, *, last: bool) -> None:
        """Give the signals back to whoever had them, or have them change no status any more."""
        signal.set_wakeup_fd(self._wakeup)
        for number, handler in self._handlers.items():
            signal.signal(number, signal.SIG_IGN if last else handler)
        os.close(self._read)
        os.close(self._write)


def run(
    factories: Sequence[Callable[..., ManagedNode]],
    args: Sequence[str] | None = None,
    *,
    names: Collection[str] = (),
    configured: bool = False,
    last: bool = False,
) -> int:
    """
    Run nodes until a signal ends them, each with an executor and a thread of its own.

    Return the exit status: 0 after a signal, 2 for a bad parameter or argument, 1 for a fault.

    :param args: with the program's name first; sys.argv if there are none.
    :param names: arguments that are no argument of ROS, and known all the same.
    :param configured: these are all nodes that the parameter files have a section for.
    :param last: the process ends with the nodes, as it does anyway where no args are given.
    """
    fill_standard_descriptors()
    if signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN:  # by who has started this
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # or nobody learns how a wire has ended
    argv = list(sys.argv if args is None else args)
    if last or args is None:
        close_inherited_descriptors(argv)
    unknown = [word for word in words_beside_ros(argv) if word not in names]
    if {'-h', '--help'} & set(unknown):
        try:
            print(help_text(factories), end='')
        except ParameterError as error:  # it needs what is not installed
            return _refuse(str(error))
        return 0
    if unknown:
        return _refuse(
            f'{unknown[0]!r} is unknown; give parameters as --ros-args -p name:=value, '
            'and see --help'
        )
    end = _End()
    try:
        with unblocked_output(log_file(argv), shown=NO_SHOW not in argv):
            try:
                return _run(factories, argv, names, end, configured=configured)
            finally:
                # Nodes are in reference cycles. Left to the collector, the middleware would end
                # some time, in whichever thread allocates next, and its threads and descriptors
                # would stay until then. No frame here names a node any more.
                gc.collect()
    finally:
        end.close(last=last or args is None)


def words_beside_ros(argv: Sequence[str]) -> list[str]:
    """
    Return what a command line has outside of ``--ros-args ... --``, without the program's name.

    ROS itself takes ``port:=/dev/x`` there for a remapping, and says nothing but "deprecated".
    """
    words, inside = [], False
    for word in argv:
        if word == '--ros-args':
            inside = True
        elif inside:
            inside = word != '--'
        else:
            words.append(word)
    return words[1:]


def _run(
    factories: Sequence[Callable[..., ManagedNode]],
    argv: list[str],
    names: Collection[str],
    end: _End,
    *,
    configured: bool,
) -> int:
    note = avoid_shared_memory()
    files = files_of(argv)
    threads: list[threading.Thread] = []
    try:
        for file in files:
            sections_of(file)
        # With ROS's own handlers the context would be gone before the last stop was published.
        rclpy.init(args=without_ros_log_file(argv), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # RCLError and others are not exported; all mean bad arguments
        return _refuse(_SOURCE.sub('', str(error)))
    nodes: list[ManagedNode] = []
    if not gc.get_freeze_count():
        gc.freeze()  # what was imported stays to the end, and need not be searched again and again
    try:
        for factory in factories:
            nodes.append(factory(parameter_files=files))
        full_names = [node.get_fully_qualified_name() for node in nodes]
        check_files(full_names, files)
        if configured:
            check_each_used(full_names, files)
        check_overrides(full_names, argv)
        check_remappings(nodes, argv, names)
        if nodes and note:
            nodes[0].get_logger().info(note)
        _prefer(nodes)
        return _spin(nodes, end, threads)
    except (ParameterError, ParameterException) as error:
        for node in nodes:
            node.get_logger().set_level(LoggingSeverity.ERROR)  # their stop is no news
        of = getattr(error, 'node', '')
        return _refuse(f'{of}: {error}' if of and len(factories) > 1 else str(error), of)
    finally:
        threads += filter(None, (node.lane.thread for node in nodes))
        _leave(nodes)
        _await(threads, _THREADS_LIMIT)


def _refuse(text: str, node: str = '') -> int:
    """Say in one line what is wrong with the command line or a file; return the exit status."""
    line = ' '.join(text.split())
    print(f'rugged_teleop: {line}', file=sys.stderr)
    refusals.leave(node or Path(sys.argv[0]).name, line)
    return 2


def avoid_shared_memory() -> str:
    """
    Have Fast DDS use UDP, unless the user has chosen: see docs/decisions/0012.

    Where ROS stays on this machine that takes a profile. Nodes with it and without it meet. Return
    what the user should know.
    """
    middleware = os.environ.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'
    if any(map(os.environ.get, _CHOICES)) or not middleware.startswith('rmw_fastrtps'):
        return ''
    by = _ONLY if os.environ.get(_ONLY) == '1' else _RANGE
    if by == _RANGE and os.environ.get(_RANGE, '') in _WIDE:
        os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
        return ''
    local = f'{by} is {os.environ[by]}'
    if by == _RANGE and os.environ.get(_PEERS):  # nothing but LOCALHOST has peers and no multicast
        return (
            f'unset {_PEERS}, or set {_RANGE} to SUBNET: shared memory is in use, which can '
            f'block, because {_PEERS} is set and {local}'
        )
    profiles = loopback_profiles()
    name, profile = next(iter(profiles.items()))
    os.environ[_RANGE] = 'SYSTEM_DEFAULT'  # as the profile says
    for other in (_ONLY, *_CHOICES):  # none, or an empty one
        os.environ.pop(other, None)
    os.environ |= profiles
    return (
        f'messages stay on this computer, as {local}, and go by UDP, as '
        f'{profile} says; {name} chooses another profile'
    )


def _prefer(nodes: Sequence[ManagedNode]) -> None:
    """Have a stop wait for little else in this process, and if asked to, for no other process."""
    gc.set_threshold(_GARBAGE)  # nothing here is made for cycles
    sys.setswitchinterval(_SWITCH_INTERVAL)
    priority = max((node.values['rt_priority'] for node in nodes), default=0)
    for text in use_realtime(priority) if priority else ():
        nodes[0].get_logger().warning(text)


def _spin(nodes: Sequence[ManagedNode], end: _End, threads: list[threading.Thread]) -> int:
    """Spin until the end, in ``threads`` that are added; return the exit status."""
    stop = threading.Event()
    statuses = [0]
    executors = [DatingExecutor() for _ in nodes]

    def end_by_fault(*_: object) -> None:
        statuses.append(1)
        end.tell()

    def spin(node: ManagedNode, executor: DatingExecutor) -> None:
        show_thread(f'spin {node.get_name()}')
        executor.add_node(node)
        try:
            node.autostart()
            while not stop.is_set():
                executor.spin_once()
        except ExternalShutdownException:
            end.tell()
        except ParameterError as error:
            statuses.append(_refuse(str(error)))
            end.tell()
        except TransportError as error:  # no fault of the parameters: it may be started again
            _refuse(str(error))
            end_by_fault()
        except BaseException:  # SystemExit would end this thread, and say nothing
            node.get_logger().fatal(traceback.format_exc())
            end_by_fault()

    threads += (
        threading.Thread(target=spin, args=pair, daemon=True)
        for pair in zip(nodes, executors, strict=True)
    )
    for thread in threads:
        thread.start()
    for node in nodes:
        node.lane.fault.add_done_callback(end_by_fault)
    end.wait()
    stop.set()
    for executor in executors:
        executor.create_task(int)  # its wake() alone does not end a wait
    _await(threads, _SPIN_LIMIT)
    for thread, executor in zip(threads, executors, strict=True):
        if not thread.is_alive():
            executor.shutdown()
    return max(statuses)


def _leave(nodes: list[ManagedNode]) -> None:
    """Have every node leave its device safe, whatever others raise; then let go of them."""
    for node in sorted(nodes, key=lambda node: not node.actuates):
        _guarded(node.shut_down)
    _guarded(lambda: _wait_acknowledged(nodes))
    while nodes:
        _guarded(nodes.pop().destroy_node)
    _guarded(rclpy.try_shutdown)


def _await(threads: Iterable[threading.Thread], limit: float) -> None:
    """
    Wait for the ends of all threads, at most for ``limit`` s.

    A busy machine may give one no time until then. If the interpreter's end found it amid a call
    of the middleware, the process would abort.
    """
    end = clock.now() + limit
    for thread in threads:
        thread.join(max(0.0, end - clock.now()))


def _wait_acknowledged(nodes: Sequence[ManagedNode]) -> None:
    """
    Wait until the last stop has arrived everywhere, at most for _ACKNOWLEDGE_LIMIT.

    A reader throws away what it has not yet taken in of a writer that it sees leave; and it may
    well see that first, since the two come by different sockets and threads.
    """
    end = clock.now() + _ACKNOWLEDGE_LIMIT
    for publisher in (publisher for node in nodes for publisher in node.publishers):
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - clock.now())))


def _guarded(step: Callable[[], object]) -> None:
    try:
        step()
    except BaseException:
        traceback.print_exc()
