# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Challenges and proofs: their bytes, what a reader believes, and every kind of bad message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
import struct
from types import SimpleNamespace
from typing import Any
from zlib import crc32

from hypothesis import example, given, strategies as st
import pytest

from bridge_core.proof import (
    Challenge,
    Heard,
    LATELY,
    nanoseconds,
    PERIOD,
    Proof,
    ProofError,
    Reader,
    Stamps,
    TOGETHER_TIME,
    Vouched,
    WorstAge,
    Writer,
)

NOW = 64.0
SILENCE = 0.5
ME, OTHER = 0x0102030405060708, 2
WRITER, TWIN = 77, 78
ONE = Proof(WRITER, 5, 2, 1, estop=False, own_estop=False, newest=9, answers=((ME, -3),))


def test_layouts_worked_out_by_hand() -> None:
    body = b'RC\1\0' + bytes(range(8, 0, -1)) + struct.pack('<q', 5_000_000_000)
    assert Challenge(ME, 5_000_000_000).to_bytes() == body + struct.pack('<I', crc32(body))
    body = b'RP\1\7' + struct.pack('<QQIIqIQq', 3, 4, 5, 6, 7, 10, 8, 9)
    proof = Proof(3, 4, 5, 6, True, True, True, 7, ((8, 9),), 10)
    assert proof.to_bytes() == body + struct.pack('<I', crc32(body))


U64, U32, I64 = (
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**32 - 1),
    st.integers(-(2**63), 2**63 - 1),
)
FLAG = st.booleans()
ANSWERS = st.lists(st.tuples(U64, I64), max_size=16)
AGE = st.none() | st.integers(0, 2**32 - 2)


PROOFS = st.builds(Proof, U64, U64, U32, U32, FLAG, FLAG, FLAG, I64, ANSWERS.map(tuple), AGE)


@given(PROOFS)
def test_round_trip(proof: Proof) -> None:
    assert Proof.from_bytes(proof.to_bytes()) == proof


@pytest.mark.parametrize(
    ('age', 'heard'),
    [(math.inf, math.inf), (0.0, 0.0), (0.0611, 0.062), (10.0, 10.0), (1e9, 4294967.294)],
)
def test_age_of_what_the_writer_goes_by_is_rounded_up_to_ms(age: float, heard: float) -> None:
    writer = Writer(WRITER)
    writer.age = age
    news = Reader(ME, SILENCE).hear(writer.proof(NOW), NOW)
    assert news is not None
    assert news.age == heard


@pytest.mark.parametrize('kind', [Challenge, Proof])
@given(data=st.binary(max_size=120))
def test_noise_is_nothing(kind: type[Challenge | Proof], data: bytes) -> None:
    with pytest.raises(ProofError):
        kind.from_bytes(data)


