# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metadata, entry points, launch files, udev rules, CI and README agree."""

import ast
from collections.abc import Iterator
import os
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from setuptools import find_packages

from bridge_core.parameter_files import sections_of
from rugged_teleop.stack import BESIDE, NODES
from stage.rig import NOT_INSTALLED, ROOT

PACKAGE = 'rugged_teleop'
LAUNCH_FILES = sorted((ROOT / 'launch').glob('*.launch.xml'))
SHARE = f'$(find-pkg-share {PACKAGE})/'
# Where the name in an import is not the rosdep key.
ROSDEP_KEYS = {
    'argcomplete': 'python3-argcomplete',
    'can': 'python3-can',
    'serial': 'python3-serial',
    'yaml': 'python3-yaml',
}
# Where it is not the name on PyPI.
DISTRIBUTIONS = {'mcap_ros2': 'mcap-ros2-support'}
# What rclpy, the message packages and mcap bring with them, and what type checkers do.
INDIRECT = {'builtin_interfaces', 'zstandard', 'typing_extensions'}


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding='utf-8')


def manifest() -> ElementTree.Element:
    return ElementTree.fromstring(text('package.xml'))


def field(name: str) -> str:
    found = manifest().findtext(name)
    assert found, f'package.xml has no {name}'
    return found


def setup_arguments() -> dict[str, ast.expr]:
    """Return the keyword arguments of setup(), unevaluated."""
    calls = (node for node in ast.walk(ast.parse(text('setup.py'))) if isinstance(node, ast.Call))
    (setup,) = (c for c in calls if isinstance(c.func, ast.Name) and c.func.id == 'setup')
    return {word.arg: word.value for word in setup.keywords if word.arg}


def entry_points() -> dict[str, str]:
    points = ast.literal_eval(setup_arguments()['entry_points'])
    groups = ('console_scripts', 'rugged_teleop.commands')  # ros2 run finds both
    return dict(point.split(' = ') for group in groups for point in points[group])


