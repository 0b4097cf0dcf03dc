"""Deliverables, as those meet them who ask for them."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.frames import FrameSelection
from flowsculpt.pipeline.plugins.delivery.deliverables import (
    Delivery,
    DeliveryOptions,
    FrameFormat,
    film_source,
    shot_source,
)
from flowsculpt.pipeline.plugins.delivery.gif import write_gif
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.render.graphics.typesetting import BurnIn
from flowsculpt.render.movie.codecs import ENCODES
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.hdr import nits_of_pq
from tests.conftest import QUALITY, TINY, ProjectFolder
from tests.needed_plugins import needs_plugins
from tests.sounds import RATE, sine, times, write_sound

FRAME = RATE // 24

NAME = "T010_tiny"
HOME = Path("renders") / NAME / QUALITY / "deliver"
QUIET = FrameFormat("rec709", has_coverage=False)


@pytest.fixture
def there(finished, monkeypatch):
    """A finished project, which is the working folder."""
    monkeypatch.chdir(finished.path)
    return finished


def taken(there, frames: str | None = None) -> tuple[Project, RenderRequest]:
    project = Project(there.path, cores=1)
    asked = None if frames is None else FrameSelection.of_text(frames)
    return project, project.find_request(NAME, QUALITY, asked)


def silent(name: str, count: int):
    return lambda: None


def test_a_shot_is_delivered_once_and_found_again(there):
    words = ("deliver", NAME, "-q", QUALITY, "--as", "review,prores4444", "--burn-in", "all", "--json")
    first, again = (json.loads(there.call(*words).out) for _ in range(2))
    assert [each["up_to_date"] for each in first["deliverables"]] == [False, False]
    assert [each["up_to_date"] for each in again["deliverables"]] == [True, True]
    assert {each["path"] for each in again["deliverables"]} == {
        (HOME / f"{NAME}.1-6.review.mp4").as_posix(),
        (HOME / f"{NAME}.1-6.prores4444.mov").as_posix(),
    }
    facts = probe_movie(there.path / HOME / f"{NAME}.1-6.prores4444.mov")
    assert (facts.frames, facts.timecode, facts.alpha) == (6, "00:00:00:01", True)
    other = there.call(*words[:-2], "shot,frame", "--json")
    assert not any(each["up_to_date"] for each in json.loads(other.out)["deliverables"])


@pytest.mark.parametrize("form", ["h264", "prores4444", "gif"])
def test_a_deliverable_that_somebody_wrote_into_is_handed_out_whole_again(there, form):
    words = ("deliver", NAME, "-q", QUALITY, "--as", form, "--json")
    (path,) = (Path(each["path"]) for each in json.loads(there.call(*words).out)["deliverables"])
    whole = path.read_bytes()
    (stored,) = (
        file
        for file in there.path.glob(f".flowsculpt/store/*/*/*{path.suffix}")
        if file.read_bytes() == whole
    )
    for file in (path, stored):
        file.chmod(0o644)
        with file.open("r+b") as damaged:
            damaged.seek(len(whole) // 2)
            damaged.write(b"damage")
        assert there.call(*words).code == 0
        assert path.read_bytes() == whole
        assert stored.read_bytes() == whole


def test_only_what_is_asked_for_is_rendered_and_no_other_movie_made(project):
    done = project.run("deliver", NAME, "-q", QUALITY, "-f", "2-3", "--as", "h264", "--slate", "apart")
    assert done.code == 0, done.err
    assert [path.name for path in project.frames()] == [f"{NAME}.0002.exr", f"{NAME}.0003.exr"]
    assert sorted(path.name for path in (project.path / HOME).iterdir()) == [
        f"{NAME}.2-3.h264.mp4",
        f"{NAME}.2-3.h264.slate.mp4",
    ]
    assert not list((project.path / "renders" / NAME / QUALITY).glob("*.mp4"))
    assert probe_movie(project.path / HOME / f"{NAME}.2-3.h264.slate.mp4").frames == 48


def test_pictures_that_move_on_pages_play_without_end_and_at_their_rate(there, tmp_path):
    hooked = tmp_path / "mine"
    shutil.copytree(Path(__file__).parents[3] / "profiles/local", hooked)
    program = f"import sys; open({str(tmp_path / 'told')!r}, 'w').write(sys.stdin.read())"
    (hooked / "hooks.yaml").write_text(
        json.dumps({"files_delivered": shlex.join([sys.executable, "-c", program])})
    )
    words = ("deliver", NAME, "-q", QUALITY, "--as", "gif,webp", "--profile", str(hooked))
    done = there.call(*words)
    assert done.code == 0, done.err
    told = json.loads((tmp_path / "told").read_text())
    paths = [Path(each["path"]) for each in told["deliverables"]]
    assert [path.name for path in paths] == [f"{NAME}.1-6.gif", f"{NAME}.1-6.webp"]
    seen = []
    for path in paths:
        with Image.open(path) as picture:
            assert picture.info["loop"] == 0  # without end
            assert path.suffix != ".gif" or picture.info["extension"][0] == b"NETSCAPE2.0"
            times, shown = [], []
            for number in range(picture.n_frames):
                picture.seek(number)
                shown.append(np.asarray(picture.convert("RGB"), np.float64))
                times.append(picture.info["duration"])
            assert sum(times) == pytest.approx(250, abs=10)
            seen.append(shown)
    assert len(seen[0]) == 6 and np.abs(np.array(seen[0][-1]) - seen[1][-1]).mean() < 4.0
    assert probe_movie(paths[0]).frames == 6


@pytest.mark.parametrize("rate", [60, 1000])
def test_no_frame_of_a_gif_is_so_short_that_browsers_slow_it_down(tmp_path: Path, rate: int) -> None:
    frames = np.random.default_rng(1).integers(0, 65535, (rate // 5, 8, 8, 3)).astype(np.uint16)
    write_gif(tmp_path / "fast.gif", lambda: iter(frames), Fraction(rate))
    times = []
    with Image.open(tmp_path / "fast.gif") as picture:
        for number in range(picture.n_frames):
            picture.seek(number)
            times.append(picture.info["duration"])
    assert min(times) >= 20 and sum(times) == pytest.approx(200, abs=20)


def test_a_film_is_delivered_with_its_own_sound_and_a_slate_before_it(there):
    with av.open("shots/tone.wav", "w") as file:
        stream = file.add_stream("pcm_s16le", rate=48000, layout="mono")
        wave = av.AudioFrame.from_ndarray(np.full((1, 48000), 9000, np.int16), format="s16", layout="mono")
        wave.sample_rate = 48000
        file.mux(stream.encode(wave))
        file.mux(stream.encode(None))
    Path("shots/reel.yaml").write_text(
        f"title: R\nshots: [{NAME}, {{shot: {NAME}, frames: 2-6, dissolve: 2}}]\ntitle_seconds: 0\n"
        "sound: {file: tone.wav}\n"
    )
    done = there.call("deliver", "reel", "-q", QUALITY, "--as", "prores4444,h265", "--slate", "head")
    assert done.code == 0, done.err
    home = there.path / "renders/film" / QUALITY / "deliver"
    facts = probe_movie(home / "reel.prores4444.mov")
    assert (facts.frames, facts.timecode, facts.sound) == (48 + 9, "00:59:58:00", "pcm_s24le")
    assert facts.seconds == pytest.approx((48 + 9) / 24)
    with av.open(str(home / "reel.prores4444.mov")) as movie:
        audio = np.concatenate([f.to_ndarray().reshape(-1, 2)[:, 0] for f in movie.decode(audio=0)])
    assert np.flatnonzero(audio)[0] == 2 * 48000  # it begins with the film, not with the slate
    assert probe_movie(home / "reel.h265.mp4").sound == "aac"


def test_a_film_of_high_dynamic_range_has_a_slate_and_burn_ins_of_graphics_white(there):
    words = ("-f", "2-3", "--as", "hdr10", "--slate", "head", "--burn-in", "all")
    done = there.call("deliver", NAME, "-q", QUALITY, *words)
    assert done.code == 0, done.err
    path = there.path / HOME / f"{NAME}.2-3.hdr10.mp4"
    facts = probe_movie(path)
    assert (facts.frames, facts.primaries, facts.transfer, facts.matrix) == (48 + 2, 9, 16, 9)
    with av.open(str(path)) as movie:
        planes = [f.reformat(format="yuv444p16le").to_ndarray() for f in movie.decode(video=0)]
    slate, last = (nits_of_pq((each[..., 0] / 256.0 - 16.0) / 219.0) for each in (planes[0], planes[-1]))
    assert 120 < slate.max() < 240
    assert 100 < last[-20:].max() < 300  # the burn-in, at the lower edge
    Path("shots/T011_raw.yaml").write_text(TINY + "view: {view: Raw}\n")
    refused = there.call("deliver", "T011_raw", "-q", QUALITY, "--as", "hlg")
    assert refused.code == 2
    assert "HDR movies show light by ACES 2.0, not by the shot's view 'Raw'" in refused.err


def test_frames_that_failed_are_cards_that_say_why(there):
    project, request = taken(there)
    keys = request.keys.pictures(project.store)
    whole = shot_source(request, project.store, {})
    project.store.discard("frame", keys[3].frame)
    source = shot_source(request, project.store, {(NAME, 3): "frame 3: the surface is torn"})
    assert source.lost == (f"{NAME} frames 3",)
    shown = [frame for frame, _ in source.frames(QUIET)]
    same = [bool((a == b[0]).all()) for a, b in zip(shown, whole.frames(QUIET), strict=True)]
    assert same.count(False) <= 1
    assert shown[2].mean() < 0.3 * shown[1].mean()
    assert source.content != whole.content
    order = DeliveryOptions((ENCODES["review"],), burn_in=BurnIn())
    (made,) = Delivery(source, order, project.store).make(silent)
    assert made.frames == 6
    assert probe_movie(there.path / made.path).frames == 6


def test_a_frame_that_cannot_be_read_is_told_and_forgotten_and_nothing_delivered(there):
    project, request = taken(there)
    key = request.keys.pictures(project.store)[3].frame
    project.store.discard("frame", key)
    project.store.put("frame", key, lambda path: path.write_bytes(b"cut short"))
    source = shot_source(request, project.store, {})
    with pytest.raises(FrameError, match=r"0003\.exr is damaged; run again"):
        Delivery(source, DeliveryOptions((ENCODES["review"],)), project.store).make(silent)
    assert not project.store.holds("frame", key)
    assert not list((there.path / "renders" / NAME / QUALITY / "deliver").glob("*.mp4"))


def test_the_coverage_of_the_subject_is_the_alpha(there):
    project, request = taken(there, "2-3")
    source = shot_source(request, project.store, {})
    assert source.has_coverage
    frame, _ = next(source.frames(FrameFormat("rec709", has_coverage=True)))
    assert frame.shape == (54, 96, 4)
    assert frame[27, 48, 3] == 65535 and frame[1, 1, 3] == 0
    for number in request.requested:
        project.store.discard("raw", request.keys.pictures(project.store)[number].raw)
    assert not shot_source(request, project.store, {}).has_coverage


def test_nothing_to_deliver_is_told(project, monkeypatch):
    monkeypatch.chdir(project.path)
    fresh = Project(project.path, cores=1)
    with pytest.raises(FrameError, match=r"none of its frames could be made.* the first error: no light"):
        shot_source(fresh.find_request(NAME, QUALITY), fresh.store, {(NAME, 1): "no light"})


@needs_plugins("versions")
def test_a_published_version_is_named(there):
    project, request = taken(there)
    assert dict(shot_source(request, project.store, {}).facts)["version"] == "in work"
    assert there.call("publish", NAME, "-q", QUALITY).code == 0
    assert dict(shot_source(request, project.store, {}).facts)["version"] == "v001"


def test_a_film_says_of_every_frame_where_it_comes_from(there):
    project = Project(there.path, cores=1)
    Path("shots/reel.yaml").write_text(
        f"title: R\nshots: [{{shot: {NAME}, frames: 1-3}}, {{shot: {NAME}, frames: 4-6, dissolve: 2}}]\n"
        "title_seconds: 0.125\n"
    )
    source = film_source(*project.edit(QUALITY, Path("shots/reel.yaml")), project.store, {})
    told = [values.get("frame") for _, values in source.frames(QUIET)]
    assert told == [None, None, None, 1, 2, 5, 6]
    assert source.count == len(told)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("--as", "prores"), 2, "'prores' is not a deliverable. Did you mean 'prores4444'?"),
        (("--as", ","), 2, "is not a deliverable"),
        (("--burn-in", "fraem"), 2, "'fraem' cannot be burnt in. Did you mean 'frame'?"),
        (("--slate", "haed"), 2, "Did you mean 'head'?"),
        (("-f", "9"), 2, "frame 9 is not in the shot, which has 1-6"),
        (("--sound", "none.wav"), 3, "none.wav: file not found"),
        (("-o", "shots/film.yaml"), 4, "a file stands where a folder should be"),
    ],
)
def test_what_cannot_be_delivered_is_told_in_one_line(there, words, code, says):
    done = there.call("deliver", NAME, "-q", QUALITY, *words)
    assert done.code == code
    assert says in done.err
    assert len(done.err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "warns"),
    [
        (("--as", "phone,review"), "phone: T010_tiny has 96 × 54 pixels, and such screens usually"),
        (("--as", "review,hlg"), "Use -q final for 1920 × 1080."),
        (("--as", "phone", "-q", "final", "--scale", "50%"), "-q final, without --scale, for 1920 × 1080."),
        (("--as", "phone", "--set", "picture.size=[192,108]", "-q", "final"), "larger picture: {size: …}"),
        (("--as", "phone", "-q", "final"), ""),
        (("--as", "review,h264,prores4444,gif"), ""),
    ],
)
def test_pictures_smaller_than_the_screens_of_a_deliverable_are_warned_of(there, words, warns):
    done = there.call("--dry-run", "deliver", NAME, "-q", QUALITY, *words)
    assert done.code == 0
    assert warns in done.err and len(done.err.splitlines()) == bool(warns)


def test_a_dry_run_delivers_nothing(there):
    done = there.call("--dry-run", "deliver", NAME, "-q", QUALITY, "--as", "av1")
    assert done.code == 0, done.err
    assert "Nothing to be done.\nThen: encoding T010_tiny as av1." in done.out
    assert not (there.path / HOME).exists()


def heard(path: Path) -> Floats:
    """The left channel of a movie, −1 … 1."""
    with av.open(str(path)) as movie:
        frames = [f.to_ndarray() for f in movie.decode(audio=0)]
    if frames[0].dtype == np.int32:
        return np.concatenate([f.reshape(-1, 2)[:, 0] for f in frames]) / 2.0**31
    return np.concatenate([f[0] for f in frames])


def sounding(project: ProjectFolder) -> ProjectFolder:
    """Give a shot of 6 frames a sound with a burst in the middle of its third frame."""
    burst = (times(1) * 24 >= 2.5) & (times(1) * 24 < 3.0)
    write_sound(project.path / "shots/burst.wav", np.where(burst, sine(3000, 1), 0.0))
    project.shot.write_text(project.shot.read_text() + "sound: {file: burst.wav}\n")
    return project


def test_movies_and_deliveries_have_the_sound_of_their_frames(finished: ProjectFolder) -> None:
    """Frames that are there are kept: a sound that no value follows changes none."""
    before = {path: path.stat().st_mtime_ns for path in sounding(finished).frames()}
    words = ("deliver", NAME, "-q", QUALITY, "-f", "2-5", "--as", "prores4444", "--slate", "head")
    finished.render()
    assert finished.call(*words).code == 0
    movie = finished.path / f"renders/{NAME}/{QUALITY}/{NAME}.mp4"
    facts = probe_movie(movie)
    assert (facts.frames, facts.sound) == (6, "aac")
    assert 6 / 24 <= facts.seconds <= 6 / 24 + 2 * 1024 / RATE
    loud = np.flatnonzero(np.abs(heard(movie)) > 0.1)
    assert abs(loud[0] - 2.5 * FRAME) < 200 and abs(loud[-1] - 3 * FRAME) < 200
    samples = heard(movie.parent / f"deliver/{NAME}.2-5.prores4444.mov")
    assert len(samples) == (48 + 4) * FRAME
    assert np.flatnonzero(samples)[0] - 1 == (48 + 1.5) * FRAME  # the first sample of a sine is 0
    assert {path: path.stat().st_mtime_ns for path in finished.frames()} == before
