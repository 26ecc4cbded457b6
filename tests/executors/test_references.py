"""Values that go to other processes with references in place of what is there."""

from __future__ import annotations

import pickle

from sparsepop_py.executors.references import References, received


def test_kept_objects_are_sent_once_and_come_back_as_themselves():
    references, part = References(), [1.0] * 50
    whole = {"part": part}
    references.keep(part, whole)
    references.keep(part)  # once more
    first = received(pickle.loads(pickle.dumps(references.packed([whole, part]))))
    second = received(pickle.loads(pickle.dumps(references.packed((part, whole)))))
    assert first.value[0]["part"] is first.value[1]
    assert second.value[0] is first.value[1] and second.value[1] is first.value[0]
    back = references.unpacked(second.answer([second.value[1], [2.0]]))
    assert back[0] is whole and back[1] == [2.0]


def test_later_groups_refer_to_earlier_ones():
    references, old = References(), [1.0]
    references.keep(old)
    new = [old, 2.0]
    references.keep(new)
    there = received(references.packed(new))
    assert there.value[0] is received(references.packed(old)).value


def test_live_objects_are_sent_as_they_are_now():
    references, state = References(), {"count": 1}
    assert received(references.packed([state], [state])).value[0] == {"count": 1}
    state["count"] = 2
    there = received(references.packed([state], [state]))
    assert there.value[0] is there.live[0] and there.live[0] == {"count": 2}
    there.live[0]["count"] = 3
    assert references.unpacked(there.answer(there.live[0]), [state]) is state
    assert state == {"count": 2}


def test_owners_do_not_mix():
    values = [[1.0], [2.0]]
    owners = [References() for _ in range(6)]
    for owner in owners:
        owner.keep(*values)
    for owner in (*owners, owners[0]):  # the first was forgotten by then
        assert received(owner.packed(values)).value == values
