"""What is told beside a diagnosis: the kinds of notes and advice, each with its sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, unique
from string import Formatter
from typing import Any

from bdnn_ros.errors import listed

LINKS = "the links' masses and inertias"
SINCE: Mapping[bool, Mapping[str, object]] = {
    False: {"reference": "simulation", "mended": LINKS, "dropped": LINKS},
    True: {"reference": "earlier model", "mended": "the earlier model", "dropped": "its links and joints"},
}
"""Words for what a recording is compared with: the simulation (False), or a model identified earlier (True)."""
UNPREDICTED = "no position, velocity, acceleration, load or time predicts it."


@unique
class Kind(Enum):
    """Kinds of notes, of clauses within them, and of advice, each with its sentence.

    Beside the usual format specifications, a share takes `%`, and a list takes how many of it are written, or what stands
    between its members.
    """

    # what the recording cannot tell
    ALONE = (
        "Only {joint} {does}: what it carries, wrong links, wrong angles and a wrong torque constant do the same to it, so none "
        "of them is named.{remedy}"
    )
    MOVES = "moves"
    MEASURED = "has a measured effort while it moves"
    MEASURED_LONGEST = "has an effort that was measured in motion for more than {least:%} of the time"
    MOVE_SEVERAL = " Move several joints at once."
    RECORD_EFFORTS = " Record the efforts of {joints:20}, too."
    BRIEFLY = (
        "There are {seconds} s of motion at the joint that moves longest, and {least} s are needed behind a low-pass of "
        "{cutoff:.1f} Hz to tell what changes with time, a push or a drift, from what differs from place to place, as cogging: "
        "none of them is named. Record more motion."
    )
    UNCOMPARED = (
        "No effort of {joints:20} is compared: it does not move, or none was measured where it does. Zeros of `effort_rmse` are "
        "no errors there."
    )
    NOT_HELD_OUT = (
        "No effort of {joints:20} is compared: it was measured in motion too briefly for any of that to be held out, so that its "
        "gain is not known. Zeros of `effort_rmse` are no errors there."
    )
    ONE_CLOCK = "Times are told on one clock, on which the recordings follow one another: {begin:20}."
    BEGINS = "{name} begins at {start:.1f} s"
    AT_REST = (
        "Where it rests, the effort at {joints:8} is far from the {reference}'s for a while: something pushes then, or dry "
        "friction holds what it likes, and no motion shows which. Keep the robot moving."
    )

    # what a finding may be mistaken for
    SCALED = (
        "How much the efforts of {joints:20} are scaled is told by those of the other joints, which are taken to be right: if "
        "all were wrong by one factor, scales, masses and frictions would be, too. Hang a known mass at the flange to see."
    )
    WEIGHTLESS = (
        "What is named at {where} may be no more than the described inertia of {links:8}, fixed to it without a mass, which the "
        "simulation counts as its own."
    )
    LIKE_A_LOAD = (
        "Something pulls {where} straight down {when}, as a load of {mass:.2g} kg would that was {done} then: a payload is told "
        "of a recording that has it from start to end."
    )
    CARRIED = (
        "Something pulls {where} straight down {when}, all through some of the recordings, as a load of {mass:.2g} kg would: a "
        "payload is told of recordings that all have it. Diagnose those apart from the others."
    )
    FROM = "from {start:.1f} s on"
    UNTIL = "until {end:.1f} s"
    BETWEEN = "from {start:.1f} s to {end:.1f} s"
    ENDLESS = (
        "That the push on {where} {edges: or } is not seen: what changes once, or creeps, as the zero of a sensor that gets "
        "warm, would do the same.{more}"
    )
    ONE_BY_ONE = " It lasts all through a recording, and each may have drifted by itself: diagnose them one by one, too."
    WITH_TIME = (
        "What is named at {where} grows with time as it does with the motion, which goes one way: a drift would do the same, and "
        "none is looked for in so short a recording. Move to and fro, and longer."
    )
    ALIKE = (
        "What the links are off by is nearly one factor, {factor:.2f} ± {std:.1g}. Efforts that are reported {factor:.2f} times "
        "as large as they act would do the same: an effort_scale of {scale:.2f} at all joints, as of a wrong torque constant or "
        "unit."
    )

    # what has no name
    AT_AN_END = (
        "Something pushes in the first or last {ends:g} s only, or a filter that was run both ways made it of the recording's "
        "ends, or pre-sliding friction was bent before the recording began: it is not named. Record from rest until the robot "
        "rests."
    )
    THROUGHOUT = (
        "Something like a push is there nearly always when the joint moves that shows it, so that a cause that changes between "
        "its moves does the same: it is not named. Move that joint again and again from start to end."
    )
    IN_MODEL = "Not sure enough for a name, but in the extended model, which it helps: {what:20}{much}."
    OF_ERROR = " ({share:%} of the {reference}'s squared error)"
    NOT_IN_MODEL = (
        "Not sure enough for a name, and not in the extended model, though the gain counts it: something that pushes at "
        "{where:20}."
    )
    UNKNOWN = (
        "Surely something is there, and the extended model has it, but this motion shows its parameters too badly for a name: "
        "{what:; }. Record more motion; `bdnn excite` makes one that shows them."
    )
    OFF_CENTRE = (
        "a centre of mass of {place} that is elsewhere than in the model, or {title} at {place}, mass {mass:.2g} ± {std:.1g} kg, "
        "which may be nothing, or a rotor's inertia at the joint that moves it"
    )
    OF_INERTIA = "inertia of {place} beyond the model's, as a rotor that moves it has"
    FAR_OFF = (
        "The links' masses and inertias are further off than usual: more is wrong with them than is named."
    )
    STAYS = (
        "What would be corrected without a name, by errors of {dropped}, surely predicts the motion that was held out worse: the "
        "extended model is the {reference} as it is."
    )
    MOSTLY_LINKS = (
        "Beside the named causes, errors of all links' masses and inertias make up {share:%} of the {reference}'s squared "
        "error: none of them is sure by itself{more}."
    )
    AMONG_THEM = ", and wrong units or what has no name may be among them"
    BY_LINKS = (
        "Errors of {mended}, none of which stands out, make up {share:%} of the {reference}'s squared error; the extended model "
        "mends them."
    )
    BY_LEAD = (
        "Efforts are stamped {much:.1f} ms too {way} for the motion, as where one is held for longer or both are not read at "
        "once. That makes up {share:%} of the {reference}'s squared error; the extended model mends it."
    )
    MOSTLY_AT = (
        "Most of what the extended model mends without a name is at {joint}, {share:%} of the earlier model's squared error, by "
        "what {does}: that is where to look, though other parameters that were not known better may do the same."
    )
    OF_JOINT = "acts at the joint itself (friction, rotor, offset)"
    OF_LINKS = "links weigh and how they turn"

    # what is unexplained
    WORSE = "What was found predicts the motion that was held out worse than the {reference} does."
    LEFT = "{Much} of the {reference}'s squared error is left above the noise{where}"
    AT = ", at {there:8}"
    HARDLY = "What is left is hardly more than noise"
    SMALL = "What is left is small, but more than twice the noise at {there:8}"
    POOR = (
        "The earlier model does not describe this motion down to its noise, whether anything changed or not{then}: {much} of its "
        "squared error is left above that{where}"
    )
    ERRED_LESS = " (it errs {times: to } times as much there as on the motion that it was made from)"
    DEPENDS = "{left}; it depends on {inputs:, }."
    DEPENDS_AT = "{left}; at {of_these:8} it depends on {inputs:, }."
    IN_BURSTS = f"{{left}}, in bursts at {{joints:8}}; {UNPREDICTED}"
    LIKE_NOTHING = f"{{left}}; {UNPREDICTED}"
    LIKE_NOISE = f"What is left looks like noise: {UNPREDICTED}"

    # advice
    RECORD_MORE = "No cause stands out in this motion: record more {wider}"
    IDENTIFY_MORE = "Identify the earlier model from more motion, and record more to compare with it, {wider}"
    WIDER = "of all joints together, over wider ranges, slow and fast; `bdnn excite` makes such a motion."
    WEIGH = (
        "Whether all links weigh {factor:.2f} times what the model says or all efforts are reported {factor:.2f} times as large "
        "as they act, no motion shows: weigh a link or hang a known mass at the flange, and check torque constants and units."
    )
    AS_GOOD = (
        "What {richer} at {place} would do beyond {plain} is less than {percent:.2g} % of its effort by this motion: either will "
        "do, and no other motion need tell them apart."
    )
    WOULD_SHOW = (
        "{Richer} of a usual size at {place} would have shown in this motion: beyond {plain} it is at most {percent:.2g} % of "
        "its effort. Only a far longer recording of such motions shows what is smaller; without it {plain} will do."
    )


@dataclass(frozen=True)
class Note:
    """Something that holds beside the findings.

    Attributes:
        values: what stands in its sentence: places, quantities, and clauses, which know the values of the whole.
    """

    kind: Kind
    values: Mapping[str, object] = field(default_factory=dict)

    def sentence(self, since: bool) -> str:
        """Its sentence; `since` if an earlier model is compared instead of the simulation."""
        return _Filled.of(self, SINCE[since])


class _Filled(Formatter):
    """Fills a sentence, and the clauses in it."""

    def __init__(self, values: Mapping[str, object]) -> None:
        self._values = values

    @classmethod
    def of(cls, note: Note, known: Mapping[str, object]) -> str:
        values = {**known, **note.values}
        return cls(values).vformat(note.kind.value, (), values)

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Note):
            return self.of(value, self._values)
        if isinstance(value, (list, tuple)):
            every = [self.format_field(one, "") for one in value]
            return listed(every, int(format_spec)) if format_spec.isdigit() else format_spec.join(every)
        if format_spec == "%":
            return f"{100.0 * min(value, 1.0):.0f} %"
        return str(super().format_field(value, format_spec))
