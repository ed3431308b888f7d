# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A wire in a process of its own, for actuators: it outlives its node long enough to stop them.

The two talk over a socket pair of messages (SOCK_SEQPACKET), and neither ever waits for the other.
When the node is gone, in whatever way, the wire finds the socket ended, says its farewell and
ends. Where it died with the node, its spare says it: the node keeps what is in force where the
spare finds it. When the node hangs, its requests grow stale at the session. When the wire is gone
or hangs, the node demands a stop and another one takes over, which begins stopped: a spare process
that has loaded all it needs and waits to be told, since a start takes long on a busy machine.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from dataclasses import dataclass
from itertools import takewhile
import math
import os
from pathlib import Path
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from typing import Any

from bridge_core import clock
from bridge_core.report import Report, Status
from bridge_core.session import Level, StopChanged, Verdict
from bridge_core.transports.link import ANSWER_TIME, Link
from bridge_core.transports.request import Activate, Deactivate, Request
from bridge_core.transports.wire import BACKOFF_START
from bridge_core.transports.wire_process import ENDING, InForce, receive, TURN
from bridge_core.waiting import FAULT_PAUSE, ready

_PROGRAM = 'bridge_core.start_wire'
SILENCE_LIMIT = 0.085  # s without any, after which the node demands a stop
_KILL_TIME = 0.25  # s without any, after which another wire takes over
_TAKE_OVER_TIME = 1.0  # s until the first; a machine that is so busy would start none sooner
_LATE = 0.005  # s
_START_TIME = 25.0  # s that a start may take; a starved machine needs most of it
_CLOSE_TIME = 0.1  # s more, for a wire whose port is being closed: a slow line has bytes to send
_LAST_WORDS = 0.2  # s to say why it cannot start, and end
_SPARE_TIME = 1.0  # s after which a wire gets a spare; what starts is busy enough before
_LONG_LIFE = 5.0  # s, after which the next start comes at once
_REPORT_PERIOD = 1.0  # s
_FAULT_TIME = 1.0  # s that the stop after a fault of the owner lasts
_ROOM = 1 << 20  # bytes, for messages either way; the system may allow less
_LARGEST = 1 << 16  # bytes of a request; any system has room for that
_NOTHING_TAKEN = 'its wire takes nothing'
_READS = 1024  # messages before the silence is judged again, and requests are refused


@dataclass
class _Process:
    """
    One that runs the wire, or a spare.

    :param socket: to it.
    :param started_at: s, as of clock.now.
    :param ready: it has loaded what it needs; a spare waits to be told.
    """

    process: subprocess.Popen[bytes]
    socket: socket.socket
    started_at: float
    ready: bool = False

    def receive(self) -> bytes | None:
        """Return what it says next, without waiting; empty: it has ended; None: nothing."""
        return receive(self.socket)

    def end(self, timeout: float) -> None:
        """Have it end; one that takes longer than ``timeout`` s is killed, at 0 unasked."""
        if timeout > 0.0:
            self.ends(timeout)
        self.process.kill()
        self.process.wait()
        self.socket.close()

    def ends(self, timeout: float) -> bool:
        """Have it end; tell whether it has within ``timeout`` s, farewell included."""
        self.socket.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(timeout) == 0
        return False


