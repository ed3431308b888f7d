# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a program refused as it started, for the ledger: nobody hears such a program in ROS.

It leaves a line in the recorder's default folder, where there is one; the recorder takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import json
import os
from pathlib import Path
import time

_FIELDS = ('program', 'why', 'refused_at')
_MOST = 100_000  # bytes: a program that is started again and again fills no disk


def default_folder() -> Path:
    """Return where recordings are if nobody said: a folder in ROS's own."""
    return Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'rugged_teleop'


def leave(program: str, why: str) -> None:
    """Leave word; raises nothing."""
    line = json.dumps(dict(zip(_FIELDS, (program, why, round(time.time(), 3)), strict=True)))
    with suppress(OSError, RuntimeError):  # no folder of one's own, either
        path = _file()
        if not path.exists() or path.stat().st_size < _MOST:
            with path.open('a', encoding='utf-8') as file:  # only where the folder is
                file.write(f'{line}\n')


def take() -> Sequence[dict[str, object]]:
    """Return what was left since the last time. :raises OSError: it cannot be read."""
    path = _file()
    taken = path.with_suffix('.taken')
    if not path.exists():
        return ()
    path.rename(taken)
    found = []
    for line in taken.read_text(encoding='utf-8', errors='replace').splitlines():
        with suppress(ValueError, TypeError, KeyError, RecursionError):  # a torn one, or none
            fields = json.loads(line)
            found.append({name: fields[name] for name in _FIELDS})
    taken.unlink()
    return found


def _file() -> Path:
    return default_folder() / 'refused.jsonl'
