# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The safety case as a drawing, in Goal Structuring Notation: plain SVG.

A rectangle is a claim, a parallelogram a strategy, a circle a piece of evidence, a diamond what is
left to whoever builds the machine. Red is what does not hold.
"""

from __future__ import annotations

from collections.abc import Iterator
import textwrap
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

if TYPE_CHECKING:
    from assurance.case import Case, Claim

_COLUMN, _ROW, _TOP, _RIM = 330, 34, 170, 20  # pixels
_BOX, _CIRCLE, _CHARACTERS = 206, 8, 34
_MOST = 21  # claims below each other
_STYLE = """<style>
  .paper { fill: #ffffff } text { fill: #0f172a } line, path { stroke: #475569; fill: none }
  .claim { fill: #e2e8f0; stroke: #475569 } .strategy { fill: #dbeafe; stroke: #1e40af }
  .evidence { fill: #bbf7d0; stroke: #166534 } .left { fill: #fef3c7; stroke: #92400e }
  .red { fill: #fecaca; stroke: #b91c1c; stroke-width: 2 }
  @media (prefers-color-scheme: dark) {
    .paper { fill: #0f172a } text { fill: #f1f5f9 } line, path { stroke: #cbd5e1 }
    .claim { fill: #334155 } .strategy { fill: #1e3a8a } .evidence { fill: #14532d }
    .left { fill: #78350f } .red { fill: #7f1d1d }
  }
</style>"""


def draw(case: Case) -> str:
    """Return the drawing of a case that was judged."""
    columns = [
        (part, part.claims[start : start + _MOST])
        for part in case.parts
        for start in range(0, max(1, len(part.claims)), _MOST)
    ]
    width = _COLUMN * len(columns) + _RIM
    height = _TOP + 40 + _ROW * max((len(claims) for _, claims in columns), default=0)
    middle = width // 2
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        'font-family="DejaVu Sans, Verdana, sans-serif" font-size="10">',
        '<title>The safety case</title>',
        f'<desc>{escape(case.goal)}, argued over '
        f'{escape(", ".join(part.name for part in case.parts))}.</desc>',
        _STYLE,
        f'<rect class="paper" width="{width}" height="{height}" rx="8"/>',
        f'<rect class="claim{_red(case.faults)}" x="{middle - 190}" y="15" width="380" '
        'height="40"/>',
        *_text(f'G: {case.goal}', middle - 182, 31, 68),
        f'<rect class="claim" x="{middle + 230}" y="15" width="250" height="40" rx="18"/>',
        *_text(f'C: {case.context}', middle + 244, 31, 42),
        f'<line x1="{middle + 190}" y1="35" x2="{middle + 230}" y2="35"/>',
    ]
    drawn: set[str] = set()
    for number, (part, claims) in enumerate(columns):
        left = _RIM + number * _COLUMN
        if part.name not in drawn:
            drawn.add(part.name)
            lines.append(f'<path d="M{middle} 55V75H{left + 100}V95"/>')
            corners = f'{left + 12},95 {left + 290},95 {left + 278},135 {left},135'
            lines.append(f'<polygon class="strategy{_red(part.faults)}" points="{corners}"/>')
            lines += _text(f'S: {part.strategy}', left + 18, 112, 46)
        else:
            lines.append(f'<path d="M{left - _COLUMN + 279} 115H{left + 4}V{_TOP}"/>')
        lines.append(f'<line x1="{left + 4}" y1="135" x2="{left + 4}" y2="{_TOP}"/>')
        for row, claim in enumerate(claims):
            lines += _claim(claim, left, _TOP + row * _ROW)
    return '\n'.join([*lines, '</svg>', ''])


def _claim(claim: Claim, left: int, top: int) -> Iterator[str]:
    """Yield a claim's rectangle, and what supports it on its right."""
    middle, right = top + 14, left + 14 + _BOX
    yield f'<path d="M{left + 4} {top - 20}V{middle}H{left + 14}"/>'
    yield (
        f'<rect class="claim{_red(claim.faults)}" x="{left + 14}" y="{top}" width="{_BOX}" '
        'height="28"/>'
    )
    words = claim.key if not claim.key.isdigit() else claim.argument
    yield from _text(f'{claim.number} {words}', left + 19, top + 12, _CHARACTERS)
    for number, evidence in enumerate(claim.evidence):
        x = right + 16 + number * (2 * _CIRCLE + 2)
        is_red = any(fault.startswith(f'{evidence}: ') for fault in claim.faults)
        if not number:
            yield f'<line x1="{right}" y1="{middle}" x2="{x - _CIRCLE}" y2="{middle}"/>'
        yield (
            f'<circle class="evidence{" red" if is_red else ""}" cx="{x}" cy="{middle}" '
            f'r="{_CIRCLE}"><title>{escape(evidence)}</title></circle>'
        )
    if claim.left:
        x = right + 16 + len(claim.evidence) * (2 * _CIRCLE + 2)
        corners = f'{x},{middle - 8} {x + 8},{middle} {x},{middle + 8} {x - 8},{middle}'
        title = f'<title>{escape(claim.left)}</title>'
        yield f'<polygon class="left" points="{corners}">{title}</polygon>'


def _red(faults: object) -> str:
    return ' red' if faults else ''


def _text(text: str, x: int, y: int, characters: int) -> Iterator[str]:
    """Yield two lines of text at most."""
    plain = text.replace('`', '').replace('*', '')
    found = textwrap.wrap(plain, characters, max_lines=2, placeholder=' …')
    for number, line in enumerate(found):
        yield f'<text x="{x}" y="{y + 12 * number}">{escape(line)}</text>'
