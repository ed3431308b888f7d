# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What nodes say of their devices in /diagnostics, for the inputs that come from these nodes.

By it ~/status says why a source demands a stop, why a remote is quiet, and why a drive does not
enable.
"""

from collections.abc import Callable, Iterable
from typing import Any

from bridge_core.reasons import causes, Coded, from_values, passed_on
from safety_mux.protocol import Kind

_HAVE_WORDS = ('e-stop source', 'operator', 'drive')
_MOST = 1000  # characters
_LAST = 3.0  # s; they come at 1 Hz
_OK = b'\0'

Explain = Callable[[Kind, str, str], object]


class DeviceWords:
    """
    Takes words in one thread and passes them on in another, the newest only.

    :param explain: gets kind and name of an input, and the words; empty: there are none.
    """

    def __init__(self, explain: Explain) -> None:
        self._explain = explain
        self._inputs: dict[str, list[tuple[Kind, str]]] = {}  # by the name of the diagnostic
        self._waiting: dict[str, tuple[bool, str]] = {}  # by the same: whether good, and words
        self._at: dict[str, float] = {}  # since when they are believed

    def listen(self, kind: Kind, name: str, topic: str) -> None:
        """Note an input. :param topic: its full name, by which its node is known."""
        if kind in _HAVE_WORDS:
            device = f'{topic.rpartition("/")[0].lstrip("/")}: device'
            self._inputs.setdefault(device, []).append((kind, name))

    def hear_diagnostics(self, statuses: Iterable[Any]) -> bool:
        """Take a message of /diagnostics; tell whether there are words to pass on."""
        for status in statuses:
            if status.name in self._inputs:
                node = status.name.rpartition(': ')[0]
                words = status.message[:_MOST].replace('~/', f'/{node}/')
                codes = {pair.key: pair.value for pair in status.values}
                for first in causes(from_values(codes), {})[:1]:
                    if isinstance(first, Coded):
                        fields = {key: text[:_MOST] for key, text in first.fields.items()}
                        words = Coded(first.code[:_MOST], words, **{**fields, 'node': node})
                self._waiting[status.name] = status.level == _OK, words
        return bool(self._waiting)

    def pass_on(self, now: float) -> None:
        """Pass on what waits."""
        for device in list(self._waiting):
            good, words = self._waiting.pop(device)
            self._at[device] = now
            says = words.removeprefix('ok').removeprefix('; ')
            if isinstance(words, Coded):  # the words of another node may have no code
                says = passed_on(words, says)
            self._say(device, says, good=good)

    def forget_old(self, now: float) -> None:
        """Take back the words of nodes that say nothing any more."""
        for device in [each for each, at in self._at.items() if now - at > _LAST]:
            del self._at[device]
            self._say(device, '', good=True)

    def forget(self, kind: Kind) -> None:
        """Take back what was said to inputs of this kind, as it had another reason."""
        for inputs in self._inputs.values():
            for each, name in inputs:
                if each == kind:
                    self._explain(each, name, '')

    def _say(self, device: str, words: str, *, good: bool) -> None:
        """What is good of a device is not why it demands a stop."""
        for kind, name in self._inputs.get(device, ()):
            is_why = not (good and kind == 'e-stop source')
            self._explain(kind, name, words if is_why else '')
