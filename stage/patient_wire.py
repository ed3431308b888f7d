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
The process of a patient node's wire, see patience.py; used like bridge_core's own.

It imports no more than that, so it starts as quickly.
"""

import runpy

from bridge_core.transports import wire

FROZEN_TIME = 1.0  # s; what is held up for as long has still heard everything
vars(wire).update(_FROZEN_TIME=FROZEN_TIME)

if __name__ == '__main__':
    runpy.run_module('bridge_core.start_wire', run_name='__main__', alter_sys=True)
