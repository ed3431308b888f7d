# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A million messages with each kind of fault that IEC 61784-3 names, and a million sound ones.

``python -m assurance.black_channel [-n COUNT] [--seed N] [FAULT...]``: what happens on the way to
challenges and proofs of bridge_core/proof.py, and whether reader and writer notice. A fault that
nobody notices, or a sound message that is taken for a bad one, is exit status 1.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
import random
import sys
import time
from typing import Final

from bridge_core.proof import Challenge, PERIOD, Proof, Reader, Writer

_COUNT = 1_000_000
_SILENCE = 0.5  # s
_LIMIT = 0.25  # s, as age_limit is delivered
_LATEST = 10.0  # s
_MOST_LOST = 5
_ROUNDING = 1e-6  # s; challenges carry ns


class Link:
    """A writer, a reader, and what carries messages between them soundly, in motion."""

    def __init__(self, chance: random.Random) -> None:
        self.chance = chance
        self.now = 1000.0
        self.writer, self.reader = Writer(self.number()), Reader(self.number(), _SILENCE)
        self.writer.say(estop=False, own_estop=False)
        self.reader.hear(self.proof(), self.now)

    def number(self) -> int:
        """Return a random identity."""
        return self.chance.getrandbits(64)

    def proof(self) -> bytes:
        """Return the proof that answers a question of now."""
        self.now += PERIOD
        self.writer.hear(self.reader.challenge(self.now), self.now)
        return self.writer.proof(self.now)

    def damaged(self, data: bytes) -> bytes:
        """Flip bits anywhere, overwrite a stretch, cut or lengthen it."""
        chance, found = self.chance, data
        while found == data:
            spoilt = bytearray(data)
            how = chance.randrange(4)
            if how == 0:
                for _ in range(chance.randint(1, 8)):
                    spoilt[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            elif how == 1:
                begin = chance.randrange(len(data))
                end = min(len(data), begin + chance.randint(1, 8))
                spoilt[begin:end] = chance.randbytes(end - begin)
            elif how == 2:
                del spoilt[chance.randrange(len(data)) :]
            else:
                spoilt += chance.randbytes(chance.randint(1, 32))
            found = bytes(spoilt)
        return found

    def is_ignored(self, data: bytes) -> bool:
        """Tell whether the reader takes nothing from a message, and trusts nothing longer."""
        before = self.reader.as_of
        return self.reader.hear(data, self.now) is None and self.reader.as_of == before

    def is_no_younger(self, data: bytes) -> bool:
        """Tell whether what a message says is no reason to trust anything for longer."""
        before = self.reader.as_of
        self.reader.hear(data, self.now)
        return self.reader.as_of <= before


def sound(link: Link) -> bool:
    """Carry it in up to 100 ms each way; tell whether it is taken, is no stop, and young."""
    asked = link.reader.challenge(link.now)
    link.now += link.chance.uniform(0.0, 0.1)
    link.writer.hear(asked, link.now)
    data = link.writer.proof(link.now)
    link.now += link.chance.uniform(0.001, 0.1)
    heard = link.reader.hear(data, link.now)
    young = link.reader.age(link.now) < _LIMIT
    return heard is not None and not (heard.stopped or heard.own_stopped) and young


def corruption(link: Link) -> bool:
    if link.chance.random() < 0.5:
        return link.is_ignored(link.damaged(link.proof()))
    return not link.writer.hear(link.damaged(link.reader.challenge(link.now)), link.now)


def repetition(link: Link) -> bool:
    """Hear a proof again, at once or after some newer ones; or a question."""
    asked, data = link.reader.challenge(link.now), link.proof()
    for _ in range(link.chance.randint(0, 2)):
        link.reader.hear(data, link.now)
        link.reader.hear(link.proof(), link.now)
    link.reader.hear(data, link.now)
    return link.is_ignored(data) and not link.writer.hear(asked, link.now)


def wrong_order(link: Link) -> bool:
    """Have newer proofs overtake one in which a stop ended."""
    link.writer.say(estop=True, own_estop=True)
    stop = link.proof()
    link.writer.say(estop=False, own_estop=False)
    heard = link.reader.hear(link.proof(), link.now)
    return heard is not None and heard.stopped and heard.own_stopped and link.is_ignored(stop)


def loss(link: Link) -> bool:
    """Lose all proofs of a stop; the next one tells of it. Others that are lost are no stop."""
    for is_stop in (False, True):
        own = link.chance.random() < 0.5
        for _ in range(link.chance.randint(1, _MOST_LOST)):
            if is_stop:
                link.writer.say(estop=True, own_estop=own)
            link.proof()
        link.writer.say(estop=False, own_estop=False)
        heard = link.reader.hear(link.proof(), link.now)
        told = (is_stop, is_stop and own)
        if heard is None or (heard.stopped, heard.own_stopped) != told:
            return False
    return True


def delay(link: Link) -> bool:
    """Have question or proof arrive late: it is known to be as old as it is, or older."""
    late = link.chance.uniform(_LIMIT, _LATEST)
    if link.chance.random() < 0.5:
        data, made = link.proof(), link.now
        link.now += late
    else:
        asked, made = link.reader.challenge(link.now), link.now
        link.now += late
        link.writer.hear(asked, link.now)
        data = link.writer.proof(link.now)
    link.reader.hear(data, link.now)
    return link.reader.age(link.now) > link.now - made - _ROUNDING


def insertion(link: Link) -> bool:
    """Bring in what is no answer: questions, noise, a proof that nobody asked for."""
    how = link.chance.randrange(3)
    if how == 0:
        return link.is_ignored(Challenge(link.number(), round(link.now * 1e9)).to_bytes())
    if how == 1:
        return link.is_ignored(link.chance.randbytes(link.chance.randint(0, 100)))
    proof = Proof.from_bytes(link.proof())
    early = link.chance.randint(1, 10**9)
    invented = tuple((reader, asked + early) for reader, asked in proof.answers)
    return link.is_no_younger(replace(proof, answers=invented).to_bytes())


def masquerade(link: Link) -> bool:
    """Have another writer say that all is well, with answers of its own: that is a stop."""
    data = replace(Proof.from_bytes(link.proof()), writer=link.number()).to_bytes()
    before = link.reader.as_of
    heard = link.reader.hear(data, link.now)
    is_stop = heard is not None and heard.stopped and heard.own_stopped
    return is_stop and link.reader.as_of == before and link.reader.is_doubled(link.now)


def wrong_address(link: Link) -> bool:
    """Hear what another reader was told, of the same question; or what it has asked."""
    proof = Proof.from_bytes(link.proof())
    answers = tuple((link.number(), asked) for _, asked in proof.answers)
    return link.is_no_younger(replace(proof, answers=answers).to_bytes())


# By fault: what it does, and what notices it.
FAULTS: Final[dict[str, tuple[Callable[[Link], bool], str]]] = {
    'sound': (sound, ''),
    'corruption': (corruption, 'CRC-32'),
    'repetition': (repetition, 'number of the proof; time of the question'),
    'wrong order': (wrong_order, 'number of the proof; number of stops'),
    'loss': (loss, 'number of stops'),
    'delay': (delay, 'the question that it answers'),
    'insertion': (insertion, 'kind, CRC-32; the question that it answers'),
    'masquerade': (masquerade, 'identity of the writer'),
    'wrong address': (wrong_address, 'identity of the reader'),
}


def failures(fault: str, count: int, seed: int = 1) -> int:
    """Do it so often; return how often nobody noticed, or a sound message was refused."""
    act, link = FAULTS[fault][0], Link(random.Random(f'{seed}:{fault}'))
    failed = 0
    for _ in range(count):
        failed += not act(link)
        link.reader.hear(link.proof(), link.now)  # what comes after is sound
    return failed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.black_channel', allow_abbrev=False)
    parser.add_argument('faults', nargs='*', metavar='FAULT', choices=[*FAULTS, []])
    parser.add_argument('-n', type=int, default=_COUNT, help=f'messages of each kind ({_COUNT})')
    parser.add_argument('--seed', type=int, default=1)
    given = parser.parse_args(arguments)
    print('| fault | messages | noticed by | unnoticed | s |\n|' + ' --- |' * 5, flush=True)
    failed = 0
    for fault in given.faults or FAULTS:
        begin = time.monotonic()
        found = failures(fault, given.n, given.seed)
        failed += found
        kept = f'{found} false alarms' if fault == 'sound' else str(found)
        took = time.monotonic() - begin
        print(f'| {fault} | {given.n} | {FAULTS[fault][1]} | {kept} | {took:.0f} |', flush=True)
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
