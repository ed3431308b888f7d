# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the box and its contacts say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
io.estop.pressed: stop, operator: {name} is pressed
    release …: it is pressed, or both its wires are cut
    -> Release it
    -> Nobody pressed it: check both its wires
io.estop.one_channel: stop, technician: {name}: one channel says pressed
    check the wires of …: channel … alone says pressed
    -> Check its wires and contacts
    -> Compare estop_kind
io.estop.discrepant: stop, technician: {name}: its channels disagreed
    press and release …, and check its contacts and wires: its channels disagreed for …
    -> Press it, and release it
    -> Check its contacts and wires
io.estop.released: stop, nobody: {name} was released just now
    wait: … was released just now
    -> Wait for debounce
io.estop.unread: stop, nobody: {name} was not read yet
    … was not read yet
    -> Wait a moment
io.link.silent: stop, technician: I/O box: nothing comes
    check power and cable of the box, unit: inputs were …
    check power and cable of the box, unit, baud and 8N1: inputs were …
    check port and lines: inputs were …
    -> Check its power and its cable
    -> Check unit, baud and 8N1; on GPIO port and lines
io.inputs.refused: stop, integrator: I/O box: it refuses to read
    check lines and unit: the box refuses to read its inputs (exception …)
    -> Correct lines and unit
    -> Exception 1: no such function; 2: no such line; 4: it failed
io.outputs.refused: note, integrator: I/O box: it refuses to set outputs
    check output_lines: the box refuses to set them (exception …)
    -> Correct output_lines
    -> Exception 1: no such function; 2: no such line; 4: it failed
io.key.doubled: note, technician: I/O box: the key is in two positions
    check the wires of the key switch: two positions are on; the lowest speed holds
    -> Check the wires of the key switch
io.state.unheard: note, integrator: I/O box: it hears no mux
    check state_topic, and start the mux: …; all outputs are off
    -> Start the mux
    -> Or correct state_topic
io.port.closed: stop, technician: I/O box: its port is closed
    plug the box in, and check port: it is not open
    -> Plug the box in
    -> Check port
""")
