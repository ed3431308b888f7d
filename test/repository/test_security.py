# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""No shell, no code made of data, no secret in the sources; a wire loads nothing foreign."""

import ast
from collections.abc import Iterator
from pathlib import Path
import subprocess
import sys

import pytest

from bridge_core.transports.started import environment
from stage.rig import NOT_INSTALLED, ROOT

PRODUCT = sorted(
    path
    for init in ROOT.glob('*/__init__.py')
    if init.parent.name not in NOT_INSTALLED
    for path in init.parent.rglob('*.py')
)
# Node and wire talk by a socket pair that nobody else can reach (docs/decisions/0014).
PICKLES = ('bridge_core/transports/process.py', 'bridge_core/transports/wire_process.py')
CODE_OF_DATA = {'eval', 'exec', 'compile', '__import__'}
SHELLS = {'os.system', 'os.popen', 'subprocess.getoutput', 'subprocess.getstatusoutput'}
LOADERS = {'marshal', 'shelve', 'dill', 'cloudpickle', 'jsonpickle'}
UNSAFE_YAML = {'yaml.load', 'yaml.load_all', 'yaml.unsafe_load', 'yaml.full_load'}
STARTERS = {'subprocess.run', 'subprocess.Popen', 'subprocess.call', 'subprocess.check_output'}
SECRET = ('password', 'passwd', 'secret', 'token', 'api_key')


def findings(tree: ast.AST) -> Iterator[str]:
    """Yield what a source should not do."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield from _of_call(node, ast.unparse(node.func))
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            names = {alias.name for alias in node.names} | {getattr(node, 'module', None)}
            yield from (str(name) for name in names & {*LOADERS, 'pickle'})
        elif isinstance(node, (ast.Assign, ast.AnnAssign)) and _is_text(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            assigned = {ast.unparse(target).lower() for target in targets}
            yield from (name for name in assigned if name.endswith(SECRET))


def _of_call(call: ast.Call, name: str) -> Iterator[str]:
    if name in CODE_OF_DATA | SHELLS | UNSAFE_YAML or name.startswith(('os.spawn', 'os.exec')):
        yield name
    if name in STARTERS and call.args and _is_text(call.args[0]):
        yield f'{name} of a string'
    yield from (f'{name}(shell=…)' for word in call.keywords if word.arg == 'shell')


def _is_text(node: ast.expr | None) -> bool:
    """Tell whether an expression is a text that is not empty."""
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value != ''
    )


def test_no_shell_no_code_of_data_no_secret() -> None:
    assert len(PRODUCT) > 100
    for path in PRODUCT:
        name = path.relative_to(ROOT).as_posix()
        allowed = ['pickle'] if name in PICKLES else []
        assert list(findings(ast.parse(path.read_text(encoding='utf-8')))) == allowed, name


@pytest.mark.parametrize(
    'source',
    [
        *('eval(text)', 'os.system(text)', 'yaml.load(text)', 'import pickle'),
        *("subprocess.run('ls')", "subprocess.run(f'ls {name}')", 'subprocess.run(x, shell=True)'),
        *("PASSWORD = 'x'", "self.token: str = 'x'", 'from marshal import loads'),
    ],
)
def test_forbidden_code_is_found(source: str) -> None:
    assert list(findings(ast.parse(source)))


@pytest.mark.skipif(sys.version_info < (3, 11), reason='Python 3.10 has no PYTHONSAFEPATH')
def test_wire_loads_nothing_from_the_folder_where_its_node_was_started(tmp_path: Path) -> None:
    (tmp_path / 'pickle.py').write_text('raise SystemExit("planted")')
    subprocess.run(
        [sys.executable, '-S', '-c', 'import pickle'],
        cwd=tmp_path,
        env=environment(__name__),
        check=True,
    )
