"""Jobs by their names."""

import errno
import inspect
import sys
from importlib import import_module

import pytest

from bushseg import jobs
from bushseg.errors import WriteError
from bushseg.jobs import JOBS, run_job


def work(deed: str) -> None:
    if deed == "refuse":
        raise WriteError("out.las: exists already")
    if deed == "full":
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise WriteError("out.las: can't be written") from error
    if deed == "unreadable":
        raise PermissionError(errno.EACCES, "Permission denied", "x.las")
    if deed == "crash":
        raise ZeroDivisionError


@pytest.mark.parametrize("name", JOBS)
def test_every_job_has_its_function(name: str) -> None:
    module, _, function = JOBS[name].partition(":")
    assert inspect.isfunction(getattr(import_module(module), function))


def test_what_becomes_of_a_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stand_in", sys.modules[__name__])
    monkeypatch.setitem(jobs.JOBS, "work", "stand_in:work")
    assert run_job("work", {"deed": ""}) is None
    assert run_job("work", {"deed": "refuse"}) == "out.las: exists already"
    assert (
        run_job("work", {"deed": "full"}) == "out.las: can't be written (No space left on device)"
    )
    said = run_job("work", {"deed": "unreadable"})
    assert said == "[Errno 13] Permission denied: 'x.las'; check the disk and its permissions"
    with pytest.raises(ZeroDivisionError):
        run_job("work", {"deed": "crash"})
    with pytest.raises(KeyError):
        run_job("stand_in:work", {"deed": ""})
