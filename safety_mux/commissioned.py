# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a mux has the parameters that were tried on its machine by rugged_teleop commission."""

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any, NamedTuple

from bridge_core.parameters import ParameterError

_REPORT = 'commissioning.report'
_SHOWN = 5  # differences


class Tried(NamedTuple):
    """What a report says. :param problem: why it does not count; empty: it does."""

    words: str
    problem: str


def tried(values: Mapping[str, Any], node: str) -> Tried | None:
    """
    Compare with the report that the parameters name; None where they name none.

    :param node: full name of the mux.
    :raises ParameterError: they require a trial that counts, and there is none.
    """
    if not values[_REPORT]:
        found = None
        problem = 'is empty: name the report.json' if values['commissioning.required'] else ''
    else:
        found = _compared(values, node)
        problem = found.problem
    if problem and values['commissioning.required']:
        raise ParameterError(
            f'parameter {_REPORT} = {values[_REPORT]!r}: {problem}; commission the machine, or '
            'set commissioning.required to false'
        )
    return found


def _compared(values: Mapping[str, Any], node: str) -> Tried:
    from bridge_core.fingerprint import differences, version  # late: few start with a report

    try:
        report = json.loads(Path(values[_REPORT]).read_text(encoding='utf-8'))
        words = f'commissioned on {report["date"]} by {report["who"]}: {report["verdict"]}'
        tried_ones = report['parameters']
        if node in tried_ones:
            changed = differences({node: tried_ones[node]}, {node: values})
        else:
            changed = [f'it is of another machine, of {", ".join(tried_ones) or "no nodes"}']
        problems = changed[:_SHOWN]
        if len(changed) > _SHOWN:
            problems.append(f'and {len(changed) - _SHOWN} more')
        if report['version'] != version():
            problems.append(f'the package was {report["version"]}, is {version()}')
        if report['simulated']:
            problems.append('it was a simulated machine')
        if report['verdict'] == 'failed':
            problems.append('the trial failed')
    except OSError as error:
        return _no_report(values, str(error.strerror))
    except KeyError as error:
        return _no_report(values, f'it has no {error}')
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        return _no_report(values, str(error))
    return Tried(words, f'not validated: {"; ".join(problems)}' if problems else '')


def _no_report(values: Mapping[str, Any], why: str) -> Tried:
    return Tried('', f'not validated: {values[_REPORT]} is no report: {why}')
