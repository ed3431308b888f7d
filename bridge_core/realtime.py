# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Real-time priority for all threads of this process, where the rights are there."""

from collections.abc import Callable
from contextlib import suppress
import ctypes
import errno
from functools import partial
import getpass
import os
from pathlib import Path
import resource

# mlockall(2): what is mapped now and later, each page once it is used, so that the unused part of
# the threads' stacks takes no memory.
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def use_realtime(priority: int) -> list[str]:
    """
    Run all threads of this process by SCHED_FIFO, and keep its memory from being swapped out.

    Threads that these start later inherit it. Return what was refused, with what to do.

    :param priority: from 1 to 98.
    """
    return [
        *_try(partial(_schedule, priority), f'rtprio {priority}', f'LimitRTPRIO={priority}'),
        *_try(_lock_memory, 'memlock unlimited', 'LimitMEMLOCK=infinity'),
    ]


def user_name() -> str:
    """Return the name of whoever runs this; the number, if that has none as in a container."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _try(step: Callable[[], None], limit: str, setting: str) -> list[str]:
    try:
        step()
    except OSError as error:
        return [
            f'add "{user_name()} - {limit}" to /etc/security/limits.conf and log in again, '
            f'or {setting} to the systemd unit: rt_priority was refused, {error.strerror}'
        ]
    return []


def _schedule(priority: int) -> None:
    for thread in Path('/proc/self/task').iterdir():
        with suppress(ProcessLookupError):  # it has ended
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(priority))


def _lock_memory() -> None:
    """Lock it only without a limit: within one, an allocation would fail some time later."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0:
        raise PermissionError(errno.EPERM, 'locked memory is limited')
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f'cannot lock memory: {os.strerror(number)}')
