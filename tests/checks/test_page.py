"""What stands on the page of a verification, and in its pictures, is what the evidence
says.
"""

import dataclasses as dc
import hashlib
import html
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from test_scene import Doubled

import stimlib
from stimlib import Input, Param, Scene, blocks as b, constant
from stimlib.blocks import white_noise
from stimlib.checks import figures
from stimlib.checks.evidence import Check, gather
from stimlib.checks.page import GROUPS, alike, headline, page
from stimlib.checks.power import Shows
from stimlib.core.definitions import definitions
from stimlib.core.parts import Part
from stimlib.motion.generators import constant_speed, minimum_jerk
from stimlib.run.processor import Change
from stimlib.scenes import ROWS

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
    assert (
        '<h1><span class="bad">FAILED against: the law' in text and "1 of 2 checks passed" in text
    )
    assert (
        '<td class="bad">FAILED</td><td>second</td><td class="n">1</td><td class="n">0.5</td>'
        in text
    )
    assert '<td class="ok">ok</td><td>first</td>' in text
    said = '<h1><span class="ok">Passed against: the law of bumps</span></h1>'
    assert said in text_of(bumped.evidence, [good])


def test_a_name_with_tags_stays_a_name(bumped, monkeypatch):
    monkeypatch.setattr("stimlib.checks.page.figures", lambda e: [])
    text = page("a <b>name</b>", [], dc.replace(bumped.evidence, source="<i>file</i>"), [], None)
    assert "<b>" not in text and "<i>" not in text and text.count("a &lt;b&gt;name") == 2


@dc.dataclass(frozen=True, eq=False)
class Bare(stimlib.Block):
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
    groups = [c.group for c in bumped.checks]
    assert {"b", "d", "e", "f"} <= {*groups} <= {*GROUPS}
    text = text_of(
        bumped.evidence, [Check(g, f"{g} named: so", 0.0, 0.0, f"{g} told") for g in GROUPS]
    )
    _, _, compared, numbers, certainty, rest = text.split("<h2>")[:6]
    assert compared.count('<td class="ok">ok</td>') == 7 and rest.startswith(
        "Each block and its law"
    )
    assert re.findall("<li>(.*?)</li>", numbers) == bumped.evidence.numbers != []
    assert "one correct rendering in 1000000;" in certainty
    for said in (["a finger that was not there"], []):
        text = text_of(dc.replace(bumped.evidence, skipped=said))
        assert f"<h2>Not checked</h2><ul><li>{said[0] if said else 'nothing'}</li></ul>" in text


def test_what_was_displayed_is_told_in_its_units(bumped, text_of):
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
        "parameters": "A = 3",
        "seed": "7",
        "stored as": "WAV FLOAT, full scale: voltage 50 V",
        "file hash": "5a",
        "scene hash": e.scene.hash,
    }
    assert {name: rows[name] for name in wanted} == wanted
    # not of what was stored
    assert rows["signal"].startswith(hashlib.sha256(y.T.astype("<f8").tobytes()).hexdigest())


def test_the_program_of_the_page_makes_the_samples_with_their_seed_and_parameters(
    text_of, tmp_path, monkeypatch, capsys
):
    scene = Scene({"y": Param("a", 1.0) * white_noise(1) + Input("x", "m") / constant(1.0, "m")})
    motion, params = {"x": constant_speed(0.1, 0.1)}, {"a": 0.5}
    e = gather(scene, motion, stimlib.render(scene, motion, 1000, 0.05, params, seed=5))
    text = text_of(e)
    _, program, stored = re.findall("<pre>(.*?)</pre>", text, re.DOTALL)
    (tmp_path / "scene.json").write_text(stored)
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    made = capsys.readouterr().out.strip()
    assert (
        made
        == hashlib.sha256(e.y.T.astype("<f8").tobytes()).hexdigest()
        == program.split("# ")[-1].strip()
    )
    assert f"under Python {sys.version_info[0]}.{sys.version_info[1]};" in text


