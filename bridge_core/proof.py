# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How old at most is what another process says? And was a stop among what was lost?

Messages that come regularly may all be old: a queue on the way shows no gap. So a reader sends
challenges, and the writer returns the newest one in its proofs. A proof is no older than the
challenge that it returns, by the reader's own clock. It carries the verdicts of that moment and
how many stops there were. A stop between two proofs shows by its number, however many messages
were lost.

Both are bytes, little endian, on a std_msgs/UInt8MultiArray:

=========  ======================================================================================
challenge  'RC', version 1, a zero; reader (8); when it was asked, ns of the reader's clock (8)
proof      'RP', version 1, flags; writer (8); number (8); stops, own stops (4 each); newest (8);
           age (4); then for each reader that was heard lately its identity (8) and what it asked
           (8)
=========  ======================================================================================

Each ends with its CRC-32 (ISO-HDLC, 4 bytes). Identities are random, for the life of a process.
Flags are estop (1), own_estop (2) and enable (4). ``newest`` is the stamp of the newest Joy,
command or feedback that the writer has published, in ns; 0: none. ``age`` is how old at most, in
ms, is what the writer itself goes by: a remote's bridge by its device, a drive by the mux; all
ones: unknown.
Of a mux, own_estop is the absence of enable, and own stops count how often enable became false.

What may go wrong on the way, in the words of IEC 61784-3, and what notices it: corruption (CRC),
unintended repetition and incorrect sequence (number), loss (numbers of stops; age), unacceptable
delay (age), insertion and masquerade (identities, and a challenge that was asked by this reader
alone), addressing (the same; two writers are a stop). There is no secret in it: whoever may
publish on the network may lie.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math
import os
import struct
from typing import Any
from zlib import crc32

PERIOD = 0.05  # s between two challenges
LATELY = 1.0  # s for which a reader that is silent still gets its answer, and ages are worst
TOGETHER_TIME = 3.0  # s for which two writers count as such after both were heard
_MOST_READERS = 16
_KEPT = 512  # challenges, 25 s; an answer to one before tells nothing
_LONG = _KEPT * PERIOD  # s; above all limits, and nothing is on its way for longer
_SET_BACK = 1_000_000_000  # ns; a clock that is further back was set

_CHALLENGE = struct.Struct('<2sBxQq')
_PROOF = struct.Struct('<2sBBQQIIqI')
_ANSWER = struct.Struct('<Qq')
_CRC = struct.Struct('<I')
LARGEST = _PROOF.size + _MOST_READERS * _ANSWER.size + _CRC.size  # bytes of a proof
_VERSION = 1
_ESTOP, _OWN_ESTOP, _ENABLE = 1, 2, 4
_UNKNOWN = 0xFFFFFFFF  # ms


class ProofError(ValueError):
    """Bytes that are no challenge or no proof; damaged, or of another version."""


@dataclass(frozen=True, slots=True)
class Challenge:
    """A reader's question. :param asked: ns of its clock."""

    reader: int
    asked: int

    def to_bytes(self) -> bytes:
        """Return the message."""
        return _sealed(_CHALLENGE.pack(b'RC', _VERSION, self.reader, self.asked))

    @classmethod
    def from_bytes(cls, data: bytes) -> Challenge:
        """Read a message. :raises ProofError: it is none."""
        body = _unsealed(data, b'RC', _CHALLENGE)
        if len(body) != _CHALLENGE.size:
            raise ProofError(f'a challenge of {len(body)} bytes')
        _, _, reader, asked = _CHALLENGE.unpack(body)
        return cls(reader, asked)


@dataclass(frozen=True, slots=True)
class Proof:
    """
    What a writer says at one moment.

    :param number: of this proof, from 1 on. :param stops: how often estop became true, and
        ``own_stops`` own_estop, since the writer began; both modulo 2 ** 32.
    :param newest: stamp of the newest Joy, command or feedback, ns. :param answers: what each
        reader asked last, by its identity. :param age: of what the writer goes by, at most, ms;
        None: unknown.
    """

    writer: int
    number: int
    stops: int
    own_stops: int
    estop: bool
    own_estop: bool
    enable: bool = False
    newest: int = 0
    answers: tuple[tuple[int, int], ...] = ()
    age: int | None = None

    def to_bytes(self) -> bytes:
        """Return the message."""
        flags = self.estop * _ESTOP | self.own_estop * _OWN_ESTOP | self.enable * _ENABLE
        numbers = (self.writer, self.number, self.stops, self.own_stops, self.newest)
        age = _UNKNOWN if self.age is None else min(self.age, _UNKNOWN - 1)
        head = _PROOF.pack(b'RP', _VERSION, flags, *numbers, age)
        return _sealed(head + b''.join(_ANSWER.pack(*answer) for answer in self.answers))

    @classmethod
    def from_bytes(cls, data: bytes) -> Proof:
        """Read a message. :raises ProofError: it is none."""
        body = _unsealed(data, b'RP', _PROOF)
        if (len(body) - _PROOF.size) % _ANSWER.size:
            raise ProofError(f'a proof of {len(body)} bytes')
        _, _, flags, writer, number, stops, own_stops, newest, age = _PROOF.unpack_from(body)
        return cls(
            *(writer, number, stops, own_stops),
            estop=bool(flags & _ESTOP),
            own_estop=bool(flags & _OWN_ESTOP),
            enable=bool(flags & _ENABLE),
            newest=newest,
            answers=tuple(_ANSWER.iter_unpack(body[_PROOF.size :])),
            age=None if age == _UNKNOWN else age,
        )


