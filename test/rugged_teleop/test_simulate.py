# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
import json
import math
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
from typing import Any

import pytest

from bridge_core.transports.multicast import MulticastTransport
from rugged_teleop import simulate
from rugged_teleop.faults import FaultyLine
from rugged_teleop.multicasts import GROUP, LOOPBACK, MulticastDevice
from rugged_teleop.ports import DevicePort
from rugged_teleop.ptys import PtyDevice
from stage.multicast_rig import free_port
from stage.rig import ROOT, run_python, TIMEOUT_FACTOR, wait_for


class Echo:
    """A device that echoes its input, and sends a word on the command ``say``."""

    def __init__(self) -> None:
        self.heard = b''
        self.out: list[bytes] = []
        self.commands: list[str] = []
        self.obeyed_at: list[int] = []  # the number of polls by then
        self.polls = 0

    def receive(self, data: bytes, now: float) -> None:
        del now
        self.heard += data
        self.out.append(data)

    def poll(self, now: float) -> list[bytes]:
        del now
        self.polls += 1
        frames, self.out = self.out, []
        return frames

    def deadline(self) -> float:
        return math.inf

    def apply(self, text: str) -> None:
        if text.startswith('bad'):
            raise ValueError('usage: anything but bad')
        if text == 'boom':
            raise ZeroDivisionError
        self.commands.append(text)
        self.obeyed_at.append(self.polls)
        if text.startswith('say '):
            self.out.append(text[4:].encode())

    def describe(self) -> dict[str, Any]:
        return {'heard': self.heard, 'commands': self.commands}


class Host:
    """Has the port open, as a bridge has."""

    def __init__(self, path: Path) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.heard = b''

    def write(self, data: bytes) -> None:
        os.write(self.fd, data)

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            self.heard += os.read(self.fd, 4096)
        return self.heard

    def wait(self, data: bytes) -> None:
        wait_for(lambda: self.read() == data, 2.0, lambda: f'{data!r}, heard {self.heard!r}')

    @property
    def hung_up(self) -> bool:
        try:
            return os.read(self.fd, 1) == b''
        except BlockingIOError:
            return False
        except OSError:
            return True


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / 'port'


@pytest.fixture
def device(path: Path) -> Iterator[PtyDevice]:
    with PtyDevice(Echo(), path, seed=1) as result:
        yield result


@pytest.fixture
def host(device: PtyDevice) -> Iterator[Host]:
    result = Host(device.path)
    yield result
    os.close(result.fd)


# The line.


def carried(line: FaultyLine, chunks: int) -> list[bytes]:
    for number in range(chunks):
        line.put(bytes((number, 0, 0)), 0.0)
    return line.take(100.0)


def test_line_loses_what_it_is_told_to_and_nothing_else() -> None:
    line = FaultyLine(random.Random(1))
    assert carried(line, 200) == [bytes((number, 0, 0)) for number in range(200)]
    line.drop_next = 2
    assert [chunk[0] for chunk in carried(line, 4)] == [2, 3]
    assert line.dropped == 2
    line.drop = 1.0
    assert carried(line, 100) == []
    line.drop = 0.5
    assert 20 < len(carried(line, 100)) < 80


def test_corrupt_flips_one_bit_and_keeps_the_length() -> None:
    line = FaultyLine(random.Random(1))
    line.corrupt_next = 1
    first, second = carried(line, 2)
    flipped = int.from_bytes(first, 'big') ^ int.from_bytes(b'\0\0\0', 'big')
    assert len(first) == 3
    assert flipped.bit_count() == 1
    assert second == b'\1\0\0'


def test_delay_keeps_order_when_it_becomes_shorter() -> None:
    line = FaultyLine(random.Random(1))
    line.delay = 0.5
    line.put(b'late', 10.0)
    line.delay = 0.0
    line.put(b'early', 10.1)
    assert line.deadline() == 10.5
    assert line.take(10.4) == []
    assert line.take(10.5) == [b'late', b'early']
    assert line.deadline() == math.inf


