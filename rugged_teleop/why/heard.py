# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was heard when: a value of which nothing was heard is a default, and no news. Pure."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable

from rugged_teleop.recordings import Said
from rugged_teleop.why.events import Event

FRESH = 0.5  # s; ~/enabled is said at 5 Hz or more, statuses of a drive come more often
_TOGETHER = 0.05  # s within which a node says what belongs together, in any order
_DEFAULTS = {
    'enabled': 'counts as disabled',
    'button': 'counts as released',
    'axis': 'counts as in the middle',
}


class Heard:
    """:param messages: in the order of time. :param events: of them."""

    def __init__(self, messages: Iterable[Said], events: Iterable[Event]) -> None:
        self._times: dict[str, list[float]] = {}
        self._links: dict[str, list[tuple[float, bool]]] = {}
        for each in messages:
            self._times.setdefault(each.topic, []).append(each.at)
        for event in events:
            kind, _, node = event.what.partition(' ')
            if kind == 'link_up':
                self._links.setdefault(node, []).append((event.at, event.value))

    def last(self, topic: str, at: float) -> float | None:
        """Return when a topic was heard last, up to then."""
        times = self._times.get(topic, [])
        place = bisect_right(times, at)
        return times[place - 1] if place else None

    def is_fresh(self, topic: str, at: float) -> bool:
        """Tell whether a topic was heard about then."""
        last = self.last(topic, at)
        return last is not None and at - last <= FRESH

    def is_linked(self, node: str, at: float) -> bool:
        """Tell whether a node has not said about then that it does not hear its device."""
        said = [value for since, value in self._links.get(node, ()) if since <= at + _TOGETHER]
        return not said or said[-1]

    def drive(self, node: str, at: float) -> bool:
        """Tell whether a drive was heard about then or soon after, as a disabled one is, too."""
        last = self.last(f'{node}/joint_states', at + FRESH)
        return self.is_linked(node, at) and last is not None and last >= at - _TOGETHER

    def qualified(self, event: Event) -> Event:
        """Return an event with a text that says so where its value is a default."""
        kind, _, source = event.what.partition(' ')
        if kind not in _DEFAULTS or event.value or not event.text:
            return event
        if kind == 'enabled':
            known, subject = self.drive(source, event.at), f'{source}: the drive'
        else:
            number, _, topic = source.partition(' ')
            known = self.is_linked(topic.rpartition('/')[0], event.at)
            subject = f'{topic}: {kind} {number}'
        text = f'{subject} {_DEFAULTS[kind]}: nothing is heard'
        return event if known else event._replace(text=text)
