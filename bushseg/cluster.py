"""A Dask cluster that runs already, over a folder which this machine and all its workers share.

Nothing listens here: the scheduler is called, and answers. What travels are the names of two
functions of bushseg, and JSON. Dask unpickles what its scheduler says, so one of another machine
must prove by TLS who it is.
"""

import json
import logging
import secrets
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from ipaddress import ip_address
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bushseg.cache import FORMAT_VERSION
from bushseg.cluster_jobs import DONE, look, run_once
from bushseg.errors import ConfigError, WorkerError
from bushseg.files import atomic_path
from bushseg.jobs import Outcome

_PATIENCE = 60.0
"""Seconds without any worker, or without the scheduler, after which the work is given up."""

_CONNECT = 20.0  # seconds
_LOOK = 5.0  # seconds between two looks at whether there still are workers
_TICK = 0.05  # seconds between two looks at whether a job has ended


@contextmanager
def connected(address: str, *, insecure: bool = False) -> Iterator["Cluster"]:
    """Connect to a scheduler, for as long as the block takes.

    Args:
        address: `tcp://host:port` or `tls://host:port`; the certificates for the latter are those
            of Dask's own settings (`distributed.comm.tls`).
        insecure: Whether another machine's may be called without TLS.

    Raises:
        ConfigError: The address isn't one that may be used.
        WorkerError: Dask isn't installed, or nobody answers there.
    """
    check_address(address, insecure=insecure)
    if find_spec("distributed") is None:
        raise WorkerError(
            f"{address}: needs Dask, which isn't installed; run `pip install 'bushseg[cluster]'`"
        )
    from distributed import Client
    from distributed.security import Security

    is_tls = address.startswith("tls:")
    security = Security(require_encryption=is_tls or None)
    if is_tls and security.get_connection_args("client").get("ssl_context") is None:
        raise WorkerError(
            f"{address}: Dask's settings name no certificates; set distributed.comm.tls.ca-file, "
            "and client.cert and client.key beside it"
        )
    with _quiet():
        try:
            client = Client(
                address,
                timeout=_CONNECT,
                security=security,
                set_as_default=False,
                direct_to_workers=False,
            )
        except (OSError, TimeoutError, RuntimeError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise WorkerError(
                f"{address}: no Dask scheduler can be called there ({reason}); start one by `dask "
                "scheduler`, or name the address that it prints"
            ) from error
        try:
            yield Cluster(client, address)
        finally:
            with suppress(Exception):  # whatever it says now, the work is over
                client.close(timeout=2)


def check_address(address: str, *, insecure: bool) -> None:
    """Refuse a scheduler's address that isn't one, or that anybody could answer at.

    Raises:
        ConfigError: It says what an address may be.
    """
    try:
        parts = urlsplit(address)
        is_one = parts.scheme in ("tcp", "tls") and bool(parts.hostname) and parts.port is not None
        is_one = is_one and not (parts.path or parts.query or parts.fragment)
    except ValueError:
        is_one = False
    if not is_one:
        raise ConfigError(
            f"scheduler is {address!r}; expected an address such as tcp://127.0.0.1:8786 or "
            "tls://host:8786"
        )
    if parts.scheme == "tls" or insecure or _is_loopback(parts.hostname or ""):
        return
    raise ConfigError(
        f"scheduler is {address}, another machine without tls: whoever answers there could run "
        "anything here; use tls://, or --insecure-scheduler in a network that you trust"
    )


class Cluster:
    """A :class:`bushseg.jobs.Scheduler` of Dask's workers.

    Args:
        client: Connected.
        address: The scheduler's, for messages.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._is_stopped = False

    @property
    def size(self) -> int:
        """How many workers there are; each does one job at a time, on all its threads."""
        with suppress(OSError, TimeoutError):
            return len(self._client.nthreads())
        return 0

    def check(self, folder: Path) -> None:
        """As :meth:`bushseg.jobs.Scheduler.check`: every worker looks, and writes, into it."""
        token, note = secrets.token_hex(), folder / f"check-{secrets.token_hex(4)}"
        with atomic_path(note) as partial:
            partial.write_text(token, encoding="utf-8")
        try:
            deadline = time.monotonic() + _PATIENCE
            while not (said := self._ask_all(look, str(note.absolute()), token, FORMAT_VERSION)):
                if time.monotonic() > deadline:
                    raise WorkerError(
                        f"{self._address}: the scheduler has no workers; start some by `dask "
                        f"worker {self._address}`"
                    )
                time.sleep(_TICK)
        finally:
            with suppress(OSError):
                note.unlink(missing_ok=True)
        for worker, answer in said.items():
            if isinstance(answer, BaseException):
                answer = f"can't run bushseg ({type(answer).__name__}: {answer}); install it"
            if answer is not None:
                raise WorkerError(f"Dask worker {worker} {answer}")

    def _ask_all(self, function: Callable[..., Any], *arguments: object) -> dict[str, Any]:
        """What a function comes to on each worker; those that are just lost are left out."""
        try:
            said = self._client.run(function, *arguments, on_error="return")
        except (OSError, TimeoutError) as error:
            raise WorkerError(f"{self._address}: the scheduler doesn't answer ({error})") from error
        return {key: value for key, value in said.items() if not isinstance(value, OSError)}

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        """As :meth:`bushseg.jobs.Scheduler.run`.

        Dask does a task again whose worker died, on as many workers as its own settings say. A file
        beside the results marks what was begun, so that it is begun once.
        """
        token, self._is_stopped = secrets.token_hex(4), False
        known = {}
        try:
            for number, arguments in jobs.items():
                mark = Path(arguments["folder"]) / f"begun-{token}-{number}"
                future = self._client.submit(
                    run_once,
                    str(mark),
                    name,
                    json.dumps(arguments),
                    key=f"bushseg-{token}-{number}",
                    pure=False,
                )
                known[future] = number, mark
            for future in self._completed(list(known)):
                number, mark = known[future]
                yield number, self._outcome(future, mark)
                if self._is_stopped:
                    break
        finally:
            with suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(known))

    def stop(self) -> None:
        """As :meth:`bushseg.jobs.Scheduler.stop`: what was begun, nobody waits for."""
        self._is_stopped = True

    def end_idle(self) -> None:
        """Nothing to do: what idles belongs to others."""

    def _completed(self, pending: list[Any]) -> Iterator[Any]:
        """Futures as they end."""
        from distributed import as_completed

        completed = as_completed(pending, loop=self._client.loop)
        seen = looked = time.monotonic()
        while not completed.is_empty():
            for future in completed.next_batch(block=False):
                yield future
                seen = looked = time.monotonic()
            if time.monotonic() - looked > _LOOK:
                looked = time.monotonic()
                if self._has_workers():
                    seen = looked
                elif looked - seen > _PATIENCE:
                    raise WorkerError(
                        f"{self._address}: has had no workers for {_PATIENCE:.0f} s; what is done "
                        "is kept: start some, then the same command again"
                    )
            time.sleep(_TICK)

    def _has_workers(self) -> bool:
        return self._client.status == "running" and self.size > 0

    def _outcome(self, future: Any, mark: Path) -> Outcome:
        """What became of a task that ended, by its mark: Dask's result is lost with its worker."""
        if future.status == "cancelled":
            raise WorkerError(
                f"{self._address}: the scheduler has gone, or dropped the jobs; what is done is "
                "kept: start the same command again"
            )
        if future.status == "error":
            error = future.exception(timeout=_PATIENCE)
            return Outcome(death=f"{type(error).__name__}: {error}".splitlines()[0])
        try:
            said = mark.read_text(encoding="utf-8")
        except OSError as error:
            return Outcome(error=f"{mark}: can't be read ({error.strerror or error})")
        if not said:
            return Outcome(death="its Dask worker was lost")
        return Outcome(error=None if said == DONE else said)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's own remarks on lost connections from standard error: ours say what is to do."""
    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)