def test_same_seed_repeats_the_same_faults() -> None:
    def run(seed: int) -> list[bytes]:
        line = FaultyLine(random.Random(seed))
        line.drop = line.corrupt = 0.5
        return carried(line, 50)

    assert run(3) == run(3) != run(4)


# The port.


def test_bytes_go_both_ways_and_are_recorded(device: PtyDevice, host: Host) -> None:
    every_byte = bytes(range(256))  # raw: nothing is swallowed or translated
    host.write(every_byte)
    host.wait(every_byte)
    assert b''.join(chunk.data for chunk in device.received()) == every_byte
    # The device notes what it has sent behind the sending.
    wait_for(lambda: b''.join(chunk.data for chunk in device.sent()) == every_byte, what='a note')
    assert device.sent()[0].at >= device.received()[0].at
    assert device.received(device.received()[-1].at) == []


def test_unknown_command_goes_to_the_device(device: PtyDevice, host: Host) -> None:
    device.apply('say hello')
    host.wait(b'hello')
    device.apply('device drop 3')  # the device's own, though the port has one of that name
    assert device.describe()['commands'] == ['say hello', 'drop 3']


def test_device_says_nothing_between_lines_that_come_together(path: Path) -> None:
    echo = Echo()
    with PtyDevice(echo, path) as device:
        with pytest.raises(ValueError, match=r'usage'):
            device.apply('one', 'two', 'bad', 'three')
        device.apply('drop 0', 'four', 'five')
    assert echo.commands == ['one', 'two', 'four', 'five']
    assert echo.obeyed_at[0] == echo.obeyed_at[1]
    assert echo.obeyed_at[2] == echo.obeyed_at[3]


@pytest.mark.parametrize(
    'text',
    [
        *('drop', 'drop 2', 'drop -1', 'drop x', 'drop 0.1 up', 'drop 0.1 in out', 'drop next'),
        *('drop next x', 'drop next -1', 'corrupt nan', 'delay', 'delay 11', 'stall', 'stall x'),
        *('unplug now', 'plug now', 'clear now', 'bad', 'bad drop'),
    ],
)
def test_bad_command_says_what_fits_and_changes_nothing(device: PtyDevice, text: str) -> None:
    before = device.describe()
    with pytest.raises(ValueError, match=r'use|usage') as caught:
        device.apply(text)
    assert '\n' not in str(caught.value)
    assert device.describe() == before


def test_fault_of_the_device_reaches_who_asked_and_ends_nothing(
    device: PtyDevice, host: Host
) -> None:
    with pytest.raises(ZeroDivisionError):
        device.apply('boom')
    host.write(b'alive')
    host.wait(b'alive')


def test_dropped_chunk_is_lost_in_its_direction_only(device: PtyDevice, host: Host) -> None:
    device.apply('drop next 1 out')
    host.write(b'lost')
    wait_for(lambda: device.describe()['heard'] == b'lost', 2.0, 'the way in is sound')
    host.write(b'kept')
    host.wait(b'kept')


def test_corrupt_chunk_differs_by_a_bit(device: PtyDevice, host: Host) -> None:
    device.apply('corrupt next 1 out')
    host.write(b'\0')
    wait_for(lambda: host.read() and host.heard[0].bit_count() == 1, 2.0, 'a flipped bit')


def test_stalled_port_stays_open_and_carries_nothing(device: PtyDevice, host: Host) -> None:
    device.apply('stall on')
    host.write(b'waits')
    device.apply('say nothing')
    assert device.describe()['stalled']
    assert host.read() == b''
    assert device.describe()['heard'] == b''
    assert not host.hung_up
    device.apply('stall off')
    host.wait(b'waits')


def test_unplugged_port_hangs_up_and_comes_back_under_its_name(
    device: PtyDevice, host: Host
) -> None:
    device.apply('unplug')
    assert not device.plugged
    assert not device.path.is_symlink()
    assert host.hung_up
    device.apply('unplug')  # twice is no fault
    device.apply('say unheard')
    device.apply('plug')
    device.apply('plug')
    again = Host(device.path)
    again.write(b'back')
    again.wait(b'back')
    os.close(again.fd)


