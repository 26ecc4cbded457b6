"""Results on their journey through JSON: what those of one call share is read and proved once.

A file holds the certificates that a result quotes and the steps with which it begins, so that the
file of the last of ten objectives repeats those of the nine others.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from typing import Any

from sparsepop_py import result as results
from sparsepop_py.io.json_files import certificates
from sparsepop_py.io.json_files.files import from_json, to_json
from sparsepop_py.result import Result


class Batch:
    """What is read and proved of the results that share one ``known``."""

    def __init__(self, known: Any = None) -> None:
        self.owner = known  # alive, so that no other batch has its id
        self.read: dict[Any, Any] = {}
        self.proved: dict[Any, Any] = {}

    def once(self, found: Any, quoted: list[Any], read: Callable[[], Any]) -> Any:
        """Read a text once, unless it quotes other certificates."""
        key = json.dumps(found), *map(id, quoted)
        if key not in self.read:
            self.read[key] = read(), quoted
        return self.read[key][0]


BATCH: ContextVar[Batch | None] = ContextVar("batch", default=None)
plainly, table = results.proved_bound, certificates._Certificates


class SharedTable(table):  # type: ignore[misc, valid-type]
    """Certificates and steps that are equal to those of the batch are the same objects."""

    def __init__(self) -> None:
        super().__init__()
        self.batch, read = BATCH.get(), self.steps.read
        if self.batch is not None:
            once = self.batch.once
            self.steps = replace(
                self.steps,
                read=lambda found, place: once(
                    found, self.quoted(found), lambda: read(found, place)
                ),
            )

    def quoted(self, step: Any) -> list[Any]:
        return [self.read_already[number] for *_, number in step.get("bounds", ())]

    def _certificate(self, found: Any, place: str) -> Any:
        read = super()._certificate
        if self.batch is None:
            return read(found, place)
        steps = [step for part in found["parts"] for step in part["steps"]]
        quoted = [one for step in steps for one in self.quoted(step)]
        return self.batch.once(found, quoted, lambda: read(found, place))


def proved_once(certificate: Any, problem: Any) -> float:
    """The bound that verification reaches with what the batch has proved."""
    batch = BATCH.get()
    if batch is None:
        return plainly(certificate, problem)
    verdict = certificate.verify(problem, batch.proved)
    assert verdict.ok, verdict.reason
    return float(verdict.bound)


certificates._Certificates, results.proved_bound = SharedTable, proved_once


def through_json(result: Result, batch: Batch | None) -> Any:
    """Write and read a result; one without a batch shares nothing."""
    token = BATCH.set(batch)
    try:
        return from_json(to_json(result))
    finally:
        BATCH.reset(token)
