"""A lifecycle node that refuses a transition which is not possible: rclpy's own would end with an error."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from bdnn_ros.errors import listed


class Lifecycle(LifecycleNode):
    """As `LifecycleNode`, but that ~/change_state answers whatever it is asked for, as rclcpp's does."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._change_if_possible

    def start(self) -> bool:
        """Configure and activate; whether both succeeded."""
        steps = (self.trigger_configure, self.trigger_activate)
        return all(step() == TransitionCallbackReturn.SUCCESS for step in steps)

    def _change_if_possible(self, request: ChangeState.Request, response: ChangeState.Response) -> Any:
        wanted = request.transition
        possible = {label: number for number, label, *_ in self._state_machine.available_transitions}
        if wanted.label in possible or (not wanted.label and wanted.id in possible.values()):
            return self._change_state(request, response)
        state = self._state_machine.current_state[1]
        self.get_logger().warning(
            f"The transition {wanted.label or wanted.id} is not possible while the node is {state}. "
            f"Ask for one of {listed(f'{label} ({number})' for label, number in possible.items())}."
        )
        response.success = False
        return response
