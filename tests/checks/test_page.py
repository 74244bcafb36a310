"""What stands on the page of a verification, and in its pictures, is what the evidence
says.
"""

import contextlib
import dataclasses as dc
import hashlib
import html
import io
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import stimlib
from stimlib import Input, Param, Scene, blocks as b, constant
from stimlib.blocks import white_noise
from stimlib.checks import Shows, figures
from stimlib.checks.evidence import Check
from stimlib.checks.page import GROUPS, alike, headline, page
from stimlib.core.definitions import definitions
from stimlib.core.parts import Part
from stimlib.motion import constant_speed, minimum_jerk
from stimlib.run.processor import Change
from stimlib.scenes import ROWS
from stimlib.scenes.about import meanings

TAGS = "<i>&b\x1b[2J"  # markup, and a control character


@pytest.fixture(scope="module")
def bumped():
    scene, motion = stimlib.scenes.bumps(), {"x": constant_speed(0.1, 0.1)}
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.2))


@pytest.fixture(scope="module")
def squeezed():
    scene, motion = stimlib.scenes.squeeze(), {"x1": minimum_jerk(), "x2": minimum_jerk(depth=0.01)}
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 0.5))


@pytest.fixture
def text_of(monkeypatch):
    """The page of an evidence without its pictures, as it is read."""
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])

    def made(e, checks=(), certain=(), what="a rendering"):
        return html.unescape(page(what, list(checks), e, list(certain), None))

    return made


def test_one_check_that_failed_fails_the_page_and_its_row(bumped, text_of):
    good, bad = Check("b", "first", 0.0, 0.0, "t"), Check("e", "second", 1.0, 0.5, "t")
    text = text_of(bumped.evidence, [good, bad])
    for row in (
        '<h1><span class="bad">FAILED against: the law',
        "1 of 2 checks passed",
        '<td class="bad">FAILED</td><td>second</td><td class="n">1</td><td class="n">0.5</td>',
        '<td class="ok">ok</td><td>first</td>',
    ):
        assert row in text
    said = '<h1><span class="ok">Passed against: the law of bumps</span></h1>'
    assert said in text_of(bumped.evidence, [good])


@dc.dataclass(frozen=True, eq=False)
class Doubled(stimlib.Block):
    """Without a law."""

    x: stimlib.Block

    def units(self, *u):
        return u[0]

    @staticmethod
    def step(p, s, x):
        return 2.0 * x, s


class Odd:
    """Motion whose text is no text of ours."""

    def __repr__(self):
        return TAGS

    def __call__(self, t):
        return 0.0 * t


@pytest.mark.parametrize("session", [False, True], ids=["file", "log"])
def test_no_text_of_others_is_read_as_markup(bumped, monkeypatch, session):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])
    monkeypatch.setattr(Scene, "to_dict", lambda scene: {"law": TAGS})
    stored = {
        "channels": [{"name": TAGS, "full_scale": 50.0, "unit": TAGS}],
        "format": TAGS,
        "subtype": TAGS,
        "file_sha256": TAGS,
    }
    names = {
        "source": TAGS,
        "skipped": [TAGS],
        "numbers": [TAGS],
        "motion": {"x": Odd()},
        "path": Path(TAGS),
        "sidecar": stored,
    }
    e = dc.replace(bumped.evidence, **names, session=session)
    checks = [Check(group, TAGS, 0.0, 0.0, TAGS) for group in GROUPS]
    text = page(TAGS, checks, e, [Shows(TAGS, TAGS, 1.0, TAGS, 0.95)], TAGS)
    assert not any(raw in text for raw in ("<i>", "&b", "\x1b"))
    assert text.count("&lt;i&gt;&amp;b\\x1b[2J") >= 29


