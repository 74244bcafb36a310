"""The examples are complete programs: they run from any folder and print what the user
guide says.
"""

import os
import re
import runpy
import sys
import warnings
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

PRINTED = {
    "first_stimulus.py": (
        "Rendering(force1, force2: 2 s at 8000 Hz)\n"
        "force1: largest 40.00 N, vibration 14.13 mN rms\n"
        "force2: largest 40.00 N, vibration 14.29 mN rms\n"
    ),
    "foreign_pattern.py": (
        "tap.ahap: 16 points, 1 transient; lost: -24 dB of the samples, -55 dB of the envelope\n"
        "tap.haptic: 11 points, 1 transient; lost: -25 dB of the samples, -55 dB of the envelope\n"
        "tap.hjif: 9 points, 1 transient; lost: -9 dB of the samples, -55 dB of the envelope\n"
        "Scene(no input -> vibration [m/s²]), 0.99 s\n"
    ),
    "ribbed_cloth.py": (
        "Rendering(force: 1.5 s at 8000 Hz)\n"
        "stroking: 0.144 N rms, between -0.26 and 0.26 N\n"
        "holding: 0.013 N rms, between -0.07 and 0.08 N\n"
    ),
    "clicks_and_bursts.py": (
        "clicks: 20 of them, largest 0.425 N\nbursts: 0.43, 0.00, 0.45 V rms in, between and in"
        " them\n"
    ),
    "sticking_surfaces.py": (
        "stroking: 131 slips in 40 mm, largest 0.87 N; held: 0.000 N\n"
        "LuGre: 0.694 N at most, 0.600 N while fast; the loop is within 0.001 N\n"
    ),
    "serial_tracker.py": "many reports; the hand ended at 10.00 mm\nreplay: equal, bit for bit\n",
    "control_loop.py --watchdog 5": (
        "a wall at 10 mm, and a hand that went to 24 mm: held\nreplay: equal, bit for bit\n"
    ),
    "control_loop.py --watchdog 5 --device serial": (
        "a wall at 10 mm, and a hand that went to 24 mm: held\nreplay: equal, bit for bit\n"
    ),
    "psychopy_trial.py --made-up-hand": (
        "interval 1: 360 N/m, 20.0 mm, 7.20 N\ninterval 2: 300 N/m, 20.0 mm, 6.00 N\nanswer: 2\n"
    ),
    "psychopy_session.py --simulated": (
        "240 N/m felt harder than 300 N/m in 0 of 4 trials\n"
        "300 N/m felt harder than 300 N/m in 3 of 4 trials\n"
        "360 N/m felt harder than 300 N/m in 3 of 4 trials\n"
    ),
    "which_is_softer.py": (
        "51 trials, 0 samples lost, 0 limited\n"
        "A = 0: felt as the standard at about 1701 N/m\n"
        "A = 3.4: felt as the standard at about 2190 N/m\n"
    ),
    "detection_threshold.py": "79 trials, threshold 0.085 V\n",
    "difference_threshold.py": (
        "        JND / Hz   95 %           Weber fraction\n"
        "P01         16.7   13.0 to 22.8   8.4%\n"
        "P02         19.2   13.7 to 30.0   9.6%\n"
        "P03         17.3   13.3 to 24.0   8.7%\n"
        "P04         15.1   11.4 to 21.6   7.6%\n"
        "P05         16.9   11.3 to 30.0   8.5%\n"
    ),
    "own_block.py": (
        "force after 50 ms: 20.0000 N\ncompiled and reference samples are equal, bit for bit\ngain"
        " at 50 Hz: -3.01 dB\n"
    ),
    "equal_rms_bumps.py": (
        "sine     duty 0.5, A = 4.000 V: 1.000 V rms, rendered 1.000 V\n"
        "sawtooth duty 0.8, A = 3.873 V: 1.000 V rms, rendered 1.000 V\n"
    ),
    "is_it_felt.py --area 1e-4": (
        "squeeze, A = 3.4: Pacinian 5.8 dB SL, non-Pacinian 1.9 dB SL: near the threshold, which"
        " differs by 5 dB between persons\n"
        "squeeze, A = 0.34: Pacinian -14.2 dB SL, non-Pacinian -13.3 dB SL: not felt\n"
        "bumps, A = 4 V: Pacinian 49.4 dB SL, non-Pacinian unknown: felt\n"
        "texture: Pacinian 11.2 dB SL, non-Pacinian 14.8 dB SL: felt\n"
        "16 bits of 50 N: -49 dB SL\n"
    ),
    "fit_tissue.py": (
        "SpringpotFit(chi=300.6 [299.5, 301.8], alpha=0.1498 [0.1484, 0.1512]; 0.99 % rms of 53"
        " samples)\nMaxwellFit(k0=152.1 [148.3, 155.9], k1=146.6 [136.1, 158], tau1=0.5419"
        " [0.4572, 0.6424], k2=99.77 [93.15, 106.9], tau2=11.33 [9.577, 13.41]; 2.3 % rms of 53"
        " samples)\nspringpot: 0.898 N, after two seconds 0.489 N\narms: 0.771 N, after two seconds"
        " 0.480 N\n"
    ),
    "many_noises.py": (
        "A = 0.5: 16.26 mN rms, 2.9 % from noise to noise\n"
        "A = 1.0: 32.36 mN rms, 3.4 % from noise to noise\n"
        "A = 1.5: 48.02 mN rms, 2.7 % from noise to noise\n"
        "A = 2.0: 64.48 mN rms, 3.3 % from noise to noise\n"
        "A = 2.5: 80.87 mN rms, 3.4 % from noise to noise\n"
        "A = 3.0: 96.24 mN rms, 3.2 % from noise to noise\n"
        "A = 3.5: 113.06 mN rms, 3.1 % from noise to noise\n"
        "A = 4.0: 129.30 mN rms, 3.4 % from noise to noise\n"
    ),
    "felt_squeezes.py": (
        "117 hands, loading at 11.1 to 124.5 mm/s; 702 renderings\n"
        "their vibration is 1.02 times that of the formula, from 0.94 to 1.08\n"
        "A =  0.85:   0 % would be felt; by the formula those from 150.2 mm/s\n"
        "A =  1.70:  15 % would be felt; by the formula those from  75.1 mm/s\n"
        "A =  3.40:  50 % would be felt; by the formula those from  37.5 mm/s\n"
        "A =  6.80:  77 % would be felt; by the formula those from  18.8 mm/s\n"
        "A = 13.60: 100 % would be felt; by the formula those from   9.4 mm/s\n"
        "A = 27.20: 100 % would be felt; by the formula those from   4.7 mm/s\n"
    ),
    "recover_springpot.py": (
        "          found                  95 %  start\n"
        "k       798.481    796.556 .. 800.411    300  N/m\n"
        "chi      61.353    59.5591 .. 63.2009    150\n"
        "alpha  0.293986  0.287549 .. 0.300505    0.5\n"
        "relative rms error 0.00591; 35 steps, converged\n"
        "inside their intervals: k, chi, alpha\n"
    ),
    "fit_arms.py": (
        "        found                    95 %  start\n"
        "k0   0.395266     0.395102 .. 0.39543    0.4  N/m\n"
        "k1   0.306567    0.304836 .. 0.308307   0.05  N/m\n"
        "k2   0.107661    0.107113 .. 0.108212   0.05  N/m\n"
        "k3  0.0934627  0.0930604 .. 0.0938667   0.05  N/m\n"
        "k4  0.0841696  0.0837689 .. 0.0845723   0.05  N/m\n"
        "k5  0.0799856  0.0796118 .. 0.0803613   0.05  N/m\n"
        "relative rms error 0.0028; 93 steps, converged\n"
        "5 arms on a grid: 0.23 % rms, largest 0.9 %\n"
        "2 free arms: 1.18 % rms, largest 3.9 %\n"
        "3 free arms: 0.41 % rms, largest 1.6 %\n"
    ),
    "match_rms.py": (
        "square   A = 4.0000 V, duty 0.5000: 72.418037 V rms\n"
        "sawtooth A = 6.5245 V, duty 0.8000: 72.418037 V rms\n"
        "sine     A = 6.0000 V, duty 0.6552: 72.418037 V rms\n"
    ),
}

