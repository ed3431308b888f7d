# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Have twist_mux, rosbag2, diagnostic_aggregator and nodes of Nav2 meet simulated devices and mux.

In a workspace with some of them: ``. install/setup.bash``, then
``python -m assurance.peers.rclcpp_nodes`` in this repository, with the names of ``PEERS`` that are
to be tried; without names all that are there. A line says what was seen; the first that was not
ends it with status 1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from signal import SIGINT, SIGKILL
import subprocess
import sys
import tempfile
import time
from typing import Any

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import String
from std_srvs.srv import Trigger
import yaml

from rugged_teleop.recordings import read, Said
from stage.devices import DRIVE, MUX, UNHURRIED, VSC
from stage.mux_talkers import sticks
from stage.recipes import bench, file_of, twist, twist_mux_is_locked
from stage.rig import NodeProcess, Observer, ROOT
from stage.spine import Spine
from stage.talkers import Talker

PROVEN: dict[str, dict[str, Any]] = {  # as in config/spine.yaml
    VSC: UNHURRIED[VSC],
    MUX: UNHURRIED[MUX]
    | dict.fromkeys(
        ('estop.fort.proof', 'estop.drive.proof', 'operator.fort.proof', 'drive_enabled_proof'),
        'required',
    ),
    DRIVE: UNHURRIED[DRIVE] | {'proof': 'required'},
}
ERROR, STALE = 2, 3  # of a DiagnosticStatus


class PatientSpine(Spine):
    """One that nothing stops but what is tried."""

    is_patient = True


