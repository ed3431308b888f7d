# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the SSC and its link say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
ssc.link.silent: stop, technician: SSC: nothing comes
    check the SSC's power …: no status from the SSC …
    -> Check its power
    -> Check the cable: RX and TX swapped? Is it Primary Comm?
    -> Leave its configuration menus
ssc.link.garbled: stop, integrator: SSC: bytes come, but no frame
    check baud … bytes come, but no frame
    -> Set baud: an SSC has 115200
    -> Check that port is the SSC: ros2 run rugged_teleop doctor --params-file
    -> Leave its configuration menus
ssc.link.byte_count: stop, integrator: SSC: its firmware counts other bytes
    update the firmware of the SSC, or report it with a capture: …
    -> Update its firmware
    -> Or report it with a capture
ssc.setup.unread: stop, technician: SSC: its configuration is not read yet
    the configuration of the SSC is not read yet
    -> Wait a moment
    -> Check the wire from our TX to R1
ssc.setup.another: stop, technician: SSC: it is another one
    connect the SSC with configuration ID …, or set config_id: this one has …
    -> Connect the right one
    -> Or set config_id
ssc.setup.contradicts: stop, technician: SSC: its messages do not fit its configuration
    message … contradicts the configuration (… channels, but … are set up)
    … (other auxiliary channels measure than are set up to)
    -> Wait a moment
    -> If it stays, power-cycle the SSC
ssc.command.stop: stop, operator: SSC: its command channel says stop
    switch the transmitter on …: command channel: …
    move its switch …: command channel: …
    -> Switch the transmitter on
    -> Move its switch
    -> Check receiver and pulse input 1
ssc.command.none: echo, integrator: SSC: nobody commands its outputs
    outputs at failsafe: no fresh command for …; start the node that commands them
    -> Start the node that commands them
ssc.inputs.silent: note, integrator: SSC: no pulse inputs come
    check poll_rates, and the wire from our TX to R1: no pulse inputs come …
    -> Check poll_rates
    -> Check the wire from our TX to R1
ssc.stick.faulty: stop, technician: SSC: a control has no believable pulse
    no believable pulse: …; check the receiver, its cables and the calibration
    -> Check the receiver and its cables
    -> Check the calibration
ssc.servo.missing: note, integrator: SSC: there is no output for {servo}
    servo …: there is no output …, only …; check servo.….channel
    -> Correct servo.<name>.channel
ssc.output.elsewhere: note, operator: SSC: output {output} obeys another source
    …: output … is on …, not on SERIAL, so that commands have no effect; …
    -> Move the transmitter's switch to SERIAL
    -> See the switch table of its configuration
ssc.line.full: note, integrator: SSC: its line is full
    messages … the SSC need … bit/s, the line has …: lower poll_rates, command_rate or …
    -> Lower poll_rates, command_rate or its own rates
ssc.link.looped: note, technician: SSC: our own frames come back
    is RX wired to TX, or echo on? Our own frames come back
    -> Look for RX wired to TX, or an echo
""")
