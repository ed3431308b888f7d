# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reasons as data: a sentence carries a stable code and its numbers, a catalogue says what to do.

A sentence is a ``Coded`` text. ``~/status`` and ``/diagnostics`` carry ``code.<n>`` and
``code.<n>.<field>`` beside it. A package that says something has a catalogue of its codes in
``reasons.py``; tools show causes and steps from there. The severity goes with the code, so what
has another catalogue puts it in the same order: that of ``causes``, which is the only one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
import re
from typing import Any, NamedTuple, TypeVar

T = TypeVar('T')
_KEY = re.compile(r'code\.([1-9]\d{0,2})(?:\.(\w+))?', re.ASCII)  # nobody has 1000 reasons
# Fields that say whom a reason is about, what says most first.
NAMES = ('source', 'operator', 'owner', 'drive', 'name', 'joint', 'limit', 'node')
_FIELD = re.compile(r'\{(\w+)\}')


class Severity(IntEnum):
    """How much a reason matters, first what somebody has to act on first."""

    STOP = 0  # a fault, or a stop that somebody demands
    ECHO = 1  # it follows from another stop, if there is one
    STEP = 2  # the next ordinary step, or a wait
    NOTE = 3  # what matters where there is nothing else


class Coded(str):
    """
    A sentence with its code.

    :param fields: what is filled in: numbers, with their unit in the name, and names.
    """

    __slots__ = ('code', 'fields')
    code: str
    fields: Mapping[str, Any]

    def __new__(cls, code: str, text: str, /, **fields: Any) -> Coded:
        """Make it."""
        self = super().__new__(cls, text)
        self.code, self.fields = code, fields
        return self

    def __reduce__(self) -> tuple[Any, ...]:  # a wire may be in another process than its node
        return _restored, (self.code, str(self), self.fields)

    def filled(self, *words: Any, **fields: Any) -> Coded:
        """Return it with words and fields filled in, as ``format`` does."""
        return Coded(self.code, self.format(*words, **fields), **fields)


def _restored(code: str, text: str, fields: Mapping[str, Any]) -> Coded:
    return Coded(code, text, **fields)


def passed_on(inner: str, text: str, code: str = '', /, **fields: Any) -> Coded:
    """Return a text with code and fields of the one that it passes on; else with these."""
    if isinstance(inner, Coded):
        return Coded(inner.code, text, **inner.fields)
    return Coded(code, text, **fields)


def to_values(reasons: Iterable[str], catalogue: Mapping[str, Entry]) -> dict[str, Any]:
    """
    Return codes and fields as key-value pairs, by the number of each reason from 1 on.

    ``code`` is that of the most urgent one.
    """
    reasons = list(reasons)
    coded = [each.code for each in causes(reasons, catalogue) if isinstance(each, Coded)]
    values: dict[str, Any] = {'code': coded[0]} if coded else {}
    for n, reason in enumerate(reasons, 1):
        if isinstance(reason, Coded):
            fields = {**reason.fields, 'severity': severity_of(reason, catalogue).name.lower()}
            values[f'code.{n}'] = reason.code
            values |= {f'code.{n}.{name}': value for name, value in fields.items()}
    return values


def from_values(values: Mapping[str, str], texts: Sequence[str] = ()) -> list[str]:
    """Return the reasons that were made key-value pairs of. :param texts: their sentences."""
    found: dict[int, dict[str, str]] = {}
    for key, value in values.items():
        if match := _KEY.fullmatch(key):
            found.setdefault(int(match[1]), {})[match[2] or ''] = value
    numbers = range(1, max(len(texts), *found) + 1) if found else range(1, len(texts) + 1)
    reasons = []
    for n in numbers:
        text, fields = texts[n - 1] if n <= len(texts) else '', found.get(n, {})
        code = fields.pop('', '')
        reasons.append(Coded(code, text, **fields) if code else text)
    return reasons


class Entry(NamedTuple):
    """
    One code of a catalogue.

    :param who: acts: operator, technician, integrator; nobody: it ends by itself.
    :param cause: in one short sentence; {fields} are filled in.
    :param says: the sentences that have it; … stands for what is filled in, or more words.
    :param steps: what to do, three at most; the first helps in nine of ten cases.
    :param more: a page with more, or ''.
    """

    severity: Severity
    who: str
    cause: str
    says: tuple[str, ...]
    steps: tuple[str, ...]
    more: str


