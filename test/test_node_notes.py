"""What a diagnosis says beside its findings reaches who runs the node: in the log, and in the answer to ~/diagnose."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from bdnn_interfaces.srv import Diagnose
from bdnn_ros.nodes.publishing import Publishing
from bdnn_ros.nodes.services import Services
from bdnn_ros.online.channel import Message
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.session import Session

LATE, CUT = "The efforts come 12 ms late.", "The effort of a was cut off."


def diagnosis(*notes: str) -> dict:
    gain = {"value": 0.5, "interval": [0.4, 0.6]}
    return {"verdict": "explained", "findings": [], "gain": gain, "advice": [], "notes": list(notes)}


def test_notes_are_logged_once_while_they_stay_the_same():
    session, node = Session(Settings()), MagicMock()
    publishing = Publishing(node, session)
    publishing._reporter = MagicMock()
    log = node.get_logger.return_value.info

    def told(found: dict) -> list[str]:
        log.reset_mock()
        session.findings.append(Message("findings", {"diagnosis": found}))
        publishing.tell(True, "", 0)
        return [call.args[0] for call in log.call_args_list]

    change = {key: value for key, value in diagnosis().items() if key != "notes"}
    assert told(diagnosis(LATE)) == [LATE]
    assert told(change) == told(diagnosis(LATE)) == []
    assert told(diagnosis(LATE, CUT)) == [CUT]
    assert told(diagnosis()) == [] and told(diagnosis(LATE)) == [LATE]
    session.stop()


@pytest.mark.parametrize(("notes", "said"), [((), "explained"), ((LATE, CUT), f"explained. {LATE} {CUT}")])
def test_notes_are_in_the_answer(notes, said):
    async def at_once(later):
        return later

    services = Services.__new__(Services)
    services._node = MagicMock()
    services._session = SimpleNamespace(
        diagnose=lambda window: Message("findings", {"diagnosis": diagnosis(*notes)})
    )
    services._until = at_once
    with pytest.raises(StopIteration) as answer:
        services._diagnose(Diagnose.Request(window=10.0), Diagnose.Response()).send(None)
    assert answer.value.value.success and answer.value.value.message == said
