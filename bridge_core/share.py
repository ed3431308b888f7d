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

"""Files that come with the package and are no code, such as config/."""

from pathlib import Path


def shared(name: str) -> Path:
    """
    Return a file of the package: in the sources, or in share/ once installed.

    :raises FileNotFoundError: naming where it was looked for.
    """
    package = Path(__file__).resolve().parent
    places = [package.parent]
    places += [parent / 'share' / 'rugged_teleop' for parent in package.parents]
    for place in places:
        if (place / name).is_file():
            return place / name
    raise FileNotFoundError(f'{name} is not in {places[0]} nor in share/ of the installation')
