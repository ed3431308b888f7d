# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Wires that are forked: they are like those that are started, and need their template no more."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import errno
import importlib
import os
from pathlib import Path
import signal
import socket
import time
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.transports import forked, template
from bridge_core.transports.child import Child
from bridge_core.transports.forked import Forked, Template
from bridge_core.transports.template import DONE
from stage.link_rig import FakeOwner
from stage.process_rig import FakeProcess
from stage.rig import Pty, wait_for
from stage.toy_links import Direct
from stage.toy_rig import is_running, name_of, spares_of, wires_of

PROGRAM, TOY = 'bridge_core.start_wire', 'stage.toy_wire'


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a busy machine fork in time."""
    monkeypatch.setattr(forked, '_FORK_TIME', 20.0)


@pytest.fixture
def forks() -> Iterator[Template]:
    made = Template()
    with made.used():
        yield made
    assert made._process is None


def started(module: str, by: Template | None, priority: int = -1) -> Child:
    """Start a process, as a link does, which has loaded all or ended."""
    if by is not None:
        wait_for(lambda: not by.loads(PROGRAM, module, -1), 60.0, 'a template that has loaded')
    made = Child.start('link: wire port', PROGRAM, module, priority, 1.0, [-1, -1, -1], by)
    assert isinstance(made.process, Forked) == (by is not None)
    wait_for(made.is_known, 20.0, 'its pid')
    made.word = wait_for(lambda: made.receive() is not None, 20.0, 'its first word')  # type: ignore[attr-defined]
    return made


def facts(pid: int) -> dict[str, Any]:
    """Return what a process has of whoever started it."""
    folder = Path(f'/proc/{pid}')
    status = dict(line.split(':\t', 1) for line in (folder / 'status').read_text().splitlines())
    files = [os.readlink(each) for each in (folder / 'fd').iterdir()]
    return {
        **{name: status[name] for name in ('SigIgn', 'SigBlk', 'SigCgt', 'PPid', 'Threads')},
        'locked': status['VmLck'].split()[0] != '0',
        'scheduler': os.sched_getscheduler(pid),
        'session': os.getsid(pid) == os.getpgid(pid) == pid,
        'files': sorted(each.partition('[')[0] for each in files),
        'name': name_of(pid),
        'title': (folder / 'cmdline').read_bytes().split(b'\0')[0],
        'folder': os.readlink(folder / 'cwd'),
        'environment': (folder / 'environ').read_bytes(),
        'ROS': 'rcl' in (folder / 'maps').read_text(),
    }


@pytest.mark.parametrize('priority', [-1, 1])
def test_fork_is_like_a_process_that_the_node_has_started(forks: Template, priority: int) -> None:
    """Files, signals, session, priority, locked memory, parent: of the template it has nothing."""
    found = []
    for by in (forks, None):
        made = started(TOY, by, priority)
        wait_for(lambda pid=made.process.pid: name_of(pid) == 'spare wire', 20.0, 'its name')  # type: ignore[misc]
        found.append(facts(made.process.pid))
        made.end(0.0)
        assert made.cause() == 'was killed by SIGKILL'
        assert made.process.wait() == -signal.SIGKILL
        made.process.kill()  # which has ended
    assert found[0] == found[1]
    assert found[0]['PPid'] == str(os.getpid())
    assert not found[0]['ROS']


SOURCE = """
import os
import random
from types import SimpleNamespace
TEMPLATE = os.getpid()

class Bridge:
    @property
    def loads(self):
        if os.getpid() != TEMPLATE:
            print(random.random(), flush=True)
        raise ImportError('it fails')

