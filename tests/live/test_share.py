"""A scene as one HTML file: its samples in a browser without a network, its sound, and
that no text in it becomes code.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import zlib
from base64 import b64decode
from contextlib import closing, redirect_stderr
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from commands import ran
from live.chromium import Browser, where
from live.shared import OFFLINE, need_compiler, numbers
from refusals import refused
from waiting import until

import stimlib
from stimlib import BadValue, Input, MissingPackage, Param, Scene, SinkError, UnknownName
from stimlib.live import notebook
from stimlib.live.describe import full_scales, page_rate
from stimlib.live.share import ORDERS, WEB, _seconds, compiled, packed, page_of, share
from stimlib.motion import minimum_jerk, ramp_and_hold, sinusoid
from stimlib.scenes import ROWS, squeeze
from stimlib.scenes.about import PAPERS, meanings
from stimlib.system import cache_folder

FS, N = 8000, 4000
MOTION = {"x1": sinusoid(0.01, 2.0, 0.01), "x2": sinusoid(0.01, 3.0, 0.01)}
CITED = "A. Author: Volumes <that> vibrate & hum, 2026"
EVIL = "\"'></title></script><script>window.hacked = 1</script><img src=x onerror=hacked=1>&lt;"


def test_motion_is_packed_without_loss():
    t = np.arange(8000) / FS
    smooth = np.array([0.02 * np.sin(3 * t), np.full(8000, -0.0)])
    odd = np.random.default_rng(1).standard_normal((3, 100))
    odd[0, :4] = np.inf, np.nan, 5e-324, -1e308
    for x in (smooth, odd, odd[:, :1]):
        made = packed(x)
        planes = np.frombuffer(zlib.decompress(b64decode(made["data"])), np.uint8)
        words = np.ascontiguousarray(planes.reshape(8, -1).T).view("<i8").reshape(x.shape)
        for _ in range(made["order"]):
            words = np.cumsum(words, axis=1)
        assert words.tobytes() == x.tobytes()
    steps = []
    made = packed(smooth, lambda done, text: steps.append(done))
    assert made["order"] > 1 and len(made["data"]) < 3 * 8000
    assert sum(steps) == 8000 * ORDERS  # what the bar counts to, besides the rendering


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_fma_and_fmod_of_the_page_are_those_of_the_c_library(tmp_path):
    words = "gcc -O1 -ffp-contract=off -w -o fma -I".split()
    source = Path(__file__).with_name("fma.c")
    subprocess.run([*words, WEB.parent, source, "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "fma"], capture_output=True, text=True).stdout == "0"


def empty(title):
    """A page of a scene that does nothing, with texts of others everywhere."""
    hello = {"title": title, "fs": FS, "inputs": [], "params": [], "view": None, "alone": "yes"}
    hello["outputs"] = [{"name": title, "unit": title, "full": 1.0}]
    hello["about"] = {
        "do": title,
        "felt": [title],
        "laws": [title],
        "sources": [title],
        "fixed": [],
    }
    data = {
        "hello": hello,
        "facts": [[title, title]],
        "sources": {},
        "held": [],
        "lifted": [],
        "wasm": title,
    }
    data["cite"] = title
    return page_of(title, data | {"motion": None, "samples": 0, "sha256": ""})


def test_a_page_loads_nothing_and_no_text_becomes_markup():
    page = empty(EVIL)
    assert len(re.findall("<script", page)) == 3 == page.count("</script>")
    assert "<img" not in page and page.count("window.hacked") == 12
    assert not re.findall(r"<\w+[^<>]+(?:src|href)=\"(?!data:,)", page)
    (policy,) = re.findall(r'Content-Security-Policy" content="(.+)">', page)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "connect-src" not in policy and "unsafe-inline" not in policy
    assert not re.findall(r"^import |^export ", page, re.M)


@pytest.fixture
def clang(tmp_path):
    """Gives the text of a program that stands in for the compiler."""
    if os.name == "nt":
        pytest.skip("the stand-in for a compiler is a shell script")

    def write(text):
        (tmp_path / "clang").write_text(text)
        (tmp_path / "clang").chmod(0o755)

    return write


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "neither clang nor zig is installed.*pip install ziglang"),
        ("not a program", "CLANG.*Exec format error"),
        ("#!/nothing/here\n", "CLANG.*No such file"),
        ("#!/bin/sh\nexit 0\n", "CLANG.*No such file.*page.wasm"),
        ("#!/bin/sh\necho no wasm-ld here >&2\nexit 1\n", "clang says: no wasm-ld here"),
        ("#!/bin/sh\nexec /bin/sleep 60\n", "CLANG.*was stopped after 0.2 s"),
    ],
)
def test_a_compiler_that_is_missing_or_does_not_work_is_named(
    clang, monkeypatch, tmp_path, text, says
):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("stimlib.live.share.PATIENCE", 0.2)
    if text:
        clang(text)
    refused(MissingPackage, says.replace("CLANG", f"{tmp_path}/clang"), compiled, tmp_path)


def test_a_page_that_is_stopped_leaves_the_old_file_and_nothing_else(clang, tmp_path):
    folder, path = tmp_path / "temporary", tmp_path / "a.html"
    folder.mkdir()
    path.write_text("old")
    clang("#!/bin/sh\ntouch begun\nexec /bin/sleep 60\n")
    words = [sys.executable, "-m", "stimlib", "share", "tone", "--out", path]
    env = os.environ | {"PATH": f"{tmp_path}:/usr/bin:/bin", "TMPDIR": str(folder)}
    env |= {"STIMLIB_CACHE": str(cache_folder.chosen())}  # it may be a temporary one
    job = subprocess.Popen(words, env=env, stderr=subprocess.PIPE)
    until(lambda: [*folder.glob("*/begun")])
    job.terminate()
    said = job.communicate()[1].decode()
    assert job.returncode == 143 and not re.sub("compiling for this machine.*\n", "", said)
    assert path.read_text() == "old" and not list(folder.iterdir())


@pytest.mark.parametrize(
    ("error", "says", "fs", "how"),
    [
        (UnknownName, "x is missing", FS, {"motion": {}}),
        (BadValue, "motion of x", FS, {"motion": {"x": 3}}),
        (BadValue, "finite", FS, {"motion": {"x": np.full(9, np.nan)}}),
        (UnknownName, "range: there is no input or parameter 'z'", FS, {"ranges": {"z": (0, 1)}}),
        (BadValue, "fs = 0", 0, {}),
        # before a second of samples is made: at 1e9 Hz, 8 GB
        (BadValue, "give at most 768000 Hz", 1e6, {}),
    ],
)
def test_what_is_refused(error, says, fs, how):
    refused(error, says, share, Scene({"y": 2 * Input("x")}), fs, **how)


def test_no_page_is_faster_than_it_can_present():
    scene = Scene({"y": 2 * Input("x")})
    refused(BadValue, "at most 768000 Hz", full_scales, scene, 1e6, {"x": (0.0, 1.0)})
    assert page_rate(768000) == 768000.0


@pytest.mark.parametrize(
    ("motions", "seconds"),
    [
        ({"x1": minimum_jerk(), "x2": minimum_jerk(rise=0.25)}, 4.6),  # both rest
        ({"x1": minimum_jerk(start=0.01, rest=0.0)}, 4.8),  # rests as it turns
        ({"x1": minimum_jerk(), "x2": sinusoid(0.01, 1.0)}, 5.0),  # never
        ({"x1": ramp_and_hold(0.01, 0.2, 0.5)}, 5.0),  # does not come back
        ({"x1": np.zeros_like}, 5.0),  # does not go
        ({"x1": minimum_jerk(), "x2": np.zeros_like}, 4.8),  # one of two goes
        ({"x1": minimum_jerk(), "x2": np.zeros(4000)}, 0.5),
    ],
)
def test_a_motion_without_an_end_is_shared_until_it_rests(motions, seconds):
    assert _seconds(squeeze(fingers=len(motions)), motions, FS) == seconds


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    need_compiler()
    path = tmp_path_factory.mktemp("shared") / "squeeze.html"
    said = StringIO()
    said.isatty = lambda: True
    with redirect_stderr(said):
        page = share(squeeze(), FS, path, MOTION, N / FS, title=EVIL, cite=CITED)
    assert "packing the motion" in said.getvalue() and "100%" in said.getvalue()
    return path, page


def test_a_page_has_the_hash_of_the_rendering(made):
    path, page = made
    y = stimlib.render(squeeze(), MOTION, FS, N / FS).y
    assert page.sha256 == hashlib.sha256(y.astype("<f8").tobytes()).hexdigest()
    assert path.read_text("utf-8") == page.page and page.samples == N
    assert len(page.page) < 250_000 and squeeze().hash in page.page


def test_a_notebook_shows_it_where_no_port_can_be_opened(monkeypatch):
    need_compiler()

    def closed(*given, **words):
        raise SinkError("no port")

    monkeypatch.setattr(notebook, "Server", closed)
    scene = Scene({"y": Param("k", 2.0) * Input("x")})
    page = scene.live(1000, 4.0, params={"k": 3.0}, title="A <b>")
    shown = page._repr_html_()
    assert shown.startswith('<iframe srcdoc="') and '"value": 3.0' in page.page
    assert shown.count("<") == 2 and "A &amp;lt;b&amp;gt;" in shown
    refused(SinkError, "no port", scene.live, 1000, 4.0, port=80)
    wide = share(scene, 1000, params={"k": 8.0})  # a slider reaches where it begins
    assert '"value": 8.0, "low": 0.0, "high": 8.0' in wide.page


def test_the_command_writes_a_page(tmp_path):
    need_compiler()
    words = ["share", "tone", "--seconds", "0.1", "--out", tmp_path / "a.html"]
    said = json.loads(ran([*words, "--json"]).stdout)
    page = (tmp_path / "a.html").read_text("utf-8")
    assert said["bytes"] == len(page.encode()) and said["samples"] == 800
    assert said["sha256"] in page and "<title>tone</title>" in page
    assert "the page checks 800 samples" in ran(words).stdout
    recorded = tmp_path / "hand.csv"
    recorded.write_text("t_s,x_m\n0,0\n0.1,0.01\n")
    words = ["share", "wall", "--out", tmp_path / "b.html"]
    ran([*words, "--motion", recorded, "--map", "x=x_m", "--max-gap", "1"])
    page = (tmp_path / "b.html").read_text("utf-8")
    assert '"0.1 s"' in page and "x: recording ('hand.csv'" in page and str(tmp_path) not in page
    assert "has no samples to check" in ran(words).stdout


pytestmark = pytest.mark.xdist_group("browser")


@pytest.fixture(scope="module")
def page(made):
    if where() is None:
        pytest.skip("Chromium is not installed: tests/devices/install.sh installs it")
    with closing(Browser(OFFLINE)) as browser:
        page = browser.page(made[0].as_uri())
        page.until("window.scene?.checked")
        yield page


def test_the_page_computes_the_samples_of_stimlib(made, page):
    found = page.js("scene.checked")
    assert found["same"] and found["sha256"] == made[1].sha256
    assert found["block"] == 16.0  # ms
    assert "bit for bit" in page.js("document.querySelector('#checked').textContent")
    assert page.complaints() == [] and not page.js("window.hacked")
    assert page.js("document.querySelector('h1').textContent") == EVIL


@pytest.mark.parametrize("rate", [FS, 48000])
def test_sound_begins_and_ends_without_a_click(page, rate):
    """The recorded motion as it is heard; at another rate it is interpolated."""
    length = N * rate // FS + rate // 10
    y = numbers(
        page,
        f"""(async () => {{
      const context = new OfflineAudioContext(1, {length}, {rate});
      const node = await scene.worklet(context);
      node.connect(context.destination);
      node.port.postMessage({{ start: {{ params: [], sources: scene.given(), session: 1 }} }});
      await new Promise(resolve => setTimeout(resolve, 100));
      return Float64Array.from((await context.startRendering()).getChannelData(0));
    }})()""",
    )[0]
    full = page.js("scene.hello.outputs[0].full")
    want = stimlib.render(squeeze(), MOTION, FS, N / FS)["force1"] / full
    at = np.arange(length) * FS / rate - 2  # the interpolation looks ahead
    middle = (at > 0.025 * FS) & (at < N - 0.025 * FS)
    error = np.abs(y - np.interp(at, np.arange(N), want))[middle].max()
    assert error < (1e-7 if rate == FS else 2e-3)
    assert abs(y[0]) < 1e-3 and np.abs(np.diff(y)).max() < 0.01 < np.abs(y).max()
    assert np.all(y[-rate // 20 :] == 0)


def test_a_recording_plays_and_a_parameter_changes_it(page):
    page.click("#run")
    page.until("document.querySelector('#state').textContent === 'running'")
    page.js("""window.taken = []; scene.tap = (all, n, first) => {
      if (!first) taken = [];
      taken.push(...all.subarray(2 * n, 3 * n)); // the first output
    }""")
    page.click("#record")  # after a fade
    ended = "document.querySelector('#log').textContent === 'The recorded motion has ended.'"
    page.until(f"{ended} && taken.length >= {N}")
    got = numbers(page, "Float64Array.from(taken)")[0]  # to the last sample, and none after it
    want = stimlib.render(squeeze(), MOTION, FS, N / FS)["force1"]
    assert got.tobytes() == want.tobytes()
    page.js("taken = []")
    page.js("const k = document.querySelector('#param-k'); k.value = 100; k.onchange()")
    page.click("#record")
    page.until(f"{ended} && taken.length >= {N}")
    assert abs(page.js(f"taken[{N - 1}]")) < 0.2 * abs(want[-1]) + 1
    assert page.complaints() == []


WATCH = """
  window.told = []; window.seen = []; window.reports = []; window.newest = {};
  const { tell, onmessage } = scene;
  scene.tell = m => { told.push(m); tell.call(scene, m); };
  scene.tap = (all, n, first) => {
    newest = { all, n, first, x1: all[n - 1] };
    seen.push([scene.session, first, scene.phase]);
  };
  scene.onmessage = m => {
    const { samples, text } = m.data;
    if (samples) newest.shown = [...new Float32Array(samples, 48)];
    if (text?.is === "report") reports.push([text.at, text.seconds, newest.first + newest.n]);
    onmessage(m);
  };
  window.filters = [];
  window.BiquadFilterNode = class extends BiquadFilterNode {
    constructor(context, o) { super(context, o); filters.push([o.type, o.frequency]); }
  };
