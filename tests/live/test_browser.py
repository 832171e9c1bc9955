"""The page in Chromium: it loads, plays, sets, survives a reload, and is used by the keyboard alone."""

import pytest

from running_page import Running, areas, until


@pytest.fixture
def shown(running, driver):
    """The page of the running network, when frames come; its console must stay empty."""
    driver.get_log("browser")
    running.page.pace.pause(False)
    driver.get(running.page.url)
    assert until(lambda: number(driver, "time") > 0.0)
    yield driver
    assert driver.get_log("browser") == []
    driver.get("about:blank")


def number(driver, id):
    """The number that an element begins with, in ms where it is a time in s; 0 where it has none."""
    words = driver.execute_script("return document.getElementById(arguments[0]).textContent", id).split()
    try:
        return float(words[0]) * (1000.0 if words[1] == "s" else 1.0)
    except (IndexError, ValueError):
        return 0.0


def ink(driver, id):
    """How many pixels of a canvas have a colour."""
    script = """
        const canvas = document.getElementById(arguments[0]), copy = new OffscreenCanvas(canvas.width, canvas.height);
        const pen = copy.getContext("2d", {willReadFrequently: true});
        pen.drawImage(canvas, 0, 0);
        const data = pen.getImageData(0, 0, canvas.width, canvas.height).data;
        let found = 0;
        for (let k = 0; k < data.length; k += 4) {
            const most = Math.max(data[k], data[k + 1], data[k + 2]), least = Math.min(data[k], data[k + 1], data[k + 2]);
            found += data[k + 3] > 100 && most - least > 60;
        }
        return found;"""  # noqa: E501
    return driver.execute_script(script, id)


def threshold(running):
    return running.page.sim._engine.get(1, "V_th")[0]  # a call of the simulation would be in the way of its thread


def press(driver, *keys):
    from selenium.webdriver import ActionChains

    chain = ActionChains(driver)
    for key in keys:
        chain.send_keys(key)
    chain.perform()


def text(driver, id):
    return driver.execute_script("return document.getElementById(arguments[0]).textContent", id)


def value(driver, id):
    return float(driver.execute_script("return document.getElementById(arguments[0]).value", id))


def test_it_loads_and_plays(shown):
    assert shown.title.startswith("seen")
    assert text(shown, "told").startswith("112 neurons, 680 synapses")
    before = number(shown, "time")
    assert until(lambda: number(shown, "time") > before + 200.0)
    for canvas in ("raster", "rates", "traces", "histogram"):
        assert until(lambda canvas=canvas: ink(shown, canvas) > 100), canvas


def test_a_slider_acts_and_survives_a_reload(shown, running):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    assert until(lambda: shown.find_elements(By.ID, "slider-V_th"))
    slider, before = shown.find_element(By.ID, "slider-V_th"), value(shown, "slider-V_th")
    slider.send_keys(Keys.ARROW_RIGHT * 5)
    assert until(lambda: threshold(running) > before)
    assert until(lambda: abs(threshold(running) - value(shown, "slider-V_th")) < 1e-6)
    now = value(shown, "slider-V_th")
    shown.refresh()
    assert until(lambda: shown.find_elements(By.ID, "slider-V_th"))
    assert value(shown, "slider-V_th") == pytest.approx(now)
    exact = shown.find_element(By.CSS_SELECTOR, "[data-word=V_th] input[type=number]")
    exact.clear()
    exact.send_keys("-90", Keys.ENTER)
    told = "return document.querySelector('[data-word=V_th] [role=alert]').textContent"
    assert until(lambda: "expected less than V_th" in shown.execute_script(told))
    assert threshold(running) == pytest.approx(now)
    exact.clear()
    exact.send_keys("-55", Keys.ENTER)
    assert until(lambda: threshold(running) == -55.0)


def test_it_is_used_by_the_keyboard_alone(shown, running):
    from selenium.webdriver.common.keys import Keys

    def focused():
        return shown.execute_script("const e = document.activeElement; return e.id || e.getAttribute('aria-label')")

    def tab_to(test):
        for _ in range(40):
            press(shown, Keys.TAB)
            if test(focused() or ""):
                return
        pytest.fail(f"never reached; at {focused()}")

    press(shown, " ")
    assert until(lambda: running.page.pace.paused and text(shown, "play") == "Go on")
    before = running.page.sim.time
    press(shown, ".")
    assert until(lambda: running.page.sim.time > before)
    tab_to(lambda name: name == "play")
    press(shown, Keys.ENTER)
    assert until(lambda: not running.page.pace.paused)
    tab_to(lambda name: name.startswith("exc, "))
    press(shown, Keys.ARROW_DOWN)
    assert focused().startswith("out, ")
    press(shown, Keys.ENTER)
    assert until(lambda: value_of(shown, "part") == "out")
    tab_to(lambda name: name == "silence")
    press(shown, " ")
    assert until(lambda: running.page.commands.silenced == ["out"])
    assert until(lambda: text(shown, "silence") == "Restore" and focused() == "silence")
    press(shown, " ")
    assert until(lambda: running.page.commands.silenced == [])


def test_the_ends_of_sliders_follow_what_is_set(shown, running):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    def end():
        return float(shown.execute_script("return document.getElementById('slider-V_th').min"))

    shown.execute_script("choose('out')")
    assert until(lambda: shown.find_elements(By.ID, "slider-V_th"))
    assert end() > -70.0
    exact = shown.find_element(By.CSS_SELECTOR, "[data-word=V_reset] input[type=number]")
    exact.clear()
    exact.send_keys("-60", Keys.ENTER)
    assert until(lambda: -60.0 < end() < -59.0)
    exact.clear()
    exact.send_keys("-70", Keys.ENTER)
    assert until(lambda: end() < -69.0)


