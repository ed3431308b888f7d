# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording read whole, for the commands that look at all of it at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from rugged_teleop.command_line import is_of_output, reason_of

if TYPE_CHECKING:
    from rugged_teleop.recordings import Said

_MAGIC = b'\x89MCAP0\r\n'
# How files of packing programs begin, and what unpacks them.
_PACKED = {
    b'\x1f\x8b': 'zcat',
    b'\x28\xb5\x2f\xfd': 'zstdcat',
    b'\xfd7zXZ\0': 'xzcat',
    b'\x04\x22\x4d\x18': 'lz4cat',
    b'BZh': 'bzcat',
    b'PK\3\4': 'unzip -p',
}


@dataclass(frozen=True, slots=True)
class Loaded:
    """
    What a recording has.

    :param said: its messages, in the order of time. :param parameters: of its nodes, by full name.
    :param cut: why it is not read to its end; empty: it is.
    :param damaged: how many messages cannot be read, by topic.
    """

    said: list[Said]
    parameters: dict[str, dict[str, Any]]
    cut: str
    damaged: Mapping[str, int] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """All of it was read."""
        return not (self.cut or self.damaged)


def check_unpacked(head: bytes) -> None:
    """:raises ValueError: so begins a file of a packing program; it says what unpacks it."""
    for beginning, program in _PACKED.items():
        if head.startswith(beginning):
            raise ValueError(f'is compressed: unpack it first, with {program}')


def load(path: Path) -> Loaded:
    """
    Read a recording, one that was cut short as far as it goes.

    :raises OSError: the file cannot be read. :raises ValueError: it is no recording.
    :raises ImportError: a package is missing; it says what to install.
    """
    try:
        from rugged_teleop import recordings  # late: they are an extra
    except ImportError as error:
        needed = 'pip install mcap mcap-ros2-support'
        raise ImportError(f'reading it needs {needed} ({error})') from error
    said: list[Said] = []
    parameters: dict[str, dict[str, Any]] = {}
    cut = ''
    damaged: Counter[str] = Counter()
    with path.open('rb') as file:
        head = file.peek(len(_MAGIC))[: len(_MAGIC)]
        check_unpacked(head)
        if head != _MAGIC:
            raise ValueError('is no MCAP file')
        for each in recordings.read(file):
            if isinstance(each, recordings.Said):
                said.append(each)
                damaged[each.topic] += each.message is None and not each.foreign
            elif isinstance(each, recordings.Parameters):
                parameters[each.node] = each.values
            else:
                cut = each.reason
    return Loaded(sorted(said, key=lambda each: each.at), parameters, cut, +damaged)


def look_at(files: Sequence[Path], look: Callable[[Loaded], int], prog: str) -> int:
    """
    Look at recordings, and return the greatest status; 2 where one cannot be read.

    :param look: prints what it finds and returns a status. :raises ValueError: it cannot.
    :param prog: the command's name, before errors.
    """
    status = 0
    for path in files:
        if len(files) > 1:
            print(f'{path}:')
        try:
            recording = load(path)
            status = max(status, look(recording))
        except (OSError, ValueError, ImportError) as error:
            if is_of_output(error):
                raise
            print(f'{prog}: {path}: {reason_of(error)}', file=sys.stderr)
            status = 2
        else:
            for topic, count in recording.damaged.items():
                text = f'{count} messages of {topic}'
                print(f'# left out, as they are damaged: {text}', file=sys.stderr)
            if recording.cut:
                print(f'# it is read up to here only: {recording.cut}', file=sys.stderr)
    return status
