"""
The scripted scene: a start, fourteen stops in mid-motion, wrong ways to go on and the right one.

Each step states what is expected, waits for it up to a deadline and prints one line. Reactions run
from the moment at which the cause was written on a port (or the plug was pulled) to the moment at
which the first packet that disables the drive was read, both taken in this process with the
monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from fort_vsc_bridge.protocol import Heartbeat
from rugged_teleop.demo_actor import BETWEEN_RESETS
from rugged_teleop.demo_actor import DEADMAN
from rugged_teleop.demo_actor import DEMANDED
from rugged_teleop.demo_actor import HELD
from rugged_teleop.demo_actor import is_released
from rugged_teleop.demo_actor import Missed
from rugged_teleop.demo_actor import PUSH
from rugged_teleop.demo_actor import SILENT_LIMIT
from rugged_teleop.demo_actor import STICK
from rugged_teleop.demo_further import Further
from rugged_teleop.demo_handover import Handover
from rugged_teleop.demo_stage import DemoError
from rugged_teleop.demo_stage import ESTOPS
from rugged_teleop.demo_stage import Stage

RETURN_LIMIT = 2.0  # s, from plugging in to a healthy link
START_LIMIT = 30.0  # s, for discovery on a busy machine


class Scene(Handover, Further):
    """
    The scene on a stage. Its steps return what happened; see ``steps`` for what they expect.

    :param say: prints a line.
    """

    def __init__(
        self, stage: Stage, say: Callable[[str], None] = print, patience: float = 1.0
    ) -> None:
        super().__init__(stage, patience)
        self._say = say

    @property
    def steps(self) -> list[tuple[str, Callable[[], str]]]:
        """What is expected, and what shows it, in order."""
        again = ('reset and a new deadman move it again', self.restart)
        return [
            ('VSC, VM-110, SSC, drive and monitor are found', self.connect),
            ('a start is a stop: deadman and stick move nothing', self.push_at_start),
            ('a reset with stick and deadman held is refused', self.reset_while_held),
            ('a reset with all let go is accepted and moves nothing', self.reset_rightly),
            ('deadman, then stick: the motors turn', self.set_off),
            ('e-stop on the remote stops', self.stop_remote),
            ('a reset while the e-stop is pressed is refused', self.reset_while_pressed),
            ('released, but not acknowledged: refused', self.reset_unacknowledged),
            ('acknowledged, stick and deadman still held: refused', self.reset_still_held),
            ('stick let go, deadman held: refused', self.reset_deadman_held),
            ('a reset with all let go is accepted and moves nothing', self.reset_rightly),
            ('the stick without the deadman moves nothing', self.stick_alone),
            ('the deadman pressed with the stick pushed moves nothing', self.deadman_late),
            ('neutral, deadman, stick: the motors turn', self.set_off),
            ('the wired e-stop of the VSC stops', self.stop_wired),
            again,
            ('a released deadman stops', self.stop_deadman),
            ('the deadman alone moves it again, without a reset', self.set_off),
            ('a VSC that falls silent stops', self.stop_silence),
            ('it speaks again, stick and deadman held: nothing moves', self.end_silence),
            again,
            ('a fault of the drive stops', self.stop_fault),
            ('a reset before the errors are cleared is refused', self.clear_fault),
            again,
            ('~/trip stops', self.stop_trip),
            ('a first reset only ends the trip, which the VSC was told of', self.end_trip),
            again,
            ('the VSC unplugged stops', self.stop_unplug),
            ('plugged in: healthy in the same process, nothing moves', self.plug),
            again,
            *self.handover_steps,
            *self.further_steps,
            ('the stack ended in mid-motion: its last packets disable', self.end),
        ]

    def play(self) -> bool:
        """
        Play all steps, up to the first that fails; print the summary. Tell whether all held.

        What follows a failed step would start from somewhere else, and tell nothing.
        """
        steps = self.steps
        for number, (expected, show) in enumerate(steps):
            try:
                happened = show()
            except (Missed, DemoError) as error:
                self._say(f'FAILED  {expected}: {error}')
                self._say(
                    f'\n{number} of {len(steps)} expectations held, one did not, '
                    f'{len(steps) - number - 1} were not tried. This machine kept us waiting '
                    f'{self.latest * 1e3:.0f} ms at worst; the stack stops from 100 ms on.'
                )
                self._say(self.stage.output())
                return False
            self._say(f'ok      {expected}: {happened}')
        self._summarise(len(steps))
        return True

    def _summarise(self, count: int) -> None:
        self._say(
            f'\nall {count} expectations held. From cause to the first disable packet '
            '(a takeover: to zero or the other direction), or to what is named:'
        )
        for reaction in self.reactions:
            self._say(
                f'  {reaction.seconds * 1e3:7.1f} ms  {reaction.cause}'
                f' (at most {reaction.limit * 1e3:.0f} ms)'
            )
        if self.time_outs:
            self._say(f'this machine is busy: time-outs stopped the motors {self.time_outs} times')

    # -- starts ----------------------------------------------------------------------------------

    def connect(self) -> str:
        """Wait for all six nodes, and for all devices without a stop."""
        watcher = self.watcher

        def connected() -> bool:
            if all(watcher.clear(name) for name in ESTOPS):
                return watcher.values != {}
            self.tend()  # until the mux has heard the drive, it asks the VSC to stop
            return False

        self.wait(
            connected,
            lambda: f'heard e-stops {watcher.estops}, mux {watcher.message or "not heard"}',
            START_LIMIT,
        )
        took = time.monotonic() - self.stage.started_at
        self.wait_for_state('STOPPED')
        return f'all without a stop after {took:.1f} s, the mux is STOPPED'

    def push_at_start(self) -> str:
        """Behave as if it had been reset."""
        self.acknowledge()
        return self.still(self.push())

    def reset_rightly(self) -> str:
        """Let all go, and reset."""
        since = time.monotonic()
        return f'{self.accepted_reset()}; {self.still(since)}'

    def restart(self) -> str:
        """Go the right way from STOPPED to motion."""
        return f'{self.accepted_reset()}; {self.set_off()}'

    # -- stops -----------------------------------------------------------------------------------

    def stop_remote(self) -> str:
        """Press the e-stop on the remote."""
        return self.stopped('e-stop of the remote', lambda: self.vsc_stop('estop remote on'))

    def stop_wired(self) -> str:
        """Open the VSC's wired e-stop input; close and acknowledge it afterwards."""
        happened = self.stopped('wired e-stop', lambda: self.vsc_stop('estop vsc on'))
        self.remote('estop vsc off')
        self.acknowledge()
        return happened

    def stop_deadman(self) -> str:
        """Release the deadman, with the stick still pushed."""

        def release() -> float:
            return self.vsc_says(self.remote(f'button {DEADMAN} 0'), is_released)

        return self.stopped('deadman released', release, state='READY')

    def stop_silence(self) -> str:
        """Let the VSC hang, its port still open."""

        def hang() -> float:
            said = self.vsc_said(self.remote('stall on') - 1.0)
            return [at for at, message in said if isinstance(message, Heartbeat)][-1]

        def undo() -> None:
            self.remote('stall off')
            self.restart()

        cause = 'VSC silent, since its last heartbeat'
        return self.repeated(lambda: self.stopped(cause, hang, SILENT_LIMIT), undo)

    def end_silence(self) -> str:
        """Let the VSC go on; stick and deadman are still held on the remote."""
        since = self.remote('stall off')
        self.wait_for_held()
        return f'{self.refused_reset(HELD)}; {self.still(since)}'

    def stop_fault(self) -> str:
        """Let the drive report an overcurrent."""

        def fail() -> float:
            return self.drive_says_fault(self.stage.drive.apply('fault a overcurrent pulse'))

        return self.stopped('overcurrent in the drive', fail)

    def clear_fault(self) -> str:
        """Try to go on without clearing the errors, then clear them."""
        happened = self.refused_reset(DEMANDED)
        success, message = self.watcher.call('clear_errors')
        if not success:
            raise Missed(message)
        return f'{happened}; ~/clear_errors: {message}'

    def stop_trip(self) -> str:
        """Call the mux's own stop."""

        def trip() -> float:
            at = time.monotonic()
            self.watcher.call('trip')
            return at

        return self.stopped('~/trip, from its call', trip)

    def end_trip(self) -> str:
        """Reset: the trip ends, and with it what stops the VSC; that has to be acknowledged."""
        self.let_go()
        may_end_at = time.monotonic() + BETWEEN_RESETS
        self.wait(lambda: time.monotonic() > may_end_at)
        self.wait(lambda: all(HELD not in text for text in self.hindrances() or [HELD]))
        return self.refused_reset('the trip is ended')

    def stop_unplug(self) -> str:
        """Pull the VSC's plug."""
        return self.stopped('VSC unplugged', lambda: self.remote('unplug'), SILENT_LIMIT)

    def plug(self) -> str:
        """Plug the VSC in again; stick and deadman are still held on the remote."""
        pid, since = self.stage.stack.pid, self.remote('plug')
        self.wait(lambda: self.watcher.clear('VSC'), limit=RETURN_LIMIT)
        took = time.monotonic() - since
        self.stage.check()
        return f'after {took:.1f} s in process {pid}; {self.still(since)}'

    def end(self) -> str:
        """End the stack while the motors turn."""
        since = time.monotonic()
        status = self.stage.end_stack()
        took = time.monotonic() - since
        packets = self.stage.packets(since)
        if status != 0 or not packets or packets[-1].enables:
            raise Missed(f'exit status {status}, last packet {packets[-1:]}')
        return f'exit status 0 after {took:.1f} s'

    # -- wrong ways to go on ---------------------------------------------------------------------

    def reset_while_held(self) -> str:
        """Reset with stick and deadman held, as the step before left them."""
        self.wait_for_held()
        return self.refused_reset(HELD)

    def reset_while_pressed(self) -> str:
        """Reset at once."""
        return self.refused_reset(DEMANDED)

    def reset_unacknowledged(self) -> str:
        """Release the e-stop, and do not acknowledge it on the remote."""
        self.remote('estop remote off')
        return self.refused_reset(DEMANDED)

    def reset_still_held(self) -> str:
        """Acknowledge, with stick and deadman held all the time."""
        since = self.acknowledge()
        self.wait_for_held()
        return f'{self.refused_reset(HELD)}; {self.still(since)}'

    def reset_deadman_held(self) -> str:
        """Centre the stick, keep the deadman."""
        self.remote(f'stick {STICK} 0')
        self.wait(lambda: self.watcher.axes[1:2] == (0.0,))
        return self.refused_reset(HELD)

    def stick_alone(self) -> str:
        """Push the stick, without the deadman."""
        return self.still(self.remote(f'stick {STICK} {PUSH}'))

    def deadman_late(self) -> str:
        """Press the deadman now: the stick is not neutral."""
        return self.still(self.remote(f'button {DEADMAN} 1'))
