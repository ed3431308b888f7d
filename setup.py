# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Build rugged_teleop, with pip or with colcon."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'rugged_teleop'
SHARED = ('config', 'container', 'dbc', 'docs', 'launch', 'layouts', 'systemd', 'udev')


def shared_files() -> list[tuple[str, list[str]]]:
    """Return what goes to share/, folder by folder, as setuptools wants it."""
    files: dict[str, list[str]] = {}
    for top in SHARED:
        found = (path for path in Path(top).rglob('*') if '_build' not in path.parts)
        for path in sorted(path for path in found if path.is_file()):
            files.setdefault(f'share/{PACKAGE}/{path.parent.as_posix()}', []).append(str(path))
    return sorted(files.items())


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Rugged operator remotes and actuators in ROS 2, with a safety mux between them',
    author='The rugged_teleop maintainers',
    maintainer='The rugged_teleop maintainers',
    maintainer_email='maintainers@rugged-teleop.example',
    license='Apache-2.0',
    python_requires='>=3.10',
    # ROS is not listed: where it is installed it is used as it is, elsewhere see requirements.txt.
    # What one node or command alone needs.
    extras_require={
        'completion': ['argcomplete>=3'],
        'gpio': ['gpiod>=2.1'],
        'modbus': ['pymodbus>=3.11,<4'],
        'page': ['aiohttp>=3.9'],
        'plot': ['matplotlib>=3.6'],
        'record': ['mcap>=1.2', 'mcap-ros2-support>=0.5'],
        # By this colcon knows what to test with. make test has all of requirements-dev.txt.
        'test': ['pytest', 'hypothesis'],
    },
    install_requires=['setuptools', 'pyserial>=3.5', 'python-can>=4.3', 'PyYAML'],
    packages=find_packages(exclude=('demo*', 'stage*', 'test*', 'assurance*')),
    package_data={'': ['py.typed'], 'rugged_teleop.status_page': ['static/*']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        # For ros2 run alone: short words like these do not belong on everybody's PATH.
        (f'lib/{PACKAGE}', sorted(str(path) for path in Path('tools').iterdir())),
        *shared_files(),
    ],
    entry_points={
        # Each device says there what it is: bridge_core.device.
        'rugged_teleop.devices': [
            'akron_can_bridge = akron_can_bridge.device:DEVICE',
            'esi_drive_bridge = esi_drive_bridge.device:DEVICE',
            'fort_vsc_bridge = fort_vsc_bridge.device:DEVICE',
            'io_bridge = io_bridge.device:DEVICE',
            'ssc_bridge = ssc_bridge.device:DEVICE',
            'vm110_bridge = vm110_bridge.device:DEVICE',
        ],
        # What `rugged_teleop NAME` runs besides these; ros2 run finds it in lib/, see above.
        'rugged_teleop.commands': [
            'recorder = rugged_teleop.recorder.node:main',
            'ssc_config = ssc_bridge.config.main:main',
            'status_page = rugged_teleop.status_page.node:main',
        ],
        'console_scripts': [
            'akron_can_bridge = akron_can_bridge.node:main',
            'esi_drive_bridge = esi_drive_bridge.node:main',
            'fort_vsc_bridge = fort_vsc_bridge.node:main',
            'io_bridge = io_bridge.node:main',
            'rugged_teleop = rugged_teleop.__main__:main',
            'rugged_teleop_stack = rugged_teleop.stack:main',
            'safety_mux = safety_mux.node:main',
            'ssc_bridge = ssc_bridge.node:main',
            'vm110_bridge = vm110_bridge.node:main',
        ],
    },
)
