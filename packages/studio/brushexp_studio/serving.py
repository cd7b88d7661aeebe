"""Serve pages to browsers on this machine only."""

import logging
import time
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import unquote

from brushexp.contracts import UserError
from brushexp.contracts.files import check_file

log = logging.getLogger(__name__)
HOST = "127.0.0.1"  # no other machine can connect
LARGEST_PAGE = 2**28  # bytes
HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",  # pages may be rewritten
    "X-Frame-Options": "DENY",
    # An untrusted page may run its own scripts, which can reach neither other pages here nor the network.
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; base-uri 'none'; form-action 'none'",
}
TIMEOUT_SECONDS = 10  # seconds of silence after which a connection is closed


@contextmanager
def serve(pages: Mapping[str, Path], port: int = 0) -> Iterator[str]:
    """Serve files within the ``with`` block, and yield the address of the page at ``/``.

    ``pages`` maps URL paths to files, which are read anew at each request. Port 0 means any free port. Raises UserError
    if the port is not available.
    """
    try:
        server = _Server((HOST, port), _Handler)
    except OSError as error:
        raise port_error(port, error) from error
    server.pages = pages
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def port_error(port: int, error: OSError) -> UserError:
    """Return the UserError for a port that is not available."""
    reason = f"port={port} is not available ({error.strerror})"
    return UserError(f"{reason}; choose another port, or port=0 for any free port")


def show_until_interrupted(address: str, *, in_browser: bool) -> None:
    """Open the address in a browser if requested, and wait for Ctrl-C."""
    try:
        if in_browser and not webbrowser.open(address):
            log.info("no browser could be started; open %s yourself", address)
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        return


class _Server(ThreadingHTTPServer):
    pages: Mapping[str, Path]

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("a browser closed its connection", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "brushexp", ""
    timeout = TIMEOUT_SECONDS

    def do_GET(self) -> None:
        port = self.server.server_port
        if self.headers.get("Host") not in {f"{HOST}:{port}", f"localhost:{port}"}:
            # A page from the network whose name resolves to this machine (DNS rebinding) must not read anything.
            self.send_error(HTTPStatus.FORBIDDEN, "open this page by its address")
            return
        page = self.server.pages.get(unquote(self.path.partition("?")[0], errors="surrogateescape"))
        try:
            if page is None or page.is_symlink():  # a link may lead out of the served folder
                raise UserError("it is not one of the pages")
            check_file(page, "", LARGEST_PAGE)
            body = page.read_bytes()
        except (UserError, OSError):
            self.send_error(HTTPStatus.NOT_FOUND, "no such page exists here")
            return
        self.send_response(HTTPStatus.OK)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        log.debug(format, *args)
