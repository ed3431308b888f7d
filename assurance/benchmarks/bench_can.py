# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The Akron bridge's 20 ms slots, and its processor time, on a bus that is full of foreign frames.

``python -m assurance.benchmarks.bench_can [SECONDS [INTERFACE CHANNEL]]``: the node, another
that sends as many frames of 8 bytes as 250 kbit/s carry, and this one, which takes the kernel's
times of the joystick frames. Without INTERFACE it is python-can's ``udp_multicast``, whose load
costs more than SocketCAN's: every frame wakes every process, whatever its filters.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import itertools
import sys
import time
from typing import Any

import can

from assurance.benchmarks.rig import (
    Figures,
    figures,
    running,
    Size,
    spent_by,
    use_own_domain,
    USUAL,
)
from rugged_teleop.canbuses import free_channel, INTERFACE

JOYSTICK = 0x0CFDD638  # the bridge's own, by default
FRAMES_PER_S = 250_000 / 131  # bits of an extended frame with 8 bytes, without any stuffing
SLOT, LATE = 0.020, 0.020  # s
# Identifiers: what the bridge's filters refuse, and what they let through for it to judge.
LOADS = {
    'no load': (),
    'foreign frames': (0x0CF00400, 0x18FEEE00, 0x18F00503, 0x18FEF121),
    'foreign frames that pass the filters': (0x18EF0505, 0x18EFFF05, 0x18EEFF90, 0x0CEF9005),
}


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


def observe(bus: can.BusABC, node: int, seconds: float) -> Figures:
    """Return gaps between slots (s), those missed, and per cent of a core."""
    while (message := bus.recv(30.0)) is None or message.arbitration_id != JOYSTICK:
        if message is None:
            raise SystemExit('the bridge sends no joystick frames')
    slots, others, spent, begin = [message.timestamp], 0, spent_by(node).time, time.monotonic()
    while (elapsed := time.monotonic() - begin) < seconds:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == JOYSTICK:
            slots.append(message.timestamp)
        elif message is not None:
            others += 1
    share = 100.0 * (spent_by(node).time - spent) / elapsed
    gaps = [after - before for before, after in itertools.pairwise(slots)]
    missed = sum(gap > SLOT + LATE for gap in gaps)
    return {**figures(gaps), 'missed': missed, 'cpu': share, 'others/s': others / elapsed}


def observations(seconds: float, interface: str, channel: str) -> Iterator[tuple[str, Figures]]:
    """Yield a title and what was observed, under each load."""
    name = ('-p', f'interface:={interface}', '-p', f'channel:="{channel}"')
    quiet = ('--ros-args', '--log-level', 'fatal')
    with (
        open_bus(interface, channel) as bus,
        running('-m', 'akron_can_bridge.node', *quiet, *name) as node,
    ):
        for title, identifiers in LOADS.items():
            with contextlib.ExitStack() as stack:
                if identifiers:
                    words = map(str, identifiers)
                    arguments = ('load', interface, channel, *words)
                    stack.enter_context(
                        running('-m', 'assurance.benchmarks.bench_can', *arguments)
                    )
                time.sleep(1.0)  # what starts takes processor time that is not the bridge's
                while bus.recv(0):
                    pass
                yield title, observe(bus, node.pid, seconds)


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return what is observed under each load."""
    rows: dict[str, Figures] = {}
    for title, found in observations(size.seconds, INTERFACE, free_channel()):
        rest = {name: found.pop(name) for name in ('cpu', 'missed', 'others/s')}
        rows |= {f'CAN slots, {title}': found, f'CAN node, {title}': rest}
    return rows


def main(seconds: float, interface: str, channel: str) -> None:
    print(f'{"":38}others/s   slots  longest (ms)  missed    CPU')
    for title, found in observations(seconds, interface, channel):
        print(
            f'{title:38}{found["others/s"]:8.0f} {found["n"]:7} {1e3 * found["max"]:12.1f} '
            f'{found["missed"]:7} {found["cpu"]:6.1f} %',
            flush=True,
        )


if __name__ == '__main__':
    if sys.argv[1:2] == ['load']:
        with contextlib.suppress(KeyboardInterrupt):
            load(*sys.argv[2:])
    else:
        place = sys.argv[2:4] or [INTERFACE, free_channel()]
        use_own_domain()
        main(float((sys.argv[1:] or ['20'])[0]), *place)
