"""A page on a network that runs in a thread, and clients that look at it."""

import json
import struct
import threading
import time
from contextlib import contextmanager
from urllib.parse import urlsplit

import neuro


def network(size=40):
    net = neuro.Network("seen", resolution=0.5)
    noise = net.population("noise", size, neuro.poisson_generator(rate=80.0))
    exc = net.population("exc", size, neuro.iaf_psc_exp())
    out = net.population("out", (2, 4), neuro.iaf_psc_exp())
    net.population("camera", (2, 3, 4), neuro.event_camera())
    net.connect(noise, exc, neuro.one_to_one(), weight=900.0, delay=1.0)
    net.connect(exc, out, neuro.all_to_all(), neuro.stdp_dopa(A_plus=0.1, signal="reward", Wmax=400.0), weight=200.0)
    net.connect(out, exc, neuro.all_to_all(), weight=-20.0, delay=1.0)
    net.signal("reward", to=out)
    net.probe("v", exc[:2], "V_m")
    return net


def areas(number):
    """Many populations, each of which has synapses from some before it and one behind it."""
    net = neuro.Network("areas", resolution=1.0)
    names = [f"area_{k}_{'inhibitory' if k % 4 == 3 else 'excitatory'}" for k in range(number)]
    for k, name in enumerate(names):
        net.population(name, 2, neuro.iaf_psc_exp(I_e=400.0 + k) if k % 10 else neuro.poisson_generator(rate=50.0))
    for k, name in enumerate(names):
        if k % 10:
            for source in sorted({max(0, k - 10), k - k % 10, min(number - 1, k + 1)}):
                net.connect(names[source], name, neuro.all_to_all(), weight=10.0, delay=1.0, name=f"p{source}_{k}")
    return net


class Running:
    """A page, and a thread that runs its simulation."""

    def __init__(self, net=None, **words):
        net = net or network()
        self.page = neuro.live.Page(
            neuro.compile(net), speed=4.0, restart=lambda seed: neuro.compile(net, seed=seed), **words
        )
        self.error = None
        self.thread = threading.Thread(target=self.run)
        self.thread.start()
        self.look(self.page)

    def look(self, page):
        """Find the way to a page."""
        parts = urlsplit(page.url)
        self.host, self.port, self.token = parts.hostname, parts.port, parts.path
        self.origin = f"http://{parts.netloc}"

    def run(self):
        try:
            self.page.run()
        except BaseException as error:
            self.error = error

    def close(self):
        self.page.stop()
        self.thread.join(10.0)
        self.page.close()
        assert self.error is None

    def goes_on(self):
        """Whether the network runs on."""
        before = self.page.sim.time
        return until(lambda: self.page.sim.time != before)

    @contextmanager
    def client(self, **words):
        from websockets.sync.client import connect

        words = {"origin": self.origin, "compression": None, "close_timeout": 0.2} | words
        with connect(f"ws://{self.host}:{self.port}{self.token}socket", **words) as connection:
            yield Client(connection)


class Client:
    """A WebSocket, and what it has heard."""

    def __init__(self, connection):
        self.connection, self.kept, self.number = connection, {}, 0

    def hear(self, seconds=10.0):
        """The next message: a frame or a file as (head, body), others as (message, None)."""
        data = self.connection.recv(timeout=seconds)
        if isinstance(data, bytes):
            head, body = struct.unpack_from("<II", data)
            return json.loads(data[8 : 8 + head]), data[8 + head : 8 + head + body]
        message = json.loads(data)
        if "keep" in message:
            self.kept[message["keep"]] = message
        return message, None

    def ask(self, **what):
        """Ask, and the answer with its file if there is one."""
        self.number += 1
        self.connection.send(json.dumps({**what, "id": self.number}))
        while True:
            found, body = self.hear()
            if found.get("id") == self.number:
                return (found, body) if body else found

    def until(self, test):
        """Hear until something holds."""
        end = time.monotonic() + 60.0
        while not test(self.kept):
            assert time.monotonic() < end, self.kept.keys()
            self.hear()
        return self.kept

    def frame(self):
        while True:
            head, body = self.hear()
            if body is not None and "rates" in head:
                return head, body


def until(test, seconds=10.0):
    end = time.monotonic() + seconds
    while not test():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True
