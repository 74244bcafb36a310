"""What a participant reads: the texts of two languages, and files of others."""

import dataclasses
import json
import re
import tomllib
from contextlib import suppress
from io import StringIO
from pathlib import Path

import pytest
from experiments.some import QUESTION, TASK, Scripted, experiment, simulate
from refusals import refused

import stimlib.experiments.texts
from stimlib.cli import terminal
from stimlib.errors import BadValue
from stimlib.experiments import (
    Quest,
    Rate,
    Session,
    Stimulus,
    Trial,
    TwoInterval,
    run,
)
from stimlib.experiments.designs import (
    ConstantStimuli,
    Interleaved,
    Sequential,
    Staircase,
    trials_of,
)
from stimlib.experiments.questions import KINDS, analogue, places, rating

FILE = Path(stimlib.experiments.texts.__file__).with_name("texts.toml")
SHIPPED = tomllib.loads(FILE.read_text("utf-8"))
SHORT = ConstantStimuli(((TASK, 4.0), (TASK, 1.0)))


def test_every_language_has_every_text_with_its_values():
    assert {"en", "de"} <= SHIPPED.keys()
    for language, words in SHIPPED.items():
        assert words["language"] == language
        gaps = {k: sorted(re.findall(r"\{.*?\}", text)) for k, text in words.items()}
        of_english = {k: sorted(re.findall(r"\{.*?\}", text)) for k, text in SHIPPED["en"].items()}
        assert gaps == of_english


def test_every_text_is_used_and_every_text_used_is_there():
    folder = Path(stimlib.__file__).parent
    page = (folder / "live/page/ask.js").read_text("utf-8")
    code = "\n".join([page, *(p.read_text("utf-8") for p in folder.rglob("*.py"))])
    made = {f"{what}_{kind}" for kind in KINDS for what in ("no", "how")}
    assert {k for k in SHIPPED["en"] if not re.search(rf"[\"'.]{k}\b", code)} <= made
    assert set(re.findall(r'say\("(\w+)"', page)) <= SHIPPED["en"].keys()


def own(tmp_path, **changed):
    words = SHIPPED["en"] | {"language": "nl", "trial_of": "Ronde {number} van {total}"} | changed
    lines = [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in words.items() if v]
    (tmp_path / "nl.toml").write_text("\n".join(lines), "utf-8")
    return tmp_path / "nl.toml"


def test_texts_of_your_own_are_read_and_logged(tmp_path, monkeypatch, capsys):
    made = experiment(design=SHORT, language=own(tmp_path))
    monkeypatch.setattr(terminal.sys, "stdin", StringIO("\n1\n\n1\n"))
    with terminal.terminal(made.texts) as face:
        session = simulate(tmp_path, made, face)
    assert "Ronde 1 van 2: any key = Continue\n" in capsys.readouterr().out
    header = json.loads((session.folder / "session.json").read_text())
    assert header["texts"]["language"] == "nl" and header["texts"]["trial_of"][:5] == "Ronde"
    assert made.facts() == experiment(design=SHORT).facts()


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"right": ""}, "nl.toml' lacks right; translate"),
        ({"rigth": "Goed"}, "an unknown rigth; translate"),
        ({"trial": "Ronde"}, "must be a text like 'Trial {number}'"),
        ({"right": "Goed {number}"}, "right = 'Goed {number}' must be"),
        ({"right": "Goed }"}, "must be a text like"),
        ({"right": " "}, "must be a text like"),
        ({"right": 3}, "right = 3 must be a text"),
        ({"right": "Goed\x1b[2J"}, "must be a text like"),
        ("fr", "language = 'fr' must be one of en, de"),
        (Path("no.toml"), "cannot read "),
        (b"right = \xff", "a.toml' is no TOML"),
    ],
)
def test_texts_that_are_not_whole_are_refused(tmp_path, changed, why):
    language = own(tmp_path, **changed) if isinstance(changed, dict) else changed
    if isinstance(changed, bytes):
        language = tmp_path / "a.toml"
        language.write_bytes(changed)
    refused(BadValue, re.escape(why), experiment, language=language)


def test_a_german_session_in_a_terminal(tmp_path, monkeypatch, capsys):
    rated = rating("rough", "Wie rau?", "glatt", "rau", 11)
    task = Rate("c", ("rough",), Stimulus("spring"), {"rough": 7})
    free = Rate("d", ("rough",), Stimulus("spring"))  # nothing is right of it
    made = experiment(
        design=ConstantStimuli(((task, None), (free, None)), shuffle="none", training=True),
        questions=(rated,),
        feedback=True,
        language="de",
    )
    monkeypatch.setattr(terminal.sys, "stdin", StringIO("\n12\n7\n\n8\n"))
    with terminal.terminal(made.texts) as face:
        simulate(tmp_path, made, face)
    assert capsys.readouterr().out.splitlines() == [
        "Durchgang 1 von 2, zur Übung: beliebige Taste = Weiter",
        "Wie rau? 1 = glatt, 11 = rau",
        "Bitte geben Sie eine ganze Zahl von 1 bis 11 an.",
        "Wie rau? 1 = glatt, 11 = rau",
        "Richtig",
        "Durchgang 2 von 2, zur Übung: beliebige Taste = Weiter",
        "Wie rau? 1 = glatt, 11 = rau",
        "Das war der letzte Durchgang. Vielen Dank.",
    ]


