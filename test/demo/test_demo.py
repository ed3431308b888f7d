# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo: its scene can fail, its command line is checked, and it leaves nothing behind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import fcntl
import itertools
import os
from pathlib import Path
import re
import struct
import subprocess
import sys
import termios
import time
from types import SimpleNamespace
from typing import Any

import pytest

from demo import __main__ as demo
from demo.scene import from_rest, Scene
from demo.stage import _timeouts
from demo.steering import Late, Steering, Step
from rugged_teleop.domains import claim_domain
from rugged_teleop.ports import Chunk
from stage.devices import Packet, packets_in
from stage.rig import ROOT, run_python, wait_for
from stage.toy_rig import children_of, is_running
from test.demo.demo_rig import FakeStage, still, turn

pytestmark = pytest.mark.waits(90)
# By hand from the ESI manual, 4.2; CRC-16/CCITT-FALSE over the six bytes of the body.
DISABLE = bytes.fromhex('f0f0 040000 040000 71d4')
LOST = "operator 'fort' held its deadman before it could count: release it"


# Packets on the drive's wire.


def test_packet_counts_from_its_last_byte_and_a_corrupt_one_not_at_all() -> None:
    chunks = [Chunk(1.0, DISABLE + DISABLE[:4]), Chunk(1.01, DISABLE[4:])]
    packets = list(packets_in([*chunks, Chunk(2.0, DISABLE[:-1] + b'\0')]))
    assert packets == [still(1.0), still(1.01)]
    assert not any(packet.enables for packet in packets)
    at_zero = Packet(0.0, (4, 5), (500, 0))
    assert (at_zero.enables, at_zero.moves, turn(0.0).moves) == (True, False, True)


def test_patience_multiplies_what_the_demos_file_has_or_else_the_default() -> None:
    given = set(_timeouts(2.0))
    assert 'safety_mux:neutral_time:=1.0' in given  # 0.5 in config/demo.yaml
    assert 'esi_drive_bridge:command_timeout:=0.2' in given


def test_two_demos_get_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('RMW_IMPLEMENTATION', raising=False)
    names = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS')
    profiles = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
    for name in (*names, *profiles, 'ROS_LOCALHOST_ONLY'):
        monkeypatch.setenv(name, 'x')
    with claim_domain():
        first = os.environ['ROS_DOMAIN_ID']
        with claim_domain():
            assert os.environ['ROS_DOMAIN_ID'] != first
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SYSTEM_DEFAULT'
    profile = Path(os.environ['FASTDDS_DEFAULT_PROFILES_FILE'])
    assert '<address>127.0.0.1</address>' in profile.read_text(encoding='utf-8')
    assert 'ROS_STATIC_PEERS' not in os.environ
    assert 'ROS_LOCALHOST_ONLY' not in os.environ  # with it rcl adds shared memory to any profile


# A scene that can fail: what it must notice.


def stop_with(
    delay: float, *, again: bool = False, patience: float = 1.0, timed: bool = True
) -> str:
    """Let the scene measure a stop whose first disable packet comes ``delay`` s after it."""
    now = time.monotonic()
    stage = FakeStage(turn(now - 0.01))

    def act() -> float:
        stage.drive.all_packets += (still(now + delay),)
        if again:
            stage.drive.all_packets += (turn(now + delay + 0.01),)
        return now

    steering: Any = Steering(stage, patience, timed=timed)
    steering._spin = lambda seconds: None  # nobody was late
    return str(steering.stopped('a stop', act, 0.15))


@pytest.mark.parametrize(
    ('delay', 'options', 'says'),
    [
        (0.02, {}, 'disabled 20.0 ms after'),
        (0.29, {'patience': 2.0}, 'disabled 290.0 ms'),
        (0.2, {'timed': False}, 'disabled 200.0 ms'),
    ],
)
def test_stop_in_time_or_untimed_is_measured(
    delay: float, options: dict[str, Any], says: str
) -> None:
    assert says in stop_with(delay, **options)


def climb(*values: int) -> list[Packet]:
    """Return what a drive gets that is asked for motion 0.6 s after enable."""
    return [turn(0.0, 0), turn(0.6, 0), *(turn(0.6, value) for value in values)]


