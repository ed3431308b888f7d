# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A drive in motion is disabled whatever becomes of its node and of the process of its wire."""

from collections.abc import Iterator
import os
from pathlib import Path
from signal import SIGHUP, SIGKILL, SIGSEGV, SIGSTOP
import time

import pytest

from stage.rig import Observer
from stage.toy_rig import is_running, name_of, spares_of, wires_of
from test.esi_drive_bridge.test_esi_drive_node import Bench as DriveBench

pytestmark = pytest.mark.waits(80)


@pytest.fixture
def drive(tmp_path: Path, observer: Observer) -> Iterator[DriveBench]:
    bench = DriveBench(tmp_path, observer, patient=False)
    bench.quiet()
    bench.enabling()
    yield bench
    bench.close()


def disabled_for_good(drive: DriveBench, cause: float) -> None:
    drive.wait(lambda: drive.drive.first_disable(cause), 'a disable packet')
    first = drive.drive.first_disable(cause)
    assert first is not None
    drive.holds(lambda: not any(p.enables for p in drive.drive.packets(first.time)), 0.3)


@pytest.mark.parametrize('number', [SIGKILL, SIGSEGV, SIGHUP, SIGSTOP])
def test_drive_is_disabled_whatever_becomes_of_its_node(drive: DriveBench, number: int) -> None:
    wire, cause = wires_of(drive.node.process.pid)[0], time.monotonic()
    drive.node.signal(number)
    disabled_for_good(drive, cause)
    if number == SIGSTOP:  # disabled, not silent
        since = time.monotonic()
        drive.wait(lambda: len(drive.drive.packets(since)) > 20, 'packets')
    else:
        drive.wait(lambda: not is_running(wire), 'the end of the wire')


def test_drive_is_disabled_though_node_and_wire_die_at_once(drive: DriveBench) -> None:
    node = drive.node.process.pid
    [wire] = wires_of(node)
    drive.wait(lambda: [p for p in spares_of(node) if name_of(p) == 'spare wire'], 'a spare')
    cause = time.monotonic()
    for pid in (node, wire):
        os.kill(pid, SIGKILL)
    disabled_for_good(drive, cause)


@pytest.mark.parametrize('number', [SIGKILL, SIGSTOP])
def test_drive_whose_wire_dies_or_hangs_is_disabled_by_a_new_one(
    drive: DriveBench, number: int
) -> None:
    wire, cause = wires_of(drive.node.process.pid)[0], time.monotonic()
    os.kill(wire, number)
    drive.wait(lambda: any(m.data for _, m in drive.estop.since(cause)), 'a stop')
    drive.wait(lambda: not drive.enabled.last.data, '~/enabled to be false')
    disabled_for_good(drive, cause)
    drive.wait(lambda: not drive.estop.last.data, 'a healthy drive')
    drive.quiet()
    drive.enabling()
