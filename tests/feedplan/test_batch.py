"""One loop over tasks: every one has an outcome, once, whatever happens to it or to those who do it."""

from __future__ import annotations

from concurrent.futures import BrokenExecutor, CancelledError, Future

import pytest

from feedplan.batch import BatchTask, TaskOutcome, UnfinishedError, run_batch, run_task
from planner.errors import InfeasibleError, InputError, SolverError


def task(key, *arguments, work=str):
    return BatchTask(key, f"label {key}", work, lambda: arguments)


class Scripted:
    """A pool without processes: every task that is handed out meets what the script says, in the order of the script."""

    def __init__(self, script=(), *, width=2, lost_after=None, reverse=False):
        self.script, self.width, self.lost_after, self.reverse = list(script), width, lost_after, reverse
        self.handed, self.most, self.stopped = [], 0, False
        self.open = []

    def submit(self, key, function, *arguments):
        self.handed.append(key)
        future = Future()
        self.open.append((future, function, arguments))
        self.most = max(self.most, len(self.open))
        if len(self.open) == self.width or len(self.handed) >= len(self.script):
            self.answer()
        return future

    def answer(self):
        for future, function, arguments in self.open[:: -1 if self.reverse else 1]:
            what = self.script.pop(0) if self.script else None
            if what == "cancel":
                future.cancel()
                future.set_running_or_notify_cancel()
            elif what is None:
                future.set_result(function(*arguments))
            elif what != "never":
                future.set_exception(what)
        self.open = []

    def room(self):
        return self.width

    def lost(self):
        return "the pool is gone" if self.lost_after is not None and len(self.handed) >= self.lost_after else ""

    def explained(self, error):
        texts = {BrokenExecutor: "it died twice", CancelledError: "it was let go twice"}
        return texts.get(type(error), "")

    def stop(self):
        self.stopped = True


class TestOutcomes:
    @pytest.mark.parametrize("reverse", [False, True])
    def test_stand_in_the_order_of_the_tasks_whoever_is_first(self, reverse):
        found = run_batch([task(key, k) for k, key in enumerate("cab")], Scripted(width=3, reverse=reverse))
        assert [(key, outcome.value) for key, outcome in found.outcomes.items()] == [("c", "0"), ("a", "1"), ("b", "2")]
        assert not found.interrupted

    def test_of_no_task_there_is_none(self):
        assert run_batch([], Scripted()).outcomes == {}

    def test_two_tasks_of_one_key_are_refused(self):
        with pytest.raises(InputError, match='"a" is that of two tasks'):
            run_batch([task("a"), task("a")], Scripted())

    def test_no_more_are_handed_out_than_there_is_room_for(self):
        pool = Scripted([None] * 9, width=3)
        assert len(run_batch([task(str(k), k) for k in range(9)], pool).outcomes) == 9
        assert pool.most == 3

    def test_arguments_are_made_when_it_is_the_tasks_turn(self):
        made = []
        pool = Scripted([None] * 4, width=1)
        tasks = [
            BatchTask(str(k), "", str, lambda k=k: (made.append((k, len(pool.handed))), (k,))[1]) for k in range(4)
        ]
        run_batch(tasks, pool)
        assert made == [(0, 0), (1, 1), (2, 2), (3, 3)]


class TestErrors:
    def test_arguments_that_cannot_be_made_are_the_outcome(self):
        def unreadable():
            raise InputError("part.ngc: cannot be read")

        pool = Scripted([None, None])
        found = run_batch([task("a", 1), BatchTask("b", "", str, unreadable), task("c", 3)], pool).outcomes
        assert [str(found["b"].error), found["a"].value, found["c"].value] == ["part.ngc: cannot be read", "1", "3"]
        assert pool.handed == ["a", "c"]

    @pytest.mark.parametrize(
        ("error", "kind", "text"),
        [
            (InfeasibleError("no plan"), InfeasibleError, "no plan"),
            (MemoryError(), SolverError, "memory of this machine"),
            (KeyError("x"), SolverError, r"unexpected KeyError: 'x'; please report it"),
        ],
    )
    def test_of_one_task_stays_with_it(self, error, kind, text):
        found = run_batch([task("a", 1), task("b", 2), task("c", 3)], Scripted([None, error, None])).outcomes
        assert (found["a"].value, found["c"].value) == ("1", "3")
        assert type(found["b"].error) is kind
        with pytest.raises(kind, match=text):
            raise found["b"].error

    def test_a_worker_of_another_version_does_nothing(self):
        with pytest.raises(InputError, match=r"the worker has feedplan .*, and the task is of feedplan 0\.0\.7"):
            run_task("0.0.7", str, 1)


