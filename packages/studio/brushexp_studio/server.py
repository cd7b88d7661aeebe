"""Serve the studio's page, pictures and files to this machine only, and receive uploads from the browser."""

import socket
import time
import warnings
from asyncio import get_running_loop
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Thread
from typing import Any
from urllib.parse import quote, unquote

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, Response
from starlette.datastructures import Headers
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from brushexp.contracts import UserError
from brushexp_studio.drafts import Drafts
from brushexp_studio.photos import LARGEST_UPLOAD, Photos
from brushexp_studio.serving import HOST, port_error
from brushexp_studio.tab import add_page
from brushexp_studio.works import Works

LOOKS = Path(__file__).parent / "looks"  # samples written by docs/site/look_samples.py
NAMES = [HOST, "localhost", "[::1]"]  # accepted names of this machine; foreign pages may use another name for it
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
GUARDS = [
    (b"content-security-policy", POLICY.encode()), (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
]  # fmt: skip
FOREVER = {"Cache-Control": "private, max-age=3600, immutable"}  # the picture at an address never changes
READER = ThreadPoolExecutor(1, "reader")  # thread for uploads; each thread retains the memory of a large one


def application(photos: Photos, works: Works, drafts: Drafts) -> FastAPI:
    """Build the web application that serves pictures and files and receives uploads."""
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    @app.get("/photos/{key}/{size}.jpg")
    def photo(key: str, size: str) -> Response:
        picture = photos[key].jpeg(240 if size == "thumb" else 1280)
        return Response(picture, media_type="image/jpeg", headers=FOREVER)

    @app.get("/drafts/{key}/{look}.jpg")
    def draft(key: str, look: str) -> Response:
        return Response(drafts.pictures[key, look], media_type="image/jpeg", headers=FOREVER)

    @app.get("/masks/{name}.png")
    def mask(name: str) -> Response:
        return FileResponse(photos.masks[name], headers=FOREVER)

    @app.get("/works/{number}/{frame}.jpg")
    def frame(number: int, frame: int) -> Response:
        return Response(works[number].jpeg(frame), media_type="image/jpeg", headers=FOREVER)

    @app.get("/works/{number}/files/{name:path}")
    def file(number: int, name: str) -> Response:
        path = works[number].files[name]
        disposition = "inline" if path.suffix == ".html" else "attachment"
        filename = f"{works[number].name}-{path.name}"
        return FileResponse(path, filename=filename, content_disposition_type=disposition)

    @app.get("/works/{number}/made/{form}")
    def send_download(number: int, form: str) -> Response:
        work = works[number]
        download = work.downloads[form]
        if download.path is None:
            raise KeyError(form)
        words = [work.name, "plan" if form == "plan" else "", download.choice.label if download.choice else ""]
        return FileResponse(download.path, filename="-".join(filter(None, words)) + download.path.suffix)

    @app.get("/works/{number}/blend/{percent}.png")
    def blend(number: int, percent: int) -> Response:
        work = works[number]
        headers = {"Content-Disposition": f"attachment; filename*=utf-8''{quote(work.name)}-{percent}.png"}
        return Response(work.blend(percent), media_type="image/png", headers=headers)

    _take_uploads(app, photos)
    app.mount("/looks", StaticFiles(directory=LOOKS))
    for error in (KeyError, UserError, FileNotFoundError):
        app.add_exception_handler(error, lambda *_: Response("nothing here has this name", 404))
    app.add_middleware(OwnPages)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=NAMES, www_redirect=False)
    return app


def _take_uploads(app: FastAPI, photos: Photos) -> None:
    @app.post("/photos")
    async def upload(request: Request) -> dict[str, Any]:
        name = unquote(request.headers.get("X-Name", ""))
        return await _receive(request, lambda path: {"photo": photos.add(path, name).key})

    @app.post("/photos/{key}/masks")
    async def paint_mask(request: Request, key: str) -> dict[str, Any]:
        return await _receive(request, lambda path: {"mask": photos.add_mask(path, photos[key])})


class OwnPages:
    """Middleware that rejects requests from other sites' pages and adds security headers to all responses."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if headers.get("Origin", own := f"http://{headers.get('Host')}") != own:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})
            else:
                await Response("only pages of the studio may request this", 403)(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *GUARDS]
            await send(message)

        await self.app(scope, receive, send_guarded)


async def _receive(request: Request, use: Any) -> dict[str, Any]:
    """Pass an uploaded file to ``use`` and return the result.

    Returns an ``error`` message instead if the file cannot be used or is larger than `LARGEST_UPLOAD`.
    """
    received = 0
    try:
        with NamedTemporaryFile() as file:
            async for piece in request.stream():
                received += len(piece)
                if received > LARGEST_UPLOAD:
                    return {"error": f"this file is larger than {LARGEST_UPLOAD // 2**20} MB; make it smaller"}
                file.write(piece)
            file.flush()
            return await get_running_loop().run_in_executor(READER, use, Path(file.name))
    except (UserError, MemoryError) as error:
        return {"error": str(error) or "there is not enough memory for this picture; make it smaller"}
    except OSError as error:
        return {"error": f"the studio cannot store this file: {error.strerror}"}
    except ClientDisconnect:
        return {}


@contextmanager
def running(app: FastAPI, port: int) -> Iterator[str]:
    """Serve an application on this machine within the ``with`` block, and yield its address.

    Port 0 means any free port. Raises UserError if the port is not available.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
    except OSError as error:
        raise port_error(port, error) from error
    config = uvicorn.Config(app, log_config=None, log_level="warning", access_log=False, timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    thread = Thread(target=server.run, kwargs={"sockets": [listening]}, name="server", daemon=True)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.01)
    try:
        yield f"http://{HOST}:{listening.getsockname()[1]}/"
    finally:
        server.should_exit = True
        thread.join()
        listening.close()


@contextmanager
def open_studio(own: Path, results: Path, port: int, options: dict[str, Any]) -> Iterator[tuple[str, Works]]:
    """Run the studio within the ``with`` block, and yield its address and its paintings.

    Uploads are stored in the ``own`` folder and paintings in ``results``; ``options`` are overrides that apply to every
    painting.
    """
    warnings.filterwarnings("ignore", ".*torch.distributed.reduce_op", FutureWarning)  # NiceGUI inspects all objects
    photos, works = Photos(own), Works(results, options)
    drafts = Drafts(works)
    app = application(photos, works, drafts)
    add_page(app, photos, works, drafts)
    with running(app, port) as address:
        works.warm_up()
        try:
            yield address, works
        finally:
            drafts.close()
            works.close()
