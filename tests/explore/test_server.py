"""The explorer's server: who is answered, and a flight flown again."""

import csv
import http.client
import json
from urllib.parse import quote


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
    order = {"fit": False, "sort": "rank", "down": False}
    return {"x": view["x"], "y": view["y"], "controllers": ["one", "two"], "outcome": "all", "brushes": {}, **order}


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
    assert near == [k, flight]
    flown = json.loads(ask(server, "/flight", {"controller": ("one", "two")[k], "flight": flight})[1])
    history = flown["history"]
    assert "equal" in flown["note"] and len(history["time"]) == 21 == len(history["channels"]["altitude_m"])


def test_what_stands_behind_a_flight_are_the_bands_of_its_controller(server):
    found = json.loads(ask(server, "/behind", {"controller": "two", "channel": "altitude_m"})[1])
    envelope = server.table.results.envelopes["two", "altitude_m"]
    assert found["time"] == envelope.time.tolist() and found["q5"] == envelope.bands["q5"].tolist()
    assert len(found["nominal"]) == len(found["time"])


def test_the_chosen_flights_are_saved_as_csv(server):
    connection = http.client.HTTPConnection(*server.server_address)
    wanted = {**asked(server), "controllers": ["two"], "sort": "flight", "down": True}
    connection.request("GET", f"/csv?token={server.token}&asked={quote(json.dumps(wanted))}")
    reply = connection.getresponse()
    rows = list(csv.DictReader(reply.read().decode().splitlines()))
    connection.close()
    assert [row["flight"] for row in rows] == [str(k) for k in range(99, -1, -1)]
    values = server.table.results.flights["two"].metrics["altitude_error_max_m"]
    assert float(rows[0]["altitude_error_max_m [m]"]) == values[99]
    assert ask(server, "/csv")[0] == 400
