# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the unit and its bus say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
akron.link.silent: stop, technician: Akron unit: it is silent
    check power and CAN wiring of unit …: it is silent
    -> Check its power
    -> Check CAN wiring and termination
akron.link.not_found: stop, technician: Akron: no unit was found
    check the unit's power …: no unit was found …
    -> Check its power
    -> Check CAN wiring, termination and bit rate: candump can0
akron.link.another: stop, integrator: Akron: another unit is heard
    set device_pin or device_type: … heard instead: …
    -> Set device_pin or device_type to one that is heard
akron.link.no_address: stop, nobody: Akron unit: it has no address
    unit … has no address at present
    -> Wait a second: it announces a new one
akron.link.misfit: stop, integrator: Akron unit: another firmware
    ask the maker about the firmware of unit …: …
    -> Ask the maker about its firmware
akron.enable.off: stop, operator: Akron unit: it is not enabled
    check what the unit is enabled by: the enable input is not asserted
    -> Close the switch of its enable input
    -> Check its wire
akron.enable.unknown: stop, integrator: Akron unit: its enable input is not known
    the enable input is not known: no digital outputs (type 83) come
    -> Check the wire of the enable input
akron.fault.motor: stop, technician: Akron unit: a motor fault
    check that motor …: motor axis … fault
    -> Check that motor, its wiring, and what blocks it
    -> Call ~/poll_faults
akron.fault.device: stop, technician: Akron unit: it is faulted
    see its reference manual: the unit reports device faulted
    -> Look into the reference manual of the 6033
akron.fault.unknown: stop, integrator: Akron unit: its faults are not known
    faults are not known: …
    -> Wait: the poll is asked again
    -> Take motor_fault out of estop_on
akron.motion: stop, operator: Akron unit: it moves unasked
    stop the unit by its own controls, or call ~/reset_controller …
    -> Stop it by its own controls
    -> Or call ~/reset_controller
    more devices/akron.md#motion-that-a-neutral-stick-does-not-end
""")
