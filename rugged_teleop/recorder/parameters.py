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
        'How long a recording goes on after what it is made of; period is the most.',
        unit='s',
        minimum=0.1,
        maximum=60.0,
        fixed=True,
    ),
    Parameter(
        'period',
        60.0,
        'From the beginning of one recording to that of the next, but for ~/save. What happens '
        'within it is in the next one; not longer than seconds.',
        unit='s',
        minimum=1.0,
        maximum=600.0,
        fixed=True,
    ),
    Parameter(
        'memory',
        100,
        'What is kept in memory is at most this, whatever seconds says.',
        unit='MB',
        minimum=1,
        maximum=10000,
        fixed=True,
    ),
    Parameter(
        'folder',
        '',
        'Where the recordings are. Empty: rugged_teleop in the folder of ROS: ROS_HOME, or .ros '
        'in your own.',
        fixed=True,
        section='disk',
    ),
    Parameter(
        'quota',
        1000,
        'What the recordings in the folder may take; the oldest go first.',
        unit='MB',
        minimum=1,
        maximum=1000000,
        fixed=True,
    ),
    Parameter(
        'files',
        100,
        'How many recordings the folder may have; the oldest go first.',
        minimum=1,
        maximum=100000,
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
