# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Hostile inputs guided by what they reach; see test/fuzz. Millions of them: ``make fuzz``.

Each target runs the corpus, which reaches the most, and then some new inputs. Faults that are
planted here show that they are found.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import io
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import messages
from assurance.fuzz import TARGETS
from assurance.fuzz.campaign import corpus, corpus_of, Finding, Fuzzer, watch_for_hangs
from bridge_core import framing, packets
from bridge_core.framing import FrameError, StreamParser
from fort_vsc_bridge.protocol import can
from fort_vsc_bridge.protocol.hid import HidDecoder
from fort_vsc_bridge.protocol.serial import SerialDecoder
from fort_vsc_bridge.session import Session
from safety_mux.mapping import JoyMapping
from safety_mux.protocol import MalformedInput
from ssc_bridge.node import SscBridge
from vm110_bridge.protocol import Crc

CORPUS = corpus()
INPUTS = 5_000  # for each parser, beside the corpus; less for what takes longer
_FEW = 50
pytestmark = pytest.mark.computes(60)  # in all


@pytest.fixture(autouse=True)
def _hangs_are_found() -> None:
    watch_for_hangs()


def fuzzer_of(name: str) -> Fuzzer:
    return Fuzzer(TARGETS[name], corpus_of(CORPUS.get(name, [])))


@pytest.mark.parametrize('name', TARGETS)
def test_no_input_of_the_corpus_and_none_like_them_shows_a_fault(name: str) -> None:
    fuzzer = fuzzer_of(name)
    with contextlib.redirect_stderr(io.StringIO()):  # libraries tell of each damaged line
        for reads in fuzzer.pool:
            TARGETS[name].run(reads)
        count, traced = (INPUTS, 1000) if 'parser' in name else (_FEW, 100)
        if 'status' in name:
            count //= 2  # of two layouts
        outcome = fuzzer.batch(-1, count, traced=traced)
    assert not outcome.findings, outcome.findings[0]


def test_same_number_gives_the_same_inputs() -> None:
    one, other = (fuzzer_of('ssc parser').batch(3, 200).found for _ in range(2))
    assert one == other


# Faults that are planted.


def accept_wrong_checks(plant: pytest.MonkeyPatch) -> None:
    plant.setattr(packets, 'is_fletcher16', lambda data, check: True)


def skip_a_whole_frame_after_a_wrong_check(plant: pytest.MonkeyPatch) -> None:
    plant.setattr(framing, 'ChecksumError', type('Never', (FrameError,), {}))


def hand_out_a_frame_before_its_end(plant: pytest.MonkeyPatch) -> None:
    feed = HidDecoder.feed

    def hasty(decoder: Any, data: bytes, now: float) -> Any:
        decoder.counters.bytes -= max(9 - len(data), 0)
        return feed(decoder, data.ljust(9, b'\0'), now)

    plant.setattr(HidDecoder, 'feed', hasty)


def take_either_check(plant: pytest.MonkeyPatch) -> None:
    plant.setattr(Crc, 'is_good', lambda crc, datagram: True)


def refuse_short_heartbeats(plant: pytest.MonkeyPatch) -> None:
    kind, payload_size, size = can._LAYOUTS['heartbeat']
    plant.setitem(can._LAYOUTS, 'heartbeat', (kind, payload_size, size + 1))


def skip_outputs(plant: pytest.MonkeyPatch) -> None:
    readers = {key: reader for key, reader in messages._READERS.items() if key[1] != 0x83}
    plant.setattr(messages, '_READERS', readers)


def keep_all_that_came(plant: pytest.MonkeyPatch) -> None:
    feed = SerialDecoder.feed

    def hoarding(decoder: Any, data: bytes, now: float) -> Any:
        decoder.all = getattr(decoder, 'all', b'') + data * 20
        return feed(decoder, data, now)

    plant.setattr(SerialDecoder, 'feed', hoarding)


def take_long_for_each_byte(plant: pytest.MonkeyPatch) -> None:
    feed = StreamParser.feed

    def slow(parser: Any, data: bytes, now: float) -> Any:
        for _ in range(20 * len(data)):
            parser._header_begins(0)
        return feed(parser, data, now)

    plant.setattr(StreamParser, 'feed', slow)


def overlook_silence(plant: pytest.MonkeyPatch) -> None:
    verdict = Session._verdict

    def trusting(session: Any, now: float) -> Any:
        heard = session._open and session._heard.age(now) < math.inf
        return session._judge(now) if heard else verdict(session, now)

    plant.setattr(Session, '_verdict', trusting)


def overlook_stops(plant: pytest.MonkeyPatch) -> None:
    take = Session._take

    def deaf(session: Any, message: Any, now: float) -> None:
        if not getattr(message, 'estop', 0) & 0x03:
            take(session, message, now)

    plant.setattr(Session, '_take', deaf)


def log_each_time(plant: pytest.MonkeyPatch) -> None:
    plant.setattr(SscBridge, '_log_configuration', lambda node, event: node.log(0, 'read'))


def check_no_axis(plant: pytest.MonkeyPatch) -> None:
    def check(mapping: Any, axes: Any, buttons: Any) -> None:
        if len(axes) < 2 or not buttons:
            raise MalformedInput

    plant.setattr(JoyMapping, '_check', check)


def find(fuzzer: Fuzzer) -> None:
    """:raises Finding: what the corpus, or then what is like it, shows first."""
    for reads in fuzzer.pool:
        fuzzer.check(reads)
    for finding in fuzzer.batch(-2, 500, traced=10).findings:
        raise finding


PLANTED = [
    (accept_wrong_checks, 'vsc parser', 'frames found'),
    (keep_all_that_came, 'vsc session', 'kept'),
    (overlook_stops, 'vsc session', 'a stop was missed'),
    (check_no_axis, 'mux callbacks', 'it goes on|not finite|limit'),
]
PLANTED_TOO = [
    (accept_wrong_checks, 'ssc session', 'ended a stop|says so'),
    (skip_a_whole_frame_after_a_wrong_check, 'vsc parser', 'frames found'),
    (hand_out_a_frame_before_its_end, 'vsc session on hid', 'ended a stop|says so'),
    (hand_out_a_frame_before_its_end, 'vsc hid parser', 'no message'),
    (take_either_check, 'vm110 parser', 'no message'),
    (refuse_short_heartbeats, 'vsc can parser', ': a message'),
    (skip_outputs, 'akron parser', ': a message'),
    (take_long_for_each_byte, 'vsc parser', 'lines'),
    (overlook_silence, 'vsc session', 'the session spins|silence is no stop|says so'),
    (log_each_time, 'ssc session', 'log lines'),
]


@pytest.mark.parametrize(
    ('plant', 'target', 'why'),
    [*PLANTED, *(pytest.param(*row, marks=pytest.mark.proof) for row in PLANTED_TOO)],
)
def test_planted_fault_is_found(
    plant: Callable[[pytest.MonkeyPatch], None],
    target: str,
    why: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plant(monkeypatch)
    with pytest.raises(Finding, match=why):
        find(fuzzer_of(target))
