# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the mux says, by code; see ``bridge_core.reasons``. docs/inhibits.md is made of it."""

from bridge_core.reasons import entries

REASONS = entries("""
mux.stopped: note, nobody: The machine was stopped
    stopped … ago
    stopped … ago: …
    -> Look at the other reasons
mux.reset.due: step, operator: Ready for a reset
    waiting for reset: call ~/reset
    -> Reset
mux.reset.clearing: step, nobody: The stops have only just cleared
    all stops have been clear for … of …
    -> Wait a moment, then reset
mux.reset.script: stop, integrator: Something resets again and again
    resets have been called since before the stop, so none counts until there was none for …
    -> End what calls ~/reset
    -> Wait for reset_silence, then reset
mux.button.quiet: note, technician: The reset button is not heard
    the reset button is silent: never heard, limit …
    the reset button is stale: last heard …
    -> Start what publishes reset_topic, at 10 Hz or more
    -> Until then, reset by ~/reset
mux.button.held: stop, operator: The reset button is held
    the reset button has been held for …: release it
    -> Release it within 2 s
    -> Look whether it sticks
mux.trip.active: step, operator: A trip is active
    a trip is active until ~/end_trip is called, or a reset succeeds
    -> Reset
    -> If it is refused, reset again
mux.trip.called: stop, nobody: The machine was tripped just now
    ~/trip was called
    -> Reset when it may move again
mux.source.silent mux.source.stale: stop, technician: The node of {source} is not heard
    e-stop source '…' is silent: never heard, limit …: start its node
    e-stop source '…' is stale: last heard … ago, limit …: start its node
    -> Start its node
    -> Compare name, namespace and type: ros2 topic info -v
    -> Look at the rate: ros2 topic hz
mux.source.was_stale: stop, integrator: {source} was not heard for a moment
    e-stop source '…' was stale: …
    -> Reset
    -> Give computer and network less work
mux.input.old: stop, technician: What {name} says comes late
    … is old: what it says is up to … old, limit …: look at the network to its node
    … was old: …
    -> Look at radio, VPN or relay to its node
    -> It clears below age_limit
    more old_news.md
mux.input.unproven: stop, integrator: {name} does not prove its age
    … is old: its node proves no age: look at the network to it, and at its version
    -> Look whether its ~/proof comes
    -> A foreign node: set proof to auto
mux.input.restarted: stop, technician: {node} was restarted
    … is invalid: … was restarted
    -> Find out why it ended
mux.input.creeping: note, technician: What {node} says grows old
    what … says was up to … old, the limit of … is …: look at the network to it
    -> Look for a queue on the network to it
    more old_news.md
mux.source.lost: stop, integrator: Messages of {topic} were lost
    e-stop source '…' is invalid: … messages of … were lost
    -> Reset; one may have been a stop
    -> Give computer and network less work
mux.topic.unpublished: echo, integrator: Nobody publishes {topics}
    nobody publishes …: start its node, or correct the topic
    -> Start its node, or correct the topic
    -> Compare the files: ros2 run rugged_teleop doctor --params-file
mux.source.stop: stop, operator: {source} demands a stop
    e-stop source '…' demands a stop: …
    e-stop source '…' demanded a stop
    operator '…' cannot take control: e-stop source …
    -> Do what its node says
    -> A button is released at the device itself
mux.source.echo: echo, nobody: {source} is stopped by the others
    e-stop source '…' demands a stop: …
    -> End the other stops first
mux.output.doubled: stop, integrator: Somebody else publishes {topics}
    stop the other publisher of …: a second mux?
    -> End the other one: ros2 topic info -v
mux.source.own_silent: note, integrator: The own e-stop of {source} is not heard
    own e-stop of e-stop source '…': …; other devices are asked to stop
    -> Start what publishes own_topic
    -> Only ~/stop_demand depends on it
mux.operator.silent mux.operator.stale: note, technician: The sticks of {operator} are not heard
    operator '…' is silent: …
    operator '…' is stale: …
    … is stale: …; its device says: …
    … is silent: …; its device says: …
    the owner was lost: …
    -> Switch the remote on
    -> See what its bridge says of the link
    -> Does it publish Joy?
mux.operator.busy: step, operator: {operator} is not at neutral
    operator '…' is not at neutral: let go of its sticks and of its deadman
    -> Let go of sticks and deadman
    -> Repair a stick that stays off
mux.operator.invalid: stop, integrator: The sticks of {operator} do not fit
    operator '…' is invalid: it has … axes, … are needed
    operator '…' is invalid: it has … buttons, … are needed
    operator '…' is invalid: deadman button … does not exist
    operator '…' is invalid: axis … is …, beyond -1.05...1.05
    -> Correct operator.<name>.axis or deadman_buttons
    -> Beyond 1.05: its driver has to scale to ±1
mux.operator.same_stamp: stop, operator: The pad of {operator} may be gone
    operator '…' is invalid: its stamp has been the same for …
    operator '…' is invalid: its messages have no stamp
    -> Switch the pad on, and bring it into reach
    -> If its driver sets no stamps: require_moving_stamps
mux.operator.may_be_gone: note, operator: The pad of {operator} may be gone
    operator '…' may be gone, and its sender repeat an old message: …
    -> Look whether the pad is on and in reach
    -> To have it stop: require_moving_stamps
mux.operator.press: step, operator: {operator} may take control
    press the deadman of '…' to take control
    press the deadman of '…' to take control; its device says: …
    -> End its menu or pause, if there is one
    -> Press the deadman
mux.operator.other_buttons: step, operator: Not the deadman of {operator} is pressed
    operator '…': buttons pressed: …; its deadman: …
    -> Press all buttons of the deadman
    -> Or correct deadman_buttons
mux.operator.early: step, operator: The deadman of {operator} was pressed too early
    operator '…' held its deadman before it could count: release it
    -> Release it
    -> Rest for neutral_time
    -> Press it again
mux.operator.unrested: step, operator: {operator} has not been at neutral yet
    operator '…' has not been neutral since the last reset or use of its deadman
    -> Let go of the sticks
mux.operator.resting: step, nobody: {operator} has to rest a moment
    operator '…' has been neutral for … of …
    -> Wait, then press the deadman
mux.operator.starts: step, nobody: The output passes through zero
    operator '…' takes control: the output passes through zero first
    -> Wait
mux.standstill: step, nobody: The joints do not stand yet
    …; ramping, left at … rad/s
    …; waiting for standstill, left at … rad/s
    waiting for standstill: left at … rad/s
    waiting for standstill: not measured since
    -> Wait until the joints stand
mux.overruled: step, operator: {owner} is losing control
    … is losing control: operator '…' moved its sticks
    … is losing control: operator '…' pressed its deadman…
    …, which did not count: …less than … after a change of owner…
    …; e-stop source '…' …
    -> Let go of everything
    -> Rest for neutral_time or hold_time
    -> Press the deadman
mux.owner.zero: step, operator: {owner} asks for zero
    … has control and asks for zero
    -> Move the stick; or the planner sends zero
mux.owner.axis_button: step, operator: {owner} does not hold the button of an axis
    operator '…' pushes …axis … without button … (operator.….axis_buttons)
    -> Hold the button of the axis, too
    -> Or correct axis_buttons
mux.autonomy.silent mux.autonomy.stale: note, integrator: The planner is not heard
    autonomy is silent: …
    autonomy is stale: …
    -> Start the planner
    -> Have it publish at rest, too
mux.autonomy.invalid: stop, integrator: The planner sends what does not fit
    autonomy is invalid: the twist is not finite: …
    autonomy is invalid: its demand is not finite: …
    autonomy is invalid: its demand is beyond ±…: …
    autonomy is invalid: it has a demand for … joints, not …
    autonomy is invalid: its joints are …, not …
    autonomy is invalid: it has … names and … values
    autonomy is invalid: joint '…' is …
    -> Correct the planner
mux.autonomy.resting: step, integrator: The planner has to ask for zero
    autonomy has asked for zero for … of …
    autonomy has not asked for zero for …: silence is no rest
    -> Send zero for neutral_time
mux.autonomy.select: step, operator: Autonomy may be given control
    call ~/select_autonomy to give autonomy control
    -> Call ~/select_autonomy, if you want that
mux.stopping: step, nobody: The machine stops on a ramp
    stopping on a ramp: …
    -> Wait: stop category 1, STOPPED follows
mux.motion.unstopped: stop, operator: The joints do not stand
    the joints do not stand … after control: …
    -> Stop the machine by other means
    -> Look at brake, drive and slope
    -> If it only coasts: a longer stop_time
mux.motion.overspeed: stop, operator: {joint} runs as nobody asked
    joint '…' runs at … rad/s, asked for …
    -> Look at brake, drive and slope
    -> If it lags behind its ramp: a larger overspeed_tolerance
mux.limit.slows: note, integrator: {limit} slows the machine
    speed limit '…' allows … %
    -> If stale or invalid: look at what publishes it
mux.limit.end: note, operator: {joint} is near its end
    joint '…' is at … rad, near its end: only back
    joint '…' is at … rad, near its end: … % of its speed
    -> Move it back
mux.feedback.silent mux.feedback.stale mux.feedback.invalid: stop, integrator: Joints unseen
    the feedback is silent: …
    the feedback is stale: …
    the feedback is invalid: …
    -> Start the drive node: it publishes feedback.topic
    -> It needs the velocity of all joints
mux.frozen: stop, integrator: The mux was frozen
    this process was frozen: … between two ticks, limit …
    -> Give the computer less work, then reset
    -> Only then raise stall_limit
mux.commissioning: note, integrator: These parameters were not tried
    not validated: …
    not validated: the package was …, is …
    not validated: it is of another machine, of …
    not validated: it was a simulated machine
    not validated: the trial failed
    not validated: … is no report: …
    … is empty: name the report.json
    -> Set them back, or commission the machine
    -> No report: correct commissioning.report
    more commissioning.md
mux.inactive: stop, integrator: The mux is not active
    the mux is not active: activate the node
    -> ros2 lifecycle set /safety_mux configure, then activate
mux.commands.unheard: stop, integrator: No drive listens to the mux
    nobody listens to ~/command…
    nobody listens to ~/cmd_vel…
    -> Start the drive node or base controller
    -> Correct its remapping
    more decisions/0036-who-obeys-a-command.md
mux.joy.held: step, operator: {operator} holds what was held before
    ~/joy/… leaves out what was held before: let go of …
    -> Let go of it, then move it
mux.drive.silent mux.drive.stale: stop, technician: The node of {drive} is not heard
    … waits for … to be enabled: the drive is silent: …
    … waits for … to be enabled: the drive is stale: …
    -> Start its node
    -> Compare enabled_topic with its name
mux.drive.disabled: stop, operator: {drive} is not enabled
    … waits for … to be enabled: it says that it is not
    … waits for … to be enabled: … was not enabled
    … to be enabled: …; its device says: …
    mend what the drive says, here or in /diagnostics; then give control back and take it anew
    -> Wait a moment
    -> Do what the drive says
    -> Press the deadman anew
""")
