"""The page to hold the wood in the hand, in a real browser without a network."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from browser import chromium
from color_checks import assert_same_colors, srgb
from wood_samples import WOODS, in_block, old_wood

from pipeline.carve.sample_meshes import sample_mesh
from pipeline.export.registry import Options, exporters_named
from pipeline.viewer import viewer_page, write_viewer

WOODS_SHOWN = {**WOODS, "old": old_wood()}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    # Small, since every pixel is drawn in software.
    with chromium(640, 420) as driver:
        yield driver


def opened(driver: Any, page: Path) -> float:
    """Open a page and wait for its first frame; returns its milliseconds."""
    driver.get_log("browser")
    driver.get_log("performance")
    driver.get(page.as_uri())
    for _ in range(300):
        ready = driver.execute_script(
            "return document.body.dataset.ready || document.getElementById('problem').innerText"
        )
        if ready:
            return float(ready)
        time.sleep(0.1)
    raise AssertionError("no frame within 30 s")


@pytest.fixture(scope="module")
def page(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("viewer") / "wood.html"
    return write_viewer(WOODS["round"], path, "a <b>round</b> one", {5: 1987})


def picture(driver: Any) -> np.ndarray:
    """What the canvas shows, (H, W, 4) bytes, row 0 on top."""
    import base64

    import cv2

    driver.execute_script("woodpipe.draw(true)")
    uri = driver.execute_script("return document.getElementById('view').toDataURL('image/png')")
    data = np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))[..., [2, 1, 0, 3]].astype(float)


@pytest.mark.parametrize("name", list(WOODS_SHOWN))
def test_the_page_evaluates_the_wood(browser: Any, tmp_path: Path, name: str) -> None:
    wood = WOODS_SHOWN[name]
    opened(browser, write_viewer(wood, tmp_path / "wood.html", name))
    where = in_block(wood, 10_000)
    out = browser.execute_script("return woodpipe.evaluate(arguments[0])", where.ravel().tolist())
    out = np.array(out).reshape(-1, 4)
    known = wood.evaluate(where)
    kept = known.ring_age > (61 if name == "old" else -1)
    assert_same_colors(out[kept, :3], known.rgb[kept])
    npt.assert_allclose(out[kept, 3], known.ring_age[kept], atol=5e-3)


def test_the_page_says_nothing_to_the_console_and_asks_no_network(browser: Any, page: Path) -> None:
    assert opened(browser, page) < 10_000.0
    assert [line for line in browser.get_log("browser") if line["level"] in ("SEVERE", "WARNING")] == []
    sent = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    asked = [one["params"]["request"]["url"] for one in sent if one["method"] == "Network.requestWillBeSent"]
    assert {url.split(":")[0] for url in asked} <= {"file", "data", "blob"}
    assert page.stat().st_size < 5_000_000


def test_the_block_is_drawn_where_our_own_evaluation_puts_it(browser: Any, page: Path) -> None:
    opened(browser, page)
    browser.execute_script("woodpipe.uniforms.u_mode.value = 2; woodpipe.uniforms.u_detail.value = false")
    shown = picture(browser)
    height, width = shown.shape[:2]
    eye = np.array(browser.execute_script("return woodpipe.uniforms.u_eye.value.toArray()"))
    matrix = browser.execute_script(
        "const c = woodpipe.camera; c.updateMatrixWorld(); return c.projectionMatrix.clone()"
        ".multiply(c.matrixWorldInverse).multiply(woodpipe.body.matrixWorld).toArray()"
    )
    seen = np.array(matrix).reshape(4, 4).T
    rng = np.random.default_rng(0)
    # Points of the photographed face, where the camera looks at it.
    points = np.column_stack([rng.uniform(5, 295, 400), rng.uniform(5, 195, 400), np.full(400, 1e-6)])
    assert eye[2] < 0.0, "the camera stands before the face"
    clip = np.column_stack([points, np.ones(400)]) @ seen.T
    spot = clip[:, :2] / clip[:, 3:]
    columns = ((spot[:, 0] * 0.5 + 0.5) * width).astype(int)
    rows = ((0.5 - spot[:, 1] * 0.5) * height).astype(int)
    found = shown[rows, columns]
    assert (found[:, 3] == 255).mean() > 0.95
    late = WOODS["round"].evaluate(points).lateness
    # Pale earlywood, dark latewood, under one even light on the whole face.
    assert np.corrcoef(found[:, 0], late)[0, 1] < -0.9
    browser.execute_script("woodpipe.uniforms.u_mode.value = 0; woodpipe.uniforms.u_detail.value = true")
    colors = picture(browser)[rows, columns, :3]
    known = srgb(WOODS["round"].evaluate(points).rgb)
    assert np.corrcoef(colors.mean(axis=1), known.mean(axis=1))[0, 1] > 0.85


def test_the_slider_moves_the_cut_and_every_mode_shows_something_else(browser: Any, page: Path) -> None:
    opened(browser, page)
    views = [picture(browser)]
    for share in (30, 60):
        browser.execute_script(
            "const s = document.getElementById('cut'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))",
            share,
        )
        views.append(picture(browser))
    for value in (1, 2, 3):
        browser.execute_script("document.querySelector(`input[name=mode][value='${arguments[0]}']`).click()", value)
        views.append(picture(browser))
    for number, one in enumerate(views):
        for other in views[:number]:
            assert np.abs(one - other).mean() > 1.0
    assert browser.execute_script("return document.getElementById('cut-value').textContent") == "60 %"
    # What the cut opens is solid: no hole, and less of the block is left.
    assert (views[2][..., 3] > 0).sum() < (views[0][..., 3] > 0).sum()


def test_pointing_at_the_wood_tells_ring_and_year(browser: Any, page: Path) -> None:
    opened(browser, page)
    middle = browser.execute_script(
        "const b = document.getElementById('view').getBoundingClientRect();"
        "return woodpipe.at(b.left + b.width / 2, b.top + b.height / 2)"
    )
    assert set(middle) == {"age", "lateness", "confidence"}
    assert middle["age"] > 0.0
    assert browser.execute_script("return woodpipe.at(2, 2)") is None, "beside the wood"
    assert "1987" in viewer_page(WOODS["round"], "x", {5: 1987})


def test_the_keyboard_turns_the_block_and_reaches_the_slider(browser: Any, page: Path) -> None:
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    before = browser.execute_script("return woodpipe.camera.position.toArray()")
    browser.execute_script("document.getElementById('view').focus()")
    press = ActionChains(browser).send_keys
    press(Keys.ARROW_LEFT).perform()
    after = browser.execute_script("return woodpipe.camera.position.toArray()")
    assert np.abs(np.subtract(before, after)).max() > 1.0
    assert np.linalg.norm(before) == pytest.approx(np.linalg.norm(after), rel=1e-3)
    met = []
    for _ in range(10):
        ActionChains(browser).send_keys(Keys.TAB).perform()
        met.append(browser.execute_script("return document.activeElement.id || document.activeElement.name"))
    assert {"mode", "detail", "cut", "axis", "file", "reset"} <= set(met)
    assert browser.execute_script("return document.getElementById('readout').textContent").startswith("ring ")


def test_a_mesh_of_ones_own_is_cut_from_the_wood(browser: Any, page: Path, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    opened(browser, page)
    block = picture(browser)
    body, broken = tmp_path / "ball.glb", tmp_path / "broken.glb"
    trimesh.Trimesh(*sample_mesh("ball", 24), process=False).export(body)
    broken.write_bytes(b"glTF, but not really")
    field = browser.find_element("id", "file")
    for path, said in ((body, "cut from the wood"), (broken, "cannot be read as a GLB")):
        field.send_keys(str(path))
        for _ in range(50):
            told = browser.execute_script("return document.getElementById('readout').textContent")
            if said in told:
                break
            time.sleep(0.1)
        assert said in told
    assert np.abs(picture(browser) - block).mean() > 2.0


def test_the_page_fits_a_phone(browser: Any, page: Path) -> None:
    opened(browser, page)
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 375, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    )
    try:
        opened(browser, page)
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        canvas = browser.execute_script("return document.getElementById('view').getBoundingClientRect().toJSON()")
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide <= 375
    assert canvas["width"] == 375
    assert canvas["height"] > 300


def test_a_name_cannot_break_out_of_the_page() -> None:
    text = viewer_page(WOODS["plain"], "</script><script>alert(1)</script>")
    assert "<script>alert(1)" not in text
    assert text.count("<script") == 2


MODULE = """
const [source, about, shader, tables, done] = arguments;
const bytes = Uint8Array.from(atob(tables), (c) => c.charCodeAt(0));
import(`data:text/javascript;base64,${source}`).then(({ makeWood }) => {
  const { THREE, body, scene } = woodpipe;
  const wood = makeWood(THREE, about, shader, new Float32Array(bytes.buffer));
  body.material = wood.material;
  scene.add(new THREE.AmbientLight(0xffffff, Math.PI));
  woodpipe.draw(true);
  done(wood.material.type);
}).catch((error) => done(String(error)));
"""


def test_the_module_for_three_js_gives_a_material_that_draws_the_wood(browser: Any, page: Path, tmp_path: Path) -> None:
    import base64

    (exporter,) = exporters_named("threejs")
    files = {path.suffix: path for path in exporter.write(WOODS["round"], tmp_path, Options())}
    about = json.loads(files[".json"].read_text())
    assert files[".bin"].stat().st_size == 4 * about["row"] * about["rows"]
    opened(browser, page)
    source, tables = (base64.b64encode(files[kind].read_bytes()).decode() for kind in (".js", ".bin"))
    told = browser.execute_async_script(MODULE, source, about, files[".glsl"].read_text(), tables)
    assert told == "MeshStandardMaterial"
    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
    shown = picture(browser)
    wood = shown[shown[..., 3] == 255][:, :3]
    assert len(wood) > 1000
    block = srgb(WOODS["round"].evaluate(in_block(WOODS["round"], 5000)).rgb)
    # Under light from everywhere the color is that of the wood, but for a little gloss.
    assert np.abs(wood.mean(axis=0) - block.mean(axis=0)).max() < 25.0