class Writer:
    """
    Whoever says something of safety.

    :param identity: random, 64 bits. :param lately: s for which a silent reader gets its answer.
    """

    def __init__(self, identity: int, lately: float = LATELY) -> None:
        self.identity = identity
        self.damaged = 0  # challenges that are none
        self.age = math.inf  # s, at most, of what the writer itself goes by; infinite: unknown
        self._lately = lately
        self._number = self._stops = self._own_stops = 0
        self._estop = self._own_estop = True
        self._enable = False
        self._newest = 0
        self._asked: dict[int, tuple[int, float]] = {}  # by reader: what, and when it came

    def hear(self, data: bytes, now: float) -> bool:
        """Take a challenge; tell whether it is to be answered."""
        try:
            challenge = Challenge.from_bytes(data)
        except ProofError:
            self.damaged += 1
            return False
        known = self._asked.get(challenge.reader)
        if known is None and len(self._readers(now)) >= _MOST_READERS:
            return False
        if known is not None and challenge.asked <= known[0]:
            return False
        self._asked[challenge.reader] = challenge.asked, now
        return True

    def say(self, *, estop: bool, own_estop: bool, enable: bool = False) -> bool:
        """Note what holds from now on; tell whether that is to be proven at once, as a stop is."""
        began, own_began = estop and not self._estop, own_estop and not self._own_estop
        self._stops = (self._stops + began) & 0xFFFFFFFF
        self._own_stops = (self._own_stops + own_began) & 0xFFFFFFFF
        turned = enable != self._enable
        self._estop, self._own_estop, self._enable = estop, own_estop, enable
        return began or own_began or turned

    def vouch(self, stamp: int) -> None:
        """Note the stamp of the newest Joy, command or feedback, ns."""
        self._newest = stamp

    def proof(self, now: float) -> bytes:
        """Return the next proof."""
        self._number += 1
        return Proof(
            *(self.identity, self._number, self._stops, self._own_stops),
            *(self._estop, self._own_estop, self._enable, self._newest),
            answers=tuple(self._readers(now).items()),
            age=None if self.age == math.inf else math.ceil(self.age * 1e3),
        ).to_bytes()

    def _readers(self, now: float) -> dict[int, int]:
        """Return what each asked who was heard lately; forget the others."""
        self._asked = {
            reader: known for reader, known in self._asked.items() if now - known[1] < self._lately
        }
        return {reader: asked for reader, (asked, _) in self._asked.items()}


@dataclass(frozen=True, slots=True)
class Heard:
    """
    What a proof tells.

    :param stopped: estop has become true since the proof before, or is true; ``own_stopped``
        likewise. :param as_of: it is no older than this (s of the reader's clock); -inf: no
        answer to a challenge of ours has come yet. :param age: s, at most, of what the writer
        itself goes by; infinite: unknown.
    """

    estop: bool
    own_estop: bool
    stopped: bool
    own_stopped: bool
    enable: bool
    newest: int
    as_of: float
    age: float = math.inf