@pytest.mark.parametrize(
    ('show', 'says'),
    [
        (lambda: stop_with(0.2), r'disabled 200.0 ms .* allowed are 150 ms'),
        (lambda: stop_with(0.31, patience=2.0), r'disabled 310.0 ms .* allowed are 300 ms'),
        (lambda: stop_with(0.2, again=True, timed=False), 'enable again'),
        (lambda: stop_with(0.02, again=True), '1 packets after the first disable .* enable again'),
        (lambda: Steering(FakeStage(still(2.0), turn(3.0))).still(1.0), 'disable packets only'),
        (lambda: Steering(FakeStage()).still(1.0), 'packets, which never end'),
        (lambda: from_rest(climb(955)), 'a step of 955 rpm'),
        (lambda: from_rest([turn(0.0, 0), turn(0.3, 38)]), r'0\.30 s after enable'),
        (lambda: refused((True, 'reset: READY')), 'it was accepted'),
        (lambda: refused((False, 'not reset: repeated'), afterwards=False), 'for something else'),
        (lambda: keep_fort('vm110', 500), 'VM-110 has control'),
        (lambda: keep_fort('fort', 500, -500), 'as VM-110 asks'),
        (lambda: rearm(closed=True), 'without being rearmed'),
    ],
)
def test_what_must_not_be_is_missed(show: Callable[[], str], says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        show()


def test_what_is_as_it_should_be_is_reported() -> None:
    assert from_rest(climb(38, 77)) == 'first motion 0.60 s after enable, no step above 39 rpm'
    assert keep_fort('fort', 500, 500) == 'FORT keeps control, 2 packets'
    assert rearm(closed=False) == 'closed by rearming; 1 packets, all disable'


def test_late_stop_is_tried_again_and_reported_but_not_for_ever() -> None:
    steering = Steering(
        FakeStage(stopped_by="e-stop source 'fort'")
    )  # that it was a timeout is not why
    undone: list[str] = []
    tries: Iterator[Late | str] = iter([Late('320 ms'), '280 ms'])

    def stop() -> str:
        happened = next(tries)
        if isinstance(happened, Late):
            raise happened
        return happened

    assert steering.retry(stop, lambda: undone.append('undone')) == '280 ms; at first: 320 ms'
    assert undone == ['undone']
    tries = itertools.repeat(Late('320 ms'))
    with pytest.raises(Late):
        steering.retry(stop, lambda: None)


@pytest.mark.parametrize(
    ('fields', 'again'),
    [
        ({'stopped_by': "e-stop source 'fort'"}, True),
        ({'stopped_by': 'stall'}, True),
        ({'stopped_by': 'none'}, False),
        ({'stopped_by': 'trip'}, False),
        ({'stopped_by': 'motion'}, False),
        (
            {
                'stopped_by': "e-stop source 'fort'",
                "condition_of_e-stop_source_'fort'": 'invalid',
            },
            False,
        ),
        ({'state': 'ACTIVE', 'drive_enabled': 'false'}, True),
        ({'state': 'ACTIVE', 'drive_enabled': 'true'}, False),
        ({'state': 'READY', 'message': LOST}, True),
        ({'state': 'READY', 'message': "press the deadman of 'fort' to take control"}, False),
    ],
)
def test_only_what_a_timeout_has_stopped_is_tried_again(
    fields: dict[str, str], again: bool
) -> None:
    well = {
        "condition_of_operator_'fort'": 'rested',
        "condition_of_e-stop_source_'fort'": 'clear',
    }
    steering: Any = Steering(FakeStage(**(well | fields)))
    recovered: list[str] = []
    steering._recover = lambda: recovered.append('recovered')
    tries = iter([AssertionError('it stopped')])

    def act() -> str:
        for error in tries:
            raise error
        return 'it moves'

    if again:
        assert steering.retry(act).startswith('it moves; at first: ')
    else:
        with pytest.raises(AssertionError, match='it stopped'):
            steering.retry(act)
    assert bool(recovered) is again


@pytest.mark.parametrize('fields', [{'state': 'STOPPED'}, {'state': 'READY', 'message': LOST}])
def test_motion_that_cannot_come_any_more_is_not_waited_for(fields: dict[str, str]) -> None:
    steering = Steering(FakeStage(**fields), patience=1000.0)
    with pytest.raises(AssertionError, match='the mux says'):
        steering.wait_in_motion(lambda: False)


def refused(reply: tuple[bool, str], afterwards: bool = True) -> str:
    """Let the scene call for a reset that must be refused, with this answer."""
    stage: Any = FakeStage()
    stage.reset = lambda: SimpleNamespace(success=reply[0], message=reply[1])
    return Steering(stage).refused_reset(lambda: True, lambda: afterwards)


def keep_fort(owner: str, *speeds: int) -> str:
    """Let the scene watch that FORT keeps control, as the mux names this owner."""
    now = time.monotonic()
    later = (turn(now + 60.0, speed) for speed in speeds)
    stage = FakeStage(turn(now), *later, state='ACTIVE', owner=owner)
    return Scene(stage).keep_fort(lambda: None)


def rearm(*, closed: bool) -> str:
    """Let the scene rearm a base unit whose relays are open, or ``closed``, before that."""
    stage: Any = FakeStage(still(time.monotonic() + 60.0))
    stage.is_clear = lambda name: True
    seen: dict[str, Any] = {'eg_link': 'Operational', 'relays_closed': closed}

    def apply(*commands: str) -> float:
        seen['relays_closed'] |= 'arm 1' in commands
        return 1.0

    stage.vsc = stage.unit = SimpleNamespace(apply=apply, describe=lambda: seen)
    scene: Any = Scene(stage)
    scene.unit_says = lambda since, wanted: 1.0
    return str(scene.close_relays())


def test_failed_step_ends_the_scene_and_says_so() -> None:
    lines: list[str] = []

    def fail() -> str:
        raise AssertionError('it did not')

    def never() -> str:
        lines.append('what follows a failed step shows nothing')
        return ''

    class Short(Scene):
        @property
        def steps(self) -> list[Step]:
            return [('one', lambda: 'fine'), ('two', fail), ('three', never)]

    assert not Short(FakeStage()).play(lines.append)
    assert lines[:2] == ['ok      one: fine', 'FAILED  two: it did not']
    assert '1 of 3 expectations held, one did not, 1 were not tried' in lines[2]
    assert lines[-1] == 'its last words'


# The command.


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [([], '--once'), *((['--once', '--patience', p], '--patience') for p in ('0.5', 'nan', 'x'))],
)
def test_no_terminal_and_patience_below_1_are_one_line_and_status_2(
    arguments: list[str],
    word: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys.stdin, 'isatty', lambda: False, raising=False)
    with pytest.raises(SystemExit) as caught:
        demo.main(arguments)
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert error.count('\n') == 1
    assert word in error


