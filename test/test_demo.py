from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
import contextlib
import fcntl
from functools import partial
import itertools
import os
from pathlib import Path
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from types import SimpleNamespace
from typing import Any

import pytest

from esi_drive_bridge.protocol import AxisCommand
from esi_drive_bridge.protocol import Command
from esi_drive_bridge.protocol import Mode
from rugged_teleop import demo
from rugged_teleop.demo_actor import Actor
from rugged_teleop.demo_actor import Late
from rugged_teleop.demo_actor import Missed
from rugged_teleop.demo_actor import shortened
from rugged_teleop.demo_handover import Handover
from rugged_teleop.demo_scene import Scene
from rugged_teleop.demo_stage import demo_config
from rugged_teleop.demo_stage import Packet
from rugged_teleop.demo_stage import packets_in
from rugged_teleop.domains import claim_domain
from rugged_teleop.ports import Chunk
from test.demo_rig import FakeStage
from test.demo_rig import STILL
from test.demo_rig import TURN
from test.rig import ROOT
from test.rig import wait_for

# By hand from the ESI manual, 4.2; CRC-16/CCITT-FALSE over the six bytes of the body.
DISABLE = bytes.fromhex('f0f0 040000 040000 71d4')


# Packets on the drive's wire.


def test_packet_split_over_reads_counts_from_its_last_byte() -> None:
    chunks = [Chunk(1.0, DISABLE + DISABLE[:4]), Chunk(1.01, DISABLE[4:])]
    assert [packet.at for packet in packets_in(chunks, 0.0)] == [1.0, 1.01]
    assert [packet.at for packet in packets_in(chunks, 1.0)] == [1.01]
    assert not any(packet.enables for packet in packets_in(chunks, 0.0))


def test_corrupt_packet_is_no_disable_packet() -> None:
    assert packets_in([Chunk(1.0, DISABLE[:-1] + b'\0')], 0.0) == []


def test_enabled_axis_at_zero_enables_and_does_not_move() -> None:
    at_rest = AxisCommand(True, False, Mode.VELOCITY, 0)
    packet = Packet(0.0, Command((AxisCommand(), at_rest)))
    assert packet.enables
    assert not packet.moves
    assert Packet(0.0, TURN).moves


def test_demo_brings_its_own_configuration() -> None:
    assert demo_config() == ROOT / 'config' / 'demo.yaml'


def test_two_demos_get_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('RMW_IMPLEMENTATION', raising=False)
    names = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS')
    for name in (*names, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):
        monkeypatch.setenv(name, 'x')
    with claim_domain():
        first = os.environ['ROS_DOMAIN_ID']
        with claim_domain():
            assert os.environ['ROS_DOMAIN_ID'] != first
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SYSTEM_DEFAULT'
    profile = Path(os.environ['FASTDDS_DEFAULT_PROFILES_FILE'])
    assert '<address>127.0.0.1</address>' in profile.read_text(encoding='utf-8')
    assert 'ROS_STATIC_PEERS' not in os.environ


# A scene that can fail: what it must notice.


def stop_with(delay: float, *, again: bool = False, patience: float = 1.0) -> str:
    """Let the scene measure a stop whose first disable packet comes ``delay`` s after it."""
    now = time.monotonic()
    stage = FakeStage(Packet(now - 0.01, TURN))
    actor: Any = Actor(stage, patience)  # type: ignore[arg-type]
    actor._sleep = lambda: None  # nobody was late

    def act() -> float:
        stage.all_packets += (Packet(now + delay, STILL),)
        if again:
            stage.all_packets += (Packet(now + delay + 0.01, TURN),)
        return now

    return str(actor.stopped('a stop', act, 0.15))


def test_stop_in_time_is_measured() -> None:
    assert 'disabled 20.0 ms after' in stop_with(0.02)


def test_stop_that_comes_too_late_is_missed() -> None:
    with pytest.raises(Missed, match=r'disabled 200.0 ms .* allowed are 150 ms'):
        stop_with(0.2)
    with pytest.raises(Missed, match=r'disabled 310.0 ms .* allowed are 300 ms'):
        stop_with(0.31, patience=2.0)
    assert 'disabled 290.0 ms' in stop_with(0.29, patience=2.0)


def test_late_stop_is_tried_again_and_told_but_not_for_ever() -> None:
    actor: Any = Actor(FakeStage())  # type: ignore[arg-type]
    actor.wait_for_state = lambda state: None
    undone: list[str] = []
    tries: Iterator[Late | str] = iter([Late('320 ms'), '280 ms'])

    def stop() -> str:
        happened = next(tries)
        if isinstance(happened, Late):
            raise happened
        return happened

    assert actor.repeated(stop, lambda: undone.append('undone')) == '280 ms; at first: 320 ms'
    assert undone == ['undone']
    tries = itertools.repeat(Late('320 ms'))
    with pytest.raises(Late):
        actor.repeated(stop, lambda: None)