class ProcessLink(Link):
    """
    Keeps a process running that runs the wire, and a spare one.

    All that the owner is told, it is told by the thread that reads what the wire says. So an owner
    that hangs is silent, and nobody takes it for a healthy one.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._lock = threading.Lock()  # of the next six
        self._wire: _Process | None = None
        self._commands: dict[int, Request] = {}  # not ended yet
        self._activation: Request | None = None  # in force, or asked for
        self._before: Request | None = None  # in force where that one is refused
        self._unsent: list[tuple[Request, str]] = []  # to be refused, and why
        self._in_force = InForce()  # what the wire has to be told, or ended for it
        self._spare: _Process | None = None
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._ended = False
        # What this process becomes later, it becomes for another node in it.
        self._begins_ordinary = os.sched_getscheduler(0) == os.SCHED_OTHER
        self._restarts = -1  # the first is none
        self._backoff = BACKOFF_START
        self._start_at = self._took_over_at = self._pace_at = self._report_at = 0.0
        self._limit = self._kill_at = 0.0  # of silence
        self._sound_at = 0.0  # not before, after a fault of the owner
        self._verdict: Verdict | None = None  # the wire's own
        self._releases = False  # it is no stop, and the owner has not been told yet
        self._said_at = 0.0  # when the wire said what was read last; 0: something before is lost
        self._trouble = ''  # why there is no healthy wire
        self._last_end = 'none'

    # -- requests, from any thread ----------------------------------------------------------------

    def _put(self, request: Request, each: bool) -> bool:
        del each  # none replaces another: all are sent
        with self._lock:
            if isinstance(request.what, Activate):
                if self._activation is None or self._activation.number not in self._commands:
                    self._before = self._activation
                self._activation = request
            if request.is_command:
                self._commands[request.number] = request
                self._keep()
            why = self._send(request)
            refused = why != '' and (request.waits or why != _NOTHING_TAKEN)
            if refused:
                self._unsent.append((request, why))
                self._wake()
        return refused or not why

    def deactivate(self) -> None:
        """Send the farewell and close the port; as of Link."""
        with self._lock:
            idle = self._activation is None and not self._commands
        if not idle:  # else there is no farewell to wait for, from a process that may just start
            super().deactivate()

    def _send(self, request: Request) -> str:
        """Send it, if that is possible; return why not."""
        if self._wire is None or not (self._wire.ready or request.is_command):
            # Commands wait. All else would fill the socket of a process that loads, which ended at
            # the first stop too many, and so would the next. It begins stopped without them.
            return _NOTHING_TAKEN
        data = pickle.dumps(tuple(request))
        if len(data) > _LARGEST and not request.stop:
            return f'it takes {len(data)} bytes; {_LARGEST} are allowed'
        try:
            self._wire.socket.send(data)
        except OSError:  # it is full, or it has ended
            if request.stop:
                self._wire.process.kill()  # it takes nothing any more, not even a stop
            return _NOTHING_TAKEN
        return ''

    def _orders(self) -> list[Request]:
        """Return what a wire has to be told that takes over: the activation, what is not done."""
        activation = self._activation
        if activation is not None and activation.number in self._commands:
            activation = self._before
        first = [] if activation is None else [activation]
        return [self._informed(each) for each in (*first, *self._commands.values())]

    def _keep(self) -> None:
        """Keep that for the spare, which finds it there where node and wire die at once."""
        self._in_force.keep(self._orders())

    def _wake(self) -> None:
        if self._wake_fd >= 0:
            os.eventfd_write(self._wake_fd, 1)

    # -- the reader's thread ----------------------------------------------------------------------

    def _run(self) -> None:
        # A process inherits that, and may not be ended before it can ignore them: see load().
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        try:
            while not self._ended:
                if not self._guarded_step():
                    time.sleep(FAULT_PAUSE)
        finally:
            self._leave()

    def _guarded_step(self) -> bool:
        """Take one; tell whether it went well."""
        try:
            self._wait_and_step()
        except Exception:
            self._take_as_stop(clock.now())
            return False
        return True

    def _take_as_stop(self, now: float) -> None:
        """Stop after a fault of the owner: what it did not take may have been one."""
        if now >= self._sound_at:  # it may fail at every event
            with contextlib.suppress(Exception):  # a log on a full disk
                traceback.print_exc()
        self._sound_at, self._pace_at = now + _FAULT_TIME, now + BACKOFF_START
        with contextlib.suppress(Exception):  # it fails at this, too
            self._judge(now)
            self._pace_at = self._owner.pace(now)

    def _wait_and_step(self) -> None:
        now = clock.now()
        if now >= self._start_due():
            self._start(now)
        if self._wire is None and self._spare is not None:
            self._take_over(self._spare)
        meant = self._wait(now)
        now = clock.now()
        if now - meant > _LATE:  # held up ourselves, as it may have been: it gets that time, too
            self._limit += now - meant
            self._kill_at += now - meant
        if self._spare is not None:
            self._look_at(self._spare)
        knows = self._read(now)
        with self._lock:
            self._keep()  # what was heard may be carried over
        if knows and now >= self._sound_at:
            self._be_sound(now)
        self._judge(now)
        self._refuse_unsent()
        if knows or self._trouble or self._verdict is None or self._verdict.estop:
            self._pace_at = self._owner.pace(now)
        else:  # what it repeats may not be so any more: silence, until the wire or _judge tells
            self._pace_at = now + SILENCE_LIMIT

    def _wait(self, now: float) -> float:
        """Sleep until something is due; return when this should be over."""
        moments = [self._pace_at, self._start_due()]
        descriptors = [self._wake_fd]
        descriptors += [each.socket.fileno() for each in (self._wire, self._spare) if each]
        if self._wire is not None:
            moments.append(self._kill_at if self._trouble else self._limit_now())
        if self._trouble:
            moments.append(self._report_at)
        timeout = max(0.0005, min(moments) - now)
        if self._wake_fd in ready(descriptors, timeout):
            os.eventfd_read(self._wake_fd)
        return now + timeout

    def _read(self, now: float) -> bool:
        """Take what the wire says; tell whether that is all, and of just now."""
        for _ in range(_READS):
            if self._wire is None:
                return False
            data = self._wire.receive()
            if data is None:
                return clock.now() <= self._said_at + SILENCE_LIMIT
            if not data:
                self._lost(self._wire, now)
                return False
            self._wire.ready = True
            heard_at = clock.now()  # later than now, if we are held up amid this
            self._limit, self._kill_at = heard_at + SILENCE_LIMIT, heard_at + _KILL_TIME
            name, arguments, self._said_at = pickle.loads(data)
            self._MESSAGES[name](self, *arguments)
        return False

    def _refuse_unsent(self) -> None:
        with self._lock:
            unsent, self._unsent = self._unsent, []
        for request, why in unsent:
            self._owner.on_refused(request.number, request.key, self._trouble or why)

    def _limit_now(self) -> float:
        with self._lock:
            closes = any(isinstance(each.what, Deactivate) for each in self._commands.values())
        return self._limit + _CLOSE_TIME * closes

    def _judge(self, now: float) -> None:
        if now < self._sound_at and not self._trouble:
            self._be_in_trouble('internal error, see the log', now)
        if self._wire is not None and not self._trouble and now >= self._limit_now():
            self._be_in_trouble(
                f'its process {self._wire.process.pid} hangs: nothing was heard of it for '
                f'{(now - self._limit + SILENCE_LIMIT) * 1e3:.0f} ms',
                now,
            )
        if self._wire is not None and now >= self._kill_at:
            self._wire.process.kill()
            self._kill_at = now + _KILL_TIME
        if self._trouble and now >= self._report_at:
            self._report_trouble(now)

    def _be_sound(self, now: float) -> None:
        """Tell the end of trouble or of a stop; not before, as another stop may be behind it."""
        ends = self._trouble or self._releases
        self._trouble, self._releases = '', False
        if ends and self._verdict is not None:
            self._owner.on_events([StopChanged(self._verdict)], now)

    def _be_in_trouble(self, text: str, now: float) -> None:
        self._said_at = 0.0  # before the end of this it has to say something more
        reason = f'the wire of {self.name} does not work, {text}'
        self._owner.link_changed(reason, False)
        self._trouble = reason  # not before it was told
        self._report_trouble(now)

    def _report_trouble(self, now: float) -> None:
        self._report_at = now + _REPORT_PERIOD
        status = Status(Level.ERROR, self._trouble, self._processes())
        self._owner.on_report(Report(status, Status(Level.ERROR, self._trouble, {})), now)

    def _processes(self) -> dict[str, Any]:
        pids = ['none' if each is None else each.process.pid for each in (self._wire, self._spare)]
        return {
            'wire process': pids[0],
            'spare process': pids[1],
            'wire restarts': max(0, self._restarts),
            'last wire': self._last_end,
        }

    # -- what a wire says -------------------------------------------------------------------------

    def _on_events(self, events: list[Any], now: float) -> None:
        told = []
        for event in events:
            if isinstance(event, StopChanged):
                self._verdict, self._releases = event.verdict, not event.verdict.estop
            if not (isinstance(event, StopChanged) and self._releases):
                told.append(event)
        self._owner.on_events(told, now)

    def _on_report(self, report: Report, now: float) -> None:
        values = {**report.link.values, **self._processes()}
        link = Status(report.link.level, report.link.message, values)
        self._owner.on_report(Report(link, report.device), now)

    def _on_refused(self, number: int, key: str, text: str) -> None:
        self._owner.on_refused(number, key, text)

    def _link_changed(self, text: str, ok: bool) -> None:
        if not ok:  # a stop to the owner, whatever the session says of it
            self._verdict, self._releases = Verdict.stop(text, link_up=False), False
        self._owner.link_changed(text, ok)

    def _on_done(self, number: int, error: str) -> None:
        """Take the end of a command, and of those before it: theirs found no room."""
        ended: dict[int, str] = {}
        with self._lock:
            if number in self._commands:  # in the order in which they were sent and are served
                ended = dict.fromkeys(takewhile(lambda each: each != number, self._commands), '')
            ended[number] = error
            for each, failure in ended.items():
                self._end_command(self._commands.pop(each, None), failure)
            self._keep()
        for each, failure in ended.items():
            self._done(each, failure)

    def _end_command(self, request: Request | None, error: str) -> None:
        newest = self._activation
        if request is None:
            pass
        elif isinstance(request.what, Deactivate):
            self._before = None
            if newest is not None and newest.number <= request.number:
                self._activation = None  # not before: the next one may have to say farewell
        elif not error:
            self._before = request
        elif request is newest:
            self._activation = self._before  # it goes on

    def _on_beat(self) -> None:
        """Nothing more than a sign of life."""

    _MESSAGES: dict[str, Callable[..., None]] = {
        'on_events': _on_events,
        'on_report': _on_report,
        'on_refused': _on_refused,
        'link_changed': _link_changed,
        'done': _on_done,
        'beat': _on_beat,
    }

    # -- the processes ----------------------------------------------------------------------------

    def _start_due(self) -> float:
        """Return when to start a process; a spare comes after the wire itself."""
        if self._wire is None and self._spare is None:
            return self._start_at
        if self._spare is None and self._wire is not None and self._wire.ready:
            return max(self._start_at, self._took_over_at + _SPARE_TIME)
        return math.inf

    def _start(self, now: float) -> None:
        """Start a spare; the next one not before a while."""
        self._start_at = now + self._backoff
        self._backoff = min(2 * self._backoff, self._reconnect_period)
        try:
            self._spare = self._new_process(now)
        except OSError as error:
            if self._wire is None:
                self._be_in_trouble(f'no process can be started: {error}', now)

    def _new_process(self, now: float) -> _Process:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        priority = self._rt_priority or -self._begins_ordinary
        before = self._open_wire()
        with theirs, contextlib.ExitStack() as last, contextlib.ExitStack() as undo:
            if before >= 0:
                last.callback(os.close, before)
            undo.callback(ours.close)
            kept = self._in_force.fileno()
            ours.setblocking(False)
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
            process = subprocess.Popen(
                [
                    f'{self.name}: wire {self.device}',
                    *('-S', '-m', _PROGRAM),
                    *(str(theirs.fileno()), self._bridge.module),
                    *(str(self._reconnect_period), str(priority), str(self._tap)),
                    *(str(kept), str(before)),
                ],
                executable=sys.executable,
                pass_fds=[theirs.fileno(), kept, *(n for n in (self._tap, before) if n >= 0)],
                stdin=subprocess.DEVNULL,
                env=environment(self._bridge.module),
                start_new_session=True,  # the terminal's signals are the node's business
            )
            undo.pop_all()
        return _Process(process, ours, now)

    def _open_wire(self) -> int:
        """Return a pidfd of the process that runs the wire; -1 where there is none."""
        with contextlib.suppress(OSError):  # a kernel without them
            if self._wire is not None:
                return os.pidfd_open(self._wire.process.pid)
        return -1

    def _look_at(self, spare: _Process) -> None:
        """Take its only word, that it is ready, or its end, which harms nothing."""
        word = spare.receive()
        if word:
            spare.ready = True
        elif word is not None:
            self._spare = None
            spare.end(0.0)

    def _take_over(self, spare: _Process) -> None:
        """Make it the wire: it is its turn."""
        self._spare, self._verdict, self._releases = None, None, False
        self._restarts += 1
        self._took_over_at = now = clock.now()  # the end of the one before may have taken a while
        self._limit = self._kill_at = spare.started_at + _START_TIME
        if spare.ready:
            self._limit, self._kill_at = now + SILENCE_LIMIT, now + _TAKE_OVER_TIME
        with self._lock:
            self._wire = spare
            with contextlib.suppress(OSError):  # it has just ended, as the reader finds
                spare.socket.send(TURN)
            for order in self._orders():
                self._send(order)

    def _informed(self, command: Request) -> Request:
        """Return it for a wire that takes over: it has to know what the one before has done."""
        if not isinstance(command.what, Activate):
            return command
        values, resting = command.what
        known = self._owner.carried_over(values)  # of its port, which may not be that of now
        return command._replace(what=Activate({**values, **known}, resting))

    def _lost(self, wire: _Process, now: float) -> None:
        """Wait for the end of a wire that has closed its socket; the next one comes after it."""
        with self._lock:
            self._wire = None
        wire.end(0.0 if wire.ready else _LAST_WORDS)  # the device may still be moving
        if now > self._took_over_at + _LONG_LIFE:
            self._backoff, self._start_at = BACKOFF_START, now
        if self._spare is not None:
            self._take_over(self._spare)  # first, for the same reason
        self._last_end = _cause(wire.process.returncode)
        self._be_in_trouble(f'its process {wire.process.pid} {self._last_end}', now)
        self._owner.on_lost()

    def _leave(self) -> None:
        with self._lock:
            wire, self._wire = self._wire, None
            moves = self._activation is not None or bool(self._commands)
        if wire is not None and moves and (wire.ready or self._restarts > 0):
            self._leave_safe(wire)
        elif wire is not None:
            wire.end(ANSWER_TIME / 2)
        with self._lock:
            self._activation = self._before = None
            self._commands.clear()
        if self._spare is not None:
            self._spare.end(0.0)

    def _leave_safe(self, wire: _Process) -> None:
        """
        Have the farewell said, if need be behind our own end.

        The device may be moving. What a process that loads, or gets no processor, has to do waits
        in its socket, and the end behind it: so it says the farewell, and ends. For one that does
        not end in time its spare does.
        """
        if not wire.ready:
            wire.socket.close()
        elif not wire.ends(ANSWER_TIME / 2) and (spare := self._spare) is not None:
            wire.end(0.0)
            self._take_over(spare)
            with self._lock:
                self._wire = None
            spare.socket.close()

    def _end(self) -> None:
        self._ended = True
        with self._lock:
            self._wake()

    def stop(self) -> None:
        """End the wire, farewell included; may be called twice. Raises nothing."""
        super().stop()
        with self._lock:
            if not self._thread.is_alive() and self._wake_fd >= 0:
                os.close(self._wake_fd)
                self._wake_fd = -1
                self._in_force.close()


def _cause(returncode: int) -> str:
    if returncode < 0:
        with contextlib.suppress(ValueError):  # a real-time signal has no name
            return f'was killed by {signal.Signals(-returncode).name}'
        return f'was killed by signal {-returncode}'
    return f'ended with {returncode}'


def environment(module: str) -> dict[str, str]:
    """
    Return the environment in which ``python -S -m`` finds what this process has imported.

    Without the module ``site`` it starts sooner and takes less memory. Its own name is no path
    that would lead it to its libraries.
    """
    roots = [
        str(Path(sys.modules[name].__file__ or '').parents[name.count('.')])
        for name in (__name__, module)
    ]
    path = [*roots, *(folder or os.getcwd() for folder in sys.path)]
    return {
        **os.environ,
        'PYTHONHOME': f'{sys.base_prefix}:{sys.base_exec_prefix}',
        'PYTHONPATH': os.pathsep.join(dict.fromkeys(path)),
        'PYTHONSAFEPATH': '1',  # from Python 3.11: nothing from where the node was started
    }
