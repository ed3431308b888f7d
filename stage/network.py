# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a network does to messages, without one: it delays, loses, doubles and reorders them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
import heapq
import itertools
import json
import math
import os
import random
import subprocess
import sys
import time
from typing import Any, TypeVar

from stage.rig import ending_with, ROOT

_OTHER = 1500  # bytes of a packet of the other traffic

T = TypeVar('T')


@dataclass(frozen=True)
class Network:
    """
    What holds for one way, from when it is set.

    :param delay: s. :param creep: s by which that grows each second, up to ``most`` s.
    :param jitter: s at most, on top; what was sent first arrives first, unless ``reorders``.
    :param loss: a share from 0 to 1; with ``burst`` it comes in bursts of up to so many s.
    :param twice: share of messages that arrive twice.
    :param rate: bit/s, of a queue of ``queue`` bytes; 0: as fast as can be. :param other: bit/s of
        other traffic in that queue.
    :param stalls: nothing arrives, until a network is set that does not.
    """

    delay: float = 0.0
    creep: float = 0.0
    most: float = math.inf
    jitter: float = 0.0
    reorders: bool = False
    loss: float = 0.0
    burst: float = 0.0
    twice: float = 0.0
    rate: float = 0.0
    queue: int = 1_000_000
    other: float = 0.0
    stalls: bool = False

    def __str__(self) -> str:
        """Return what is not sound, for people."""
        return ', '.join(
            f'{name} {value:g}' for name, value in asdict(self).items() if value != _SOUND[name]
        )


_SOUND = asdict(Network())


class Way:
    """One way through a network. All moments are in s, of one clock."""

    def __init__(self, seed: int = 0) -> None:
        self._chance = random.Random(seed)
        self._count = itertools.count()
        self._carried: list[tuple[float, int, Any]] = []  # a heap: when it arrives, and what
        self._last = -math.inf  # arrival of the newest
        self._free_at = -math.inf  # when all of the queue is sent
        self.set(Network(), 0.0)

    def set(self, network: Network, now: float) -> None:
        """Let this hold for what is sent from now on."""
        self._network, self._since = network, now
        self._other_at = self._burst_end = now
        self._burst_begin = math.inf

    def send(self, item: Any, size: int, now: float) -> None:
        """Take a message of so many bytes."""
        network = self._network
        leaves = self._through_queue(size, now)
        if leaves is None or self._is_lost(now):
            return
        delay = min(network.most, network.delay + network.creep * (now - self._since))
        for _ in range(1 + (self._chance.random() < network.twice)):
            arrives = leaves + delay + self._chance.uniform(0.0, network.jitter)
            if not network.reorders:
                arrives = self._last = max(arrives, self._last)
            heapq.heappush(self._carried, (arrives, next(self._count), item))

    def arrived(self, now: float) -> list[Any]:
        """Return what has arrived since the last call, in its order."""
        found = []
        while self.next_arrival() <= now:
            found.append(heapq.heappop(self._carried)[2])
        return found

    def next_arrival(self) -> float:
        """Return when the next message arrives; infinite: none is on its way."""
        if self._network.stalls or not self._carried:
            return math.inf
        return self._carried[0][0]

    def _through_queue(self, size: int, now: float) -> float | None:
        """Return when it leaves the queue; None: there is no room for it."""
        network = self._network
        if not network.rate:
            return now
        while network.other and self._other_at < now:
            self._enqueue(_OTHER, self._other_at)
            self._other_at += 8 * _OTHER / network.other
        return self._enqueue(size, now)

    def _enqueue(self, size: int, now: float) -> float | None:
        begin = max(now, self._free_at)
        if (begin - now) * self._network.rate / 8 + size > self._network.queue:
            return None
        self._free_at = begin + 8 * size / self._network.rate
        return self._free_at

    def _is_lost(self, now: float) -> bool:
        network, chance = self._network, self._chance
        if not (network.loss and network.burst):
            return chance.random() < network.loss
        while now >= self._burst_end:
            pause = network.burst / 2 * (1 / network.loss - 1)
            self._burst_begin = self._burst_end + pause * chance.expovariate(1.0)
            self._burst_end = self._burst_begin + chance.uniform(0.0, network.burst)
        return now >= self._burst_begin


def obey(line: str | bytes, ways: Iterable[Way]) -> None:
    """Set the networks of a line that a ``NetworkProcess`` was told."""
    for way, given in zip(ways, json.loads(line), strict=True):
        way.set(Network(**given), time.monotonic())


class NetworkProcess:
    """
    A process that carries messages, each way through a network. A context manager.

    :param module: it obeys each line of its input. :param files: descriptors that it inherits.
    """

    def __init__(self, module: str, *words: str, files: Sequence[int] = ()) -> None:
        self._process = subprocess.Popen(
            [*ending_with(os.getpid()), sys.executable, '-m', module, *words],
            stdin=subprocess.PIPE,
            cwd=ROOT,
            text=True,
            bufsize=1,
            pass_fds=files,
            start_new_session=True,
        )

    def set(self, network: Network | None = None, back: Network | None = None) -> float:
        """
        Set what holds for all that comes from now on; return the moment.

        :param network: None: a sound one. :param back: of the way back; None: the same.
        """
        ways = [asdict(network or Network()), asdict(back or network or Network())]
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(ways) + '\n')
        return time.monotonic()

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()
