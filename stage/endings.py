# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A test for each signal that ends a node: SIGTERM in make test, the others in make proof."""

from typing import Any

import pytest

from stage.rig import ENDING


def first_of(first: Any, *others: Any) -> list[Any]:
    """Return what one parameter may be: the first in make test, the others in make proof."""
    return [first, *(pytest.param(each, marks=pytest.mark.proof) for each in others)]


each_ending = pytest.mark.parametrize('number', first_of(*ENDING))
