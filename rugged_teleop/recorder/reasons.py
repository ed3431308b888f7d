# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the recorder says of recordings and ledger, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
recorder.failed: note, technician: The last recording failed
    make room or correct folder: the last recording failed: …
    nothing is recorded: …
    -> Make room on the disk
    -> Or correct folder; the next stop tries again
recorder.slow: note, technician: Some messages are not recorded
    use a faster disk: it was too slow for some messages
    use a faster disk: it has not yet taken the minute before; /diagnostics will tell
    -> Use a faster disk; see dropped messages
recorder.hangs: note, nobody: The recorder is too busy to answer
    call it again, nothing is recorded: …
    -> Call it again
recorder.none: note, operator: There is no recording to keep
    nothing is kept: there is no recording
    -> Call ~/save first
recorder.alone: note, integrator: The recorder hears no node
    start the nodes: none is there to record
    -> Start the nodes
    -> Compare ROS_DOMAIN_ID
recorder.ledger.failed: note, technician: The ledger cannot be written
    make room or correct ledger.file: …
    -> Make room on the disk; lines wait in memory
    -> Two recorders: give each a folder
recorder.ledger.lost: note, technician: Lines of the ledger are lost
    make room: some lines are lost for ever
    -> Make room on the disk
    more record.md#the-ledger
recorder.ledger.anchor: note, technician: The ledger's second place cannot be written
    correct ledger.anchor: …
    -> Correct ledger.anchor; the ledger goes on
recorder.brakes: note, technician: The machine stops slower than commissioned
    have the brakes looked at, they stop slower than commissioned: …
    -> Have the brakes looked at
    more record.md#stops-are-measured
recorder.untried: note, operator: Not seen to work lately: {names}
    press and release each of these, last seen to work: …
    -> Press and release each
    -> A stop by a lost link does not count
    more commissioning.md#the-daily-check
""")
