# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mux's services. They are asked for in the executor's thread, and done on the lane."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from std_srvs.srv import SetBool, Trigger

from bridge_core import clock
from bridge_core.managed_node import ManagedNode
from bridge_core.watchdog import FreezeWatch, FROZEN
from safety_mux.protocol import Reply

LOOK_PERIOD = 0.1  # s; each look wakes the executor
_FREEZE = 0.2 + LOOK_PERIOD  # s without a look: what bridges take for a freeze, at the least
_SETTLING_TIME = 0.25  # s, as of bridges


class Services:
    """
    ~/reset, ~/trip, ~/end_trip and ~/select_autonomy.

    Who asked may have gone away while the executor hung: what may have waited as long is not
    done, unless it is a stop.

    :param reset: does it, as the other three do, on the lane; true: it is late.
    :param select: true: autonomy gets control.
    """

    def __init__(
        self,
        node: ManagedNode,
        *,
        reset: Callable[[bool], Reply],
        trip: Callable[[], Reply],
        end_trip: Callable[[], Reply],
        select: Callable[[bool], Reply],
    ) -> None:
        self._node = node
        self._reset, self._trip, self._end_trip, self._select = reset, trip, end_trip, select
        self.freeze = FreezeWatch(_FREEZE, _SETTLING_TIME)  # of the executor's thread
        self.look()  # until the first of its looks, requests wait as in a freeze
        node.create_timer(LOOK_PERIOD, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        node.create_service(Trigger, '~/reset', self.on_reset)
        node.create_service(Trigger, '~/trip', self.on_trip)
        node.create_service(Trigger, '~/end_trip', self.on_end_trip)
        node.create_service(SetBool, '~/select_autonomy', self.on_select_autonomy)

    def look(self) -> None:
        """Note that the executor's thread runs."""
        self.freeze.look(clock.now())

    def on_reset(self, request: Any, response: Any) -> Any:
        """Answer ~/reset; a late one counts as one in vain."""
        del request
        reset, late = (partial(self._reset, late) for late in (False, True))
        return self._answer(response, 'reset', reset, late=late)

    def on_trip(self, request: Any, response: Any) -> Any:
        """Answer ~/trip."""
        del request
        return self._answer(response, 'trip', self._trip, late=self._trip)

    def on_end_trip(self, request: Any, response: Any) -> Any:
        """Answer ~/end_trip."""
        del request
        return self._answer(response, 'end_trip', self._end_trip)

    def on_select_autonomy(self, request: Any, response: Any) -> Any:
        """Answer ~/select_autonomy; false is a stop."""
        select = partial(self._select, request.data)
        late = None if request.data else select
        return self._answer(response, 'select_autonomy', select, late=late)

    def _answer(
        self,
        response: Any,
        service: str,
        ask: Callable[[], Reply],
        *,
        late: Callable[[], Reply] | None = None,
    ) -> Any:
        """
        Do what is asked for.

        :param late: what to do where that may have waited; ``ask`` itself if it is a stop.
        """
        to_do = late if self.freeze.settling(clock.now()) else ask
        try:
            if to_do is None:
                response.message = FROZEN
            else:
                response.success, response.message = self._node.lane.call(to_do)
        except TimeoutError as error:
            response.message = str(error)
            if late is not None:
                self._node.lane.post(late)
            if late == ask:
                response.message = f'it stops as soon as it goes on: {error}'
        self._node.get_logger().info(f'~/{service}: {response.message}')
        return response
