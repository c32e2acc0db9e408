"""Server of the browser view on the loopback address, with a token in the URL."""

import gzip
import hmac
import json
import secrets
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from abhv_mc.analysis.replay import EQUAL_BITS, replay_flight
from abhv_mc.custom_code.child import run_in_thread
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.folder.flown_campaign import read_histories
from abhv_mc.interfaces import Fly
from abhv_mc.io.csv_table import csv_text
from abhv_mc.io.messages import InputError, counted
from abhv_mc.report.pages.channel_curves import band_names, channel_curves
from abhv_mc.report.pages.flights_view import SCRIPTS, STYLES, template_text
from abhv_mc.report.pages.page import make_environment
from abhv_mc.topics.formatting import json_data
from abhv_mc_explore.counts import (
    FlightTable,
    count_flights,
    find_flight,
    find_nearest,
    list_flights,
    parse_selection,
)

_HOST = "127.0.0.1"
_MOST_BYTES = 100_000  # maximum size of a request in bytes
_MOST_TIMES = 1000  # maximum number of time points in a plotted history
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "img-src data: blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)


def _page(path: str, token: str) -> tuple[str, str] | None:
    """Return the text and media type of a page, or None if the page does not exist."""
    own = files("abhv_mc_explore")
    if path == "/":
        frame = make_environment().from_string((own / "explore.html.j2").read_text("utf-8"))
        return frame.render(token=token), "text/html"
    if path == "/view.js":
        return "".join(map(template_text, SCRIPTS)) + (own / "explore.js").read_text(
            "utf-8"
        ), "text/javascript"
    if path == "/plotly.js":
        packed = files("abhv_mc") / "report/pages/template/plotly-basic.min.js.gz"
        return gzip.decompress(packed.read_bytes()).decode(), "text/javascript"
    return ("".join(map(template_text, STYLES)), "text/css") if path == "/style.css" else None


class ExploreServer(ThreadingHTTPServer):
    """HTTP server for one campaign at the address :attr:`url`."""

    daemon_threads = True

    def __init__(
        self,
        root: Path,
        table: FlightTable,
        fly: Fly | None = None,
        port: int = 0,
        trust_code: bool = False,
    ) -> None:
        super().__init__((_HOST, port), _Handler)
        self.root = root
        self.table = table
        self.fly = fly
        self.trust_code = trust_code
        self.token = secrets.token_urlsafe(24)
        self.one_flight = threading.Lock()  # only one flight is simulated at a time

    @property
    def url(self) -> str:
        """Address of the server, with the token."""
        return f"http://{_HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that disconnect during a response."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    def open_flight(self, controller: str, flight: int) -> dict[str, Any]:
        """Return the values and the time history of a flight.

        The flight is re-run as ``abhv-mc replay`` does it, subject to the trust list, and compared
        with the stored flight; if the flight cannot be re-run, the stored history is returned.
        """
        entry = find_flight(self.table, controller, flight)
        if not self.table.results.campaign.can_rerun:
            return {**entry, "note": "", "history": None}
        try:
            with self.one_flight:
                again = run_in_thread(
                    lambda: replay_flight(
                        self.root, controller, flight, self.fly, trust_code=self.trust_code
                    )
                )
        except InputError as error:
            history = read_histories(self.root, controller).get(flight, {})
            note = str(error)
        else:
            same = "differ from the stored metrics!" if again.differences else f"{EQUAL_BITS}."
            history = self._history(again.block)
            note = f"{again.sentence} Its metrics {same}"
        history = self.table.results.align(controller, history)
        curves = {"time": history.pop("time"), "channels": history} if history else None
        return {**entry, "note": note, "history": curves}

    def _history(self, block: FlightBlock) -> dict[str, Any]:
        """Return a flight's channels at a subset of its times, or {} if there is no history."""
        if not block.history.size:
            return {}
        every = max(1, -(-block.times.size // _MOST_TIMES))
        flown = block.history[0, ::every].astype(float)
        records = self.table.results.campaign.channels
        channels = {channel.name: flown[:, i] for i, channel in enumerate(records)}
        return {"time": block.times[::every], **channels}

    def behind(self, controller: str, channel: str) -> dict[str, Any]:
        """Return the envelopes and nominal flight of a channel for the background of a plot."""
        results = self.table.results
        time, curves = channel_curves(results, controller, channel)
        return {"time": time, **dict(zip((*band_names(results), "nominal"), curves, strict=True))}


class _Handler(BaseHTTPRequestHandler):
    server: ExploreServer

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        if not self._admitted(url.query):
            return
        if url.path == "/view":
            self._send_json(self.server.table.view)
        elif url.path == "/csv":
            self._send_csv(parse_qs(url.query).get("asked", [""])[0])
        elif page := _page(url.path, self.server.token):
            content, kind = page
            self._send(content.encode(), f"{kind}; charset=utf-8")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        url = urlsplit(self.path)
        if not self._admitted(url.query):
            return
        try:
            length = int(self.headers.get("Content-Length", "0"))
            if not 0 < length <= _MOST_BYTES:
                raise InputError(
                    "request", f"found {counted(length, 'byte')}", f"1 to {_MOST_BYTES} bytes"
                )
            data = json.loads(self.rfile.read(length))
            table = self.server.table
            if url.path == "/counts":
                self._send_json(count_flights(table, parse_selection(data, table)))
            elif url.path == "/nearest":
                selection = parse_selection(data, table)
                self._send_json(find_nearest(table, selection, *map(float, data["at"])))
            elif url.path == "/flight":
                self._send_json(
                    self.server.open_flight(str(data["controller"]), int(data["flight"]))
                )
            elif url.path == "/behind":
                self._send_json(self.server.behind(str(data["controller"]), str(data["channel"])))
            else:
                self._refuse(HTTPStatus.NOT_FOUND, "no such request")
        except (InputError, ValueError, KeyError, TypeError, RecursionError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))

    def _admitted(self, query: str) -> bool:
        """Return whether the request contains the token and names this server as its host.

        Requests from pages of other origins do not meet these conditions.
        """
        token = parse_qs(query).get("token", [""])[0]
        host = self.headers.get("Host", "")
        if host == f"{_HOST}:{self.server.server_port}" and hmac.compare_digest(
            token.encode(), self.server.token.encode()
        ):
            return True
        self._refuse(HTTPStatus.FORBIDDEN, "open the address that abhv-mc explore printed")
        return False

    def _send_json(self, value: Any) -> None:
        self._send(json.dumps(json_data(value), allow_nan=False).encode(), "application/json")

    def _send_csv(self, text: str) -> None:
        """Send the selected flights as CSV in parts; a million rows may not fit in memory."""
        table = self.server.table
        try:
            heads, flights = list_flights(table, parse_selection(json.loads(text), table))
        except (InputError, ValueError, RecursionError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
            return
        self._send_head(
            "text/csv; charset=utf-8", {"Content-Disposition": 'attachment; filename="flights.csv"'}
        )
        for rows in chain([[heads]], flights):
            self.wfile.write(csv_text(rows).encode())

    def _refuse(self, status: HTTPStatus, message: str) -> None:
        self._send(json.dumps({"error": message}).encode(), "application/json", status)

    def _send(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send_head(kind, {"Content-Length": str(len(content))}, status)
        self.wfile.write(content)

    def _send_head(
        self, kind: str, headers: dict[str, str], status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            **headers,
            "Content-Security-Policy": _POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
        }.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Suppress logging, because each line would show the token in the terminal."""