def test_a_report_that_failed_says_so_in_every_form_of_it(bumped):
    """And which check it was: in the notebook, the terminal, one line, and JSON."""
    good, bad = Check("b", "first", 0.0, 0.0, TAGS), Check("e", TAGS, 2.0, 0.5, "t")
    failed = dc.replace(
        bumped,
        checks=[good, bad],
        evidence=dc.replace(bumped.evidence, source=TAGS, skipped=["s"], numbers=["n"]),
    )
    passed = dc.replace(failed, checks=[good])
    assert passed.passed and not failed.passed
    shown = "<i>&b\\x1b[2J"
    named = repr(dc.replace(failed, checks=[good, dc.replace(bad, name="second")]))
    assert named.endswith(", 0.2 s at 8000 Hz, seed 0: FAILED: second)") and repr(passed).endswith(
        "seed 0: passed)"
    )
    lines = [line.split() for line in str(failed).splitlines()]
    assert "FAILED" in lines[0] and "passed" in str(passed).splitlines()[0]
    assert [
        words[1] for words in lines if "first" in words or shown in words and "(e)" in words
    ] == ["ok", "FAILED"]
    assert "\x1b" not in str(failed) and any("numbers" in words and "n" in words for words in lines)
    html = failed._repr_html_()
    assert (
        ": FAILED</h4>" in html
        and ": passed</h4>" in passed._repr_html_()
        and not any(raw in html for raw in ("<i>", "&b", "\x1b"))
    )
    told = failed.to_dict()
    assert (told["passed"], passed.to_dict()["passed"]) == (False, True)
    assert [c["passed"] for c in told["checks"]] == [True, False] and (
        told["numbers"],
        told["skipped"],
    ) == (["n"], ["s"])


def test_the_law_is_in_words_or_said_to_be_unknown(bumped, text_of):
    x = Scene({"y": 2 * Input("x")})
    unknown = stimlib.verify(
        x, {"x": np.ones(64)}, stimlib.render(x, {"x": np.ones(64)}, 8000)
    ).evidence
    text, none = text_of(bumped.evidence), text_of(unknown)
    assert ROWS["bumps"].words in text and "no law of the whole scene" not in text
    head = none.partition("<h1>")[2].partition("</h1>")[0]
    assert "Passed against: the laws of its 2 blocks, each by itself; no law of the whole" in head
    assert "together are the intended stimulus was not checked" in none


def test_the_headline_names_three_laws_and_counts_blocks_that_have_none(bumped):
    parts = [Part(law, {}) for law in ("wall", "tone", "wall", "bumps", "click", "pulse")]
    e = dc.replace(bumped.evidence, scene=Scene(bumped.evidence.scene.outputs, law=tuple(parts)))
    said = "Passed against: the laws of wall, tone, bumps and 2 more"
    assert headline(True, e) == said
    x = Input("x", "m")
    report = stimlib.verify(
        s := Scene({"y": Bare(x)}), {"x": np.ones(64)}, stimlib.render(s, {"x": np.ones(64)}, 8000)
    )
    assert " of its 1 blocks, each by itself (1 more have none)" in headline(True, report.evidence)


def test_the_headline_names_outputs_whose_law_is_not_known():
    scene = Scene.combine(screen=stimlib.scenes.bumps(), mine=Scene({"y": 2 * Input("z")}))
    motion = {"screen_x": np.zeros(64), "mine_z": np.ones(64)}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000))
    said = "Passed against: the law of bumps; no law of mine_y as a whole is known"
    assert headline(report.passed, report.evidence) == said


def test_an_error_that_is_never_seen_is_said_to_be_so(bumped, text_of):
    text = text_of(
        bumped.evidence,
        certain=[Shows("a", "level", 0.25, "dB", 0.95), Shows("b", "slope", np.nan, "dB", 0.95)],
    )
    assert (
        '<td>level</td><td class="n">0.25 dB</td><td>95%' in text
        and '<td class="n">none, however large</td>' in text
    )


def test_a_parameter_is_asked_up_to_all_of_it_and_only_where_there_is_a_law(bumped, text_of):
    asked, nothing = (
        "The law of the scene was also computed",
        Shows("law of the scene", "b", np.nan, "of it", 1.0),
    )
    text = text_of(bumped.evidence, certain=[nothing])
    # three times b might be seen
    assert '<td class="n">none, up to all of it</td>' in text and asked in text
    assert asked not in text_of(bumped.evidence, certain=[Shows("a", "level", 0.25, "dB", 0.95)])


def own_block(tmp_path, motion):
    scene = Scene({"y": Doubled(Input("x", "m"))})
    stimlib.render(scene, {"x": motion}, 8000, 0.1).save(tmp_path / "a.wav", full_scale=1.0)
    return stimlib.verify(scene, {"x": motion}, tmp_path / "a.wav")


