"""The command line in this process."""

from typer.testing import CliRunner

from stimlib.cli import app


def ran(words, code=0, says="", **how):
    """Run ``stimlib`` with these words (a text is split at its spaces) and return what
    it printed. It must end with this status, say this on stderr (whose lines are
    joined), and show a traceback with status 3 alone.
    """
    words = words.split() if isinstance(words, str) else [*map(str, words)]
    done = CliRunner().invoke(app, words, **how)
    assert done.exit_code == code, done.output
    assert says in " ".join(done.stderr.split()), done.output
    assert ("Traceback" in done.output) == (code == 3), done.output
    return done


def refuses(words, says, **how):
    """What every command does with a mistake: it ends with status 2, and says what is
    wrong in one line on stderr and nothing on stdout.
    """
    done = ran(words, 2, says, **how)
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr
    assert not done.stdout and "value error" not in done.stderr.lower()
    return done
