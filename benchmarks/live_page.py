"""Slowdown of a simulation by a page, and frame rate of Chromium: `python benchmarks/live_page.py [--chromium]`.

A balanced network of 10,000 neurons runs as fast as possible in stretches of half a second. Stretches without a client
alternate with stretches in which three WebSocket clients in another process read 30 times a second. So other programs
on the machine slow both kinds alike. The figure is the ratio of the medians. With `--chromium` the network runs in real
time, and the page counts the frames that it draws.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import multiprocessing
import shutil
import threading
import time
from statistics import median
from urllib.parse import urlsplit

import neuro

STRETCH_S = 0.5
READS_PER_S = 30.0
CLIENTS = 3


def balanced(size: int = 10_000) -> neuro.Network:
    """Return a network that fires at about 10 Hz."""
    cell = neuro.iaf_psc_delta(tau_m=20.0, t_ref=2.0, E_L=0.0, V_reset=10.0, V_th=20.0)
    net = neuro.Network("balanced", resolution=0.1)
    exc, inh = 4 * size // 5, size // 5
    noise = net.population("noise", 1000, neuro.poisson_generator(rate=140.0))
    parts = [
        net.population(name, number, cell, initial={"V_m": neuro.uniform(low=0.0, high=20.0)})
        for name, number in (("exc", exc), ("inh", inh))
    ]
    for target in parts:
        net.connect(noise, target, neuro.fixed_indegree(50), weight=0.15, delay=1.5)
        net.connect(parts[0], target, neuro.fixed_indegree(80), weight=0.2, delay=1.5)
        net.connect(parts[1], target, neuro.fixed_indegree(20), weight=-1.0, delay=1.5)
    return net


def read(url: str, looking: object, frames: object) -> None:
    """Connect three clients while `looking` is set, and count the frames that they read."""
    from websockets.asyncio.client import connect

    parts = urlsplit(url)

    async def client() -> None:
        while True:
            if not looking.value:  # type: ignore[attr-defined]
                await asyncio.sleep(0.01)
                continue
            address, origin = f"ws://{parts.netloc}{parts.path}socket", f"http://{parts.netloc}"
            async with connect(address, origin=origin, compression=None, max_queue=1) as connection:
                while looking.value:  # type: ignore[attr-defined]
                    if isinstance(await connection.recv(), bytes):
                        frames.value += 1  # type: ignore[attr-defined]
                        await asyncio.sleep(1.0 / READS_PER_S)

    async def run() -> None:
        await asyncio.gather(*(client() for _ in range(CLIENTS)))

    asyncio.run(run())


def slowdown(rounds: int) -> None:
    """Print the slowdown of the run by clients."""
    sim = neuro.compile(balanced(), seed=1)
    sim.run(200.0)
    looking, frames = multiprocessing.Value("b", 0), multiprocessing.Value("q", 0)
    taken: dict[int, list[float]] = {0: [], 1: []}
    used: dict[int, list[float]] = {0: [], 1: []}
    with neuro.live.Page(sim, speed=math.inf) as page:
        process = multiprocessing.Process(target=read, args=(page.url, looking, frames), daemon=True)
        process.start()
        page.run(sim.time + 1000.0)
        for number in range(2 * rounds):
            kind = (number // 2 + number) % 2
            looking.value = kind  # type: ignore[attr-defined]
            stretch(page, 0.2)
            ms, wall, cpu = stretch(page, STRETCH_S)
            taken[kind].append(wall / ms * 1e3)
            used[kind].append(cpu / ms * 1e3)
        process.kill()
    rate = sim.counts().spikes / (11_000 * sim.time * 1e-3)
    print(f"{sim.program.name}: 10,000 neurons, {rate:.1f} Hz; {frames.value:,} frames read by {CLIENTS} clients")  # type: ignore[attr-defined]
    for what, found in (("seconds", taken), ("processor seconds", used)):
        alone, seen = median(found[0]), median(found[1])
        print(f"{what} of a second of the network: {alone:.3f} alone, {seen:.3f} with clients: x {seen / alone:.3f}")


def stretch(page: neuro.live.Page, seconds: float) -> tuple[float, float, float]:
    """Run for `seconds`. Return the simulated ms, the wall time and the time of the thread in s."""
    ms, wall, cpu = page.sim.time, time.perf_counter(), time.thread_time()
    while time.perf_counter() < wall + seconds:
        page.run(page.sim.time + 20.0)
    return page.sim.time - ms, time.perf_counter() - wall, time.thread_time() - cpu


def chromium(seconds: float) -> None:
    """Print the number of frames per second that Chromium draws of a run in real time."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = shutil.which("chromium") or ""
    for word in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "window-size=1600,1050"):
        options.add_argument(f"--{word}")
    sim = neuro.compile(balanced(), seed=1)
    with neuro.live.Page(sim, speed=1.0) as page:
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        rates: list[str] = []

        def look() -> None:
            driver.get(page.url)
            for _ in range(int(seconds)):
                time.sleep(1.0)
                rates.append(driver.execute_script("return document.getElementById('fps').textContent"))

        thread = threading.Thread(target=look)
        thread.start()
        began, ms = time.perf_counter(), sim.time
        while thread.is_alive():
            page.run(sim.time + 20.0)
        speed = (sim.time - ms) * 1e-3 / (time.perf_counter() - began)
        driver.quit()
    found = [float(rate.split()[0]) for rate in rates[2:] if rate]
    least, middle = min(found), median(found)
    print(f"Chromium: {sim.time * 1e-3:.1f} s at {speed:.3f} x real time, {middle:.0f} frames/s, least {least:.0f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--chromium", action="store_true")
    parser.add_argument("--seconds", type=float, default=12.0)
    given = parser.parse_args()
    slowdown(given.rounds)
    if given.chromium:
        chromium(given.seconds)