def test_scene_that_did_not_hold_names_patience(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = SimpleNamespace(play=lambda _: False)
    monkeypatch.setattr('demo.__main__.signal.signal', lambda *_: None)
    monkeypatch.setattr('demo.__main__.open_stage', lambda *_: None)
    monkeypatch.setattr('demo.__main__.Scene', lambda *_, **__: scene)
    with pytest.raises(SystemExit, match='1'):
        demo.main(['--once', '--patience', '2'])
    assert capsys.readouterr().err.endswith('--patience 4\n')


def test_demo_without_msgpack_names_it_in_one_line(tmp_path: Path) -> None:
    """ROS brings python-can without it, and the monitor's bus needs it."""
    (tmp_path / 'msgpack.py').write_text("raise ImportError('there is none')\n")
    env = {**os.environ, 'PYTHONPATH': str(tmp_path), 'PYTHONDONTWRITEBYTECODE': '1'}
    result = run_python('-m', 'demo', '--once', env=env)
    assert result.returncode == 1
    assert result.stderr.count('\n') == 1
    assert 'msgpack not installed' in result.stderr


def scratch_environment(tmp_path: Path) -> dict[str, str]:
    # Sizes of a terminal, where one is given, count before its own.
    kept = {name: text for name, text in os.environ.items() if name not in ('COLUMNS', 'LINES')}
    return {**kept, 'TMPDIR': str(tmp_path), 'TERM': 'xterm'}


def scene(tmp_path: Path) -> subprocess.CompletedProcess[str]:
    try:
        return run_python(
            *('-m', 'demo', '--once', '--patience', '3', '--untimed'),
            env=scratch_environment(tmp_path),
            timeout=280.0,
            start_new_session=True,  # with a share of the processors of its own
        )
    except subprocess.TimeoutExpired as late:
        raise AssertionError((late.stdout or b'').decode()) from late


def test_scene_holds_and_leaves_nothing_behind(tmp_path: Path) -> None:
    result = scene(tmp_path)
    waited = re.search(r'This machine kept us waiting (\d+) ms', result.stdout)
    if waited is not None and int(waited[1]) > 300:  # more than that patience: a stop
        result = scene(tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    assert 'FAILED' not in result.stdout
    stops = re.findall(r'^ +[\d.]+ ms  ', result.stdout, re.MULTILINE)
    assert len(stops) == 20
    process = re.search(r'in process (\d+)', result.stdout)
    assert process is not None
    assert not is_running(int(process[1]))
    assert list(tmp_path.iterdir()) == []


class Terminal:
    """The demo on a terminal of its own."""

    def __init__(self, tmp_path: Path) -> None:
        self.master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', 40, 120, 0, 0))
        os.set_blocking(self.master, False)
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'demo'],
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


def test_live_view_takes_keys_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """What each key does: test_demo_view.py."""
    with Terminal(tmp_path) as terminal:
        terminal.wait('space  e-stop')
        terminal.press('?')
        terminal.wait("'?' is no key of the demo")
        terminal.press('q')
        assert terminal.end() == 0
    assert list(tmp_path.iterdir()) == []


def test_killed_demo_leaves_no_node_behind(tmp_path: Path) -> None:
    with Terminal(tmp_path) as terminal:
        terminal.wait('mux')
        nodes = children_of(terminal.process.pid)
        assert nodes
        terminal.process.kill()
        wait_for(lambda: not any(map(is_running, nodes)), 5.0, 'the end of the nodes')