def production_imports() -> Iterator[str]:
    """Yield the top-level names that the installed packages import."""
    for package in (path.parent for path in ROOT.glob('*/__init__.py')):
        if package.name in NOT_INSTALLED:
            continue
        for path in package.rglob('*.py'):
            for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
                if isinstance(node, ast.Import):
                    yield from (alias.name.split('.')[0] for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    yield node.module.split('.')[0]


# Metadata.


def test_manifest_is_of_format_3_for_ament_python() -> None:
    assert manifest().get('format') == '3'
    assert field('name') == PACKAGE
    assert field('license') == 'Apache-2.0'
    assert field('export/build_type') == 'ament_python'
    assert 'Apache License' in text('LICENSE')


def test_malformed_maintainer_address_would_hide_the_package_from_ros() -> None:
    maintainer = manifest().find('maintainer')
    assert maintainer is not None
    address = maintainer.get('email', '')
    assert re.fullmatch(r'[\w.+-]+@[\w-]+(\.[\w-]+)+', address)
    assert ast.literal_eval(setup_arguments()['maintainer_email']) == address


def test_versions_agree() -> None:
    version = field('version')
    assert ast.literal_eval(setup_arguments()['version']) == version
    newest = re.search(r'^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)\n-+$', text('CHANGELOG.rst'), re.M)
    assert newest is not None
    assert newest[1] == version


def test_every_import_has_its_dependency() -> None:
    dependencies = {tag.text for tag in manifest() if tag.tag in ('depend', 'exec_depend')}
    own = {path.parent.name for path in ROOT.glob('*/__init__.py')}
    extras = ast.literal_eval(setup_arguments()['extras_require'])
    optional = {re.split('[<>=]', each)[0] for extra in extras.values() for each in extra}
    foreign = set(production_imports()) - own - set(sys.stdlib_module_names) - INDIRECT
    foreign = {name for name in foreign if DISTRIBUTIONS.get(name, name) not in optional}
    assert {ROSDEP_KEYS.get(name, name) for name in foreign} <= dependencies


def test_resource_marker_and_type_markers_are_there() -> None:
    assert (ROOT / 'resource' / PACKAGE).is_file()
    for init in ROOT.glob('*/__init__.py'):
        if init.parent.name not in NOT_INSTALLED:
            assert (init.parent / 'py.typed').is_file(), init.parent.name


def test_what_shows_and_proves_is_not_installed() -> None:
    found = ast.unparse(setup_arguments()['packages'])
    exclude = ast.literal_eval(found.removeprefix('find_packages(exclude=').removesuffix(')'))
    installed = {name.split('.')[0] for name in find_packages(str(ROOT), exclude=exclude)}
    assert {'rugged_teleop', 'bridge_core', 'safety_mux'} <= installed
    assert not installed & {*NOT_INSTALLED}


def test_every_source_file_says_whose_it_is_and_under_which_licence() -> None:
    roots = ['launch', *(name for name in find_packages(str(ROOT)) if '.' not in name)]
    for path in [file for root in roots for file in (ROOT / root).rglob('*.*')]:
        if path.suffix in ('.py', '.c', '.h') and path.stat().st_size:
            first, second = path.read_text(encoding='utf-8').splitlines()[:2]
            assert first.lstrip('#/ ') == 'Copyright 2026 The rugged_teleop maintainers', path
            identifier = ['SPDX-License-Identifier', 'Apache-2.0']
            assert second.lstrip('#/ ').split(': ') == identifier, path


_NUMPY_FINDS = """
import importlib, os, sys
found = []
sys.addaudithook(
    lambda event, arguments: event == 'import' and arguments[0] == 'numpy'
    and found.append(os.environ.get('OPENBLAS_NUM_THREADS'))
)
importlib.import_module(sys.argv[1])
print(*found)
"""


_MODULES = sorted({point.split(':')[0] for point in entry_points().values()})


@pytest.mark.parametrize(
    ('module', 'given'), [*((each, None) for each in _MODULES), (_MODULES[0], '3')]
)
def test_no_executable_has_a_thread_a_processor_for_numpy(module: str, given: str | None) -> None:
    environment = {k: v for k, v in os.environ.items() if k != 'OPENBLAS_NUM_THREADS'}
    if given:
        environment['OPENBLAS_NUM_THREADS'] = given
    command = [sys.executable, '-c', _NUMPY_FINDS, module]
    found = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert set(found.stdout.split()) <= {given or '1'}


def test_requirements_are_pinned() -> None:
    for name in ('requirements.txt', 'requirements-dev.txt', 'requirements-docs.txt'):
        for line in text(name).splitlines():
            assert line.startswith('#') or re.fullmatch(r'[\w-]+==[\w.]+(; .+)?', line), line


def test_locked_files_have_every_requirement_by_hash() -> None:
    line = r'([\w-]+==[\w.+]+)( ; python_version [^-]+)?( --hash=sha256:[0-9a-f]{64})+'
    locked = {}
    for name in ('requirements-locked.txt', 'requirements-ros-locked.txt'):
        lines = [each for each in text(name).splitlines() if not each.startswith('#')]
        assert all(re.fullmatch(line, each) for each in lines), name
        locked[name] = {each.split()[0] for each in lines}
    wanted = {
        each.split(';')[0].lower().replace('_', '-')
        for name in ('requirements.txt', 'requirements-dev.txt')
        for each in text(name).splitlines()
        if not each.startswith('#')
    }
    assert wanted <= set.union(*locked.values()), 'make lock'
    # Where a ROS is sourced, none of it is installed.
    assert not any(each.startswith('ros-') for each in locked['requirements-locked.txt'])


# What is on the path.


def test_path_gets_each_node_and_two_names_of_the_package_alone() -> None:
    """pip puts console scripts on everybody's PATH: no `recorder` or `simulate` belongs there."""
    nodes = {path.parent.name for path in ROOT.glob('*/node.py')} - {'bridge_core'}
    points = ast.literal_eval(setup_arguments()['entry_points'])['console_scripts']
    names = {point.split(' = ')[0] for point in points}
    assert names == {*nodes, 'rugged_teleop', 'rugged_teleop_stack'}


# Launch files. They are checked as text, for ROS's launch is not on every machine.


def test_there_is_a_launch_file_for_each_node_for_the_three_and_for_all() -> None:
    names = {path.name.removesuffix('.launch.xml') for path in LAUNCH_FILES}
    assert names == {*NODES, *BESIDE, 'spine', 'stack'}


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_file_names_what_exists(path: Path) -> None:
    root = ElementTree.parse(path).getroot()
    assert root.tag == 'launch'
    for node in root.iter('node'):
        assert node.get('pkg') == PACKAGE
        assert node.get('exec') in entry_points()
        if path.name != 'stack.launch.xml':  # several nodes, each with a name of its own
            assert node.get('name') == node.get('exec')
    for value in values(root):
        if value.startswith(SHARE):
            assert (ROOT / value.removeprefix(SHARE)).is_file(), value


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_file_declares_what_it_uses_and_passes_its_parameter_file_on(path: Path) -> None:
    root = ElementTree.parse(path).getroot()
    defaults = {arg.get('name'): arg.get('default') for arg in root.findall('arg')}
    used = {name for value in values(root) for name in re.findall(r'\$\(var (\w+)\)', value)}
    assert used == {*defaults}
    assert 'params_file' in defaults
    assert all(arg.get('description') for arg in root.findall('arg'))
    # Given as <param from=...>, a file that does not exist is left out, and the node starts.
    assert not list(root.iter('param'))
    for node in root.iter('node'):
        assert node.get('ros_args') == '--params-file $(var params_file)'
    for include in root.iter('include'):
        given = {arg.get('name'): arg.get('value', '') for arg in include.iter('arg')}
        file = include.get('file', '').removeprefix(SHARE)
        assert {*given} <= {a.get('name') for a in ElementTree.parse(ROOT / file).iter('arg')}
        (name,) = re.findall(r'\$\(var (\w+)\)', given['params_file'])
        assert defaults[name] == '$(var params_file)'


def test_file_of_the_spine_has_a_section_for_each_of_its_nodes() -> None:
    sections = sections_of(ROOT / 'config/spine.yaml')
    assert sections == [
        f'/**/{name}' for name in ('fort_vsc_bridge', 'safety_mux', 'esi_drive_bridge')
    ]


def values(root: ElementTree.Element) -> list[str]:
    return [value for element in root.iter() for value in element.attrib.values()]


# udev, CI, README.


@pytest.mark.parametrize(
    ('subsystem', 'vendor', 'parts'),
    [
        ('tty', '2a99', ['ATTRS{idProduct}=="d002"', 'SYMLINK+="fort_vsc"']),
        ('tty', 'ffff', ['ATTRS{idProduct}=="f005"', 'SYMLINK+="fort_vsc"']),
        ('hidraw', '2a99', ['SYMLINK+="fort_vsc_hid"']),
        ('hidraw', 'ffff', ['ATTRS{idProduct}=="f005"', 'SYMLINK+="fort_vsc_hid"']),
    ],
)
def test_udev_rule_gives_the_vsc_its_name(subsystem: str, vendor: str, parts: list[str]) -> None:
    rules = text('udev/60-rugged-teleop.rules').splitlines()
    begin = f'SUBSYSTEM=="{subsystem}", ATTRS{{idVendor}}=="{vendor}"'
    (rule,) = (line for line in rules if line.startswith(begin))
    for part in (*parts, 'MODE="0660"', 'GROUP="dialout"'):
        assert part in rule


def targets() -> set[str]:
    (line,) = re.findall(r'^\.PHONY: (.+)$', text('Makefile'), re.M)
    return set(line.split())


def first_commands(markdown: str) -> list[str]:
    """Return the commands of a page's first code block, fenced or indented."""
    block = re.search(r'^```.*\n((?:(?!```).*\n)+)|^((?: {4}.+\n)+)', markdown, re.M)
    assert block is not None
    return [line.split('#')[0].strip() for line in (block[1] or block[2]).splitlines()]


def test_readme_opens_with_its_two_commands() -> None:
    readme = text('README.md')
    commands = first_commands(readme)
    assert commands == ['make demo ARGS=--once', 'make test']
    assert readme.index(commands[0]) < readme.index('\n## ')
    assert {command.split()[1] for command in commands} <= targets()


def test_make_has_the_targets_that_the_documents_name() -> None:
    assert {'demo', 'test', 'lint', 'bench', 'clean'} <= targets()
    for page in ('README.md', 'CONTRIBUTING.md'):
        assert set(re.findall(r'`make ([\w-]+)', text(page))) <= targets(), page
