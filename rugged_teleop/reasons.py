# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that nodes of this package say, by code, for the tools and for the pages."""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
import re
from typing import NamedTuple

from bridge_core import shared_reasons
from bridge_core.reasons import (
    advice,
    by_code,
    cause_of,
    causes,
    Entry,
    in_a_line,
    NAMES,
    Severity,
    severity_of,
    steps_of,
)
from rugged_teleop.devices import devices
from rugged_teleop.recorder import reasons as recorder_reasons
from safety_mux import reasons as mux_reasons

_CODE = re.compile(
    r'(?:ros2|candump) .+|~/\w+|\b[a-z]+\.[\w<>.]+|\b\w+_\w+\b'
)  # what a page shows as code
_WORD = re.compile(r'[\w~/]+')
_SMALL = {*_WORD.findall('a an and as at by for from in it its of on or that the this to with')}
_SAID = 'as it says'


@cache
def catalogue() -> Mapping[str, Entry]:
    """Return the entries of all packages."""
    of_devices = (device.reasons for device in devices().values())
    ours = shared_reasons.REASONS, mux_reasons.REASONS, recorder_reasons.REASONS
    tables = (*ours, *of_devices)
    return by_code(row for table in tables for row in table.items())


class ToDo(NamedTuple):
    """
    What to do now: the cause to act on first, and steps, three at most.

    :param names: of whom it is: nodes, as diagnostics have them, or inputs. :param cause: and
        these names, if there are several.
    """

    code: str
    names: list[str]
    cause: str
    steps: list[str]

    @property
    def line(self) -> str:
        """Return it in a line."""
        return f'{self.cause}. {in_a_line(self.steps)}'


def to_do(inhibits: Iterable[str], state: str) -> ToDo | None:
    """
    Return what to do now; None: nothing.

    :param inhibits: of a mux. :param state: its state: a stop that was ended waits for its reset.
    """
    inhibits = list(inhibits)
    for reason in causes(inhibits, catalogue())[:1]:
        steps = [*steps_of(reason, catalogue())]
        is_stop = severity_of(reason, catalogue()) is Severity.STOP
        if state == 'STOPPED' and is_stop and not any('eset' in step for step in steps):
            steps = [*steps[:2], 'Reset']
        alike = [each for each in inhibits if _code(each) == _code(reason) != '']
        names = [*dict.fromkeys(filter(None, map(_whose, [reason, *alike])))]
        cause = cause_of(reason, catalogue())
        if len(names) > 1:
            is_named = names[0] in cause
            cause += f' ({", ".join(names[is_named:])}{", too" * is_named})'
        return ToDo(_code(reason), names, cause, steps)
    return None


def explained(reasons: Iterable[str], told: str = '') -> Iterator[tuple[str, str, str]]:
    """Yield each with its code and what to do, once for each code. :param told: a code."""
    said = {told}
    for reason in reasons:
        code = _code(reason)
        yield reason, code, '' if code in said else advice(reason, catalogue())
        said.add(code)


def markdown_table(entries: Mapping[str, Entry], head: str, folder: str = '') -> str:
    """Return entries as a table. :param head: of what is said. :param folder: of the page."""
    codes: dict[Entry, list[str]] = {}
    for code, entry in entries.items():
        codes.setdefault(entry, []).append(f'`{code}`')
    table = f'| {head} | code | who | what to do |\n| --- | --- | --- | --- |\n'
    return table + ''.join(
        f'| {"<br>".join(entry.says)} | {"<br>".join(names)} | {_who(entry)} | '
        f'{_steps(entry, folder)} |\n'
        for entry, names in codes.items()
    )


def tables() -> dict[str, str]:
    """Return the table of each page that has one."""
    pages = {
        'docs/inhibits.md': markdown_table(mux_reasons.REASONS, 'inhibit'),
        'docs/record.md': markdown_table(recorder_reasons.REASONS, 'message'),
        'docs/common.md': markdown_table(shared_reasons.REASONS, 'message'),
    }
    for device in devices().values():
        if device.reasons:
            pages[device.page] = markdown_table(device.reasons, 'message', '../')
    return pages


def _code(reason: str) -> str:
    return str(getattr(reason, 'code', ''))


def _whose(reason: str) -> str:
    """Return the node whose device says it, or whom it names; or ''."""
    fields = getattr(reason, 'fields', {})
    return next((str(fields[name]) for name in ('node', *NAMES) if name in fields), '')


def _who(entry: Entry) -> str:
    return '' if entry.who == 'nobody' else entry.who


def _steps(entry: Entry, folder: str) -> str:
    """Return the steps; those that every sentence of it says itself only if they are short."""
    sentences = [_content(each) for each in entry.says]
    said = [each for each in entry.steps if all(_content(each) <= words for words in sentences)]
    steps = [each for each in entry.steps if each not in said]
    if steps and len(' '.join(said).split()) <= len(_SAID.split()):
        steps = [*entry.steps]
    elif said:
        steps = [_SAID, *steps]
    text = '. '.join(_CODE.sub(r'`\g<0>`', step) for step in steps)
    return f'{text} ([more]({folder}{entry.more}))' if entry.more else text


def _content(text: str) -> set[str]:
    """Return the words that tell one step from another, in small letters."""
    return {*_WORD.findall(text.lower())} - _SMALL
