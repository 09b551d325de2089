"""A worker process: `python -m bushseg.worker`.

Reads a job a line, [name, arguments, cores] as JSON, and answers each in a line: null, or why it
was refused. It says "ready" first, and whenever it reads null instead of a job; it ends when nobody
can give it jobs any more.
"""

import json
import os
import queue
import sys
import threading
from typing import Any

READY = "ready"


def main() -> None:
    """Work until standard input ends."""
    # What a library prints must not be taken for an answer.
    answers = os.dup(1)
    os.dup2(2, 1)
    jobs: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(jobs,), daemon=True).start()

    from bushseg.jobs import load_job, run_job
    from bushseg.parallel import use_cores

    answer: str | None = READY
    while True:
        os.write(answers, json.dumps(answer).encode() + b"\n")
        if (job := jobs.get()) is None:
            answer = READY
            continue
        name, arguments, cores = job
        use_cores(cores)
        load_job(name)
        if (torch := sys.modules.get("torch")) is not None:  # not all jobs need it, it takes memory
            torch.set_num_threads(cores)
        answer = run_job(name, arguments)


def _listen(jobs: "queue.SimpleQueue[Any]") -> None:
    """Pass jobs on. Whoever gives them may be killed: then this process ends amid its work."""
    for line in sys.stdin.buffer:
        jobs.put(json.loads(line))
    os._exit(0)


if __name__ == "__main__":
    main()
