# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder's parameters: names, defaults, ranges and what they mean."""

from collections.abc import Mapping
from typing import Any

from bridge_core.parameters import Parameter, ParameterError

PARAMETERS = (
    Parameter(
        'seconds',
        60.0,
        'How much of what was heard before is in a recording.',
        unit='s',
        minimum=1.0,
        maximum=600.0,
        fixed=True,
        section='recordings',
    ),
    Parameter(
        'after',
        10.0,
        'How long a recording goes on after its reason; at most period.',
        unit='s',
        minimum=0.1,
        maximum=60.0,
        fixed=True,
    ),
    Parameter(
        'period',
        60.0,
        'From the beginning of one recording to that of the next, but for ~/save; not longer than '
        'seconds.',
        unit='s',
        minimum=1.0,
        maximum=600.0,
        fixed=True,
    ),
    Parameter(
        'memory',
        100,
        'Most that is kept in memory, whatever seconds says.',
        unit='MB',
        minimum=1,
        maximum=10000,
        fixed=True,
    ),
    Parameter(
        'folder',
        '',
        'Where the recordings are. Empty: rugged_teleop in ROS_HOME, or in .ros of your home.',
        fixed=True,
        section='disk',
    ),
    Parameter(
        'quota',
        1000,
        'What the recordings in the folder may take; first faults go, then the oldest.',
        unit='MB',
        minimum=1,
        maximum=1000000,
        fixed=True,
    ),
    Parameter(
        'files',
        100,
        'How many recordings the folder may have; first faults go, then the oldest.',
        minimum=1,
        maximum=100000,
        fixed=True,
    ),
    Parameter(
        'ledger.file',
        '',
        'The ledger. Empty: ledger.jsonl in the folder of the recordings.',
        fixed=True,
        section='ledger',
    ),
    Parameter(
        'ledger.anchor',
        '',
        'File, pipe or printer, best on another computer, that gets number and SHA-256 of each '
        'newest line.',
        fixed=True,
    ),
    Parameter(
        'commissioning.report',
        '',
        'report.json of the commissioned machine, or its folder, to compare stops with.',
        fixed=True,
    ),
    Parameter(
        'commissioning.stop_tolerance',
        0.25,
        'How much longer than commissioned a stop may take: 0.25 is a quarter.',
        minimum=0.05,
        maximum=2.0,
        fixed=True,
    ),
    Parameter(
        'commissioning.test_interval',
        0.0,
        'Warns of each stop and deadman that was not seen to work for so long. 0: never.',
        unit='h',
        minimum=0.0,
        maximum=10000.0,
        fixed=True,
    ),
)


def check(values: Mapping[str, Any]) -> None:
    """Refuse a period that would leave gaps. :raises ParameterError: it."""
    if values['period'] > values['seconds']:
        raise ParameterError(
            f'parameters period = {values["period"]} and seconds = {values["seconds"]}: '
            'period must not be above seconds, or a stop may be in no recording'
        )
