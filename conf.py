# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The site of ``make docs``: the Markdown as it stands, from the root of the repository."""

from pathlib import Path
import sys
from typing import Any

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from assurance import case  # noqa: E402
from rugged_teleop import messages  # noqa: E402
from rugged_teleop.doctor import findings  # noqa: E402

# Headings, and patterns of the pages below them. A page stands where it matches first.
NAVIGATION = {
    'Start': ('docs/start/*.md', 'docs/bringup.md', 'docs/commissioning.md', 'docs/migration.md'),
    'Concepts': ('docs/concepts.md', 'docs/common.md', 'docs/can.md'),
    'Devices': ('docs/devices/*.md', 'docs/sixth_device.md'),
    'Safety mux': ('docs/safety_mux.md', 'docs/mux_recipes.md', 'docs/inhibits.md'),
    'When it does not work': ('docs/doctor.md', 'docs/faults.md', 'docs/messages.md'),
    'Tools': (
        'docs/status_page.md',
        'docs/record.md',
        'docs/replay.md',
        'docs/decode.md',
        'docs/ssc_config.md',
    ),
    'Recipes': ('docs/recipes.md', 'docs/works_with.md'),
    'Safety and security': (
        'docs/safety.md',
        'docs/old_news.md',
        'docs/security.md',
        'docs/assurance.md',
        'docs/case.md',
    ),
    'Performance': ('docs/performance.md',),
    'Decisions': ('docs/decisions/*.md',),
    'Contributing': (
        'CONTRIBUTING.md',
        'CODE_OF_CONDUCT.md',
        'SECURITY.md',
        'QUALITY_DECLARATION.md',
        'CHANGELOG.rst',
    ),
}

project = 'rugged_teleop'
root_doc = 'README'
include_patterns = [f'{root_doc}.md', *(each for group in NAVIGATION.values() for each in group)]
extensions = ['myst_parser']
myst_heading_anchors = 4  # as the repository makes them, for links from page to page
highlight_language = 'none'
smartquotes = False  # what is quoted is searched for, and commands are copied
html_theme = 'furo'
html_title = project
html_show_copyright = False
html_extra_path = ['docs/index.html']


def contents() -> dict[str, list[str]]:
    """Return the pages below each heading, in order, without their suffix."""
    seen = {root_doc}
    groups: dict[str, list[str]] = {}
    for heading, patterns in NAVIGATION.items():
        found = (path for each in patterns for path in sorted(ROOT.glob(each)))
        names = (path.relative_to(ROOT).with_suffix('').as_posix() for path in found)
        groups[heading] = [name for name in dict.fromkeys(names) if name not in seen]
        seen.update(groups[heading])
    return groups


def _add_contents(_: Any, page: str, source: list[str]) -> None:
    """Add the navigation to the first page, which is read on the repository without it."""
    if page == root_doc:
        for heading, names in contents().items():
            lines = '\n'.join(f'/{name}' for name in names)
            source[0] += f'\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{lines}\n```\n'


def _add_messages(_: Any, page: str, source: list[str]) -> None:
    """Add what nodes and doctor may say, which in the repository stands on their pages alone."""
    if page == 'docs/messages':
        source[0] += f'\n{messages.catalogue()}\n## doctor\n\nFrom [doctor.md](doctor.md).\n\n'
        source[0] += findings.markdown_table()


def _add_case(_: Any, page: str, source: list[str]) -> None:
    """Add each claim with its evidence, which in the repository are in files."""
    if page == 'docs/case':
        source[0] += '\n' + case.markdown(case.read(), case.results())


def _leave_folders(app: Any, tree: Any) -> None:
    """Leave links to folders, which have no page here, as their text."""
    here = Path(app.env.doc2path(app.env.docname)).parent
    for link in list(tree.findall(lambda node: node.tagname == 'pending_xref')):
        if (here / link['reftarget']).is_dir():
            link.replace_self(link.children)


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect('source-read', _add_contents)
    app.connect('source-read', _add_messages)
    app.connect('source-read', _add_case)
    app.connect('doctree-read', _leave_folders)
