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
What a capture says: files of many formats, by the codecs of the bridges.

A reader (texts, pcap, logs) turns a file into pieces, each with its place in the file; protocols
turns pieces into entries; statistics and writers are what becomes of these. All of them are
generators, so that no file has to fit into memory.
"""
