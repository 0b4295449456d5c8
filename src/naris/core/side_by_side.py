"""Long jobs, several at a time, each in a process of its own: when one is to stop, all stop and keep what they have."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from queue import Empty
from typing import NamedTuple, TypeAlias, TypeVar

from naris.core.progress import Advance, Progress

_POLL_S = 0.2


class _Message(NamedTuple):
    """What a worker tells of a task: that it begins (`steps` in all), goes on, or ends."""

    task: tuple[int, str]  # the number of the job, and the name of the task
    word: str
    steps: int


_Result = TypeVar("_Result")
_Inbox: TypeAlias = "Queue[_Message]"
_inbox: _Inbox | None = None
_stop: Event | None = None
_alone = threading.Event()
_at_work = threading.Lock()


def side_by_side(jobs: Sequence[Callable[[Progress], _Result]], workers: int, progress: Progress) -> list[_Result]:
    """What the jobs return, in their order.

    On Ctrl-C every job that has begun is interrupted where it next tells of a step, no other begins, and
    KeyboardInterrupt is raised; so it is with those beside a job that fails, and with those whose parent was killed.
    A job that minds SIGINT itself, as a training does, gets the signal there and ends as it likes; another gets
    KeyboardInterrupt.

    Args:
        jobs: each can be pickled, and tells its steps to what it is called with.
        workers: processes.
        progress: of all, with the names that the jobs give their tasks.
    """
    context = multiprocessing.get_context("spawn")
    inbox: _Inbox = context.Queue()
    stop = context.Event()
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_attach, initargs=(inbox, stop))
    with ExitStack() as tasks:
        try:
            with _no_interrupts():
                running = [pool.submit(_one, number, job) for number, job in enumerate(jobs)]
            _relay(inbox, running, progress, tasks)
            return [one.result() for one in running]
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back; processes that start inside hold it back until `_attach` (where the system can: POSIX)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attach(inbox: _Inbox, stop: Event) -> None:
    """Make ready the process of a worker; the only way to hand a queue to the processes of a pool."""
    global _inbox, _stop
    _inbox, _stop = inbox, stop
    inbox.cancel_join_thread()  # nobody reads what is told after an interruption: the end must not wait for it
    # A terminal sends Ctrl-C to the workers too. A training minds it; whoever does not leaves it to `_stop`.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed stops nobody: its workers would go on for hours, and then wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        _alone.set()
        with _at_work:  # a job that goes on keeps what it has first
            os._exit(1)


def _stopped() -> bool:
    return _alone.is_set() or (_stop is not None and _stop.is_set())


def _one(number: int, job: Callable[[Progress], _Result]) -> _Result:
    with _at_work:
        if _stopped():
            raise KeyboardInterrupt
        return job(_Remote(number))


class _Remote:
    """Progress that is told to the process that waits."""

    def __init__(self, number: int) -> None:
        self.number = number

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[Advance]:
        def tell(word: str, steps: int) -> None:
            if _inbox is not None:
                _inbox.put(_Message((self.number, name), word, steps))

        def advance(steps: int) -> None:
            tell("advance", steps)
            if not _stopped():
                return
            if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
                raise KeyboardInterrupt
            signal.raise_signal(signal.SIGINT)  # whoever minds it ends as it likes: a training writes its state

        tell("start", total)
        yield advance
        tell("end", 0)


def _relay(inbox: _Inbox, jobs: Sequence[Future[_Result]], progress: Progress, tasks: ExitStack) -> None:
    """Tell what the workers tell until all have ended; the error of the first that fails is raised at once."""
    open_tasks: dict[tuple[int, str], tuple[ExitStack, Advance]] = {}
    checked = time.monotonic()
    while True:
        try:
            message = inbox.get(timeout=_POLL_S)
        except Empty:
            message = None
        if message is None or time.monotonic() - checked > _POLL_S:
            checked = time.monotonic()
            done, running = wait(jobs, timeout=0)
            for one in done:
                one.result()
            if not running and message is None:
                return
        if message is None:
            continue
        if message.word == "start":
            opened = tasks.enter_context(ExitStack())
            advance = opened.enter_context(progress.task(message.task[1], message.steps))
            open_tasks[message.task] = opened, advance
        elif message.task in open_tasks and message.word == "advance":
            open_tasks[message.task][1](message.steps)
        elif message.task in open_tasks:
            open_tasks.pop(message.task)[0].close()
