"""The part of the scene with two operators: FORT and VM-110, one after the other, and together."""

from __future__ import annotations

from collections.abc import Callable
import time

from fort_vsc_bridge.protocol import Joystick
from rugged_teleop.demo_actor import Actor
from rugged_teleop.demo_actor import DEADMAN
from rugged_teleop.demo_actor import FORT
from rugged_teleop.demo_actor import is_released
from rugged_teleop.demo_actor import Missed
from rugged_teleop.demo_actor import PUSH
from rugged_teleop.demo_actor import RAMP_LIMIT
from rugged_teleop.demo_actor import Reaction
from rugged_teleop.demo_actor import STICK
from rugged_teleop.demo_actor import UNIT_DEADMAN
from rugged_teleop.demo_actor import UNIT_SILENT_LIMIT
from rugged_teleop.demo_actor import UNIT_STICK
from rugged_teleop.demo_actor import VM110
from rugged_teleop.demo_stage import Packet
from vm110_bridge.protocol import BuState
from vm110_bridge.protocol import PeriodicInput

_WATCHED = 0.6  # s: several VRPI, and longer than the mux's hold_time


class Handover(Actor):
    """
    Hands control over from FORT, which ranks higher, to VM-110 and back, and stops VM-110.

    The stop of either reaches the hardware chain of the other: Master Enables, ES-Link relays.
    """

    @property
    def handover_steps(self) -> list[tuple[str, Callable[[], str]]]:
        """What is expected, and what shows it, in order; from FORT in motion to FORT in motion."""
        return [
            ('a VM-110 armed and enabled takes nothing from FORT', self.arm),
            ('its deadman does not take over from FORT, which ranks higher', self.push_below),
            ('FORT released, VM-110 still held: it stops, and nothing moves', self.leave_fort),
            ("VM-110's sticks let go, then its deadman: it drives", self.drive_unit),
            ("FORT's deadman takes over from VM-110, through zero", self.take_over),
            ('FORT released, VM-110 still held: it stops, and nothing moves', self.leave_fort),
            ("VM-110's sticks let go, then its deadman: it drives", self.drive_unit),
            ("VM-110's stop switch stops", self.stop_unit),
            ("it opens the VSC's Master Enables too", self.see_enables_open),
            ('its stop switch held, deadman and stick again: nothing moves', self.push_stopped),
            ('released, rearmed, reset: a new deadman moves it again', self.rearm),
            ('a VM-110 that falls silent stops', self.stop_unit_silence),
            ('it speaks again, its deadman held: nothing moves', self.end_unit_silence),
            ('a reset, and FORT drives again', self.return_to_fort),
            ("FORT's e-stop opens VM-110's relays too, after its 2 s", self.open_relays),
            ('released and acknowledged: VM-110 must be rearmed to close them', self.close_relays),
            ('a reset, and FORT drives again', self.return_to_fort),
        ]

    def arm(self) -> str:
        """Arm the VM-110's first remote while FORT drives."""

        def arm() -> None:
            since = self.arm_unit()
            self.unit_says(since, lambda vrpi: vrpi.bu_state == BuState.ARMED)

        return self.persist(lambda: self._keep_fort(arm))

    def push_below(self) -> str:
        """Press the lower operator's deadman and push its stick while FORT drives."""
        return self.persist(lambda: self._keep_fort(self._hold_unit))

    def _hold_unit(self) -> None:
        """Hold the VM-110's deadman, with its stick pushed the other way than FORT's."""
        since = self.unit(f'{UNIT_DEADMAN} 1', f'{UNIT_STICK} {-PUSH}')
        self.unit_says(since, _is_pushed)

    def _keep_fort(self, act: Callable[[], None]) -> str:
        """Let the VM-110 do something while FORT drives; watch that FORT keeps control."""
        if not self._moving():
            self.set_off()
        since = time.monotonic()
        act()
        end = time.monotonic() + _WATCHED
        while time.monotonic() < end:
            self._sleep()
            if self.watcher.values.get('owner') == VM110:
                raise Missed(f'VM-110 has control: {self.watcher.message}')
        packets = self.stage.packets(since)
        values = [axis.value for packet in packets for axis in packet.command.axes]
        if min(values, default=-1) < 0:
            raise Missed(f'no packets, or some as VM-110 asks: {values}')
        self.wait_for_owner(FORT)
        return f'FORT keeps control, {len(packets)} packets'

    def leave_fort(self) -> str:
        """Release FORT's deadman; the VM-110's is held meanwhile."""

        def release() -> float:
            self._hold_unit()
            return self.vsc_says(self.remote(f'button {DEADMAN} 0'), is_released)

        happened = self.stopped('FORT released, to hand over', release, state='READY')
        return f'{happened}; {self.still(time.monotonic())}'

    def drive_unit(self) -> str:
        """Let go of all, and drive with the VM-110."""
        self.hand = VM110
        return f'{self.set_off()}, owner {VM110}'

    def take_over(self) -> str:
        """Take over with FORT, while VM-110 drives."""
        return self.persist(self._take_over)

    def _take_over(self) -> str:
        """
        Press FORT's deadman and push its stick the other way, while VM-110 drives.

        Measured is the way down to zero, from FORT's message of its deadman on.
        """
        self.hand = VM110
        if not self._moving() or self.watcher.values.get('owner') != VM110:
            self.set_off()
        free_at = time.monotonic() + _WATCHED  # not within hold_time of the last change of owner
        self.wait(lambda: time.monotonic() > free_at)
        self._late = 0.0
        since = self.remote(f'button {DEADMAN} 1')
        at = self.vsc_says(since, _is_pressed)
        self.remote(f'stick {STICK} {-PUSH}')
        self.wait_for_owner(FORT)
        self.hand = FORT

        def reversed_at() -> float:
            return next((p.at for p in self.stage.packets(at) if _speed(p) < 0), 0.0)

        turned = self.wait_for_moment(reversed_at, 'FORT has control, and nothing turns')
        packets = [packet for packet in self.stage.packets(at) if packet.at <= turned]
        # The mux is at zero for one decision, which may fall between two packets of the drive's.
        zero = next(packet for packet in packets if _speed(packet) <= 0)
        jumps = abs(_speed(zero)) > _speed(packets[0]) / 2
        if jumps or not all(packet.enables for packet in packets):
            raise Missed('it did not pass through zero on a ramp, or was disabled on the way')
        took = zero.at - at
        self.reactions.append(Reaction("FORT's takeover, until zero", took, RAMP_LIMIT))
        self.check_limit(f'at zero {took * 1e3:.0f} ms after the deadman', took, RAMP_LIMIT)
        return f'at zero after {took * 1e3:.1f} ms, then the other way'

    def stop_unit(self) -> str:
        """Press the stop switch of the VM-110's remote."""

        def press() -> float:
            since = self.unit('stop 1 on')
            return self.unit_says(since, lambda vrpi: vrpi.bu_state == BuState.STOPPED)

        return self.stopped("VM-110's stop switch", press)

    def see_enables_open(self) -> str:
        """See that the stop of VM-110 has reached the hardware chain of FORT."""
        vsc = self.stage.vsc
        self.wait(lambda: not vsc.describe()['master_enable'], lambda: f'{vsc.describe()}')
        return 'open, until FORT acknowledges'

    def push_stopped(self) -> str:
        """Let deadman and stick go, then press and push them: the stop switch is still pressed."""
        self.let_go()
        return self.still(self.push())

    def rearm(self) -> str:
        """Go the right way from the stop switch to motion."""
        self.unit('stop 1 off')
        self.arm_unit()
        return f'{self.accepted_reset()}; {self.set_off()}'

    def stop_unit_silence(self) -> str:
        """Let the base unit hang."""

        def hang() -> float:
            since = self.unit('stall on') - 1.0
            return self.stage.unit.sent(since)[-1].at

        return self.stopped('VM-110 silent, since its last VRPI', hang, UNIT_SILENT_LIMIT)

    def end_unit_silence(self) -> str:
        """Let the base unit go on, and arm it anew if it has opened its relays meanwhile."""
        since = self.unit('stall off')
        self.arm_unit()
        self.wait(lambda: self.watcher.clear('VM-110'))
        return self.still(since)

    def open_relays(self) -> str:
        """Press FORT's e-stop and wait for VM-110 to say that its relays are open."""
        happened = self.stopped(
            "FORT's e-stop, VM-110 armed", lambda: self.vsc_stop('estop remote on')
        )
        since = time.monotonic()
        opened = self.unit_says(since, lambda vrpi: vrpi.bu_state == BuState.EXTERNAL_LINK_ERROR)
        if self.stage.unit.describe()['relays_closed']:
            raise Missed('the relays are closed')
        last = self.stage.unit.received()[-1].at
        return f'{happened}; relays open {opened - last:.1f} s after the last VRPO'

    def close_relays(self) -> str:
        """Release and acknowledge on FORT; watch that only rearming closes the relays."""
        self.remote('estop remote off')
        self.acknowledge()
        self.wait(lambda: self.watcher.clear('VSC'))
        unit = self.stage.unit
        self.wait(lambda: unit.describe()['eg_link'] == 'Operational')
        if unit.describe()['relays_closed']:
            raise Missed('the relays have closed without being rearmed')
        since = self.arm_unit()
        self.unit_says(since, lambda vrpi: vrpi.bu_state == BuState.ARMED)
        if not unit.describe()['relays_closed']:
            raise Missed('the relays are open')
        return f'closed by rearming; {self.still(since)}'


def _is_pressed(message: object) -> bool:
    return isinstance(message, Joystick) and message.buttons[0].value is True


def _is_pushed(vrpi: PeriodicInput) -> bool:
    return bool(vrpi.switches[0]) and vrpi.joysticks[1] != 0


def _speed(packet: Packet) -> int:
    """Return what the first axis is told; both turn alike here."""
    return packet.command.axes[0].value
