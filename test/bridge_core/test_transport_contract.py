# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One contract for every kind of port: serial lines and servers, hidraw, multicast, CAN buses."""

from collections.abc import Callable, Iterator
from dataclasses import fields
import os
from pathlib import Path
import threading
import time
from typing import Any

import pytest

from bridge_core.framing import Counters
from bridge_core.report import LinkStatus
from bridge_core.transports import TransportError
from bridge_core.transports.active import Active
from stage.can_rig import CanBus
from stage.port_rig import (
    BusPeer,
    FifoPeer,
    GroupPeer,
    numbered,
    Peer,
    PtyPeer,
    readable,
    Rfc2217Peer,
    TcpPeer,
)
from stage.rig import TIMEOUT_FACTOR, wait_for

pytestmark = pytest.mark.usefixtures('patient_writer')
KINDS: dict[str, Callable[[Path], Peer]] = {
    'pty': PtyPeer,
    'socket': TcpPeer,
    'rfc2217': Rfc2217Peer,
    'hidraw': FifoPeer,
    'multicast': GroupPeer,
}
BUSES = [pytest.param('can_bus', marks=pytest.mark.real_can), 'virtual']


@pytest.fixture(params=[*KINDS, *BUSES])
def peer(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Peer]:
    kind = request.param
    if kind in KINDS:
        result = KINDS[kind](tmp_path / 'device')
    elif kind == 'virtual':
        result = BusPeer(CanBus('virtual', request.node.name))
    else:
        result = BusPeer(request.getfixturevalue('can_bus'))
    yield result
    result.close()


def open_soon(peer: Peer) -> None:
    """Open, again and again: a server may need a moment to let go of the last client."""

    def opened() -> bool:
        try:
            peer.transport.open()
        except TransportError:
            return False
        return True

    wait_for(opened, 10.0, f'{peer.transport.name} opens')


def send(peer: Peer, frame: Any) -> None:
    """Send it, again while the line is busy: a slow kernel may confirm the last one late."""
    wait_for(lambda: peer.transport.send(frame), 5.0, 'a line that is not busy')


def test_frames_pass_both_ways_in_order(peer: Peer) -> None:
    peer.transport.open()
    frames = numbered(peer, range(9))
    peer.say(*frames)
    assert peer.hear(9) == frames
    for each in frames * peer.sends:
        send(peer, each)
        peer.wait_received(each)
    assert peer.sends or not peer.transport.send(frames[0])


def test_own_frames_do_not_come_back(peer: Peer) -> None:
    if not peer.sends:
        pytest.skip('nothing is sent there')
    peer.transport.open()
    send(peer, peer.frame(1))
    peer.wait_received(peer.frame(1))
    peer.say(peer.frame(2))
    assert peer.hear(1) == [peer.frame(2)]


def test_nothing_there_is_no_error_and_no_wait(peer: Peer) -> None:
    peer.transport.open()
    assert not readable(peer.transport, 0.0)
    assert peer.transport.receive() == []


def test_what_came_before_the_port_was_opened_is_forgotten(peer: Peer) -> None:
    if isinstance(peer, TcpPeer):
        pytest.skip('it goes with its connection')
    for number in range(2):
        if peer.keeps_early:
            peer.say(peer.frame(90))
        elif number:
            peer.say(peer.frame(91))  # while it is open, and nobody takes it
            wait_for(lambda: readable(peer.transport), 5.0, 'a frame')
        open_soon(peer)
        peer.say(peer.frame(number))
        assert peer.hear(1) == [peer.frame(number)]


def test_what_came_while_a_node_was_held_up_is_discarded_or_the_port_is_opened_anew(
    peer: Peer,
) -> None:
    peer.transport.open()
    session: Any = None
    active: Active[Any] = Active(
        session, peer.transport, resting=False, status=LinkStatus(), tell=lambda *_: None, tap=None
    )
    peer.say(peer.frame(90))
    wait_for(lambda: readable(peer.transport), 5.0, 'a frame')
    if peer.transport.name.startswith(('rfc2217', 'virtual')):
        assert not active.discard()  # another one may wait before the threads that carry it
    else:
        assert active.discard()
        peer.say(peer.frame(1))
        assert peer.hear(1) == [peer.frame(1)]


