# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names of threads for ``top -H`` and ``ps -L``, which Python gives the kernel from 3.14 on."""

from contextlib import suppress

_LONGEST = 15  # bytes, proc(5)


def show_thread(name: str) -> None:
    """Have the kernel show this thread under a name, of which it keeps 15 bytes."""
    with suppress(OSError), open('/proc/thread-self/comm', 'wb') as comm:
        comm.write(name.encode()[:_LONGEST])
