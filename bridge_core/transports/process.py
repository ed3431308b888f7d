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

What follows from what is decided in supervisor.py. Here are processes, sockets and signals.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import pickle
import signal
import threading
import time
import traceback
from typing import Any, ClassVar

from bridge_core import clock
from bridge_core.reasons import Coded, passed_on
from bridge_core.report import Report, Status
from bridge_core.session import Level, StopChanged, Verdict
from bridge_core.supervisor import Orders, Stage, Supervisor, Times
from bridge_core.transports.child import Child
from bridge_core.transports.forked import TEMPLATE, Template
from bridge_core.transports.link import ANSWER_TIME, Link
from bridge_core.transports.request import Activate, Request
from bridge_core.transports.wire_process import ENDING, InForce, TURN
from bridge_core.waiting import FAULT_PAUSE, ready

_PROGRAM = 'bridge_core.start_wire'
_LATE = 0.005  # s
_LAST_WORDS = 0.2  # s to say why it cannot start, and end
_REPORT_PERIOD = 1.0  # s
_LARGEST = 1 << 16  # bytes of a request; any system has room for that
_NOTHING_TAKEN = 'its wire takes nothing'
_READS = 1024  # messages before the silence is judged again, and requests are refused


class ProcessLink(Link):
    """
    Keeps a process running that runs the wire, and a spare one.

    All that the owner is told, it is told by the thread that reads what the wire says. So an owner
    that hangs is silent, and nobody takes it for a healthy one.
    """

    TIMES: ClassVar = Times()

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._state = Supervisor(self.TIMES, self._reconnect_period)
        self._lock = threading.Lock()  # of the next four
        self._wire: Child | None = None
        self._orders = Orders()
        self._unsent: list[tuple[Request, str]] = []  # to be refused, and why
        self._in_force = InForce()  # what the wire has to be told, or ended for it
        self._spare: Child | None = None
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._ended = False
        # What this process becomes later, it becomes for another node in it.
        self._begins_ordinary = os.sched_getscheduler(0) == os.SCHED_OTHER
        self._template: Template | None = None
        self._coming: Child | None = None  # the next spare, which may not be there yet
        self._pace_at = self._report_at = 0.0
        self._last_end = 'none'

    # -- requests, from any thread ----------------------------------------------------------------

    def _put(self, request: Request, each: bool) -> bool:
        del each  # none replaces another: all are sent
        with self._lock:
            if request.is_command:
                self._orders.give(request)
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
            moves = self._orders.moves
        if moves:  # else there is no farewell to wait for, from a process that may just start
            super().deactivate()

    def _send(self, request: Request) -> str:
        """Send it, if that is possible; return why not."""
        if self._wire is None or not (self._state.has_loaded or request.is_command):
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

    def _to_tell(self) -> list[Request]:
        """Return the orders for a wire that takes over: it has to know what was done before it."""
        orders = self._orders.all()
        for n, order in enumerate(orders):
            if isinstance(order.what, Activate):
                values, resting = order.what
                known = self._owner.carried_over(values)  # of its port, maybe not that of now
                orders[n] = order._replace(what=Activate({**values, **known}, resting))
        return orders

    def _keep(self) -> None:
        """Keep that for the spare, which finds it there where node and wire die at once."""
        self._in_force.keep(self._to_tell())

    def _wake(self) -> None:
        if self._wake_fd >= 0:
            os.eventfd_write(self._wake_fd, 1)

    # -- the reader's thread ----------------------------------------------------------------------

    def _run(self) -> None:
        # A process inherits that, and may not be ended before it can ignore them: see load().
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        with TEMPLATE.used() as self._template:
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
            self._stop_for_fault(clock.now())
            return False
        return True

    def _stop_for_fault(self, now: float) -> None:
        """Stop after a fault of the owner: what it did not take may have been one."""
        if self._state.failed(now):  # it may fail at every event
            with contextlib.suppress(Exception):  # a log on a full disk
                traceback.print_exc()
        self._pace_at = now + self.TIMES.pause
        with contextlib.suppress(Exception):  # it fails at this, too
            self._judge(now)
            self._pace_at = self._owner.pace(now)

    def _wait_and_step(self) -> None:
        now = clock.now()
        if self._coming is not None or now >= self._state.start_due():
            self._start(now)
        if self._wire is None and self._spare is not None:
            self._give_turn(self._spare)
        meant = self._wait(now)
        now = clock.now()
        if now - meant > _LATE:  # held up ourselves, as it may have been: it gets that time, too
            self._state.held_up(now - meant)
        if self._spare is not None:
            self._hear_spare(self._spare)
        knows = self._read(now)
        with self._lock:
            self._keep()  # what was heard may be carried over
        if knows and (verdict := self._state.recovered(now)) is not None:
            self._owner.on_events([StopChanged(verdict)], now)
        self._judge(now)
        self._refuse_unsent()
        if self._state.may_publish(knows=knows):
            self._pace_at = self._owner.pace(now)
        else:  # what it repeats may not be so any more: silence, until the wire or _judge tells
            self._pace_at = now + self.TIMES.silence

    def _wait(self, now: float) -> float:
        """Sleep until something is due; return when this should be over."""
        moments = [self._pace_at, self._state.start_due()]
        if self._state.trouble:
            moments += [self._report_at, self._state.kill_at()]
        else:
            moments.append(self._hangs_at())
        ends = [each.fileno() for each in (self._wire, self._spare, self._coming) if each]
        timeout = max(0.0005, min(moments) - now)
        if self._wake_fd in ready([self._wake_fd, *ends], timeout):
            os.eventfd_read(self._wake_fd)
        return now + timeout

    def _read(self, now: float) -> bool:
        """Read what the wire says; tell whether that is all, and of just now."""
        for _ in range(_READS):
            if self._wire is None:
                return False
            data = self._wire.receive()
            if data is None:
                return self._state.is_news(clock.now())
            if not data:
                self._replace(self._wire, now)
                return False
            name, arguments, said_at = pickle.loads(data)
            self._state.heard(clock.now(), said_at)  # later than now, if held up amid this
            self._MESSAGES[name](self, *arguments)
        return False

    def _refuse_unsent(self) -> None:
        with self._lock:
            unsent, self._unsent = self._unsent, []
        for request, why in unsent:
            self._owner.on_refused(request.number, request.key, self._state.trouble or why)

    def _hangs_at(self) -> float:
        with self._lock:
            return self._state.hangs_at(closes=self._orders.closes)

    def _judge(self, now: float) -> None:
        if not self._state.trouble and not self._state.is_sound(now):
            self._be_in_trouble('internal error, see the log', now)
        if self._wire is not None and not self._state.trouble and now >= self._hangs_at():
            self._be_in_trouble(
                f'its process {self._wire.process.pid} hangs: nothing was heard of it for '
                f'{self._state.silence(now) * 1e3:.0f} ms',
                now,
            )
        if self._wire is not None and now >= self._state.kill_at():
            self._wire.process.kill()
            self._state.killed(now)
        if self._state.trouble and now >= self._report_at:
            self._report_trouble(now)

    def _be_in_trouble(self, text: str, now: float) -> None:
        self._state.doubt()
        reason = f'the wire of {self.name} does not work, {text}'
        self._owner.link_changed(Coded('wire.down', reason), False)
        self._state.trouble = reason  # not before it was told
        self._report_trouble(now)

    def _report_trouble(self, now: float) -> None:
        self._report_at = now + _REPORT_PERIOD
        trouble = passed_on(self._state.trouble, self._state.trouble, 'wire.down')
        status = Status(Level.ERROR, trouble, self._processes(), [trouble])
        self._owner.on_report(Report(status, status._replace(values={})), now)

    def _processes(self) -> dict[str, Any]:
        pids = ['none' if each is None else each.process.pid for each in (self._wire, self._spare)]
        return {
            'wire process': pids[0],
            'spare process': pids[1],
            'wire restarts': max(0, self._state.turns - 1),
            'last wire': self._last_end,
        }

    # -- what a wire says -------------------------------------------------------------------------

    def _on_events(self, events: list[Any], now: float) -> None:
        told = []
        for event in events:
            if isinstance(event, StopChanged):
                verdict = event.verdict
                self._state.said(verdict)
                if not verdict.estop:
                    continue  # a stop may be behind it: see Supervisor.recovered
                if self._state.trouble:  # one of less than all, as of one axis, ends none of that
                    event = StopChanged(Verdict.stop(*verdict.reasons, link_up=verdict.link_up))
            told.append(event)
        self._owner.on_events(told, now)

    def _on_report(self, report: Report, now: float) -> None:
        values = {**report.link.values, **self._processes()}
        self._owner.on_report(Report(report.link._replace(values=values), report.device), now)

    def _link_changed(self, text: str, ok: bool) -> None:
        if not ok:  # a stop to the owner, whatever the session says of it
            reason = passed_on(text, text, 'port.closed')
            self._state.said(Verdict.stop(reason, link_up=False))
        self._owner.link_changed(text, ok)

    def _on_done(self, number: int, error: str) -> None:
        with self._lock:
            ended = self._orders.ended(number, error)
            self._keep()
        for each, failure in ended.items():
            self._done(each, failure)

    _MESSAGES: dict[str, Callable[..., None]] = {
        'on_events': _on_events,
        'on_report': _on_report,
        'on_refused': lambda self, *told: self._owner.on_refused(*told),
        'link_changed': _link_changed,
        'done': _on_done,
        'beat': lambda self: None,  # no more than a sign of life
    }

    # -- the processes ----------------------------------------------------------------------------

    def _start(self, now: float) -> None:
        try:
            spare = self._next_process()
        except OSError as error:
            self._state.trying(now)
            if self._wire is None:
                self._be_in_trouble(f'no process can be started: {error}', now)
            return
        if spare is None:
            self._state.not_yet(now)
            return
        self._state.trying(now)
        self._spare = spare
        self._state.started(now)

    def _next_process(self) -> Child | None:
        """Return the next process; None: it does not load or fork yet, which is worth a wait."""
        template = self._template
        of = _PROGRAM, self._bridge.module, -self._begins_ordinary
        if self._coming is None and template is not None and template.loads(*of):
            if self._wire is not None or not self._state.turns:
                return None
            template = None  # the device may be moving, and nobody else would say the farewell
        coming, self._coming = self._coming or self._new_process(template), None
        try:
            if not coming.is_known():
                self._coming = coming
                return None
        except TimeoutError:
            coming.drop()
            assert template is not None
            template.end()
            coming = self._new_process(None)
            coming.is_known()
        except OSError:
            coming.drop()
            raise
        return coming

    def _new_process(self, template: Template | None) -> Child:
        before = -1 if self._wire is None else self._wire.pidfd()
        try:
            return Child.start(
                f'{self.name}: wire {self.device}',
                _PROGRAM,
                self._bridge.module,
                self._rt_priority or -self._begins_ordinary,
                self._reconnect_period,
                [self._tap, self._in_force.fileno(), before],
                template,
            )
        finally:
            if before >= 0:
                os.close(before)

    def _hear_spare(self, spare: Child) -> None:
        """Hear its only word, that it is ready, or its end, which harms nothing."""
        word = spare.receive()
        if word:
            self._state.spare = Stage.READY
        elif word is not None:
            self._spare = None
            self._state.spare = Stage.NONE  # which harms nothing
            spare.end(0.0)

    def _give_turn(self, spare: Child) -> None:
        """Have it run the wire."""
        self._spare = None
        with self._lock:
            self._wire = spare
            self._state.turned(clock.now())  # the end of the one before may have taken a while
            with contextlib.suppress(OSError):  # it has just ended, as the reader finds
                spare.socket.send(TURN)
            for order in self._to_tell():
                self._send(order)

    def _replace(self, wire: Child, now: float) -> None:
        """Wait for the end of a wire that has closed its socket; the next one comes after it."""
        loads = self._state.wire is Stage.LOADING
        with self._lock:
            self._wire = None
            self._state.wire_ended(now)
        wire.end(_LAST_WORDS if loads else 0.0)  # the device may still be moving
        if self._spare is not None:
            self._give_turn(self._spare)  # first, for the same reason
        self._last_end = wire.cause()
        self._be_in_trouble(f'its process {wire.process.pid} {self._last_end}', now)
        self._owner.on_lost()

    def _leave(self) -> None:
        with self._lock:
            wire, self._wire = self._wire, None
            moves = self._orders.moves
        if wire is not None and moves and (self._state.has_loaded or self._state.turns > 1):
            self._leave_safe(wire)
        elif wire is not None:
            wire.end(ANSWER_TIME / 2)
        with self._lock:
            self._orders.forget()
        if self._spare is not None:
            self._spare.end(0.0)
        if self._coming is not None:
            self._coming.drop()

    def _leave_safe(self, wire: Child) -> None:
        """
        Have the farewell said, if need be behind our own end.

        The device may be moving. Commands queue in the socket of a process that loads, or gets no
        processor, and the end behind them: it says the farewell once it runs, and ends. For one
        that does not end in time its spare does.
        """
        if not self._state.has_loaded:
            wire.socket.close()
        elif not wire.ends(ANSWER_TIME / 2) and (spare := self._spare) is not None:
            wire.end(0.0)
            self._give_turn(spare)
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
