# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The stack with faults planted in methods of its nodes: ``python -m test.system.faulty_stack``.

Each of ``METHODS`` raises for as long as there is a file of its name in the folder that the
environment names.
"""

from __future__ import annotations

import functools
import importlib
import os
from pathlib import Path
from typing import Any

from rugged_teleop.stack import main

FOLDER = 'FAULTY_STACK_FOLDER'
METHODS = {  # of these modules
    'Arbiter.tick': 'safety_mux.arbiter',
    'BridgeNode._diagnose': 'bridge_core.node',
    'EsiDriveBridge._on_command': 'esi_drive_bridge.node',
    'FortVscBridge.on_event': 'fort_vsc_bridge.node',
    'Intake._joy': 'safety_mux.intake',
    'ManagedNode._on_set_parameters': 'bridge_core.managed_node',
    'SafetyMux._on_diagnostics': 'safety_mux.node',
    'Services.on_trip': 'safety_mux.services',
    'SafetyMux._publish_diagnostics': 'safety_mux.node',
    'SafetyMux._tick': 'safety_mux.node',
}


class PlantedFault(Exception):  # noqa: N818 - it is one
    """Nobody expects it."""


def plant(name: str, flag: Path) -> None:
    """Have the method raise while there is such a file."""
    owner, _, method = name.partition('.')
    kind = getattr(importlib.import_module(METHODS[name]), owner)
    real = getattr(kind, method)

    @functools.wraps(real)
    def faulty(*arguments: Any, **options: Any) -> Any:
        if flag.exists():
            raise PlantedFault(name)
        return real(*arguments, **options)

    setattr(kind, method, faulty)


if __name__ == '__main__':
    for each in METHODS:
        plant(each, Path(os.environ[FOLDER]) / each)
    main()
