# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Dialogues with the menus, on a simulated clock, with the simulated SSC and with worse.

The property that counts: whatever happens, what is said of the unit afterwards is true.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from ssc_bridge.config.image import Image
from ssc_bridge.config.menus import Dialogue, readable, Screen, screen_of, Script
from ssc_bridge.config.scripts import ENTRY, ENTRY_TRIES, Maintenance, POWER_CYCLE, Standing
from ssc_bridge.simulator import Settings, Simulator, sums
from ssc_bridge.simulator.menus import Terminal
from stage.ssc_rig import VECTORS

pytestmark = pytest.mark.computes
GOLDEN = Image.parse('\n'.join(VECTORS['config_image']['lines']))
OTHERS = Settings(config_id=42)  # a unit without a valid configuration has other ones
STEP = 0.005  # seconds; an answer takes as long
LONGEST = 200.0

EVERY_TERMINAL = pytest.mark.parametrize(
    'terminal', [Terminal(echoes, asks) for echoes in (False, True) for asks in (False, True)]
)


Change = Callable[[bytes], bytes]


@dataclass
class Bench:
    """
    A unit that somebody switches off and on when told to, and a dialogue with it.

    :ivar to_unit, from_unit: change the bytes of one moment on their way.
    :ivar chunk: the dialogue gets so many bytes at a time.
    """

    simulator: Simulator = field(default_factory=lambda: Simulator(OTHERS))
    unit: Maintenance = field(default_factory=Maintenance)
    to_unit: Change = lambda data: data
    from_unit: Change = lambda data: data
    chunk: int = 4096
    latency: float = 0.0  # seconds, of what the unit says
    cancel_at: float = LONGEST
    unplug_at: float = LONGEST
    obeys: bool = True  # the user does what is asked
    now: float = 0.0
    lines: list[str] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    under_way: list[tuple[float, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.before = self.simulator.memory.stored
        self.simulator.poll(0.0)
        self.now = 1000.0  # it has run for long
        self.started = self.now
        self.simulator.poll(self.now)

    def dump(self) -> Dialogue:
        return self.converse(self.unit.dump())

    def restore(self, image: Image = GOLDEN) -> Dialogue:
        return self.converse(self.unit.restore(image))

    def converse(self, script: Script[Image]) -> Dialogue:
        dialogue = Dialogue(script)
        cancelled = False
        while not dialogue.done and self.elapsed < self.unplug_at:
            assert self.elapsed < LONGEST, 'it never ends'
            if self.elapsed >= self.cancel_at and not cancelled:
                dialogue.cancel()
                cancelled = True
            self._host(dialogue)
            self._device(dialogue)
            self.now += STEP
        return dialogue

    @property
    def elapsed(self) -> float:
        return self.now - self.started

    def _host(self, dialogue: Dialogue) -> None:
        lines, keys = dialogue.poll(self.now)
        self.lines += lines
        if POWER_CYCLE in lines and self.obeys:
            self.simulator.apply('reboot')
        if keys:
            self.sent.append((self.now, keys))
            self.simulator.receive(self.to_unit(keys), self.now)

    def _device(self, dialogue: Dialogue) -> None:
        data = b''.join(self.simulator.poll(self.now))
        if data:
            self.under_way.append((self.now + self.latency, self.from_unit(data)))
        while self.under_way and self.under_way[0][0] <= self.now:
            _, data = self.under_way.pop(0)
            for start in range(0, len(data), self.chunk):
                dialogue.receive(data[start : start + self.chunk], self.now)
                lines, keys = dialogue.poll(self.now)
                assert not keys, 'it pressed a key before the unit had finished'
                self.lines += lines

    @property
    def keys(self) -> bytes:
        return b''.join(keys for _, keys in self.sent)

    @property
    def sending(self) -> bool:
        """The image is being sent: I was pressed last, but for digits."""
        return b'I' in self.keys.replace(ENTRY, b'') and self.sent[-1][1] != b'I'

    @property
    def drives(self) -> bool:
        self.simulator.poll(self.now + 1.0)
        return self.simulator.operates

    def assert_truth(self) -> None:
        """What is said of the unit holds."""
        stored = self.simulator.memory.stored
        if self.unit.standing in (Standing.UNSEEN, Standing.UNCHANGED):
            assert stored == self.before
        if self.unit.standing is Standing.STORED:
            assert stored == GOLDEN.data
        if self.unit.standing is Standing.SPOILT:
            assert stored not in (self.before, GOLDEN.data)
        if not self.unit.in_menus:
            assert self.simulator._menu is None
            if self.unit.standing in (Standing.UNCHANGED, Standing.STORED):
                assert self.drives


def harm(at: int, bit: int) -> Change:
    """Flip one bit of one byte of all that passes; 8: lose that byte."""
    passed = 0

    def change(data: bytes) -> bytes:
        nonlocal passed
        place, passed = at - passed, passed + len(data)
        if not 0 <= place < len(data):
            return data
        harmed = bytes([data[place] ^ 1 << bit]) if bit < 8 else b''
        return data[:place] + harmed + data[place + 1 :]

    return change


# Reading.


@EVERY_TERMINAL
def test_dump_reads_what_is_stored_and_leaves_the_unit_running(terminal: Terminal) -> None:
    bench = Bench(Simulator(image=GOLDEN.data, terminal=terminal))
    dialogue = bench.dump()
    assert dialogue.result == GOLDEN == bench.unit.image
    assert bench.lines == [POWER_CYCLE]
    assert bench.unit.how_it_stands == Standing.UNCHANGED.value
    assert bench.drives
    assert bench.simulator.memory.saves == bench.simulator.memory.erasures == 0


WAYS: list[dict[str, Any]] = [
    *({'chunk': chunk} for chunk in (1, 2, 3, 7, 64)),
    *({'latency': latency} for latency in (0.02, 0.1, 0.3, 0.6)),
]


@pytest.mark.parametrize('way', WAYS, ids=str)
def test_dump_reads_any_split_and_waits_for_a_slow_unit(way: dict[str, Any]) -> None:
    bench = Bench(Simulator(image=GOLDEN.data), **way)
    assert bench.dump().result == GOLDEN
    assert bench.drives


@pytest.mark.parametrize('keys', [b'', b'1', b'c', b'2', b'13', b'ci', b'ci01', b'cd'])
def test_menus_left_open_are_restarted_and_nothing_unsaved_is_read(keys: bytes) -> None:
    bench = Bench(Simulator(image=GOLDEN.data))
    bench.simulator.apply('reboot')
    bench.simulator.poll(bench.now + 1.0)
    bench.simulator.receive(b'ssconfig' + b'1b99\r0' + keys, bench.now + 1.0)
    bench.now += 1.0
    bench.simulator.poll(bench.now)
    assert bench.dump().result == GOLDEN
    assert POWER_CYCLE not in bench.lines
    assert bench.drives


@pytest.mark.parametrize('mute', [True, False])
def test_unit_that_nobody_switches_off_or_that_is_silent_is_given_up(mute: bool) -> None:
    bench = Bench(obeys=False)
    bench.simulator.apply(f'mute {"on" if mute else "off"}')
    assert 'no menu within 60 s' in str(bench.dump().error)
    assert bench.keys.count(ENTRY) == ENTRY_TRIES
    assert bench.unit.how_it_stands == Standing.UNSEEN.value
    assert bench.drives


def with_a_line_of_zeros() -> bytes:
    """Return an image whose sums stay right where the fourth line is lost."""
    body = bytearray(GOLDEN.data[:-2])
    body[104:152] = bytes(48)  # no constants
    body[6] = next(n for n in range(256) if (sum(body[:108]) - body[6] + n) % 64 == 0)
    return bytes(body) + sums(bytes(body))


def losing_zeros(times: int, then: tuple[bytes, bytes] = (b'', b'')) -> Change:
    """Lose a line of zeros of so many images. :param then: what is another thing afterwards."""
    left = times

    def change(data: bytes) -> bytes:
        nonlocal left
        place = data.find(b'0' * 72 + b'\r\n')
        if place < 0:
            return data
        left -= 1
        return data[:place] + data[place + 74 :] if left >= 0 else data.replace(*then)

    return change


ZEROS = with_a_line_of_zeros()
SHORT = ZEROS[:108] + ZEROS[144:]
READINGS: list[tuple[bytes, Callable[[], Change], bytes | None, int]] = [
    # What is stored, what becomes of it on its way, what is read, and how often it is asked for.
    (ZEROS, lambda: losing_zeros(0), ZEROS, 1),
    (ZEROS, lambda: losing_zeros(1), ZEROS, 2),  # the sums did not see the line that was lost
    (ZEROS, lambda: losing_zeros(2), SHORT, 2),  # another size counts once it came twice alike
    (ZEROS, lambda: losing_zeros(1, (b'4E20', b'4E21')), None, 2),
    (GOLDEN.data, lambda: lambda data: data.replace(b'C87C', b'C87D'), None, 2),
]


@pytest.mark.parametrize(('stored', 'harm_it', 'result', 'times'), READINGS)
def test_image_counts_if_it_is_sound_and_of_a_size_that_is_known_or_came_twice(
    stored: bytes, harm_it: Callable[[], Change], result: bytes | None, times: int
) -> None:
    bench = Bench(Simulator(image=stored), from_unit=harm_it())
    dialogue = bench.dump()
    assert dialogue.result == bench.unit.image == (None if result is None else Image(result))
    assert ('no sound image in two tries' in str(dialogue.error)) is (result is None)
    assert bench.keys.replace(ENTRY, b'').count(b'D') == times
    assert bench.unit.how_it_stands == Standing.UNCHANGED.value
    assert bench.drives


# Writing.


@EVERY_TERMINAL
def test_restore_loads_checks_saves_restarts_and_reads_back(terminal: Terminal) -> None:
    bench = Bench(Simulator(OTHERS, terminal=terminal))
    assert bench.restore().result == GOLDEN
    assert bench.unit.how_it_stands == Standing.STORED.value
    assert bench.simulator.memory.stored == GOLDEN.data
    assert (bench.simulator.memory.saves, bench.simulator.memory.erasures) == (1, 0)
    assert bench.drives
    progress = [line for line in bench.lines if line.endswith('bytes sent')]
    assert progress == [f'{n} of 220 bytes sent' for n in (36, 72, 108, 144, 180, 216, 220)]


def digit_changed(place: int) -> Callable[[Bench], None]:
    def change_it(bench: Bench) -> None:
        digits = 0

        def change(data: bytes) -> bytes:
            nonlocal digits
            digits += bench.sending and data.isalnum()
            return b'B' if digits == place + 1 and data.isalnum() else data

        bench.to_unit = change

    return change_it


def locked_out(bench: Bench) -> None:
    """Lock it out behind the restart."""

    def change(data: bytes) -> bytes:
        if data == ENTRY and bench.simulator.memory.saves:
            bench.simulator._locked = True
        return data

    bench.to_unit = change


def habits(
    *, asks: bool = False, takes: int, echoes: bool = False, latency: float = 0.0
) -> Callable[[Bench], None]:
    def change(bench: Bench) -> None:
        bench.simulator.terminal = Terminal(echoes, asks, takes_digits=takes)
        bench.latency = latency

    return change


FAILED: list[tuple[Callable[[Bench], Any], str, Standing, int]] = [
    # What harms it, what is said of that, how the unit stands, and how often it saved something.
    *(
        (habits(echoes=echoes, asks=asks, takes=taken), 'FAILED', Standing.UNCHANGED, 0)
        for echoes in (False, True)
        for asks in (False, True)
        for taken in (0, 1, 17, 18, 72, 300, 400)
    ),
    *(
        (digit_changed(place), 'did not take the image', Standing.UNCHANGED, 0)
        for place in (0, 77, 434)
    ),
    (
        lambda bench: bench.simulator.apply('memory worn'),
        'does not hold what was saved',
        Standing.UNCHANGED,
        1,
    ),
    (locked_out, 'lock it out', Standing.SAVING, 1),
    # Digits go on for 0.5 s: 4, which is refused, then E, which erases it, then 2 ...
    (habits(takes=304, latency=0.5), 'stopped listening', Standing.SPOILT, 0),
]


@pytest.mark.parametrize(('harm_it', 'words', 'standing', 'saves'), FAILED)
def test_restore_that_fails_says_how_the_unit_stands(
    harm_it: Callable[[Bench], Any], words: str, standing: Standing, saves: int
) -> None:
    bench = Bench()
    harm_it(bench)
    assert words in str(bench.restore().error)
    assert bench.unit.standing is standing
    assert bench.simulator.memory.saves == saves
    assert bool(bench.simulator.memory.erasures) is (standing is Standing.SPOILT)
    bench.assert_truth()


def test_image_of_another_size_is_not_sent() -> None:
    body = GOLDEN.data[:-2] + b'\0'
    bench = Bench()
    assert 'has 221 bytes' in str(bench.restore(Image(body + sums(body))).error)
    assert b'I' not in bench.keys.replace(ENTRY, b'')
    assert bench.unit.standing is Standing.UNCHANGED
    assert bench.drives


def test_unit_that_was_erased_is_told_and_mended() -> None:
    bench = Bench(to_unit=lambda data: b'E' if data == b'D' else data)
    assert bench.dump().error is not None
    assert bench.simulator.memory.erasures == 1
    assert bench.unit.standing is Standing.GARBLED
    bench = Bench()
    bench.simulator.apply('memory erased')
    assert bench.restore().result == GOLDEN
    assert bench.drives


# Truth, whatever happens.


@pytest.mark.proof
@settings(max_examples=100)
@given(at=st.integers(0, 520), bit=st.integers(0, 8))
def test_byte_harmed_on_its_way_to_the_unit_is_never_hidden(at: int, bit: int) -> None:
    bench = Bench(to_unit=harm(at, bit))
    bench.restore()
    bench.assert_truth()


@pytest.mark.proof
@settings(max_examples=60)
@given(at=st.integers(0, 8000), bit=st.integers(0, 8))
def test_byte_harmed_on_its_way_from_the_unit_is_never_hidden(at: int, bit: int) -> None:
    bench = Bench(Simulator(Settings(config_id=42, rates=[0] * 5)), from_unit=harm(at, bit))
    bench.restore()
    bench.assert_truth()


@settings(max_examples=40)
@given(at=st.floats(0.0, 19.0))
def test_unplugged_at_any_moment_is_told_truthfully(at: float) -> None:
    bench = Bench(unplug_at=at)
    bench.restore()
    bench.assert_truth()


@settings(max_examples=40)
@given(at=st.floats(0.0, 19.0))
def test_interrupted_at_any_moment_ends_outside_the_menus_and_truthfully(at: float) -> None:
    bench = Bench(cancel_at=at)
    dialogue = bench.restore()
    assert dialogue.done
    assert bench.unit.standing in (Standing.UNSEEN, Standing.UNCHANGED, Standing.STORED)
    assert not bench.unit.in_menus
    bench.assert_truth()
    assert bench.drives


@settings(max_examples=20)
@given(data=st.lists(st.binary(max_size=200), max_size=20))
def test_garbage_for_an_answer_raises_nothing_and_changes_nothing(data: list[bytes]) -> None:
    dialogue = Dialogue(Maintenance().restore(GOLDEN))
    now = 0.0
    pieces = iter(data)
    while not dialogue.done:
        dialogue.poll(now)
        dialogue.receive(next(pieces, b''), now)
        now = max(dialogue.deadline, now + 0.2)
        assert now < LONGEST
    assert dialogue.error is not None


@pytest.mark.parametrize(
    'answer',
    [b'login: ', b'SERVICE MENU\r\n1) Burn\r\nSelect : ', b'MAIN MENU', b'\xff' * 500],
)
def test_wrong_menus_end_in_an_error_and_meet_no_dangerous_key(answer: bytes) -> None:
    unit = Maintenance()
    dialogue = Dialogue(unit.dump())
    now, keys = 0.0, b''
    while not dialogue.done:
        _, pressed = dialogue.poll(now)
        keys += pressed
        if pressed:
            dialogue.receive(answer, now)
        now += 0.05
        assert now < LONGEST
    assert isinstance(dialogue.error, Exception)
    assert unit.standing is Standing.UNSEEN  # it was none
    assert 'the SSC answers' not in str(dialogue.error)
    assert set(keys.replace(ENTRY, b'')) <= set(b'R0\r')
    assert unit.in_menus == (b'Select' in answer)


# Screens.


@pytest.mark.parametrize(
    ('text', 'screen'),
    [
        ('', None),
        ('MAIN MENU\r\n1) I/O Setup', None),
        ('MAI N MENU\n1) 1/0 Setup\nSel ect :', Screen.MAIN),  # as it was scanned
        ('\x1b[2J\x1b[1;1HMAIN MENU\r\nSelect : ', Screen.MAIN),
        ("'[2J'[1;1Hmain menu select:", Screen.MAIN),  # ESC as the manual prints it
        ('MAIN MENU Select : S) Save to NV Memory Select : ', Screen.CONFIG),
        ('S) Save to NV Memory Select : MAIN MENU Select :', Screen.MAIN),
        ('S) Save to NV Memory Select : ---- Waiting For Image ----', Screen.WAITING),
        ('---- Waiting For Image ---- bad. S) Save to NV Memory Select : ', Screen.CONFIG),
        ('I/O SETUP\r\nSelect : ', Screen.OTHER),
        ('MAIN MENU Select : I/O SETUP Select : ', Screen.OTHER),
    ],
)
def test_screen_is_told_by_what_was_shown_last(text: str, screen: Screen | None) -> None:
    assert screen_of(text) is screen


def test_verdict_is_shown_without_the_menu_behind_it() -> None:
    text = '\r\nLoad OK.\x07\r\n\x1b[2J\x1b[1;1HS) Save to NV Memory\r\nL) Reload'
    assert readable(text) == 'Load OK.'
