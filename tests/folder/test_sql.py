"""SQL over a campaign's tables: how a question ends."""

import pytest

from abhv_mc.folder import sql


def test_an_interrupt_of_an_answer_that_has_just_ended_is_one(failing_folder, monkeypatch):
    def interrupted_at_its_end(work):
        work()
        raise KeyboardInterrupt

    monkeypatch.setattr(sql, "run_in_thread", interrupted_at_its_end)
    with pytest.raises(KeyboardInterrupt):
        sql.ask(failing_folder, "select 1", lambda answer: answer.fetchall())
