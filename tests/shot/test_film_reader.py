"""Edits: their shots in order, and what is wrong in any of their files."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.shot import read_film

GOOD = (Path(__file__).parent / "cube.yaml").read_text(encoding="utf-8")
FILM = "title: Two\nshots: [A, B]\nrate: 24\n"


def written(folder: Path, text: str, name: str = "a.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_a_film_is_its_shots_in_order(tmp_path: Path) -> None:
    for name in ("A", "B"):
        written(tmp_path, GOOD.replace("Cube", name), f"{name}.yaml")
    film = read_film(written(tmp_path, FILM.replace("[A, B]", "[B, A]"), "film.yaml"))
    assert [shot.title for shot in film.shots] == ["B", "A"]
    assert (film.title, str(film.rate), film.entries[0].seconds) == ("Two", "24", 3.0)


def test_a_film_tells_what_is_wrong_in_all_its_files(tmp_path: Path) -> None:
    written(tmp_path, GOOD.replace("rate: 24", "rate: 30").replace('"2s"', "49"), "A.yaml")
    written(tmp_path, GOOD.replace("speed", "sped"), "B.yaml")
    with pytest.raises(ShotError) as error:
        read_film(written(tmp_path, FILM + "subtitel: x\n", "film.yaml"))
    text = str(error.value).replace(f"{tmp_path}/", "")
    assert "film.yaml:2:9: A plays at 30 frames per second and the film at 24" in text
    assert "film.yaml:4:1: subtitel: unknown name. Did you mean 'subtitle'?" in text
    assert "B.yaml:9:20: flows.0.sum.1.rotation.sped: unknown name" in text


def test_a_card_stands_for_a_minute_at_most(tmp_path: Path) -> None:
    for name in ("A", "B"):
        written(tmp_path, GOOD, f"{name}.yaml")
    with pytest.raises(
        ShotError,
        match=r"film\.yaml:4:1: title_seconds: 1000000000.* is out of range; it must be at most 60$",
    ):
        read_film(written(tmp_path, FILM + "title_seconds: 1e9\n", "film.yaml"))


def test_a_shot_that_is_not_there_is_a_missing_input(tmp_path: Path) -> None:
    written(tmp_path, GOOD, "A.yaml")
    with pytest.raises(
        MissingInputError, match=r"film\.yaml:2:12: shot not found: .*B\.yaml\. There are: A\."
    ):
        read_film(written(tmp_path, FILM, "film.yaml"))


def test_an_edit_without_any_shot_beside_it_is_told_what_makes_one(tmp_path: Path) -> None:
    with pytest.raises(
        MissingInputError,
        match=r"shot not found: .*A\.yaml\. No shot is beside the edit; flowsculpt new NAME makes one\.",
    ):
        read_film(written(tmp_path, "title: One\nshots: [A]\n", "film.yaml"))


def test_the_films_own_shots_are_good() -> None:
    film = read_film(Path(__file__).parents[2] / "shots" / "film.yaml")
    assert len(film.shots) == 3
    assert all(2 <= shot.rate.seconds(len(shot.frames)) <= 8 for shot in film.shots)


def test_a_film_of_cards_alone_is_refused(tmp_path: Path) -> None:
    cards = FILM.replace("[A, B]", "[{card: Act one, seconds: 2}, {card: Act two, seconds: 2}]")
    with pytest.raises(ShotError, match=r"film\.yaml:2:\d+: shots has cards only; .* Add one\.$"):
        read_film(written(tmp_path, cards, "film.yaml"))


def test_a_film_without_a_rate_takes_that_of_its_shots(tmp_path: Path) -> None:
    without = FILM.replace("rate: 24\n", "")
    for name, rate in (("A", "23.976"), ("B", "23.976")):
        written(tmp_path, GOOD.replace("rate: 24", f"rate: {rate}"), f"{name}.yaml")
    film = read_film(written(tmp_path, without, "film.yaml"))
    assert film.rate == film.shots[0].rate != FrameRate.of(24)
    written(tmp_path, GOOD.replace("rate: 24", "rate: 30").replace('"2s"', "49"), "B.yaml")
    with pytest.raises(ShotError, match="B plays at 30 frames per second and the film at 24000/1001"):
        read_film(tmp_path / "film.yaml")
