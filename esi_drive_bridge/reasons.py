# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the drive and its link say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
esi.overcurrent.a esi.overcurrent.b: stop, technician: ESI drive: overcurrent
    axis …: overcurrent: check for a blocked or shorted motor
    -> Check for a blocked or shorted motor
    -> Call ~/clear_errors
esi.loss_of_feedback.a esi.loss_of_feedback.b: stop, technician: ESI drive: loss of feedback
    … loss of feedback: check encoder or resolver and its cable
    -> Check encoder or resolver and its cable
    -> Call ~/clear_errors
esi.overspeed.a esi.overspeed.b: stop, technician: ESI drive: overspeed
    … overspeed: check the load, the velocity limit and the loop tuning
    -> Check load, velocity limit and loop tuning
    -> Call ~/clear_errors
esi.motor_temperature.a esi.motor_temperature.b: stop, operator: ESI drive: the motor is hot
    … motor temperature: let the motor cool, check load and sensor
    -> Let the motor cool
    -> Check load and sensor
    -> Call ~/clear_errors
esi.internal_temperature.a esi.internal_temperature.b: stop, operator: ESI drive: it is hot
    … internal temperature: let the drive cool, check cooling
    -> Let the drive cool
    -> Check its cooling
    -> Call ~/clear_errors
esi.brake.a esi.brake.b: stop, technician: ESI drive: brake over- or undercurrent
    … brake over- or undercurrent: check the brake and its wiring
    -> Check the brake and its wiring
    -> Call ~/clear_errors
esi.current_calibration.a esi.current_calibration.b: stop, technician: ESI drive: uncalibrated
    … phase current sensors failed to calibrate: power-cycle the drive with the motor at rest
    -> Power-cycle the drive with the motor at rest
esi.logic_fault.a esi.logic_fault.b: stop, technician: ESI drive: logic voltage out of range
    … logic voltage out of range: check the logic supply
    -> Check the logic supply
    -> Call ~/clear_errors
esi.overvoltage.a esi.overvoltage.b: stop, technician: ESI drive: overvoltage
    … overvoltage: check the supply, and where braking energy goes
    -> Check the supply, and where braking energy goes
    -> Call ~/clear_errors
esi.undervoltage.a esi.undervoltage.b: stop, technician: ESI drive: undervoltage
    … undervoltage: check supply, fuses and cable for sag under load
    -> Check supply and fuses
    -> Check the cable for sag under load
    -> Call ~/clear_errors
esi.processors.a esi.processors.b: stop, technician: ESI drive: its processors lost each other
    … CAN between the processors of the drive failed
    -> Power-cycle the drive
    -> Have it repaired
esi.unnamed.a esi.unnamed.b: stop, technician: ESI drive: an error without a name
    … error condition without an error bit: read the cause with HiDS
    -> Read the cause with HiDS
    -> Call ~/clear_errors
esi.line.a esi.line.b: stop, technician: ESI drive: it gets no good packets
    axis A: RS422 packet error or timeout: check the transmit pair, baud, single_axis_layout and
        HiDS's SerialChecksumErrorCount
    axis A: RS422 timeout, as this node sent nothing for … ms: give the computer less work; call
        ~/clear_errors if it stays
    -> Call ~/clear_errors
    -> Check the transmit pair, baud and single_axis_layout
    -> Give the computer less work
esi.clear: step, operator: ESI drive: it keeps its errors
    then call ~/clear_errors, as the drive keeps its errors until it is asked
    -> Mend the cause
    -> Call ~/clear_errors, or rugged_teleop clear
esi.link.silent: stop, technician: ESI drive: nothing comes
    check power, the receive pair, and HiDS's SerialInterfaceEnable: no status from the drive, …
    -> Check its power
    -> Check the receive pair
    -> Look at SerialInterfaceEnable in HiDS
    more devices/esi_drive.md#troubleshooting
esi.link.garbled: stop, integrator: ESI drive: bytes come, but no frame
    check baud, that port is the drive, and single_axis_layout …
    -> Set baud as in HiDS
    -> Check that port is the drive: ros2 run rugged_teleop doctor --params-file
    -> Try the other single_axis_layout
esi.disobeys: stop, technician: ESI drive does not obey
    cut the power of axis …, then check our pair to the drive, and who else commands it: it is
        still enabled … ms after disable was sent
    … it is enabled, and was not by this node since it opened the port
    -> Cut its power
    -> Check our pair to the drive
    -> Look who else commands it
    more decisions/0021-drive-that-does-not-obey.md
esi.warning: note, technician: ESI drive: a warning of axis {axis}
    the drive reports a warning: read it with HiDS
    -> Read it with HiDS
esi.astray: note, technician: ESI drive: {joint} does not follow
    check that mode and scale of … are as in HiDS, and that nothing holds it: …
    -> Check mode and scale: as in HiDS
    -> Look what holds it
esi.second_axis: note, integrator: ESI drive: it has a second axis
    name two joints in joint_names if the drive has two axes: …
    -> Name two joints in joint_names
esi.line.full: note, integrator: ESI drive: its line is full
    raise baud in HiDS and here, or lower the rate: …
    -> Raise baud in HiDS and here
    -> Or lower the rate
esi.command.cut: note, integrator: ESI drive: a command for {joint} is cut
    …, so every velocity and torque is cut to … %
    -> Correct limits and scale
esi.clearing: step, nobody: ESI drive: its errors are being cleared
    errors are being cleared
    -> Wait
esi.stalled: stop, technician: ESI drive: its node was held up
    this node stalled for … ms, limit … ms
    -> Release the deadman, and press it
    -> Give the computer less work
esi.not_enabled: stop, technician: ESI drive: it did not become enabled
    the drive did not become enabled within … ms
    -> Look at its enable input and STO
    -> Read its state with HiDS
esi.disabled: stop, technician: ESI drive: axis {axis} disabled itself
    axis … disabled itself
    -> Read its cause with HiDS
    -> Release the deadman, and press it
esi.position.unanswered: step, nobody: ESI drive: its position is not known yet
    wait until the drive has answered packets in position mode
    -> Wait
esi.position.limit: stop, technician: ESI drive: {joint} is beyond its packets
    move … by hand to within …: its measured position is at the limit of a packet …
    -> Move it by hand to within the limit
""")
