"""The canvas that pictures are drawn on."""

import numpy as np

from stereo_selfcal.pictures.canvas import Canvas


def test_text_stays_inside_the_picture():
    strip = Canvas(np.zeros((60, 960, 3), np.uint8), 1.0)
    strip.text("x" * 500, 10, 40)
    assert (strip.pixels[:, -1] > 150).sum() == 0