RECORDINGS = EXAMPLES.parents[1] / "shared" / "data"
NEEDS = {
    "fit_arms.py": RECORDINGS / "afm-relaxation",
    "felt_squeezes.py": RECORDINGS / "grip-trials",
}


def but_steps(printed: str) -> str:
    """Without the number of steps of a search, which rounding may change."""
    return re.sub(r"\d+ steps", "some steps", printed)


def test_every_example_is_tested():
    assert {name.split()[0] for name in PRINTED} == {p.name for p in EXAMPLES.glob("*.py")}


# searches that take long to compile, as those of test_identify and of the pages do, and
# sessions and recordings of half a minute
SLOW = {
    name: pytest.mark.stress
    for name in (
        "fit_arms.py",
        "match_rms.py",
        "recover_springpot.py",
        "felt_squeezes.py",
        "which_is_softer.py",
    )
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in PRINTED])
def test_example_prints_its_result_and_draws_only_when_asked(name, tmp_path, monkeypatch, capsys):
    """In this process, with a folder of its own and warnings that are errors: a process
    for each pays the imports each time.
    """
    if name in NEEDS and not NEEDS[name].is_dir():
        pytest.skip(f"recordings that are not there: ../shared/data/{NEEDS[name].name}")
    monkeypatch.chdir(tmp_path)
    warnings.simplefilter("error")  # pytest restores it
    warnings.filterwarnings("ignore", category=DeprecationWarning, module="matplotlib|pyparsing")
    warnings.filterwarnings("ignore", "not permitted here")  # real time
    example, *words = name.split()
    plain = [[]] * (name in ("first_stimulus.py", "own_block.py"))  # quick, and not drawn too
    for call in [*plain, ["--plot", "picture.png"]]:
        monkeypatch.setattr(sys, "argv", [str(EXAMPLES / example), *call, *words])
        runpy.run_path(sys.argv[0], run_name="__main__")
        printed, told = capsys.readouterr()
        assert (but_steps(printed), told) == (but_steps(PRINTED[name]), "")
        assert os.listdir(".") == call[1:]
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_an_example_says_which_recording_is_not_there(monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(EXAMPLES / "fit_arms.py"), "--data", "nowhere"])
    with pytest.raises(SystemExit, match="the recording is not there: nowhere"):
        runpy.run_path(sys.argv[0], run_name="__main__")
