"""Parameters of the nodes: defaults, descriptions, ranges and the messages on invalid values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from bdnn_ros.efforts import factors_by_joint
from bdnn_ros.errors import BdnnError, UsageError, listed

TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    list: Parameter.Type.STRING_ARRAY,
}


@dataclass(frozen=True)
class Setting:
    """One parameter.

    Attributes:
        default: gives the type, too; an empty list is a list of strings.
        low, high: range of a number, both ends allowed.
        least: a number between `low` and this one is too small; `low` itself means something else, as none.
        choices: values of a string, any if empty.
        distinct: a list may hold nothing twice.
        check: raises BdnnError where the strings of a list cannot be used.
        live: may be changed while the node is configured.
    """

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    least: float | None = None
    choices: tuple[str, ...] = ()
    distinct: bool = False
    check: Callable[[list[str]], object] | None = None
    live: bool = False

    @property
    def descriptor(self) -> ParameterDescriptor:
        """What `ros2 param describe` shows; ranges are refused by rclpy itself."""
        descriptor = ParameterDescriptor(description=self.description)
        if self.choices:
            descriptor.additional_constraints = f"one of {listed(self.choices)}"
        if self.low is not None and self.high is not None:
            if isinstance(self.default, int):
                bounds = IntegerRange(from_value=int(self.low), to_value=int(self.high))
                descriptor.integer_range = [bounds]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=self.low, to_value=self.high)
                ]
        return descriptor

    def objection(self, value: Any) -> str:
        """Why a value is invalid, one sentence; empty if it is valid."""
        if self.choices and value not in self.choices:
            return f"{self.name} is {value!r}; it must be one of {listed(self.choices)}."
        if self.low is not None and self.high is not None and not self.low <= value <= self.high:
            return f"{self.name} is {value:g}; it must lie between {self.low:g} and {self.high:g}."
        if self.least is not None and self.low < value < self.least:
            return f"{self.name} is {value:g}; it must be {self.low:g}, or {self.least:g} and more."
        if self.distinct:
            twice = sorted(name for name, times in Counter(value or ()).items() if name and times > 1)
            if twice:
                return f"{self.name} holds {listed(twice)} more than once; name each only once."
        if self.check is not None:
            try:
                self.check(_texts(value))
            except BdnnError as error:
                return f"{self.name}: {error}"
        return ""


IDENTIFICATION = (
    Setting("urdf_file", "", "URDF to start from; empty waits for the topic robot_description."),
    Setting(
        "joints",
        [],
        "Joints to identify, in this order; empty takes the most movable ones that are published together.",
        distinct=True,
    ),
    Setting(
        "effort_source",
        "measured",
        "Where efforts come from: the joint states (measured) or the topic effort_commands (command).",
        choices=("measured", "command"),
    ),
    Setting(
        "effort_factors",
        [],
        "N*m in each unit of reported effort, JOINT=FACTOR or FACTOR for all others: for currents, or turned signs.",
        check=factors_by_joint,
    ),
    Setting(
        "add_gravity",
        False,
        "Efforts leave out what the controller adds for gravity: add the robot description's.",
    ),
    Setting(
        "model_directory",
        "",
        "Where models are saved and loaded; the one in it is loaded at start and saved at the end. "
        "Empty: nothing is kept.",
    ),
    Setting(
        "save_period",
        60.0,
        "Time between saves of what was learned meanwhile [s], in model_directory; 0 saves at the end only.",
        0.0,
        86400.0,
    ),
    Setting("autostart", True, "Configure and activate at start, without a lifecycle manager."),
    Setting("training", True, "Learn from the stream; false only serves the model.", live=True),
    Setting(
        "cutoff",
        0.0,
        "-3 dB frequency of the low-pass [Hz]; 0 chooses by the rate. Below 0.1 an estimate would take so long that "
        "1000 joint states a second could not be kept up with.",
        0.0,
        500.0,
        least=0.1,
    ),
    Setting("estimate_rate", 120.0, "Estimates published per second [Hz]; 0 publishes none.", 0.0, 1000.0),
    Setting(
        "diagnosis_period", 30.0, "Time between diagnoses [s]; 0 diagnoses only when asked.", 0.0, 86400.0
    ),
    Setting("diagnosis_window", 60.0, "Time each diagnosis looks back [s]; 0 takes all kept.", 0.0, 86400.0),
    Setting("buffer_size", 131072, "Joint states kept in memory, of about 200 bytes each.", 1000, 10_000_000),
    Setting("queue_depth", 1000, "Depth of the subscriptions' queues [messages].", 1, 100_000),
    Setting(
        "reliability",
        "reliable",
        "Quality of service of joint_states; best_effort for a publisher that offers no more.",
        choices=("reliable", "best_effort"),
    ),
    Setting("trainer_niceness", 10, "How much the trainer yields to other processes.", 0, 19),
)

REPLAY = (
    Setting("bag", "", "Bag to play: an .mcap file, a rosbag2 directory or a .db3 file."),
    Setting("rate", 1.0, "Speed, as a multiple of the bag's own.", 0.01, 100.0),
    Setting("loop", False, "Start over at the end."),
    Setting("joint_states_topic", "/joint_states", "Topic of the joint states in the bag."),
    Setting("effort_commands_topic", "", "Topic of the effort commands in the bag; empty plays none."),
    Setting("urdf_file", "", "URDF to publish; empty takes the bag's own, if it has one."),
    Setting("rename", [], "Rules for joint names, old=new or s/pattern/replacement/."),
    Setting("clock", False, "Publish the stamps on /clock, for nodes with use_sim_time."),
    Setting("wait", 10.0, "Longest wait for a subscriber before it starts [s].", 0.0, 3600.0),
)


def _texts(value: Iterable[str] | None) -> list[str]:
    """The non-empty strings of a list."""
    return [text for text in value or [] if text]


class Settings:
    """The declared parameters of a node; changes are validated.

    Args:
        configured: whether settings that are not live may no longer change.
        changed: called with name and value after a live one was set.

    Raises:
        UsageError: a value given at start is of the wrong type or out of range.
    """

    def __init__(
        self,
        node: Node,
        settings: Sequence[Setting],
        configured: Callable[[], bool] = lambda: False,
        changed: Callable[[str, Any], None] | None = None,
    ) -> None:
        self._node = node
        self._by_name = {setting.name: setting for setting in settings}
        self._configured = configured
        for setting in settings:
            self._declare(setting)
        node.add_on_set_parameters_callback(self._check)
        if changed is not None:

            def tell(accepted: list[Parameter]) -> None:
                for parameter in accepted:
                    changed(parameter.name, parameter.value)

            node.add_post_set_parameters_callback(tell)

    def __getitem__(self, name: str) -> Any:
        """The value of a parameter; strings in a list are never empty."""
        value = self._node.get_parameter(name).value
        if isinstance(self._by_name[name].default, list):
            return _texts(value)
        return value

    def _declare(self, setting: Setting) -> None:
        kind = TYPES[type(setting.default)]
        try:
            # a default of [] would be taken for bytes: the type is declared, the value set after
            parameter = self._node.declare_parameter(setting.name, kind, setting.descriptor)
            if parameter.type_ == Parameter.Type.NOT_SET:
                self._node.set_parameters([Parameter(setting.name, kind, setting.default)])
        except InvalidParameterTypeException:
            given = self._node._parameter_overrides[setting.name].value
            words = {float: "a number with a decimal point", int: "a whole number", bool: "true or false"}
            needed = words.get(type(setting.default), "text" if setting.default == "" else "a list of text")
            raise UsageError(f"{setting.name} is {given!r}; it must be {needed}.") from None
        except InvalidParameterValueException:
            given = self._node._parameter_overrides[setting.name].value
            raise UsageError(setting.objection(given)) from None
        objection = setting.objection(self._node.get_parameter(setting.name).value)
        if objection:
            raise UsageError(objection)

    def _check(self, parameters: Iterable[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            setting = self._by_name.get(parameter.name)
            if setting is None:
                continue
            objection = setting.objection(parameter.value)
            if not objection and self._configured() and not setting.live:
                objection = f"{setting.name} takes effect at configuration: clean the node up first."
            if objection:
                return SetParametersResult(successful=False, reason=objection)
        return SetParametersResult(successful=True)
