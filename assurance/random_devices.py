# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults for the random campaign: what is done to devices and to their lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
from dataclasses import dataclass
import fcntl
import random
from typing import Any, Final

from assurance.beside import JOYSTICK
from assurance.machine import Machine, NOISE_PERIOD, Setting
from bridge_core.j1939 import CanFrame
from esi_drive_bridge.simulator import FAULTS as DRIVE_FAULTS, Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from rugged_teleop.canbuses import pack
from stage.devices import DRIVE, MONITOR, SSC, UNIT, VSC

# Bounds of docs/safety.md, in s from the cause to the first packet that disables; the hops from
# wire to wire, and how often a device speaks, are in them.
HEARD = 0.15  # a stop that a device says in its next heartbeat or status, or when it is let go
SILENT = 0.3  # a device, or its bridge, that says nothing any more
DEAD = 0.02  # of the process at the actuator's side
DEAF = 0.25  # of what the drive hears, 0.1, and its next status
OVERSPEED = 0.65  # overspeed_time, and the packet that says it
UNIT_SILENT = 0.55  # the VM-110's link_timeout, 0.5
UNIT_RADIO = 0.45  # of its base unit, 0.3, and the next VRPI
MONITOR_SILENT = 0.35  # the Akron unit's link_timeout, 0.3
RECEIVER = 0.2  # of the SSC, without pulses for 0.1 s, and its next status
_NOISE_RATE = 1_000_000  # byte/s
_FRAME_RATE = 2000  # frames/s
_BAD_LINE = 0.3  # most that is lost or damaged of a line that still carries something


@dataclass(frozen=True)
class Fault:
    """
    One fault, drawn.

    :param begin: does it; what it returns is the moment (s, monotonic), or None: when it is done.
    :param lasts: s until ``end`` undoes it.
    :param bound: s in which the drive is to be disabled; None: no stop is needed.
    :param at_once: the stop is due however soon the fault is undone; else if it lasts for longer
        than the bound.
    :param hears: the drive hears what is sent; else what counts is the last packet that enables.
    :param detail: what was drawn, for people.
    """

    kind: str
    begin: Callable[[Machine], float | None]
    end: Callable[[Machine], object] = lambda machine: None
    lasts: float = 0.5
    bound: float | None = None
    at_once: bool = False
    hears: bool = True
    detail: str = ''


# Kinds of faults: each draws one.

Draw = Callable[[random.Random, Setting], Fault]


def _steps(name: str, lines: Sequence[str]) -> Callable[[Machine], float | None]:
    def act(machine: Machine) -> float | None:
        device = machine.devices[name]
        return device.apply(*lines) if lines else None

    return act


def _device(
    name: str,
    begin: str,
    end: str = '',
    bound: float | None = None,
    *,
    lasts: tuple[float, float] = (0.05, 1.0),
    at_once: bool = False,
    hears: bool = True,
) -> Draw:
    """
    Steer device or line by lines with commas between; ``{}`` is a number up to _BAD_LINE.

    """

    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting
        seconds, number = chance.uniform(*lasts), chance.uniform(0.0, _BAD_LINE)
        said = begin.format(f'{number:.3f}')
        steps = _steps(name, said.split(', ')), _steps(name, list(filter(None, end.split(', '))))
        return Fault('', *steps, seconds, bound, at_once, hears, said)

    return draw


def _wrong_device(name: str) -> Draw:
    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting
        right: list[Any] = []

        def begin(machine: Machine) -> float:
            device = machine.devices[name]
            right.append(device.simulator)
            other = DriveSimulator() if name == VSC else VscSimulator()
            at: float = device.swap(other)
            return at

        def end(machine: Machine) -> None:
            machine.devices[name].swap(right[0])

        return Fault('', begin, end, chance.uniform(0.05, 1.0), SILENT)

    return draw


def _bytes() -> list[bytes]:
    """Return 1 MB/s of noise."""
    return [random.randbytes(int(_NOISE_RATE * NOISE_PERIOD))]


def _frames() -> list[bytes]:
    """Return other devices' frames, as many as 250 kbit/s carry."""
    number = round(_FRAME_RATE * NOISE_PERIOD)
    return [pack(CanFrame(random.getrandbits(29), random.randbytes(8))) for _ in range(number)]


