# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every node that a parameter file has a section for, as processes: see docs/bringup.md."""

from pathlib import Path
import tempfile
from typing import Any

from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from rugged_teleop.bringup import missing_for_recorder, PORTS, processes

_RESPAWN_DELAY = 1.0  # s
_SWITCH = {'true': True, 'false': False}


def _argument(name: str, description: str, default: str | None = None, **options: Any) -> Any:
    return DeclareLaunchArgument(name, default_value=default, description=description, **options)


def _start(context: Any) -> list[Any]:
    def value(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    recorder = _SWITCH[value('recorder')]
    missing = missing_for_recorder() if recorder else ''
    found = processes(
        Path(value('params_file')).expanduser().absolute(),
        Path(tempfile.mkdtemp(prefix='rugged_teleop_')),
        namespace=value('namespace'),
        simulated=_SWITCH[value('simulated')],
        autostart=_SWITCH[value('autostart')],
        ports={name: value(name) for name in PORTS},
        cmd_joy=value('cmd_joy'),
        recorder=recorder and not missing,
    )
    return [
        *([LogInfo(msg=missing)] if missing else []),
        *(
            ExecuteProcess(
                cmd=list(process.command),
                name=process.name.strip('/').replace('/', '.'),
                output='screen',
                respawn=process.respawn,
                respawn_delay=_RESPAWN_DELAY,
            )
            for process in found
        ),
    ]


def generate_launch_description() -> Any:
    """Return what ``ros2 launch`` is to do."""
    switches = list(_SWITCH)
    return LaunchDescription(
        [
            _argument('params_file', 'Parameters of the nodes; who has no section does not run.'),
            _argument('namespace', 'Of the sections that name none, such as /**/safety_mux.', ''),
            _argument(
                'simulated', 'Simulate the devices, all of them.', 'false', choices=switches
            ),
            _argument(
                'autostart',
                'false: the nodes wait for a lifecycle manager.',
                'true',
                choices=switches,
            ),
            *(
                _argument(name, f'{parameter} of {node}; empty: as the file says.', '')
                for name, (node, parameter) in PORTS.items()
            ),
            _argument('cmd_joy', 'Topic of who moves the fire monitor: safety_mux/joy/fort.', ''),
            _argument(
                'recorder', 'Keep what led to each stop, in files.', 'true', choices=switches
            ),
            OpaqueFunction(function=_start),
        ]
    )
