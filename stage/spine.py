# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The spine on a bench: VSC and drive on a stage, bridge, mux and drive node a process each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import fcntl
import os
from pathlib import Path
import select
import struct
import subprocess
import time
from typing import Any

from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from rugged_teleop.stack import wiring
from stage.devices import CLEAR_ERRORS, DRIVE, LATE_WORDS, MUX, Stage, VSC
from stage.rig import Observer, run_python, TIMEOUT_FACTOR
from stage.run_delay import RunDelay, WIRE_HELD_UP

MODULES = {VSC: 'fort_vsc_bridge.node', MUX: 'safety_mux.node', DRIVE: 'esi_drive_bridge.node'}
DEADMAN, STICK = 'left_down', 'left_y'  # the mux's defaults: button 0, axis 1
_PRESS_TIME = 3.0  # s from a press of the deadman to an enabled drive


class Spine(Stage):
    """
    VSC, mux and drive: three processes, two ptys, and an observer. Use it as a context manager.

    :param parameters: by node name, beside the ports.
    """

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        super().__init__(folder, observer, (VSC, DRIVE, MUX))
        self._parameters = parameters or {}
        self.vsc_estop, self.drive_estop = self.estops[VSC], self.estops[DRIVE]
        self.mux_estop = self.estops[MUX]
        self.joints = observer.record(JointState, f'/{DRIVE}/joint_states')
        for name in MODULES:
            self.restart(name)

    def restart(self, name: str) -> None:
        """Start a node, or start it again."""
        parameters = dict(self._parameters.get(name, {}))
        device = {VSC: self.vsc, DRIVE: self.drive}.get(name)
        if device is not None:
            parameters['port'] = device.path
        self.start(name, MODULES[name], parameters, wiring([name]))

    def restart_and_meet(self, name: str) -> None:
        """
        Start a node again, and wait until it can answer us.

        It hears of our clients in their order: of one that is younger than the others, last.
        """
        self.restart(name)
        self.observer.call(GetParameters, f'/{name}/get_parameters', tries=3)

    def wait(self, condition: Any, what: str, timeout: float = 10.0) -> Any:
        """Spin until it is true; the error says what the mux said last."""
        return super().wait(condition, lambda: f'{what}; {self.story()}', timeout)

    def story(self) -> str:
        """Return in words where everything is."""
        drive = self.drive.simulator.describe()
        return (
            f'mux: {self.values.get("state")}, {self.message}; '
            f'drive enabled {drive["enabled"]}, command {drive["command"]}, '
            f'rpm {drive["rpm"]}; the drive node said last:\n{self.nodes[DRIVE].output[-400:]}'
        )

    # States.

    def rest(self) -> None:
        """Bring everything to the same start: alive, plugged in, nothing held, mux STOPPED."""
        self.vsc.exchange(VscSimulator())
        # A busy machine is no wiring fault.
        self.drive.exchange(DriveSimulator(command_timeout=1.0))
        for name, node in self.nodes.items():
            if node.process.poll() is not None:
                self.restart_and_meet(name)
        self.operational()
        self.vsc.apply('estop remote on')
        self.wait(lambda: self.mux_says('STOPPED'), 'STOPPED')
        self.release()
        self.observer.spin()
        self.wait(lambda: self.is_clear(VSC), 'the VSC without a stop', 15.0)
        self.wait(lambda: self.is_clear(DRIVE), 'the drive without a stop', 15.0)

    def operational(self) -> None:
        """Let the remote be connected and in its operational mode."""
        self.vsc.apply('mode operational')

    def release(self) -> float:
        """Take a stop back on the remote, and acknowledge it; sticks count again."""
        return self.vsc.apply('estop remote off', 'estop vsc off', 'ack', 'mode operational')

    def may_reset(self) -> bool:
        """Tell whether a status names no inhibit but the stop itself and the reset."""
        inhibits = sum(key.startswith('inhibit') for key in self.values)
        return super().may_reset() and inhibits == 2

    def hold(self, stick: float = 0.5) -> float:
        """Press the deadman, then push the stick; return when the stick moved."""
        return self.vsc.apply(f'button {DEADMAN} 1', f'stick {STICK} {stick}')

    def let_go(self) -> None:
        """Release stick and deadman."""
        self.vsc.apply(f'stick {STICK} 0', f'button {DEADMAN} 0')

    def ready(self) -> None:
        """Reset, once nothing else is missing, and let FORT's operator rest for long enough."""
        self._delay = self.run_delay()
        self._rest_operator(resets=0)

    def rested(self) -> None:
        """Wait, after ``reset_once`` or a motion, until FORT's deadman gets control."""
        self._rest_operator(resets=1)

    def reset_once(self) -> float:
        """Reset, once nothing else is missing; return a moment just before."""
        self._delay = self.run_delay()

        def accepted() -> float:
            if not self.may_reset():
                return 0.0
            before = time.monotonic()
            reply = self.reset()
            assert reply.success or self.held_up(), reply.message
            return before if reply.success else 0.0

        return float(self.wait(accepted, 'a reset that counts'))

    def _rest_operator(self, resets: int) -> None:
        """
        Wait until FORT's deadman gets control.

        A process that was held up stops the machine; only that is reset once more.

        :param resets: how many there were.
        """

        def rested() -> bool:
            nonlocal resets
            if self.may_reset():
                assert not resets or self.held_up(), self.story()
                resets += self.reset().success
            return self.is_rested('fort')

        self.wait(rested, 'a reset, and a rested operator', 30.0)

    def clear_errors(self) -> Any:
        """Return the drive's answer; only a node that was held up is asked once more."""
        delay = self.run_delay()

        def answer() -> Any:
            reply = self.call(CLEAR_ERRORS)
            if any(words in reply.message for words in LATE_WORDS):
                assert delay.exceeds(WIRE_HELD_UP), reply.message
                return None
            return reply

        return self.wait(answer, "the drive's answer")

    def move(self, until: Callable[[], bool] = lambda: True) -> None:
        """
        Be in motion, from READY, by deadman and stick; see ``ready``.

        A node that was held up stops the machine, or disables the drive until the next press.

        :param until: what then holds.
        """
        pressed_at = time.monotonic()

        def moves() -> bool:
            nonlocal pressed_at
            late = not self.drive.enabled and time.monotonic() > pressed_at + _PRESS_TIME
            if late or self.mux_says('STOPPED'):
                assert self.held_up(), self.story()
                self.let_go()
                self.ready()
                self.hold()
                pressed_at = time.monotonic()
            return self.drive.enabled and self.drive.rpm > 20.0 and until()

        self.hold()
        self.wait(moves, 'motion')
        self._delay = self.run_delay()

    def moving(self, until: Callable[[], bool] = lambda: True) -> None:
        """Be in motion, from STOPPED; see ``move``."""
        self.ready()
        self.move(until)

    def run_delay(self) -> RunDelay:
        """Count from now on how long nodes and devices wait for a processor."""
        return RunDelay([node.process.pid for node in self.nodes.values()])

    def allowed(self, bound: float) -> float:
        """Return a bound (seconds) for what happened since the last motion began, or its reset."""
        return self._delay.allowed(bound)

    def held_up(self) -> bool:
        """Tell whether what happened since then may be the machine's doing."""
        return self._delay.exceeds(WIRE_HELD_UP)

    def says_or_held_up(self, state: str) -> bool:
        """Tell whether the mux says this, or STOPPED, where that may be the machine's doing."""
        if self.mux_says('STOPPED'):
            assert self.held_up(), self.story()
            return True
        return self.mux_says(state)

    def restart_rightly(self) -> None:
        """Show that the way back is open: all let go, reset, which moves nothing, deadman."""
        self.let_go()
        before = time.monotonic()
        self.ready()
        self.holds_still(before, 0.1)
        self.move()

    def disabled_after(self, cause: float, within: float) -> float:
        """Return the seconds from ``cause`` to the first disable packet; none enables later."""
        packet = self.wait(lambda: self.drive.first_disable(cause), 'a disable packet', 3.0)
        reaction = packet.time - cause
        within = self.allowed(within)
        assert reaction <= within, f'{reaction * 1e3:.0f} ms, allowed are {within * 1e3:.0f} ms'
        assert not any(p.enables for p in self.drive.packets(packet.time))
        return float(reaction)


class UntouchedPort:
    """A serial port that knows whether anybody has ever opened it."""

    def __init__(self) -> None:
        self._master = os.open('/dev/ptmx', os.O_RDWR | os.O_NOCTTY)
        fcntl.ioctl(self._master, 0x40045431, struct.pack('i', 0))  # TIOCSPTLCK
        (number,) = struct.unpack('i', fcntl.ioctl(self._master, 0x80045430, bytes(4)))  # TIOCGPTN
        self.path = f'/dev/pts/{number}'

    @property
    def was_opened(self) -> bool:
        """Tell whether somebody spoke there, or has opened and closed it: a hang-up."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Give it back."""
        os.close(self._master)


def exit_of(module: str, *arguments: str, timeout: float = 20.0) -> tuple[int, str]:
    """Run a module to its end; return exit status and stderr."""
    given = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.PIPE}
    done = run_python('-m', module, *arguments, timeout=timeout * TIMEOUT_FACTOR, **given)
    return done.returncode, done.stderr
