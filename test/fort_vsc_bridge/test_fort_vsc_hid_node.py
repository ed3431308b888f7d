# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's node does on a hidraw device alone: it looks who the device is."""

from __future__ import annotations

import os
from pathlib import Path

from stage.fort_vsc_nodes import NodeBench
from stage.node_bench import LINK
from stage.rig import Observer, wait_for

# Sticks all out, pad up and right, buttons 1 and 4, Operational; the last byte is the e-stop.
ALL_OUT = bytes.fromhex('7F7F7F818181910900')
FOREIGN = {  # 9 bytes each, of HID devices that are no VSC
    'keyboard, idle': '010000000000000000',
    'keyboard, five keys held': '010000040506070900',
    'joystick, slider at its end': '00000F002000200900',
}


def on_fifo(path: Path, observer: Observer, **parameters: object) -> NodeBench:
    os.mkfifo(path)
    where = {'transport': 'hid', 'port': str(path), **parameters}
    return NodeBench(None, where, observer)


def test_fifo_stands_in_for_a_device(tmp_path: Path, observer: Observer) -> None:
    path = tmp_path / 'hidraw'
    bench = on_fifo(path, observer, **{'hid.devices': ['none']})
    try:
        bench.node.wait_output('opened')
        bench.wait_says(bench.estop, True)
        writer = os.open(path, os.O_WRONLY)

        def report(_: float) -> None:
            os.write(writer, ALL_OUT)
            observer.spin(0.03)

        def moved() -> bool:
            return bench.says(bench.estop, False) and any(bench.axes())

        wait_for(moved, 15.0, 'no stop, and sticks', idle=report)
        os.close(writer)
        bench.wait_says(bench.estop, True)
        bench.wait_neutral()
    finally:
        bench.close()


def test_reports_of_a_device_that_is_not_known_for_a_vsc_never_clear_the_stop(
    tmp_path: Path, observer: Observer
) -> None:
    path = tmp_path / 'hidraw'
    bench = on_fifo(path, observer)
    writer = os.open(path, os.O_RDWR)
    try:
        bench.wait_says(bench.estop, True)
        bench.wait(lambda: 'no vendor and product' in bench.told(LINK), 'the refusal')
        for report in FOREIGN.values():
            for _ in range(20):
                os.write(writer, bytes.fromhex(report))
                observer.spin(0.03)
        assert False not in [message.data for message in bench.estop.messages]
        assert 'hid.devices' in bench.told(LINK)
    finally:
        os.close(writer)
        bench.close()
