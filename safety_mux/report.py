# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``~/status`` says: the whole answer to 'why does it not move?'."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from bridge_core import report
from bridge_core.session import Level
from bridge_core.watchdog import in_words
from safety_mux.protocol import State, Status

# Nodes that look at a command and move nothing by it: the package's own, and tools of ROS.
_ONLOOKERS = (
    'status_page',
    'recorder',
    'rosbag2_recorder',
    'foxglove_bridge',
    'rosbridge_websocket',
)
_LOOK = ('_', 'rqt', 'rviz')  # how further ones begin, such as those of ros2 topic echo and doctor
_PATIENCE = 0.5  # s that a drive may take to enable before that is worth a word


class Surroundings(NamedTuple):
    """
    What the arbiter does not know.

    :param unheard: the topic of the commands if nobody obeys it, and who looks on; else empty.
    :param unpublished: topics of sources and owners that nobody publishes.
    :param button: what is wrong with the reset button; None: nothing, or there is none.
    :param held: by operator, what its gated Joy leaves out.
    :param pressed: by operator, which buttons he presses instead of his deadman, in words.
    :param old_stamps: by operator, why it may be gone.
    :param refused_reset: when (s), and what it was answered; None if the last one counted.
    """

    unheard: str
    unpublished: Sequence[str]
    button: str | None
    held: Mapping[str, Sequence[str]]
    pressed: Mapping[str, str]
    old_stamps: Mapping[str, str]
    refused_reset: tuple[float, str] | None


def unheard(topic: str, listeners: Iterable[str]) -> str:
    """
    Return the topic, and who looks on, if nobody obeys it; empty if somebody does.

    :param listeners: names of the nodes that subscribe to it.
    """
    names = sorted(set(listeners))
    if any(name not in _ONLOOKERS and not name.startswith(_LOOK) for name in names):
        return ''
    return f'{topic}, but for {", ".join(names)}' if names else topic


def report_of(status: Status, around: Surroundings, now: float) -> report.Status:
    """Return it; WARN while the machine is kept from moving."""
    inhibits = [*status.inhibits, *_further_inhibits(status, around, now)]
    stopped = status.state is State.STOPPED
    warnings = [
        f"operator '{name}' may be gone, and its sender repeat an old message: {why}"
        for name, why in around.old_stamps.items()
    ]
    values = _fields(status)
    values |= {f'inhibit {n}': text for n, text in enumerate(inhibits, 1)}
    values |= {f'age of {name} (s)': age for name, age in status.ages.items()}
    last = status.last_transition
    values['last transition'] = (
        f'{last.before.value} to {last.after.value}, {now - last.at:.1f} s ago: {last.reason}'
    )
    values |= {f'warning {n}': text for n, text in enumerate(warnings, 1)}
    slowed = [each for each in status.slowed if each not in inhibits]
    moves = f'{status.owner} has control'
    message = '; '.join(['; '.join(inhibits) or moves, *slowed, *warnings])
    if around.refused_reset is not None and stopped:
        at, answer = around.refused_reset
        refused = f'refused {in_words(now - at)} ago'
        values['last reset'] = f'{refused}: {answer}'
        message += f'; the last reset was {refused}'
    bad = stopped or warnings or status.state is State.STOPPING
    return report.Status(Level.WARN if bad else Level.OK, message, values)


def _fields(status: Status) -> dict[str, Any]:
    """Return what programs read."""
    values: dict[str, Any] = {
        'state': status.state.value,
        'owner': status.owner or 'none',
        'stopped by': ', '.join(status.last_transition.causes) or 'none',
        'stops clear': status.stops_clear,
        'operators at rest': status.operators_at_rest,
        'trip active': status.tripped,
    }
    if status.drives_enabled is not None:
        values['drive enabled'] = status.drives_enabled
    if status.slowed:
        values['slowed'] = '; '.join(status.slowed)
    return values | {f'condition of {name}': word for name, word in status.conditions.items()}


def _further_inhibits(status: Status, around: Surroundings, now: float) -> list[str]:
    """Say what else keeps the machine, or a part of it, still, although the arbiter would not."""
    why = []
    if around.button is not None and status.state is State.STOPPED:
        why.append(f'the reset button {around.button}')
    if around.unpublished and not status.state.enables:
        topics = ', '.join(around.unpublished)
        why.append(f'nobody publishes {topics}: start its node, or correct the topic')
    if around.unheard:
        why.append(
            f'nobody listens to {around.unheard}: is the drive node running and wired to the mux?'
        )
    elif (
        status.state is State.ACTIVE
        and not status.drives_ready
        and now - status.last_transition.at >= _PATIENCE
    ):
        why.append(
            'mend what the drive says, here or in /diagnostics; then give control back and '
            'take it anew'
        )
    if status.state is State.READY:
        why += [
            f"operator '{name}': {text} (operator.{name}.deadman_buttons)"
            for name, text in around.pressed.items()
            if text
        ]
    why += [
        f'~/joy/{name} leaves out what was held before: let go of {", ".join(held)}'
        for name, held in around.held.items()
        if held
    ]
    return why