def test_enable_packet_after_the_stop_is_missed() -> None:
    with pytest.raises(Missed, match='1 packets after the first disable packet enable again'):
        stop_with(0.02, again=True)


def test_enable_packet_while_nothing_may_move_is_missed() -> None:
    actor = Actor(FakeStage(Packet(2.0, STILL), Packet(3.0, TURN)))  # type: ignore[arg-type]
    with pytest.raises(Missed, match='enables the drive'):
        actor.still(1.0)


def test_end_of_all_packets_is_missed() -> None:
    actor: Any = Actor(FakeStage())  # type: ignore[arg-type]
    actor.wait = partial(actor.wait, limit=0.5)
    with pytest.raises(Missed, match='no packets at all'):
        actor.still(1.0)


@pytest.mark.parametrize(
    ('reply', 'expected'),
    [
        ((True, 'reset: READY'), 'it was accepted'),
        ((False, 'not reset: a held or repeated reset does nothing'), 'not because'),
    ],
)
def test_wrong_restart_that_is_not_refused_for_its_reason_is_missed(
    reply: tuple[bool, str], expected: str
) -> None:
    actor: Any = Actor(FakeStage())  # type: ignore[arg-type]
    actor.watcher.call = lambda service: reply
    with pytest.raises(Missed, match=expected):
        actor.refused_reset('is not at neutral')


def test_wrong_restart_that_a_time_out_refuses_first_is_tried_again() -> None:
    replies = iter(
        [
            (False, "not reset: e-stop source 'fort' is silent: never heard, limit 250 ms"),
            (False, "not reset: operator 'fort' is not at neutral"),
        ]
    )
    actor: Any = Actor(FakeStage())  # type: ignore[arg-type]
    actor.watcher.call = lambda service: next(replies)
    assert actor.refused_reset('is not at neutral').endswith('is not at neutral')


def keep_fort(owner: str, *speeds: int) -> str:
    """Let the scene watch that FORT keeps control, as the mux names this owner."""
    now = time.monotonic()
    commands = [Command((AxisCommand(True, False, Mode.VELOCITY, speed),) * 2) for speed in speeds]
    stage = FakeStage(Packet(now, TURN), *(Packet(now + 60.0, command) for command in commands))
    stage.watcher = SimpleNamespace(state='ACTIVE', message='', values={'owner': owner})
    return Handover(stage)._keep_fort(lambda: None)  # type: ignore[arg-type]


def test_fort_that_keeps_control_is_told() -> None:
    assert keep_fort('fort', 500, 500) == 'FORT keeps control, 2 packets'


def test_lower_operator_that_takes_control_is_missed() -> None:
    with pytest.raises(Missed, match='VM-110 has control'):
        keep_fort('vm110', 500)


def test_packet_as_the_lower_operator_asks_is_missed() -> None:
    with pytest.raises(Missed, match='as VM-110 asks'):
        keep_fort('fort', 500, -500)


def rearm(*, closed: bool) -> str:
    """Let the scene rearm a base unit whose relays are open, or ``closed``, before that."""
    stage: Any = FakeStage(Packet(time.monotonic() + 60.0, STILL))
    stage.watcher.clear = lambda name: True
    seen: dict[str, Any] = {'eg_link': 'Operational', 'relays_closed': closed}

    def apply(command: str) -> float:
        seen['relays_closed'] |= command == 'arm 1'
        return 1.0

    stage.vsc = stage.unit = SimpleNamespace(apply=apply, describe=lambda: seen)
    handover: Any = Handover(stage)
    handover.unit_says = lambda since, wanted: 1.0
    return str(handover.close_relays())


def test_relays_that_close_without_being_rearmed_are_missed() -> None:
    assert rearm(closed=False) == 'closed by rearming; 1 packets, all disable'
    with pytest.raises(Missed, match='without being rearmed'):
        rearm(closed=True)


def test_failed_step_ends_the_scene_and_says_so() -> None:
    lines: list[str] = []

    def fail() -> str:
        raise Missed('it did not')

    def never() -> str:
        raise AssertionError('what follows a failed step tells nothing')

    class Short(Scene):
        @property
        def steps(self) -> list[tuple[str, Callable[[], str]]]:
            return [('one', lambda: 'fine'), ('two', fail), ('three', never)]

    assert not Short(FakeStage(), lines.append).play()  # type: ignore[arg-type]
    assert lines[:2] == ['ok      one: fine', 'FAILED  two: it did not']
    assert '1 of 3 expectations held, one did not, 1 were not tried' in lines[2]
    assert lines[-1] == 'its last words'


