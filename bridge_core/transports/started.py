# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Python process that is started from nothing, and finds what this process has imported."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import subprocess
import sys


def popen(
    title: str,
    program: str,
    module: str,
    arguments: Sequence[str],
    descriptors: Sequence[int],
) -> subprocess.Popen[bytes]:
    """
    Start a program; it gets the arguments, and these descriptors.

    :param title: for whoever lists the processes. :param module: that it has to find, too.
    """
    return subprocess.Popen(
        [title, '-S', '-m', program, *arguments],
        executable=sys.executable,
        pass_fds=descriptors,
        stdin=subprocess.DEVNULL,
        env=environment(module),
        start_new_session=True,  # the terminal's signals are the node's business
    )


def root_of(module: str) -> str:
    """Return the folder from which a module was imported."""
    return str(Path(sys.modules[module].__file__ or '').parents[module.count('.')])


def environment(module: str) -> dict[str, str]:
    """
    Return the environment in which ``python -S -m`` finds what this process has imported.

    Without the module ``site`` it starts sooner and takes less memory. Its own name is no path
    that would lead it to its libraries.
    """
    path = [root_of(__name__), root_of(module), *(folder or os.getcwd() for folder in sys.path)]
    return {
        **os.environ,
        'PYTHONHOME': f'{sys.base_prefix}:{sys.base_exec_prefix}',
        'PYTHONPATH': os.pathsep.join(dict.fromkeys(path)),
        'PYTHONSAFEPATH': '1',  # from Python 3.11: nothing from where the node was started
    }
