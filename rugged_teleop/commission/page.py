# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report as a page to print and to sign: a summary first, then every step. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

_STYLE = """
body{font:11pt sans-serif;max-width:48em;margin:2em auto;color:#111}
table{border-collapse:collapse;width:100%}td,th{border:1px solid #999;padding:.2em .4em;
text-align:left;vertical-align:top}th{background:#eee}.failed{color:#a00}.passed{color:#060}
h3{margin-bottom:.2em}svg{width:100%;height:11em}.sign td{height:4em;width:50%}
@media print{body{margin:0}.summary{page-break-after:always}section{page-break-inside:avoid}}
"""
_COLOURS = ('#06c', '#c40', '#084', '#808', '#660', '#055')
_WIDTH, _HEIGHT = 640.0, 150.0
_HEAD = ('machine', 'place', 'who', 'date', 'version', 'ros', 'python', 'computer', 'simulated')


def page(report: Mapping[str, Any]) -> str:
    """Return it as HTML that needs no other file."""
    title = escape(f'Commissioning of {report["machine"]}')
    return ''.join(
        (
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>',
            f'<style>{_STYLE}</style><div class="summary"><h1>{title}</h1>',
            *_summary(report),
            '</div>',
            *(_step(each) for each in report['steps']),
            '</html>\n',
        )
    )


def _summary(report: Mapping[str, Any]) -> Iterator[str]:
    kind = 'failed' if report['verdict'] == 'failed' else 'passed'
    yield f'<h2 class="{kind}">{escape(report["verdict"])}</h2>'
    rows = [(name, report.get(name, '')) for name in _HEAD]
    rows.append(('parameters that decide', report['fingerprint']))
    yield _table(rows)
    for heading, key in (('Failed', 'failed'), ('Exceptions', 'exceptions')):
        if report[key]:
            items = ''.join(f'<li>{escape(each)}</li>' for each in report[key])
            yield f'<h3>{heading}</h3><ul>{items}</ul>'
    facts = [fact for each in report['steps'] for fact in each.get('facts', {}).items()]
    if facts:
        yield f'<h3>Facts of this machine</h3>{_table(facts)}'
    counts: dict[str, int] = {}
    for each in report['steps']:
        counts[each['result']] = counts.get(each['result'], 0) + 1
    yield f'<p>{len(report["steps"])} steps: '
    yield ', '.join(f'{number} {name}' for name, number in sorted(counts.items())) + '.</p>'
    yield (
        '<p>This is a record of what was seen on this machine with these parameters. It is no '
        'certificate and no declaration of conformity.</p>'
        '<table class="sign"><tr><td>Commissioned by, date, signature</td>'
        '<td>Checked by, date, signature</td></tr></table>'
    )


def _table(rows: Sequence[tuple[str, Any]]) -> str:
    cells = (
        f'<tr><th>{escape(str(name))}</th><td>{escape(str(value))}</td></tr>'
        for name, value in rows
    )
    return f'<table>{"".join(cells)}</table>'


def _step(step: Mapping[str, Any]) -> str:
    rows = [('result', step['result']), ('seen', step['text']), ('at', step['at'])]
    if step['reason']:
        rows.append(('reason', step['reason']))
    for each in step['measured']:
        limit = '' if each['limit'] is None else f', at most {each["limit"]:.3g}'
        rows.append((each['name'], f'{each["value"]:.3g} {each["unit"]}{limit}'))
    rows += [(f'answer: {name}', text) for name, text in step['answers'].items()]
    rows += [*step.get('facts', {}).items()]
    if step.get('piece'):
        rows.append(('recording', step['piece']))
    name, title = escape(step['name']), escape(step['title'])
    plot = _plot(step['series'], step.get('events', {})) if step['series'] else ''
    return f'<section><h3>{name}</h3><p>{title}</p>{_table(rows)}{plot}</section>'


def _plot(series: Mapping[str, Sequence[Sequence[float]]], events: Mapping[str, float]) -> str:
    """
    Return lines of rad/s over s, with the greatest of both written at the axes.

    :param events: moments, such as that of the stop's cause; each becomes an upright line.
    """
    points = [point for line in series.values() for point in line]
    longest = max(at for at, _ in points) or 1.0
    low = min(0.0, *(value for _, value in points))
    high = max(0.0, *(value for _, value in points))
    scale = (high - low) or 1.0
    lines = []
    for number, (name, line) in enumerate(sorted(series.items())):
        colour = _COLOURS[number % len(_COLOURS)]
        dash = ' stroke-dasharray="5 3"' if name.startswith('command') else ''
        path = ' '.join(
            f'{at / longest * _WIDTH:.1f},{(high - value) / scale * _HEIGHT + 5.0:.1f}'
            for at, value in line
        )
        lines.append(f'<polyline fill="none" stroke="{colour}"{dash} points="{path}"/>')
        lines.append(
            f'<text x="{_WIDTH - 5:.0f}" y="{18 + 13 * number}" font-size="11" '
            f'text-anchor="end" fill="{colour}">{escape(name)}</text>'
        )
    for number, (name, at) in enumerate(sorted(events.items(), key=lambda event: event[1])):
        x = min(at / longest, 1.0) * _WIDTH
        lines.append(
            f'<path stroke="#333" stroke-dasharray="2 3" d="M{x:.1f} 5v{_HEIGHT:.0f}"/>'
            f'<text x="{x:.1f}" y="{_HEIGHT - 12 * number:.0f}" font-size="11" '
            f'text-anchor="{"end" if x > _WIDTH / 2.0 else "start"}">'
            f'{escape(name)} {at:.2f} s</text>'
        )
    frame = f'<rect x="0" y="5" width="{_WIDTH}" height="{_HEIGHT}" fill="none" stroke="#999"/>'
    words = (
        f'<text x="3" y="17" font-size="11">{high:.3g} rad/s</text>'
        f'<text x="3" y="{_HEIGHT + 2:.0f}" font-size="11">{low:.3g} rad/s</text>'
        f'<text x="{_WIDTH}" y="{_HEIGHT + 18:.0f}" font-size="11" text-anchor="end">'
        f'{longest:.3g} s</text>'
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {_HEIGHT + 22:.0f}">{frame}{"".join(lines)}{words}</svg>'
    )
