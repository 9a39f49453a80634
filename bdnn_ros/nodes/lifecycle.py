"""A lifecycle node that refuses transitions that are not possible in its state; rclpy's own raises and ends."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from bdnn_ros.errors import listed


class Lifecycle(LifecycleNode):
    """A `LifecycleNode` whose service ~/change_state always answers, as that of rclcpp does."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._change_if_possible

    def start(self) -> bool:
        """Configure and activate; returns whether both succeeded."""
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
