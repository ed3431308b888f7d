# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What all nodes say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
node.inactive: stop, integrator: The node is not active
    the node is not active
    -> Activate it: ros2 lifecycle set
port.closed: stop, technician: The port is not open
    not opened yet
    the port is not open
    the port is closed
    -> Look at plug, permission and other programs
    -> Ask the doctor: ros2 run rugged_teleop doctor
port.missing: stop, technician: There is no such port
    cannot open …: no such port; plug the device in, or set the parameter port
    -> Plug the device in
    -> Or set port: ls -l /dev/serial/by-id
port.wrong: stop, integrator: The port is no serial port
    … a folder; set the parameter port
    … no serial port; set the parameter port
    -> Set port: ls -l /dev/serial/by-id
port.no_permission: stop, integrator: No permission to open the port
    … no permission; add your user to the group dialout and log in again
    -> Add your user to the group dialout
    -> Log in again
port.in_use: stop, integrator: Another program has the port
    … in use by another program; close that one
    -> Close it: sudo fuser -v PORT names it
    -> Often it is ModemManager: install the udev rules
port.dead: stop, technician: The port does not answer
    … the device does not answer; is it plugged in?
    -> Unplug the device and plug it in
gate.stopped: echo, operator: It is stopped with the mux
    e-stop input is true
    -> Look at ~/status of the mux
gate.disabled: echo, operator: The mux does not enable it
    enable is false
    enable went false
    … is not true
    -> Take control: press the deadman
gate.stale: stop, integrator: Its {input} is not heard
    e-stop input is stale: …
    enable is stale: …
    command is stale: …
    -> Start the mux
    -> Compare its wiring with this input
gate.refused: stop, integrator: Its command is refused
    command refused: …
    -> Correct what sends it
gate.neutral: step, operator: It waits for a neutral command
    the command must be neutral once
    -> Let go of the stick
gate.edge: step, operator: It waits for enable to rise
    enable must go false, then true again
    enable was not heard false before, after the last stop
    -> Release the deadman, and press it
link.damaged: note, technician: Much of what comes is damaged
    check cable, shield, ground and bit rate: … of what comes is damaged
    -> Check cable, shield and ground
    -> Check baud or bit rate: a wrong one damages all
input.doubled: stop, integrator: Two nodes publish {topic}
    stop one of the two publishers of …: while both are heard, only stops count
    … is invalid: two live publishers on …: stop one of them
    -> End one: a second bridge, or ros2 topic pub
    -> It clears then; 20 s later for one that was killed
input.two_nodes: stop, integrator: Two nodes have the name {node}
    … is invalid: two nodes named … prove what they say: stop one of them
    -> Give each machine a namespace or a domain
input.best_effort: stop, integrator: The stop on {topic} cannot be heard
    … is invalid: … publishes … best effort: make it reliable
    -> Publish it reliable
input.wrong_type: stop, integrator: Another type is published on {topic}
    … is invalid: … publishes … on …, not Bool
    -> Rename one of the topics
input.lost: stop, integrator: Messages of an input were lost
    messages of … were lost: one may have been a stop
    -> Release the deadman, and press it
    -> Give computer and network less work
gate.unpublished: echo, integrator: Nobody publishes {topics}
    …; nobody publishes …
    -> Start who does, or correct the remapping
gate.waits: step, nobody: It waits for the device
    wait for the device
    wait for a status that says where the axis stands
    -> Wait
gate.last_stop: note, nobody: It stopped before
    last stop: …
    -> Look at the other reasons
gate.old: stop, technician: What {mux} says comes late
    what … says is up to … old, limit …: look at the network to it
    the command of … is up to … old …
    … was too old in the last 1 s …
    … older than it proves
    -> Look at the network to the mux
    -> It clears 1 s after the last that was too old
    more old_news.md
gate.creeping: note, technician: What {mux} says grows old
    what … says is up to … old, limit …: look at the network to it
    -> Look at the network to the mux
    more old_news.md
gate.unproven: stop, integrator: {mux} does not prove its age
    … proves no age: look at the network to it, and at its version
    -> Look whether ~/proof of the mux comes
    -> Another node than the mux: set proof to auto
link.network: note, integrator: Its line goes over a network
    join the device by a port of this computer: its line goes over a network …
    -> Join it by a port of this computer
link.interrupted: stop, technician: Something was lost that may have been a stop
    this node was held up for … s, and discarded what came meanwhile …
    the node did not take what its wire had to tell …
    -> Give the computer less work
wire.down: stop, technician: Its process has failed, and is replaced
    the wire of … does not work, its process … hangs: nothing was heard of it for … ms
    … was killed by …, was killed by signal …, ended with …
    … no process can be started: …
    -> Wait: it is replaced
    -> If it comes back: dmesg, ulimit -u, a hung driver
node.leaves: stop, nobody: The node ends
    the node leaves
    -> Start it again
""")
