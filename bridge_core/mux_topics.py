# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The proofs of an actuator's mux: its node carries them to the wire, and challenges back.

The node of ``~/estop_in`` is the mux, if that topic is its ``~/estop``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from std_msgs.msg import UInt8MultiArray

from bridge_core.actuator import ActuatorSession
from bridge_core.mux_words import MUX
from bridge_core.parameters import ParameterError
from bridge_core.proof import LARGEST
from bridge_core.proof_topics import PROOF_QOS
from bridge_core.session import Asked

_ESTOP = '/estop'


class MuxTopics:
    """``<mux>/proof`` and ``<mux>/challenge``. :param node: the actuator's."""

    def __init__(self, node: Any) -> None:
        self._node = node
        _, mux = _estop_in_of(node)
        self._name = mux if node.values.get('proof', 'none') != 'none' else ''
        self._enables = node.resolve_topic_name('~/enable') == f'{self._name}/enable'
        self._is_proven = node.values.get('proof') == 'required'
        self._challenges: Any = None

    @staticmethod
    def check(node: Any, values: Mapping[str, Any]) -> None:
        """Refuse to wait for proofs where there are none. :raises ParameterError: saying so."""
        topic, mux = _estop_in_of(node)
        if values.get('proof') == 'required' and not mux:
            raise ParameterError(
                "parameter proof = 'required': remap ~/estop_in to the mux's ~/estop, or set "
                f'proof to none; it is {topic}, and there is no ~/proof beside that'
            )

    def subscribe(self) -> None:
        """Listen to proofs, behind the inputs that were subscribed to before."""
        if self._name:
            topic = f'{self._name}/challenge'
            self._challenges = self._node.create_publisher(UInt8MultiArray, topic, PROOF_QOS)
            topic = f'{self._name}/proof'
            self._node.lane.subscribe(UInt8MultiArray, topic, self._on_proof, PROOF_QOS)

    def _on_proof(self, message: Any, info: Any) -> None:
        del info
        data = bytes(message.data[: LARGEST + 1])  # what is longer is none, wherever it is cut
        # As a stop: none may be dropped, and its age is judged by what is in it.
        self._node.request(ActuatorSession.hear_proof, data, stop=True)

    def ask(self, event: Asked) -> None:
        """Publish a challenge."""
        self._is_proven |= event.proven
        self._challenges.publish(UInt8MultiArray(data=event.challenge))

    def vouches_for(self, topic: str) -> bool:
        """Tell whether the mux vouches for commands on this topic, by their stamps."""
        return self._name != '' and topic.startswith(f'{self._name}/')

    def proves(self, topic: str) -> bool:
        """Tell whether proofs say what a lost message of this stop input did."""
        own = [f'{self._name}{_ESTOP}', *[f'{self._name}/enable'] * self._enables]
        return self._is_proven and self._name != '' and topic in own

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a session has to know. Who had to prove its words once has to for ever."""
        if not self._name:
            return {}
        proof = 'required' if self._is_proven else values['proof']
        return {MUX: (self._name, self._enables), 'proof': proof}


def _estop_in_of(node: Any) -> tuple[str, str]:
    """Return the topic, and the full name of the node whose ~/estop it is; empty: of none."""
    topic = node.resolve_topic_name('~/estop_in')
    return topic, topic.removesuffix(_ESTOP) if topic.endswith(_ESTOP) else ''
