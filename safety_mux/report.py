# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``~/status`` says: the whole answer to 'why does it not move?'."""

from collections.abc import Iterable, Mapping, Sequence
import math
from typing import Any, NamedTuple

from bridge_core import report
from bridge_core.reasons import Coded, passed_on, to_values
from bridge_core.session import Level
from bridge_core.watchdog import in_words
from safety_mux.commissioned import Tried
from safety_mux.protocol import NOBODY, ProofReport, State, Status
from safety_mux.reasons import REASONS

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
    :param proofs: of nodes that may prove how old their words are.
    :param tried: what the trial of the machine says of the parameters; None: there is none.
    :param ends: which joints are near a soft end, in words.
    :param joys: by operator, the full name of its topic.
    :param refused: by operator, how often his deadman gave no control.
    """

    unheard: str
    unpublished: Sequence[str]
    button: Coded | None
    held: Mapping[str, Sequence[str]]
    pressed: Mapping[str, str]
    old_stamps: Mapping[str, str]
    refused_reset: tuple[float, str] | None
    proofs: Sequence[ProofReport] = ()
    tried: Tried | None = None
    ends: Sequence[Coded] = ()
    joys: Mapping[str, str] = {}
    refused: Mapping[str, int] = {}


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
    warnings: list[Coded] = [
        Coded(
            'mux.operator.may_be_gone',
            f"operator '{name}' may be gone, and its sender repeat an old message: {why}",
            operator=name,
        )
        for name, why in around.old_stamps.items()
    ]
    warnings += [each.creeping for each in around.proofs if each.creeping]
    values = _fields(status)
    values |= {f'inhibit {n}': text for n, text in enumerate(inhibits, 1)}
    values |= {f'age of {name} (s)': age for name, age in status.ages.items()}
    values |= {f'joy of {name}': topic for name, topic in around.joys.items()}
    values |= {f'deadman of {name} refused': count for name, count in around.refused.items()}
    values |= _proven(around.proofs)
    last = status.last_transition
    values['last transition'] = (
        f'{last.before.value} to {last.after.value}, {now - last.at:.1f} s ago: {last.reason}'
    )
    if around.tried is not None:
        values['commissioning'] = around.tried.problem or around.tried.words
        if around.tried.problem:
            warnings.append(Coded('mux.commissioning', around.tried.problem))
    values |= {f'warning {n}': text for n, text in enumerate(warnings, 1)}
    values |= to_values([*inhibits, *warnings], REASONS)
    limits = [*status.slowed, *around.ends]
    if limits:
        values['slowed'] = '; '.join(limits)
    slowed = [each for each in limits if each not in inhibits]
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
        'owner': status.owner or NOBODY,
        'stopped by': ', '.join(status.last_transition.causes) or 'none',
        'stops clear': status.stops_clear,
        'operators at rest': status.operators_at_rest,
        'deadman refused': ', '.join(status.refused) or 'none',
        'trip active': status.tripped,
    }
    if status.drives_enabled is not None:
        values['drive enabled'] = status.drives_enabled
    return values | {f'condition of {name}': word for name, word in status.conditions.items()}


def _proven(proofs: Iterable[ProofReport]) -> dict[str, Any]:
    """Return how old at most all was lately that is proven, and all the way of a stop, s."""
    values: dict[str, Any] = {}
    remotes, to_wires = [], []
    for each in proofs:
        for age in each.ages:
            values |= {
                f'proven age of {age.label} (s)': _known(age.worst),
                f'age limit of {age.label} (s)': age.limit,
            }
        if each.ages:
            values |= {
                f'proven age of what {each.node} goes by (s)': _known(each.of_device),
                f'proofs of {each.node} damaged, repeated, unasked': str(each.bad)[1:-1],
            }
        of_stops = [age.worst for age in each.ages if age.kind == 'e-stop source']
        if any(age.kind == 'drive' for age in each.ages):
            to_wires.append(each.of_device)
        elif of_stops:
            remotes.append((max(of_stops), each.of_device))
    if remotes:
        to_wire = max(to_wires, default=math.inf)
        to_mux = max(age for age, _ in remotes)
        from_button = max(age + of_device for age, of_device in remotes)
        values |= {
            'from node to wire, at most (s)': _known(to_mux + to_wire),
            'from button to wire, at most (s)': _known(from_button + to_wire),
        }
    return values


def _known(age: float) -> float | str:
    return age if age < math.inf else 'unknown'


def _further_inhibits(status: Status, around: Surroundings, now: float) -> list[Coded]:
    """Say what else keeps the machine, or a part of it, still, although the arbiter would not."""
    why: list[Coded] = []
    if around.button is not None and status.state is State.STOPPED:
        why.append(passed_on(around.button, f'the reset button {around.button}'))
    if around.unpublished and not status.state.enables:
        topics = ', '.join(around.unpublished)
        text = f'nobody publishes {topics}: start its node, or correct the topic'
        why.append(Coded('mux.topic.unpublished', text, topics=topics))
    if around.unheard:
        why.append(
            Coded(
                'mux.commands.unheard',
                f'nobody listens to {around.unheard}: is the drive node running and wired to the '
                'mux?',
            )
        )
    elif (
        status.state is State.ACTIVE
        and not status.drives_ready
        and now - status.last_transition.at >= _PATIENCE
    ):
        why.append(
            Coded(
                'mux.drive.disabled',
                'mend what the drive says, here or in /diagnostics; then give control back and '
                'take it anew',
                drive='the drive',
            )
        )
    if status.state is State.READY:
        why += [
            Coded(
                'mux.operator.other_buttons',
                f"operator '{name}': {text} (operator.{name}.deadman_buttons)",
                operator=name,
            )
            for name, text in around.pressed.items()
            if text
        ]
    why += [
        Coded(
            'mux.joy.held',
            f'~/joy/{name} leaves out what was held before: let go of {", ".join(held)}',
            operator=name,
        )
        for name, held in around.held.items()
        if held
    ]
    return why