def test_long_reason_fits_a_line() -> None:
    assert shortened(200 * 'x', 10) == 'xxxxxxxxx…'
    assert shortened('short') == 'short'


# The command.


def test_live_view_without_a_terminal_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdin, 'isatty', lambda: False, raising=False)
    with pytest.raises(SystemExit) as caught:
        demo.main([])
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert error.count('\n') == 1
    assert '--once' in error


@pytest.mark.parametrize('patience', ['0.5', 'nan', 'much'])
def test_patience_is_a_factor_of_1_or_more(
    patience: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        demo.main(['--once', '--patience', patience])
    assert caught.value.code == 2
    assert '--patience' in capsys.readouterr().err


def test_demo_without_msgpack_names_it_in_one_line(tmp_path: Path) -> None:
    """ROS brings python-can without it, and the monitor's bus needs it."""
    (tmp_path / 'msgpack.py').write_text("raise ImportError('there is none')\n")
    result = subprocess.run(
        [sys.executable, '-m', 'rugged_teleop.demo', '--once'],
        cwd=ROOT,
        env={**os.environ, 'PYTHONPATH': str(tmp_path), 'PYTHONDONTWRITEBYTECODE': '1'},
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    assert result.returncode == 1
    assert result.stderr.count('\n') == 1
    assert 'msgpack not installed' in result.stderr


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def scratch_environment(tmp_path: Path) -> dict[str, str]:
    return {**os.environ, 'TMPDIR': str(tmp_path), 'TERM': 'xterm'}


def test_scene_holds_and_leaves_nothing_behind(tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, '-m', 'rugged_teleop.demo', '--once', '--patience', '8'],
        cwd=ROOT,
        env=scratch_environment(tmp_path),
        capture_output=True,
        text=True,
        timeout=280.0,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert 'FAILED' not in result.stdout
    stops = re.findall(r'^ +[\d.]+ ms  ', result.stdout, re.MULTILINE)
    assert len(stops) == 19
    process = re.search(r'in process (\d+)', result.stdout)
    assert process is not None
    assert not is_alive(int(process[1]))
    assert list(tmp_path.iterdir()) == []


class Terminal:
    """The demo on a terminal of its own."""

    def __init__(self, tmp_path: Path) -> None:
        self.master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', 40, 120, 0, 0))
        os.set_blocking(self.master, False)
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'rugged_teleop.demo'],
            cwd=ROOT,
            env=scratch_environment(tmp_path),
            stdin=slave,
            stdout=slave,
            stderr=slave,
        )
        os.close(slave)
        self.shown = ''

    def read(self) -> str:
        """Return all that was shown since the last text that was waited for."""
        with contextlib.suppress(BlockingIOError):
            self.shown += os.read(self.master, 65536).decode(errors='replace')
        return self.shown

    def wait(self, text: str) -> None:
        """Wait until it is shown, after the last that was waited for."""

        wait_for(lambda: text in self.read(), 30.0, lambda: f'{text!r} in {self.shown[-2000:]!r}')
        self.shown = self.shown.partition(text)[2]

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def press_until(self, key: str, text: str) -> None:
        """Press a key that may be refused for a while, once a second."""
        pressed_at = 0.0

        def found() -> bool:
            nonlocal pressed_at
            if time.monotonic() - pressed_at > 1.0:
                pressed_at = time.monotonic()
                self.press(key)
            return text in self.read()

        wait_for(found, 30.0, lambda: f'{text!r} in {self.shown[-2000:]!r}')

    def end(self) -> int:
        """Read on, or it could not write its last words; return its exit status."""

        def ended() -> bool:
            with contextlib.suppress(OSError):
                os.read(self.master, 65536)
            return self.process.poll() is not None

        wait_for(ended, 15.0, 'its end')
        return self.process.returncode

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            self.end()
        os.close(self.master)


def test_keyboard_resets_drives_and_stops(tmp_path: Path) -> None:
    with Terminal(tmp_path) as terminal:
        terminal.wait('space  e-stop')
        terminal.wait('waiting for reset')
        terminal.press_until('ar', "press the deadman of 'fort'")
        terminal.press_until('m', 'remote 1 armed')
        terminal.press('d')
        terminal.wait('ACTIVE')
        terminal.press('\x1bOA')  # up
        terminal.wait('enable velocity')
        terminal.press('h')
        terminal.wait('told turn')
        terminal.press(' ')
        terminal.wait('disable velocity')
        terminal.wait('relays OPEN')
        terminal.press(' ')
        terminal.press_until('am', 'relays closed')
        terminal.press('q')
        assert terminal.end() == 0
    assert list(tmp_path.iterdir()) == []


def test_terminated_demo_leaves_nothing_behind(tmp_path: Path) -> None:
    with Terminal(tmp_path) as terminal:
        terminal.wait('mux')
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.end() == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
