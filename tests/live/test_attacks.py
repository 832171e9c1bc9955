"""The page attacked: what is not its own is refused, and the simulation goes on."""

import http.client
import json
import socket
from contextlib import ExitStack, suppress

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install '.[live]'")

from neuro.live.serving import BURST, LONGEST_MESSAGE, MOST_CLIENTS, OPEN_S
from running_page import until


@pytest.fixture(autouse=True)
def goes_on(running):
    yield
    assert running.goes_on()
    with running.client() as client:
        assert client.ask(do="speed", value=4.0) == {"id": 1}


def status(running, path, method="GET", **headers):
    connection = http.client.HTTPConnection(running.host, running.port, timeout=5.0)
    try:
        connection.request(method, path, headers=headers)
        return connection.getresponse().status
    finally:
        connection.close()


def refused(running, **words):
    """The status with which a WebSocket is refused."""
    from websockets.exceptions import InvalidStatus

    with pytest.raises(InvalidStatus) as error, running.client(**words):
        pass
    return error.value.response.status_code


def test_its_files_come_with_a_policy_that_lets_nothing_else_in(running):
    for name, kind in (("", "html"), ("page.js", "javascript"), ("page.css", "css")):
        connection = http.client.HTTPConnection(running.host, running.port, timeout=5.0)
        connection.request("GET", running.token + name)
        answer = connection.getresponse()
        text = answer.read().decode()
        assert answer.status == 200
        assert kind in answer.headers["Content-Type"]
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
        assert "innerHTML" not in text
        assert "style=" not in text
        connection.close()


OTHER_PATHS = [
    "/", "/page.js", "/socket", "{}x/", "{}serving.py", "{}../page.js", "{}%2e%2e/%2e%2e/etc/passwd",
    "{}....//....//etc/passwd", "{}//etc/passwd", "{}?", "/" + "A" * 33 + "/"
]  # fmt: skip


def test_other_paths_are_not_there(running):
    assert {path: status(running, path.format(running.token)) for path in OTHER_PATHS} == dict.fromkeys(
        OTHER_PATHS, 404
    )


def test_other_methods_and_hosts_are_refused(running):
    assert status(running, running.token, "POST") in (404, 405)
    for host in ("evil.example", f"evil.example:{running.port}", f"{running.host}:1", f"{running.host}.evil:80"):
        assert status(running, running.token, Host=host) == 403
    for host in (f"localhost:{running.port}", f"[::1]:{running.port}"):
        assert status(running, running.token, Host=host) == 200


def test_a_socket_is_for_the_page_alone(running):
    for origin in ("http://evil.example", "null", f"https://{running.host}:{running.port}", "http://127.0.0.1", None):
        assert refused(running, origin=origin) == 403
    right, running.token = running.token, "/wrong/"
    try:
        assert refused(running) == 404
    finally:
        running.token = right


def test_messages_that_are_huge_or_too_many_end_their_connection(running):
    from websockets.exceptions import ConnectionClosed

    for messages, code in ((["x" * (LONGEST_MESSAGE + 1)], 1009), (["{}"] * int(3 * BURST), 1008)):
        with running.client() as client:
            with pytest.raises(ConnectionClosed) as error:
                flood(client, messages)
            assert error.value.rcvd.code == code


def flood(client, messages):
    for message in messages:
        client.connection.send(message)
    while True:
        client.hear()


MALFORMED = [
    "", "{", "[1]", "null", b"\x00\xff", "[" * 4000, '{"do": {"a": 1}}', '{"do": ["set"]}', "\ud7ff" * 1000,
    '{"do": "__init__"}', '{"do": "answer"}', '{"do": 3}', "{}", '{"do": "seed", "value": -1}',
    '{"do": "seed", "value": 1e300}', '{"do": "speed", "value": NaN}', '{"do": "speed", "value": -Infinity}',
    '{"do": "speed", "value": true}', '{"do": "curve", "population": "exc", "neuron": 99999999999}',
    '{"do": "watch", "population": "exc", "neuron": 0, "state": "../../etc"}',
    '{"do": "watch", "population": "/etc/passwd", "neuron": 0, "state": "V_m"}',
    '{"do": "set", "part": "exc", "word": "V_th", "value": "__import__(\'os\').getcwd()"}',
    '{"do": "set", "part": "exc", "word": "V_th", "value": ' + "9" * 3000 + "}",
    '{"do": "set", "part": "exc[0]", "word": "V_th", "value": 1}',
    '{"do": "set", "part": "exc", "word": "_engine", "value": 1}',
    '{"do": "set", "part": "exc", "word": "tau_minus", "value": 1}',
    '{"do": "set", "part": "exc", "word": "V_th", "value": -1e400}',
    '{"do": "activate", "population": "exc", "rate": -5}', '{"do": "reset", "weights": "yes"}'
]  # fmt: skip


def test_malformed_messages_are_answered_by_an_error(client):
    for message in MALFORMED:
        client.connection.send(message)
        while True:
            found, _ = client.hear()
            if "keep" not in found and "rates" not in found:
                break
        assert found["error"], message


def test_no_more_clients_than_are_served(running):
    from websockets.exceptions import InvalidStatus

    with ExitStack() as clients:
        first = []

        def joined():
            with suppress(InvalidStatus):  # a client of the test before may not be gone yet
                first.append(clients.enter_context(running.client()))
            return len(first) == MOST_CLIENTS

        assert until(joined)
        assert [refused(running) for _ in range(5)] == [503] * 5
        for each in first:
            assert each.frame()
        assert running.goes_on()


def test_a_client_that_does_not_read_holds_nobody_up(running):
    with running.client(max_queue=1) as deaf, running.client() as other:
        deaf.connection.send(json.dumps({"do": "network", "id": 1}))
        times = [other.frame()[0]["time"] for _ in range(30)]
        assert (times, len({*times})) == (sorted(times), 30)


def test_connections_that_say_nothing_or_nonsense(running):
    with ExitStack() as sockets:
        for words in (
            b"", b"GET", b"\x16\x03\x01\x02\x00\x01", b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 5000, b"\r\n" * 99
        ):  # fmt: skip
            sockets.enter_context(socket.create_connection((running.host, running.port))).sendall(words)
        with running.client() as client:
            assert client.frame()


def test_clients_that_never_finish_their_handshake(running):
    """Any number of them keep nobody out, and are closed after a while."""
    begun = f"GET {running.token}socket HTTP/1.1\r\nHost: {running.host}:{running.port}\r\n".encode()
    with ExitStack() as sockets:
        ones = [sockets.enter_context(socket.create_connection((running.host, running.port))) for _ in range(200)]
        for one in ones[::2]:
            one.sendall(begun)
        with running.client() as client:
            assert client.frame()
            ones[0].settimeout(2.0 * OPEN_S)
            assert ones[0].recv(1) in (b"", b"H")
            assert client.frame()


ODD_PATHS = ["{}\u00e9", "{}%00", "*", "{}socket?x", "{}socket/../page.js"]


def test_odd_paths_are_answered_by_a_refusal_or_nothing(running):
    for path in ODD_PATHS:
        with socket.create_connection((running.host, running.port), 5.0) as one:
            request = f"GET {path.format(running.token)} HTTP/1.1\r\nHost: {running.host}:{running.port}\r\n\r\n"
            one.sendall(request.encode())
            assert one.recv(100).split(b" ")[:2] in ([b"HTTP/1.1", b"404"], [b""]), path