def test_a_seed_that_is_refused_is_said_and_put_back(shown):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    seed = shown.find_element(By.ID, "seed")
    before = seed.get_attribute("value")
    seed.clear()
    seed.send_keys("-3", Keys.ENTER)
    assert until(lambda: "seed = -3" in text(shown, "message") or "value = -3" in text(shown, "message"))
    assert seed.get_attribute("value") == before


def value_of(driver, id):
    return driver.execute_script("return document.getElementById(arguments[0]).value", id)


@pytest.mark.parametrize(("button", "name"), [("picture", "ms.png"), ("save", "ms.h5"), ("network", "seen.yaml")])
def test_what_is_saved_is_named(shown, button, name):
    assert until(lambda: ink(shown, "raster") > 0)
    shown.execute_script("document.getElementById(arguments[0]).click()", button)
    assert until(lambda: text(shown, "message").endswith(f"{name} is saved"))


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (390, "dark"), (1600, "dark")])
def test_it_fits_narrow_and_wide_in_light_and_dark(shown, width, scheme):
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    shown.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    media = [{"name": "prefers-color-scheme", "value": scheme}]
    shown.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": media})
    try:
        assert until(lambda: shown.execute_script("return innerWidth") == width)
        script = "return [...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML.slice(0, 80))"  # noqa: E501
        assert until(lambda: shown.execute_script(script) == []), shown.execute_script(script)
        dark = shown.execute_script("return getComputedStyle(document.body).backgroundColor") == "rgb(16, 19, 23)"
        assert dark == (scheme == "dark")
        assert until(lambda: ink(shown, "raster") > 50)
    finally:
        shown.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        shown.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


@pytest.fixture(scope="module")
def large(request, websockets):
    one = Running(areas(request.param))
    yield one
    one.close()


BOXES = """
    const box = e => { const r = e.getBoundingClientRect(); return [r.left, r.top, r.right, r.bottom]; };
    const nodes = [...document.querySelectorAll('#graph .node')];
    return nodes.map(e => [box(e.querySelector('.box')), box(e.querySelector('text'))]);
"""


@pytest.mark.parametrize("large", [50, 300], indirect=True)
def test_a_graph_of_many_populations_is_read_and_used(large, driver):
    from selenium.webdriver.common.keys import Keys

    driver.get(large.page.url)
    number_ = len(large.page.sim.program.populations)
    assert until(lambda: number(driver, "time") > 0.0)
    boxes = driver.execute_script(BOXES)
    assert len(boxes) == number_ if number_ <= 60 else 2 <= len(boxes) <= 49
    net = driver.execute_script(
        "const r = document.getElementById('net'); return [r.clientWidth, r.scrollWidth, r.clientHeight]"
    )
    assert net[1] <= net[0]
    assert net[2] <= 460
    for k, ((left, top, right, bottom), label) in enumerate(boxes):
        assert left < label[0] < label[2] < right
        assert label[3] - label[1] > 10.0
        for other, _ in boxes[:k]:
            assert other[0] >= right or other[2] <= left or other[1] >= bottom or other[3] <= top
    driver.execute_script("document.querySelector('#graph [tabindex=\\'0\\']').focus()")
    first = driver.execute_script("return document.activeElement.getAttribute('aria-label')")
    press(driver, Keys.ARROW_DOWN, Keys.ENTER)
    chosen = value_of(driver, "part")
    assert not first.startswith(chosen + ",")
    assert driver.execute_script("return document.activeElement.getAttribute('aria-label')").startswith(chosen + ",")
    inside = "const a = document.activeElement.getBoundingClientRect(), b = document.getElementById('net').getBoundingClientRect(); return a.top >= b.top - 1 && a.bottom <= b.bottom + 1"  # noqa: E501
    assert driver.execute_script(inside)


@pytest.mark.parametrize("large", [300], indirect=True)
def test_which_populations_are_shown_is_chosen_by_the_keyboard_and_kept(large, driver):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    def listed():
        return [e.text.split()[0] for e in driver.find_elements(By.CSS_SELECTOR, "#legend li")]

    driver.get(large.page.url)
    names = [part.name for part in large.page.sim.program.populations]
    assert until(lambda: number(driver, "time") > 0.0)
    assert listed() == [name for k, name in enumerate(names) if k % 10][:12]
    driver.find_element(By.CSS_SELECTOR, "#chooser summary").send_keys(Keys.ENTER)
    driver.find_element(By.ID, "none").send_keys(Keys.ENTER)
    assert listed() == []
    driver.find_element(By.ID, "filter").send_keys("_4_")
    press(driver, Keys.TAB, Keys.TAB, " ")
    assert listed() == ["area_4_excitatory"]
    assert until(lambda: ink(driver, "raster") > 20 and ink(driver, "rates") > 20)
    driver.refresh()
    assert until(lambda: number(driver, "time") > 0.0)
    assert listed() == ["area_4_excitatory"]
    driver.execute_script("document.querySelectorAll('#choices input').forEach(box => box.click())")
    assert len(listed()) == min(len(names) - 1, 24)
    driver.execute_script("sessionStorage.clear()")


def test_axes_have_round_numbers(shown):
    marks = [(0.1466, 0.3426, 5), (6.1, 20.0, 3), (0.0, 948.7, 5), (-70.0, -55.0, 3), (0.0, 25.0, 3)]
    found = [shown.execute_script("return rounds(...arguments)", *each) for each in marks]
    assert found[0] == pytest.approx([0.15, 0.2, 0.25, 0.3])
    assert found[1:] == [[10, 15, 20], [0, 200, 400, 600, 800], [-70, -60], [0, 10, 20]]
