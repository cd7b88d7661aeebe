"""Pages for a browser on this machine: these files, and nothing else."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import unquote

from brushexp.errors import UserError

log = logging.getLogger(__name__)
HOST = "127.0.0.1"  # nobody else can connect
TIMEOUT_SECONDS = 10  # that a silent connection may take
HEADERS = {
    "Cache-Control": "no-store",  # the page may be made anew
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
}
PORT_CURES = {
    errno.EADDRINUSE: "is taken by another program; choose another port, or port=0 for any that is free",
    errno.EACCES: "may not be used by you; choose a port from 1024, or port=0 for any that is free",
}


@contextmanager
def served(pages: Mapping[str, Path], port: int = 0) -> Iterator[str]:
    """Serve pages while the context lasts.

    Args:
        pages: path of the address, ``/`` for the first page -> file, read whenever it is asked for.
        port: of this machine, up to 65535; 0 for any that is free.

    Yields:
        the address of the first page.

    Raises:
        UserError: if the port cannot be had.
    """
    try:
        server = _Server((HOST, port), _Handler)
    except OSError as error:
        reason = PORT_CURES.get(error.errno or 0, f"cannot be had ({error.strerror}); choose another one")
        raise UserError(f"port={port} {reason}") from error
    server.pages = pages
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    """Knows its pages."""

    pages: Mapping[str, Path]
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("a browser went away", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET and HEAD of the pages."""

    server: _Server
    server_version, sys_version = "brushexp", ""
    timeout = TIMEOUT_SECONDS

    def do_GET(self) -> None:
        port = self.server.server_port
        if self.headers.get("Host") not in {f"{HOST}:{port}", f"localhost:{port}"}:
            # A page from the network whose name was made to mean this machine (DNS rebinding) must not read anything.
            return self._answer(HTTPStatus.FORBIDDEN, b"ask for this page by its address\n", "text/plain")
        page = self.server.pages.get(unquote(self.path.partition("?")[0], errors="surrogateescape"))
        if page is None or not page.is_file():
            return self._answer(HTTPStatus.NOT_FOUND, b"there is no such page here\n", "text/plain")
        return self._answer(HTTPStatus.OK, page.read_bytes(), "text/html")

    do_HEAD = do_GET

    def _answer(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self.send_response(status)
        headers = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body))}
        for name, value in (headers | HEADERS).items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        log.debug(format, *args)
