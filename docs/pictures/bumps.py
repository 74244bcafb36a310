"""Figure 4.1 of the touch-screen thesis, redrawn from renderings: python
docs/pictures/bumps.py writes bumps.svg beside it.
"""

from pathlib import Path

import numpy as np

import stimlib
from stimlib.scenes import bumps

FS, SPEED, NB, SHOWN = 4000, 0.2, 6, 2  # two of six bumps, as a finger at 0.2 m/s meets them
WIDTH, HEIGHT, GAP, LEFT, TOP = 210, 70, 26, 70, 34
WAVEFORMS, DUTIES = ("sine", "square", "sawtooth"), (0.2, 0.5, 0.8)


def rendered(waveform, duty, **more):
    """Place in bumps, and voltage before the amplifier, at unit amplitude."""
    x = SPEED * np.arange(SHOWN * 0.1 / NB / SPEED * FS) / FS
    scene = bumps(waveform, NB, duty, amplitude=1.0, gain=1.0, **more)
    return x * NB / 0.1, stimlib.compile(scene, FS).process(x[None])[0]


def path(u, y, left, top):
    """Points of a polyline; of a run of equal values only the ends."""
    keep = np.r_[True, (np.diff(y[:-1]) != 0) | (np.diff(y[1:]) != 0), True]
    points = zip(left + WIDTH * u[keep] / SHOWN, top + HEIGHT * (1 - y[keep]), strict=True)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in points)


def picture():
    """The text of the file."""
    width, height = LEFT + 3 * (WIDTH + GAP), TOP + 3 * (HEIGHT + GAP) + 26
    out = [
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
            ' font-family="sans-serif" font-size="12">'
        ),
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for row, waveform in enumerate(WAVEFORMS):
        top = TOP + row * (HEIGHT + GAP)
        out.append(f'<text x="8" y="{top + HEIGHT / 2:g}">{waveform}</text>')
        for column, duty in enumerate(DUTIES):
            left = LEFT + column * (WIDTH + GAP)
            if row == 0:
                out.append(f'<text x="{left}" y="{TOP - 14}">duty cycle {duty:g}</text>')
            envelope = rendered(waveform, duty, freq=0.0, phase=np.pi / 2, rectify=None)
            out.append(f'<path d="M{left},{top}v{HEIGHT}h{WIDTH}" fill="none" stroke="#999"/>')
            for (u, y), style in ((rendered(waveform, duty), "#1f5fa8"), (envelope, "#c0392b")):
                out.append(
                    f'<polyline points="{path(u, y, left, top)}" fill="none" stroke="{style}"/>'
                )
    note = (
        f"Two of {NB} bumps on 0.1 m, as a finger at {SPEED:g} m/s meets them; red: the envelope."
    )
    out.append(f'<text x="{LEFT}" y="{height - 10}">{note}</text>')
    return "\n".join([*out, "</svg>"]) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("bumps.svg").write_text(picture())
