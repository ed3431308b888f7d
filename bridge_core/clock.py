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

"""
The one clock by which anything here is late, stale or due.

CLOCK_MONOTONIC stands still while the computer sleeps: what was heard before would still be fresh
when it wakes up. CLOCK_BOOTTIME goes on. It never steps, and all processes of a computer share it,
so that they can tell each other moments.
"""

import time

_CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)  # the latter where it is not Linux


def now() -> float:
    """Return the seconds since some moment in the past, sleep of the computer included."""
    return time.clock_gettime(_CLOCK)
