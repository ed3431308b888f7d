# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The process that the wires of a node are forked from: they share the memory of what they load.

It is started as a wire is, has one thread and nothing of ROS, and does what forked.py asks: it
loads a module, or forks. It ends with its node. The parent of a fork ends at once, which makes
the node its parent: so nothing that happens to the template happens to a wire. A fork of the node
would copy the locks of the middleware. With six nodes in one process the wires and spares took
84 MB (PSS) as fresh Pythons; as forks they take 48.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import gc
import importlib
import os
import socket
import sys

from bridge_core.thread_name import show_thread

DONE = b'done'
LARGEST = 1 << 16  # bytes of a request
PLACES = (1, 4, 5, 6)  # of descriptors in the arguments of a wire; -1: none
_MOST = 8  # descriptors


def serve(descriptor: int) -> list[str]:
    """Do what is asked, to the end of the node; return in each fork, with its arguments."""
    show_thread('wire template')
    with contextlib.suppress(OSError), socket.socket(fileno=descriptor) as node:
        while True:
            data, given, _, _ = socket.recv_fds(node, LARGEST, _MOST)
            if not data:
                break
            name, *words = os.fsdecode(data).split('\0')
            if not given:
                _load(name, *words)
                node.send(DONE)
                continue
            with contextlib.suppress(OSError), socket.socket(fileno=given.pop(0)) as answer:
                if _forks(answer):
                    return _begin(name, words, given)
                for each in given:
                    os.close(each)
                answer.send(DONE)
    os._exit(0)


def _load(module: str, root: str) -> None:
    """Import what a wire needs; a fork says what cannot be imported."""
    if root not in sys.path:
        sys.path.append(root)
    with contextlib.suppress(Exception):
        for late in importlib.import_module(module).BRIDGE.loads:
            importlib.import_module(late)
    gc.collect()
    gc.freeze()


def _forks(answer: socket.socket) -> bool:
    """Fork a child of the node, which is told its pid, or -errno; tell whether this is it."""
    between, number = -1, 0
    try:
        between = os.fork()
        if between == 0:
            number = os.fork()
            if number == 0:
                return True
    except OSError as error:
        number = -(error.errno or 1)
    if between > 0:
        os.waitpid(between, 0)
    if number:
        with contextlib.suppress(OSError):  # the node gave up
            answer.send(str(number).encode())
    if between == 0:
        os._exit(0)
    return False


def _begin(title: str, arguments: Sequence[str], given: Sequence[int]) -> list[str]:
    """Be like a process that the node has started; return the arguments, with our numbers."""
    os.setsid()
    for number, each in zip((1, 2), given, strict=False):
        os.dup2(each, number)
        os.close(each)
    _show_title(title)
    numbers = iter(given[2:])
    return [
        str(next(numbers)) if place in PLACES and word != '-1' else word
        for place, word in enumerate(arguments)
    ]


def _show_title(title: str) -> None:
    """Have ``ps -o args`` show this, in the place of the template's arguments (proc(5), stat)."""
    with (
        contextlib.suppress(OSError),
        open('/proc/self/stat', encoding='ascii', errors='replace') as stat,
        open('/proc/self/mem', 'r+b', buffering=0) as memory,
    ):
        begin, end = map(int, stat.read().rpartition(')')[2].split()[45:47])
        memory.seek(begin)
        memory.write(os.fsencode(title)[: end - begin - 1].ljust(end - begin, b'\0'))
