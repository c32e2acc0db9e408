"""The explorer's server: who is answered, and a flight flown again."""

import http.client
import json

import pytest
from explore.served import serve


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serve(tmp_path_factory.mktemp("explore")) as served:
        yield served


def ask(server, place, data=None, token=None, host=None):
    connection = http.client.HTTPConnection(*server.server_address)
    token = server.token if token is None else token
    body = None if data is None else json.dumps(data)
    headers = {} if host is None else {"Host": host}
    connection.request("GET" if data is None else "POST", f"{place}?token={token}", body, headers)
    reply = connection.getresponse()
    content = reply.read()
    connection.close()
    return reply.status, content


def asked(server):
    view = json.loads(ask(server, "/view")[1])
    return {"x": view["x"], "y": view["y"], "controllers": ["one", "two"], "outcome": "all", "brushes": {}}


def test_only_this_machine_and_only_with_the_token_is_answered(server):
    assert server.server_address[0] == "127.0.0.1" and len(server.token) >= 32
    for place, data in (("/", None), ("/view", None), ("/plotly.js", None), ("/counts", {}), ("/flight", {})):
        for wrong in ({"token": ""}, {"token": server.token[:-1]}, {"host": "example.org"}):
            assert ask(server, place, data, **wrong)[0] == 403
    assert ask(server, "/")[0] == 200 and server.token.encode() in ask(server, "/")[1]
    assert ask(server, "/../manifest.json")[0] == 404


def test_flights_are_counted_and_the_nearest_is_flown_again(server):
    status, content = ask(server, "/counts", asked(server))
    found = json.loads(content)
    assert status == 200 and found["count"] == 200 == len(found["points"])
    k, x, y, flight, _ = found["points"][30]
    near = json.loads(ask(server, "/nearest", {**asked(server), "at": [x, y]})[1])
    assert near == [("one", "two")[k], flight]
    flown = json.loads(ask(server, "/flight", {"controller": near[0], "flight": flight})[1])
    assert flown["same"] and len(flown["time"]) == 21 == len(flown["channels"]["altitude_m"]["values"])
