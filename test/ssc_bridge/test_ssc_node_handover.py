# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the SSC node has a new session know of those before: what is in force until undone."""

from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import KeyValue
import pytest

from bridge_core.session import StopChanged, Verdict
from bridge_core.transports.request import Call
from ssc_bridge.node import SscBridge
from ssc_bridge.protocol import Configuration
from ssc_bridge.session import ConfigurationRead, OutputsSent, RELEASE_FRAMES
from ssc_bridge.wire import AUX_SET, make_session, OUTPUTS_SENT
from stage.node_alone import alone
from stage.ssc_bench import AUX
from stage.ssc_rig import configuration

PORT, OTHER = '/dev/ssc', '/dev/other'
SENT = ((1700.0, 1700.0, True),)


@pytest.fixture
def node(context: Any) -> Iterator[SscBridge]:
    with alone(SscBridge, context) as node:
        yield node


@pytest.fixture
def asked(node: SscBridge, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Give what is asked of the session."""
    asked: list[tuple[Any, ...]] = []

    def request(call: Call, **_: Any) -> int:
        asked.append((call.name, *call.arguments))
        return 1

    monkeypatch.setattr(node.link, 'request', request)
    return asked


def read(aux: Any = AUX) -> ConfigurationRead:
    return ConfigurationRead(Configuration.from_bytes(configuration(aux=aux)))


def test_outputs_that_were_set_before_the_first_configuration_was_told_are_undone(
    node: SscBridge, asked: list[tuple[Any, ...]]
) -> None:
    """A session takes requests from its configuration on, of which the node hears later."""
    node._on_aux_outputs(KeyValue(key='4.level', value='high'))
    for aux in (AUX, AUX, AUX[::-1]):  # of the wire, of the next one, of another device
        asked.clear()
        node.on_events([read(aux)], 0.0)
        assert asked == ([('claim_aux', {4})] if aux == AUX else [])


def test_what_was_sent_is_carried_over_to_the_same_port_only(node: SscBridge) -> None:
    node.on_events([OutputsSent(PORT, SENT), read()], 0.0)
    node._on_aux_outputs(KeyValue(key='4.level', value='high'))
    for port in (PORT, OTHER, PORT):
        node.take_parameters({**node.values, 'port': port})
        for told, count in ((PORT, 1), (OTHER, 0)):  # one may be asked for, and one in force yet
            values = {**node.values, 'port': told}
            session = make_session({**values, **node.carried_over(values)})
            session.opened(0.0)
            frames = session.farewell(0.0)
            assert [frame[2] for frame in frames] == [20, 21] * count * RELEASE_FRAMES


def test_last_words_of_another_port_are_not_taken_for_those_of_this_one(node: SscBridge) -> None:
    values = {**node.values, 'port': OTHER}
    node.take_parameters(values)
    node.on_events([OutputsSent(PORT, SENT)], 0.0)  # of the farewell there, which was late
    assert node.carried_over(values)[OUTPUTS_SENT] == ()
    assert node.carried_over(node.values)[OUTPUTS_SENT] == SENT


def test_what_another_port_was_sent_is_not_undone(
    node: SscBridge, asked: list[tuple[Any, ...]]
) -> None:
    node.on_events([read()], 0.0)
    node._on_aux_outputs(KeyValue(key='4.level', value='high'))
    node._sent.commanded = True
    for port, undone in ((OTHER, []), (PORT, [('claim_outputs',), ('claim_aux', {4})])):
        node.take_parameters({**node.values, 'port': port})
        asked.clear()
        node.on_events([read()], 0.0)
        assert asked == undone


def test_what_was_sent_behind_a_stop_is_carried_over_at_once(node: SscBridge) -> None:
    node.on_events([StopChanged(Verdict.stop()), OutputsSent(PORT, SENT), read()], 0.0)
    aux = read().configuration.aux, frozenset[int]()
    assert node.carried_over(node.values) == {OUTPUTS_SENT: SENT, AUX_SET: aux}