@contextmanager
def running(package: str, program: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a program of a package until the end of the block, which ends it as Ctrl-C does."""
    path = Path(get_package_prefix(package)) / 'lib' / package / program
    with (
        tempfile.TemporaryFile() as output,
        subprocess.Popen(
            [str(path), '--ros-args', *arguments],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        try:
            yield process
        except BaseException:
            output.seek(0)
            print(output.read()[-4000:].decode())
            raise
        finally:
            process.send_signal(SIGINT)


@contextmanager
def spine(observer: Observer, parameters: Any = UNHURRIED) -> Iterator[Spine]:
    """Run VSC, mux and drive, at rest."""
    with (
        tempfile.TemporaryDirectory() as folder,
        PatientSpine(Path(folder), observer, parameters) as result,
    ):
        yield result


def twist_mux(observer: Observer, recipe: str, space: str, output: str, *more: str) -> Any:
    """Run it with a recipe's file."""
    arguments = ('--params-file', str(file_of(recipe)), '-r', f'__ns:={space or "/"}')
    return running('twist_mux', 'twist_mux', *arguments, '-r', f'cmd_vel_out:={output}', *more)


def lock(observer: Observer) -> Iterator[str]:
    """Lock twist_mux by the e-stop of the mux."""

    def start(space: str) -> Any:
        return twist_mux(observer, 'twist_mux', space, 'base/cmd_vel')

    yield from twist_mux_is_locked(observer, start)


def nav2_in(observer: Observer) -> Iterator[str]:
    """Fill the pauses of a planner by twist_mux; it is one of before its pull request 50."""
    mux = bench(
        observer, 'nav2', '-r', '~/cmd_vel:=/base/cmd_vel', autonomy__type='Twist', output='twist'
    )
    mux.command = observer.record(Twist, '/base/cmd_vel')
    planner = Talker(observer, Twist, '/cmd_vel', twist(0.3, 0.2), rate=20.0)
    planner.pause()
    idle = Talker(observer, Twist, '/idle_vel', twist(), rate=20.0)

    def follows(*expected: float) -> None:
        mux.wait(lambda: mux.demand == expected, f'{expected}')

    with twist_mux(observer, 'nav2', '', 'plan_vel'):
        try:
            mux.ready()
            mux.wait(lambda: mux.explains('~/select_autonomy'), 'rested autonomy')
            assert mux.select_autonomy().success
            for _ in range(2):
                planner.resume()
                follows(0.3, 0.2)
                planner.pause()
                follows(0.0, 0.0)
                observer.holds_for(lambda: mux.says('ACTIVE') and not any(mux.demand), 1.5)
                yield 'a goal drives, its end stops, and control stays'
            planner.resume()
            follows(0.3, 0.2)
            mux.joy.message = sticks(-1.0, deadman=True)
            follows(-0.5, 0.0)
            yield 'the deadman takes over'
        finally:
            for talker in (planner, idle):
                talker.leave()
            mux.close()


class Scanner(Talker):
    """A laser that sees the same all around, now."""

    def see(self, distance: float) -> None:
        """:param distance: m."""
        self.message.ranges = [distance] * 360

    def say(self) -> None:
        """Publish now."""
        self.message.header.stamp = self._node.get_clock().now().to_msg()
        super().say()


def collision_monitor(observer: Observer) -> Iterator[str]:
    """Put an obstacle before a planner that twist_mux and mux follow; end the laser, the node."""
    mux = bench(
        observer, 'nav2', '-r', '~/cmd_vel:=/base/cmd_vel', autonomy__type='Twist', output='twist'
    )
    mux.command = observer.record(Twist, '/base/cmd_vel')
    scan = LaserScan(angle_max=6.27, angle_increment=0.0175, range_min=0.05, range_max=10.0)
    scan.header.frame_id = 'base_link'
    scanner = Scanner(observer, LaserScan, '/scan', scan, rate=20.0)
    scanner.see(5.0)
    planner = Talker(observer, Twist, '/cmd_vel_smoothed', twist(0.3), rate=20.0)
    planner.pause()
    idle = Talker(observer, Twist, '/idle_vel', twist(), rate=20.0)
    zone = 'polygon_stop'
    values = {
        'base_frame_id': 'base_link',
        'base_shift_correction': 'false',
        'source_timeout': '1.0',
        'polygons': f'[{zone}]',
        f'{zone}.type': 'circle',
        f'{zone}.radius': '0.5',
        f'{zone}.action_type': 'stop',
        f'{zone}.visualize': 'false',
        'observation_sources': '[scan]',
        'scan.type': 'scan',
        'scan.topic': '/scan',
    }
    words = [word for key, value in values.items() for word in ('-p', f'{key}:={value}')]

    def follows(*expected: float) -> None:
        mux.wait(lambda: mux.demand == expected, f'{expected}')

    def stays() -> None:
        follows(0.0, 0.0)
        observer.holds_for(lambda: mux.says('ACTIVE') and not any(mux.demand), 3.0)

    with (
        twist_mux(observer, 'nav2', '', 'plan_vel'),
        running('nav2_collision_monitor', 'collision_monitor', *words) as monitor,
    ):
        try:
            for transition in ('configure', 'activate'):
                assert observer.change_state('/collision_monitor', transition)
            mux.ready()
            mux.wait(lambda: mux.explains('~/select_autonomy'), 'rested autonomy')
            assert mux.select_autonomy().success
            planner.resume()
            follows(0.3, 0.0)
            scanner.see(0.3)
            stays()
            yield 'an obstacle: zero for 3 s, and control stays'
            scanner.see(5.0)
            follows(0.3, 0.0)
            scanner.pause()
            stays()
            yield 'it is gone: motion; the laser is silent: zero'
            scanner.resume()
            follows(0.3, 0.0)
            monitor.kill()
            stays()
            yield 'SIGKILL of the monitor in motion: zero'
        finally:
            for talker in (scanner, planner, idle):
                talker.leave()
            mux.close()


def aggregator(observer: Observer) -> Iterator[str]:
    """Group what the nodes say of themselves, and miss one that has died."""
    record = observer.record(DiagnosticArray, '/diagnostics_agg')
    here = {'mux': 'Safety mux', 'fort_vsc': 'FORT VSC', 'esi_drive': 'ESI drive'}
    here['recorder'] = 'Recorder'
    sections = yaml.safe_load((ROOT / 'config' / 'diagnostics.yaml').read_text(encoding='utf-8'))
    groups = sections['analyzers']['ros__parameters']
    for name in groups.keys() - here.keys() - {'path'}:
        del groups[name]

    def levels() -> dict[str, int]:
        found = record.last.status if record.last else ()
        return {each.name.removeprefix('/rugged_teleop'): each.level[0] for each in found}

    def all_is_well() -> bool:
        found = levels()
        return {'', *(f'/{group}' for group in here.values())} < found.keys() and not any(
            level >= ERROR for level in found.values()
        )

    with tempfile.TemporaryDirectory() as folder, spine(observer) as machine:
        file = Path(folder) / 'diagnostics.yaml'
        file.write_text(yaml.safe_dump(sections), encoding='utf-8')
        with (
            running('diagnostic_aggregator', 'aggregator_node', '--params-file', str(file)),
            NodeProcess('rugged_teleop.recorder.node', {'folder': folder}),
        ):
            machine.rest()
            machine.wait(all_is_well, 'all groups, and none in error', 20.0)
            yield f'{levels()}'
            machine.nodes[DRIVE].signal(SIGKILL)
            machine.wait(lambda: levels()['/ESI drive'] == STALE, 'a stale group', 15.0)
            yield f"SIGKILL of the drive's node: {levels()}"
            machine.restart(DRIVE)
            machine.wait(all_is_well, 'all groups, and none in error', 20.0)
            yield 'started again: no group is stale'


def lifecycle_manager(observer: Observer) -> Iterator[str]:
    """Bring nodes up, lose one, and pause them in motion."""
    service = import_module('nav2_msgs.srv').ManageLifecycleNodes

    def ask(command: str) -> bool:
        request = service.Request(command=getattr(service.Request, command))
        return bool(observer.call(service, f'{manager}/manage_nodes', request).success)

    def states() -> dict[str, str]:
        return {name: observer.state(f'/{name}') for name in (VSC, DRIVE, MUX)}

    manager, file = '/lifecycle_manager', ROOT / 'config' / 'lifecycle_manager.yaml'
    waiting = {name: {**values, 'autostart': False} for name, values in UNHURRIED.items()}
    with (
        spine(observer, waiting) as machine,
        running('nav2_lifecycle_manager', 'lifecycle_manager', '--params-file', str(file)),
    ):
        machine.wait(lambda: set(states().values()) == {'active'}, 'active', 30.0)
        yield f'{states()}'
        machine.rest()
        machine.moving()
        assert ask('PAUSE')
        machine.wait(lambda: not machine.drive.enabled, 'a drive that is disabled')
        yield f'pause, in motion: {states()}'
        assert ask('RESUME')
        machine.let_go()
        machine.wait(lambda: machine.mux_says('STOPPED'), 'STOPPED')
        yield f'resume: STOPPED, {states()}'
        machine.moving()
        machine.nodes[DRIVE].signal(SIGKILL)
        machine.wait(lambda: not machine.drive.enabled, 'a drive that is disabled')
        machine.let_go()
        machine.restart_and_meet(DRIVE)
        is_active = observer.call(Trigger, f'{manager}/is_active').success
        yield f'SIGKILL of a node that is started again: {states()}; the manager: {is_active=}'
        yield f'STARTUP: {ask("STARTUP")}, {states()}'
        for transition in ('configure', 'activate'):
            assert observer.change_state(f'/{DRIVE}', transition)
        machine.moving()
        yield f'configured and activated by hand, then a reset: motion, {states()}'


def rosbag2(observer: Observer) -> Iterator[str]:
    """Record a motion, play it to the machine it was recorded from, and play our recordings."""

    command = f'/{MUX}/command'

    def said(file: Path) -> list[Said]:
        with file.open('rb') as opened:
            return [each for each in read(opened) if isinstance(each, Said)]

    def pass_time(duration: float) -> None:
        end = time.monotonic() + duration
        observer.wait_for(lambda: time.monotonic() > end, 2.0 * duration)

    def play(file: Path) -> None:
        before = observer.node.count_publishers(command)
        times = [each.at for each in said(file)]
        with running('rosbag2_transport', 'player', '-p', f'storage.uri:={file}'):
            observer.wait_for(lambda: observer.node.count_publishers(command) > before, 20.0)
            pass_time(max(times) - min(times) + 1.0)

    with tempfile.TemporaryDirectory() as folder, spine(observer, PROVEN) as machine:
        bag = Path(folder) / 'bag'
        options = {'record.all_topics': 'true', 'storage.uri': bag, 'storage.storage_id': 'mcap'}
        words = [word for key, value in options.items() for word in ('-p', f'{key}:={value}')]
        with running('rosbag2_transport', 'recorder', *words) as recorder:
            machine.rest()
            machine.moving()
            pass_time(2.0)
            machine.vsc.apply('estop remote on')
            machine.wait(lambda: machine.mux_says('STOPPED'), 'STOPPED')
            recorder.send_signal(SIGINT)
            recorder.wait(30.0)
        (file,) = bag.glob('*.mcap')
        recorded = said(file)
        commands = [each.message for each in recorded if each.topic == command]
        assert any(any(message.velocity) for message in commands)
        topics = {each.topic for each in recorded}
        yield f'recorded {len(recorded)} messages of {len(topics)} topics, and read them'
        machine.let_go()
        machine.release()
        machine.ready()
        start = time.monotonic()
        played = observer.record(JointState, command)
        play(file)
        moved = sum(any(message.velocity) for message in played.messages)
        enabled = [packet for packet in machine.drive.packets(start) if packet.enables]
        yield f'played to the machine: {moved} commands, {len(enabled)} packets enable the drive'
        assert moved
        assert not enabled
        machine.moving()
        yield 'after it: a reset, and motion'
    state = observer.record(String, f'/{MUX}/state')  # a recording keeps no QoS
    for recording in ('lost_remote', 'pressed_estop', 'drive_fault'):
        state.clear()
        play(ROOT / 'test' / 'recordings' / f'{recording}.mcap')
        yield f'played {recording}: {dict(Counter(message.data for message in state.messages))}'
        assert state.messages


PEERS = {
    'lock': ('twist_mux', lock),
    'nav2_in': ('twist_mux', nav2_in),
    'collision_monitor': ('nav2_collision_monitor', collision_monitor),
    'aggregator': ('diagnostic_aggregator', aggregator),
    'lifecycle_manager': ('nav2_lifecycle_manager', lifecycle_manager),
    'rosbag2': ('rosbag2_transport', rosbag2),
}


def main(names: list[str]) -> None:
    for name in names or PEERS:
        package, tried = PEERS[name]
        try:
            get_package_prefix(package)
        except PackageNotFoundError:
            print(f'{name}: {package} is not here')
            continue
        with Observer() as observer:
            for seen in tried(observer):
                print(f'{name}: {seen}', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