def test_blocks_of_ones_own_are_imported_hashed_and_said_to_be_unchecked(
    tmp_path, text_of, monkeypatch, capsys
):
    report = own_block(tmp_path, minimum_jerk())
    text = text_of(report.evidence)
    (told,) = definitions(report.evidence.scene).items()
    assert (
        f"<th>own blocks of {told[0]}</th><td>{told[1]['sha256']}" in text
        and f"<code>{told[0]}</code>.</p>" in text
    )
    assert [
        s
        for s in report.evidence.skipped
        if s.startswith("Doubled(Input('x')): it states no response")
    ]
    _, program, scene = re.findall("<pre>(.*?)</pre>", text, re.DOTALL)
    (tmp_path / "scene.json").write_text(scene)
    monkeypatch.chdir(tmp_path)
    assert f"\nimport {told[0]}" in program
    exec(program, {})
    assert capsys.readouterr().out.strip() == program.split("# ")[-1].strip()


def test_no_program_is_claimed_of_a_function_of_ones_own(tmp_path, text_of):
    text = text_of(own_block(tmp_path, lambda t: 0.01 * np.asarray(t)).evidence)
    assert "parse_source" not in text and "No text here makes the samples again" in text


@pytest.mark.parametrize(
    "change", [Change(5, "A", 2.0, 0.0), Change(0, "A", 2.0, 0.1)], ids=["later", "with a ramp"]
)
def test_changes_are_told_and_then_no_program_makes_the_samples(bumped, text_of, change):
    text = text_of(dc.replace(bumped.evidence, changes=[change] * 22))
    told = f"A to 2 at {change.at / 8000:g} s within {change.ramp:g} s"
    assert f"{', '.join([told] * 20)} and 2 more" in text
    assert text.count(told) == 20 + 7 * (text.count("seed 0, A to 2"))
    assert "import hashlib" not in text and "No text here makes the samples again" in text
    assert "import hashlib" in text_of(
        bumped.evidence
    ) and "differences from the scene" not in text_of(bumped.evidence)


def test_motion_that_is_an_array_is_told_as_such_and_hashed_by_samples(squeezed, text_of):
    e = dc.replace(
        squeezed.evidence, motion=squeezed.evidence.motion | {"x2": squeezed.evidence.x[1]}
    )
    text = text_of(e)
    assert "x2: array of 4000 samples" in text and "import hashlib" not in text
    for rows, what in ((e.x, "motion, as sampled"), (e.y, "signal")):
        digest = hashlib.sha256(rows.T.astype("<f8").tobytes()).hexdigest()
        assert re.search(f"{what}</th><td>{digest}", text), what


# Pictures -----------------------------------------------------------------------------
def test_a_finger_is_shown_by_its_vibration_rate_and_gate(squeezed, monkeypatch):
    drawn = []
    monkeypatch.setattr(figures, "over_time", lambda *a: None)
    monkeypatch.setattr(figures, "close_by", lambda *a: None)
    monkeypatch.setattr(figures, "curve", lambda ax, t, y, **style: drawn.append(y))
    e = squeezed.evidence
    assert [title for title, _ in figures.figures(e)][2].startswith("Vibration, rate and gate")
    for k, f in enumerate(e.fingers.values()):
        for got, want in zip(drawn[3 * k : 3 * k + 3], (e.y[k] - f.mean, f.v, f.gate), strict=True):
            np.testing.assert_array_equal(got, want)


