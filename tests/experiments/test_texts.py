"""What a participant reads: the texts of two languages, and files of others."""

import dataclasses
import json
import re
import tomllib
from io import StringIO
from pathlib import Path

import pytest
from experiments.some import QUESTION, TASK, experiment
from experiments.test_session import Scripted
from refusals import refused

import stimlib.experiments.texts
from stimlib.cli import terminal
from stimlib.errors import BadValue
from stimlib.experiments import (
    OneInterval,
    Quest,
    Rate,
    Session,
    Stimulus,
    Trial,
    TwoInterval,
    run,
    texts_of,
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


def gaps(text):
    return sorted(re.findall(r"\{.*?\}", text))


def test_every_language_has_every_text_with_its_values():
    assert {"en", "de"} <= SHIPPED.keys()
    for language, words in SHIPPED.items():
        assert words["language"] == language and words.keys() == SHIPPED["en"].keys()
        assert all(gaps(words[k]) == gaps(text) for k, text in SHIPPED["en"].items())


def test_every_text_is_used_and_every_text_used_is_there():
    folder = Path(stimlib.__file__).parent
    files = [*folder.rglob("*.py"), folder / "live/page/ask.js"]
    code = "\n".join(p.read_text("utf-8") for p in files)
    made = {f"{what}_{kind}" for kind in KINDS for what in ("no", "how")}
    unused = {k for k in SHIPPED["en"] if not re.search(rf"[\"'.]{k}\b", code)}
    assert unused <= made
    page = (folder / "live/page/ask.js").read_text()
    assert set(re.findall(r'say\("(\w+)"', page)) <= SHIPPED["en"].keys()


def own(tmp_path, **changed):
    words = SHIPPED["en"] | {"language": "nl", "trial_of": "Ronde {number} van {total}"} | changed
    lines = [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in words.items() if v]
    (tmp_path / "nl.toml").write_text("\n".join(lines), "utf-8")
    return tmp_path / "nl.toml"


def test_texts_of_your_own_are_read_and_logged(tmp_path, monkeypatch, capsys):
    made = experiment(design=SHORT, language=own(tmp_path))
    monkeypatch.setattr(terminal.sys, "stdin", StringIO("\n1\n\n1\n"))
    with Session(made, tmp_path, "P01") as session, terminal.terminal(made.texts) as face:
        run(session, face, lambda trial, folder: {})
    assert "Ronde 1 van 2: any key = Continue\n" in capsys.readouterr().out
    header = json.loads((session.folder / "session.json").read_text())
    assert header["texts"]["language"] == "nl" and header["texts"]["trial_of"][:5] == "Ronde"
    assert made.facts() == experiment(design=SHORT).facts()


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"right": ""}, "nl.toml' lacks right; translate"),
        ({"rigth": "Goed"}, "has an unknown rigth; translate"),
        ({"trial": "Ronde"}, "trial = 'Ronde' must be a text like 'Trial {number}'"),
        ({"right": "Goed {number}"}, "right = 'Goed {number}' must be a text like"),
        ({"right": "Goed }"}, "must be a text like"),
        ({"right": " "}, "must be a text like"),
        ({"right": 3}, "right = 3 must be a text"),
        ({"right": "Goed\x1b[2J"}, "must be a text like"),
    ],
)
def test_texts_that_are_not_whole_are_refused(tmp_path, changed, why):
    refused(BadValue, re.escape(why), experiment, language=own(tmp_path, **changed))


def test_a_language_that_is_none_is_refused(tmp_path):
    refused(BadValue, "language = 'fr' must be one of en, de, or a file", experiment, language="fr")
    refused(BadValue, "cannot read .*no.toml", experiment, language=tmp_path / "no.toml")
    (tmp_path / "a.toml").write_bytes(b"right = \xff")
    refused(BadValue, "a.toml' is no TOML in UTF-8", texts_of, tmp_path / "a.toml")


