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

from assurance.fuzz.campaign import Target
from assurance.fuzz.decoders import DECODERS
from assurance.fuzz.devices import SESSIONS
from assurance.fuzz.files import FILES
from assurance.fuzz.messages import MESSAGES
from assurance.fuzz.onlookers import ONLOOKERS
from assurance.fuzz.parsers import PARSERS

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (*PARSERS, *DECODERS, *SESSIONS, *FILES, *MESSAGES, *ONLOOKERS)
}