class TestDeaths:
    def test_a_task_whose_process_died_is_handed_out_again_after_all_others(self):
        pool = Scripted([BrokenExecutor(), None, None, None], width=2)
        found = run_batch([task("a", 1), task("b", 2), task("c", 3)], pool).outcomes
        assert [outcome.value for outcome in found.values()] == ["1", "2", "3"]
        assert pool.handed == ["a", "b", "c", "a"]

    def test_tasks_that_are_tried_again_are_alone(self):
        """Each of two dies beside the other; tried again one dies, and the other is done."""
        alone = []

        class Watched(Scripted):
            def submit(self, key, function, *arguments):
                alone.append((key, not self.open))
                if len(self.handed) >= 3:
                    self.width = 1
                return super().submit(key, function, *arguments)

            def room(self):
                return 3

        pool = Watched([BrokenExecutor(), BrokenExecutor(), None, BrokenExecutor(), None], width=3)
        found = run_batch([task("a", 1), task("b", 2), task("c", 3)], pool).outcomes
        assert alone == [("a", True), ("b", False), ("c", False), ("a", True), ("b", True)]
        assert str(found["a"].error) == "it died twice"
        assert (found["b"].value, found["c"].value) == ("2", "3")

    def test_a_second_death_is_the_outcome(self):
        pool = Scripted([BrokenExecutor(), None, None, BrokenExecutor()], width=2)
        found = run_batch([task("a", 1), task("b", 2), task("c", 3)], pool).outcomes
        assert isinstance(found["a"].error, UnfinishedError)
        assert str(found["a"].error) == "it died twice"
        assert pool.handed == ["a", "b", "c", "a"]

    def test_a_task_that_was_let_go_is_handed_out_again(self):
        pool = Scripted(["cancel", None, None], width=1)
        found = run_batch([task("a", 1), task("b", 2)], pool).outcomes
        assert [outcome.value for outcome in found.values()] == ["1", "2"]
        again = run_batch([task("a", 1)], Scripted(["cancel", "cancel"], width=1)).outcomes
        assert str(again["a"].error) == "it was let go twice"

    def test_a_pool_that_is_lost_leaves_what_is_done(self):
        pool = Scripted([None, "cancel"], width=2, lost_after=2)
        found = run_batch([task("a", 1), task("b", 2), task("c", 3)], pool).outcomes
        assert found["a"] == TaskOutcome("1")
        assert [str(found[key].error) for key in "bc"] == ["the pool is gone"] * 2
        assert pool.handed == ["a", "b"]
        assert pool.stopped


class TestInterrupt:
    @pytest.mark.parametrize("at", ["a", "b", "c"])
    def test_keeps_what_is_done_and_says_of_the_rest_why_not(self, at):
        class Interrupted(Scripted):
            def submit(self, key, function, *arguments):
                if key == at:
                    raise KeyboardInterrupt
                return super().submit(key, function, *arguments)

        pool = Interrupted([None] * 3, width=1)
        found = run_batch([task(key, key) for key in "abc"], pool)
        done = "abc"[: "abc".index(at)]
        assert found.interrupted
        assert pool.stopped
        assert [found.outcomes[key].value for key in "abc"] == [key if key in done else None for key in "abc"]
        assert {str(o.error) for o in found.outcomes.values() if o.error} == {"interrupted before it was done"}


def test_progress_counts_what_is_done_and_names_what_is_in_work():
    said = []
    run_batch(
        [task(str(k), k) for k in range(5)],
        Scripted([None] * 5, width=5),
        lambda text, share=None: said.append((text, share)),
    )
    assert said == [("0 of 5 done; in work: label 0, label 1, label 2 and 2 more", 0.0)]