class Reader:
    """
    Whoever decides on what one writer says.

    :param identity: random, 64 bits. :param silence: s after which a writer that is not heard is
        gone, and another one may have its place.
    """

    def __init__(self, identity: int, silence: float) -> None:
        self.as_of = -math.inf  # what was heard is no older (s); -inf: nobody knows
        self.writer: int | None = None
        self.damaged = 0  # messages that are no proof
        self.repeated = 0  # proofs that are no newer than one before
        self.unasked = 0  # answers to what was not asked
        self._identity = identity
        self._silence = silence
        self._asked: deque[float] = deque(maxlen=_KEPT)  # when, by the clock; to the ns
        self._heard_at = self._second_at = -math.inf
        self._number = 0
        self._stops = self._own_stops = 0

    def challenge(self, now: float) -> bytes:
        """Return a question; to be sent each PERIOD."""
        asked = round(now * 1e9)
        if asked / 1e9 > now:  # an answer at once would be from the future
            asked = math.floor(math.nextafter(now * 1e9, -math.inf))
        if not self._asked or asked / 1e9 > self._asked[-1]:
            self._asked.append(asked / 1e9)
        return Challenge(self._identity, asked).to_bytes()

    def age(self, now: float) -> float:
        """Return how old at most is what was heard, s; infinite: nobody knows."""
        return now - self.as_of

    def is_doubled(self, now: float) -> bool:
        """Tell whether two writers were heard beside each other not long ago."""
        return now - self._second_at < TOGETHER_TIME

    def hear(self, data: bytes, now: float) -> Heard | None:
        """Take a message; None: it says nothing new. Two writers are a stop of both kinds."""
        try:
            proof = Proof.from_bytes(data)
        except ProofError:
            self.damaged += 1
            return None
        if proof.writer != self.writer:
            if self.writer is not None and now - self._heard_at < self._silence:
                self._second_at = now
                return Heard(True, True, True, True, False, 0, self.as_of)
            begins = self.writer is not None  # who was restarted had stopped meanwhile
            self.writer, self.as_of = proof.writer, -math.inf
        elif proof.number <= self._number:
            self.repeated += 1
            return None
        else:
            begins = False
        stopped = begins or proof.estop or proof.stops != self._stops
        own_stopped = begins or proof.own_estop or proof.own_stops != self._own_stops
        self._number, self._heard_at = proof.number, now
        self._stops, self._own_stops = proof.stops, proof.own_stops
        self._note_answer(proof)
        return Heard(
            *(proof.estop, proof.own_estop, stopped, own_stopped, proof.enable, proof.newest),
            as_of=self.as_of,
            age=math.inf if proof.age is None else proof.age / 1e3,
        )

    def _note_answer(self, proof: Proof) -> None:
        for reader, asked in proof.answers:
            if reader != self._identity:
                continue
            if asked / 1e9 not in self._asked:
                self.unasked += 1
                continue
            self.as_of = max(self.as_of, asked / 1e9)
            while self._asked[0] < self.as_of:
                self._asked.popleft()


class Stamps:
    """
    Stamps of all that goes out, each above the one before: by them proofs say what is the newest.

    A clock that stands, such as a simulation's that is paused, does not make two alike.
    """

    def __init__(self) -> None:
        self._newest = 0

    def next(self, now: int) -> int:
        """Return the next one. :param now: ns, by the clock of the node."""
        if 0 <= self._newest - now < _SET_BACK:
            now = self._newest + 1
        self._newest = now
        return now


class Vouched:
    """
    How old messages with a stamp are at most, such as Joys, by the proofs of their writer.

    A message is no older than the newest proof by which it was published already, or a later one.
    One that is far ahead of the newest proof, not long after the writer's clock was set back, is
    from before.
    """

    def __init__(self) -> None:
        self._known: deque[tuple[int, float]] = deque(maxlen=_KEPT)  # stamp, and as of when
        self._set_back_at = -math.inf

    def prove(self, newest: int, as_of: float) -> None:
        """Note a proof: its ``newest`` stamp, 0 if there is none, and as of when it is."""
        if not newest:
            return
        if self._known and newest <= self._known[-1][0]:
            if newest < self._known[-1][0]:  # the writer's clock was set back
                self._set_back_at = max(as_of, self._known[-1][1])
                self._known.clear()
            else:
                self._known.pop()
        self._known.append((newest, as_of))

    def as_of(self, stamp: int) -> float:
        """Return the moment before which a message was not the newest one; -inf: nobody knows."""
        newest, as_of = self._known[-1] if self._known else (stamp, -math.inf)
        if stamp > newest + _SET_BACK and as_of < self._set_back_at + _LONG:
            return self._set_back_at - _LONG
        return next(
            (as_of for newest, as_of in reversed(self._known) if newest <= stamp), -math.inf
        )


class WorstAge:
    """The greatest of the ages that were noted in the last one to two seconds."""

    def __init__(self) -> None:
        self._newest, self._worst, self._worst_before = math.inf, 0.0, 0.0
        self._since = -math.inf

    def note(self, age: float, now: float) -> None:
        """Note an age, s; infinite: nobody knows, and until another one is noted."""
        if now >= self._since + LATELY:
            self._worst_before, self._worst, self._since = self._worst, 0.0, now
        self._newest = age
        if age < math.inf:
            self._worst = max(self._worst, age)

    @property
    def value(self) -> float:
        """It, s; infinite: nobody knows."""
        return max(self._worst, self._worst_before) if self._newest < math.inf else math.inf


def new_identity() -> int:
    """Return 64 random bits; the module ``secrets`` would bring 4 MB of cryptography."""
    return int.from_bytes(os.urandom(8), 'big')


def nanoseconds(stamp: Any) -> int:
    """Return the stamp of a header, as ``Vouched`` and ``Writer.vouch`` take it."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _sealed(body: bytes) -> bytes:
    return body + _CRC.pack(crc32(body))


def _unsealed(data: bytes, kind: bytes, layout: struct.Struct) -> bytes:
    """Return all but the CRC. :raises ProofError: damaged, too short, or something else."""
    body, check = data[: -_CRC.size], data[-_CRC.size :]
    if len(body) < layout.size or _CRC.pack(crc32(body)) != check:
        raise ProofError('damaged')
    if body[:3] != kind + bytes((_VERSION,)):
        raise ProofError(f'begins with {body[:3].hex()}')
    return body
