"""The view's server: on the loopback address alone, and only for who has the token in the address."""

import gzip
import hmac
import json
import secrets
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.explore.counts import FlightTable, count_flights, find_nearest, parse_asked
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.io.input_error import InputError
from abhv_mc.simulators.engine import Engine
from abhv_mc.topics.plain import plain
from abhv_mc.user_code.run_in_thread import run_in_thread

_HOST = "127.0.0.1"
_MOST_BYTES = 100_000  # of a request
_MOST_TIMES = 1000  # of a history that is drawn
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src data: blob:; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
_PAGES = {
    "/": ("explore", "explore.html", "text/html"),
    "/explore.js": ("explore", "explore.js", "text/javascript"),
    "/plotly.js": ("report/pages/template", "plotly-basic.min.js.gz", "text/javascript"),
    "/style.css": ("report/pages/template", "style.css", "text/css"),
}


class ExploreServer(ThreadingHTTPServer):
    """Serves one campaign; :attr:`url` opens it."""

    daemon_threads = True

    def __init__(self, root: Path, table: FlightTable, engine: Engine, port: int = 0, trust_code: bool = False) -> None:
        super().__init__((_HOST, port), _Handler)
        self.root, self.table, self.engine, self.trust_code = root, table, engine, trust_code
        self.token = secrets.token_urlsafe(24)
        self.one_flight = threading.Lock()  # at a time

    @property
    def url(self) -> str:
        """The address with its token."""
        return f"http://{_HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle of a reply is none."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    def replay(self, controller: str, flight: int) -> dict[str, Any]:
        """A flight flown again, as ``abhv-mc replay`` does: by the trust list, and compared with the stored one."""
        with self.one_flight:
            again = run_in_thread(
                lambda: replay_flight(self.root, controller, flight, self.engine.fly, trust_code=self.trust_code)
            )
        every = max(1, -(-again.block.times.size // _MOST_TIMES))
        history = again.block.history[0, ::every]
        return {
            "controller": controller,
            "flight": flight,
            "sentence": again.sentence,
            "same": not again.differences,
            "time": again.block.times[::every],
            "channels": {
                channel.name: {"unit": channel.unit.removeprefix("-"), "values": history[:, i].astype(float)}
                for i, channel in enumerate(CHANNELS)
            },
        }


class _Handler(BaseHTTPRequestHandler):
    server: ExploreServer

    def do_GET(self) -> None:
        place = urlsplit(self.path)
        if not self._admitted(place.query):
            return
        if place.path == "/view":
            self._send_json(self.server.table.view)
        elif place.path in _PAGES:
            folder, name, kind = _PAGES[place.path]
            content = files("abhv_mc").joinpath(folder, name).read_bytes()
            if name.endswith(".gz"):
                content = gzip.decompress(content)
            if name.endswith(".html"):
                content = content.replace(b"TOKEN", self.server.token.encode())
            self._send(content, f"{kind}; charset=utf-8")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        place = urlsplit(self.path)
        if not self._admitted(place.query):
            return
        try:
            length = int(self.headers.get("Content-Length", "0"))
            if not 0 < length <= _MOST_BYTES:
                raise InputError("request", f"{length} bytes", f"1 to {_MOST_BYTES}")
            data = json.loads(self.rfile.read(length))
            if place.path == "/counts":
                self._send_json(count_flights(self.server.table, parse_asked(data, self.server.table)))
            elif place.path == "/nearest":
                asked = parse_asked(data, self.server.table)
                self._send_json(find_nearest(self.server.table, asked, *map(float, data["at"])))
            elif place.path == "/flight":
                self._send_json(self.server.replay(str(data["controller"]), int(data["flight"])))
            else:
                self._refuse(HTTPStatus.NOT_FOUND, "no such question")
        except (InputError, ValueError, KeyError, TypeError, RecursionError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))

    def _admitted(self, query: str) -> bool:
        """Whether the request has the token, and names this server: a page from elsewhere has neither."""
        token = parse_qs(query).get("token", [""])[0]
        host = self.headers.get("Host", "")
        if host == f"{_HOST}:{self.server.server_port}" and hmac.compare_digest(
            token.encode(), self.server.token.encode()
        ):
            return True
        self._refuse(HTTPStatus.FORBIDDEN, "open the address that abhv-mc explore printed")
        return False

    def _send_json(self, value: Any) -> None:
        self._send(json.dumps(plain(value), allow_nan=False).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, words: str) -> None:
        self._send(json.dumps({"error": words}).encode(), "application/json", status)

    def _send(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(content))),
            ("Content-Security-Policy", _POLICY),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cache-Control", "no-store"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Nothing: requests would fill the terminal, with the token in each line."""
