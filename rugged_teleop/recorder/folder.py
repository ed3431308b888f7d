# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The folder of recordings: names that sort by time, a quota, and what is there."""

from __future__ import annotations

import os
from pathlib import Path
import re
import time

UNFINISHED = '.part'
PARAMETERS_OF = 'parameters of '  # begins the name of a metadata record, in a recording
_OURS = re.compile(r'\d{8}T\d{6}\.\d{3}Z_[\w-]+\.mcap(\.part)?')


def default_folder() -> Path:
    """Return where recordings are if nobody said: a folder in ROS's own."""
    return Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'rugged_teleop'


def file_name(at: float, reason: str) -> str:
    """
    Return a name that sorts by time. :param at: seconds since 1970.

    :param reason: words; what a file name should not have becomes a hyphen.
    """
    moment = time.strftime('%Y%m%dT%H%M%S', time.gmtime(at))
    words = re.sub(r'[^a-z0-9_]+', '-', reason.lower()).strip('-')
    return f'{moment}.{int(at % 1 * 1000):03}Z_{words[:80] or "recording"}.mcap'


class Folder:
    """
    :param path: it is made when it is needed.
    :param quota: bytes that all recordings may take. :param files: their number.
    """

    def __init__(self, path: Path, quota: int, files: int) -> None:
        self.path = path
        self._quota = quota
        self._files = files

    def recordings(self) -> list[Path]:
        """Return all recordings, the oldest first, also one that was never finished."""
        if not self.path.is_dir():
            return []
        return sorted(path for path in self.path.iterdir() if _OURS.fullmatch(path.name))

    def make_room(self) -> list[Path]:
        """
        Remove the oldest recordings beyond the quota, but never the newest; return them.

        :raises OSError: one cannot be removed.
        """
        kept = self.recordings()
        sizes = {path: path.stat().st_size for path in kept}
        removed = []
        while len(kept) > 1 and (
            len(kept) > self._files or sum(sizes[path] for path in kept) > self._quota
        ):
            removed.append(kept.pop(0))
            removed[-1].unlink()
        return removed