def test_every_check_is_on_the_page_and_the_laws_of_blocks_are_the_model(bumped, text_of):
    assert {"b", "d", "e", "f"} <= {*[c.group for c in bumped.checks]} <= {*GROUPS}
    checks = [Check(g, f"{g} named: so", 0.0, 0.0, f"{g} told") for g in GROUPS]
    _, _, compared, numbers, certainty, rest = text_of(bumped.evidence, checks).split("<h2>")[:6]
    assert compared.count('<td class="ok">ok</td>') == 7
    assert rest.startswith("Each block and its law")
    assert re.findall("<li>(.*?)</li>", numbers) == bumped.evidence.numbers != []
    assert "one correct rendering in 1000000;" in certainty


def test_what_was_displayed_is_told_in_its_units(bumped, text_of, monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", lambda package: "9.9")  # as installed
    y, shown = bumped.evidence.y, bumped.evidence.y.astype(np.float32).astype(float)
    stored = {
        "format": "WAV",
        "subtype": "FLOAT",
        "file_sha256": "5a",
        "scene_hash": "7b",
        "signal_sha256": "9c",
    }
    stored |= {"channels": [{"name": "voltage", "full_scale": 50.0, "unit": "V"}]}
    e = dc.replace(bumped.evidence, params={"A": 3.0}, seed=7, shown=shown, sidecar=stored)
    rows = dict(re.findall("<tr><th>(.*?)</th><td>(.*?)</td></tr>", text_of(e)))
    wanted = {
        "outputs": "voltage [V]",
        "length": "1600 samples at 8000 Hz, 0.2 s",
        "parameters": f"A = 3: {meanings('bumps')['A']}",
        "seed": "7",
        "stored as": "WAV FLOAT, full scale: voltage 50 V",
        "file hash": "5a",
        "scene hash": e.scene.hash,
        "versions": f"stimlib {stimlib.__version__}, numpy 9.9, scipy 9.9, llvmlite 9.9,"
        " soundfile 9.9, matplotlib 9.9",
    }
    assert {name: rows[name] for name in wanted} == wanted
    motion = np.ascontiguousarray(e.x.T, "<f8").tobytes()
    assert rows["motion, as sampled"].startswith(hashlib.sha256(motion).hexdigest())
    # not of what was stored
    assert rows["signal"].startswith(hashlib.sha256(y.T.astype("<f8").tobytes()).hexdigest())


def test_the_program_of_the_page_makes_the_samples_with_their_seed_and_parameters(
    text_of, tmp_path
):
    scene = Scene({"y": Param("a", 1.0) * white_noise(1) + Input("x", "m") / constant(1.0, "m")})
    motion, params = {"x": constant_speed(0.1, 0.1)}, {"a": 0.50000001}
    r = stimlib.render(scene, motion, 1000, 0.05, params, seed=np.int64(5))
    e = stimlib.verify(scene, motion, r).evidence
    assert "<th>parameters</th><td>a = 0.50000001</td>" in text_of(e)
    _, made, stated = reproduced(text_of(e), tmp_path)
    assert made == stated == hashlib.sha256(e.y.T.astype("<f8").tobytes()).hexdigest()
    assert f"under Python {sys.version_info[0]}.{sys.version_info[1]};" in text_of(e)


def test_a_report_that_failed_says_so_in_every_form_of_it(bumped):
    """And which check it was: in the notebook, the terminal, one line, and JSON."""
    good, bad = Check("b", "first", 0.0, 0.0, TAGS), Check("e", TAGS, 2.0, 0.5, "t")
    e = dc.replace(bumped.evidence, source=TAGS, skipped=["s"], numbers=["n"])
    failed = dc.replace(bumped, checks=[good, bad], evidence=e)
    passed, named = dc.replace(failed, checks=[good]), dc.replace(bad, name="second")
    assert repr(dc.replace(failed, checks=[good, named])).endswith("seed 0: FAILED: second)")
    assert repr(passed).endswith(", 0.2 s at 8000 Hz, seed 0: passed)")
    shown, lines = "<i>&b\\x1b[2J", [line.split() for line in str(failed).splitlines()]
    assert "FAILED" in lines[0] and "passed" in str(passed).splitlines()[0]
    rows = [words[1] for words in lines if "first" in words or shown in words and "(e)" in words]
    assert rows == ["ok", "FAILED"]
    assert any("numbers" in words and "n" in words for words in lines)
    html, told = failed._repr_html_(), failed.to_dict()
    assert ": FAILED</h4>" in html and ": passed</h4>" in passed._repr_html_()
    assert not any(raw in html for raw in ("<i>", "&b", "\x1b")) and "\x1b" not in str(failed)
    assert (told["passed"], passed.to_dict()["passed"]) == (False, True)
    assert [c["passed"] for c in told["checks"]] == [True, False]
    assert (told["numbers"], told["skipped"]) == (["n"], ["s"])


def rendered(scene, motion, fs=8000):
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, fs))


