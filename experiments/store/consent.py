"""Consent: what a participant answered to the protocol's question whether they take part.

The answer stands in the database of the session, and in its journal. The session of a
participant who declined holds nothing else. No signature is kept.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from core.files import InputError
from experiments.inputs import is_person
from experiments.protocol import Protocol

KEY = "consent"  # in the table `about`


class ConsentAnswer(NamedTuple):
    agreed: bool
    time: str  # ISO, UTC


def refuse_consent(protocol: Protocol, participant: str, answer: ConsentAnswer | None) -> None:
    """InputError if the protocol asks for consent and there is no answer, or the other way round."""
    if protocol.consent is not None and answer is None:
        raise InputError(
            f"participant {participant}: has not been asked for the consent of the {protocol.name} protocol"
        )
    if protocol.consent is None and answer is not None:
        raise InputError(f"participant {participant}: the {protocol.name} protocol does not ask for consent")


def agreed(about: Mapping[str, Any]) -> bool | None:
    """Whether the participant agreed, by what is stored; None: not asked, or it cannot be read."""
    stored = about.get(KEY)
    answer = stored.get("agreed") if isinstance(stored, dict) else None
    return answer if isinstance(answer, bool) else None


def refuse_without_consent(session: Path, protocol: Protocol, about: Mapping[str, Any]) -> None:
    """InputError if a stored session of a person cannot go on: they declined, or were not asked."""
    if protocol.consent is None or not is_person(about["hand"]) or agreed(about):
        return
    why = (
        "the participant declined to take part"
        if agreed(about) is False
        else "the participant was not asked for consent"
    )
    raise InputError(f"{session}: {why}; name another participant")
