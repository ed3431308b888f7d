# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that come with the package and are no code, such as config/."""

import os
from pathlib import Path

# Jazzy's Fast DDS reads the first alone. Later ones read both, and refuse half of Jazzy's.
_LOOPBACK = {
    'FASTRTPS_DEFAULT_PROFILES_FILE': 'config/fastdds_loopback_jazzy.xml',
    'FASTDDS_DEFAULT_PROFILES_FILE': 'config/fastdds_loopback.xml',
}


def shared(name: str) -> Path:
    """
    Return a file of the package: in the sources, or in share/ once installed.

    :raises FileNotFoundError: naming where it was looked for.
    """
    package = Path(__file__).resolve().parent
    places = [package.parent]
    places += [parent / 'share' / 'rugged_teleop' for parent in package.parents]
    for place in places:
        if (place / name).is_file():
            return place / name
    raise FileNotFoundError(f'{name} is not in {places[0]} nor in share/ of the installation')


def loopback_profiles() -> dict[str, str]:
    """Return the variables that keep Fast DDS on this machine, and without shared memory."""
    loaded_from = filter(None, os.environ.get('LD_LIBRARY_PATH', '').split(':'))
    later = any(Path(place, 'libfastdds.so').exists() for place in loaded_from)
    return {
        name: str(shared(path))
        for name, path in _LOOPBACK.items()
        if not later or name.startswith('FASTDDS')
    }