def _taken(name: str, bound: float, *, hears: bool) -> Draw:
    """Unplug it; once it is back, somebody else has locked it."""

    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting

        def lock(machine: Machine, how: int) -> None:
            device = machine.devices[name]
            with contextlib.suppress(BlockingIOError):  # the node was faster
                device.call(lambda *_: fcntl.flock(device._slave, how | fcntl.LOCK_NB))

        def begin(machine: Machine) -> float:
            device = machine.devices[name]
            at: float = device.apply('unplug')
            device.apply('plug')
            lock(machine, fcntl.LOCK_EX)
            return at

        def end(machine: Machine) -> None:
            lock(machine, fcntl.LOCK_UN)

        return Fault('', begin, end, chance.uniform(0.2, 1.0), bound, True, hears)

    return draw


def _noisy(name: str, noise: Callable[[], list[bytes]] = _bytes) -> Draw:
    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting

        def begin(machine: Machine) -> None:
            machine.noise(machine.devices[name], noise)

        return Fault('', begin, Machine.calm, chance.uniform(0.1, 1.0))

    return draw


def _drive_error(chance: random.Random, setting: Setting) -> Fault:
    name = chance.choice([n for n in DRIVE_FAULTS if n not in ('warning', 'rs422')])
    made = _device(DRIVE, f'fault a {name} on', f'fault a {name} off', HEARD, at_once=True)
    return made(chance, setting)


def _lie(chance: random.Random, setting: Setting) -> Fault:
    del setting
    factor = chance.choice([-1.0, 0.0, 0.5, 3.0])

    def lie(machine: Machine, value: float) -> float:
        def change(drive: Any, now: float) -> float:
            drive.factor = value
            return now

        return machine.drive.call(change)

    return Fault(
        '',
        lambda machine: lie(machine, factor),
        lambda machine: lie(machine, 1.0),
        chance.uniform(0.1, 1.2),
        OVERSPEED if factor > 1.0 else None,
        detail=f'{factor:g} times its speed',
    )


def _late_enabling(chance: random.Random, setting: Setting) -> Fault:
    """Let go, and take long to enable when the deadman is pressed next."""
    del setting
    seconds = chance.uniform(0.1, 0.9)

    def begin(machine: Machine) -> float:
        return machine.vsc.apply('button left_down 0', 'stick left_y 0')

    def end(machine: Machine) -> None:
        machine.drive.apply(f'enabling {seconds}')

    return Fault('', begin, end, 0.2, HEARD, at_once=True, detail=f'after {seconds:.2f} s')


DEVICES: Final[dict[str, Draw]] = {
    'VSC: e-stop of the remote': _device(VSC, 'estop remote on', '', HEARD, at_once=True),
    'VSC: deadman let go, pressed again': _device(
        VSC, 'button left_down 0', 'button left_down 1', HEARD, lasts=(0.2, 0.6)
    ),
    'VSC: radio lost': _device(VSC, 'radio off', 'radio on', HEARD, at_once=True),
    'VSC: paused': _device(VSC, 'mode pause', 'mode operational', HEARD, lasts=(0.2, 0.6)),
    'VSC: unplugged': _device(VSC, 'unplug', 'plug', HEARD, at_once=True),
    'VSC: port taken': _taken(VSC, HEARD, hears=True),
    'VSC: silent': _device(VSC, 'drop 1 out', 'drop 0 out', SILENT),
    'VSC: stalled': _device(VSC, 'stall on', 'stall off', SILENT),
    'VSC: reboots': _device(VSC, 'reboot', '', SILENT, lasts=(1.05, 1.3)),
    'VSC: bits flipped': _device(VSC, 'corrupt {} out', 'corrupt 0 out'),
    'VSC: frames lost': _device(VSC, 'drop {} out', 'drop 0 out'),
    'VSC: frames late': _device(VSC, 'delay {} out', 'delay 0 out'),
    'VSC: noise of 1 MB/s': _noisy(VSC),
    'VSC: another device': _wrong_device(VSC),
    'VM-110: stop switch': _device(UNIT, 'stop 1 on', 'stop 1 off', HEARD, at_once=True),
    'VM-110: radio lost': _device(UNIT, 'radio 1 off', 'radio 1 on', UNIT_RADIO),
    'VM-110: unplugged': _device(UNIT, 'unplug', 'plug', UNIT_SILENT),
    'VM-110: silent': _device(UNIT, 'drop 1 out', 'drop 0 out', UNIT_SILENT),
    'VM-110: stalled': _device(UNIT, 'stall on', 'stall off', UNIT_SILENT),
    'VM-110: hears nothing': _device(UNIT, 'drop 1 in', 'drop 0 in'),
    'VM-110: reboots': _device(UNIT, 'reboot', '', UNIT_SILENT, lasts=(1.05, 1.3)),
    'VM-110: bits flipped': _device(UNIT, 'corrupt {} out', 'corrupt 0 out'),
    'VM-110: packets lost': _device(UNIT, 'drop {} out', 'drop 0 out'),
    'VM-110: packets late': _device(UNIT, 'delay {} out', 'delay 0 out'),
    'VM-110: packets doubled, and in another order': _device(UNIT, 'double 3, swap'),
    'VM-110: noise of 1 MB/s': _noisy(UNIT),
    'drive: unplugged': _device(DRIVE, 'unplug', 'plug', DEAD, at_once=True, hears=False),
    'drive: port taken': _taken(DRIVE, DEAD, hears=False),
    'drive: silent': _device(DRIVE, 'mute on', 'mute off', SILENT),
    'drive: hears nothing': _device(DRIVE, 'deaf on', 'deaf off', DEAF),
    'drive: reboots': _device(DRIVE, 'reboot', '', SILENT, lasts=(0.55, 0.8)),
    'drive: drops out': _device(DRIVE, 'trip a', '', HEARD, at_once=True),
    'drive: error': _drive_error,
    'drive: bits flipped': _device(DRIVE, 'corrupt {} out', 'corrupt 0 out'),
    'drive: status late': _device(DRIVE, 'delay {} out', 'delay 0 out'),
    'drive: noise of 1 MB/s': _noisy(DRIVE),
    'drive: another device': _wrong_device(DRIVE),
    'drive: lies about its speed': _lie,
    'drive: enables late': _late_enabling,
}