BRIDGE = Bridge()
"""


def test_forks_are_told_apart_by_chance_and_say_why_they_fail(
    forks: Template,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Where the node says it, now and not as the template began."""
    with capfd.disabled():
        started(TOY, forks).end(0.0)
    (tmp_path / 'lost').mkdir()
    (tmp_path / 'lost' / 'wire.py').write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module('lost.wire')
    monkeypatch.setattr('sys.path', [])  # it was found by a hook, as what is installed editable
    capfd.readouterr()
    for _ in range(2):
        made = started('lost.wire', forks)
        made.end(10.0)
        assert made.cause() == 'ended with 1'
    said = capfd.readouterr()
    assert len({*said.out.split()}) == 2
    assert said.err.count('the process of a wire cannot start: lost.wire: ImportError') == 2


# -- a template that fails ------------------------------------------------------------------------


@pytest.fixture
def direct(pty: Pty) -> Iterator[Direct]:
    with contextlib.closing(Direct(pty)) as result:
        result.activate()
        yield result


def template_of(direct: Direct) -> int:
    """Return it by its link: a fork that is new still has its name."""

    def found() -> int:
        made = direct.link._template and direct.link._template._process
        return made.pid if made else 0

    return int(wait_for(found, 20.0, 'a template'))


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP])
def test_wires_go_on_without_their_template_and_the_next_ones_come(
    direct: Direct, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forked, '_FORK_TIME', 1.0)
    served = template_of(direct)
    spare = direct.spare()
    wire = direct.wire()
    os.kill(served, number)
    del direct.owner.told[:-1]
    wait_for(lambda: direct.is_healthy() and len(direct.owner.told) > 20, 20.0, 'that it goes on')
    for ended in (wire, spare):
        assert direct.wire() == ended
        os.kill(ended, signal.SIGKILL)
        wait_for(lambda of=ended: wires_of(os.getpid()) not in ([], [of]), 20.0, 'the next one')  # type: ignore[misc]
        wait_for(direct.is_healthy, 20.0, 'a healthy one')
        assert f'its process {ended} was killed by SIGKILL' in ' '.join(direct.owner.log)
    wait_for(lambda: not is_running(served), 20.0, 'the end of the template')
    wait_for(lambda: spares_of(os.getpid()), 20.0, 'a spare of another template')
    assert template_of(direct) != served