def test_delayed_bytes_do_not_survive_an_unplug(device: PtyDevice, host: Host) -> None:
    device.apply('delay 10 out')
    host.write(b'gone')
    wait_for(lambda: device.describe()['heard'] == b'gone', 2.0, 'the way in is sound')
    device.apply('unplug')
    device.apply('clear')
    assert device.plugged
    again = Host(device.path)
    again.write(b'new')
    again.wait(b'new')
    os.close(again.fd)


def test_port_without_a_host_blocks_nothing(device: PtyDevice) -> None:
    for _ in range(150):
        device.apply('say ' + 1000 * 'x')
    wait_for(lambda: device.describe()['lost_bytes'] > 0, 2.0, 'a full port loses bytes')


def test_device_with_nothing_to_do_is_left_alone(path: Path) -> None:
    class Hasty(Echo):
        def deadline(self) -> float:
            return -math.inf  # a simulator that always wants to be called

    with PtyDevice(Echo(), path) as idle:
        polls = idle.call(lambda echo, now: echo.polls)  # type: ignore[attr-defined]
        assert polls <= 2
    hasty = Hasty()
    with PtyDevice(hasty, path):
        wait_for(lambda: hasty.polls > 3, 2.0, 'it is called again')


def test_link_left_by_a_killed_simulator_is_taken_over(path: Path) -> None:
    path.symlink_to('/dev/pts/999999')
    with PtyDevice(Echo(), path):
        assert path.exists()
    assert not path.is_symlink()


def test_port_of_a_simulator_that_is_alive_is_refused_and_named(path: Path) -> None:
    with PtyDevice(Echo(), path):
        before = os.readlink(path)
        words = ('-m', 'rugged_teleop', 'simulate', 'ssc', '--port', str(path))
        done = run_python(*words, stdin=subprocess.DEVNULL)
        assert (done.returncode, done.stdout) == (2, ''), done
        assert f'{path}: is the port of ' in done.stderr
        assert f'(pid {os.getpid()})' in done.stderr
        assert os.readlink(path) == before
        # A terminal has its number by now: nobody there has both of its sides.
        path.unlink()
        master, slave = os.openpty()
        path.symlink_to(os.ttyname(slave))
        os.close(slave)
        with PtyDevice(Echo(), path):
            assert os.readlink(path) != before
        os.close(master)


@pytest.mark.parametrize('kind', ['file', 'link'])
def test_what_is_no_port_of_ours_is_not_overwritten(path: Path, kind: str) -> None:
    if kind == 'file':
        path.write_text('precious')
    else:
        path.symlink_to('/dev/null')
    with pytest.raises(FileExistsError):
        PtyDevice(Echo(), path)
    assert path.exists()


def test_name_that_somebody_else_took_is_left_to_them(path: Path) -> None:
    with PtyDevice(Echo(), path):
        path.unlink()
        path.symlink_to('/dev/null')
    assert os.readlink(path) == '/dev/null'


def test_closed_device_says_so(path: Path) -> None:
    device = PtyDevice(Echo(), path)
    device.close()
    device.close()
    with pytest.raises(RuntimeError, match='closed'):
        device.apply('say hello')


# The multicast group.


def test_group_carries_both_ways_is_recorded_and_can_be_left() -> None:
    port = free_port()
    host = MulticastTransport(GROUP, port, port + 2, interface_address=LOOPBACK)
    host.open()
    with MulticastDevice(Echo(), port, seed=1) as device:
        host.send(b'hello')
        wait_for(lambda: host.receive() == [b'hello'], 2.0, 'the echo')
        assert [chunk.data for chunk in device.received()] == [b'hello']
        device.apply('drop next 1 in')
        host.send(b'lost')
        host.send(b'kept')
        wait_for(lambda: host.receive() == [b'kept'], 2.0, 'the second')
        device.apply('unplug')
        assert not device.plugged
        device.apply('say unheard')
        device.apply('plug')
        device.apply('say back')
        wait_for(lambda: host.receive() == [b'back'], 2.0, 'the word after the plug')
    host.close()
    with pytest.raises(RuntimeError, match='closed'):
        device.apply('say hello')