def test_every_flipped_bit_and_every_cut_is_found() -> None:
    for message, kind in ((ONE.to_bytes(), Proof), (Challenge(ME, 1).to_bytes(), Challenge)):
        for bit in range(8 * len(message)):
            spoilt = bytearray(message)
            spoilt[bit // 8] ^= 1 << bit % 8
            with pytest.raises(ProofError):
                kind.from_bytes(bytes(spoilt))
        for size in range(len(message)):
            with pytest.raises(ProofError):
                kind.from_bytes(message[:size])


CUT_PROOF, LONG_CHALLENGE = ONE.to_bytes()[:-4] + b'\0', Challenge(ME, 1).to_bytes()[:-4] + b'\0'


@pytest.mark.parametrize(
    ('kind', 'body', 'words'),
    [
        *((Challenge, head + bytes(16), 'begins with') for head in (b'RC\2\0', b'RX\1\0')),
        (Challenge, b'RP\1\0' + bytes(16), 'begins with'),
        (Challenge, b'RC\1', 'damaged'),
        (Proof, b'RP\1', 'damaged'),
        (Proof, CUT_PROOF, 'a proof of'),  # half an answer
        (Challenge, LONG_CHALLENGE, 'a challenge of'),
    ],
)
def test_message_of_another_form_is_none_though_its_check_is_right(
    kind: type[Challenge | Proof], body: bytes, words: str
) -> None:
    with pytest.raises(ProofError, match=words):
        kind.from_bytes(body + struct.pack('<I', crc32(body)))


# -- a writer -------------------------------------------------------------------------------------


def proof_of(writer: Writer, now: float = NOW) -> Proof:
    return Proof.from_bytes(writer.proof(now))


def test_writer_counts_stops_and_numbers_its_proofs() -> None:
    writer = Writer(WRITER)
    first = proof_of(writer)
    assert first == Proof(WRITER, 1, 0, 0, True, True)
    for _ in range(2):
        assert not writer.say(estop=False, own_estop=False)
    assert writer.say(estop=True, own_estop=False)
    assert not writer.say(estop=True, own_estop=False)
    assert writer.say(estop=True, own_estop=True)
    assert not writer.say(estop=True, own_estop=True)
    assert writer.say(estop=False, own_estop=False, enable=True)
    writer.vouch(123)
    last = proof_of(writer)
    assert (last.number, last.stops, last.own_stops) == (2, 1, 1)
    assert (last.estop, last.own_estop, last.enable, last.newest) == (False, False, True, 123)


def test_writer_answers_the_newest_challenge_of_each_reader_for_a_while() -> None:
    writer = Writer(WRITER)
    for reader, when, answered in (
        (ME, 5, True),
        (ME, 7, True),
        (ME, 6, False),
        (ME, 7, False),
        (OTHER, 1, True),
    ):
        assert writer.hear(Challenge(reader, when).to_bytes(), NOW) is answered
    assert not writer.hear(b'nonsense', NOW)
    assert writer.damaged == 1
    assert proof_of(writer).answers == ((ME, 7), (OTHER, 1))
    writer.hear(Challenge(OTHER, 2).to_bytes(), NOW + LATELY / 2)
    assert proof_of(writer, NOW + LATELY).answers == ((OTHER, 2),)


def test_writer_answers_sixteen_readers_and_another_once_one_is_gone() -> None:
    writer = Writer(WRITER)
    assert all(writer.hear(Challenge(each, 1).to_bytes(), NOW) for each in range(16))
    assert not writer.hear(Challenge(99, 1).to_bytes(), NOW)
    assert writer.hear(Challenge(9, 2).to_bytes(), NOW)
    assert writer.hear(Challenge(99, 1).to_bytes(), NOW + LATELY)


# -- a reader -------------------------------------------------------------------------------------


class Exchange:
    """A reader and its writer, with a channel that takes no time unless it is told to."""

    def __init__(self) -> None:
        self.now = NOW
        self.reader, self.writer = Reader(ME, SILENCE), Writer(WRITER)
        self.writer.say(estop=False, own_estop=False)

    def ask(self) -> None:
        self.writer.hear(self.reader.challenge(self.now), self.now)

    def turn(self, delay: float = 0.0) -> Any:
        """Ask and hear the answer so much later."""
        self.ask()
        data = self.writer.proof(self.now)
        self.now += delay
        return self.reader.hear(data, self.now)


def test_age_is_that_of_the_challenge_and_grows_in_silence() -> None:
    it = Exchange()
    assert it.reader.age(NOW) == math.inf
    it.turn(delay=0.25)
    assert it.reader.as_of == NOW
    assert it.reader.age(it.now) == 0.25
    assert it.reader.age(it.now + 1.0) == 1.25
    it.turn()
    assert it.reader.age(it.now) == 0.0


@given(st.floats(0.0, 1e7))
@example(math.nextafter(100.52, 0.0))  # 100.52 when rounded to ns
def test_answer_at_once_is_not_from_the_future(now: float) -> None:
    it = Exchange()
    it.now = now
    it.turn()
    assert 0.0 <= it.reader.age(now) < 4e-9


def test_answer_to_somebody_else_or_to_what_was_never_asked_proves_nothing() -> None:
    it = Exchange()
    it.ask()
    for number, answers in enumerate([(), ((OTHER, 64_000_000_000),), ((ME, 63_999_999_999),)], 1):
        assert it.reader.hear(replace(ONE, number=number, answers=answers).to_bytes(), NOW)
        assert it.reader.as_of == -math.inf
    assert it.reader.unasked == 1
    it.reader.challenge(NOW - 1.0)  # by a clock that runs backwards
    late = replace(ONE, number=9, answers=((ME, round((NOW - 1.0) * 1e9)),))
    assert it.reader.hear(late.to_bytes(), NOW)
    assert (it.reader.as_of, it.reader.unasked) == (-math.inf, 2)


def test_older_answer_does_not_make_it_older() -> None:
    it = Exchange()
    it.ask()
    early = it.writer.proof(it.now)
    it.now += PERIOD
    it.turn()
    newest = it.reader.as_of
    assert it.reader.hear(early, it.now) is None
    assert (it.reader.as_of, it.reader.repeated) == (newest, 1)
    data = it.writer.proof(it.now)
    assert it.reader.hear(data, it.now) is not None
    assert it.reader.hear(data, it.now) is None  # the same one again
    assert it.reader.hear(b'noise', it.now) is None
    assert (it.reader.repeated, it.reader.damaged) == (2, 1)


@pytest.mark.parametrize(
    ('says', 'stopped', 'own_stopped'),
    [
        ([], False, False),
        ([(True, True)], True, True),
        ([(True, True), (False, False)], True, True),  # came and went between two proofs
        ([(True, False), (False, False)], True, False),
        ([(True, False), (False, False)] * 3, True, False),
    ],
)
def test_stop_between_two_proofs_is_told(
    says: list[tuple[bool, bool]], stopped: bool, own_stopped: bool
) -> None:
    it = Exchange()
    heard = it.turn()
    assert (heard.stopped, heard.own_stopped) == (False, False)
    for estop, own in says:
        it.writer.say(estop=estop, own_estop=own)
    for _ in range(3):
        it.writer.proof(it.now)  # lost
    heard = it.turn()
    assert (heard.stopped, heard.own_stopped) == (stopped, own_stopped)
    heard = it.turn()
    still = says[-1:] == [(True, True)]
    assert (heard.stopped, heard.own_stopped) == (still, still)


def test_second_writer_beside_the_first_is_a_stop_for_three_seconds() -> None:
    it = Exchange()
    it.turn()
    twin = replace(ONE, writer=TWIN, answers=((ME, round(NOW * 1e9)),))
    heard = it.reader.hear(twin.to_bytes(), it.now)
    assert heard == Heard(True, True, True, True, False, 0, NOW)
    assert it.reader.writer == WRITER
    assert it.reader.is_doubled(it.now + TOGETHER_TIME - 0.125)
    assert not it.reader.is_doubled(it.now + TOGETHER_TIME)


def test_writer_that_was_restarted_has_stopped_and_proves_its_age_anew() -> None:
    it = Exchange()
    it.turn()
    it.now += SILENCE
    it.writer = Writer(TWIN)
    it.writer.say(estop=False, own_estop=False)
    heard = it.reader.hear(it.writer.proof(it.now), it.now)
    assert heard is not None
    assert (heard.stopped, heard.own_stopped, heard.as_of) == (True, True, -math.inf)
    assert (heard.estop, heard.own_estop) == (False, False)
    heard = it.turn()
    assert (heard.stopped, heard.as_of) == (False, it.now)


# -- what has a stamp -----------------------------------------------------------------------------


def test_message_is_as_old_as_the_newest_proof_by_which_it_was_the_newest() -> None:
    vouched = Vouched()
    assert vouched.as_of(5) == -math.inf
    vouched.prove(0, 0.5)  # it has said nothing
    vouched.prove(50, 1.0)
    vouched.prove(100, 2.0)
    assert vouched.as_of(49) == -math.inf
    assert (vouched.as_of(99), vouched.as_of(100), vouched.as_of(101)) == (1.0, 2.0, 2.0)
    vouched.prove(100, 3.0)  # it still is
    assert (vouched.as_of(99), vouched.as_of(100)) == (1.0, 3.0)
    vouched.prove(200, 4.0)
    assert (vouched.as_of(100), vouched.as_of(200)) == (3.0, 4.0)
    assert vouched.as_of(-1) == -math.inf


SECOND = 1_000_000_000  # ns


@pytest.mark.parametrize(
    ('proofs', 'stamp', 'as_of'),
    [
        ([(100, 1.0), (40, 2.0)], 41, 2.0),
        ([(10, 0.5), (100, 1.0), (50, 2.0)], 50, 2.0),
        ([(10, 0.5), (100, 1.0), (50, 2.0)], 49, -math.inf),
        ([(100, 1.0), (40, 2.0)], 99, -math.inf),  # of before the clock was set back
        ([(100, 1.0), (40, 2.0)], 160, -math.inf),  # of before, too: a proof of it was lost
        ([(100, 1.0), (40, 2.0), (45, 7.0)], 99, -math.inf),
        ([(100, 1.0), (40, 2.0), (80, 42.0)], 99, 42.0),  # nothing is on its way for that long
        ([(100, 1.0), (40, 2.0), (100, 3.0)], 101, 3.0),  # and was set forth again
        ([(40, 1.0)], 100, 1.0),  # set forth alone
        ([(100, 1.0), (0, 2.0)], 100, 1.0),  # of before a restart: it has said nothing since
        ([(100, 1.0), (0, 2.0), (101, 2.5)], 101, 2.5),
        ([(100, 1.0), (0, -math.inf), (40, -math.inf), (45, 2.0)], 99, -math.inf),
    ],
)
def test_message_of_before_the_clock_was_set_back_is_old_however_late_it_comes(
    proofs: Sequence[tuple[int, float]], stamp: int, as_of: float
) -> None:
    vouched = Vouched()
    for newest, at in proofs:
        vouched.prove(newest * SECOND, at)
    found = vouched.as_of(stamp * SECOND)
    assert found == as_of or (as_of == -math.inf and found < proofs[0][1] - 20.0)


@pytest.mark.parametrize(
    ('clock', 'stamps'),
    [
        ([5, 6, 9], [5, 6, 9]),
        ([5, 5, 5, 9], [5, 6, 7, 9]),  # paused
        ([10**9, 1, 2], [10**9, 10**9 + 1, 10**9 + 2]),  # a step back that is slewed over
        ([3 * 10**9, 10**9, 10**9], [3 * 10**9, 10**9, 10**9 + 1]),  # it was set
    ],
)
def test_stamps_grow_unless_the_clock_was_set_back(clock: list[int], stamps: list[int]) -> None:
    made = Stamps()
    assert [made.next(each) for each in clock] == stamps


def test_stamp_of_a_header_is_in_ns() -> None:
    assert nanoseconds(SimpleNamespace(sec=2, nanosec=3)) == 2_000_000_003


def test_worst_age_is_that_of_the_last_one_to_two_seconds_and_unknown_while_nobody_knows() -> None:
    worst, found = WorstAge(), []
    notes = ((0.2, 0.0), (0.1, 0.9), (0.1, 1.0), (0.1, 2.0), (math.inf, 2.1), (0.1, 2.2))
    for age, now in notes:
        worst.note(age, now)
        found.append(worst.value)
    assert found == [0.2, 0.2, 0.2, 0.1, math.inf, 0.1]
