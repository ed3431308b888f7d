# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC and its link say, by code; see ``bridge_core.reasons``. Its page is made of it."""

from bridge_core.reasons import entries

REASONS = entries("""
fort.estop.remote: stop, operator: FORT remote: e-stop pressed, or out of reach
    release the stop at SRC (remote), then acknowledge on the remote …
    -> Release it, or bring it into reach
    -> Acknowledge on the remote
fort.estop.wired: stop, operator: FORT VSC: wired e-stop pressed
    release the stop at VSC (wired input) …
    -> Release the wired e-stop
    -> Acknowledge on the remote
    -> Check both loops
fort.estop.any: stop, operator: FORT VSC: a stop is pressed
    release the stop at the remote, the wired input or a computer …
    -> Release the stop at the remote
    -> Acknowledge it there
    -> Look at the VSC's LED
fort.estop.unknown: stop, technician: FORT VSC: a stop of unknown source
    release the stop at unknown source …
    -> Read the VSC with the maker's tool
fort.remote.off: echo, operator: FORT remote: not connected, or not acknowledged
    switch the remote on, bring it into reach, acknowledge on it: mode is …
    -> Switch it on
    -> Bring it into reach
    -> Acknowledge on it
fort.mode.strange: stop, technician: FORT VSC does not say that it works
    restart the VSC if this lasts, look at its LED, check its firmware: mode is …
    -> Restart the VSC
    -> Look at its LED, and at its firmware
fort.estop.asked: echo, operator: FORT VSC: stopped by this computer
    end what ~/software_estop asks for …
    wait: the port was opened anew …
    start what publishes ~/software_estop …
    start this node anew …
    -> End what ~/software_estop asks for: see the mux's ~/status
    -> Acknowledge on the remote
    more devices/fort_vsc.md#the-software-e-stop
fort.estop.held: stop, operator: FORT VSC: holds an earlier stop
    acknowledge on the remote: VSC reports e-stop: USER (this computer), not asked any more
    … not asked by this node …
    -> Acknowledge on the remote
    -> If it comes back, see whether heartbeats fail
fort.remote.not_operational: step, operator: FORT remote: in Remote mode
    bring the remote into Operational mode: it is in Remote mode …
    -> Bring it into Operational mode
fort.remote.menu: step, operator: FORT remote: in its menu
    leave the menu of the remote: it is in Menu mode …
    -> Leave it by the Menu button
fort.remote.paused: step, operator: FORT remote: paused
    take the remote in hand, hold it upright and leave Pause mode on it: …
    -> Hold it upright
    -> Leave Pause mode by its button
fort.line.late: stop, technician: FORT VSC: the line is late
    look at the network to the serial server: what comes over this line is up to …
    -> Look at the network to the serial server
    more devices/fort_vsc.md#a-serial-server
fort.line.slow: note, technician: FORT VSC: the line is slow
    look at the network to the serial server: the VSC answers after …
    -> Look at the network to the serial server
    more devices/fort_vsc.md#a-serial-server
fort.line.no_answer: note, technician: FORT VSC: its line tells no age
    look at the VSC's firmware, or join it by USB, RS232 or CAN: …
    -> Look at its firmware
    -> Or join it by USB, RS232 or CAN
fort.line.unbounded: note, integrator: FORT VSC: the age of its line is unbounded
    set line_age_limit: this line goes over a network …
    -> Set line_age_limit
fort.port.closed: stop, technician: FORT VSC: its port is closed
    plug the VSC in, and check port …: it is not open
    -> Plug the VSC in
    -> See what the link says: ros2 run rugged_teleop doctor
fort.link.silent: stop, technician: FORT VSC: nothing comes
    check power and serial cable of the VSC: no heartbeat from the VSC …
    check the VSC's power, the CAN wiring, the bit rate and can.heartbeat …
    check the VSC's power and USB cable, and that port is its hidraw device: no report from the
        VSC …
    -> Check its power and its LED
    -> Check the cable: TX and RX swapped?
fort.link.garbled: stop, integrator: FORT VSC: bytes come, but no frame
    check baud, and that port is the VSC …
    check that port is the hidraw device of the VSC …
    -> Set baud: RS232 has 115200 bit/s
    -> Check that port is the VSC
fort.link.no_heartbeat: stop, technician: FORT VSC: its heartbeat is off
    enable its heartbeat message, as joystick messages do come …
    compare can.heartbeat with the VSC …
    -> Enable it by the maker's tool
    -> Too slow: raise link_timeout, then set device.heartbeat_interval_ms
    -> CAN: compare can.heartbeat
fort.link.no_joystick: note, technician: FORT VSC: no joystick messages come
    set device.joystick_interval_ms …
    compare can.left_basic and so on with the VSC …
    …: no joystick messages come
    -> Set device.joystick_interval_ms to 20, with configure_device
    -> CAN: compare can.left_basic and so on
fort.link.foreign: stop, technician: FORT VSC: frames of another come
    take the other sender of … off this bus …
    update this software or the VSC, their firmware does not match …
    -> Take the other sender off this bus
    -> Serial: update this software or the VSC
fort.link.two_vscs: stop, technician: FORT VSC: two on one bus
    take one of two VSCs off this bus, or change its identifiers; else set vsc_heartbeat_rate …
    -> Take one off this bus, or change its identifiers
    -> It clears 3 s after the last excess
    more decisions/0026-one-identity-one-sender.md
fort.link.looped: note, technician: FORT VSC: our own frames come back
    look for RX wired to TX, or an echo on the line: our own frames come back
    -> Look for RX wired to TX, or an echo
fort.link.deaf: stop, technician: FORT VSC does not hear this computer
    check the line from this computer to the VSC (its serial RX), then press a wired stop …
    -> Press a wired stop
    -> Check the line from this computer to its RX
fort.stick.faulty: stop, technician: FORT remote: a control is broken
    have the remote repaired: it reports …
    -> Have the remote repaired
    -> To drive without it: tolerate_faulty_axes
fort.stop.not_carried: stop, integrator: FORT VSC: this line carries no software e-stop
    wire that stop elsewhere: transport … cannot carry software_estop …
    -> Wire that stop elsewhere
    more devices/fort_vsc.md#what-each-transport-can-do
fort.setting.not_written: note, integrator: FORT VSC: {names} not written
    set configure_device, or leave … out: nothing is written while it is false
    -> Set configure_device, or leave them out
    more devices/fort_vsc.md#what-the-device-keeps
fort.setting.refused: note, technician: FORT VSC: {name} is not taken
    see the VSC's firmware and the maker's tool: device.…: differs, and the device does not take it
    -> Look at its firmware and the maker's tool
    -> Try again: deactivate, activate
fort.setting.unanswered: note, technician: FORT VSC: {name} is not known
    connect a remote, and see that the VSC hears this computer: device.…: not known, as the device
        does not answer
    -> Connect a remote; some settings need it
    -> See that the VSC hears this computer
fort.setting.overruled: note, integrator: FORT VSC: {name} was set otherwise
    change the parameter, or what ~/set_user_value says: device.…: overruled by ~/set_user_value
    -> Change the parameter, or what ~/set_user_value says
fort.battery.low: note, operator: FORT remote: battery at {percent} %
    charge the remote: its battery is at … %
    -> Charge the remote
fort.radio.weak: note, operator: FORT remote: radio at its weakest
    bring the remote nearer …
    -> Bring the remote nearer
    -> Keep its way to the VSC clear of metal
""")
