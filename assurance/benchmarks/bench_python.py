# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