def test_a_german_session_in_a_terminal(tmp_path, monkeypatch, capsys):
    rated = rating("rough", "Wie rau?", "glatt", "rau", 11)
    task = Rate("c", ("rough",), Stimulus("spring"), {"rough": 7})
    made = experiment(
        design=ConstantStimuli(((task, None),), training=True),
        questions=(rated,),
        feedback=True,
        language="de",
    )
    monkeypatch.setattr(terminal.sys, "stdin", StringIO("\n12\n7\n"))
    with Session(made, tmp_path, "P01") as session, terminal.terminal(made.texts) as face:
        run(session, face, lambda trial, folder: {})
    assert capsys.readouterr().out.splitlines() == [
        "Durchgang 1 von 1, zur Übung: beliebige Taste = Weiter",
        "Wie rau? 1 = glatt, 11 = rau",
        "Bitte geben Sie eine ganze Zahl von 1 bis 11 an.",
        "Wie rau? 1 = glatt, 11 = rau",
        "Richtig",
        "Das war der letzte Durchgang. Vielen Dank.",
    ]


# How many, and how far ----------------------------------------------------------------
def test_the_total_is_told_where_answers_do_not_change_it(tmp_path):
    stairs = Staircase(TASK, 4.0, (0.5, 8.0), reversals=4)
    quest = Quest(TASK, (1.0, 2.0, 3.0), (1.0, 2.0), (0.5, 1.0), trials=7)
    four = ConstantStimuli(((TASK, 4.0), (TASK, 1.0)), 2)
    assert [trials_of(d) for d in (four, quest, stairs)] == [4, 7, None]
    both = Interleaved({"a": four, "b": quest})
    assert trials_of(both) == 11 and trials_of(Sequential({"c": both, "d": four})) == 15
    assert trials_of(Sequential({"c": both, "d": stairs})) is None
    for wanted, first in ((True, "Trial 1 of 2"), (False, "Trial 1")):
        face = Scripted("first", "first")
        made = experiment(name=f"x{wanted}", design=SHORT, show_total=wanted)
        with Session(made, tmp_path, "P01") as session:
            run(session, face, lambda trial, folder: {})
        assert face.noted[0] == first
    face = Scripted(*["first"] * 99)
    with Session(experiment(design=stairs), tmp_path, "P01") as session:
        run(session, face, lambda trial, folder: {})
    assert face.noted[0] == "Trial 1"


def test_a_resumed_session_says_where_it_goes_on_and_repeats_nothing(tmp_path):
    made = experiment(
        design=SHORT, instructions="Squeeze.", familiarisation={"soft": Stimulus("spring")}
    )

    def show(trial, folder):
        folder.mkdir()
        return {}

    class Gone(Exception):
        pass

    class Leaving(Scripted):
        def ask(self, trial, question, replays):
            if not self.answers:
                raise Gone
            return super().ask(trial, question, replays)

    noted = []
    for resume, answers in ((False, []), (True, ["first"]), (True, ["first"])):
        face = Leaving(*answers, picks=["soft"])
        try:
            with Session(made, tmp_path, "P01", resume=resume) as session:
                run(session, face, show)
        except Gone:
            pass
        noted.append([text for text in face.noted if isinstance(text, str)])
    again = "The session goes on where it stopped."
    assert noted == [
        ["Squeeze.", "Trial 1 of 2"],
        [again, "Trial 1 of 2", "Trial 2 of 2"],
        [again, "Trial 2 of 2", "That was the last one. Thank you."],
    ]
    names = {p.name for p in session.folder.glob("*.stimlog")}
    assert {n for n in names if n.startswith("fam")} == {"familiarisation-1.stimlog"}


def test_a_session_goes_on_in_the_language_in_which_it_began(tmp_path):
    made = experiment(design=SHORT)
    with Session(made, tmp_path, "P01"):
        pass
    other = dataclasses.replace(made, language="de")
    with pytest.raises(BadValue, match="the language of the texts differs. Go on with"):
        Session(other, tmp_path, "P01", resume=True).__enter__()
    with Session(dataclasses.replace(made, show_total=False), tmp_path, "P01", resume=True):
        pass


# Right answers ------------------------------------------------------------------------
def two(standard, comparison, **other):
    made = TwoInterval("c", "softer", Stimulus("spring", standard), comparison, "k", **other)
    return {level: made.trial(level, 1, 0) for level in (1.0, 2.0, 3.0)}


def has(trial):
    """Which stimulus the right answer names."""
    return {trial.stimuli[("first", "second").index(c)].name for c in trial.correct.values()}


