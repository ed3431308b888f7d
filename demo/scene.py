# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The scripted scene: a start, fifteen stops in mid-motion, wrong ways to go on and the right one.

Each step states what is expected, waits for it up to a deadline and prints one line. Reactions run
from the moment at which the cause was written on a port (or the plug was pulled) to the moment at
which the first packet that disables the drive was read, both taken in this process with the
monotonic clock.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time

from demo.actuators import Actuators
from demo.stage import DemoError, ESTOPS, STACK
from demo.steering import (
    FAST_RPM,
    FORT,
    RAMP_LIMIT,
    shortened,
    SILENT_LIMIT,
    Step,
    step,
    UNIT_SILENT_LIMIT,
    VM110,
)
from fort_vsc_bridge.protocol import Heartbeat
from stage.devices import (
    BETWEEN_RESETS,
    CLEAR_ERRORS,
    END_TRIP,
    greatest_step,
    LATE_WORDS,
    Packet,
    TRIP,
    UNIT,
    VSC,
)
from stage.rig import wait_for
from vm110_bridge.protocol import BuState, PeriodicInput

RETURN_LIMIT = 2.0  # s, from plugging in to a healthy link
SLOW = 0.5  # s
ZONE = 0.25  # of the speed that is asked for
DOWNHILL_RPM = 300  # of the motors, 3.1 rad/s of the joints
GREATEST_STEP = 39  # rpm a packet: 40 rad/s a second, geared 10 to 1, every 0.01 s; and rounding
START_LIMIT = 30.0  # s, for discovery on a busy machine
_WATCHED = 0.6  # s: several VRPI, and longer than the mux's hold_time
# And where another wire takes over, which has heard nothing yet.
_IN_VAIN = (*LATE_WORDS, 'its wire', 'not opened yet', 'no status from')


