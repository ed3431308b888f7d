# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mux as a writer: what it proves of its stop, its enable and what it has published."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, UInt8MultiArray

from bridge_core.proof import Heard, nanoseconds, Proof, Reader, Vouched
from bridge_core.proof_topics import PROOF_QOS
from safety_mux.protocol import State
from stage.fed_mux import LIMIT, StepMux, SteppedMux, TICK
from stage.mux_talkers import MuxBench, NewMux, sticks
from stage.rig import Observer


class Wire:
    """Whoever obeys a mux of this process: asks it at each step of its time, and hears."""

    def __init__(self, stepped: SteppedMux, monkeypatch: pytest.MonkeyPatch) -> None:
        self.proofs: list[Proof] = []
        self.stepped = stepped
        self.reader = Reader(1, 1.0)
        monkeypatch.setattr(stepped.mux._proofs, '_publisher', self)

    def publish(self, message: Any) -> None:
        self.proofs.append(Proof.from_bytes(bytes(message.data)))
        self.reader.hear(bytes(message.data), self.stepped.now)

    def ask(self) -> None:
        data = self.reader.challenge(self.stepped.now)
        self.stepped.mux._proofs._asked.append(SimpleNamespace(data=data))

    def said(self) -> tuple[bool, bool, bool]:
        newest = self.proofs[-1]
        return newest.estop, newest.own_estop, newest.enable


def test_stop_and_enable_are_proven_at_once_and_answers_are_made_by_the_lane_alone(
    step_mux: StepMux, monkeypatch: pytest.MonkeyPatch
) -> None:
    stepped = step_mux()
    wire = Wire(stepped, monkeypatch)
    stepped.run(0.1)
    assert wire.proofs == []  # nobody asks
    wire.ask()
    stepped.run(TICK)
    assert wire.said() == (True, True, False)
    assert wire.reader.age(stepped.now) == pytest.approx(TICK)
    assert stepped.reset().ok
    assert stepped.run(LIMIT + 0.1) is State.READY
    wire.ask()
    stepped.run(TICK)
    assert wire.said() == (False, True, False)
    before = len(wire.proofs)
    stepped.joy = sticks(0.5, deadman=True)
    assert stepped.run(0.1) is State.ACTIVE
    assert wire.said() == (False, False, True)
    stepped.topic('estop.drive.topic').take(Bool(data=True), stepped.now)
    stepped.decide()
    assert wire.said() == (True, True, False)
    assert len(wire.proofs) == before + 2
    stops = wire.proofs[-1].stops, wire.proofs[-1].own_stops
    assert stops == (1, 1)
    wire.ask()
    stepped.now += 1.0  # a lane that hangs
    assert len(wire.proofs) == before + 2


def test_mux_that_is_not_active_goes_on_proving_its_stop(
    step_mux: StepMux, monkeypatch: pytest.MonkeyPatch
) -> None:
    stepped = step_mux()
    wire = Wire(stepped, monkeypatch)
    assert stepped.reset().ok
    stepped.run(0.1)
    assert stepped.mux.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    assert wire.said() == (True, True, False)
    for _ in range(10):
        wire.ask()
        stepped.run(0.05)
        assert wire.said() == (True, True, False)
        assert wire.reader.age(stepped.now) <= 0.05 + TICK / 2


class FarWire:
    """Whoever obeys a mux of another process."""

    def __init__(self, mux: MuxBench, observer: Observer) -> None:
        self.heard: Heard | None = None
        self.vouched = Vouched()
        self._reader = Reader(2, 10.0)
        self._record = observer.record(UInt8MultiArray, f'{mux.name}/proof', PROOF_QOS)
        self._asks = observer.node.create_publisher(
            UInt8MultiArray, f'{mux.name}/challenge', PROOF_QOS
        )

    def look(self) -> Heard | None:
        """Ask anew, and hear what has come."""
        now = time.monotonic()
        self._asks.publish(UInt8MultiArray(data=self._reader.challenge(now)))
        for message in self._record.messages:
            self.heard = self._reader.hear(bytes(message.data), now) or self.heard
            if self.heard is not None:
                self.vouched.prove(self.heard.newest, self.heard.as_of)
        self._record.clear()
        return self.heard

    def age(self, message: Any) -> float:
        return time.monotonic() - self.vouched.as_of(nanoseconds(message.header.stamp))


def test_commands_and_joys_on_running_nodes_are_as_young_as_proofs_say(
    observer: Observer, new_mux: NewMux
) -> None:
    mux = new_mux(operator__fort__gated_joy=True)
    joys = observer.record(Joy, f'{mux.name}/joy/fort')
    wire = FarWire(mux, observer)
    mux.wait(lambda: (heard := wire.look()) and heard.estop and heard.own_estop, 'a proven stop')
    mux.active()

    def is_young() -> bool:
        heard = wire.look()
        ages = wire.age(mux.command.last), wire.age(joys.last)
        return heard is not None and heard.enable and not heard.estop and max(ages) < LIMIT

    mux.wait(is_young, 'a proven enable, a young command and a young Joy')
    mux.fort_estop.publisher.publish(Bool(data=True))
    mux.wait(lambda: (heard := wire.look()) and heard.stopped and not heard.enable, 'the stop')
