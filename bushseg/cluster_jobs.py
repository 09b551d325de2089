"""What Dask's workers do for :mod:`bushseg.cluster`."""

import json
import tempfile
from pathlib import Path

from bushseg.cache import FORMAT_VERSION
from bushseg.jobs import one_at_a_time, run_job
from bushseg.parallel import use_cores

DONE = "done"


def look(path: str, token: str, version: int) -> str | None:
    """Whether a worker sees a file of a shared folder and may write beside it; done by workers.

    Args:
        path: The file.
        token: What it holds.
        version: The format version of whoever asks.

    Returns:
        None, or what is wrong, one line.
    """
    if version != FORMAT_VERSION:
        return f"has another version of bushseg (format {FORMAT_VERSION}, here {version})"
    folder = Path(path).parent
    remedy = (
        "name a --scratch folder, or for many scans or a data set an output folder, that this "
        "machine and all workers share"
    )
    try:
        found = Path(path).read_text(encoding="utf-8")
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        return f"doesn't see {folder}, or can't write there ({error.strerror or error}); {remedy}"
    return None if found == token else f"sees another folder as {folder}; {remedy}"


def run_once(mark: str, name: str, arguments: str) -> None:
    """Do a job unless it was begun before; done by workers.

    Args:
        mark: A file that is made when the job begins. When it ends, "done" or why it was refused is
            written there: one that stays empty tells of a worker that was lost.
        name: Which job.
        arguments: Its arguments, JSON.
    """
    from distributed import get_worker

    with one_at_a_time:  # a job that waits for another hasn't begun
        use_cores(get_worker().state.nthreads)
        try:
            with Path(mark).open("x"):
                pass
        except FileExistsError:
            return
        refusal = run_job(name, json.loads(arguments))
        Path(mark).write_text(DONE if refusal is None else refusal, encoding="utf-8")
