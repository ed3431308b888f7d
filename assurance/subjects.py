# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the campaign harms: an actuator's node in motion, with its device beside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
import contextlib
import functools
import os
from pathlib import Path
import struct
import termios
import threading
import time
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from assurance.benchmarks.chain import DRIVE, MUX, Nodes, STICK, Variant
from assurance.benchmarks.rig import Rig
from rugged_teleop.canbuses import frames, free_channel, INTERFACE
from stage import akron_node_rig, ssc_bench
from stage.can_rig import CanBus
from stage.rig import latched, NodeProcess, Observer
from stage.talkers import Diagnostics

TIMEOUT = 0.1  # s, command_timeout of all three
BRIEF = 0.005  # s, of a stop that is hardly pressed
_STICK_ID = 0x0CFDD638  # the monitor's joystick frames


class Sent(NamedTuple):
    """What an actuator was told (s, monotonic): a stop, or motion."""

    at: float
    is_stop: bool


def starter(name: str, variants: Mapping[str, Variant]) -> Callable[..., NodeProcess]:
    """Return what starts this node, as it is or in another way."""
    module, arguments, terminal = variants.get(name, Variant(f'{name}.node'))
    return functools.partial(NodeProcess, module, arguments=arguments, terminal=terminal)


class Subject(ABC):
    """A node in motion; motion is asked for until ``let_go``."""

    name = ''  # of the node
    full_name = ''
    period = 0.02  # s, in which the device is due a packet
    observer: Observer
    released_at = 0.0  # when motion was permitted last
    asked_at = 0.0  # when a stop was asked for last, of those that move again with fresh inputs

    def listen(self) -> None:
        """Record what is said about stops."""
        self.estop = self.observer.record(Bool, f'/{self.full_name}/estop', latched(), keep=2000)
        self.mux_estop = self.observer.record(Bool, f'/{MUX}/estop', latched(), keep=2000)
        self._diagnostics = Diagnostics(self.observer, self.full_name)

    @property
    @abstractmethod
    def node(self) -> NodeProcess:
        """The node."""

    @abstractmethod
    def sent(self, since: float) -> list[Sent]:
        """Return what the device was told after a moment."""

    @abstractmethod
    def move(self) -> None:
        """Be in motion, by all steps that it takes."""

    @abstractmethod
    def restart(self) -> None:
        """Start the node again, which has ended."""

    @abstractmethod
    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 15.0) -> None:
        """Wait, with all inputs going on. :raises AssertionError: not in time."""

    def expect_end(self) -> None:
        """Take the node's end for no surprise from now on."""
        return

    def stop(self) -> None:
        """Let the machine's own stop come to the node, as a mux would for its ``~/estop``."""
        return

    def ask_stop(self, *, brief: bool = False) -> None:
        """Have somebody press a stop. :param brief: for BRIEF."""
        del brief
        self.stop()

    def try_to_move(self) -> None:
        """Do all that motion takes, where it must be in vain."""
        return

    def pause(self, seconds: float) -> None:
        """Let so much time pass."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end, 'time', seconds + 5.0)

    def is_back(self) -> bool:
        """Tell whether the node says just now that it demands no stop."""
        fresh = self.estop.times and time.monotonic() - self.estop.times[-1] < 0.2
        return bool(fresh and not self.estop.last.data)

    def mux_says(self) -> str:
        """Return why the mux stops; empty where there is none."""
        return ''

    def diagnostics(self) -> str:
        """Return what the node says in /diagnostics."""
        parts = {part: self._diagnostics.status(part) for part in ('link', 'device')}
        return '; '.join(f'{part}: {said.message}' for part, said in parts.items() if said)


class Drive(Subject):
    """The drive, behind VSC bridge and mux."""

    name = full_name = DRIVE
    period = 0.01

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        exits: contextlib.ExitStack,
        variants: Mapping[str, Variant],
    ) -> None:
        self.observer = observer
        self.rig = exits.enter_context(Rig(folder))
        self.listen()
        self.chain = Nodes(self.rig, observer, exits, variants=variants)

    @property
    def node(self) -> NodeProcess:
        return self.chain.nodes[DRIVE]

    def sent(self, since: float) -> list[Sent]:
        return [Sent(packet.at, not packet.enables) for packet in self.rig.packets(since)]

    def move(self) -> None:
        self.chain.ready()
        self.chain.pause(0.4)
        self.released_at = time.monotonic()
        self.chain.move()

    def restart(self) -> None:
        self.chain.start(DRIVE)
        self.chain.may_end.clear()

    def expect_end(self) -> None:
        self.chain.may_end.add(DRIVE)

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 15.0) -> None:
        self.chain.wait(condition, what, timeout)

    def ask_stop(self, *, brief: bool = False) -> None:
        self.rig.say('estop 1')
        if brief:
            time.sleep(BRIEF)
            self.rig.say('estop 0')

    def try_to_move(self) -> None:
        self.chain.let_go()
        self.pause(0.4)
        self.chain.try_reset()
        self.rig.say('deadman 1', f'stick {STICK}')
        self.pause(0.4)

    def mux_says(self) -> str:
        return self.chain.why


class Servo(Subject):
    """A servo on the SSC."""

    name = ssc_bench.NAME
    _FAILSAFE_US = ssc_bench.SERVOS['servo.pan.failsafe_us']

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        exits: contextlib.ExitStack,
        variants: Mapping[str, Variant],
    ) -> None:
        self.observer, self._exits = observer, exits
        self._given = {**ssc_bench.SERVOS, 'command_timeout': TIMEOUT}
        self._start = starter(self.name, variants)
        self._bench = ssc_bench.Bench(
            folder, observer, ssc_bench.new_simulator(), self._start, **self._given
        )
        exits.callback(self._bench.close)
        self.full_name = self._bench.name.lstrip('/')
        self.listen()
        asked = ssc_bench.position(pan=0.5, tilt=-1.0)
        self._talker = self._bench.talker(JointState, 'servo_command', asked)

    @property
    def node(self) -> NodeProcess:
        return self._bench.node

    def sent(self, since: float) -> list[Sent]:
        data = b''
        places = []  # of the byte after each chunk, and when it came
        for at, chunk in self._bench.port.received(since):
            data += chunk
            places.append((len(data), at))
        found = []
        start = data.find(b'\x81\xa1\x14')
        while 0 <= start <= len(data) - 9:
            at = next(at for place, at in places if place >= start + 9)
            (pan,) = struct.unpack_from('>H', data, start + 4)
            found.append(Sent(at, pan == self._FAILSAFE_US))
            start = data.find(b'\x81\xa1\x14', start + 9)
        return found

    def move(self) -> None:
        self._bench.connect()
        self.pause(0.2)
        self.released_at = time.monotonic()
        self._bench.estop_in.message = Bool(data=False)
        self.wait(self._moves, 'motion')
        self.pause(0.2)

    def _moves(self) -> bool:
        told = self.sent(time.monotonic() - 0.1)
        return bool(told) and not told[-1].is_stop

    def stop(self) -> None:
        self._bench.estop_in.message = Bool(data=True)
        self.asked_at = time.monotonic()

    def restart(self) -> None:
        given = {'port': str(self._bench.port.path), **self._given}
        space = self._bench.name.rpartition('/')[0]
        node = self._start(parameters=given, namespace=space)
        self._bench.node = self._exits.enter_context(node)

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 15.0) -> None:
        self._bench.wait(condition, what, timeout)


class Monitor(Subject):
    """A fire monitor on a CAN bus of this machine."""

    name = full_name = akron_node_rig.NAME

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        exits: contextlib.ExitStack,
        variants: Mapping[str, Variant],
    ) -> None:
        del folder
        self.observer, self._exits, self._variants = observer, exits, variants
        bus = CanBus(INTERFACE, free_channel())
        self._station = akron_node_rig.Station(MonitorSimulator(), bus)
        exits.callback(self._station.close)
        self._given = {
            'interface': bus.interface,
            'channel': bus.channel,
            'command_timeout': TIMEOUT,
            'estop_in_timeout': TIMEOUT,
        }
        self.listen()
        self._stick = akron_node_rig.MOVE
        self._bench = akron_node_rig.Bench(observer, self._start())

    def _start(self) -> NodeProcess:
        node = starter(self.name, self._variants)(parameters=self._given)
        return self._exits.enter_context(node)

    @property
    def node(self) -> NodeProcess:
        return self._bench.node

    def sent(self, since: float) -> list[Sent]:
        chunks = self._station.received(since)
        heard = ((chunk.at, frames([chunk])) for chunk in chunks)
        return [
            Sent(at, frame.data == akron_node_rig.NEUTRAL)
            for at, found in heard
            for frame in found
            if frame.identifier == _STICK_ID
        ]

    def move(self) -> None:
        self._bench.asked = Joy(axes=[0.0, 0.0])
        self._bench.connect()
        self.released_at = time.monotonic()
        self._bench.drive(self._station, self._stick)
        self._stick = Joy(axes=[-axis for axis in self._stick.axes])  # or it reaches its end stop
        self.pause(0.2)

    def stop(self) -> None:
        self._bench.stop = True
        self.asked_at = time.monotonic()

    def restart(self) -> None:
        self._bench.node = self._start()

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 15.0) -> None:
        self._bench.wait(condition, what, timeout)


SUBJECTS: dict[str, type[Any]] = {'drive': Drive, 'servo': Servo, 'monitor': Monitor}


class Terminal:
    """A terminal to write to, read for as long as nobody presses Ctrl-S. A context manager."""

    def __init__(self) -> None:
        self._ours, self.its = os.openpty()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # nobody has it open any more
            while os.read(self._ours, 65536):
                pass
        os.close(self._ours)

    def press_ctrl_s(self) -> None:
        termios.tcflow(self.its, termios.TCOOFF)

    def press_ctrl_q(self) -> None:
        termios.tcflow(self.its, termios.TCOON)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        self.press_ctrl_q()
        os.close(self.its)
