"""The sound of movies: files as they were when the work was planned, and where they are heard."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.serialise import OMIT_DEFAULT, to_plain

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot.shot import SoundTrack
    from flowsculpt.render.movie.movie_sound import Samples, Segment, Sound


@dataclass(frozen=True)
class AudioTrack:
    """The sound of a shot or a film: a file as it was when the work was planned, and its place.

    start    seconds into the shot or film; below 0 its beginning is left out
    gain     decibels
    fade_in, fade_out  seconds
    silence  seconds that timestamps in the file leave empty
    """

    file: str
    digest: str
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0
    silence: float = field(default=0.0, metadata=OMIT_DEFAULT)

    @classmethod
    def of(cls, track: SoundTrack) -> AudioTrack:
        return cls(**{**vars(track), "file": str(track.file)})

    @property
    def content(self) -> dict[str, Any]:
        """All that decides the sound, which the place of the file does not."""
        return {name: value for name, value in to_plain(self).items() if name != "file"}

    @property
    def is_unchanged(self) -> bool:
        path = Path(self.file)
        return path.is_file() and InputFile(path).digest() == self.digest

    @property
    def seconds(self) -> float:
        """The length of the file. Raises MissingInputError or BadInputError where it cannot be read."""
        from flowsculpt.render.movie.movie_sound import require_sound  # imports PyAV, which takes time

        return require_sound(Path(self.file))

    def sound(self) -> Sound:
        """Return the sound. Raises FrameError where the file was changed."""
        from flowsculpt.render.movie.movie_sound import Sound

        path = Path(self.file)
        if not self.is_unchanged:
            raise FrameError(f"{path} was changed while the film was made; run again")
        return Sound(path, self.start, self.gain, self.fade_in, self.fade_out)


@dataclass(frozen=True)
class AudioClip:
    """Sounds under a run of frames of a movie.

    tracks     their starts count from the first frame of the shot, or of the film
    first      frames of the movie before the run
    frames     the length of the run
    skipped    frames of the shot before those in the run
    rise, fall  frames over which it comes and goes: dissolves
    """

    tracks: tuple[AudioTrack, ...]
    first: int
    frames: int
    skipped: int = 0
    rise: int = 0
    fall: int = 0

    @classmethod
    def of_file(cls, file: Path, frames: int = 0) -> AudioClip:
        """Return a sound file under so many frames. Raises MissingInputError or BadInputError."""
        from flowsculpt.render.movie.movie_sound import silence_in

        silence = silence_in(file)
        return cls((AudioTrack(str(file.absolute()), InputFile(file).digest(), silence=silence),), 0, frames)

    @property
    def content(self) -> list[Any]:
        """All that decides the sound, plain data."""
        tracks = [track.content for track in self.tracks]
        return [tracks, self.first, self.frames, self.skipped, self.rise, self.fall]

    def later(self, frames: int) -> AudioClip:
        """Return the clip so many frames later."""
        return replace(self, first=self.first + frames)

    def segment(self, rate: FrameRate) -> Segment:
        """Return what is mixed. Raises FrameError where a file was changed."""
        from flowsculpt.render.movie.movie_sound import Segment

        skipped = float(self.skipped / rate.fps)
        sounds = [track.sound() for track in self.tracks]
        moved = tuple(replace(sound, start=sound.start - skipped) for sound in sounds)
        first, frames, rise, fall = (
            Fraction(count) / rate.fps for count in (self.first, self.frames, self.rise, self.fall)
        )
        return Segment(moved, first, frames, rise, fall)

    @staticmethod
    def mix(clips: Sequence[AudioClip], frames: int, rate: FrameRate) -> Iterator[Samples] | None:
        """Return the sound of clips under a movie of so many frames, in blocks; None without clips.

        Raises FrameError where a file was changed, and as `require_sound` of `movie_sound` does.
        """
        if not clips:
            return None
        from flowsculpt.render.movie.movie_sound import mixed

        return mixed([clip.segment(rate) for clip in clips], Fraction(frames) / rate.fps)


def sound_of_frames(
    tracks: tuple[AudioTrack, ...], shot: Sequence[int], shown: Sequence[int], first: int = 0
) -> tuple[AudioClip, ...]:
    """Return the sound of frames of a shot that are shown one after another; none if they skip or turn back.

    shot   all frames of the shot, ascending
    shown  those in the movie
    first  frames of the movie before them
    """
    if not tracks or list(shown) != list(range(shown[0], shown[0] + len(shown))):
        return ()
    return (AudioClip(tracks, first, len(shown), skipped=shown[0] - shot[0]),)
