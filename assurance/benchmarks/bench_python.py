# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the interpreter itself takes, as the anchor of what runs in one thread."""

import struct
import timeit

NAME = 'Python: three fields unpacked into a dict'
_FIELDS = struct.Struct('<HhB')
_DATA = bytes(range(5))


def unpack() -> dict[str, int]:
    speed, current, flags = _FIELDS.unpack(_DATA)
    return {'speed': speed, 'current': current, 'flags': flags}


def measure() -> dict[str, float]:
    """Return the seconds of one."""
    number = 20_000
    return {NAME: min(timeit.repeat(unpack, number=number, repeat=10)) / number}


if __name__ == '__main__':
    print(f'{NAME}: {1e6 * measure()[NAME]:.3f} µs')