# How many, and how far ----------------------------------------------------------------
def test_the_total_is_told_where_answers_do_not_change_it(tmp_path):
    stairs = Staircase(TASK, 4.0, (0.5, 8.0), reversals=4)
    quest = Quest(TASK, (1.0, 2.0, 3.0), (1.0, 2.0), (0.5, 1.0), trials=7)
    four = ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), 2)
    both = Interleaved({"a": four, "b": quest})
    for design, total in (
        (four, 4),
        (quest, 7),
        (stairs, None),
        (both, 11),
        (Sequential({"c": both, "d": four}), 15),
        (Sequential({"c": both, "d": stairs}), None),
    ):
        assert trials_of(design) == total
    for name, first, told in (
        ("x", "Trial 1 of 2", {"design": SHORT}),
        ("y", "Trial 1", {"design": SHORT, "show_total": False}),
        ("z", "Trial 1", {"design": stairs}),
    ):
        face = Scripted(*["first"] * 99)
        simulate(tmp_path, experiment(name=name, **told), face)
        assert face.noted[0] == first


def test_a_resumed_session_says_where_it_goes_on_and_repeats_nothing(tmp_path):
    known = {"soft": Stimulus("spring")}
    made = experiment(design=SHORT, instructions="Squeeze.", familiarisation=known)
    again, last = "The session goes on where it stopped.", "That was the last one. Thank you."
    for resume, answers, told in (
        (False, ["leave"], ["Squeeze.", "Trial 1 of 2"]),
        (True, ["first", "leave"], [again, "Trial 1 of 2", "Trial 2 of 2"]),
        (True, ["first"], [again, "Trial 2 of 2", last]),
    ):
        face = Scripted(*answers, picks=["soft"])
        with suppress(KeyboardInterrupt), Session(made, tmp_path, "P01", resume=resume) as session:
            run(session, face, lambda trial, folder: folder.mkdir() or {})
        assert [text for text in face.noted if isinstance(text, str)] == told
    assert sorted(p.name for p in session.folder.glob("fam*")) == ["familiarisation-1.stimlog"]
    german = Session(dataclasses.replace(made, language="de"), tmp_path, "P01", resume=True)
    refused(BadValue, "the language of the texts differs", german.__enter__)
    with Session(dataclasses.replace(made, show_total=False), tmp_path, "P01", resume=True):
        pass


# Right answers ------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("standard", "comparison", "more", "right"),
    [
        ({"k": 2.0}, "spring", {}, ["standard", "", "comparison"]),
        ({"k": 2.0}, "spring", {"asks_less": True}, ["comparison", "", "standard"]),
        ({"k": 0.0}, "spring", {}, ["comparison"] * 3),
        ({}, "other", {"detection": True}, ["comparison"] * 3),
        ({}, "spring", {}, [""] * 3),  # nobody knows its k
        ({"k": 2.0}, "other", {}, [""] * 3),
        ({"k": 2.0, "A": 1.0}, "spring", {}, [""] * 3),
    ],
)
def test_two_intervals_have_a_right_answer_where_only_one_quantity_differs(
    standard, comparison, more, right
):
    spring = Stimulus("spring", standard)
    made = TwoInterval("c", "softer", spring, Stimulus(comparison), "k", **more)
    for level, name in zip((1.0, 2.0, 3.0), right, strict=True):
        trial = made.trial(level, 1, 0)
        by = dict(zip(("first", "second"), (s.name for s in trial.stimuli), strict=True))
        assert "".join(by[c] for c in trial.correct.values()) == name


@pytest.mark.parametrize(
    ("more", "right"),
    [
        ({"chance": 1 / 3}, {"odd": "b"}),  # that of score one
        ({}, {}),
        ({"chance": 0.0}, {}),
        ({"correct": {"odd": "a", "other": 1}}, {"odd": "a"}),
    ],
)
def test_a_task_of_your_own_with_a_chance_level_has_an_answer(more, right):
    assert Trial("c", (), ("odd",), scores={"a": 0.0, "b": 1.0}, **more).right == right


def test_a_typed_number_is_one_of_everyday_life():
    line, where = analogue("rough", "How rough?", "smooth", "rough"), places("at", "Where?", 2)
    assert str(line.answer("-0")) == "0.0" and line.answer(" 7.5 ") == 7.5
    assert str(where.answer("-0 0.01")) == "[[0.0, 0.01]]"
    for question, text in ((line, "1_0"), (where, "0.0_1 0"), (line, "nan"), (line, "1e999")):
        refused(BadValue, None, question.answer, text)


@pytest.mark.parametrize(
    "task",
    [
        TASK,
        Rate("c", ("rough",), Stimulus("spring")),
        Rate("c", ("where",), Stimulus("spring"), {"where": [[0, 0]]}),
    ],
)
def test_feedback_without_a_right_answer_is_refused_at_once(tmp_path, task):
    asked = QUESTION, rating("rough", "?", "smooth", "rough"), places("where", "?", 2)
    stairs = Staircase(TASK, 4.0, (0.5, 8.0), reversals=4)
    for design in (ConstantStimuli(((task, 4.0 if task is TASK else None),)), stairs):
        more = {"feedback": True, "questions": asked}
        refused(BadValue, "but no trial", experiment, design=design, **more)
        later = experiment(design=lambda who, session, of=design: of, **more)
        refused(BadValue, "but no trial", Session, later, tmp_path, "P01")
