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

"""
What today's code would have decided, of what was recorded: a regression test out of any incident.

``track`` compares two courses of a value, ``beginning`` brings a mux to the state in which a
recording begins, ``mux`` and ``sessions`` feed what was recorded, ``main`` is the command.
"""
