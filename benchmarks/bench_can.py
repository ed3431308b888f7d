"""
The Akron bridge's 20 ms slots, and its processor time, on a bus that is full of foreign frames.

``python -m benchmarks.bench_can [SECONDS [INTERFACE CHANNEL]]``: the node as a process, another
that sends as many frames of 8 bytes as 250 kbit/s carry, and this one, which takes the kernel's
times of the joystick frames. Without INTERFACE it is python-can's ``udp_multicast``, whose load
costs more than SocketCAN's: every frame wakes every process, whatever its filters.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import itertools
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

import can

from rugged_teleop.canbuses import free_channel
from rugged_teleop.canbuses import INTERFACE

ROOT = Path(__file__).parent.parent
JOYSTICK = 0x0CFDD638  # the bridge's own, by default
FRAMES_PER_S = 250_000 / 131  # bits of an extended frame with 8 bytes, without any stuffing
SLOT, LATE = 0.020, 0.020  # s
# Identifiers: what the bridge's filters refuse, and what they let through for it to judge.
LOADS = {
    'no load': (),
    'foreign frames': (0x0CF00400, 0x18FEEE00, 0x18F00503, 0x18FEF121),
    'foreign frames that pass the filters': (0x18EF0505, 0x18EFFF05, 0x18EEFF90, 0x0CEF9005),
}
_TICKS = os.sysconf('SC_CLK_TCK')


def open_bus(interface: str, channel: str) -> can.BusABC:
    options: dict[str, Any] = {'interface': interface, 'channel': channel}
    if interface == INTERFACE:
        group, port = channel.split(':')
        options.update(channel=group, port=int(port), hop_limit=0)
    return can.Bus(**options, ignore_config=True)


def load(interface: str, channel: str, *identifiers: str) -> None:
    """Fill the bus for ever."""
    frames = itertools.cycle(
        can.Message(arbitration_id=int(identifier), data=bytes(8)) for identifier in identifiers
    )
    with open_bus(interface, channel) as bus:
        begin = time.monotonic()
        for sent in itertools.count():
            time.sleep(max(0.0, begin + sent / FRAMES_PER_S - time.monotonic()))
            with contextlib.suppress(can.CanOperationError):  # as full as it can be
                bus.send(next(frames))


@contextlib.contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    child = subprocess.Popen([sys.executable, '-m', *arguments], cwd=ROOT)
    try:
        yield child
    finally:
        child.terminate()
        child.wait(10.0)


def processor_time(pid: int) -> float:
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def measure(bus: can.BusABC, node: int, seconds: float) -> str:
    """Return one row of the table."""
    while (message := bus.recv(30.0)) is None or message.arbitration_id != JOYSTICK:
        if message is None:
            raise SystemExit('the bridge sends no joystick frames')
    slots, others, spent, begin = [message.timestamp], 0, processor_time(node), time.monotonic()
    while (elapsed := time.monotonic() - begin) < seconds:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == JOYSTICK:
            slots.append(message.timestamp)
        elif message is not None:
            others += 1
    share = 100.0 * (processor_time(node) - spent) / elapsed
    gaps = [after - before for before, after in itertools.pairwise(slots)]
    missed = sum(gap > SLOT + LATE for gap in gaps)
    return (
        f'{others / elapsed:8.0f} {len(gaps):7} {1e3 * max(gaps):12.1f} {missed:7} {share:6.1f} %'
    )


def main(seconds: float, interface: str, channel: str) -> None:
    name = ('-p', f'interface:={interface}', '-p', f'channel:="{channel}"')
    print(f'{"":38}others/s   slots  longest (ms)  missed    CPU')
    with (
        open_bus(interface, channel) as bus,
        process('akron_can_bridge.node', '--ros-args', '--log-level', 'fatal', *name) as node,
    ):
        for title, identifiers in LOADS.items():
            with contextlib.ExitStack() as stack:
                if identifiers:
                    words = map(str, identifiers)
                    arguments = ('load', interface, channel, *words)
                    stack.enter_context(process('benchmarks.bench_can', *arguments))
                time.sleep(1.0)  # what starts takes processor time that is not the bridge's
                while bus.recv(0):
                    pass
                print(f'{title:38}{measure(bus, node.pid, seconds)}', flush=True)


if __name__ == '__main__':
    if sys.argv[1:2] == ['load']:
        with contextlib.suppress(KeyboardInterrupt):
            load(*sys.argv[2:])
    else:
        place = sys.argv[2:4] or [INTERFACE, free_channel()]
        main(float((sys.argv[1:] or ['20'])[0]), *place)
