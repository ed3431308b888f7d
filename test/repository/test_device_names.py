# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device is named in its own folder alone: others ask what it says of itself."""

from pathlib import Path
import re

import pytest

from rugged_teleop.devices import devices
from stage.rig import ROOT

# How people call the devices, and what their packages are called.
NAMES = re.compile(
    r'(?i)\b(fort|vsc|vm-?110|akron|esi|ssc)(?![a-z])|(fort_|vm110_|akron_|esi_|ssc_|\bio_bridge)'
)
# Which other folders name none; the rest of bridge_core and the tools may cite a manual.
FOLDERS = ('safety_mux', 'rugged_teleop/why', 'rugged_teleop/replay', 'rugged_teleop/status_page')
_EXAMPLES = ('rugged_teleop/why/main.py', 'rugged_teleop/replay/main.py')  # names of recordings


@pytest.mark.parametrize('folder', FOLDERS)
def test_no_device_is_named(folder: str) -> None:
    for path in sorted((ROOT / folder).rglob('*.py')):
        name = path.relative_to(ROOT).as_posix()
        found = [line for line in _lines(path) if NAMES.search(line)]
        assert name in _EXAMPLES or not found, name


def test_names_are_those_of_the_devices() -> None:
    assert all(NAMES.search(name) for name in devices())


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding='utf-8').splitlines()