# The command.


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        ([], 'DEVICE'),
        (['toaster', '--port', 'x'], 'toaster'),
        (['fort_vsc'], '--port'),
        (['fort_vsc', '--port', 'x', '--seed', 'y'], 'seed'),
        (['fort_vsc', '--port', 'x', '--axes', '1'], 'axes'),
        (['esi_drive', '--port', 'x', '--axes', '3'], 'axes'),
        (['esi_drive', '--port', 'x', '--axes', '2', '--compact'], 'compact'),
        (['esi_drive', '--port', 'x', '--status-rate', '0'], 'status-rate'),
        (['fort_vsc', '--port', '/nowhere/port'], '/nowhere/port'),
        (
            ['fort_vsc_hid', '--port', '/dev/null'],
            '--port /dev/null: exists and is no link of ours',
        ),
        (['fort_vsc', '--port', ''], '--port .: exists and is no link of ours; name another path'),
        (['akron', '--pin', 'xyz'], '--pin: xyz is no device PIN such as 1032AE100801035'),
        (['akron', '--pin', '1032AE10080103'], 'is no device PIN'),
        (['vm110', '--port', '/dev/null'], '/dev/null is not within 1 to 65533'),
        (['vm110', '--port', '65534'], '65534'),
        (['vm110', '--bu-id', '0'], 'bu-id'),
        (['vm110', '--group', '10.0.0.1'], '10.0.0.1'),
        (['vm110', '--interface-address', '192.0.2.1'], '192.0.2.1'),
        (['fort_vsc', '--port', 'x', '--as', 'y'], '--as'),
        (['esi_drive', '--port', 'x', '--as', '/nowhere'], '--as /nowhere: No such file'),
        (['esi_drive', '--port', 'x', '--as', str(ROOT / 'setup.py')], 'setup.py: is no report'),
        (['esi_drive', '--port', 'x', '--as', '/bin/sh'], '--as /bin/sh: is no report'),
    ],
)
def test_bad_argument_is_one_line_and_status_2(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        simulate.main(arguments)
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert error.count('\n') == 1
    assert word in error


def _plugged_in(path: Path, *words: str) -> DevicePort:
    return simulate.plug_in(
        simulate.parser().parse_args(['esi_drive', '--port', str(path), *words])
    )


def test_device_obeys_what_it_is_given_to_begin_with(path: Path) -> None:
    with _plugged_in(path, '--apply', 'fault a brake on', '--apply', 'fault b brake on') as device:
        assert device.describe()['errors'] == [['brake'], ['brake']]
    with pytest.raises(ValueError, match='there are: fault'):
        _plugged_in(path, '--apply', 'mute on', '--apply', 'nonsense')
    assert not path.is_symlink()


STOP = {'speed': 2.0, 'time': 0.6, 'angle': 0.7}


@pytest.mark.parametrize(
    ('nodes', 'node', 'says'),
    [
        (['/esi_drive_bridge'], '', ''),
        (['/a/esi_drive_bridge', '/b/esi_drive_bridge'], '/b/esi_drive_bridge', ''),
        (['/a/esi_drive_bridge', '/b/esi_drive_bridge'], '', 'it has /a/esi_drive_bridge, /b'),
        (['/esi_drive_bridge'], '/c/esi_drive_bridge', 'it has /esi_drive_bridge'),
        ([], '', 'it has no esi_drive'),
    ],
)
def test_drive_is_as_a_report_has_it(
    path: Path, nodes: list[str], node: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    values = {'joint_names': ['left', 'right'], 'gear_ratio': [10.0]}
    step = {'name': 'a', 'stopping': {'left': STOP, 'right': STOP}, 'measured': []}
    report = path.with_suffix('.json')
    report.write_text(json.dumps({'parameters': dict.fromkeys(nodes, values), 'steps': [step]}))
    words = ['--as', str(report), *(['--node', node] if node else [])]
    if says:
        with pytest.raises(ValueError, match=says):
            _plugged_in(path, *words)
    else:
        with _plugged_in(path, *words):
            assert 'brake a 0.' in capsys.readouterr().out


class Command:
    """The executable as a child process."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'rugged_teleop.simulate', *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
        )
        assert self.process.stdout is not None
        os.set_blocking(self.process.stdout.fileno(), False)
        self.output = ''

    def say(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f'{line}\n'.encode())
        self.process.stdin.flush()

    def wait(self, text: str) -> None:
        assert self.process.stdout is not None
        fd = self.process.stdout.fileno()

        def found() -> bool:
            with contextlib.suppress(BlockingIOError):
                self.output += os.read(fd, 65536).decode()
            return text in self.output

        wait_for(found, 10.0, lambda: f'{text!r} in {self.output!r}')
        self.output = self.output.partition(text)[2]

    def end(self, number: int) -> int:
        self.process.send_signal(number)
        return self.process.wait(5.0 * TIMEOUT_FACTOR)

    def __enter__(self) -> Command:
        return self

    def __exit__(self, *error: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@pytest.mark.parametrize(
    ('device', 'names', 'end'),
    [
        ('fort_vsc', ('reboot', 'left_y', 'left_down'), signal.SIGTERM),
        ('ssc', ('reboot',), signal.SIGHUP),
        ('esi_drive', ('quit', 'rs422', 'overcurrent'), 'quit'),
    ],
)
def test_command_helps_and_takes_its_port_away_when_it_is_told_to_end(
    path: Path, device: str, names: Sequence[str], end: int | str
) -> None:
    with Command(device, '--port', str(path), '--verbose') as command:
        command.wait('type help')
        assert path.is_symlink()
        command.say('help')
        for word in names:
            command.wait(word)
        command.say('nonsense')
        command.wait("not done: unknown command 'nonsense'")
        command.say('show')
        command.wait('plugged: True')
        if device == 'fort_vsc':
            command.say('estop remote on')
            command.wait('remote_estop: True')
            command.say('battery 20')
            command.wait('battery_percent: 20')
            assert 'remote_estop' not in command.output, 'a change is told once'
        if isinstance(end, str):
            command.say(end)
            assert command.process.wait(5.0 * TIMEOUT_FACTOR) == 0
        else:
            assert command.end(end) == 0
    assert not path.is_symlink()


def test_command_that_is_told_twice_to_end_ends_well(path: Path) -> None:
    """Ctrl-C is a signal of the terminal's, then one of ros2 launch."""
    with Command('fort_vsc', '--port', str(path)) as command:
        command.wait('type help')

        def ended() -> bool:
            if command.process.poll() is None:
                command.process.send_signal(signal.SIGINT)
            return command.process.poll() is not None

        wait_for(ended, 5.0, 'its end')
        assert command.process.returncode == 0


def test_command_outlives_the_end_of_its_input(path: Path) -> None:
    with Command('fort_vsc', '--port', str(path)) as command:
        assert command.process.stdin is not None
        command.process.stdin.write(b'nonsense')  # a last line without an end
        command.process.stdin.close()
        command.wait('type help')
        command.wait("not done: unknown command 'nonsense'")
        host = Host(path)
        wait_for(lambda: b'\x10\x01' in host.read(), 5.0, 'a frame of the VSC')
        os.close(host.fd)
        assert command.end(signal.SIGTERM) == 0
        command.process.stdin = None


def test_command_runs_without_input_and_output(path: Path) -> None:
    words = ['-m', 'rugged_teleop.simulate', 'fort_vsc', '--port', str(path)]
    closed = ['sh', '-c', 'exec "$@" <&- >&- 2>&-', 'sh', sys.executable, *words]
    with subprocess.Popen(closed, cwd=ROOT) as process:
        wait_for(lambda: path.is_symlink() or process.poll() is not None, 20.0, 'the port')
        process.terminate()
        assert process.wait(10.0) == 0


def test_help_of_a_simulator_is_for_people() -> None:
    assert not [name for name, each in simulate.DEVICES.items() if ':raises' in each.help]