def test_closed_port_may_be_closed_again_and_neither_sends_nor_receives(peer: Peer) -> None:
    transport = peer.transport
    transport.close()
    transport.open()
    assert transport.fileno() >= 0
    transport.close()
    transport.close()
    assert transport.fileno() == -1
    uses: list[Callable[[], Any]] = [transport.receive]
    if peer.sends:
        uses.append(lambda: transport.send(peer.frame(1)))
    for use in uses:
        with pytest.raises(TransportError):
            use()


def test_last_frame_leaves_although_the_port_is_closed_behind_it(peer: Peer) -> None:
    for number in range(3 * peer.sends):
        open_soon(peer)
        send(peer, peer.frame(number))
        peer.transport.close()
        peer.wait_received(peer.frame(number))


def test_line_that_takes_nothing_is_an_error_and_close_does_not_wait(peer: Any) -> None:
    if not peer.is_stream:
        pytest.skip('its frames are dropped: see the tests of its kind')
    transport = peer.transport
    transport.open()
    peer.stalled = True
    errors: list[str] = []
    longest, dropped = 0.0, 0

    def is_told() -> bool:
        nonlocal longest, dropped
        start = time.monotonic()
        try:
            dropped += not transport.send(b'\x55' * 64)
        except TransportError as error:
            errors.append(str(error))
        longest = max(longest, time.monotonic() - start)
        return bool(errors)

    wait_for(is_told, 20.0, 'an error from a port that takes nothing', idle=lambda _: None)
    assert 'took no bytes for' in errors[0]
    if '://' in transport.name:  # a pty has no queue
        assert dropped  # rather than kept for as long as the network is away, to come out then
    closing = time.monotonic()
    transport.close()
    # Not a matter of speed: a close that waits for the line waits for ever, or for 30 s.
    assert max(longest, time.monotonic() - closing) < 3.0 * TIMEOUT_FACTOR


def test_flood_is_handed_up_in_portions_and_none_of_it_is_lost(peer: Peer) -> None:
    peer.transport.open()
    frames = numbered(peer, range(200))
    peer.say(*frames)
    wait_for(lambda: readable(peer.transport), 5.0, 'the first')
    portion = peer.transport.receive()
    assert len(portion) <= 64
    if peer.is_stream:
        rest = b''.join(frames)[len(b''.join(portion)) :]
        assert b''.join(peer.hear(len(rest) // 9)) == rest
    else:
        assert [*portion, *peer.hear(200 - len(portion))] == frames


def test_device_gone_is_an_error_and_not_silence_until_it_is_back(peer: Peer) -> None:
    if not peer.unplugs:
        pytest.skip('its interface goes and comes: see the tests of its kind')
    peer.transport.open()
    peer.say(peer.frame(1))
    assert peer.hear(1) == [peer.frame(1)]
    peer.unplug()
    wait_for(lambda: readable(peer.transport), 5.0, 'a sign')
    with pytest.raises(TransportError, match='unplugged'):
        peer.hear(1)
    with pytest.raises(TransportError):
        peer.transport.open()
    peer.replug()
    open_soon(peer)
    peer.say(peer.frame(2))
    assert peer.hear(1) == [peer.frame(2)]


def test_reopening_leaks_no_descriptors_and_threads(peer: Peer) -> None:
    def count() -> tuple[int, int]:
        return len(os.listdir('/proc/self/fd')), threading.active_count()

    peer.transport.open()
    peer.transport.close()
    before = count()
    for _ in range(3):
        open_soon(peer)
        peer.transport.close()
    wait_for(lambda: count() <= before, 5.0, lambda: f'{before} descriptors, threads; {count()}')


def test_counts_hide_none_of_the_session(peer: Peer) -> None:
    """Both go into one diagnostic, where of two with one name the second would win."""
    of_sessions = {field.name.replace('_', ' ') for field in fields(Counters)}
    peer.transport.open()
    assert of_sessions.isdisjoint(peer.transport.counts())