def laws_of(bumped):
    parts = [Part(law, {}) for law in ("wall", "tone", "wall", "bumps", "click", "pulse")]
    return dc.replace(bumped.evidence, scene=Scene(bumped.evidence.scene.outputs, law=tuple(parts)))


def partly():
    scene = Scene.combine(screen=stimlib.scenes.bumps(), mine=Scene({"y": 2 * Input("z")}))
    return rendered(scene, {"screen_x": np.zeros(64), "mine_z": np.ones(64)}).evidence


def lawless(make):
    return rendered(Scene({"y": make(Input("x", "m"))}), {"x": np.ones(64)}).evidence


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (laws_of, "the laws of wall, tone, bumps and 2 more"),
        (lambda _: partly(), "the law of bumps; no law of mine_y as a whole is known"),
        (
            lambda _: lawless(lambda x: 2 * x),
            "the laws of 2 blocks, each by itself; no law of the whole scene is known",
        ),
        (
            lambda _: lawless(Doubled),
            "the laws of 1 block, each by itself (none is known for 1 more);"
            " no law of the whole scene is known",
        ),
    ],
)
def test_the_headline_names_the_laws_and_what_has_none(bumped, text_of, make, said):
    e = make(bumped)
    assert headline(True, e) == f"Passed against: {said}"
    assert ("no law of the whole" in text_of(e)) == ("no law of the whole" in said)


def test_the_law_is_in_words_or_said_to_be_unknown(bumped, text_of):
    assert ROWS["bumps"].words in text_of(bumped.evidence)
    assert "the intended stimulus was not checked" in text_of(lawless(lambda x: 2 * x))


def own_block(tmp_path, motion):
    scene = Scene({"y": Doubled(Input("x", "m"))})
    stimlib.render(scene, {"x": motion}, 8000, 0.1).save(tmp_path / "a.wav", full_scale=1.0)
    return stimlib.verify(scene, {"x": motion}, tmp_path / "a.wav")


def reproduced(text, folder):
    """What the program of a page prints, and what it says that it will."""
    _, program, scene = re.findall("<pre>(.*?)</pre>", text, re.DOTALL)
    (folder / "scene.json").write_text(scene)
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    return program, out.getvalue().strip(), program.split("# ")[-1].strip()


def test_blocks_of_ones_own_are_imported_hashed_and_said_to_be_unchecked(tmp_path, text_of):
    report = own_block(tmp_path, minimum_jerk())
    text = text_of(report.evidence)
    ((name, told),) = definitions(report.evidence.scene).items()
    assert f"<th>own blocks of {name}</th><td>{told['sha256']}" in text
    assert f"<code>{name}</code>.</p>" in text
    said = "Doubled(Input('x')): it states no response"
    assert [text for text in report.evidence.skipped if text.startswith(said)]
    program, made, stated = reproduced(text, tmp_path)
    assert f"\nimport {name}" in program and made == stated


def test_no_program_is_claimed_of_a_function_of_ones_own(tmp_path, text_of):
    text = text_of(own_block(tmp_path, lambda t: 0.01 * np.asarray(t)).evidence)
    assert "parse_source" not in text and "No text here makes the samples again" in text