def entries(text: str) -> dict[str, Entry]:
    """
    Read a catalogue: a head ``code code: severity, who: cause``, then lines that are indented.

    These are a sentence each, ``-> `` and a step, or ``more `` and a page. A line that is indented
    deeper goes on.

    :raises ValueError: a code stands there twice.
    """
    return by_code(_entries(text))


def by_code(rows: Iterable[tuple[str, T]]) -> dict[str, T]:
    """Return what stands behind each code. :raises ValueError: one stands there twice."""
    found: dict[str, T] = {}
    for code, row in rows:
        if code in found:
            raise ValueError(f'{code} stands there twice')
        found[code] = row
    return found


def _entries(text: str) -> Iterator[tuple[str, Entry]]:
    for block in re.split(r'\n(?=\S)', text.strip('\n')):
        head, *lines = re.sub(r'\n {5,}', ' ', block).splitlines()
        codes, kind, cause = head.split(': ', 2)
        severity, who = kind.split(', ')
        words = [line.strip() for line in lines]
        entry = Entry(
            Severity[severity.upper()],
            who,
            cause,
            tuple(each for each in words if not each.startswith(('-> ', 'more '))),
            tuple(each[3:] for each in words if each.startswith('-> ')),
            next((each[5:] for each in words if each.startswith('more ')), ''),
        )
        yield from ((code, entry) for code in codes.split())


def cause_of(reason: str, catalogue: Mapping[str, Entry]) -> str:
    """Return the cause, its fields filled in; of a code that is not known, the sentence."""
    if not isinstance(reason, Coded) or reason.code not in catalogue:
        return reason
    fields = reason.fields
    cause = catalogue[reason.code].cause
    return _FIELD.sub(lambda name: str(fields.get(name[1], '…')), cause)


def causes(reasons: Iterable[str], catalogue: Mapping[str, Entry]) -> list[str]:
    """
    Return what there is to act on, the most urgent first; the same is said once.

    An echo is left out where a stop explains it, and a note where there is anything else.
    """
    found: dict[Any, str] = {}
    for reason in reasons:
        found.setdefault(_identity(reason, catalogue), reason)
    ranked = sorted(found.values(), key=lambda each: severity_of(each, catalogue))
    found_first = severity_of(ranked[0], catalogue) if ranked else Severity.NOTE
    left_out = {Severity.ECHO} if found_first is Severity.STOP else set()
    left_out |= {Severity.NOTE} if found_first < Severity.NOTE else set()
    return [each for each in ranked if severity_of(each, catalogue) not in left_out]


def advice(reason: str, catalogue: Mapping[str, Entry]) -> str:
    """Return the steps in a line; empty: none are known."""
    return in_a_line(steps_of(reason, catalogue))


def in_a_line(steps: Iterable[str]) -> str:
    """Return steps in a line, numbered where there are several."""
    found = list(steps)
    if len(found) < 2:
        return ''.join(found)
    return '. '.join(f'{n} {step}' for n, step in enumerate(found, 1))


def steps_of(reason: str, catalogue: Mapping[str, Entry]) -> tuple[str, ...]:
    """Return what to do, the first step first; none where it is not known."""
    entry = catalogue.get(reason.code) if isinstance(reason, Coded) else None
    return () if entry is None else entry.steps


def severity_of(reason: str, catalogue: Mapping[str, Entry]) -> Severity:
    """Return it, as who gives the reason says, or its catalogue; a stop where nobody knows it."""
    said = str(getattr(reason, 'fields', {}).get('severity', '')).upper()
    if said in Severity.__members__:
        return Severity[said]
    entry = catalogue.get(reason.code) if isinstance(reason, Coded) else None
    return Severity.STOP if entry is None else entry.severity


def _identity(reason: str, catalogue: Mapping[str, Entry]) -> Any:
    return getattr(reason, 'code', ''), cause_of(reason, catalogue)
