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

"""Hostile inputs, guided by what they reach: ``make fuzz`` runs millions, ``make test`` a few."""

from __future__ import annotations

from test.fuzz.campaign import Target
from test.fuzz.decoders import DECODERS
from test.fuzz.devices import SESSIONS
from test.fuzz.files import FILES
from test.fuzz.messages import MESSAGES
from test.fuzz.onlookers import ONLOOKERS
from test.fuzz.parsers import PARSERS

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (*PARSERS, *DECODERS, *SESSIONS, *FILES, *MESSAGES, *ONLOOKERS)
}