class Scene(Actuators):
    """The scene on a stage. Its steps return what happened; see ``steps`` for what they expect."""

    @property
    def steps(self) -> list[Step]:
        stopped, refused, apply = self.stopped, self.refused_reset, self.stage.vsc.apply
        press = partial(self.vsc_stop, 'estop remote on')
        demanded, unplug = partial(self.demanded, FORT), partial(apply, 'unplug')
        reset = step('a reset with all let go is accepted and moves nothing', self.reset_rightly)
        again = step('reset and a new deadman move it again', self.restart)
        return [
            step('VSC, VM-110, SSC, drive and monitor are found', self.connect),
            step('a start is a stop: deadman and stick move nothing', self.push_at_start),
            step('a reset with stick and deadman held is refused', refused, self.held),
            reset,
            step('deadman, then stick: the motors turn', self.set_off),
            step('e-stop on the remote stops', stopped, 'e-stop of the remote', press),
            step('a reset while the e-stop is pressed is refused', refused, demanded),
            step('released, but not acknowledged: refused', self.reset_unacknowledged),
            step('acknowledged, stick and deadman still held: refused', self.reset_still_held),
            step('stick let go, deadman held: refused', self.reset_deadman_held),
            reset,
            step('the stick without the deadman moves nothing', self.stick_alone),
            step('the deadman pressed with the stick pushed moves nothing', self.deadman_late),
            step('neutral, deadman, stick: the motors turn', self.set_off),
            step('the wired e-stop of the VSC stops', self.stop_wired),
            again,
            step('a released deadman stops', self.stop_deadman),
            step('the deadman alone moves it again, without a reset', self.set_off),
            step(f'a drive that takes {SLOW} s to enable starts from rest', self.start_slowly),
            step('in a slow zone the motors turn at a quarter, then as before', self.slow_down),
            step('a machine that runs on when told to stop stops all devices', self.run_on),
            again,
            step('a VSC that falls silent stops', self.stop_silence),
            step('it speaks again, stick and deadman held: nothing moves', self.end_silence),
            again,
            step('a fault of the drive stops', stopped, 'overcurrent', self.drive_fault),
            step('a reset before the errors are cleared is refused', self.clear_fault),
            again,
            step('~/trip stops', stopped, '~/trip, from its call', self.trip),
            step('the VSC is stopped by it, too; ~/end_trip moves nothing', self.end_trip),
            again,
            step('the VSC unplugged stops', stopped, 'VSC unplugged', unplug, SILENT_LIMIT),
            step('plugged in: healthy in the same process, nothing moves', self.plug),
            again,
            *self.handover_steps,
            *self.actuator_steps,
            step('the stack ended in mid-motion: its last packets disable', self.end),
        ]

    @property
    def handover_steps(self) -> list[Step]:
        """What is expected, and what shows it; from FORT in motion to FORT in motion."""
        leave, drive, retry = self.leave_fort, partial(self.drive, VM110), self.retry
        arm, hold = partial(self.keep_fort, self._arm), partial(self.keep_fort, self._hold_unit)
        alone = step('FORT released, VM-110 still held: it stops, and nothing moves', leave)
        unit = step("VM-110's sticks let go, then its deadman: it drives", drive)
        back = step('a reset, and FORT drives again', self.return_to_fort)
        return [
            step('a VM-110 armed and enabled takes nothing from FORT', retry, arm),
            step('its deadman does not take over from FORT, which ranks higher', retry, hold),
            *(alone, unit),
            step("FORT's deadman takes over from VM-110, through zero", retry, self.take_over),
            *(alone, unit),
            step("VM-110's stop switch stops", self.stop_unit),
            step("it opens the VSC's Master Enables too", self.see_enables_open),
            step('its stop switch held, deadman and stick again: nothing moves', self.push_again),
            step('released, rearmed, reset: a new deadman moves it again', self.rearm),
            step('a VM-110 that falls silent stops', self.stop_unit_silence),
            step('it speaks again, its deadman held: nothing moves', self.end_unit_silence),
            back,
            step("FORT's e-stop opens VM-110's relays too, after its 2 s", self.open_relays),
            step('released and acknowledged: only rearming closes them', self.close_relays),
            back,
        ]

    def play(self, say: Callable[[str], None]) -> bool:
        """
        Play all steps, up to the first that fails; say how it went. Tell whether all held.

        What follows a failed step would start from somewhere else, and show nothing.
        """
        steps = self.steps
        for number, (expected, show) in enumerate(steps):
            try:
                happened = show()
            except (AssertionError, DemoError) as error:
                say(f'FAILED  {expected}: {error}')
                say(
                    f'\n{number} of {len(steps)} expectations held, one did not, '
                    f'{len(steps) - number - 1} were not tried. This machine kept us waiting '
                    f'{self.latest * 1e3:.0f} ms at worst; the stack stops from 100 ms on.'
                )
                say(self.stage.output())
                return False
            say(f'ok      {expected}: {happened}')
        say(
            f'\nall {len(steps)} expectations held. From cause to the first disable packet '
            '(a takeover: to zero or the other direction), or to what is named:'
        )
        for cause, seconds, limit in self.reactions:
            most = limit * self.patience * 1e3
            say(f'  {seconds * 1e3:7.1f} ms  {cause} (at most {most:.0f} ms)')
        if self.timeouts:
            say(f'this machine is busy: timeouts stopped the motors {self.timeouts} times')
        return True

    # Starts.

    def connect(self) -> str:
        started_at = time.monotonic()

        def connected() -> bool:
            return all(map(self.stage.is_clear, ESTOPS.values())) and self.is_stopped()

        def missing() -> str:
            return f'missing: {[name for name in ESTOPS if not self.stage.is_clear(ESTOPS[name])]}'

        # The mux stops the VSC until it has heard the drive.
        self.wait(connected, missing, START_LIMIT, self.acknowledge_and_rearm)
        took = time.monotonic() - started_at
        return f'all without a stop after {took:.1f} s, the mux is {self.state}'

    def push_at_start(self) -> str:
        self.acknowledge()
        return self.still(self.push())

    def start_slowly(self) -> str:
        """Set off with a drive whose brake takes its time, and look at the packets it gets."""
        drive, usual = self.stage.drive, self.stage.drive.simulator.enable_delay
        since = drive.apply(f'enabling {SLOW}')
        try:
            return self.retry(lambda: self._set_off_from_rest(since))
        finally:
            drive.apply(f'enabling {usual}')

    def _set_off_from_rest(self, since: float) -> str:
        self._set_off()
        return from_rest(self.stage.drive.packets_since_disabled(since))

    def slow_down(self) -> str:
        return self.retry(self._slow_down)

    def _slow_down(self) -> str:
        """Enter a slow zone; return what the mux's status says."""
        self._set_off()
        self.stage.relay.zone = ZONE
        try:
            self.wait_in_motion(lambda: self._slowest < ZONE * FAST_RPM * 1.3)
            self.wait_in_motion(lambda: 'slowed' in self.stage.values)
            self.wait_in_motion(self.moving)
            slow = f'{self._slowest:.0f} rpm; the mux says: {self.stage.message}'
        finally:
            self.stage.relay.zone = 1.0
        self.wait_in_motion(lambda: self._slowest > FAST_RPM)
        self.wait_in_motion(self.moving)
        return f'{slow}; then {self._slowest:.0f} rpm'

    def run_on(self) -> str:
        return self.retry(self._run_on)

    def _run_on(self) -> str:
        """Release the deadman on a slope, without a brake, until all devices are stopped."""
        self._set_off()
        self.stage.drive.apply(f'slope {DOWNHILL_RPM}')
        try:
            self.let_go()
            self.wait(self.is_stopped)
            values = self.stage.values
            assert values['stopped by'] == 'motion', self.stage.message
            self.see_enables_open()
            return shortened(values['last transition'].partition(': ')[2])
        finally:
            self.stage.drive.apply('slope 0')

    def reset_rightly(self) -> str:
        since = time.monotonic()
        return f'{self.accepted_reset()}; {self.still(since)}'

    # Stops.

    def stop_wired(self) -> str:
        happened = self.stopped('wired e-stop', partial(self.vsc_stop, 'estop vsc on'))
        self.stage.vsc.apply('estop vsc off')
        self.acknowledge()
        return happened

    def stop_deadman(self) -> str:
        """Release the deadman, with the stick still pushed."""
        return self.stopped('deadman released', partial(self.vsc_deadman, False), state='READY')

    def stop_silence(self) -> str:
        """Let the VSC hang, its port still open."""

        def hang() -> float:
            said = self.vsc_said(self.stage.vsc.apply('stall on') - 1.0)
            return [at for at, message in said if isinstance(message, Heartbeat)][-1]

        def undo() -> None:
            self.stage.vsc.apply('stall off')
            self.restart()

        cause = 'VSC silent, since its last heartbeat'
        return self.retry(partial(self.stopped, cause, hang, SILENT_LIMIT), undo)

    def end_silence(self) -> str:
        since = self.stage.vsc.apply('stall off')
        return f'{self.refused_reset(self.held)}; {self.still(since)}'

    def clear_fault(self) -> str:
        """Try to go on without clearing the errors, then clear them."""
        happened = self.refused_reset(partial(self.demanded, 'drive'))
        return f'{happened}; ~/clear_errors: {self.wait(self._clear, "held up again and again")}'

    def _clear(self) -> str:
        """Call ~/clear_errors; return what it says, nothing where it was in vain: see _IN_VAIN."""
        reply = self.stage.call(CLEAR_ERRORS)
        if any(words in reply.message for words in _IN_VAIN):
            self.wait(partial(self.stage.status_since, time.monotonic()))
            return ''
        assert reply.success, reply.message
        return str(reply.message)

    def trip(self) -> float:
        at = time.monotonic()
        self.stage.call(TRIP)
        self.tripped_by = time.monotonic()  # the call may have been on its way until now
        return at

    def end_trip(self) -> str:
        """End the trip, and with it what stops the VSC; that has to be acknowledged."""
        self.let_go()
        may_end_at = self.tripped_by + BETWEEN_RESETS  # clear_time
        self.wait(lambda: self.demanded(FORT) and time.monotonic() > may_end_at)
        since = time.monotonic()
        reply = self.stage.call(END_TRIP)
        assert reply.success, reply.message
        return f'{reply.message}; {self.still(since)}'

    def plug(self) -> str:
        """Plug the VSC in again; stick and deadman are still held on the remote."""
        since = self.stage.vsc.apply('plug')
        clear = partial(self.stage.is_clear, VSC)
        self.wait(clear, limit=RETURN_LIMIT, meanwhile=self.try_to_acknowledge)
        took = time.monotonic() - since
        self.stage.check()
        pid = self.stage.nodes[STACK].process.pid
        return f'after {took:.1f} s in process {pid}; {self.still(since)}'

    def end(self) -> str:
        since = time.monotonic()
        status = self.stage.nodes[STACK].end()
        took = time.monotonic() - since
        assert status == 0, f'exit status {status}'

        def last() -> list[Packet]:
            return self.stage.drive.packets(since)[-1:]

        # The drive may not have read it yet.
        wait_for(lambda: last() and not last()[0].enables, what=lambda: f'disabled: {last()}')
        return f'exit status 0 after {took:.1f} s'

    # Wrong ways to go on.

    def reset_unacknowledged(self) -> str:
        self.stage.vsc.apply('estop remote off')
        return self.refused_reset(partial(self.demanded, FORT))

    def reset_still_held(self) -> str:
        since = self.acknowledge()
        return f'{self.refused_reset(self.held)}; {self.still(since)}'

    def reset_deadman_held(self) -> str:
        self.stick(False)
        self.wait(lambda: self.stage.axes[1:2] == (0.0,))
        return self.refused_reset(self.held)

    def stick_alone(self) -> str:
        return self.still(self.stick(True))

    def deadman_late(self) -> str:
        return self.still(self.deadman(True))

    # Two operators: the stop of either reaches the hardware chain of the other, too.

    def _arm(self) -> float:
        since = self.arm_unit()
        self.unit_says(since, _reports(BuState.ARMED))
        return since

    def _hold_unit(self) -> None:
        """
        Hold the VM-110's deadman, with its stick pushed the other way than FORT's.

        Return once the mux knows: what it hears after FORT has let go would be a new press.
        """

        def hold() -> None:
            """Where it was disarmed on the way, which ends no motion of FORT's, arm it first."""
            is_armed = self.stage.is_clear(UNIT)
            if not is_armed:
                self.acknowledge_and_rearm()
            self.deadman(is_armed, VM110)

        self.deadman(True, VM110)
        since = self.stage.unit.apply('stick 1 2 -0.6')
        self.unit_says(since, lambda vrpi: bool(vrpi.switches[0] and vrpi.joysticks[1]))
        word = partial(self.stage.condition, f"operator '{VM110}'")
        self.wait(lambda: word() == 'in use', lambda: f'{VM110}: {word()}', meanwhile=hold)

    def keep_fort(self, act: Callable[[], object]) -> str:
        """Let the VM-110 do something while FORT drives; watch that FORT keeps control."""
        if not self.moving():
            self.set_off()
        since = time.monotonic()
        act()
        end = time.monotonic() + _WATCHED

        def watched() -> bool:
            assert self.owner != VM110, f'VM-110 has control: {self.stage.message}'
            return time.monotonic() > end

        self.wait(watched)
        packets = self.stage.drive.packets(since)
        values = [value for packet in packets for value in packet.values]
        assert min(values, default=-1) >= 0, f'no packets, or some as VM-110 asks: {values}'
        self.wait_for_owner(FORT)
        return f'FORT keeps control, {len(packets)} packets'

    def leave_fort(self) -> str:
        """Release FORT's deadman; the VM-110's is held meanwhile."""

        def release() -> float:
            self._hold_unit()
            return self.vsc_deadman(False)

        happened = self.stopped('FORT released, to hand over', release, state='READY')
        return f'{happened}; {self.still(time.monotonic())}'

    def take_over(self) -> str:
        """
        Press FORT's deadman and push its stick the other way, while VM-110 drives.

        Measured is the way down to zero, from FORT's message of its deadman on.
        """
        self.operator = VM110
        if not self.moving() or self.owner != VM110:
            self.set_off()
        free_at = time.monotonic() + _WATCHED  # not within hold_time of the last change of owner
        self.wait(lambda: time.monotonic() > free_at)
        self._late = 0.0
        self.caused_at = self.vsc_deadman(True)
        self.stage.vsc.apply('stick left_y -0.6')
        self.wait_for_owner(FORT)
        self.operator = FORT

        def reversed_at() -> float:
            packets = self.stage.drive.packets(self.caused_at)
            return next((packet.time for packet in packets if packet.values[0] < 0), 0.0)

        turned = self.wait_in_motion(reversed_at, 'FORT has control, and nothing turns')
        packets = [p for p in self.stage.drive.packets(self.caused_at) if p.time <= turned]
        # The mux is at zero for one decision, which may fall between two packets of the drive's.
        zero = next(packet for packet in packets if packet.values[0] <= 0)
        jumps = abs(zero.values[0]) > packets[0].values[0] / 2
        ramped = not jumps and all(packet.enables for packet in packets)
        assert ramped, 'it did not pass through zero on a ramp, or was disabled on the way'
        cause = "FORT's takeover, until zero"
        took = self.reacts(cause, 'at zero', lambda _: zero.time, RAMP_LIMIT)
        return f'{took}, then the other way'

    def stop_unit(self) -> str:
        def press() -> float:
            return self.unit_says(self.stage.unit.apply('stop 1 on'), _reports(BuState.STOPPED))

        return self.stopped("VM-110's stop switch", press)

    def see_enables_open(self) -> str:
        vsc = self.stage.vsc
        self.wait(lambda: not vsc.describe()['master_enable'], lambda: f'{vsc.describe()}')
        return 'open, until FORT acknowledges'

    def push_again(self) -> str:
        self.let_go()
        return self.still(self.push())

    def rearm(self) -> str:
        self.stage.unit.apply('stop 1 off')
        self.arm_unit()
        return self.restart()

    def stop_unit_silence(self) -> str:
        def hang() -> float:
            return self.stage.unit.sent(self.stage.unit.apply('stall on') - 1.0)[-1].at

        return self.stopped('VM-110 silent, since its last VRPI', hang, UNIT_SILENT_LIMIT)

    def end_unit_silence(self) -> str:
        """Let the base unit go on, and arm it anew if it has opened its relays meanwhile."""
        since = self.stage.unit.apply('stall off')
        self.arm_unit()
        self.wait(lambda: self.stage.is_clear(UNIT), meanwhile=self.acknowledge_and_rearm)
        return self.still(since)

    def open_relays(self) -> str:
        press = partial(self.vsc_stop, 'estop remote on')
        happened = self.stopped("FORT's e-stop, VM-110 armed", press)
        since, unit = time.monotonic(), self.stage.unit
        opened = self.unit_says(since, _reports(BuState.EXTERNAL_LINK_ERROR))
        assert not unit.describe()['relays_closed'], 'the relays are closed'
        after = opened - unit.received()[-1].at
        return f'{happened}; relays open {after:.1f} s after the last VRPO'

    def close_relays(self) -> str:
        self.stage.vsc.apply('estop remote off')
        self.acknowledge()
        unit = self.stage.unit
        self.wait(
            lambda: self.stage.is_clear(VSC) and unit.describe()['eg_link'] == 'Operational',
            meanwhile=self.try_to_acknowledge,
        )
        closed = unit.describe()['relays_closed']
        assert not closed, 'the relays have closed without being rearmed'
        since = self._arm()
        assert unit.describe()['relays_closed'], 'the relays are open'
        return f'closed by rearming; {self.still(since)}'


def from_rest(packets: list[Packet]) -> str:
    """Say how a slow drive was started. :raises AssertionError: not from rest, or with a step."""
    moving = [packet.time for packet in packets if packet.moves]
    assert moving, 'it was disabled again at once'
    after, step = moving[0] - packets[0].time, greatest_step(packets)
    assert after > SLOW, f'motion is asked for {after:.2f} s after enable, and it is not enabled'
    assert step <= GREATEST_STEP, f'a step of {step} rpm, allowed are {GREATEST_STEP}'
    return f'first motion {after:.2f} s after enable, no step above {step} rpm'


def _reports(state: BuState) -> Callable[[PeriodicInput], bool]:
    return lambda vrpi: vrpi.bu_state == state
