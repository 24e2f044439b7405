"""The page in a browser: what WebGL is given, and what is seen at a pixel, are those of the run."""

import runpy
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from browser import NEEDED, Browser, browser_of_a_module
from conftest import but_long
from faults import refused
from machines import ball

import symmb as mb
from symmb._types import Array
from symmb.show.cli.scene_file import load_scene, shipped_names

pytestmark = [NEEDED, pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")]
browser = browser_of_a_module
EXACT = 1e-6
TIMES = (0.0, 0.4, 0.9)
"""Shares of the run at which pages are read."""


EXAMPLES = Path(__file__).parents[2] / "examples"
GALLERY = [path.stem for path in sorted(EXAMPLES.glob("*.py")) if "mb.view(run" in path.read_text(encoding="utf-8")]
SHORT = {"excavator", "planetary_gear"}
SUBJECTS = [*but_long(shipped_names(), "artillery", "bicycle"), *but_long(GALLERY, *{*GALLERY} - SHORT)]


@pytest.fixture(scope="module", params=SUBJECTS)
def shown(request, tmp_path_factory):
    if request.param in GALLERY:
        run = runpy.run_path(str(EXAMPLES / f"{request.param}.py"))["run"]
    else:
        run = mb.simulate(load_scene(request.param))
    path = tmp_path_factory.mktemp("pages") / f"{request.param}.html"
    mb.view(run, path)
    return run, path


def matrices(browser: Browser) -> list[tuple[str, str, str, Array]]:
    """Name, kind and form of the parts, and their matrices (4, 4) as WebGL gets them."""
    return [
        (p["name"], p["kind"], p["form"], np.array(p["matrix"]).reshape(4, 4).T) for p in browser.run("symmb.parts()")
    ]


def frame(browser: Browser, i: int) -> Array:
    return np.array(browser.run(f"symmb.frameMatrix({i})")).reshape(4, 4).T


def differences(browser: Browser, run: mb.Trajectory) -> float:
    """Largest distance between positions and directions in the page and those of the run, at three times."""
    errors, scene = [], run.scene
    for share in TIMES:
        k = round(share * (len(run.t) - 1))
        browser.run(f"location.hash = 't={float(run.t[k])!r}', new Promise(done => setTimeout(done, 50))")
        parts = matrices(browser)
        for i, body in enumerate(scene.system.bodies):
            expected = run(ca.vec(ca.horzcat(body.frame.R, body.frame.r)))[k].reshape(4, 3).T
            errors.append(frame(browser, i + 1)[:3] - expected)
            errors += [m[:3, 3] - expected[:, 3] for *own, m in parts if own == [body.name, "centre of mass", "ball"]]
        for joint in scene.system.elements:
            if isinstance(joint, mb.Spherical | mb.Revolute):
                kind, form = ("Revolute", "pin") if isinstance(joint, mb.Revolute) else ("Spherical", "ball")
                (matrix,) = [m for *own, m in parts if own == [joint.name, kind, form]]
                middle, along = matrix[:3, 3], matrix[:3, 2]
                errors.append(middle + (form == "pin") * along / 2 - run(joint.point_a.r)[k])
                if form == "pin":
                    errors.append(along / np.linalg.norm(along) - run(joint.frames[0][:, 2])[k])
    return max((np.abs(error).max() for error in errors), default=0.0)


def test_pages_show_the_run(browser, shown):
    run, path = shown
    browser.open(path)
    assert differences(browser, run) <= EXACT
    assert not browser.errors


def test_the_address_sets_the_time(browser, shown):
    run, path = shown
    k = len(run.t) // 3
    browser.open(path, f"t={float(run.t[k])!r}")
    step = -(-len(run.t) // 1001)
    assert browser.run("Number(document.getElementById('scrub').value)") == round(k / step)
    assert not browser.errors


def planted(path: Path, true: str, false: str) -> Path:
    text = path.read_text()
    assert true in text
    wrong = path.with_name("mirrored.html")
    wrong.write_text(text.replace(true, false, 1))
    return wrong


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    run = mb.simulate(load_scene("double_pendulum"))
    path = tmp_path_factory.mktemp("pendulum") / "page.html"
    mb.view(run, path)
    return run, path


MIRRORED = {
    "return [p[0], p[4], p[8], 0,": "return [-p[0], p[4], p[8], 0,",
    "p[3], p[7], p[11], 1]": "-p[3], p[7], p[11], 1]",
    "const moved = (m, a) => add(turned(m, a)": "const moved = (m, a) => sub(turned(m, a)",
}


@pytest.mark.parametrize(("true", "false"), MIRRORED.items())
def test_a_mirrored_sign_of_a_matrix_is_noticed(browser, pendulum, true, false):
    run, path = pendulum
    browser.open(planted(path, true, false))
    assert differences(browser, run) > 1e-3


def picked(browser: Browser, run: mb.Trajectory, k: int) -> list[str]:
    """What is seen a little beside the centre of each rod, where an upright picture has it."""
    browser.run(f"symmb.play(false), symmb.seek({k})")
    width, height = browser.run("[document.getElementById('view').width, document.getElementById('view').height]")
    shoulder = np.array(browser.run("symmb.project([0, 0, 0])"))
    metre = np.linalg.norm(np.array(browser.run("symmb.project([1, 0, 0])")) - shoulder)
    names = []
    for rod in ("rod1", "rod2"):
        r = np.array([run[f"{rod}.x"][k], run[f"{rod}.y"][k]])
        x, y = shoulder + metre * r  # gravity is along +y, which points down on the screen
        assert 0 <= x < width and 0 <= y < height
        names.append(browser.run(f"symmb.pick({round(x)}, {round(y)})?.shape.name ?? ''"))
    return names


@pytest.mark.parametrize(("address", "sign"), [("play", "\u275a\u275a"), ("t=0", "\u25b6")])
def test_an_address_plays_or_stands(browser, pendulum, address, sign):
    browser.open(pendulum[1], address)
    assert browser.run("document.getElementById('play').textContent") == sign
    assert not browser.errors


def test_fingers_and_keys_move_the_view(browser, pendulum):
    """The drawing moves with a finger, and stretches with two fingers."""
    browser.open(pendulum[1])
    browser.run("symmb.play(false)")
    box = "(({ x, y, width, height }) => [x + width / 2, y + 0.8 * height])(canvas.getBoundingClientRect())"
    x, y = browser.run(box)
    places = "[[0, 0, 0], [0.1, 0.1, 0]].map(symmb.project)"

    def moved(*moves: list[tuple[float, float]]) -> tuple[Array, Array]:
        before = np.array(browser.run(places))
        browser.touch(*moves)
        return before, np.array(browser.run(places))

    before, after = moved([(x, y)], [(x + 30, y)], [(x + 30, y - 20)])
    assert np.allclose(after - before, [30, -20])
    before, after = moved([(x - 20, y), (x + 20, y)], [(x - 40, y), (x + 40, y)])
    assert np.allclose(np.diff(after, axis=0), 2 * np.diff(before, axis=0))
    before, k = after, browser.run("picture")
    browser.press("ArrowRight", shift=True)
    after = np.array(browser.run(places))
    assert np.allclose(after - before, [20, 0])
    browser.press("+")
    assert np.allclose(np.diff(browser.run(places), axis=0), 1.1 * np.diff(after, axis=0))
    browser.press("ArrowRight")
    assert browser.run("picture") == k + 1 and not browser.errors


def test_pixels_show_what_is_there(browser, pendulum):
    run, path = pendulum
    browser.open(path)
    for k in (0, 370, 800):
        assert picked(browser, run, k) == ["rod1", "rod2"]


def test_a_mirrored_picture_is_noticed(browser, pendulum):
    run, path = pendulum
    browser.open(planted(path, "gl_Position = camera", "gl_Position = vec4(-1.0, 1.0, 1.0, 1.0) * camera"))
    assert picked(browser, run, 0) != ["rod1", "rod2"]


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=str)
def test_the_region_of_a_point_is_in_the_frame(browser, tmp_path, pose):
    """A point that is far from all that is drawn: the page fits where it gets, as a still does."""
    is_planar, p = isinstance(pose, mb.Planar), mb.Parameters(speed=1.0)
    arm, along = mb.Body("arm", 1.0, 1.0 if is_planar else (1.0, 1.0, 1.0), pose=pose), "y" if is_planar else "z"
    tip, start = arm.point(*([50, 0] if is_planar else [50, 0, 0])), {f"arm.v{along}": p.speed}
    scene = mb.Scene(mb.System(arm, parameters=p), start, [0.0, 1.5, 3.0], {"x": tip.x}, mb.Box(speed=(0.5, 1.5)))
    mb.view(mb.propagate(scene, mb.PolynomialChaos()), tmp_path / "p.html", point=tip)
    browser.open(tmp_path / "p.html")
    size = browser.run("[document.getElementById('view').clientWidth, document.getElementById('view').clientHeight]")
    for way in (0.0, 0.75, 1.5, 4.5):
        place = [50, way, 0] if is_planar else [50, 0, way]
        seen = np.array(browser.run(f"symmb.project({place})")[:2])
        assert ((0 <= seen) & (seen <= size)).all()
    assert not browser.errors


def test_pages_are_small(pendulum):
    viewer = Path(mb.__file__).parent / "show" / "drawing" / "viewer.js"
    assert len(viewer.read_text().splitlines()) <= 600
    assert viewer.stat().st_size <= 100e3
    assert pendulum[1].stat().st_size <= 1e6


@pytest.mark.long
def test_the_page_of_the_gun_is_small(tmp_path):
    gun = tmp_path / "gun.html"
    mb.view(mb.simulate(load_scene("artillery"), times=np.linspace(0, 14e-3, 200)), gun)
    assert gun.stat().st_size <= 6e6


def test_joints_open_and_meshes_stay_with_their_bodies(browser, tmp_path):
    """A triangle on a bob whose sling opens when x = cos(t) is 0."""
    stl = tmp_path / "part.stl"
    corners = "vertex 0 0 0 vertex 1 0 0 vertex 0 1 0"
    stl.write_text(f"solid a facet normal 0 0 1 outer loop {corners} endloop endfacet endsolid a")
    bob = mb.Body("bob", 1.0, pose=mb.Particle(), shapes=[mb.Mesh(stl, scale=0.1), mb.Cylinder(0.02, 0.1)])
    sling = mb.Distance("sling", mb.Ground().point(0, 0), bob.point(0, 0), 1.0)
    system = mb.System(bob, sling, mb.Release(sling, bob.x < 0))
    run = mb.simulate(mb.Scene(system, {"bob.x": 1.0, "bob.y": 0.0, "bob.vy": 1.0}, np.linspace(0, 3, 31)))
    mb.view(run, tmp_path / "sling.html")
    browser.open(tmp_path / "sling.html")
    browser.run("symmb.play(false)")
    for k in (0, 10, 20, 30):
        browser.run(f"symmb.seek({k})")
        parts = matrices(browser)
        names = {name for name, *_ in parts} - {"bob", "ground"}
        assert names == ({"sling"} if run.t[k] < np.pi / 2 else {"sling_release"})
        for kind, up in (("mesh", 0.0), ("cylinder", -0.05)):  # the foot of the cylinder
            (matrix,) = (matrix for _, own, _, matrix in parts if own == kind)
            assert np.abs(matrix[:3, 3] - [run["bob.x"][k], run["bob.y"][k], up]).max() < EXACT
    assert not browser.errors


def test_curves_have_a_time_axis(browser, pendulum):
    browser.open(pendulum[1])
    ticks = """(() => {
        const texts = [], fill = OffscreenCanvasRenderingContext2D.prototype.fillText;
        OffscreenCanvasRenderingContext2D.prototype.fillText = function (text, ...at) { texts.push(text); fill.call(this, text, ...at); };
        dispatchEvent(new Event("resize"));
        OffscreenCanvasRenderingContext2D.prototype.fillText = fill;
        return texts;
    })()"""  # noqa: E501
    assert browser.run(ticks)[:6] == ["0", "2", "4", "6", "8", "10 s"]


@pytest.mark.parametrize("has_figure", [False, True])
def test_places_of_sliders_are_runs(browser, tmp_path, has_figure):
    """Of a thrown particle x = v t, y = -g t^2 / 2. A slider stands at the value next to the nominal one at first."""
    rng = np.random.default_rng(int(has_figure))
    thrown = ball(g=2.0, speed=(1.0, "m/s"))
    body, start = thrown.ball, {"ball.vx": thrown.p.speed}
    outputs = {"x <b>": body.x, "y": body.y} | ({"peak": mb.maximum(body.vx)} if has_figure else {})
    scene = thrown.scene(outputs, np.linspace(0, 2, 11), start)
    speeds, drops = np.sort(rng.uniform(0.5, 1.5, 4)), np.sort(rng.uniform(1, 3, 3))
    path = tmp_path / "thrown.html"
    mb.view(mb.sweep(scene, {"speed": speeds, "g": drops}), path, time=2.0)
    browser.open(path)
    browser.run("symmb.play(false)")
    text = "[...document.querySelectorAll('#sliders label')].map(label => label.textContent)"
    at = [int(np.abs(speeds - 1).argmin()), int(np.abs(drops - 2).argmin())]
    move = "(i => { i.value = %d; i.dispatchEvent(new Event('input')); })(document.querySelectorAll('nav input')[%d])"
    for which, place in ((None, None), (0, 3), (1, 0), (0, 0), (1, 2)):
        if which is not None:
            at[which] = place
            browser.run(move % (place, which))
        speed, drop = speeds[at[0]], drops[at[1]]
        assert browser.run(text) == [f"speed [m/s]{float(f'{speed:.4g}'):g}", f"g{float(f'{drop:.4g}'):g}"]
        for k in (0, 4, 10):
            browser.run(f"symmb.seek({k})")
            t = 0.2 * k
            assert np.abs(frame(browser, 1)[:3, 3] - [speed * t, -drop * t**2 / 2, 0]).max() < 1e-6
            shown = float(browser.run("document.querySelector('#curves b').textContent"))
            assert abs(shown - speed * t) < 1e-3
    assert not browser.errors


def test_sweeps_that_have_no_sliders(tmp_path):
    scene = load_scene("double_pendulum").with_times([0.0, 0.1])
    grid = mb.sweep(scene, {"l1": [0.9, 1.0]})
    grid.save(tmp_path / "grid.npz")
    of_function = mb.sweep(mb.FunctionSimulator(lambda k: [k], {"k": 1.0}, [0.0], ["x"]), {"k": [1.0, 2.0]})
    failed = mb.sweep(scene, {"l1": [-1.0, 1.0]})
    for sweep, name, words in (
        (grid, "a.png", "need a page"),
        (mb.Sweep.load(tmp_path / "grid.npz"), "a.html", "has no scene"),
        (of_function, "a.html", "has no scene"),
        (mb.simulate(scene, parameters=[{"l1": 0.9}, {"l1": 1.0}]), "a.html", "has no grid"),
        (failed, "a.html", "1 of 2 runs failed"),
        (mb.sweep(scene, {"l1": np.linspace(0.9, 1.1, 501)}), "a.html", "has 501 runs"),
    ):
        refused(words, mb.view, sweep, tmp_path / name)
