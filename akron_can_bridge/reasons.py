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
akron.foreign: stop, operator: Akron unit: a foreign joystick drives it
    a foreign joystick drives the unit past the mux: address …, frame …; if it is meant to drive
        the unit beside the mux, list it in allowed_joysticks; else take it off this bus
    another sender uses our own source_address: address …, frame …; …
    a foreign controller gives the unit the SOE permission: address …, frame …; take it off this
        bus, or set soe_permissive to false
    -> Let go of that joystick
    -> Allow it: allowed_joysticks
    more devices/akron.md#what-is-a-stop
akron.forgotten: stop, technician: Akron unit: no frame went out
    no frame went out for 200 ms, so the unit forgot what was held
    -> Let go of the stick
    -> Look at the bus: candump can0
akron.restarted: stop, technician: Akron unit: it may have restarted
    the unit was silent for 0.5 s or more, so it may have been switched off
    -> Let go of the stick
    -> Check its power and CAN wiring
akron.busy.asked: step, nobody: Akron unit: it does what it was asked
    its zero positions are being set
    the unit is being reset
    the unit is being put into setup mode
    -> Wait
akron.busy.setup: step, technician: Akron unit: in setup mode
    the unit is in setup mode, or may be; call ~/reset_controller once that is done
    -> Finish the setup
    -> Call ~/reset_controller
akron.busy.new: step, nobody: The node starts
    this node has yet to tell what it knew of the unit before
    -> Wait
akron.pause.missing: note, integrator: Akron unit: switch 7 does not pause
    set pause_on_stop to false: type 81 told of no pause once switch 7 was pressed …
    -> Set pause_on_stop to false
akron.bus.misfit: note, integrator: Akron: a message is not as in the manual
    a message is not as in the manual: …; ask its maker
    -> Ask its maker
akron.bus.namesake: note, integrator: Akron: another device claims our address
    another device (NAME …) claims our own address …; change its address or source_address
    -> Change its address or source_address
akron.bus.rivals: note, integrator: Akron: several units would do
    … would do as well as …, which was heard first; set device_pin
    -> Set device_pin
akron.bus.stick: stop, technician: Akron joystick: it is broken
    the joystick at joy_source reports …; have it repaired
    -> Have it repaired
akron.soe.off: step, integrator: Akron unit: it waits for permission
    SOE mode is active, so the unit moves only with permission; set soe_permissive
    -> Set soe_permissive
akron.soe.withheld: step, operator: Akron unit: it has no permission yet
    move the stick to give the SOE permission: …
    -> Let go of the stick, and move it
akron.position.uncalibrated: note, technician: Akron unit: not calibrated
    the unit is not calibrated; calibrate it as its reference manual says
    -> Calibrate it as its reference manual says
akron.position.error: note, technician: Akron unit: the {axis} position is in error
    the … position is in error; check its sensor
    -> Check its sensor
akron.fault.told: note, technician: Akron unit: it tells of a fault
    …; see the Error Flash Codes in the reference manual of the device
    -> See the Error Flash Codes in its manual
""")