def test_the_law_is_drawn_where_it_is_best_seen(bumped, monkeypatch):
    drawn = []
    monkeypatch.setattr(figures, "close_by", lambda *a: None)
    monkeypatch.setattr(
        figures, "over_time", lambda fig, rows, fs, start=0: drawn.append((rows, start))
    )
    e = dc.replace(bumped.evidence, closeup=slice(100, 300))
    list(figures.figures(e))
    (whole, _), (rows, start) = drawn
    assert (
        start == 100 and {r.y.size for r in rows} == {200} and {r.y.size for r in whole} == {1600}
    )
    assert [r.name for r in rows][-2:] == list(e.curves) == ["envelope", "carrier"]


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
    alternating = apart * (-1.0) ** np.arange(size)
    square = apart * np.sign(np.sin(2 * np.pi * 40 / size * (np.arange(size) + 0.5)))
    for difference, least in (
        (alternating, 1 - 1e-9),
        (square, 0.8),
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


def test_the_page_names_each_block_those_that_nothing_holds_first(tmp_path):
    x = stimlib.Input("x", "m")
    scene = stimlib.Scene({"y": 2.0 * stimlib.blocks.velocity(x, 100.0), "z": Bare(x)})
    r = stimlib.verify(
        scene,
        {"x": np.linspace(0, 0.01, 500)},
        stimlib.render(scene, {"x": np.linspace(0, 0.01, 500)}, 1000),
    )
    r.to_html(tmp_path / "a.html")
    part = (
        (tmp_path / "a.html")
        .read_text()
        .partition("Each block and its law")[2]
        .partition("<h2>")[0]
    )
    assert part.index("Bare") < part.index("Velocity") and "no law of its output" in part
    found = r.to_dict()["blocks"]
    assert found[0]["class"].endswith("Bare") and found[0]["why"] and found[0]["smallest"] is None
    velocity = next(b for b in found if b["class"] == "Velocity")
    assert velocity["samples"] == 500 and velocity["error"] <= 1 and 0 < velocity["smallest"] < 1e-6


def test_the_page_of_many_blocks_has_a_line_for_each_class(tmp_path):
    x = stimlib.Input("x", "m")
    total = x
    for k in range(200):
        total = total + float(k) * stimlib.blocks.velocity(x, 100.0 + k) * stimlib.constant(
            1.0, "s"
        )
    scene, motion = stimlib.Scene({"y": total}), {"x": np.linspace(0, 0.01, 200)}
    r = stimlib.verify(scene, motion, stimlib.render(scene, motion, 1000))
    r.to_html(tmp_path / "a.html")
    shown = (
        (tmp_path / "a.html")
        .read_text()
        .partition("Each block and its law")[2]
        .partition("<details")[0]
    )
    assert shown.count("<tr>") < 10 and '<td>Velocity</td><td class="n">200</td>' in shown


@pytest.fixture(scope="module")
def hissing():
    """Five gated noises in one output."""
    x = Input("x", "m")
    on, force = b.loading(b.velocity(x, 100.0)), b.spring(x, 1000.0)
    for k in range(5):
        force = force + b.enabled(b.lowpass(white_noise(1, k), 200.0 + 10 * k), by=on) * constant(
            0.1, "N"
        )
    scene, motion = Scene({"force": force}), {"x": minimum_jerk()}
    return stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 1.0))


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


def test_up_to_three_equal_rows_stand_alone_and_four_are_one():
    assert alike("abaac", str) == [["a"], ["a"], ["a"], ["b"], ["c"]]
    assert alike("abaaac", str) == [["a", "a", "a", "a"], ["b"], ["c"]]


def test_a_check_that_failed_is_in_no_group(hissing, text_of):
    bad = [dc.replace(c, limit=-1.0) for c in hissing.checks if c.name.endswith(": spectrum")]
    text = re.sub("<details.*?</details>", "", text_of(hissing.evidence, bad))
    assert all(f'<td class="bad">FAILED</td><td>{c.name}</td>' in text for c in bad)


def test_equal_reasons_are_one_item(bumped, text_of):
    said = [f"noise {k}: too short" for k in range(5)] + ["another: reason"]
    text = text_of(dc.replace(bumped.evidence, skipped=said))
    part = text.partition("<h2>Not checked</h2>")[2].partition("<h2>")[0]
    items = part.partition("</ul>")[0]
    assert items.count("<li>") == 2 and "<li>noise 0 and 4 more: too short</li>" in items


def test_each_row_of_a_linear_block_names_the_block_with_its_numbers(hissing):
    filters = [c for c in hissing.checks if c.name.startswith("Filter: ")]
    texts = {c.text for c in filters}
    assert len(filters) == len(texts) == 10
    assert all(
        sum(f" of Filter(White(..), band='lowpass', low={200.0 + 10 * k}" in t for t in texts) == 2
        for k in range(5)
    )


def test_the_page_is_for_a_telephone_too_and_its_pictures_have_names(bumped, tmp_path):
    bumped.to_html(tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text()
    assert '<meta name="viewport" content="width=device-width,initial-scale=1">' in text
    assert text.count("<svg") == text.count('<svg role="img" aria-label="') == 3
    assert text.index("<svg") < text.index("What was compared"), "pictures first"
    assert '<div class="scene" tabindex="0"><pre>' in text, "on paper the scene is not folded away"


def test_the_errors_that_a_noise_hides_are_computed_once_for_equal_bands(monkeypatch):
    from stimlib.checks import power

    x = Input("x", "m")
    on, y = b.loading(b.velocity(x, 100.0)), constant(0.0)
    for k in range(6):
        y = y + b.enabled(b.lowpass(white_noise(1, k), 300.0), by=on)
    scene, motion = Scene({"y": y}), {"x": minimum_jerk()}
    report = stimlib.verify(scene, motion, stimlib.render(scene, motion, 8000, 1.0))
    asked, real = [], power.of_spectrum
    monkeypatch.setattr(power, "of_spectrum", lambda *a: asked.append(a) or real(*a))
    power._of_bins.cache_clear()
    assert sum(s.kind == "level" for s in report.certainty()) == 6 and len(asked) == 1