@pytest.mark.parametrize(
    "change", [Change(5, "A", 2.0, 0.0), Change(0, "A", 2.0, 0.1)], ids=["later", "with a ramp"]
)
def test_changes_are_told_and_then_no_program_makes_the_samples(bumped, text_of, change):
    text, without = (
        text_of(dc.replace(bumped.evidence, changes=[change] * 22)),
        text_of(bumped.evidence),
    )
    told = f"A to 2 at {change.at / 8000:g} s within {change.ramp:g} s"
    assert f"{', '.join([told] * 20)} and 2 more" in text
    assert "import hashlib" not in text and "No text here makes the samples again" in text
    assert "import hashlib" in without and "differences from the scene" not in without


# Pictures -----------------------------------------------------------------------------


def test_the_band_of_a_noise_holds_as_many_false_alarms_as_are_told(squeezed):
    """Two-sided, one in a million for all bands and the trend together; the measured
    power lies in it.
    """
    e = squeezed.evidence
    a, s = squeezed.spectra()["force1"], e.taps[0].spectrum
    bins = np.array([b.bins for b in s.bands])
    outside = stats.gamma.sf(bins * a.high / a.law, bins) + stats.gamma.cdf(
        bins * a.low / a.law, bins
    )
    np.testing.assert_allclose(outside * (bins.size + 1), 1e-6, rtol=1e-6)
    np.testing.assert_allclose(a.measured / a.law, [b.ratio for b in s.bands])
    np.testing.assert_allclose(a.law, e.taps[0].model(a.f))


def test_the_band_of_a_law_is_what_a_difference_can_do(bumped):
    """One whose sign alternates reaches the edge at its frequency, a square wave
    nearly; none passes it.
    """
    size, apart, rng = 1600, 1e-3, np.random.default_rng(1)
    for difference, least in (
        (apart * (-1.0) ** np.arange(size), 1 - 1e-9),
        (apart * np.sign(np.sin(2 * np.pi * 40 / size * (np.arange(size) + 0.5))), 0.8),
        (apart * rng.choice([-1, 1], size), 0.0),
    ):
        e = dc.replace(
            bumped.evidence,
            y=difference[None],
            wanted={"voltage": lambda: (np.zeros(size), apart)},
            taps=[],
        )
        a = figures.spectra_of(e)["voltage"]
        assert least <= (a.measured / a.high).max() <= 1 + 1e-9 and not a.law.any()


def test_pictures_are_of_the_first_outputs_and_say_so(bumped, monkeypatch):
    (y,) = bumped.evidence.scene.outputs.values()
    monkeypatch.setattr(figures, "svg", lambda draw, size: size)
    for count, title in (
        (6, "Signals over time"),
        (7, "Signals over time, the first 6 of 7 outputs"),
    ):
        scene = Scene({f"V{i}": y for i in range(count)})
        row = bumped.evidence.shown[0]
        signals = figures.Signals(
            scene, 8000.0, {"x": row}, {f"V{i}": row for i in range(min(count, figures.OUTPUTS))}
        )
        drawn = dict(
            figures.figures(dc.replace(bumped.evidence, scene=scene, shown=np.array([row] * count)))
        )
        assert drawn[title] == (12, figures.heights(signals)[0])
        assert "What the law is made of" in drawn and {wide for wide, _ in drawn.values()} == {12}


