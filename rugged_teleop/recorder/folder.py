# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The folder of recordings: names that sort by time, a quota, and what is there."""

from __future__ import annotations

from pathlib import Path
import re
import time

from rugged_teleop.recorder.triggers import FAULT

UNFINISHED = '.part'
KEPT = 'kept'  # a folder in that of the recordings: nothing in it is ever removed, or counts
PARAMETERS_OF = 'parameters of '  # begins the name of a metadata record, in a recording
_OURS = re.compile(r'\d{8}T\d{6}\.\d{3}Z_[\w-]+\.mcap(\.part)?')


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

    def keep(self, path: Path) -> Path:
        """Have a recording never removed; return where it is now. :raises OSError: it is not."""
        kept = self.path / KEPT / path.name
        kept.parent.mkdir(0o750, exist_ok=True)
        return path.rename(kept)

    def make_room(self, written: Path | None = None) -> list[Path]:
        """
        Remove recordings beyond the quota, but never the newest; return them.

        Faults go first, for one that comes and goes would push out all stops; then the oldest.

        :param written: just now, whatever its name says: the clock may be wrong.
        :raises OSError: one cannot be removed.
        """
        sizes = {path: path.stat().st_size for path in self.recordings()}
        waiting = [path for path in [*sizes][:-1] if path != written]
        waiting.sort(key=lambda path: f'Z_{FAULT}_' not in path.name)
        removed = []
        while waiting and (len(sizes) > self._files or sum(sizes.values()) > self._quota):
            removed.append(waiting.pop(0))
            removed[-1].unlink()
            del sizes[removed[-1]]
        return removed