def test_nobody_waits_for_a_template_that_loads_once_a_wire_has_died(
    direct: Direct, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The device may be moving: there has to be one that says the farewell if the node ends."""
    spare, wire = direct.spare(), direct.wire()
    monkeypatch.setattr(direct.link._template, 'loads', lambda *_: True)
    for ended in (spare, wire):
        os.kill(ended, signal.SIGKILL)
    wait_for(lambda: wires_of(os.getpid()) not in ([], [wire]), 20.0, 'the next one')
    wait_for(direct.is_healthy, 20.0, 'a healthy one')
    assert direct.link._wire is not None
    assert not isinstance(direct.link._wire.process, Forked)


def test_link_leaves_though_its_template_hangs(direct: Direct) -> None:
    """A fork that comes too late for anybody to know it ends by itself, and says nothing."""
    spare = direct.spare()
    served = template_of(direct)
    os.kill(served, signal.SIGSTOP)
    os.kill(spare, signal.SIGKILL)
    wait_for(lambda: direct.link._coming, 20.0, 'the next one that is asked for')
    direct.pty.clear()
    direct.close()
    direct.pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(served), 20.0, 'the end of the template')
    assert direct.pty.received.count(b'BYE') == 1


class Asked:
    """A template that the test answers for."""

    def __init__(self) -> None:
        self.template = Template()
        self.process = FakeProcess()
        self.theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.template._process = self.process  # type: ignore[assignment]
        self.template._socket = ours

    def loads(self) -> bool:
        return self.template.loads(PROGRAM, TOY, -1)

    def fork(self, *answers: bytes) -> Forked:
        """Ask for one; give these answers, of which an empty one is the end."""
        made = self.template.fork('title', ['-1'], [])
        assert made is not None
        request, given, _, _ = socket.recv_fds(self.theirs, 1000, 8)
        assert request == b'title\0-1'
        for each in given[1:]:
            os.close(each)
        self.answer = socket.socket(fileno=given[0])
        for answer in answers:
            if answer:
                self.answer.send(answer)
            else:
                self.answer.close()
        return made


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Iterator[Asked]:
    result = Asked()
    monkeypatch.setattr(result.template, '_start', lambda *_: None)
    yield result
    result.template.end()
    result.theirs.close()


REFUSED = str(-errno.EAGAIN).encode()


@pytest.mark.parametrize(
    ('answers', 'late', 'error'),
    [
        ([], True, TimeoutError),
        ([b'1'], True, TimeoutError),
        ([b''], False, TimeoutError),
        ([b'1', b''], False, TimeoutError),
        ([DONE], False, TimeoutError),
        ([REFUSED], False, BlockingIOError),
        ([REFUSED, DONE], True, BlockingIOError),
        ([], False, None),
        ([b'1'], False, None),
    ],
)
def test_fork_is_waited_for_unless_it_fails(
    asked: Asked,
    monkeypatch: pytest.MonkeyPatch,
    answers: list[bytes],
    late: bool,
    error: type[OSError] | None,
) -> None:
    """What the system refuses is told in its words, and anything else is for another start."""
    now = clock.now()
    monkeypatch.setattr(clock, 'now', lambda: now)
    made = asked.fork(*answers)
    now += 20.1 if late else 19.9
    if error is None:
        assert not made.is_known()
    else:
        with pytest.raises(error, match='unavailable' if error is BlockingIOError else None):
            made.is_known()
    for each in (asked.answer, made.answer):
        each.close()


def test_fork_of_a_template_that_has_ended_is_none(asked: Asked) -> None:
    asked.theirs.close()
    for _ in range(2):
        assert asked.template.fork('title', [], []) is None
    assert (asked.process.kills, asked.process.waited) == (1, [None])


@pytest.mark.parametrize('refused', [1, 2])
def test_template_says_what_fork_is_refused(monkeypatch: pytest.MonkeyPatch, refused: int) -> None:
    """The first is that of the template, the second that of the process between."""
    forks = iter([0, None] if refused == 2 else [None])
    ends: list[int] = []

    def fork() -> int:
        if (result := next(forks)) is None:
            raise BlockingIOError(errno.EAGAIN, 'too many')
        return result

    monkeypatch.setattr(os, 'fork', fork)
    monkeypatch.setattr(os, '_exit', ends.append)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        assert not template._forks(theirs)
        assert ours.recv(100) == REFUSED
    assert ends == [0] * (refused - 1)


@pytest.mark.parametrize('what', ['loads too long', 'ends', 'says something else'])
def test_start_waits_for_a_template_that_loads_and_for_no_other(
    asked: Asked, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    now = clock.now()
    monkeypatch.setattr(clock, 'now', lambda: now)
    assert asked.loads()
    assert asked.theirs.recv(1000).startswith(f'{TOY}\0'.encode())
    now += 24.9
    assert asked.loads()
    if what == 'ends':
        asked.theirs.close()
    elif what == 'says something else':
        asked.theirs.send(b'?')
    now += 0.2
    assert not asked.loads()
    assert asked.process.kills == 1


def test_system_that_knows_no_pidfd_has_no_template(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(pid: int) -> int:
        raise OSError(errno.ENOSYS, 'not implemented')

    monkeypatch.setattr(os, 'pidfd_open', refuse)
    made = Template()
    assert not made.loads(PROGRAM, TOY, -1)
    assert made.fork('title', [], []) is None


def test_link_that_waits_for_a_fork_publishes(pty: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = time.monotonic() + 0.5
    forks = forked.TEMPLATE
    monkeypatch.setattr(Template, 'loads', lambda *_: time.monotonic() < ended)
    monkeypatch.setattr(forks, 'fork', lambda *_: None)
    with contextlib.closing(Direct(pty)) as direct:
        owner: FakeOwner = direct.owner
        wait_for(lambda: len(owner.told) > 5, 20.0, 'words of the node')
        assert all(owner.told)
        direct.activate()
        assert time.monotonic() > ended