def test_the_page_has_a_line_for_each_class_those_that_nothing_holds_first(text_of):
    x = Input("x", "m")
    total = sum((k * b.velocity(x, 100.0 + k) for k in range(60)), 0.0 * b.velocity(x))
    r = rendered(Scene({"y": total, "z": Doubled(x)}), {"x": np.linspace(0, 0.01, 500)}, 1000)
    part = text_of(r.evidence, r.checks).partition("Each block and its law")[2].partition("<h2>")[0]
    assert part.index("Doubled") < part.index("Velocity") and "no law of its output" in part
    short = part.partition("<details")[0]  # one line for all blocks of a class
    assert short.count("<tr>") < 10 and '<td>Velocity</td><td class="n">61</td>' in short
    found = r.to_dict()["blocks"]
    assert (
        found[0]["class"].endswith("Doubled") and found[0]["why"] and found[0]["smallest"] is None
    )
    velocity = next(b for b in found if b["class"] == "Velocity")
    assert velocity["samples"] == 500 and velocity["error"] <= 1 and 0 < velocity["smallest"] < 1e-6


@pytest.fixture(scope="module")
def hissing():
    """Five gated noises in one output."""
    x = Input("x", "m")
    on, force = b.loading(b.velocity(x, 100.0)), b.spring(x, 1000.0)
    for k in range(5):
        noise = b.enabled(b.lowpass(white_noise(1, k), 200.0 + 10 * k), by=on)
        force = force + noise * constant(0.1, "N")
    return rendered(Scene({"force": force}), {"x": minimum_jerk()(np.arange(8000) / 8000)})


def test_equal_checks_have_one_row_with_the_worst_and_each_noise_has_a_name(hissing, text_of):
    text = text_of(hissing.evidence, hissing.checks, hissing.certainty())
    _, _, compared, _, certainty, *_ = text.split("<h2>")
    outside = re.sub("<details.*?</details>", "", compared)
    for kind, count in (("spectrum", 5), ("independence", 10), ("generator", 5)):
        same = [c for c in hissing.checks if c.name.endswith(f": {kind}")]
        worst = max(same, key=lambda c: c.measured / c.limit)
        row = re.findall(f"<tr>(?:(?!<tr>).)*<td>{kind}, {count} checks</td>.*?</tr>", outside)
        assert len(same) == count and len(row) == 1 and f": {kind}</td>" not in outside
        assert f"{worst.measured:.3g}</td>" in row[0]
        assert f"worst of {worst.name.rpartition(': ')[0]}: " in row[0]
        assert all(compared.count(f"<td>{c.name}</td>") == 1 for c in same), "each is in the list"
        assert len({c.name for c in same}) == count
    assert "spectrum, 5 times; worst of force, white(1, " in certainty and text.count("<h1>") == 1
    for largest, shown in ((9.0, ">9 dB<"), (np.nan, "none, however large")):
        sizes = (1.0, 2.0, largest, 3.0)
        shows = [Shows(f"n{k}: spectrum", "level", v, "dB", 0.95) for k, v in enumerate(sizes)]
        certainty = text_of(hissing.evidence, hissing.checks, shows).split("<h2>")[4]
        assert "spectrum, 4 times; worst of n2" in certainty and shown in certainty


def test_a_check_that_failed_is_in_no_group(hissing, text_of):
    assert alike("abaac", str) == [["a"], ["a"], ["a"], ["b"], ["c"]]
    assert alike("abaaac", str) == [["a", "a", "a", "a"], ["b"], ["c"]]
    bad = [dc.replace(c, limit=-1.0) for c in hissing.checks if c.name.endswith(": spectrum")]
    text = re.sub("<details.*?</details>", "", text_of(hissing.evidence, bad))
    assert all(f'<td class="bad">FAILED</td><td>{c.name}</td>' in text for c in bad)


@pytest.mark.parametrize(
    ("skipped", "items"),
    [
        ([], "<li>nothing</li>"),
        (["a finger that was not there"], "<li>a finger that was not there</li>"),
        (
            [f"noise {k}: too short" for k in range(5)] + ["another: reason"],
            "<li>noise 0 and 4 more: too short</li><li>another: reason</li>",
        ),
    ],
)
def test_equal_reasons_are_one_item(bumped, text_of, skipped, items):
    text = text_of(dc.replace(bumped.evidence, skipped=skipped))
    assert f"<h2>Not checked</h2><ul>{items}</ul>" in text