"""


def test_what_is_done_by_hand_reaches_the_audio_thread_and_what_comes_back_is_said(page):
    def chosen(css, value):
        page.js(
            f"(e => {{ e.value = {value!r}; e.dispatchEvent(new Event('change')); }})"
            f"(document.querySelector({css!r}))"
        )

    page.reload()
    page.until("window.scene?.checked")
    page.js(WATCH)
    assert "follows a pointer 78 ms later" in page.js(
        "document.querySelector('#behind').textContent"
    )
    chosen("#heard", "1")
    page.click("#run")
    page.until("seen.length > 3")
    assert {"listen": 1} in page.js("told.slice(-3)")  # also what was chosen before
    x, y, wide, high = page.box("#field")
    page.mouse("Pressed", x + 0.4 * wide, y + high / 2)
    page.mouse("Moved", x + 0.7 * wide, y + high / 2)
    page.until("newest.x1 > 0.6 * scene.sources.x1.high && scene.sound.played.length > 0")
    assert page.js("document.querySelector('#gaps').textContent") == "none"
    # no more than the age of the context, and no less than the delay of a pointer
    delay, age = page.js("[scene.sound.played[0], 1e3 * scene.context.currentTime]")
    assert 1e3 / 60 < delay < age
    page.mouse("Released", x + 0.7 * wide, y + high / 2)
    chosen("#param-k", "100")
    assert page.js("told.at(-1)") == {"set": [0, 100, 160]}  # 20 ms
    page.click("#record")
    page.until("scene.recorded && newest.first > 1000 && seen.at(-1)[0] === scene.session")
    moves = "The recorded motion moves x1, x2; it is at x1 = "
    page.until(f"document.querySelector('#where').textContent.startsWith({moves!r})")
    chosen("#sources fieldset:nth-child(2) select", "value")
    assert page.js("told.at(-1).choose.x2.from") == "value"
    assert page.js("document.querySelector('#log').textContent") == ""
    page.click("#record")
    page.until("scene.recorded && seen.at(-1)[0] === scene.session && newest.first > 500")
    page.click("#run")
    page.until("scene.phase === 'idle'")
    assert page.js("document.querySelector('#log').textContent") == ""  # stopped, not ended
    page.js("scene.postMessage({ do: 'stop' })")
    assert page.js("scene.phase") == "idle"
    # the end of a session before is not the end of the next
    session, phases = page.js("[scene.session, seen.filter(([, first]) => first > 300)]")
    assert {p for s, _, p in phases if s == session - 1} == {"running"}
    for at, seconds, end in page.js("reports"):
        assert at == end == seconds * FS
    # clips on either side, values in full scale, vibration that begins at rest, and
    # nothing of a session before
    full = page.js("scene.hello.outputs.map(o => o.full)")
    page.js(f"""scene.clips = {{}};
      scene.take({{ all: Float64Array.of(0, 0, {-2 * full[0]}, {full[1] / 2}), n: 1, first: 0, t: 0,
        session: scene.session }})""")
    assert page.js("newest.shown") == [0, 0, -2, 0.5, 0, 0]
    assert page.js("scene.clips") == {"force1": {"full": 1}}
    page.js("newest.shown = 0; scene.take({ all: new Float64Array(4), n: 1, session: -1 })")
    assert page.js("newest.shown") == 0
    assert page.js("filters") == [["highpass", 40]] * 2
    for open in (1, 0):
        page.click("#sound")
        page.until(f"Math.abs(scene.sound.open.gain.value - {open}) < 0.05")
    assert page.complaints() == []


SHOWN = """[...document.querySelectorAll('.plot canvas, #field')].filter(e => e.checkVisibility())
  .map(e => [e.id || e.parentElement.className, e.getBoundingClientRect()])
  .map(([name, {top, bottom}]) => [name, top, bottom])"""


def test_a_phone_shows_what_vibrates_above_the_finger_and_speaks_of_touch(page):
    page.call("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        page.size(390, 844)
        page.reload()
        page.until("window.scene?.checked")
        (first, top, _), (field, _, bottom), *_ = page.js(SHOWN)
        assert (first, field) == ("plot vibration", "field")
        assert bottom - top < 844 - page.box(".bar")[3]  # both are seen, below the bar
        help = "['#touches', '#keys'].map(css => document.querySelector(css).checkVisibility())"
        assert page.js(help) == [True, False]
        assert page.js("document.documentElement.scrollWidth") == 390
        label = "getComputedStyle(document.querySelector('.theme')).fontSize"
        assert float(page.js(label).removesuffix("px")) > 12
        assert not page.js("document.querySelector('#sources').checkVisibility()")  # folded
        page.call("Emulation.setTouchEmulationEnabled", enabled=False)
        assert page.js(help) == [False, True]
    finally:
        page.call("Emulation.setTouchEmulationEnabled", enabled=False)
        page.size(1240, 900)


def test_a_page_says_what_it_is_in_the_words_of_the_report(made, page):
    text = page.js("document.body.innerText")
    row = ROWS["squeeze"]
    assert row.felt in text and f"Press Start and {row.do}; or play" in text
    law = page.js("document.querySelector('#laws').textContent")
    plain = {"\N{GREEK SMALL LETTER TAU}": "tau", "\N{MINUS SIGN}": "-", "Source: ": "("}
    for sign, word in plain.items():
        law = law.replace(sign, word)
    words = re.sub(r"_(\w)|; ", lambda m: m[1] or "", row.words)
    assert re.sub(r"[ .;)]", "", law) == re.sub(r"[ .;)]", "", words)
    assert page.js("document.querySelector('.formula').textContent").endswith("else F = k x")
    names = "['#meter', '#param-level'].map(q => document.querySelector(q).ariaLabel)"
    meter, level = page.js(names)
    assert meter.startswith("Output level: ") and level == "level, parameter"
    params = page.js("[...document.querySelectorAll('.param')].map(e => e.innerText)")
    about = [f"{n}\n{u}" for n, u in zip("k A level".split(), ("N/m", "", ""), strict=True)]
    for said, start, meaning in zip(params, about, meanings("squeeze").values(), strict=True):
        assert said.startswith(start.strip()) and meaning[:12] in said
    assert "\nSources\n" in text and "\nto cite\n" in text
    assert PAPERS["UGrip paper"] in text and CITED in text and squeeze().hash in text


def test_a_page_says_if_samples_differ(made, page, tmp_path):
    path = tmp_path / "other.html"
    path.write_text(made[1].page.replace(made[1].sha256, "0" * 64), "utf-8")
    page.go(path.as_uri())
    page.until("document.querySelector('#checked').className === 'bad'")
    said = page.js("document.querySelector('#checked').textContent")
    assert said.endswith(f"the samples differ: their SHA-256 is {made[1].sha256}.")


def test_a_page_says_which_output_is_not_finite_and_may_start_again(page, tmp_path):
    outputs = {"a": 1.0 * Input("x", "m"), "b": Param("p", 1.0) / Param("q", 1.0)}
    share(Scene(outputs), FS, tmp_path / "b.html", params={"q": 0.0})
    other = page.browser.page((tmp_path / "b.html").as_uri())
    identity = other.js("document.querySelector('#identity').innerText")
    assert identity.endswith("so there are no samples to check.")
    note = "document.querySelector('#note').textContent"
    other.click("#run")
    other.until(f"scene.phase === 'idle' && {note} === 'Not finite: b. It was faded out.'")
    other.js("scene.set({name: 'q', value: 1.0})")
    other.click("#run")
    other.until(f"scene.next > {FS // 2} && scene.phase === 'running' && {note} === ''")
    said = "['#do', '#about'].map(q => (e => e.hidden || e.innerText)(document.querySelector(q)))"
    assert other.js(said) == ["Press Start and move a finger over the field.", True]
    assert other.complaints() == []
    other.close()


def test_no_text_of_others_runs(page, tmp_path):
    path = tmp_path / "evil.html"
    path.write_text(empty(EVIL), "utf-8")
    page.go(path.as_uri())
    page.until("document.querySelector('.facts dd')?.textContent")
    assert not page.js("window.hacked") and page.js("document.images.length") == 0
    assert page.js("document.title") == EVIL
    page.click("#run")
    page.until("document.querySelector('#note').textContent.startsWith('This browser cannot')")
