# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What there is to download."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_MOST = 100


def recordings(folder: Path | None) -> list[dict[str, Any]]:
    """Return name and size (bytes) of the recordings; the last names, the newest, come first."""
    if folder is None:
        return []
    try:
        files = [path for path in folder.glob('*.mcap') if _is_plain(path)]
        files = sorted(files, key=lambda path: path.name, reverse=True)[:_MOST]
        return [{'name': path.name, 'size': path.stat().st_size} for path in files]
    except OSError:  # a folder that is gone, a file that is being removed
        return []


def recording(folder: Path | None, name: str) -> Path | None:
    """Return the file of a recording; None where the folder itself has none of this name."""
    if folder is None or Path(name).name != name or Path(name).suffix != '.mcap':
        return None
    path = folder / name
    return path if _is_plain(path) else None


def _is_plain(path: Path) -> bool:
    """Tell whether it is a file, and no link that leads elsewhere."""
    return path.is_file() and not path.is_symlink()