def test_two_intervals_have_a_right_answer_where_only_one_quantity_differs():
    spring = Stimulus("spring")
    more, less = two({"k": 2.0}, spring), two({"k": 2.0}, spring, asks_less=True)
    assert [has(t) for t in more.values()] == [{"standard"}, set(), {"comparison"}]
    assert [has(t) for t in less.values()] == [{"comparison"}, set(), {"standard"}]
    detected = two({"k": 0.0}, spring)
    assert [has(t) for t in detected.values()] == [{"comparison"}] * 3
    assert [has(t) for t in two({}, Stimulus("other"), detection=True).values()] == [
        {"comparison"}
    ] * 3
    for standard, comparison in (
        ({}, spring),  # nobody knows its k
        ({"k": 2.0}, Stimulus("other")),
        ({"k": 2.0, "A": 1.0}, spring),
    ):
        assert not any(t.correct for t in two(standard, comparison).values())


def test_a_task_of_your_own_with_a_chance_level_has_the_answer_of_score_one():
    odd = {"condition": "c", "stimuli": (), "questions": ("odd",), "scores": {"a": 0.0, "b": 1.0}}
    assert Trial(**odd, chance=1 / 3).right == {"odd": "b"}
    assert Trial(**odd).right == {} == Trial(**odd, chance=0.0).right
    assert Trial(**odd, correct={"odd": "a", "other": 1}).right == {"odd": "a"}


WHERE = places("where", "?", 2)
ROUGH = rating("rough", "?", "smooth", "rough")


def test_a_typed_number_is_one_of_everyday_life():
    line, where = analogue("rough", "How rough?", "smooth", "rough"), places("at", "Where?", 2)
    assert str(line.answer("-0")) == "0.0" and line.answer(" 7.5 ") == 7.5
    assert str(where.answer("-0 0.01")) == "[[0.0, 0.01]]"
    for question, text in ((line, "1_0"), (where, "0.0_1 0"), (line, "nan"), (line, "1e999")):
        refused(BadValue, None, question.answer, text)


@pytest.mark.parametrize(
    ("design", "questions"),
    [
        (ConstantStimuli(((Rate("c", ("rough",), Stimulus("spring")), None),)), (ROUGH,)),
        (SHORT, None),
        (Staircase(TASK, 4.0, (0.5, 8.0), reversals=4), None),
        (
            ConstantStimuli(
                ((Rate("c", ("where",), Stimulus("spring"), {"where": [[0, 0]]}), None),)
            ),
            (WHERE,),
        ),
    ],
)
def test_feedback_without_a_right_answer_is_refused_at_once(tmp_path, design, questions):
    more = {"feedback": True} | ({"questions": questions} if questions else {})
    refused(BadValue, "feedback=True, but no trial", experiment, design=design, **more)
    later = experiment(design=lambda who, session: design, **more)
    refused(BadValue, "feedback=True, but no trial", Session, later, tmp_path, "P01")


def test_feedback_is_told_after_every_trial_that_has_a_right_answer(tmp_path):
    task = TwoInterval("c", "softer", Stimulus("spring", {"k": 2.0}), Stimulus("spring"), "k")
    rated = Rate("d", ("softer",), Stimulus("spring"))
    color = OneInterval(
        "e", "softer", {"first": Stimulus("spring"), "second": Stimulus("spring", {"k": 3.0})}
    )
    design = ConstantStimuli(
        ((task, 3.0), (task, 2.0), (rated, None), (color, "second")), shuffle="none"
    )
    face = Scripted("first", "first", "first", "first")
    with Session(experiment(design=design, feedback=True), tmp_path, "P01") as session:
        run(session, face, lambda trial, folder: {})
    told = [text for text in face.noted if text in ("Right", "Wrong")]
    first = session.records[0].trial.correct["softer"] == "first"
    assert told == ["Right" if first else "Wrong", "Wrong"]


def test_feedback_is_right_where_every_answer_of_a_trial_is(tmp_path):
    asked = rating("rough", "How rough?", "smooth", "coarse")
    right = {"softer": "first", "rough": 6}
    task = Rate("c", tuple(right), Stimulus("spring"), right)
    design, face = ConstantStimuli(((task, None),), 2), Scripted("first", 5, "first", 6)
    made = experiment(design=design, questions=(QUESTION, asked), feedback=True)
    with Session(made, tmp_path, "P01") as session:
        run(session, face, lambda trial, folder: {})
    assert [text for text in face.noted if text in ("Right", "Wrong")] == ["Wrong", "Right"]
