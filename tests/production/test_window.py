"""Parts of pictures and smaller ones: what may be asked for, and what it is called."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.request.lookup import QualityName, cropped_name, quality_named
from flowsculpt.render.scene.render_quality import QUALITIES

pytestmark = pytest.mark.quick


def quality(crop=None, scale=None, of="final"):
    return quality_named(cropped_name(of, crop, scale), QUALITIES)


def test_without_a_word_a_quality_is_itself():
    assert cropped_name("draft") == cropped_name("draft", scale="100%") == "draft"
    assert quality() == QUALITIES["final"]


def test_a_picture_may_be_scaled_by_per_cent_or_by_a_factor():
    assert cropped_name("final", scale="50%") == cropped_name("final", scale="0.5") == "final.scale50"
    half = quality(scale="50%")
    assert (half.width, half.height, half.samples) == (960, 540, QUALITIES["final"].samples)
    assert cropped_name("draft", scale="33.3%") == "draft.scale33.3"


def test_a_part_is_said_in_shares_or_in_pixels():
    assert cropped_name("final", "0.25,0.5,0.75,1") == cropped_name("final", "480,540,1440,1080")
    assert quality("480,540,1440,1080").crop == (480, 540, 1440, 1080)
    assert cropped_name("draft", "0,0,1,1") == "draft.crop0-0-480-270"


def test_a_part_of_a_scaled_picture_is_in_pixels_of_that():
    assert cropped_name("final", "0.5,0,1,1", "50%") == "final.scale50.crop480-0-960-540"


@given(st.tuples(*[st.floats(0, 1)] * 4), st.sampled_from([*QUALITIES]), st.sampled_from(["100%", "37%"]))
def test_every_part_of_some_size_is_found_again_in_its_name(shares, of, scale):
    x0, x1 = sorted(shares[:2])
    y0, y1 = sorted(shares[2:])
    if x1 - x0 < 1e-3 or y1 - y0 < 1e-3:
        return
    part = quality(f"{x0},{y0},{x1},{y1}", scale, of)
    left, upper, right, lower = part.crop
    assert left <= x0 * part.width + 1e-5 and right >= x1 * part.width - 1e-5
    assert upper <= y0 * part.height + 1e-5 and lower >= y1 * part.height - 1e-5
    assert QualityName.of(cropped_name(of, f"{x0},{y0},{x1},{y1}", scale)).base == of


@pytest.mark.parametrize(
    ("crop", "scale", "message"),
    [
        ("10,10,10,50", None, "is 0 × 40 pixels large"),
        ("0,0,0,0", None, "is 0 × 0 pixels large"),
        ("50,50,10,10", None, "is 0 × 0 pixels large"),
        ("0,0,5000,50", None, "goes beyond the picture, which has 1920 × 1080 pixels"),
        ("-1,0,50,50", None, "goes beyond the picture"),
        ("0,0,1000,50", "50%", "goes beyond the picture, which has 960 × 540 pixels"),
        ("1,2,3", None, "write the left, upper, right and lower edge"),
        ("a,b,c,d", None, "write the left, upper, right and lower edge"),
        ("nan,0,1,1", None, "write the left, upper, right and lower edge"),
        (None, "0", "is out of range"),
        (None, "10", r"--scale 10 is out of range \(1–400%\). Write 10%."),
        (None, "1e9%", "is out of range"),
        (None, "half", "is out of range"),
        (None, "nan", "is out of range"),
    ],
)
def test_what_is_no_part_of_a_picture_is_told(crop, scale, message):
    with pytest.raises(UsageError, match=message):
        cropped_name("final", crop, scale)


def test_an_unknown_quality_is_left_to_be_told_of():
    assert cropped_name("finest", "0,0,1,1") == "finest"
    assert QualityName.of("final.crop1-2").base == "final.crop1-2"
