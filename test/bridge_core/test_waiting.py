# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Descriptors above 1023, those that a process inherits, and loops whose wait fails."""

import errno
import fcntl
import os
import subprocess
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core import waiting
from bridge_core.transports import process, wire
from bridge_core.transports.process import ProcessLink
from stage.link_rig import FakeOwner
from stage.rig import ROOT, run_python, TIMEOUT_FACTOR
from stage.toy_wire import BRIDGE
from stage.wire_rig import WireBench

_HIGH = 1100
_PRODUCT = ('*_bridge', 'bridge_core', 'rugged_teleop', 'safety_mux')


def test_descriptor_above_1023_is_waited_for() -> None:
    read, write = os.pipe()
    high = fcntl.fcntl(read, fcntl.F_DUPFD_CLOEXEC, _HIGH)
    try:
        assert waiting.ready([high, read], 0.0) == []
        os.write(write, b'x')
        assert waiting.ready([high], None) == [high]
        assert waiting.writable(write, 0.0)
    finally:
        for each in (read, write, high):
            os.close(each)
    with pytest.raises(OSError, match=os.strerror(errno.EBADF)):
        waiting.ready([high], 0.0)


def test_nothing_of_the_product_waits_by_select() -> None:
    files = [file for name in _PRODUCT for file in ROOT.glob(f'{name}/**/*.py')]
    assert len(files) > 100
    found = [file.name for file in files if 'select.select(' in file.read_text()]
    assert not found


_AS_FROM_SYSTEMD = """
import os, sys
from bridge_core.descriptors import close_inherited_descriptors
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS=sys.argv[1])
close_inherited_descriptors([])
print(*(number for number in range(3, 64) if os.path.exists(f'/proc/self/fd/{number}')))
"""


@pytest.mark.parametrize(('count', 'left'), [('2', {3, 4}), ('none', set())])
def test_sockets_of_systemd_stay_open_unless_their_count_is_none(
    count: str, left: set[int]
) -> None:
    def three_files() -> None:
        for number in (3, 4, 5):
            os.dup2(1, number, inheritable=True)

    inherits: dict[str, Any] = {'close_fds': False, 'preexec_fn': three_files, 'check': True}
    found = run_python('-c', _AS_FROM_SYSTEMD, count, stdout=subprocess.PIPE, **inherits)
    assert {int(each) for each in found.stdout.split()} - {0, 1, 2} == left


def fails_to_wait(*_: Any) -> list[int]:
    raise OSError(errno.EBADF, 'no wait')


def test_wire_whose_wait_fails_pauses_and_says_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, pauses = WireBench(monkeypatch), []

    def sleep(seconds: float) -> None:
        pauses.append(seconds)
        bench.wire._quit = len(pauses) == 3

    bench.expects_fault = True
    bench.run()
    monkeypatch.setattr(wire, 'ready', fails_to_wait)
    monkeypatch.setattr(wire, 'time', SimpleNamespace(sleep=sleep))
    bench.wire.run()
    assert pauses == [waiting.FAULT_PAUSE] * 3
    assert 'stop True' in bench.log()


def test_link_whose_wait_fails_each_time_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    link, pauses = ProcessLink('link', BRIDGE, FakeOwner()), []

    def sleep(seconds: float) -> None:
        pauses.append(seconds)
        link._ended = len(pauses) == 3

    monkeypatch.setattr(process, 'ready', fails_to_wait)
    monkeypatch.setattr(process, 'time', SimpleNamespace(sleep=sleep))
    monkeypatch.setattr(link, '_start', lambda now: None)
    thread = threading.Thread(target=link._run)  # it blocks signals
    thread.start()
    thread.join(10.0 * TIMEOUT_FACTOR)
    assert pauses == [waiting.FAULT_PAUSE] * 3
