"""One contract for every kind of CAN interface that can be had without hardware."""

from test.can_rig import CanBus
from test.can_rig import frame
from test.can_rig import message
from test.can_rig import receive
from test.can_rig import wait_frames


def test_frames_pass_both_ways_in_order(can_bus: CanBus) -> None:
    peer, transport = can_bus.endpoint(), can_bus.transport()
    sent = [message(0x18FEF500 + number, bytes(range(number))) for number in range(9)]
    for each in sent:
        peer.send(each)
    assert wait_frames(transport, 9) == [frame(each) for each in sent]
    for each in sent:
        assert transport.send(frame(each))
    assert [receive(peer, 0, 0) for _ in sent] == [frame(each) for each in sent]