# Those of the devices that ``Setting.all_devices`` adds.
MORE_DEVICES: Final[dict[str, Draw]] = {
    'SSC: receiver lost': _device(SSC, 'receiver off', 'receiver on', RECEIVER),
    'SSC: transmitter lost': _device(SSC, 'link off', 'link on', HEARD),
    'SSC: unplugged': _device(SSC, 'unplug', 'plug', HEARD, at_once=True),
    'SSC: port taken': _taken(SSC, HEARD, hears=True),
    'SSC: silent': _device(SSC, 'drop 1 out', 'drop 0 out', SILENT),
    'SSC: stalled': _device(SSC, 'stall on', 'stall off', SILENT),
    'SSC: hears nothing': _device(SSC, 'drop 1 in', 'drop 0 in'),
    'SSC: reboots': _device(SSC, 'reboot, mute on', 'reboot, mute off', SILENT),
    'SSC: bits flipped': _device(SSC, 'corrupt {} out', 'corrupt 0 out'),
    'SSC: frames lost': _device(SSC, 'drop {} out', 'drop 0 out'),
    'SSC: frames late': _device(SSC, 'delay {} out', 'delay 0 out'),
    'SSC: noise of 1 MB/s': _noisy(SSC),
    'SSC: another device': _wrong_device(SSC),
    'Akron: not enabled': _device(MONITOR, 'enable off', 'enable on', HEARD),
    'Akron: motor fault': _device(MONITOR, 'fault axis_1 on', 'fault axis_1 off', HEARD),
    'Akron: off the bus': _device(MONITOR, 'unplug', 'plug', MONITOR_SILENT),
    'Akron: silent': _device(MONITOR, 'drop 1 out', 'drop 0 out', MONITOR_SILENT),
    'Akron: stalled': _device(MONITOR, 'stall on', 'stall off', MONITOR_SILENT),
    'Akron: hears nothing': _device(MONITOR, 'drop 1 in', 'drop 0 in'),
    'Akron: reboots': _device(MONITOR, 'power off', 'power on', MONITOR_SILENT),
    'Akron: takes another address': _device(MONITOR, 'address 90', 'address 80'),
    'Akron: bits flipped': _device(MONITOR, 'corrupt {} out', 'corrupt 0 out'),
    'Akron: frames lost': _device(MONITOR, 'drop {} out', 'drop 0 out'),
    'Akron: frames late': _device(MONITOR, 'delay {} out', 'delay 0 out'),
    'Akron: bus full': _noisy(MONITOR, _frames),
    'Akron: foreign joystick': _device(JOYSTICK, 'plug, stick x 1', 'unplug', HEARD, at_once=True),
}
